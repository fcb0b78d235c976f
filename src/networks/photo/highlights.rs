//! Diffuse albedo under highlights, where a photograph hardly determines it.
//!
//! The tail of a highlight is predictable to 10 to 15 % of its radiance (lobes, tone curves), and
//! saturated values are only lower bounds. The network therefore leaves holes and gray spots.
//! Unreliable cells of [`CELL`] texels get their level from the surroundings: a membrane over all
//! cells, attached to each by its reliability. Detail within cells is kept.

use crate::Svbrdf;
use crate::interpolation::{between, bilinear};
use crate::observation::Observation;
use crate::render::render;
use crate::svbrdf::channel;

/// Texels per side of a cell.
const CELL: usize = 16;
/// Relative uncertainty of a highlight's radiance.
const TAIL: f32 = 0.15;
/// Acceptable deviation of diffuse radiance, relative to its mean.
const ENOUGH: f32 = 0.1;
/// Reach of saturation, texels.
const REACH: usize = 2;
/// Weight of differences between neighbouring cells; a reliable cell's own level has weight 1.
const STIFFNESS: f32 = 0.5;
/// Weight of the network's level, independent of reliability.
const LEAST_WEIGHT: f32 = 0.05;
/// Sweeps over the cells, sufficient for the largest hole.
const SWEEPS: usize = 200;
/// Offset of roots of albedo used as divisors.
const LEAST_ROOT: f32 = 1e-3;

/// Replaces the level of the diffuse albedo under highlights. `maps` are the network's maps of `observation`.
pub(super) fn complete_diffuse(maps: &mut Svbrdf, observation: &Observation) {
    let (w, h) = (maps.width(), maps.height());
    let reliability = reliability(maps, observation);
    let cells = Cells { columns: w.div_ceil(CELL), rows: h.div_ceil(CELL), width: w, height: h };
    let weight = cells.means(|i| reliability[i]);
    if weight.iter().all(|&weight| weight > 0.99) {
        return;
    }
    for c in channel::DIFFUSE..channel::DIFFUSE + 3 {
        let plane = maps.plane_mut(c);
        let plain = cells.means(|i| plane[i].sqrt());
        let weighted = cells.means(|i| reliability[i] * plane[i].sqrt());
        let mut ratio = cells.membrane(&weight, &weighted, &plain);
        for ((ratio, plain), weight) in ratio.iter_mut().zip(plain).zip(&weight) {
            *ratio = 1.0 + (1.0 - weight) * ((*ratio + LEAST_ROOT) / (plain + LEAST_ROOT) - 1.0);
        }
        for y in 0..h {
            for x in 0..w {
                let ratio = cells.at(&ratio, x, y);
                plane[y * w + x] *= ratio * ratio;
            }
        }
    }
    maps.clamp();
}

/// How well the photograph determines the diffuse albedo of each texel, 0 to 1: acceptable variance
/// over acceptable plus highlight variance.
fn reliability(maps: &Svbrdf, observation: &Observation) -> Vec<f32> {
    let (w, h, n) = (maps.width(), maps.height(), maps.texels());
    let mut whole = vec![0.0; 3 * n];
    render(maps, &observation.view, &mut whole);
    let mut specular = vec![0.0; 3 * n];
    let mut black = maps.clone();
    black.planes_mut()[channel::DIFFUSE * n..(channel::DIFFUSE + 3) * n].fill(0.0);
    render(&black, &observation.view, &mut specular);
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    let enough = (ENOUGH * (mean(&whole) - mean(&specular))).max(1e-3 * mean(&whole));
    let saturated: Vec<bool> =
        (0..n).map(|i| (0..3).any(|c| observation.radiance(c, i) < 0.0)).collect();
    let near_saturated = |x: usize, y: usize| {
        let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(w);
        (y.saturating_sub(REACH)..(y + REACH + 1).min(h))
            .any(|y| saturated[y * w..][columns.clone()].contains(&true))
    };
    let reliability = |i: usize| {
        if observation.weight(i) == 0.0 || near_saturated(i % w, i / w) {
            return 0.0;
        }
        let tail = TAIL * (0..3).map(|c| specular[c * n + i]).fold(0.0, f32::max);
        let share = enough * enough / (enough * enough + tail * tail);
        if share.is_finite() { share } else { 0.0 }
    };
    (0..n).map(reliability).collect()
}

/// Cells of planes of `width * height` texels, smaller at the right and lower edge.
struct Cells {
    columns: usize,
    rows: usize,
    width: usize,
    height: usize,
}

impl Cells {
    /// Means over the texels of each cell.
    fn means(&self, value: impl Fn(usize) -> f32) -> Vec<f32> {
        let (mut sums, mut counts) =
            (vec![0.0; self.columns * self.rows], vec![0.0; self.columns * self.rows]);
        for y in 0..self.height {
            for x in 0..self.width {
                let cell = y / CELL * self.columns + x / CELL;
                sums[cell] += value(y * self.width + x);
                counts[cell] += 1.0;
            }
        }
        sums.iter().zip(counts).map(|(sum, count): (&f32, f32)| sum / count).collect()
    }

