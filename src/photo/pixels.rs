//! A photograph's pixels as stored, read as linear RGB.

use super::encoding::Encoding;
use super::plateau::plateau;
use crate::parallel;
use crate::{Error, Result};

/// Largest photograph accepted, pixels.
pub const MAX_PIXELS: u64 = 100_000_000;

/// A photograph.
///
/// Linear values are in units of full scale (1 = the largest value the file can hold for integer
/// formats), *not* yet divided by [`Photo::exposure`].
#[derive(Debug, Clone)]
pub struct Photo {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) pixels: Pixels,
    exposure: f32,
    /// A linear channel at or above this value is saturated.
    saturation: f32,
    finite: bool,
    focal_35mm: Option<f32>,
}

/// Interleaved RGB as stored.
#[derive(Debug, Clone)]
pub(super) enum Pixels {
    U8(Vec<u8>, &'static [f32; 256]),
    U16(Vec<u16>, &'static [f32; 65536]),
    F32(Vec<f32>),
}

/// Smallest saturated 8-bit value; lossy compression changes 255 by one.
const SATURATED_8: u8 = 254;
/// The same for 16 bits: full scale of 10-bit data shifted up (those of 12 and 14 bits are larger).
const SATURATED_16: u16 = 0xFFC0;

/// Weights of the luma of linear Rec. 709 RGB.
pub(super) const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];

impl Photo {
    /// Takes interleaved linear RGB. `exposure` is relative: value = radiance * exposure. A channel
    /// at or above `saturation` is clipped (infinite: never).
    ///
    /// # Errors
    /// If the sizes do not fit, or exposure or saturation are not positive.
    pub fn from_linear(
        width: u32,
        height: u32,
        rgb: Vec<f32>,
        exposure: f32,
        saturation: f32,
    ) -> Result<Self> {
        if saturation.is_nan() || saturation <= 0.0 {
            return Err(Error::argument("saturation", "a positive number is expected"));
        }
        let finite = rgb.iter().all(|v| v.is_finite());
        Self::new(width, height, Pixels::F32(rgb), exposure, saturation, finite)
    }

    /// Copies rows of `stride` bytes with three 8-bit channels per pixel. 254, 255 and an edited
    /// clipping level below them count as clipped.
    ///
    /// # Errors
    /// If the sizes do not fit or the exposure is not positive.
    pub fn from_rgb8(
        width: u32,
        height: u32,
        data: &[u8],
        stride: usize,
        encoding: Encoding,
        exposure: f32,
    ) -> Result<Self> {
        let data = pack::<u8, 3>(width, height, data, stride)?;
        Self::from_u8(width, height, data, encoding, exposure)
    }

    /// Copies rows of `stride` bytes with four 8-bit channels per pixel, the fourth ignored; 254
    /// and 255 count as clipped.
    ///
    /// # Errors
    /// As [`Photo::from_rgb8`].
    pub fn from_rgba8(
        width: u32,
        height: u32,
        data: &[u8],
        stride: usize,
        encoding: Encoding,
        exposure: f32,
    ) -> Result<Self> {
        let data = pack::<u8, 4>(width, height, data, stride)?;
        Self::from_u8(width, height, data, encoding, exposure)
    }

    /// Copies rows of `stride` values with three 16-bit channels per pixel; 0xFFC0 and above (full
    /// scale of 10 bits shifted up) count as clipped.
    ///
    /// # Errors
    /// As [`Photo::from_rgb8`].
    pub fn from_rgb16(
        width: u32,
        height: u32,
        data: &[u16],
        stride: usize,
        encoding: Encoding,
        exposure: f32,
    ) -> Result<Self> {
        let data = pack::<u16, 3>(width, height, data, stride)?;
        Self::from_u16(width, height, data, encoding, exposure)
    }

    /// Copies rows of `stride` values with three linear floats per pixel. A channel at or above
    /// `saturation` is clipped (infinite: never).
    ///
    /// # Errors
    /// As [`Photo::from_linear`].
    pub fn from_rgb_f32(
        width: u32,
        height: u32,
        data: &[f32],
        stride: usize,
        exposure: f32,
        saturation: f32,
    ) -> Result<Self> {
        let data = pack::<f32, 3>(width, height, data, stride)?;
        Self::from_linear(width, height, data, exposure, saturation)
    }

    pub(super) fn from_u8(
        width: u32,
        height: u32,
        data: Vec<u8>,
        encoding: Encoding,
        exposure: f32,
    ) -> Result<Self> {
        let table = encoding.table8();
        let saturated = plateau(&data).unwrap_or(SATURATED_8);
        let saturation = table[usize::from(saturated)];
        Self::new(width, height, Pixels::U8(data, table), exposure, saturation, true)
    }

