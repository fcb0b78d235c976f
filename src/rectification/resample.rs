//! Resamples photographs that already show the top view.

use crate::Rejection;
use crate::observation::{FULL_WEIGHT, Observation, View};
use crate::parallel;
use crate::photo::Photo;
use crate::svbrdf::bands;

/// Takes a photo of exactly the sample's rectangle from above, row 0 at the +Y edge.
///
/// Radiances are values divided by the photo's exposure. Along each axis, texels larger than pixels average
/// the covered pixels (exact area); smaller ones interpolate linearly between pixel centres. All weights are
/// 1. A texel is saturated in a channel if any contributing pixel is.
///
/// # Errors
/// [`Rejection::NotFinite`] if a value is not a number.
pub fn from_rectified(
    photo: &Photo,
    view: View,
    width: usize,
    height: usize,
) -> Result<Observation, Rejection> {
    let texels = width * height;
    let columns = Taps::new(photo.width() as usize, width);
    let rows = Taps::new(photo.height() as usize, height);
    let mut radiance = vec![0.0; 3 * texels];
    let scale = 1.0 / photo.exposure();
    let saturation = photo.saturation();
    let finite = texels == 0 || {
        let rows_finite: Vec<bool> =
            parallel::map_parts(bands::<3, _>(&mut radiance, width, height, 1), |y, out| {
                let mut finite = true;
                let (first_row, row_weights) = rows.of(y);
                for x in 0..width {
                    let (first_column, column_weights) = columns.of(x);
                    let mut sum = [0.0_f32; 3];
                    let mut saturated = [false; 3];
                    for (j, wy) in row_weights.iter().enumerate() {
                        for (i, wx) in column_weights.iter().enumerate() {
                            let pixel =
                                photo.pixel((first_column + i) as u32, (first_row + j) as u32);
                            for c in 0..3 {
                                sum[c] += wx * wy * pixel[c];
                                saturated[c] |= pixel[c] >= saturation;
                            }
                        }
                    }
                    for c in 0..3 {
                        finite &= sum[c].is_finite();
                        // Negative after black-level subtraction, not a clipped value.
                        let value = sum[c].max(0.0) * scale;
                        out[c][x] = if saturated[c] { -value } else { value };
                    }
                }
                finite
            });
        rows_finite.into_iter().all(|finite| finite)
    };
    if !finite {
        return Err(Rejection::NotFinite);
    }
    Ok(Observation::from_planes(width, height, view, &radiance, &vec![FULL_WEIGHT; texels]))
}

/// First pixel of each texel along an axis, and the weights (sum 1) of it and its successors.
struct Taps {
    first: Vec<usize>,
    weights: Vec<f32>,
    start: Vec<usize>,
}

impl Taps {
    fn new(pixels: usize, texels: usize) -> Self {
        let mut taps = Self { first: Vec::new(), weights: Vec::new(), start: vec![0] };
        let ratio = pixels as f64 / texels.max(1) as f64;
        for t in 0..texels {
            // Edges of the texel, in pixels; pixel i covers i to i + 1.
            let (low, high) = (t as f64 * ratio, (t + 1) as f64 * ratio);
            if ratio >= 1.0 {
                // Rounding must not add a sliver of the next pixel.
                let (low, high) = (low + 1e-9, (high - 1e-9).min(pixels as f64));
                let (first, last) = (low as usize, (high.ceil() as usize).min(pixels) - 1);
                taps.first.push(first);
                for p in first..=last {
                    let overlap = high.min(p as f64 + 1.0) - low.max(p as f64);
                    taps.weights.push((overlap / (high - low)) as f32);
                }
            } else {
                let centre = (0.5 * (low + high) - 0.5).clamp(0.0, (pixels - 1) as f64);
                let first = (centre as usize).min(pixels.saturating_sub(2));
                let fraction = (centre - first as f64) as f32;
                taps.first.push(first);
                // A pixel without weight must not mark the texel as saturated.
                if fraction <= 0.0 {
                    taps.weights.push(1.0);
                } else {
                    taps.weights.extend([1.0 - fraction, fraction]);
                }
            }
            taps.start.push(taps.weights.len());
        }
        taps
    }

    fn of(&self, texel: usize) -> (usize, &[f32]) {
        (self.first[texel], &self.weights[self.start[texel]..self.start[texel + 1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::Falloff;

    fn view() -> View {
        View {
            sample_mm: [100.0, 100.0],
            camera_mm: [0.0, 0.0, 200.0],
            light_mm: [0.0, 0.0, 200.0],
            falloff: Falloff::None { power: [1.0; 3] },
            ..View::default()
        }
    }

    fn ramp(width: u32, height: u32) -> Vec<f32> {
        (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .flat_map(|(x, y)| {
                let (x, y) = ((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
                [x, y, 0.5 * x + 0.25 * y]
            })
            .collect()
    }

    #[test]
    fn means_are_kept_when_shrinking_by_any_ratio_and_ramps_are_exact() {
        let photo = Photo::from_linear(30, 21, ramp(30, 21), 2.0, f32::INFINITY).unwrap();
        for (w, h) in [(30, 21), (15, 7), (13, 8), (1, 1)] {
            let o = from_rectified(&photo, view(), w, h).unwrap();
            for c in 0..3 {
                let sum: f32 = (0..w * h).map(|i| o.radiance(c, i)).sum();
                let mean = sum / (w * h) as f32;
                let expected = [0.25, 0.25, 0.1875][c];
                // Tolerance: half floats of values below 1.
                assert!((mean - expected).abs() < 1.3e-4, "{w}x{h} {c}: {mean}");
            }
            assert!(o.planes().1.iter().all(|w| *w == 1.0));
        }
        // Magnified: linear inside the outermost pixel centres.
        let o = from_rectified(&photo, view(), 75, 60).unwrap();
        for x in 2..73 {
            let expected = 0.5 * (x as f32 + 0.5) / 75.0;
            assert!((o.radiance(0, 30 * 75 + x) - expected).abs() < expected / 1000.0);
        }
    }

    #[test]
    fn a_clipped_channel_marks_exactly_the_texels_it_reaches() {
        let mut rgb = vec![0.25; 3 * 16];
        rgb[3 * 5] = 1.0; // pixel (1, 1), red
        let photo = Photo::from_linear(4, 4, rgb.clone(), 1.0, 1.0).unwrap();
        let o = from_rectified(&photo, view(), 2, 2).unwrap();
        let (radiance, _) = o.planes();
        assert_eq!(radiance[..4], [-0.4375, 0.25, 0.25, 0.25]);
        assert!(radiance[4..].iter().all(|v| *v == 0.25));
        rgb[0] = f32::NAN;
        let photo = Photo::from_linear(4, 4, rgb, 1.0, 1.0).unwrap();
        assert_eq!(from_rectified(&photo, view(), 2, 2), Err(Rejection::NotFinite));
    }
}
