use half::f16;

use super::*;

fn tight(data: &[u8], row_stride: usize) -> Plane<'_> {
    Plane { data, row_stride, pixel_stride: 0 }
}

/// Linear RGB of 3 x 2 pixels, all values exact in 8 bits.
const PIXELS: [u8; 18] =
    [0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 140, 255, 1, 2];

/// The pixels in a layout, with gaps between pixels and rows.
fn laid_out(layout: Interleaved, gap: usize) -> (Vec<u8>, usize, usize) {
    let pixel = layout.bytes() + gap;
    let row = 3 * pixel + 5;
    let mut data = vec![0xAB; 2 * row];
    for (i, rgb) in PIXELS.as_chunks::<3>().0.iter().enumerate() {
        let mut bytes = Vec::new();
        let mut stored = *rgb;
        if layout == Interleaved::Bgra8 {
            stored.reverse();
        }
        for v in stored {
            match layout {
                Interleaved::Rgb8 | Interleaved::Rgba8 | Interleaved::Bgra8 => bytes.push(v),
                Interleaved::Rgb16 | Interleaved::Rgba16 => {
                    bytes.extend((u16::from(v) * 257).to_ne_bytes());
                }
                Interleaved::RgbaF16 => bytes.extend(f16::from_f32(f32::from(v)).to_ne_bytes()),
                Interleaved::RgbF32 | Interleaved::RgbaF32 => {
                    bytes.extend((f32::from(v) / 255.0).to_ne_bytes());
                }
            }
        }
        let at = (i / 3) * row + (i % 3) * pixel;
        data[at..at + bytes.len()].copy_from_slice(&bytes);
    }
    (data, row, pixel)
}

#[test]
fn every_layout_gives_the_same_pixels_whatever_the_strides() {
    let expected: Vec<f32> = PIXELS.iter().map(|&v| f32::from(v) / 255.0).collect();
    for layout in [
        Interleaved::Rgb8,
        Interleaved::Rgba8,
        Interleaved::Bgra8,
        Interleaved::Rgb16,
        Interleaved::Rgba16,
        Interleaved::RgbaF16,
        Interleaved::RgbF32,
        Interleaved::RgbaF32,
    ] {
        for gap in [0, 3] {
            let (data, row_stride, pixel_stride) = laid_out(layout, gap);
            let plane = Plane { data: &data, row_stride, pixel_stride };
            let photo = Photo::from_interleaved(
                [3, 2],
                plane,
                layout,
                Encoding::Linear,
                Rotation::None,
                2.0,
                f32::INFINITY,
            )
            .unwrap();
            let scale = if layout == Interleaved::RgbaF16 { 255.0 } else { 1.0 };
            for (found, expected) in photo.to_linear().iter().zip(&expected) {
                // Tables are computed in f64, floats divided in f32: a tolerance of half a unit in
                // the last place.
                assert!((found - expected * scale).abs() < 1e-6 * scale, "{layout:?}");
            }
            assert_eq!(photo.exposure(), 2.0);
        }
    }
}

#[test]
fn rotations_turn_clockwise() {
    let (data, row, _) = laid_out(Interleaved::Rgb8, 0);
    let green = |rotation| {
        let photo = Photo::from_interleaved(
            [3, 2],
            tight(&data, row),
            Interleaved::Rgb8,
            Encoding::Linear,
            rotation,
            1.0,
            1.0,
        )
        .unwrap();
        let mut rows = Vec::new();
        for y in 0..photo.height() {
            let value = |x| (photo.pixel(x, y)[1] * 255.0).round() as u8;
            rows.push((0..photo.width()).map(value).collect::<Vec<_>>());
        }
        rows
    };
    assert_eq!(green(Rotation::None), [[10, 40, 70], [100, 130, 1]]);
    assert_eq!(green(Rotation::Quarter), [[100, 10], [130, 40], [1, 70]]);
    assert_eq!(green(Rotation::Half), [[1, 130, 100], [70, 40, 10]]);
    assert_eq!(green(Rotation::ThreeQuarters), [[70, 1], [40, 130], [10, 100]]);
}

