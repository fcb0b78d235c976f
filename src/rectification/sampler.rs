//! Interpolation in a decoded part of the photo.

use super::mapping::{Area, LANES, Positions};
use super::response::Response;
use crate::photo::Photo;

/// Flag of a texel whose footprint leaves the photo or holds values that are not finite. Flags 1, 2
/// and 4 mark saturated channels.
pub(super) const OUTSIDE: u32 = 8;

/// Interpolation of a texel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Filter {
    /// Catmull-Rom, averaged over sub-samples if a texel covers several pixels.
    Adaptive,
    /// Bilinear at the texel's centre: the baseline of the tests.
    #[cfg(test)]
    Bilinear,
}

impl Filter {
    /// Most sub-samples along an axis.
    const MAX_SUB: usize = 24;
    /// Pixels per texel up to which one sample suffices: pixel area and interpolation average over
    /// about as much.
    const SINGLE_PX: f64 = 1.5;
    /// Sub-samples per pixel for larger texels. More would only blur, for the same reason.
    const PER_PX: f64 = 0.75;

    /// Number of sub-samples along both axes for a texel of the given size in pixels.
    pub fn sub_samples(self, (right, down): (f64, f64)) -> (usize, usize) {
        let count = |px: f64| match self {
            Self::Adaptive if px > Self::SINGLE_PX => {
                ((Self::PER_PX * px).ceil() as usize).min(Self::MAX_SUB)
            }
            _ => 1,
        };
        (count(right), count(down))
    }
}

/// Pixels of a part of the photo.
#[derive(Default)]
pub(super) struct Tile {
    /// RGB and an unused value, for one load per pixel.
    pixels: Vec<[f32; 4]>,
    /// Flags, dilated by a pixel, because demosaicking, sharpening and JPEG spread clipping to
    /// neighbours. Empty without flagged pixels.
    flags: Vec<u8>,
    scratch: Vec<u8>,
    width: usize,
    height: usize,
    x0: f32,
    y0: f32,
    /// Largest positions inside the photo.
    right: f32,
    bottom: f32,
}

impl Tile {
    /// Larger tiles are split: at 16 bytes per pixel they should fit a core's cache.
    pub const MAX_PIXELS: usize = 64 * 1024;

    /// Decodes an area to linear values.
    pub fn load(&mut self, photo: &Photo, area: Area, response: &Response) {
        self.width = (area.x1 - area.x0) as usize;
        self.height = (area.y1 - area.y0) as usize;
        (self.x0, self.y0) = (area.x0 as f32, area.y0 as f32);
        self.right = photo.width() as f32 - 1.0;
        self.bottom = photo.height() as f32 - 1.0;
        self.pixels.clear();
        self.flags.clear();
        let saturation = response.saturation(photo);
        let mut any = 0;
        for y in area.y0..area.y1 {
            for x in area.x0..area.x1 {
                let rgb = photo.pixel(x, y);
                let mut flags = 0;
                for (c, v) in rgb.iter().enumerate() {
                    flags |= u8::from(*v >= saturation) << c;
                }
                if rgb.iter().all(|v| v.is_finite()) {
                    let rgb = response.linear(rgb);
                    self.pixels.push([rgb[0], rgb[1], rgb[2], 0.0]);
                } else {
                    flags |= OUTSIDE as u8;
                    self.pixels.push([0.0; 4]);
                }
                self.flags.push(flags);
                any |= flags;
            }
        }
        if any == 0 {
            self.flags.clear();
        } else {
            self.dilate();
        }
    }

    /// Spreads flags to the eight neighbours.
    fn dilate(&mut self) {
        let (w, h) = (self.width, self.height);
        self.scratch.clear();
        for row in self.flags.chunks_exact(w) {
            for x in 0..w {
                let (l, r) = (x.saturating_sub(1), (x + 1).min(w - 1));
                self.scratch.push(row[l] | row[x] | row[r]);
            }
        }
        for y in 0..h {
            let (t, b) = (y.saturating_sub(1), (y + 1).min(h - 1));
            for x in 0..w {
                self.flags[y * w + x] =
                    self.scratch[t * w + x] | self.scratch[y * w + x] | self.scratch[b * w + x];
            }
        }
    }

