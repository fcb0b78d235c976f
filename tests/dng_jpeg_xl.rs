//! Raw photographs with JPEG XL inside, made by the encoder of libjxl (`cjxl`).
#![cfg(feature = "jxl")]

#[path = "common/negatives.rs"]
#[allow(dead_code)] // Other tests use the rest.
mod negatives;

use std::process::Command;

use glam::DMat3;
use negatives::{Encoder, Negative, Storage, Values};
use svbrdf::files::{Options, decode};
use svbrdf::photo::{Photo, Primaries};

const JPEG_XL: u16 = 52546;

/// 16 x 8 px of 10 bits, lossless, a bare codestream: [`colour_value`]; by cjxl 0.7.0 from a PPM file, as
/// [`cjxl`] writes it, with `-d 0 -e 9`.
const COLOUR: &str = "ff0ac15140712108020100cc004b2834328e130602cc0692bbc0bf6f3e80f3006256f02fff9ccda2e9ffe4\
    67d091c00b34eb70f12e962d5014608e0d429f4002";
/// 16 x 8 px of 16 bits, lossless, in a container: [`gray_value`]; the same with `--container=1`.
const GRAY: &str = "0000000c4a584c200d0a870a00000014667479706a786c20000000006a786c20000000096a786c6c0a\
    000000836a786c63ff0ac1f10314170208020100b4014b188b150152e891415b7357f1f812a284e9e6f3e07f67f7165077\
    f2b004283ce10950800214a210052948310ac741135eb20f73f6e88ba0e8713420221015880c44070202bd133480143bfb\
    f0237f1287907a4602e68b0bf2676e14a968f6a1c7054d8d161d8d02cc1717cc0f";
const SIZE: [u32; 2] = [16, 8];

fn colour_value(x: u32, y: u32, c: u32) -> u16 {
    (31 * x + 17 * y + 100 * c + 300 * ((x / 4 + y / 4) % 2)) as u16
}

fn gray_value(x: u32, y: u32) -> u16 {
    (257 * (7 * x + 11 * y) + x * y) as u16
}

fn bytes(hex: &str) -> Vec<u8> {
    hex.as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}

/// A file whose values are linear Rec. 709.
fn negative(
    size: [u32; 2],
    bits: u32,
    channels: u32,
    value: impl Fn(u32, u32, u32) -> u16,
) -> Negative {
    let pixels = (0..size[0] * size[1]).map(|i| (i % size[0], i / size[0]));
    let samples = pixels.flat_map(|(x, y)| (0..channels).map(move |c| (x, y, c)));
    let from_xyz = Primaries::Rec709.to_xyz().inverse().transpose();
    let matrix = DMat3::from_diagonal(glam::DVec3::ONE) * from_xyz;
    let negative = Negative {
        size,
        bits,
        channels,
        samples: samples.map(|(x, y, c)| value(x, y, c)).collect(),
        storage: Storage::Strips(size[1]),
        big_endian: false,
        below: true,
        fields: vec![
            (50706, Values::Bytes(vec![1, 7, 1, 0])),
            (50721, Values::Millionths(matrix.to_cols_array().to_vec())),
            (50728, Values::Millionths(vec![1.0; 3])),
            (50778, Values::Shorts(vec![21])),
        ],
    };
    let filters = |n: Negative| {
        n.set(33421, Values::Shorts(vec![2, 2])).set(33422, Values::Bytes(vec![0, 1, 1, 2]))
    };
    if channels == 1 { filters(negative) } else { negative }
}

fn white(negative: Negative, level: u32) -> Negative {
    negative.set(50717, Values::Longs(vec![level]))
}

fn read(bytes: &[u8]) -> Result<Photo, String> {
    let options = Options { exposure: Some(1.0), ..Options::default() };
    decode(bytes, &options).map(|decoded| decoded.photo).map_err(|fault| fault.to_string())
}

