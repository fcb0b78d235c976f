//! Height from the slopes of the normals.

use super::poisson::{Border, Differences, Grid};
use crate::parallel;
use crate::{Error, Result, Svbrdf};

/// Height above the mean plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Height {
    /// One value per texel, mm, row by row; mean 0.
    pub mm: Vec<f32>,
    /// Share of the squared slopes that no height explains, 0 to 1: noise and non-integrable normals.
    pub unexplained: f32,
}

impl Height {
    /// Finds the height whose slopes fit those of the maps best, by least squares. `periodic`: the
    /// maps, and thus the height, are tileable.
    ///
    /// Slopes are integrated between texels by cubic interpolation, with fourth-order accuracy on
    /// smooth surfaces. Borders are free.
    ///
    /// # Errors
    /// [`Error::Argument`] if the size of the sample is not positive.
    pub fn of(maps: &Svbrdf, sample_mm: [f32; 2], periodic: bool) -> Result<Self> {
        let (w, h) = (maps.width(), maps.height());
        let spacing = texel_mm(maps, sample_mm)?;
        let border = if periodic { Border::Periodic } else { Border::Free };
        let grid =
            Grid { width: w, height: h, borders: [border; 2], spacing: spacing.map(f64::from) };
        let [p, q] = maps.normal_slopes();
        let mut differences = Differences { right: vec![0.0; w * h], down: vec![0.0; w * h] };
        let rows = differences.right.chunks_mut(w).zip(differences.down.chunks_mut(w));
        parallel::parts(rows, |y, (right, down)| {
            for x in 0..w {
                // The surface falls in the direction of the normal; rows run downwards.
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

/// Width and height of a texel, mm.
pub(super) fn texel_mm(maps: &Svbrdf, sample_mm: [f32; 2]) -> Result<[f32; 2]> {
    if !sample_mm.iter().all(|v| v.is_finite() && *v > 0.0) {
        let message = format!("{sample_mm:?} given, two positive lengths expected");
        return Err(Error::argument("sample_mm", message));
    }
    Ok([sample_mm[0] / maps.width() as f32, sample_mm[1] / maps.height() as f32])
}

/// Mean slope between the centres of texels `i` and `i + 1` of `n`: the integral of the cubic
/// through four neighbours, or of the line through two near an end.
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

#[cfg(test)]
#[path = "height_tests.rs"]
mod tests;
