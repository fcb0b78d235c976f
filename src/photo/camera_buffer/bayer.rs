//! Raw sensor values behind a colour filter mosaic.

use crate::photo::encoding::Encoding;
use crate::photo::pixels::Photo;
use crate::photo::plane::{Plane, Reader, Rotation};
use crate::{Error, Result};

/// Colours of the top-left 2 x 2 sensor pixels, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BayerPattern {
    /// Red, green; green, blue.
    Rggb,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
    /// Blue, green; green, red.
    Bggr,
}

/// Meaning of raw sensor values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bayer {
    /// Order of the colour filters.
    pub pattern: BayerPattern,
    /// Black level at the four positions of the pattern, row by row.
    pub black_level: [f32; 4],
    /// White level; samples at or above it are clipped.
    pub white_level: f32,
    /// Gains of R, G and B that make gray neutral.
    pub white_balance: [f32; 3],
    /// Rows of the matrix from white-balanced sensor colours to linear Rec. 709.
    pub color_matrix: [[f32; 3]; 3],
}

impl Photo {
    /// Develops 16-bit raw values to 16-bit linear Rec. 709: black level, white balance,
    /// demosaicking after Malvar, He and Cutler (ICASSP 2004), colour matrix. A channel that is
    /// clipped at the pixel or next to it is saturated.
    ///
    /// Full scale of the result is the clipping level of the channel with the smallest gain; the
    /// other channels are clipped there too.
    ///
    /// # Errors
    /// If the sizes do not fit the plane or a number is out of range.
    pub fn from_bayer16(
        size: [u32; 2],
        plane: Plane,
        bayer: &Bayer,
        rotation: Rotation,
        exposure: f32,
    ) -> Result<Self> {
        Self::developed(size, plane, bayer, None, rotation, exposure)
    }

    /// As [`Photo::from_bayer16`] with a correction of lens shading: `gains` multiply the values
    /// above the black level, one per sensor pixel, row by row.
    ///
    /// # Errors
    /// As [`Photo::from_bayer16`], or if `gains` does not hold one positive number per pixel.
    pub fn from_bayer16_shaded(
        size: [u32; 2],
        plane: Plane,
        bayer: &Bayer,
        gains: &[f32],
        rotation: Rotation,
        exposure: f32,
    ) -> Result<Self> {
        let count = u64::from(size[0]) * u64::from(size[1]);
        if gains.len() as u64 != count || !gains.iter().all(|v| v.is_finite() && *v > 0.0) {
            let message = format!("{count} positive numbers are expected");
            return Err(Error::argument("gains", message));
        }
        Self::developed(size, plane, bayer, Some(gains), rotation, exposure)
    }

    fn developed(
        size: [u32; 2],
        plane: Plane,
        bayer: &Bayer,
        gains: Option<&[f32]>,
        rotation: Rotation,
        exposure: f32,
    ) -> Result<Self> {
        let gain = bayer.check()?;
        let sensor = Sensor::read(&Reader::new(size, plane, 2)?, bayer, gain, gains);
        let rgb = rotation.apply(size, sensor.developed(&bayer.color_matrix));
        let [w, h] = rotation.size(size);
        Self::from_u16(w, h, rgb, Encoding::Linear, exposure / gain)
    }
}

impl Bayer {
    /// Checks every number; returns the smallest gain.
    fn check(&self) -> Result<f32> {
        let black = self.black_level.iter().fold(0.0f32, |a, &b| a.max(b));
        if !self.black_level.iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Err(Error::argument("black_level", "four numbers of at least 0 are expected"));
        }
        if !(self.white_level.is_finite() && self.white_level > black) {
            return Err(Error::argument(
                "white_level",
                "a number above the black levels is expected",
            ));
        }
        if !self.white_balance.iter().all(|v| v.is_finite() && *v > 0.0) {
            return Err(Error::argument("white_balance", "three positive numbers are expected"));
        }
        if !self.color_matrix.iter().flatten().all(|v| v.is_finite()) {
            return Err(Error::argument("color_matrix", "nine finite numbers are expected"));
        }
        Ok(self.white_balance.iter().fold(f32::INFINITY, |a, &b| a.min(b)))
    }
}

impl BayerPattern {
    /// Colour (0 red, 1 green, 2 blue) of a sensor pixel.
    #[inline]
    fn color(self, x: usize, y: usize) -> usize {
        // Position of red inside the pattern.
        let (rx, ry) = match self {
            Self::Rggb => (0, 0),
            Self::Grbg => (1, 0),
            Self::Gbrg => (0, 1),
            Self::Bggr => (1, 1),
        };
        usize::from((x & 1) != rx) + usize::from((y & 1) != ry)
    }
}