    pub(super) fn from_u16(
        width: u32,
        height: u32,
        data: Vec<u16>,
        encoding: Encoding,
        exposure: f32,
    ) -> Result<Self> {
        let table = encoding.table16();
        let saturation = table[usize::from(SATURATED_16)];
        Self::new(width, height, Pixels::U16(data, table), exposure, saturation, true)
    }

    fn new(
        width: u32,
        height: u32,
        pixels: Pixels,
        exposure: f32,
        saturation: f32,
        finite: bool,
    ) -> Result<Self> {
        let found = match &pixels {
            Pixels::U8(data, _) => data.len(),
            Pixels::U16(data, _) => data.len(),
            Pixels::F32(data) => data.len(),
        };
        let expected = 3 * u64::from(width) * u64::from(height);
        if expected == 0 || found as u64 != expected {
            return Err(Error::argument(
                "rgb",
                format!("{found} values given, 3 * {width} * {height} expected"),
            ));
        }
        if !(exposure.is_finite() && exposure > 0.0) {
            return Err(Error::argument("exposure", "a positive number is expected"));
        }
        Ok(Self { width, height, pixels, exposure, saturation, finite, focal_35mm: None })
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

    /// A linear channel at or above this value is saturated; infinite if none is.
    pub fn saturation(&self) -> f32 {
        self.saturation
    }

    /// Focal length by the metadata, mm on 36 x 24 mm film.
    pub fn focal_35mm(&self) -> Option<f32> {
        self.focal_35mm
    }

    /// Sets the focal length, mm on 36 x 24 mm film; `None`: unknown. It supports the estimate of a camera.
    pub fn with_focal_35mm(self, focal_35mm: Option<f32>) -> Self {
        let focal_35mm = focal_35mm.filter(|f| f.is_finite() && *f > 0.0);
        Self { focal_35mm, ..self }
    }

    /// Sets the clipping level.
    pub(super) fn with_saturation(self, saturation: f32) -> Self {
        Self { saturation, ..self }
    }

    /// Replaces the pixels.
    pub(super) fn with_pixels(&self, width: u32, height: u32, pixels: Pixels) -> Self {
        Self { width, height, pixels, ..*self }
    }

    /// Replaces the pixels by linear values.
    pub(super) fn with_linear(&self, rgb: Vec<f32>) -> Self {
        self.with_pixels(self.width, self.height, Pixels::F32(rgb))
    }

    /// Whether every value is a finite number.
    pub fn is_finite(&self) -> bool {
        self.finite
    }

    /// Linear RGB of a pixel.
    ///
    /// # Panics
    /// If the position is outside.
    #[inline]
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        let i = 3 * (y as usize * self.width as usize + x as usize);
        match &self.pixels {
            Pixels::U8(data, table) => {
                let p = &data[i..i + 3];
                [table[usize::from(p[0])], table[usize::from(p[1])], table[usize::from(p[2])]]
            }
            Pixels::U16(data, table) => {
                let p = &data[i..i + 3];
                [table[usize::from(p[0])], table[usize::from(p[1])], table[usize::from(p[2])]]
            }
            Pixels::F32(data) => {
                let p = &data[i..i + 3];
                [p[0], p[1], p[2]]
            }
        }
    }

    /// Whether a channel of the pixel is saturated.
    #[inline]
    pub fn is_clipped(&self, x: u32, y: u32) -> bool {
        self.pixel(x, y).iter().any(|&v| v >= self.saturation)
    }

    /// Whether each pixel has a saturated channel, row by row.
    pub fn clip_mask(&self) -> Vec<bool> {
        let level = self.saturation;
        self.map_pixels(|p| p[0] >= level || p[1] >= level || p[2] >= level)
    }

    /// Linear luma of every pixel (Rec. 709 weights), row by row.
    pub fn luma(&self) -> Vec<f32> {
        self.map_pixels(|[r, g, b]| LUMA[0] * r + LUMA[1] * g + LUMA[2] * b)
    }

    /// Subtracts a photograph of the same view without flash, scaled by the exposures. Clipped
    /// pixels stay clipped; negative values become 0.
    ///
    /// # Errors
    /// If the sizes differ.
    pub fn without_ambient(&self, ambient: &Self) -> Result<Self> {
        if (self.width, self.height) != (ambient.width, ambient.height) {
            let message = format!(
                "its size is {} x {} px, that of the photo {} x {}",
                ambient.width, ambient.height, self.width, self.height
            );
            return Err(Error::argument("ambient", message));
        }
        let scale = self.exposure / ambient.exposure;
        let mut rgb = self.to_linear();
        for (v, a) in rgb.iter_mut().zip(ambient.to_linear()) {
            if *v < self.saturation {
                *v = (*v - scale * a).max(0.0);
            }
        }
        let photo =
            Self::from_linear(self.width, self.height, rgb, self.exposure, self.saturation)?;
        // Comparisons have turned NaN into 0.
        let finite = self.finite && ambient.finite;
        Ok(Self { finite, focal_35mm: self.focal_35mm, ..photo })
    }

