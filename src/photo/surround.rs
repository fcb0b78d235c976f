//! Surroundings of a pixel: the source of a dirty lens's veil and the reference of local tone mapping.

use serde::{Deserialize, Serialize};

use super::pixels::Photo;

/// Standard deviation of the blur relative to the photograph's width, for fingerprints and screen protectors.
const SIGMA: f32 = 0.12;
/// Cells along the width, and pixels sampled along each side of a cell.
const ACROSS: u32 = 32;
const READ: u32 = 4;

/// Strongly blurred linear values of a photograph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Surround {
    size: [u32; 2],
    /// Pixels along the sides of a cell.
    cell: [f32; 2],
    cells: Vec<[f32; 3]>,
}

impl Surround {
    /// Scales of local tone mapping (standard deviations relative to the photograph's width); the
    /// second is that of [`Self::of`].
    pub(crate) const SCALES: [f32; 3] = [0.05, SIGMA, 0.2];

    /// Surroundings in a whole photograph.
    pub fn of(photo: &Photo) -> Self {
        Self::sharp(photo).blurred(SIGMA)
    }

    /// Surroundings at each of [`Self::SCALES`].
    pub(crate) fn at_scales(photo: &Photo) -> [Self; Self::SCALES.len()] {
        let sharp = Self::sharp(photo);
        Self::SCALES.map(|sigma| sharp.blurred(sigma))
    }

    /// Means of cells.
    fn sharp(photo: &Photo) -> Self {
        let (w, h) = (photo.width(), photo.height());
        let columns = ACROSS.min(w);
        let rows = (columns * h / w).clamp(1, h);
        let cell = [w as f32 / columns as f32, h as f32 / rows as f32];
        let read = |column: u32, row: u32| {
            let mut sum = [0.0_f32; 3];
            for i in 0..READ * READ {
                let at = |k: u32, cell: f32, i: u32, size: u32| {
                    let px = (k as f32 + (i as f32 + 0.5) / READ as f32) * cell;
                    (px as u32).min(size - 1)
                };
                let rgb =
                    photo.pixel(at(column, cell[0], i % READ, w), at(row, cell[1], i / READ, h));
                (0..3).for_each(|c| sum[c] += rgb[c]);
            }
            sum.map(|v| v / (READ * READ) as f32)
        };
        let cells = (0..rows * columns).map(|i| read(i % columns, i / columns)).collect();
        Self { size: [columns, rows], cell, cells }
    }

    /// Blurs with a standard deviation relative to the width.
    fn blurred(&self, sigma: f32) -> Self {
        let [columns, rows] = self.size.map(|n| n as usize);
        let sigma = sigma * columns as f32;
        let aspect = self.cell[0] / self.cell[1];
        let along = blurred(&self.cells, columns, rows, [sigma, 0.0]);
        let cells = blurred(&along, columns, rows, [0.0, sigma * aspect]);
        Self { cells, ..*self }
    }

    /// Value at a pixel of the whole photograph, interpolated linearly.
    pub fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let place = |px: f32, k: usize| {
            let at = ((px + 0.5) / self.cell[k] - 0.5).clamp(0.0, self.size[k] as f32 - 1.0);
            (at as usize, (at as usize + 1).min(self.size[k] as usize - 1), at.fract())
        };
        let ((x0, x1, u), (y0, y1, v)) = (place(x, 0), place(y, 1));
        let cell = |x: usize, y: usize| self.cells[y * self.size[0] as usize + x];
        let [a, b, c, d] = [cell(x0, y0), cell(x1, y0), cell(x0, y1), cell(x1, y1)];
        std::array::from_fn(|k| {
            let (top, bottom) = (a[k] + u * (b[k] - a[k]), c[k] + u * (d[k] - c[k]));
            top + v * (bottom - top)
        })
    }

    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        let [w, h] = self.size.map(|v| v as usize);
        w > 0
            && h > 0
            && self.cells.len() == w * h
            && self.cell.iter().all(|v| *v > 0.0 && v.is_finite())
            && self.cells.iter().flatten().all(|v| v.is_finite())
    }
}

/// Blurs along one axis: the deviation of the other is 0.
fn blurred(cells: &[[f32; 3]], w: usize, h: usize, sigma: [f32; 2]) -> Vec<[f32; 3]> {
    let (count, step, sigma) = if sigma[0] > 0.0 { (w, 1, sigma[0]) } else { (h, w, sigma[1]) };
    let weight = |d: usize| (-0.5 * (d as f32 / sigma).powi(2)).exp();
    let weights: Vec<f32> = (0..count).map(weight).collect();
    let of = |i: usize| {
        let place = i / step % count;
        let first = i - place * step;
        let (mut sum, mut all) = ([0.0_f32; 3], 0.0);
        for other in 0..count {
            let weight = weights[place.abs_diff(other)];
            all += weight;
            (0..3).for_each(|c| sum[c] += weight * cells[first + other * step][c]);
        }
        sum.map(|v| v / all)
    };
    (0..cells.len()).map(of).collect()
}

impl Photo {
    /// Removes a veil: a share of the light comes from the surroundings of each pixel. `corner` is
    /// the position of the first pixel in the whole photograph, to which `surround` belongs.
    /// Clipped pixels stay clipped.
    pub fn without_veil(&self, share: f32, surround: &Surround, corner: [u32; 2]) -> Self {
        let (w, level) = (self.width() as usize, self.saturation());
        let mut rgb = self.to_linear();
        for (i, pixel) in rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (x, y) = ((i % w) as f32 + corner[0] as f32, (i / w) as f32 + corner[1] as f32);
            let around = surround.at(x, y);
            for (v, s) in pixel.iter_mut().zip(around) {
                if *v < level {
                    *v = ((*v - share * s) / (1.0 - share)).max(0.0).min(level);
                }
            }
        }
        self.with_linear(rgb)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_veil_is_taken_off() {
        let (w, h) = (160, 120);
        let clear = |i: usize| {
            let (x, y) = (i % w, i / w);
            let board = if (x / 10 + y / 10) % 2 == 0 { 0.8 } else { 0.05 };
            [board * (1.2 - x as f32 / w as f32), board, 0.5 * board]
        };
        let clear: Vec<f32> = (0..w * h).flat_map(clear).collect();
        let photo = |rgb: Vec<f32>| Photo::from_linear(w as u32, h as u32, rgb, 1.0, 9.0).unwrap();
        let surround = Surround::of(&photo(clear.clone()));
        let veiled: Vec<f32> = clear
            .iter()
            .enumerate()
            .map(|(k, v)| {
                let (x, y) = ((k / 3 % w) as f32, (k / 3 / w) as f32);
                0.9 * v + 0.1 * surround.at(x, y)[k % 3]
            })
            .collect();
        // A crop with the surroundings of the whole; the veil hardly changes the surroundings.
        let veiled = photo(veiled);
        let around = Surround::of(&veiled);
        let part = veiled.cropped(20, 30, 100, 80).without_veil(0.1, &around, [20, 30]);
        for (x, y) in [(0, 0), (50, 40), (99, 79), (3, 70)] {
            let (found, i) = (part.pixel(x, y), 3 * ((y as usize + 30) * w + x as usize + 20));
            for c in 0..3 {
                assert!(
                    (found[c] - clear[i + c]).abs() < 0.006,
                    "{x} {y}: {found:?} {:?}",
                    &clear[i..i + 3]
                );
            }
        }
    }
}
