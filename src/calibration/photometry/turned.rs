//! Photographs turned by 180 degrees after capture: their flash lies on the opposite side.

use glam::DVec3;

use super::exposure;
use super::fit::{self, Solution};
use super::model::{Model, Problem, Sample, Shot, parameter};

/// A photograph is turned if that lowers the misfit by this and by this share.
const EVIDENCE: f64 = 12.0;
const EVIDENCE_SHARE: f64 = 0.3;
/// A flash nearer to the lens has no side, mm.
const LEAST_MM: f64 = 4.0;

/// The photographs with a better set of turned ones; `None` if there is none.
pub(super) fn find(
    samples: &[Sample],
    shots: &[Shot],
    problem: &Problem,
    light: &Solution,
) -> Option<Vec<Shot>> {
    if shots.len() < 3 || problem.offset_sigma_mm == DVec3::ZERO {
        return None;
    }
    let wishes: Vec<Wish> =
        (0..shots.len()).map(|i| Wish::of(samples, shots, problem, light, i)).collect();
    let turned = divided(&wishes)?;
    let turn = |(shot, turned): (&Shot, &bool)| Shot { turned: shot.turned ^ *turned, ..*shot };
    let with: Vec<Shot> = shots.iter().zip(&turned).map(turn).collect();
    let other = exposure::solve(samples, &with, problem, None);
    let sigma = other.sigma;
    let before = fit::misfit(samples, shots, problem, light, sigma);
    let after = fit::misfit(samples, &with, problem, &other, sigma);
    (before - after > EVIDENCE + EVIDENCE_SHARE * after).then_some(with)
}

/// Flash position preferred by one photograph, along its axes: mm, and information (inverse variances).
struct Wish {
    mm: [f64; 2],
    information: [f64; 2],
}

impl Wish {
    /// One step from the common light, with the photograph's own scale.
    fn of(
        samples: &[Sample],
        shots: &[Shot],
        problem: &Problem,
        light: &Solution,
        photo: usize,
    ) -> Self {
        let model = Model::new(shots, problem, &light.theta);
        let odd = 4.0 * light.sigma.max(light.photo_sigma[photo]);
        let rows: Vec<([f64; 2], f64)> = samples
            .iter()
            .filter(|s| s.frame == photo)
            .filter_map(|s| {
                let residual = model.residual(s)?;
                let by = |i| residual.derivatives().iter().find(|d| d.0 == i).map_or(0.0, |d| d.1);
                let axes = [by(parameter::OFFSET), by(parameter::OFFSET + 1)];
                Some((axes.map(|d| d / s.sigma), residual.value / s.sigma))
            })
            .filter(|(_, value)| value.abs() < odd)
            .collect();
        let count = rows.len().max(1) as f64;
        /// Derivatives by the offset's axes, and the residual, in standard deviations.
        type Row = ([f64; 2], f64);
        let mean = |f: &dyn Fn(&Row) -> f64| rows.iter().map(f).sum::<f64>() / count;
        let value = mean(&|row| row.1);
        let shared = light.offset_mm.to_array();
        let mut wish = Self { mm: [shared[0], shared[1]], information: [0.0; 2] };
        for k in 0..2 {
            let own = mean(&|row| row.0[k]);
            let variance = mean(&|row| (row.0[k] - own).powi(2));
            let covariance = mean(&|row| (row.0[k] - own) * (row.1 - value));
            if variance > 0.0 {
                wish.mm[k] -= covariance / variance;
                wish.information[k] = count * variance / (3.0 * light.sigma.powi(2));
            }
        }
        wish
    }
}

/// Photographs that prefer the opposite side, if the others agree on one side.
fn divided(wishes: &[Wish]) -> Option<Vec<bool>> {
    let best = (0..wishes.len()).map(|seed| {
        let mut centre = wishes[seed].mm;
        let mut turned = vec![false; wishes.len()];
        for _ in 0..8 {
            for (turned, wish) in turned.iter_mut().zip(wishes) {
                *turned = distance(wish, centre, -1.0) < distance(wish, centre, 1.0);
            }
            for k in 0..2 {
                let signed = wishes.iter().zip(&turned);
                let sum = signed
                    .map(|(w, t)| w.information[k] * if *t { -w.mm[k] } else { w.mm[k] })
                    .sum::<f64>();
                let all = wishes.iter().map(|w| w.information[k]).sum::<f64>();
                centre[k] = if all > 0.0 { sum / all } else { 0.0 };
            }
        }
        let sign = |t: &bool| if *t { -1.0 } else { 1.0 };
        let left: f64 = wishes.iter().zip(&turned).map(|(w, t)| distance(w, centre, sign(t))).sum();
        (left, centre, turned)
    });
    let (_, centre, mut turned) = best.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // The majority is upright; in a tie the first photograph is.
    let count = turned.iter().filter(|t| **t).count();
    if 2 * count > turned.len() || (2 * count == turned.len() && turned[0]) {
        turned.iter_mut().for_each(|t| *t = !*t);
    }
    let is_clear = centre[0].hypot(centre[1]) > LEAST_MM && turned.contains(&true);
    is_clear.then_some(turned)
}

fn distance(wish: &Wish, centre: [f64; 2], sign: f64) -> f64 {
    (0..2).map(|k| wish.information[k] * (wish.mm[k] - sign * centre[k]).powi(2)).sum()
}