    /// Membrane attached to `weighted / weight` with `weight`, to `plain` with [`LEAST_WEIGHT`] and
    /// to neighbours with [`STIFFNESS`] (Gauss-Seidel).
    fn membrane(&self, weight: &[f32], weighted: &[f32], plain: &[f32]) -> Vec<f32> {
        let mut values = plain.to_vec();
        for _ in 0..SWEEPS {
            for cell in 0..values.len() {
                let (x, y) = (cell % self.columns, cell / self.columns);
                let mut sum = weighted[cell] + LEAST_WEIGHT * plain[cell];
                let mut held = weight[cell] + LEAST_WEIGHT;
                let mut add = |there: bool, neighbour: usize| {
                    if there {
                        sum += STIFFNESS * values[neighbour];
                        held += STIFFNESS;
                    }
                };
                add(x > 0, cell.wrapping_sub(1));
                add(x + 1 < self.columns, cell + 1);
                add(y > 0, cell.wrapping_sub(self.columns));
                add(y + 1 < self.rows, cell + self.columns);
                values[cell] = sum / held;
            }
        }
        values
    }

    /// Bilinear interpolation between cell centres.
    fn at(&self, values: &[f32], x: usize, y: usize) -> f32 {
        let place = |at: usize| (at as f32 + 0.5) / CELL as f32 - 0.5;
        let (left, right, across) = between(place(x), self.columns);
        let (above, below, down) = between(place(y), self.rows);
        let value = |x: usize, y: usize| values[y * self.columns + x];
        let four =
            [value(left, above), value(right, above), value(left, below), value(right, below)];
        bilinear(four, [across, down])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::{Falloff, View};

    const SIDE: usize = 160;

    /// A glossy red plane from above, its maps with a gray hole under the highlight, and the area
    /// of the hole.
    fn red_with_a_hole() -> (Svbrdf, Svbrdf, Observation, impl Fn(usize) -> bool) {
        let mut truth = Svbrdf::new(SIDE, SIDE);
        for (c, value) in [0.5, 0.05, 0.04, 0.05, 0.05, 0.05, 0.2].into_iter().enumerate() {
            truth.plane_mut(channel::DIFFUSE + c).fill(value);
        }
        // detail to preserve
        for c in channel::DIFFUSE..channel::DIFFUSE + 3 {
            truth.plane_mut(c).iter_mut().step_by(2).for_each(|v| *v *= 0.8);
        }
        let view = View {
            sample_mm: [100.0, 100.0],
            camera_mm: [0.0, 0.0, 150.0],
            light_mm: [0.0, 0.0, 150.0],
            falloff: Falloff::InverseSquare { power_mm2: [7e4; 3] },
            ..View::default()
        };
        let mut radiance = vec![0.0; 3 * SIDE * SIDE];
        render(&truth, &view, &mut radiance);
        // Clipped values are negative.
        radiance.iter_mut().filter(|v| **v > 1.0).for_each(|v| *v = -1.0);
        let observation =
            Observation::new(SIDE, SIDE, view, &radiance, &vec![1.0; SIDE * SIDE]).unwrap();
        let hidden = |i: usize| {
            let (x, y) = ((i % SIDE) as f32 - 79.5, (i / SIDE) as f32 - 79.5);
            x.hypot(y) < 20.0
        };
        let mut holed = truth.clone();
        for i in (0..SIDE * SIDE).filter(|&i| hidden(i)) {
            for (c, gray) in [0.1, 0.15, 0.15].into_iter().enumerate() {
                holed.diffuse_mut()[c][i] = gray * if i % 2 == 0 { 0.8 } else { 1.0 };
            }
        }
        (truth, holed, observation, hidden)
    }

    fn error(maps: &Svbrdf, truth: &Svbrdf, at: impl Fn(usize) -> bool) -> f32 {
        let n = maps.texels();
        let texels: Vec<usize> = (0..n).filter(|&i| at(i)).collect();
        let squares = (channel::DIFFUSE..channel::DIFFUSE + 3).flat_map(|c| {
            texels.iter().map(move |&i| (maps.plane(c)[i] - truth.plane(c)[i]).powi(2))
        });
        (squares.sum::<f32>() / (3 * texels.len()) as f32).sqrt()
    }

    #[test]
    fn a_hole_under_a_highlight_is_filled_from_around() {
        let (truth, holed, observation, hidden) = red_with_a_hole();
        let before = error(&holed, &truth, &hidden);
        let mut filled = holed.clone();
        complete_diffuse(&mut filled, &observation);
        let after = error(&filled, &truth, &hidden);
        // The network's level in the hole has some weight, and cells are wider than the hole's edge.
        assert!(after < 0.5 * before, "{before} {after}");
        let around = |i: usize| !hidden(i);
        assert!(error(&filled, &truth, around) < 0.03, "{}", error(&filled, &truth, around));
        for c in [channel::SLOPE_X, channel::SPECULAR, channel::ROUGHNESS] {
            assert_eq!(filled.plane(c), holed.plane(c));
        }
    }

    #[test]
    fn reliable_maps_are_unchanged() {
        let (truth, _, observation, _) = red_with_a_hole();
        let mut matt = truth;
        for c in 0..3 {
            matt.specular_mut()[c].fill(1e-4);
        }
        let mut radiance = vec![0.0; 3 * SIDE * SIDE];
        render(&matt, &observation.view, &mut radiance);
        let weight = vec![1.0; SIDE * SIDE];
        let photograph =
            Observation::new(SIDE, SIDE, observation.view, &radiance, &weight).unwrap();
        let mut same = matt.clone();
        complete_diffuse(&mut same, &photograph);
        // the Fresnel part of the highlight remains
        assert!(error(&same, &matt, |_| true) < 1e-3);
    }
}
