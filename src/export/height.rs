//! Height from the slopes of the normals, and the light of the surround that reaches a texel.

use std::f32::consts::PI;

use super::poisson::{Border, Differences, Grid};
use crate::parallel;
use crate::svbrdf::channel;
use crate::{Error, Result, Svbrdf};

/// Height above the mean plane, found from normals.
#[derive(Debug, Clone, PartialEq)]
pub struct Height {
    /// One value a texel, mm, row by row; mean 0.
    pub mm: Vec<f32>,
    /// Share of the squared slopes that no height explains, 0 to 1: noise, and normals that are no
    /// surface's.
    pub unexplained: f32,
}

impl Height {
    /// Finds the height whose slopes differ least from those of the maps in the squares' sum.
    /// `periodic`: the maps are tileable, and so is the height.
    ///
    /// Slopes are integrated from texel to texel by cubic interpolation, so that smooth surfaces
    /// come back to fourth order; borders need no assumption but that the surface ends there.
    ///
    /// # Errors
    /// [`Error::Argument`] where the size of the sample is not positive.
    pub fn of(maps: &Svbrdf, sample_mm: [f32; 2], periodic: bool) -> Result<Self> {
        let (w, h) = (maps.width(), maps.height());
        let spacing = texel_mm(maps, sample_mm)?;
        let border = if periodic { Border::Periodic } else { Border::Free };
        let grid =
            Grid { width: w, height: h, borders: [border; 2], spacing: spacing.map(f64::from) };
        let (p, q) = (maps.plane(channel::SLOPE_X), maps.plane(channel::SLOPE_Y));
        let mut differences = Differences { right: vec![0.0; w * h], down: vec![0.0; w * h] };
        let rows = differences.right.chunks_mut(w).zip(differences.down.chunks_mut(w));
        parallel::parts(rows, |y, (right, down)| {
            for x in 0..w {
                // The surface falls where the normal leans, and rows run downwards.
                right[x] = -spacing[0] * step(w, border, x, |x| p[y * w + x]);
                down[x] = spacing[1] * step(h, border, y, |y| q[y * w + x]);
            }
        });
        let mm = grid.integrate(&differences);
        let unexplained = grid.unexplained(&differences, &mm);
        Ok(Self { mm, unexplained })
    }

    /// Lowest and highest value, mm.
    pub fn range_mm(&self) -> [f32; 2] {
        let ends = (f32::INFINITY, f32::NEG_INFINITY);
        let (low, high) = self.mm.iter().fold(ends, |(a, b), &v| (a.min(v), b.max(v)));
        [low, high]
    }
}