#[test]
fn planes_that_are_too_short_or_overflow_are_refused() {
    let data = [0u8; 64];
    let attempt = |size, plane| {
        let layout = Interleaved::Rgba8;
        Photo::from_interleaved(size, plane, layout, Encoding::Srgb, Rotation::None, 1.0, 1.0)
    };
    // The last row may end after its last pixel.
    assert!(attempt([2, 2], Plane { data: &data[..24], row_stride: 16, pixel_stride: 4 }).is_ok());
    for (size, row_stride, pixel_stride) in [
        ([0, 2], 16, 4),
        ([2, 0], 16, 4),
        ([u32::MAX, u32::MAX], 16, 4),
        ([2, 2], 7, 4),
        ([2, 2], 16, 3),
        ([2, 2], 64, 4),
        ([2, 3], usize::MAX, 4),
        ([2, 3], usize::MAX / 2 + 1, 4),
        ([2, 1], 16, usize::MAX),
    ] {
        let fault = attempt(size, Plane { data: &data, row_stride, pixel_stride });
        assert!(matches!(fault, Err(Error::Argument { .. })), "{size:?} {row_stride}");
    }
    let floats = Photo::from_interleaved(
        [1, 1],
        tight(&data, 16),
        Interleaved::RgbaF32,
        Encoding::Srgb,
        Rotation::None,
        1.0,
        1.0,
    );
    assert!(floats.is_err(), "floats with a curve");
}

/// R'G'B' to luma and chroma as defined by the standards.
fn luma_chroma(rgb: [f64; 3], kr: f64, kb: f64, full: bool, bits: i32) -> [u16; 3] {
    let y = kr * rgb[0] + (1.0 - kr - kb) * rgb[1] + kb * rgb[2];
    let (u, v) = (0.5 * (rgb[2] - y) / (1.0 - kb), 0.5 * (rgb[0] - y) / (1.0 - kr));
    let (largest, step) = (2f64.powi(bits) - 1.0, 2f64.powi(bits - 8));
    let [a, b, o] =
        if full { [largest, largest, 0.0] } else { [219.0 * step, 224.0 * step, 16.0 * step] };
    let middle = 128.0 * step;
    [o + a * y, middle + b * u, middle + b * v].map(|v| v.round().min(largest) as u16)
}

const MATRICES: [(YuvMatrix, f64, f64, bool); 6] = [
    (YuvMatrix::Bt601Full, 0.299, 0.114, true),
    (YuvMatrix::Bt601Limited, 0.299, 0.114, false),
    (YuvMatrix::Bt709Full, 0.2126, 0.0722, true),
    (YuvMatrix::Bt709Limited, 0.2126, 0.0722, false),
    (YuvMatrix::Bt2020Full, 0.2627, 0.0593, true),
    (YuvMatrix::Bt2020Limited, 0.2627, 0.0593, false),
];

const COLORS: [[f64; 3]; 5] =
    [[1.0, 1.0, 1.0], [0.0; 3], [0.8, 0.3, 0.2], [0.1, 0.6, 0.9], [1.0, 0.0, 0.0]];

#[test]
fn ten_bits_come_back_four_times_as_fine() {
    for (matrix, kr, kb, full) in MATRICES {
        for rgb in COLORS {
            // 5 x 3 words of one colour, with the ignored lower bits set.
            let [y, u, v] = luma_chroma(rgb, kr, kb, full, 10).map(|v| (v << 6 | 21).to_ne_bytes());
            let luma = y.repeat(15);
            let chroma: Vec<u8> = [u, v].concat().repeat(6);
            let planes = [
                Plane { data: &luma, row_stride: 10, pixel_stride: 0 },
                Plane { data: &chroma[..22], row_stride: 12, pixel_stride: 4 },
                Plane { data: &chroma[2..], row_stride: 12, pixel_stride: 4 },
            ];
            let read = |planes| {
                let turned = Rotation::Quarter;
                Photo::from_p010([5, 3], planes, matrix, Encoding::Linear, turned, 1.0)
            };
            let photo = read(planes).unwrap();
            assert_eq!((photo.width(), photo.height()), (3, 5));
            for (found, expected) in photo.pixel(2, 4).iter().zip(rgb) {
                // Tolerance as for 8 bits: 0.5 (1 + 1.88) steps of 1/876.
                assert!((f64::from(*found) - expected).abs() < 1.5 / 876.0, "{matrix:?} {rgb:?}");
            }
            // Rounded chroma may leave full red one step below full scale, but never white.
            if rgb != [1.0, 0.0, 0.0] {
                assert_eq!(photo.is_clipped(0, 0), rgb == [1.0; 3], "{matrix:?} {rgb:?}");
            }
            let short = Plane { data: &luma[..29], ..planes[0] };
            assert!(read([short, planes[1], planes[2]]).is_err());
        }
    }
}

