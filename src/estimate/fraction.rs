//! The fraction of an estimate's work that is done.

use super::baseline;
use super::estimation::{Estimation, Stage, Work};
use super::schedule::{Part, Row, cost, latent_cost, rounds_left};
use crate::observation::Observation;

impl Estimation {
    /// Fraction of the work that is done, by what its parts cost.
    pub(super) fn fraction_done(&self) -> f32 {
        let texels = match &self.stage {
            Stage::Settled(_) => return 1.0,
            Stage::Baseline { run, .. } => {
                let done = run.as_ref().map_or(0, |(baseline, _)| baseline.steps());
                return done as f32 / baseline::STEPS as f32;
            }
            Stage::Latent { .. } => None,
            Stage::Texels(texels) => Some(texels),
        };
        let at = texels.map(|texels| texels.at);
        let (rows, photographs) = (self.rows(), self.photographs.len());
        let seen = photographs.min(self.options.schedule.photographs);
        let all = self.photographs.full().first().map_or(0, Observation::texels);
        let counts = [all >> (2 * self.photographs.thinning()), all];
        let [mut done, all] = self.latent.as_ref().map_or([0.0; 2], |latent| {
            latent_cost(latent.work(), latent.averages().texels(), seen)
        });
        let mut left = all - done;
        for (i, row) in rows.iter().enumerate() {
            // The last steps see all photographs.
            let seen = if i + 1 < rows.len() { seen } else { photographs };
            let part = |part| cost(row, part, seen, counts);
            let parts = [Part::Before, Part::Phase, Part::After];
            let round: f32 = parts.iter().map(|p| part(*p)).sum();
            match at {
                Some(at) if i < at.row => done += rounds_left(row, 0) * round,
                Some(at) if i == at.row => {
                    let before = parts.iter().take_while(|p| **p != at.part).map(|p| part(*p));
                    let begun = texels.map_or(0.0, |texels| texels.work.done(row, at.part));
                    let here = before.sum::<f32>() + begun * part(at.part);
                    done += at.round as f32 * round + here;
                    left += round - here + rounds_left(row, at.round + 1) * round;
                }
                _ => left += rounds_left(row, 0) * round,
            }
        }
        // What lights have misled is done twice.
        let total = done + left;
        let again = match &self.stage {
            Stage::Latent { again, .. } => *again,
            _ => texels.is_some_and(|texels| texels.again),
        };
        if again {
            done += total;
        } else if texels.is_some_and(|texels| self.is_misled(texels)) {
            left += total;
        }
        done / (done + left).max(f32::MIN_POSITIVE)
    }
}

impl Work {
    /// Fraction of a part of a row that is done.
    fn done(&self, row: &Row, part: Part) -> f32 {
        let [done, all] = match self {
            Self::Pending => [0, 1],
            Self::Maps(solver, _) => {
                let all = if part == Part::Before { row.before } else { row.after };
                [solver.state.steps, all]
            }
            Self::Widths(trials) => trials.work(),
            Self::Lights(fit) => fit.work(),
            Self::Classes(trials) => [trials.costs.len(), trials.count()],
        };
        (done as f32 / all.max(1) as f32).min(1.0)
    }
}