/// Size of a texel, mm.
fn texel_mm(maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<[f32; 2]> {
    if !sample_mm.iter().all(|v| v.is_finite() && *v > 0.0) {
        let message = format!("{sample_mm:?} given, two positive lengths expected");
        return Err(Error::argument("sample_mm", message));
    }
    Ok([sample_mm[0] / maps.width() as f32, sample_mm[1] / maps.height() as f32])
}

/// Mean slope between the centres of texels `i` and `i + 1` of `n`: the integral of the cubic
/// through four neighbours, of the line through two where there are fewer.
fn step(n: usize, border: Border, i: usize, slope: impl Fn(usize) -> f32) -> f32 {
    if border == Border::Free && i + 1 == n {
        return 0.0;
    }
    let at = |k: usize| slope((i + k) % n);
    if n < 4 {
        return 0.5 * (at(0) + at(1));
    }
    match border {
        Border::Free if i == 0 => (9.0 * at(0) + 19.0 * at(1) - 5.0 * at(2) + at(3)) / 24.0,
        Border::Free if i + 2 == n => {
            (9.0 * at(1) + 19.0 * at(0) - 5.0 * at(n - 1) + at(n - 2)) / 24.0
        }
        _ => (13.0 * (at(0) + at(1)) - at(n - 1) - at(2)) / 24.0,
    }
}

/// Slices through a texel, each looking both ways.
const SLICES: usize = 8;

/// Distances at which a slice looks for what stands in the way, texels.
const DISTANCES: [f32; 9] = [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0, 27.0, 40.0];

/// Share of a uniform surround's light that reaches each texel, 0 to 1: the cosine-weighted part of
/// the sky above the horizon within 40 texels, slice by slice in closed form (Jimenez et al.,
/// *Practical Real-Time Strategies for Accurate Indirect Occlusion*, 2016).
///
/// # Errors
/// [`Error::Argument`] where the size of the sample is not positive or the height is of other maps.
pub fn occlusion(
    maps: &Svbrdf,
    height: &Height,
    sample_mm: [f32; 2],
    periodic: bool,
) -> Result<Vec<f32>> {
    let (w, h) = (maps.width(), maps.height());
    let spacing = texel_mm(maps, sample_mm)?;
    if height.mm.len() != w * h {
        let message = format!("{} values given, {w} * {h} expected", height.mm.len());
        return Err(Error::argument("height", message));
    }
    let slices: Vec<Slice> = (0..SLICES).map(|k| Slice::new(k, spacing)).collect();
    let (p, q) = (maps.plane(channel::SLOPE_X), maps.plane(channel::SLOPE_Y));
    let mut out = vec![0.0; w * h];
    parallel::parts(out.chunks_mut(w), |y, row| {
        for (x, v) in row.iter_mut().enumerate() {
            let i = y * w + x;
            let up = (1.0 + p[i] * p[i] + q[i] * q[i]).sqrt().recip();
            let sum: f32 = slices
                .iter()
                .map(|slice| {
                    let lean = p[i] * slice.direction[0] + q[i] * slice.direction[1];
                    // The tangent plane is the lowest horizon.
                    let ahead = slice.horizon(&height.mm, [w, h], [x, y], periodic, 1, -lean);
                    let behind = slice.horizon(&height.mm, [w, h], [x, y], periodic, -1, lean);
                    up * open_part(lean, ahead, behind)
                })
                .sum();
            *v = (sum / SLICES as f32).clamp(0.0, 1.0);
        }
    });
    Ok(out)
}

/// Light between two horizons of one slice, relative to an open sky over a level texel, times the
/// normal's share in the slice relative to its height. `lean`: tangent of the normal's angle
/// towards the direction; `ahead`, `behind`: tangents of the horizons' elevations.
fn open_part(lean: f32, ahead: f32, behind: f32) -> f32 {
    // cos(2a + c) and the like by the tangents; c is the lean's angle, projected length 1 / cos c.
    let double = |t: f32| {
        let k = (1.0 + t * t).recip();
        ((1.0 - t * t) * k, 2.0 * t * k)
    };
    let ((cos_a, sin_a), (cos_b, sin_b)) = (double(ahead), double(behind));
    let first = cos_a - lean * sin_a + 1.0 + (PI - 2.0 * ahead.atan()) * lean;
    let second = cos_b + lean * sin_b + 1.0 - (PI - 2.0 * behind.atan()) * lean;
    0.25 * (first + second)
}

/// A direction and the texels along it.
struct Slice {
    /// Unit vector, X right, Y up.
    direction: [f32; 2],
    /// Columns, rows (downwards) and distance in mm.
    steps: [(isize, isize, f32); DISTANCES.len()],
}

impl Slice {
    fn new(k: usize, spacing: [f32; 2]) -> Self {
        let angle = PI * (k as f32 + 0.5) / SLICES as f32;
        let unit = spacing[0].min(spacing[1]);
        let steps = DISTANCES.map(|d| {
            let dx = (d * unit * angle.cos() / spacing[0]).round();
            let dy = (d * unit * angle.sin() / spacing[1]).round();
            (dx as isize, -dy as isize, (dx * spacing[0]).hypot(dy * spacing[1]))
        });
        Self { direction: [angle.cos(), angle.sin()], steps }
    }

    /// Tangent of the horizon's elevation on one side, not below `lowest`.
    fn horizon(
        &self,
        height: &[f32],
        [w, h]: [usize; 2],
        [x, y]: [usize; 2],
        periodic: bool,
        side: isize,
        lowest: f32,
    ) -> f32 {
        let here = height[y * w + x];
        let mut horizon = lowest;
        for &(dx, dy, distance) in &self.steps {
            let (mut tx, mut ty) = (x as isize + side * dx, y as isize + side * dy);
            if periodic {
                (tx, ty) = (tx.rem_euclid(w as isize), ty.rem_euclid(h as isize));
            } else if tx < 0 || ty < 0 || tx >= w as isize || ty >= h as isize {
                break;
            }
            horizon = horizon.max((height[ty as usize * w + tx as usize] - here) / distance);
        }
        horizon
    }
}

#[cfg(test)]
#[path = "height_tests.rs"]
mod tests;