/// White-balanced sensor values with a mirrored margin of two pixels.
struct Sensor {
    values: Vec<f32>,
    clipped: Vec<bool>,
    pattern: BayerPattern,
    width: usize,
    height: usize,
}

const MARGIN: usize = 2;

impl Sensor {
    fn read(reader: &Reader, bayer: &Bayer, smallest_gain: f32, shading: Option<&[f32]>) -> Self {
        let (width, height) = (reader.width, reader.height);
        let n = (width + 2 * MARGIN) * (height + 2 * MARGIN);
        let (mut values, mut clipped) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let gains = bayer.white_balance.map(|g| g / smallest_gain);
        for y in 0..height + 2 * MARGIN {
            let y = mirrored(y, height);
            for x in 0..width + 2 * MARGIN {
                let x = mirrored(x, width);
                let p = reader.at(x, y);
                let raw = f32::from(u16::from_ne_bytes([p[0], p[1]]));
                let black = bayer.black_level[2 * (y & 1) + (x & 1)];
                let scale = gains[bayer.pattern.color(x, y)] / (bayer.white_level - black);
                let shading = shading.map_or(1.0, |gains| gains[y * width + x]);
                values.push((raw - black) * scale * shading);
                clipped.push(raw >= bayer.white_level);
            }
        }
        Self { values, clipped, pattern: bayer.pattern, width, height }
    }

    /// Interleaved 16-bit linear RGB.
    fn developed(&self, matrix: &[[f32; 3]; 3]) -> Vec<u16> {
        let mut out = Vec::with_capacity(3 * self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                let sensor = self.demosaicked(x, y);
                let clipped = self.clipped_channels(x, y);
                for c in 0..3 {
                    let [r, g, b] = matrix[c];
                    let value = r * sensor[0] + g * sensor[1] + b * sensor[2];
                    out.push(if clipped[c] { u16::MAX } else { (value * 65535.0 + 0.5) as u16 });
                }
            }
        }
        out
    }

    #[inline]
    fn index(&self, x: usize, y: usize) -> usize {
        (y + MARGIN) * (self.width + 2 * MARGIN) + x + MARGIN
    }

    /// RGB of a pixel by the linear filters of the paper, scaled by 1/8.
    #[inline]
    fn demosaicked(&self, x: usize, y: usize) -> [f32; 3] {
        let row = self.width + 2 * MARGIN;
        let i = self.index(x, y);
        let v = |i: usize| self.values[i];
        let centre = v(i);
        let (across, down) = (v(i - 1) + v(i + 1), v(i - row) + v(i + row));
        let (across2, down2) = (v(i - 2) + v(i + 2), v(i - 2 * row) + v(i + 2 * row));
        let diagonal = v(i - row - 1) + v(i - row + 1) + v(i + row - 1) + v(i + row + 1);
        let color = self.pattern.color(x, y);
        if color == 1 {
            let beside = 5.0 * centre + 4.0 * across - diagonal - across2 + 0.5 * down2;
            let above = 5.0 * centre + 4.0 * down - diagonal - down2 + 0.5 * across2;
            let [beside, above] = [beside / 8.0, above / 8.0];
            if self.pattern.color(x + 1, y) == 0 {
                [beside, centre, above]
            } else {
                [above, centre, beside]
            }
        } else {
            let green = (4.0 * centre + 2.0 * (across + down) - across2 - down2) / 8.0;
            let opposite = (6.0 * centre + 2.0 * diagonal - 1.5 * (across2 + down2)) / 8.0;
            if color == 0 { [centre, green, opposite] } else { [opposite, green, centre] }
        }
    }

    /// Channels with a clipped sample in the 3 x 3 pixels around a pixel.
    #[inline]
    fn clipped_channels(&self, x: usize, y: usize) -> [bool; 3] {
        let row = self.width + 2 * MARGIN;
        let i = self.index(x, y);
        let mut found = [false; 3];
        for dy in 0..3 {
            for dx in 0..3 {
                if self.clipped[i + dy * row + dx - row - 1] {
                    // Two more rows or columns keep the phase of the pattern.
                    found[self.pattern.color(x + dx + 1, y + dy + 1)] = true;
                }
            }
        }
        found
    }
}

/// Position inside for a position with margin, mirrored at the centre of the outermost pixel so
/// that the pattern continues.
fn mirrored(at: usize, size: usize) -> usize {
    let i = at.abs_diff(MARGIN);
    // Pictures of one or two pixels have no pattern; any position works.
    if i < size { i } else { (2 * size).saturating_sub(i + 2).min(size - 1) }
}