#[test]
fn stored_codestreams_are_read_exactly() {
    // As newer iPhones write it: 10 bits, levels of 16.
    let coded = Storage::Coded(16, 8, JPEG_XL, |_, _, _| bytes(COLOUR));
    let plain = negative(SIZE, 10, 3, colour_value);
    for (level, step) in [(65_535, 1.0 / 65_535.0), (1023, 0.0)] {
        let photo =
            read(&white(Negative { storage: coded, ..plain.clone() }, level).bytes()).unwrap();
        let expected = read(&white(plain.clone(), 1023).bytes()).unwrap();
        for (a, b) in photo.to_linear().iter().zip(expected.to_linear()) {
            // The matrix is the identity but for its rounding.
            assert!((a - b).abs() <= step + 1e-6, "{level}: {a} {b}");
        }
        assert!((photo.pixel(3, 2)[1] - f32::from(colour_value(3, 2, 1)) / 1023.0).abs() < 1e-4);
    }
    // Without a level of white, that of 16 bits.
    let photo = read(&Negative { storage: coded, ..plain.clone() }.bytes()).unwrap();
    assert!((photo.pixel(3, 2)[1] - f32::from(colour_value(3, 2, 1)) / 1023.0).abs() < 1e-4);
    let plain = negative(SIZE, 16, 1, |x, y, _| gray_value(x, y));
    let coded = Storage::Coded(16, 8, JPEG_XL, |_, _, _| bytes(GRAY));
    let photo = read(&Negative { storage: coded, ..plain.clone() }.bytes()).unwrap();
    assert_eq!(photo.to_linear(), read(&plain.bytes()).unwrap().to_linear());
}

#[test]
fn codestreams_that_do_not_fit_are_named() {
    let plain = negative(SIZE, 16, 3, colour_value);
    for (storage, expected) in [
        (Storage::Coded(16, 8, JPEG_XL, |_, _, _| bytes(GRAY)), "1 values a pixel; 3"),
        (Storage::Coded(32, 16, JPEG_XL, |_, _, _| bytes(COLOUR)[..60].to_vec()), "JPEG XL: "),
        (Storage::Coded(16, 16, JPEG_XL, |_, _, _| b"no codestream".to_vec()), "JPEG XL: "),
        (Storage::Coded(8, 8, JPEG_XL, |_, _, _| bytes(COLOUR)), "JPEG XL: "),
    ] {
        let said = read(&Negative { storage, ..plain.clone() }.bytes()).err().unwrap();
        assert!(said.contains(expected), "{expected}: {said}");
    }
    // A tile at the edge may hold only its pixels inside the picture.
    let edge = Storage::Coded(32, 16, JPEG_XL, |_, _, _| bytes(COLOUR));
    let photo = read(&white(Negative { storage: edge, ..plain.clone() }, 65_535).bytes()).unwrap();
    assert!((photo.pixel(3, 2)[1] - f32::from(colour_value(3, 2, 1)) / 1023.0).abs() < 1e-4);
}

#[test]
fn damaged_codestreams_are_photographs_or_errors() {
    let coded = Storage::Coded(16, 8, JPEG_XL, |_, _, _| bytes(COLOUR));
    let whole = Negative { storage: coded, ..negative(SIZE, 10, 3, colour_value) }.bytes();
    let mut state = 7u64;
    let mut random = |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for round in 0..400 {
        let mut damaged = whole.clone();
        // The codestream lies behind the header.
        for _ in 0..=round % 3 {
            damaged[8 + random(COLOUR.len() / 2)] ^= 1 << random(8);
        }
        match read(&damaged) {
            Ok(photo) => assert!(photo.width() == 16 && photo.is_finite()),
            Err(said) => assert!(said.contains("DNG: "), "{said}"),
        }
    }
}

/// A picture encoded by `cjxl`; `None` if the program is missing. Versions interpret values of fewer bits in different
/// ways, so it gets 16 bits and the number to store.
fn cjxl(rows: &[Vec<u16>], bits: u32, channels: u32, options: &[&str]) -> Option<Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    let (source, target) = (dir.path().join("in.pnm"), dir.path().join("out.jxl"));
    let kind = if channels == 3 { 6 } else { 5 };
    let width = rows[0].len() / channels as usize;
    let mut picture = format!("P{kind}\n{width} {}\n65535\n", rows.len()).into_bytes();
    let full = (1u32 << bits) - 1;
    let widened = |v: &u16| ((u32::from(*v) * 65_535 + full / 2) / full) as u16;
    picture.extend(rows.iter().flatten().flat_map(|v| widened(v).to_be_bytes()));
    std::fs::write(&source, picture).unwrap();
    let depth = format!("--override_bitdepth={bits}");
    let run =
        Command::new("cjxl").arg(source).arg(&target).arg(depth).args(options).output().ok()?;
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    Some(std::fs::read(target).unwrap())
}

