//! Downscaled photographs, computed on the calling thread for low latency beside the threads of a fit.

use std::ops::AddAssign;

use super::pixels::{LUMA, Photo, Pixels};

impl Photo {
    /// The photograph at 1/`step` of its size: means of blocks of `step` x `step` stored values,
    /// without incomplete blocks. A block is clipped only if all of it is. Position `p` of the
    /// result is `step * p + 0.5 * (step - 1)` here.
    ///
    /// # Panics
    /// If `step` is 0 or larger than a side.
    pub fn reduced(&self, step: u32) -> Self {
        let (width, height) = (self.width / step, self.height / step);
        assert!(width > 0 && height > 0, "{step} steps in {} x {}", self.width, self.height);
        let (row, count) = (3 * self.width as usize, step as usize);
        let size = [width as usize, height as usize];
        let area = step * step;
        let pixels = match &self.pixels {
            Pixels::U8(data, table) => Pixels::U8(
                blocks(data, row, size, count, |sum: u32| ((sum + area / 2) / area) as u8),
                table,
            ),
            Pixels::U16(data, table) => Pixels::U16(
                blocks(data, row, size, count, |sum: u64| {
                    ((sum + u64::from(area) / 2) / u64::from(area)) as u16
                }),
                table,
            ),
            Pixels::F32(data) => Pixels::F32(blocks(data, row, size, count, |sum: f64| {
                (sum / f64::from(area)) as f32
            })),
        };
        self.with_pixels(width, height, pixels)
    }

    /// As [`Photo::luma`], on the calling thread alone.
    pub(crate) fn luma_on_this_thread(&self) -> Vec<f32> {
        let luma = |[r, g, b]: [f32; 3]| LUMA[0] * r + LUMA[1] * g + LUMA[2] * b;
        match &self.pixels {
            Pixels::U8(data, table) => {
                let pixels = data.as_chunks::<3>().0.iter();
                pixels.map(|p| luma(p.map(|v| table[usize::from(v)]))).collect()
            }
            Pixels::U16(data, table) => {
                let pixels = data.as_chunks::<3>().0.iter();
                pixels.map(|p| luma(p.map(|v| table[usize::from(v)]))).collect()
            }
            Pixels::F32(data) => data.as_chunks::<3>().0.iter().map(|p| luma(*p)).collect(),
        }
    }
}

/// Converted sums of blocks of interleaved RGB with `row` values per row.
fn blocks<T: Copy, S: Copy + Default + AddAssign + From<T>>(
    data: &[T],
    row: usize,
    [width, height]: [usize; 2],
    step: usize,
    finish: impl Fn(S) -> T,
) -> Vec<T> {
    if step == 1 {
        return data.to_vec();
    }
    let mut out = Vec::with_capacity(3 * width * height);
    // Adding whole rows vectorises.
    let mut sums = vec![S::default(); 3 * width * step];
    for rows in data.chunks_exact(row * step).take(height) {
        sums.fill(S::default());
        for line in rows.chunks_exact(row) {
            for (sum, value) in sums.iter_mut().zip(line) {
                *sum += S::from(*value);
            }
        }
        for block in sums.chunks_exact(3 * step) {
            let mut all = [S::default(); 3];
            for pixel in block.as_chunks::<3>().0 {
                all.iter_mut().zip(pixel).for_each(|(a, v)| *a += *v);
            }
            out.extend(all.map(&finish));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::Encoding;

    #[test]
    fn incomplete_blocks_are_dropped() {
        let rgb: Vec<f32> = (0..7 * 5).flat_map(|i| [i as f32, 2.0 * i as f32, 7.0]).collect();
        let photo = Photo::from_linear(7, 5, rgb, 2.0, 30.0).unwrap().with_focal_35mm(Some(26.0));
        let half = photo.reduced(2);
        assert_eq!((half.width(), half.height()), (3, 2));
        assert_eq!(
            (half.exposure(), half.saturation(), half.focal_35mm()),
            (2.0, 30.0, Some(26.0))
        );
        // The mean of a ramp is its value in the middle: x = 2 * 1 + 0.5, y = 2 * 1 + 0.5.
        let middle = 2.5 + 7.0 * 2.5;
        assert_eq!(half.pixel(1, 1), [middle, 2.0 * middle, 7.0]);
        assert_eq!(photo.reduced(1).to_linear(), photo.to_linear());
    }

    #[test]
    fn stored_numbers_are_rounded_to_the_nearest() {
        let data: [u8; 12] = [0, 0, 255, 1, 3, 255, 0, 0, 255, 0, 0, 255];
        let photo = Photo::from_rgb8(2, 2, &data, 6, Encoding::Linear, 1.0).unwrap();
        let one = photo.reduced(2);
        assert_eq!(one.pixel(0, 0), [0.0, 1.0 / 255.0, 1.0]);
        assert!(one.is_clipped(0, 0));
        let wide: Vec<u16> = data.iter().map(|v| 257 * u16::from(*v)).collect();
        let wide = Photo::from_rgb16(2, 2, &wide, 6, Encoding::Linear, 1.0).unwrap();
        assert_eq!(wide.reduced(2).pixel(0, 0), [64.0 / 65535.0, 193.0 / 65535.0, 1.0]);
        assert_eq!(wide.luma_on_this_thread(), wide.luma());
        assert_eq!(photo.luma_on_this_thread(), photo.luma());
    }
}