#[test]
fn yuv_comes_back_as_the_rgb_it_was_made_from() {
    for (matrix, kr, kb, full) in MATRICES {
        for rgb in COLORS {
            let [y, u, v] = luma_chroma(rgb, kr, kb, full, 8).map(|v| v as u8);
            // 5 x 3 pixels of one colour; chroma interleaved as in NV12, 3 x 2 samples.
            let luma = [y; 15];
            let chroma: Vec<u8> = [u, v].repeat(6);
            let planes = [
                Plane { data: &luma, row_stride: 5, pixel_stride: 1 },
                Plane { data: &chroma[..11], row_stride: 6, pixel_stride: 2 },
                Plane { data: &chroma[1..], row_stride: 6, pixel_stride: 2 },
            ];
            let photo = Photo::from_yuv420(
                [5, 3],
                planes,
                matrix,
                Encoding::Linear,
                Rotation::Quarter,
                1.0,
            )
            .unwrap();
            assert_eq!((photo.width(), photo.height()), (3, 5));
            for (found, expected) in photo.pixel(2, 4).iter().zip(rgb) {
                // Rounding of luma and chroma: at most 0.5 (1 + 1.86) steps of 1/219.
                assert!((f64::from(*found) - expected).abs() < 1.5 / 219.0, "{matrix:?} {rgb:?}");
            }
        }
    }
}

#[test]
fn chroma_is_interpolated_between_its_samples() {
    let luma = [128; 8];
    // One chroma sample per two columns: 128, then 160, centred at x = 0.5 and 2.5.
    let (u, v) = ([128; 2], [128, 160]);
    let planes = [tight(&luma, 4), tight(&u, 2), tight(&v, 2)];
    let size = [4, 2];
    let photo = Photo::from_yuv420(
        size,
        planes,
        YuvMatrix::Bt601Full,
        Encoding::Linear,
        Rotation::None,
        1.0,
    )
    .unwrap();
    let red = |x| (photo.pixel(x, 0)[0] * 255.0).round();
    // 1.402 times 0, 8, 24, 32 above 128
    assert_eq!([red(0), red(1), red(2), red(3)], [128.0, 139.0, 162.0, 173.0]);
}

const IDENTITY: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn bayer(pattern: BayerPattern) -> Bayer {
    Bayer {
        pattern,
        black_level: [64.0; 4],
        white_level: 1023.0,
        white_balance: [1.0; 3],
        color_matrix: IDENTITY,
    }
}

const PATTERNS: [(BayerPattern, [usize; 4]); 4] = [
    (BayerPattern::Rggb, [0, 1, 1, 2]),
    (BayerPattern::Grbg, [1, 0, 2, 1]),
    (BayerPattern::Gbrg, [1, 2, 0, 1]),
    (BayerPattern::Bggr, [2, 1, 1, 0]),
];

fn mosaic(colors: [usize; 4], rgb: impl Fn(usize, usize) -> [f32; 3]) -> Vec<u8> {
    let value = |i: usize| {
        let (x, y) = (i % 12, i / 12);
        (64.0 + 959.0 * rgb(x, y)[colors[2 * (y & 1) + (x & 1)]]).round() as u16
    };
    (0..120).flat_map(|i| value(i).to_ne_bytes()).collect()
}

fn develop(data: &[u8], bayer: &Bayer) -> Photo {
    Photo::from_bayer16([12, 10], tight(data, 24), bayer, Rotation::None, 1.0).unwrap()
}