    fn inside(&self, x: f32, y: f32) -> bool {
        x >= 0.0 && y >= 0.0 && x <= self.right && y <= self.bottom
    }

    /// Upper left of the four pixels around a position, clamped to the tile, and the fractions.
    fn corner(&self, x: f32, y: f32) -> (usize, usize, f32, f32) {
        let x = (x - self.x0).clamp(0.0, (self.width - 1) as f32);
        let y = (y - self.y0).clamp(0.0, (self.height - 1) as f32);
        let (ix, iy) = (x as usize, y as usize);
        (ix, iy, x - ix as f32, y - iy as f32)
    }

    fn flags_round(&self, ix: usize, iy: usize) -> u32 {
        if self.flags.is_empty() {
            return 0;
        }
        let (x1, y1) = ((ix + 1).min(self.width - 1), (iy + 1).min(self.height - 1));
        let (top, bottom) = (iy * self.width, y1 * self.width);
        u32::from(
            self.flags[top + ix]
                | self.flags[top + x1]
                | self.flags[bottom + ix]
                | self.flags[bottom + x1],
        )
    }

    fn bilinear(&self, ix: usize, iy: usize, fx: f32, fy: f32) -> [f32; 4] {
        let (x1, y1) = ((ix + 1).min(self.width - 1), (iy + 1).min(self.height - 1));
        let (top, bottom) = (iy * self.width, y1 * self.width);
        let (a, b) = (self.pixels[top + ix], self.pixels[top + x1]);
        let (c, d) = (self.pixels[bottom + ix], self.pixels[bottom + x1]);
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        std::array::from_fn(|k| {
            weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k] + weights[3] * d[k]
        })
    }

    fn catmull_rom(&self, ix: usize, iy: usize, fx: f32, fy: f32) -> [f32; 4] {
        let (wx, wy) = (catmull_rom_weights(fx), catmull_rom_weights(fy));
        let inner = ix >= 1 && iy >= 1 && ix + 2 < self.width && iy + 2 < self.height;
        let mut sum = [0.0; 4];
        let mut add = |wy: f32, taps: &[[f32; 4]; 4]| {
            for k in 0..4 {
                sum[k] += wy
                    * (wx[0] * taps[0][k]
                        + wx[1] * taps[1][k]
                        + wx[2] * taps[2][k]
                        + wx[3] * taps[3][k]);
            }
        };
        if inner {
            for (j, wy) in wy.into_iter().enumerate() {
                let start = (iy + j - 1) * self.width + ix - 1;
                if let Some(taps) = self.pixels[start..].first_chunk() {
                    add(wy, taps);
                }
            }
        } else {
            // The outermost pixels of the photo extend outwards.
            let column = |k: usize| (ix + k).saturating_sub(1).min(self.width - 1);
            for (j, wy) in wy.into_iter().enumerate() {
                let row = (iy + j).saturating_sub(1).min(self.height - 1) * self.width;
                add(wy, &std::array::from_fn(|k| self.pixels[row + column(k)]));
            }
        }
        sum
    }

    /// Adds one sample to every texel.
    pub fn add_samples(
        &self,
        at: &Positions,
        columns: usize,
        filter: Filter,
        sums: &mut [[f32; 4]; LANES],
        flags: &mut [u32; LANES],
    ) {
        for lane in 0..columns {
            let (x, y) = (at.x[lane], at.y[lane]);
            if !self.inside(x, y) {
                flags[lane] |= OUTSIDE;
                continue;
            }
            let (ix, iy, fx, fy) = self.corner(x, y);
            let here = self.flags_round(ix, iy);
            flags[lane] |= here;
            // No sharpening near clipped pixels: the value must remain a lower bound.
            let value = if filter == Filter::Adaptive && here == 0 {
                self.catmull_rom(ix, iy, fx, fy)
            } else {
                self.bilinear(ix, iy, fx, fy)
            };
            for k in 0..4 {
                sums[lane][k] += value[k];
            }
        }
    }
}

/// Weights of four equidistant values at a position `t` (0 to 1) between the middle two: the
/// interpolating cubic with central-difference slopes (Keys, a = -1/2).
fn catmull_rom_weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        0.5 * (t3 - t2),
    ]
}
