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
    let offsets: Vec<OwnOffset> =
        (0..shots.len()).map(|i| OwnOffset::of(samples, shots, problem, light, i)).collect();
    let turned = opposite_sides(&offsets)?;
    let turn = |(shot, turned): (&Shot, &bool)| Shot { turned: shot.turned ^ *turned, ..*shot };
    let with: Vec<Shot> = shots.iter().zip(&turned).map(turn).collect();
    let other = exposure::solve(samples, &with, problem, None);
    let sigma = other.sigma;
    let before = fit::misfit(samples, shots, problem, light, sigma);
    let after = fit::misfit(samples, &with, problem, &other, sigma);
    (before - after > EVIDENCE + EVIDENCE_SHARE * after).then_some(with)
}

/// Flash position preferred by one photograph, along its axes: mm, and information (inverse variances).
struct OwnOffset {
    mm: [f64; 2],
    information: [f64; 2],
}

impl OwnOffset {
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
        let mut offset = Self { mm: [shared[0], shared[1]], information: [0.0; 2] };
        for k in 0..2 {
            let own = mean(&|row| row.0[k]);
            let variance = mean(&|row| (row.0[k] - own).powi(2));
            let covariance = mean(&|row| (row.0[k] - own) * (row.1 - value));
            if variance > 0.0 {
                offset.mm[k] -= covariance / variance;
                offset.information[k] = count * variance / (3.0 * light.sigma.powi(2));
            }
        }
        offset
    }
}

/// Photographs that prefer the opposite side, if the others agree on one side.
fn opposite_sides(offsets: &[OwnOffset]) -> Option<Vec<bool>> {
    let best = (0..offsets.len()).map(|seed| {
        let mut centre = offsets[seed].mm;
        let mut turned = vec![false; offsets.len()];
        for _ in 0..8 {
            for (turned, offset) in turned.iter_mut().zip(offsets) {
                *turned = distance(offset, centre, -1.0) < distance(offset, centre, 1.0);
            }
            for k in 0..2 {
                let signed = offsets.iter().zip(&turned);
                let sum = signed
                    .map(|(o, t)| o.information[k] * if *t { -o.mm[k] } else { o.mm[k] })
                    .sum::<f64>();
                let all = offsets.iter().map(|o| o.information[k]).sum::<f64>();
                centre[k] = if all > 0.0 { sum / all } else { 0.0 };
            }
        }
        let sign = |t: &bool| if *t { -1.0 } else { 1.0 };
        let left: f64 =
            offsets.iter().zip(&turned).map(|(o, t)| distance(o, centre, sign(t))).sum();
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

fn distance(offset: &OwnOffset, centre: [f64; 2], sign: f64) -> f64 {
    (0..2).map(|k| offset.information[k] * (offset.mm[k] - sign * centre[k]).powi(2)).sum()
}
