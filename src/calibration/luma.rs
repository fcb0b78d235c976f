//! The single-channel picture that the detector works on.

use crate::photo::Photo;
use glam::DVec2;

/// Luminance on a square-root scale, row by row.
///
/// Under the flash's fall-off, the square root gives both sides of a printed edge similar
/// gradients. In linear light the white side dominates every gradient sum and pulls corners towards
/// the brighter white square. The square root also makes photon noise uniform.
#[derive(Debug, Clone, PartialEq)]
pub struct LumaImage {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// `width * height` finite values, at least 0.
    pub data: Vec<f32>,
}

impl LumaImage {
    /// Square root of a photograph's luminance. Negative values and values that are not finite become 0.
    pub fn from_photo(photo: &Photo) -> Self {
        Self::from_luma(photo, photo.luma())
    }

    /// The same, computed on the calling thread alone.
    pub(crate) fn on_this_thread(photo: &Photo) -> Self {
        Self::from_luma(photo, photo.luma_on_this_thread())
    }

    fn from_luma(photo: &Photo, mut data: Vec<f32>) -> Self {
        let (width, height) = (photo.width() as usize, photo.height() as usize);
        for v in &mut data {
            *v = if v.is_finite() { v.max(0.0).sqrt() } else { 0.0 };
        }
        Self { width, height, data }
    }

    /// Half the size by averages of 2 x 2 pixels, without an odd last row or column. Position `p`
    /// of the result is `2 p + 0.5` here.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut data = vec![0.0; width * height];
        for y in 0..height {
            let upper = &self.data[2 * y * self.width..][..2 * width];
            let lower = &self.data[(2 * y + 1) * self.width..][..2 * width];
            let out = &mut data[y * width..][..width];
            for ((o, u), l) in out.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2))
            {
                *o = 0.25 * ((u[0] + u[1]) + (l[0] + l[1]));
            }
        }
        Self { width, height, data }
    }

    /// Smoothed with the binomial filter 1 4 6 4 1 (sigma 1 px) in both directions; borders repeat.
    pub(super) fn smoothed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let mut across = vec![0.0f32; w * h];
        for (row, out) in self.data.chunks_exact(w).zip(across.chunks_exact_mut(w)) {
            if w >= 5 {
                for (o, v) in out[2..].iter_mut().zip(row.windows(5)) {
                    *o = binomial(v[0], v[1], v[2], v[3], v[4]);
                }
            }
            let at = |x: isize| row[x.clamp(0, w as isize - 1) as usize];
            for x in (0..w).filter(|&x| x < 2 || x + 2 >= w) {
                let x0 = x as isize;
                out[x] = binomial(at(x0 - 2), at(x0 - 1), at(x0), at(x0 + 1), at(x0 + 2));
            }
        }
        let mut data = vec![0.0f32; w * h];
        for y in 0..h {
            let row = |dy: isize| {
                let y = (y as isize + dy).clamp(0, h as isize - 1) as usize;
                &across[y * w..][..w]
            };
            let (a, b, c, d, e) = (row(-2), row(-1), row(0), row(1), row(2));
            let out = &mut data[y * w..][..w];
            for x in 0..w {
                out[x] = binomial(a[x], b[x], c[x], d[x], e[x]);
            }
        }
        Self { width: w, height: h, data }
    }

    /// Bilinear value; positions outside take the nearest border value.
    #[inline]
    pub(super) fn sample(&self, p: DVec2) -> f32 {
        let x = p.x.clamp(0.0, (self.width - 1) as f64);
        let y = p.y.clamp(0.0, (self.height - 1) as f64);
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let (upper, lower) = (y0 * self.width, y1 * self.width);
        let top = self.data[upper + x0] * (1.0 - fx) + self.data[upper + x1] * fx;
        let bottom = self.data[lower + x0] * (1.0 - fx) + self.data[lower + x1] * fx;
        top * (1.0 - fy) + bottom * fy
    }

    /// Whether `p` is inside and at least `margin` px from every border pixel's centre.
    pub(super) fn contains(&self, p: DVec2, margin: f64) -> bool {
        p.x >= margin
            && p.y >= margin
            && p.x <= (self.width as f64 - 1.0) - margin
            && p.y <= (self.height as f64 - 1.0) - margin
    }
}

fn binomial(a: f32, b: f32, c: f32, d: f32, e: f32) -> f32 {
    ((a + e) + 4.0 * (b + d) + 6.0 * c) * (1.0 / 16.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_survives_halving_smoothing_and_sampling() {
        let (width, height) = (31, 22);
        let data = (0..width * height).map(|i| (i % width + 2 * (i / width)) as f32).collect();
        let image = LumaImage { width, height, data };
        // Symmetric filters reproduce a plane exactly away from the border.
        let half = image.halved();
        let p = DVec2::new(5.25, 4.5);
        assert!((half.sample(p) - image.sample(2.0 * p + 0.5)).abs() < 1e-5);
        assert!((image.smoothed().sample(2.0 * p) - image.sample(2.0 * p)).abs() < 1e-5);
        assert_eq!(image.sample(DVec2::new(-3.0, 90.0)), image.data[21 * width]);
    }

    #[test]
    fn invalid_radiances_count_as_black() {
        let rgb = [f32::NAN, 0.0, 0.0, -1.0, -1.0, -1.0, 4.0, 4.0, 4.0].to_vec();
        let photo = Photo::from_linear(3, 1, rgb, 1.0, f32::INFINITY).unwrap();
        let luma = LumaImage::from_photo(&photo);
        assert_eq!(luma.data[..2], [0.0, 0.0]);
        assert!((luma.data[2] - 2.0).abs() < 1e-6);
    }
}