#[test]
fn plain_colours_and_ramps_are_developed_exactly() {
    for (pattern, colors) in PATTERNS {
        let plain = develop(&mosaic(colors, |_, _| [0.2, 0.5, 0.7]), &bayer(pattern));
        for y in 0..10 {
            for x in 0..12 {
                for (found, expected) in plain.pixel(x, y).iter().zip([0.2, 0.5, 0.7]) {
                    // Tolerance: half a 10-bit step, times the filters' gain of at most 2.
                    assert!((found - expected).abs() < 1.0 / 959.0, "{pattern:?} {x} {y}");
                }
            }
        }
        // Symmetric linear filters that preserve constants preserve gray ramps.
        let gray = |x: usize, y: usize| [0.1 + 0.03 * x as f32 + 0.02 * y as f32; 3];
        let ramp = develop(&mosaic(colors, gray), &bayer(pattern));
        for y in 2..8 {
            for x in 2..10 {
                let expected = gray(x, y)[0];
                for found in ramp.pixel(x as u32, y as u32) {
                    assert!((found - expected).abs() < 2.0 / 959.0, "{pattern:?} {x} {y}");
                }
            }
        }
    }
}

#[test]
fn white_balance_and_matrix_act_before_and_after_demosaicking() {
    let (pattern, colors) = PATTERNS[1];
    let matrix = [[1.5, -0.4, -0.1], [-0.2, 1.4, -0.2], [0.0, -0.5, 1.5]];
    let settings = Bayer {
        white_balance: [2.0, 1.0, 1.6],
        color_matrix: matrix,
        black_level: [60.0, 64.0, 64.0, 70.0],
        ..bayer(pattern)
    };
    let raw = [0.2, 0.4, 0.3];
    let balanced = [0.4, 0.4, 0.48];
    let photo = develop(&mosaic(colors, |_, _| raw), &settings);
    for (found, row) in photo.pixel(5, 5).iter().zip(matrix) {
        let expected: f32 = row.iter().zip(balanced).map(|(m, v)| m * v).sum();
        // True blacks are 60 and 70 instead of 64: 6 / 959 in green, times 1.5 in red and blue.
        assert!((found - expected).abs() < 0.015, "{found} {expected}");
    }
    // Gains below 1 would put clipped values below full scale, so they change the exposure.
    let dim = Bayer { white_balance: [1.0, 0.5, 0.8], ..settings };
    let scaled = develop(&mosaic(colors, |_, _| raw), &dim);
    assert_eq!(scaled.to_linear(), photo.to_linear());
    assert_eq!(scaled.exposure(), 2.0);
}

#[test]
fn clipped_samples_mark_their_channel_only() {
    let (pattern, colors) = PATTERNS[0];
    // Low enough for interpolated values beside full scale to stay below it.
    let mut data = mosaic(colors, |_, _| [0.3; 3]);
    // (4, 4) is red in this pattern.
    data[2 * (4 * 12 + 4)..][..2].copy_from_slice(&1023u16.to_ne_bytes());
    let photo = develop(&data, &bayer(pattern));
    let clipped = |x, y| photo.pixel(x, y).map(|v| v >= photo.saturation());
    assert_eq!(clipped(4, 4), [true, false, false]);
    assert_eq!(clipped(5, 5), [true, false, false]);
    assert_eq!(clipped(7, 4), [false; 3]);
}

#[test]
fn raw_numbers_out_of_range_are_refused() {
    let data = [0u8; 240];
    let good = bayer(BayerPattern::Rggb);
    for bad in [
        Bayer { white_level: 64.0, ..good },
        Bayer { white_level: f32::NAN, ..good },
        Bayer { black_level: [0.0, f32::NAN, 0.0, 0.0], ..good },
        Bayer { black_level: [-1.0; 4], ..good },
        Bayer { white_balance: [1.0, 0.0, 1.0], ..good },
        Bayer { white_balance: [1.0, f32::INFINITY, 1.0], ..good },
        Bayer { color_matrix: [[f32::NAN; 3]; 3], ..good },
    ] {
        let plane = tight(&data, 24);
        assert!(Photo::from_bayer16([12, 10], plane, &bad, Rotation::None, 1.0).is_err());
    }
    for size in [[1, 1], [2, 2], [3, 1]] {
        let plane = tight(&data, 24);
        assert!(Photo::from_bayer16(size, plane, &good, Rotation::None, 1.0).is_ok());
    }
}