    /// Interleaved linear RGB, row by row: four times the memory of 8 bits.
    pub fn to_linear(&self) -> Vec<f32> {
        match &self.pixels {
            Pixels::U8(data, table) => data.iter().map(|&v| table[usize::from(v)]).collect(),
            Pixels::U16(data, table) => data.iter().map(|&v| table[usize::from(v)]).collect(),
            Pixels::F32(data) => data.clone(),
        }
    }

    /// A copy of the `width` x `height` pixels from (`x`, `y`) on, in the same storage.
    ///
    /// # Panics
    /// If the rectangle is empty or not inside.
    pub fn cropped(&self, x: u32, y: u32, width: u32, height: u32) -> Self {
        let inside = |from: u32, count: u32, size: u32| {
            count > 0 && from.checked_add(count).is_some_and(|end| end <= size)
        };
        assert!(
            inside(x, width, self.width) && inside(y, height, self.height),
            "{width} x {height} px from ({x}, {y}) of {} x {}",
            self.width,
            self.height
        );
        let rows = (y as usize..(y + height) as usize).map(|row| {
            let start = 3 * (row * self.width as usize + x as usize);
            start..start + 3 * width as usize
        });
        let pixels = match &self.pixels {
            Pixels::U8(data, table) => {
                Pixels::U8(rows.flat_map(|r| &data[r]).copied().collect(), table)
            }
            Pixels::U16(data, table) => {
                Pixels::U16(rows.flat_map(|r| &data[r]).copied().collect(), table)
            }
            Pixels::F32(data) => Pixels::F32(rows.flat_map(|r| &data[r]).copied().collect()),
        };
        self.with_pixels(width, height, pixels)
    }

