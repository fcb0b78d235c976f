//! The choice of a prior and the joint solve.

use super::work::{Context, Done, Work};
use crate::Result;
use crate::estimate::joint::{JointFit, PriorChoice, STEPS, flattened};
use crate::estimate::options::JointPrior;

/// The prior of the joint solve, chosen by prediction.
#[derive(Default)]
pub struct Choice {
    choice: Option<Box<PriorChoice>>,
    chosen: Option<JointPrior>,
}

impl Work for Choice {
    fn name(&self) -> &'static str {
        "choice"
    }

    fn cost(&self, photographs: usize) -> f32 {
        60.0 + 40.0 * photographs.min(12) as f32
    }

    fn fraction(&self) -> f32 {
        let [done, all] = self.choice.as_ref().map_or([0, 1], |choice| choice.work());
        done as f32 / all.max(1) as f32
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        let Some(map_state) = context.map_state else { return Ok(Done::silent(true)) };
        let choice = self.choice.get_or_insert_with(|| {
            let maps = flattened(&map_state.maps, 1.0);
            let board = !context.task.free_lights;
            let photographs = context.photographs.working();
            Box::new(PriorChoice::new(photographs, &maps, board, context.options))
        });
        choice.step();
        let ended = choice.is_done();
        if ended {
            self.chosen = choice.chosen();
            map_state.joint = self.chosen.unwrap_or(map_state.joint);
        }
        let [least, _] = choice.range();
        Ok(Done::new(ended, [f64::NAN, least]))
    }

    fn result(&self) -> Option<String> {
        let JointPrior {
            between_classes,
            relief,
            slope,
            diffuse: _,
            specular,
            roughness,
            noise,
            directions,
            coated,
            sheen,
        } = self.chosen?;
        Some(format!(
            "{relief:.2} of the relief, sigmas between classes {between_classes:.3}, of slopes {slope:.3}, specular {specular:.3}, \
             roughness {roughness:.3}, noise {noise:.2}{}{}{}",
            ["", ", anisotropic", ", anisotropic in two directions"][directions.min(2)],
            if coated { ", coated" } else { "" },
            if sheen { ", with sheen" } else { "" },
        ))
    }
}

/// The joint solve.
#[derive(Default)]
pub struct Joint {
    fit: Option<Box<JointFit>>,
    fraction: f32,
    shared: Option<String>,
}

impl Work for Joint {
    fn name(&self) -> &'static str {
        "joint"
    }

    fn cost(&self, photographs: usize) -> f32 {
        30.0 + 20.0 * photographs as f32
    }

    fn fraction(&self) -> f32 {
        self.fraction
    }

    fn step(&mut self, context: &mut Context) -> Result<Done> {
        let Some(map_state) = context.map_state else { return Ok(Done::silent(true)) };
        let fit = self.fit.get_or_insert_with(|| {
            let maps = flattened(&map_state.maps, 1.0);
            let (photographs, board) = (context.photographs.working(), !context.task.free_lights);
            Box::new(JointFit::new(photographs, &maps, map_state.joint, board, context.options))
        });
        let before = fit.cost();
        fit.step();
        context.meter.count();
        self.fraction = fit.steps() as f32 / STEPS as f32;
        let done = Done::new(fit.is_done(), [before, fit.cost()]);
        if done.ended {
            self.shared = Some(fit.shared(&context.options.joint.shared));
            if let Some(fit) = self.fit.take() {
                *context.lobes = fit.finish(context.photographs, map_state);
            }
        }
        Ok(done)
    }

    fn result(&self) -> Option<String> {
        self.shared.clone()
    }
}