fn lossless(rows: &[Vec<u16>], bits: u32, channels: u32) -> Vec<u8> {
    cjxl(rows, bits, channels, &["-d", "0", "-e", "3"]).unwrap()
}

fn contained(rows: &[Vec<u16>], bits: u32, channels: u32) -> Vec<u8> {
    cjxl(rows, bits, channels, &["-d", "0", "-e", "3", "--container=1"]).unwrap()
}

fn lossy(rows: &[Vec<u16>], bits: u32, channels: u32) -> Vec<u8> {
    cjxl(rows, bits, channels, &["-d", "0.1"]).unwrap()
}

/// Smooth with a little detail.
fn scene(x: u32, y: u32, c: u32) -> f64 {
    let (x, y) = (f64::from(x), f64::from(y));
    0.4 + 0.25 * (0.07 * x + f64::from(c)).sin()
        + 0.2 * (0.09 * y).cos()
        + 0.02 * (x * 1.7 + y).sin()
}

#[test]
fn files_of_an_independent_encoder_are_those_without_compression() {
    if cjxl(&[vec![0; 8], vec![0; 8]], 16, 1, &[]).is_none() {
        eprintln!(
            "SKIPPED: cjxl (Debian: libjxl-tools) is missing: only stored codestreams are read"
        );
        return;
    }
    let tiles = |encoder: Encoder| Storage::Coded(64, 48, JPEG_XL, encoder);
    for (bits, channels) in [(10, 3), (12, 3), (14, 1), (16, 3), (16, 1)] {
        let full = f64::from((1u32 << bits) - 1);
        let value =
            |x, y, c| (scene(x, y, if channels == 3 { c } else { x % 2 + y % 2 }) * full) as u16;
        let plain = white(negative([150, 100], bits, channels, value), (1 << bits) - 1);
        let known = read(&plain.bytes()).unwrap().to_linear();
        for encoder in [lossless as Encoder, contained] {
            for (storage, big_endian) in
                [(tiles(encoder), true), (Storage::Coded(150, 100, JPEG_XL, encoder), false)]
            {
                let coded = Negative { storage, big_endian, ..plain.clone() };
                let photo = read(&coded.bytes()).unwrap();
                assert!(photo.to_linear() == known, "{bits} bits, {channels} channels");
            }
        }
        // Visually lossless: some thousandths in the mean.
        if channels == 3 {
            let coded = Negative { storage: tiles(lossy), ..plain.clone() };
            let found = read(&coded.bytes()).unwrap().to_linear();
            let off: f32 = found.iter().zip(&known).map(|(a, b)| (a - b).abs()).sum();
            let mean = off / known.len() as f32;
            assert!(mean < 0.003, "{bits} bits: {mean}");
        }
    }
}

/// Adobe's converter puts the four places of the colour filters side by side before it compresses them.
#[test]
fn fields_are_put_in_order() {
    let [w, h] = [31u32, 22];
    let value = |x: u32, y: u32, _: u32| (scene(x, y, x % 2 + y % 2) * 60_000.0) as u16;
    let plain = negative([w, h], 16, 1, value);
    let known = read(&plain.bytes()).unwrap().to_linear();
    // The first field has one more row of an odd number.
    let place = |i: u32, count: u32| i % 2 * count.div_ceil(2) + i / 2;
    let mut stored = plain.clone();
    for (i, value) in plain.samples.iter().enumerate() {
        let (x, y) = (i as u32 % w, i as u32 / w);
        stored.samples[(place(y, h) * w + place(x, w)) as usize] = *value;
    }
    let stored = stored.set(50975, Values::Longs(vec![2])).set(52547, Values::Longs(vec![2]));
    assert!(read(&stored.bytes()).unwrap().to_linear() == known);
    assert!(read(&stored.set(52547, Values::Longs(vec![1])).bytes()).unwrap().to_linear() != known);
}