    /// Maps every pixel; the storage type is matched once.
    fn map_pixels<T: Send + Clone + Default>(&self, f: impl Fn([f32; 3]) -> T + Sync) -> Vec<T> {
        match &self.pixels {
            Pixels::U8(data, table) => {
                let linear = |v: u8| table[usize::from(v)];
                let pixels = data.as_chunks::<3>().0;
                parallel::values(pixels.len(), |i| f(pixels[i].map(linear)))
            }
            Pixels::U16(data, table) => {
                let linear = |v: u16| table[usize::from(v)];
                let pixels = data.as_chunks::<3>().0;
                parallel::values(pixels.len(), |i| f(pixels[i].map(linear)))
            }
            Pixels::F32(data) => {
                let pixels = data.as_chunks::<3>().0;
                parallel::values(pixels.len(), |i| f(pixels[i]))
            }
        }
    }
}

/// Packs rows of `N` channels per pixel and `stride` values per row into tight RGB.
fn pack<T: Copy, const N: usize>(
    width: u32,
    height: u32,
    data: &[T],
    stride: usize,
) -> Result<Vec<T>> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(Error::argument(
            "width, height",
            format!("{width} x {height} px given, 1 to {MAX_PIXELS} pixels expected"),
        ));
    }
    let (row, rows) = (N * width as usize, height as usize);
    let needed = stride.checked_mul(rows - 1).and_then(|n| n.checked_add(row));
    if stride < row || needed.is_none_or(|n| data.len() < n) {
        return Err(Error::argument(
            "stride",
            format!(
                "{} values in rows of {stride} given, {rows} rows of at least {row} expected",
                data.len()
            ),
        ));
    }
    let mut packed = Vec::with_capacity(3 * pixels as usize);
    for y in 0..rows {
        let line = &data[y * stride..][..row];
        if N == 3 {
            packed.extend_from_slice(line);
        } else {
            packed.extend(line.as_chunks::<N>().0.iter().flat_map(|p| [p[0], p[1], p[2]]));
        }
    }
    Ok(packed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ambient_light_is_subtracted_in_linear_light() {
        let photo = |rgb: [f32; 6], exposure| {
            Photo::from_linear(2, 1, rgb.to_vec(), exposure, 0.9).unwrap()
        };
        let flash = photo([0.5, 0.3, 0.1, 0.95, 0.2, 0.01], 2.0);
        // Twice the exposure, so half of it is subtracted.
        let ambient = photo([0.2, 0.1, 0.04, 0.2, 0.2, 0.2], 4.0);
        let less = flash.without_ambient(&ambient).unwrap();
        let expected = [0.4, 0.25, 0.08, 0.95, 0.1, 0.0];
        for (a, b) in less.to_linear().iter().zip(expected) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        assert!(less.is_clipped(1, 0) && !less.is_clipped(0, 0));
        assert_eq!(less.exposure(), 2.0);
        let other = Photo::from_linear(1, 2, vec![0.1; 6], 1.0, 1.0).unwrap();
        assert!(flash.without_ambient(&other).is_err());
        let broken = photo([f32::NAN, 0.1, 0.1, 0.1, 0.1, 0.1], 2.0);
        assert!(less.is_finite() && !flash.without_ambient(&broken).unwrap().is_finite());
    }

    #[test]
    fn every_constructor_gives_the_same_linear_pixels() {
        let rgb8 = [10, 20, 30, 0, 128, 255, 254, 253, 252, 7, 7, 7u8];
        // A stride of 7 bytes leaves one byte between rows of two pixels.
        let strided: Vec<u8> = [&rgb8[..6], &[99], &rgb8[6..]].concat();
        let rgba: Vec<u8> =
            rgb8.as_chunks::<3>().0.iter().flat_map(|p| [p[0], p[1], p[2], 99]).collect();
        let rgb16: Vec<u16> = rgb8.iter().map(|&v| u16::from(v) * 257).collect();
        for encoding in Encoding::ALL {
            let exact: Vec<f32> =
                rgb8.iter().map(|&v| encoding.decode(f64::from(v) / 255.0) as f32).collect();
            let photos = [
                Photo::from_rgb8(2, 2, &strided, 7, encoding, 2.0).unwrap(),
                Photo::from_rgba8(2, 2, &rgba, 8, encoding, 2.0).unwrap(),
                Photo::from_rgb16(2, 2, &rgb16, 6, encoding, 2.0).unwrap(),
                Photo::from_rgb_f32(2, 2, &exact, 6, 2.0, f32::INFINITY).unwrap(),
            ];
            for photo in &photos {
                assert_eq!(photo.to_linear(), exact);
                assert_eq!(photo.pixel(1, 0), [exact[3], exact[4], exact[5]]);
                let luma = photo.luma();
                let expected = 0.2126 * exact[9] + 0.7152 * exact[10] + 0.0722 * exact[11];
                assert!((luma[3] - expected).abs() < 1e-6);
                assert_eq!(photo.exposure(), 2.0);
            }
            assert_eq!(photos[0].clip_mask(), [false, true, true, false]);
            // 16 bits represent full scale exactly: 254 * 257 is not clipped.
            assert_eq!(photos[2].clip_mask(), [false, true, false, false]);
            assert!(photos[2].is_clipped(1, 0));
            assert_eq!(photos[3].clip_mask(), [false; 4]);
        }
    }

    #[test]
    fn crops_hold_the_same_pixels() {
        let data: Vec<u8> = (0..60).collect();
        let photo = Photo::from_rgb8(5, 4, &data, 15, Encoding::Srgb, 2.0).unwrap();
        let crop = photo.cropped(1, 2, 3, 2);
        assert_eq!((crop.width(), crop.height(), crop.exposure()), (3, 2, 2.0));
        for (x, y) in [(0, 0), (2, 0), (1, 1), (2, 1)] {
            assert_eq!(crop.pixel(x, y), photo.pixel(x + 1, y + 2));
        }
    }

    #[test]
    fn ten_bit_full_scale_shifted_up_is_clipped() {
        let data = [1023 << 6, 0, 0, 1022 << 6, 0, 0u16];
        let photo = Photo::from_rgb16(2, 1, &data, 6, Encoding::Linear, 1.0).unwrap();
        assert_eq!(photo.clip_mask(), [true, false]);
    }

    #[test]
    fn invalid_sizes_and_numbers_are_refused() {
        let data = [0u8; 12];
        let rgb8 = |w, h, stride, e| Photo::from_rgb8(w, h, &data, stride, Encoding::Srgb, e);
        assert!(rgb8(2, 2, 6, 1.0).is_ok());
        for (w, h, stride, exposure) in [
            (0, 2, 6, 1.0),
            (2, 2, 5, 1.0),
            (2, 3, 6, 1.0),
            (2, 2, usize::MAX, 1.0),
            (u32::MAX, u32::MAX, usize::MAX, 1.0),
            (2, 2, 6, 0.0),
            (2, 2, 6, f32::NAN),
        ] {
            assert!(matches!(rgb8(w, h, stride, exposure), Err(Error::Argument { .. })));
        }
        assert!(Photo::from_linear(1, 1, vec![0.0; 3], 1.0, f32::NAN).is_err());
        assert!(Photo::from_linear(1, 1, vec![0.0; 4], 1.0, 1.0).is_err());
        let photo = Photo::from_linear(1, 1, vec![0.0, f32::NAN, 0.0], 1.0, 1.0).unwrap();
        assert!(!photo.is_finite());
    }
}
