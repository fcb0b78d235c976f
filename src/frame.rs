//! Photographs: pixels in, linear RGB out.

use crate::{Error, Result};

/// Transfer curve of stored pixel values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Proportional to radiance.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// Pure power law of 2.2.
    Gamma22,
}

/// A photograph in linear RGB.
///
/// Values are in units of full scale (1 = the largest value the file can hold for integer
/// formats), *not* yet divided by [`Photo::exposure`].
#[derive(Debug, Clone)]
pub struct Photo {
    width: u32,
    height: u32,
    /// Interleaved RGB.
    rgb: Vec<f32>,
    exposure: f32,
    /// A channel at or above this value is saturated.
    saturation: f32,
}

impl Photo {
    /// Takes interleaved linear RGB. `exposure` is relative: value = radiance * exposure. A
    /// channel at or above `saturation` counts as clipped (infinite: never).
    ///
    /// # Errors
    /// When the sizes do not fit, or exposure or saturation are not positive.
    pub fn from_linear(
        width: u32,
        height: u32,
        rgb: Vec<f32>,
        exposure: f32,
        saturation: f32,
    ) -> Result<Self> {
        let expected = 3 * width as usize * height as usize;
        if expected == 0 || rgb.len() != expected {
            return Err(Error::argument(
                "rgb",
                format!("{} values given, 3 * {width} * {height} expected", rgb.len()),
            ));
        }
        if !(exposure.is_finite() && exposure > 0.0) {
            return Err(Error::argument("exposure", "a positive number is expected"));
        }
        if saturation.is_nan() || saturation <= 0.0 {
            return Err(Error::argument("saturation", "a positive number is expected"));
        }
        Ok(Self { width, height, rgb, exposure, saturation })
    }

    /// Width, px.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Relative exposure: value = radiance * exposure.
    pub fn exposure(&self) -> f32 {
        self.exposure
    }

    /// A channel at or above this value is saturated.
    pub fn saturation(&self) -> f32 {
        self.saturation
    }

    /// Linear RGB of a pixel.
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        let i = 3 * (y as usize * self.width as usize + x as usize);
        [self.rgb[i], self.rgb[i + 1], self.rgb[i + 2]]
    }

    /// Interleaved linear RGB.
    pub fn rgb(&self) -> &[f32] {
        &self.rgb
    }
}
