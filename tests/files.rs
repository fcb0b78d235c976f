//! Photographs' files: one scene in every format, metadata, limits, and the names of unsupported formats.
#![cfg(feature = "files")]

#[allow(dead_code)] // Other tests use the rest.
#[path = "common/negatives.rs"]
mod negatives;
#[path = "../cli/tests/common/photos.rs"]
mod photos;

use std::io::Cursor;

use glam::{DMat3, DVec3};
use image::{DynamicImage, ImageFormat, RgbImage};
use moxcms::ColorProfile;
use negatives::{Negative, Storage, Values};
use photos::{Written, to_display_p3};
use svbrdf::Error;
use svbrdf::comparison::{delta_e_2000, lab};
use svbrdf::files::{Kind, Limits, Metadata, Options, Remark, decode};
use svbrdf::photo::{Encoding, Photo, Primaries};

/// A format that messages name besides those that are always supported.
const HEIC: &str = if cfg!(feature = "heic") { "HEIC" } else { "OpenEXR" };
/// Pixels along a side of a block of one colour, and blocks along a side of the picture.
const BLOCK: u32 = 16;
const BLOCKS: u32 = 4;
const SIDE: u32 = BLOCK * BLOCKS;

/// Linear Rec. 709 of a block: dark and bright, gray and vivid ones.
fn colour(block: u32) -> [f64; 3] {
    let level = 0.06 * 1.17f64.powi(block as i32);
    let hue = |c: u32| match (block + c) % 4 {
        0 => 1.0,
        1 => 0.35,
        2 => 0.7,
        _ => 0.9,
    };
    [0, 1, 2].map(|c| level * if block.is_multiple_of(5) { 1.0 } else { hue(c) })
}

fn block_of(x: u32, y: u32) -> u32 {
    y / BLOCK * BLOCKS + x / BLOCK
}

/// The scene with the curve of sRGB and primaries, 8 bits.
fn picture(primaries: impl Fn([f64; 3]) -> [f64; 3]) -> RgbImage {
    RgbImage::from_fn(SIDE, SIDE, |x, y| {
        let stored = |v: f64| (255.0 * Encoding::Srgb.encode(v)).round() as u8;
        image::Rgb(primaries(colour(block_of(x, y))).map(stored))
    })
}

fn srgb() -> RgbImage {
    picture(|v| v)
}

/// The scene in 16 bits with a curve and primaries.
fn deep(encoding: Encoding, primaries: impl Fn([f64; 3]) -> [f64; 3]) -> DynamicImage {
    let stored = |v: f64| (65_535.0 * encoding.encode(v)).round() as u16;
    DynamicImage::ImageRgb16(image::ImageBuffer::from_fn(SIDE, SIDE, |x, y| {
        image::Rgb(primaries(colour(block_of(x, y))).map(stored))
    }))
}

fn encoded(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn written(written: &Written, name: &str, picture: &RgbImage) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    written.save(&path, picture);
    std::fs::read(path).unwrap()
}

/// A PNG file with a chunk behind its header.
fn with_chunk(png: &[u8], kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [&kind[..], data].concat();
    let checksum = crc32fast::hash(&body).to_be_bytes();
    let length = (data.len() as u32).to_be_bytes();
    [&png[..33], &length, &body, &checksum, &png[33..]].concat()
}

/// The matrix from linear Rec. 709 to the sensor's values.
fn mix() -> DMat3 {
    DMat3::from_cols_array_2d(&[[0.35, 0.15, 0.05], [0.2, 0.7, 0.1], [0.05, 0.15, 0.5]]).transpose()
}

/// A raw file of the scene: behind colour filters, or with three values a pixel.
fn negative(channels: u32, storage: Storage) -> Vec<u8> {
    const FULL: f64 = 65_000.0;
    let values = |i: u32| {
        let (x, y) = (i % SIDE, i / SIDE);
        let seen = (mix() * DVec3::from_array(colour(block_of(x, y)))).to_array();
        let stored = seen.map(|v| (v * FULL).round() as u16);
        match channels {
            1 => vec![stored[(x % 2 + y % 2) as usize]],
            _ => stored.to_vec(),
        }
    };
    let rows = |m: DMat3| Values::Millionths(m.transpose().to_cols_array().to_vec());
    let negative = Negative {
        size: [SIDE; 2],
        bits: 16,
        channels,
        samples: (0..SIDE * SIDE).flat_map(values).collect(),
        storage,
        big_endian: false,
        below: true,
        fields: vec![
            (33421, Values::Shorts(vec![2, 2])),
            (33422, Values::Bytes(vec![0, 1, 1, 2])),
            (50706, Values::Bytes(vec![1, 4, 0, 0])),
            (50717, Values::Longs(vec![FULL as u32])),
            (50721, rows(mix() * Primaries::Rec709.to_xyz().inverse())),
            (50728, Values::Millionths((mix() * DVec3::ONE).to_array().to_vec())),
            (50778, Values::Shorts(vec![21])),
        ],
    };
    negative.bytes()
}

/// Mean of the middle of each block, per exposure.
fn means(photo: &Photo) -> Vec<[f64; 3]> {
    assert_eq!((photo.width(), photo.height()), (SIDE, SIDE));
    let middle = BLOCK / 2 - 3..BLOCK / 2 + 3;
    let mean = |block: u32| {
        let (left, top) = (block % BLOCKS * BLOCK, block / BLOCKS * BLOCK);
        let mut sum = [0.0; 3];
        for y in middle.clone() {
            for x in middle.clone() {
                let pixel = photo.pixel(left + x, top + y);
                (0..3).for_each(|c| sum[c] += f64::from(pixel[c] / photo.exposure()));
            }
        }
        sum.map(|v| v / 36.0)
    };
    (0..BLOCKS * BLOCKS).map(mean).collect()
}

fn options() -> Options {
    Options { exposure: Some(1.0), ..Options::default() }
}

#[test]
fn one_scene_comes_through_every_format() {
    let srgb = srgb();
    let p3 = ColorProfile::new_display_p3().encode().unwrap();
    let tagged = Written { profile: Some(p3), ..Written::default() };
    let wide = picture(to_display_p3);
    let linear = encoded(&deep(Encoding::Linear, |v| v), ImageFormat::Png);
    let pq = encoded(&deep(Encoding::Pq, |v| v), ImageFormat::Png);
    let p3_linear = encoded(&deep(Encoding::Linear, to_display_p3), ImageFormat::Png);
    let floats = DynamicImage::ImageRgb32F(image::ImageBuffer::from_fn(SIDE, SIDE, |x, y| {
        image::Rgb(colour(block_of(x, y)).map(|v| v as f32))
    }));
    let alpha = DynamicImage::ImageRgba16(deep(Encoding::Srgb, |v| v).to_rgba16());
    let quality = heifer::EncodeOptions { quality: 98, ..Default::default() };
    let heic = heifer::encode_rgb8(SIDE, SIDE, srgb.as_raw(), &quality).unwrap();
    let green = (mix() * DVec3::ONE).y;
    let cases: Vec<(&str, Vec<u8>, Kind, f64)> = vec![
        ("png", written(&Written::default(), "a.png", &srgb), Kind::Png, 1.0),
        ("jpeg", written(&Written::default(), "a.jpg", &srgb), Kind::Jpeg, 1.0),
        ("jpeg, Display P3", written(&tagged, "a.jpg", &wide), Kind::Jpeg, 1.0),
        ("png, gAMA 1", with_chunk(&linear, b"gAMA", &100_000u32.to_be_bytes()), Kind::Png, 1.0),
        ("png, cICP PQ", with_chunk(&pq, b"cICP", &[1, 16, 0, 1]), Kind::Png, 1.0),
        ("png, cICP P3", with_chunk(&p3_linear, b"cICP", &[12, 8, 0, 1]), Kind::Png, 1.0),
        ("tiff", encoded(&deep(Encoding::Srgb, |v| v), ImageFormat::Tiff), Kind::Tiff, 1.0),
        ("tiff, alpha", encoded(&alpha, ImageFormat::Tiff), Kind::Tiff, 1.0),
        ("exr", encoded(&floats, ImageFormat::OpenExr), Kind::OpenExr, 1.0),
        ("dng", negative(1, Storage::Strips(8)), Kind::Dng, green),
        ("dng, linear", negative(3, Storage::Strips(8)), Kind::Dng, green),
        ("dng, linear, JPEG", negative(3, Storage::Jpeg(32, 32, 1, 3)), Kind::Dng, green),
        ("heic", heic, Kind::Heic, 1.0),
    ];
    for (name, bytes, kind, scale) in cases {
        assert_eq!(Kind::of(&bytes), Some(kind), "{name}");
        if !kind.is_read() {
            assert!(decode(&bytes, &options()).unwrap_err().to_string().contains("HEIC"));
            continue;
        }
        let decoded = decode(&bytes, &options()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(decoded.remarks.is_empty(), "{name}: {:?}", decoded.remarks);
        let mut worst = 0.0f64;
        for (block, mean) in (0..).zip(means(&decoded.photo)) {
            worst = worst.max(delta_e_2000(lab(mean.map(|v| v / scale)), lab(colour(block))));
        }
        println!("{name}: ΔE00 {worst:.3} at worst");
        // 8 bits are some tenths in the darkest blocks. Files of luma and chroma round twice: a level of
        // a dark vivid colour is 1.1.
        let limit = if name.starts_with("jpeg") || kind == Kind::Heic { 1.25 } else { 1.0 };
        assert!(worst < limit, "{name}: {worst}");
    }
}

#[test]
fn metadata_are_read_and_exposure_is_right() {
    let phone = Written {
        model: Some("Phone"),
        exposure: Some(([1, 50], 125, 18)),
        time: Some("2026:05:06 07:08:09"),
        subsec: Some("25"),
        orientation: Some(6),
        flash: Some(25),
        zoom: Some(([13, 10], 35)),
        ..Written::default()
    };
    let expected = 125.0 / 50.0 / 1.8f64.powi(2);
    let quality = heifer::EncodeOptions::default();
    let pixels = srgb();
    let rgba = pixels.pixels().flat_map(|p| [p[0], p[1], p[2], 255].map(u16::from)).collect();
    let picture =
        heifer::Image { width: SIDE, height: SIDE, bit_depth: 8, has_alpha: false, data: rgba };
    let exif = heifer::Metadata { exif: phone.exif(), ..Default::default() };
    let heic = heifer::encode_with_metadata(&picture, &exif, &quality).unwrap();
    for (name, bytes) in [
        ("jpeg", written(&phone, "a.jpg", &pixels)),
        ("png", written(&phone, "a.png", &pixels)),
        ("heic", heic),
    ] {
        let known = Metadata::of(&bytes);
        assert_eq!(known.model.as_deref(), Some("Phone"), "{name}");
        // This encoder takes the picture as upright.
        let upright = if name == "heic" { 0 } else { 90 };
        assert_eq!((known.flash_fired, known.upright_deg), (Some(true), Some(upright)), "{name}");
        assert_eq!(known.taken.as_deref(), Some("2026:05:06 07:08:09.25"), "{name}");
        assert_eq!((known.digital_zoom, known.focal_35mm), (Some(1.3), Some(35.0)), "{name}");
        let exposure = known.exposure.unwrap();
        assert!((exposure / expected - 1.0).abs() < 0.01, "{name}: {exposure} for {expected}");
        if Kind::of(&bytes).is_some_and(Kind::is_read) {
            assert_eq!(known.size, Some([SIDE; 2]), "{name}");
            let photo = decode(&bytes, &Options::default()).unwrap().photo;
            assert!((f64::from(photo.exposure()) / expected - 1.0).abs() < 0.01, "{name}");
            assert_eq!(photo.focal_35mm(), Some(35.0), "{name}");
        }
    }
}

/// Programs that write photographs anew may change the types of fields.
#[test]
fn numbers_of_other_types_are_read() {
    use exif::{Field, In, Tag, Value};
    let field = |tag, value| Field { tag, ifd_num: In::PRIMARY, value };
    let fields = [
        field(Tag::ExposureTime, Value::Double(vec![0.02])),
        field(Tag::FNumber, Value::Float(vec![1.8])),
        field(Tag::PhotographicSensitivity, Value::Long(vec![125])),
    ];
    let mut writer = exif::experimental::Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut block = Cursor::new(Vec::new());
    writer.write(&mut block, false).unwrap();
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
    image::ImageEncoder::set_exif_metadata(&mut encoder, block.into_inner()).unwrap();
    encoder.encode_image(&srgb()).unwrap();
    let exposure = Metadata::of(&bytes).exposure.unwrap();
    assert!((exposure / (125.0 * 0.02 / 1.8f64.powi(2)) - 1.0).abs() < 1e-6, "{exposure}");
}

#[test]
fn mirroring_tags_are_honoured_and_said() {
    let picture = RgbImage::from_fn(8, 4, |x, y| image::Rgb([x as u8 * 30, y as u8 * 60, 7]));
    for (tag, upright, mirrored) in [(1, 0, false), (2, 0, true), (5, 270, true), (7, 90, true)] {
        let tagged = Written { orientation: Some(tag), ..Written::default() };
        let bytes = written(&tagged, "a.png", &picture);
        let known = Metadata::of(&bytes);
        assert_eq!((known.upright_deg, known.mirrored), (Some(upright), mirrored), "{tag}");
        let linear = Options { encoding: Some(Encoding::Linear), ..options() };
        let decoded = decode(&bytes, &linear).unwrap();
        assert_eq!(decoded.remarks.contains(&Remark::Mirrored), mirrored, "{tag}");
        let size = (decoded.photo.width(), decoded.photo.height());
        assert_eq!(size, if upright == 0 { (8, 4) } else { (4, 8) }, "{tag}");
        // Turned back, it is the stored picture or its mirror image.
        let turn = svbrdf::photo::Rotation::from_degrees((360 - upright) % 360).unwrap();
        let back = decoded.photo.turned(turn);
        for (x, y) in [(0, 0), (7, 0), (2, 3)] {
            let stored = picture.get_pixel(if mirrored { 7 - x } else { x }, y).0;
            let seen = back.pixel(x, y).map(|v| (255.0 * v).round() as u8);
            assert_eq!(seen, stored, "{tag}: {x}, {y}");
        }
    }
}

#[test]
fn a_missing_end_and_gray_values_are_said() {
    let whole = written(&Written::default(), "a.jpg", &srgb());
    let cut = |end: usize| decode(&whole[..whole.len() - end], &options());
    let known = decode(&whole, &options()).unwrap();
    assert!(known.remarks.is_empty());
    for end in [1, 2] {
        let decoded = cut(end).unwrap();
        assert_eq!(decoded.remarks, [Remark::EndMissing]);
        assert_eq!(decoded.photo.to_linear(), known.photo.to_linear());
    }
    for end in [60, 120] {
        let said = cut(end).unwrap_err().to_string();
        assert!(said.contains("truncated"), "{end}: {said}");
    }
    let gray = DynamicImage::ImageLuma8(DynamicImage::ImageRgb8(srgb()).into_luma8());
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Tiff] {
        // Phones write their black-and-white pictures with three equal channels.
        for gray in [gray.clone(), gray.to_rgb8().into(), gray.to_rgba8().into()] {
            if format == ImageFormat::Jpeg && gray.color().has_alpha() {
                continue;
            }
            let decoded = decode(&encoded(&gray, format), &options()).unwrap();
            assert_eq!(decoded.remarks, [Remark::Gray], "{format:?} {:?}", gray.color());
        }
    }
}

/// A deflate stream of so many zeros, as zlib wraps it: matches of 258 bytes at distance 1.
fn zeros(count: u64) -> Vec<u8> {
    let (mut out, mut hold, mut bits) = (vec![0x78, 0x01], 0u64, 0);
    let mut push = |value: u64, length: u32| {
        hold |= value << bits;
        bits += length;
        while bits >= 8 {
            out.push(hold as u8);
            hold >>= 8;
            bits -= 8;
        }
    };
    let reversed = |value: u64, length: u32| value.reverse_bits() >> (64 - length);
    // The last block, with the fixed code; a literal 0.
    push(0b011, 3);
    push(reversed(0x30, 8), 8);
    for _ in 0..count / 258 {
        // Length 258 is code 285, distance 1 is code 0.
        push(reversed(0b1100_0101, 8), 8);
        push(0, 5);
    }
    push(0, 7);
    push(0, 7);
    // The checksum of any number of zeros that is a multiple of 65521 is 1 in its lower half; nobody
    // comes as far as looking.
    out.extend([0, 0, 0, 1]);
    out
}

fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

#[test]
fn a_profile_of_a_gigabyte_is_not_unpacked() {
    let png = written(&Written::default(), "a.png", &srgb());
    for size in [40u64 << 20, 1 << 30] {
        let bomb = with_chunk(&png, b"iCCP", &[b"bomb\0\0".as_slice(), &zeros(size)].concat());
        let before = peak_mib();
        let decoded = decode(&bomb, &options()).unwrap();
        let said = decoded.remarks[0].to_string();
        assert!(
            said.contains("ICC profile cannot be used") && said.contains("too large"),
            "{said}"
        );
        assert_eq!((decoded.photo.width(), decoded.photo.height()), (SIDE, SIDE));
        if let (Some(before), Some(after)) = (before, peak_mib()) {
            // Other tests run meanwhile.
            assert!(after - before < 300.0, "{before} to {after} MiB");
        }
    }
}

#[test]
fn limits_hold_before_anything_is_allocated() {
    let huge = DynamicImage::ImageLuma8(image::GrayImage::new(4000, 4000));
    let limited = |limits: Limits| Options { limits, ..options() };
    for format in [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Jpeg] {
        let bytes = encoded(&huge, format);
        let few = Limits { pixels: 1 << 20, ..Limits::default() };
        let said = decode(&bytes, &limited(few)).unwrap_err().to_string();
        assert!(said.contains("4000 x 4000 px; 1 to 1048576"), "{said}");
        assert!(said.contains("half the size"), "{said}");
        let little = Limits { memory_bytes: 16 << 20, ..Limits::default() };
        let fault = decode(&bytes, &limited(little)).unwrap_err();
        assert!(matches!(fault, Error::MemoryLimit { limit, .. } if limit == 16 << 20), "{fault}");
        let short = Limits { file_bytes: 100, ..Limits::default() };
        let said = decode(&bytes, &limited(short)).unwrap_err().to_string();
        assert!(said.contains("at most 100"), "{said}");
    }
    let raw = negative(1, Storage::Strips(8));
    let little = Limits { memory_bytes: 1 << 10, ..Limits::default() };
    assert!(matches!(decode(&raw, &limited(little)), Err(Error::MemoryLimit { .. })));
}

#[test]
fn formats_that_are_not_read_are_named_with_what_to_do() {
    let mut cases: Vec<(Vec<u8>, &str, &str)> = vec![
        (b"\0\0\0\x1Cftypavif\0\0\0\0avifmif1miaf".to_vec(), "AVIF", "JPEG"),
        (b"\xFF\x0A\xFA\x7F".to_vec(), "JPEG XL", "JPEG"),
        (b"RIFF\x10\0\0\0WEBPVP8 ".to_vec(), "WebP", "JPEG"),
        (b"II*\0\x10\0\0\0CR\x02\0".to_vec(), "raw file of a camera maker", "DNG"),
        (b"\0\0\0\x14ftypcrx \0\0\0\x01crx ".to_vec(), "raw file of a camera maker", "DNG"),
        (b"P6 640 480 255\n".to_vec(), "PPM", HEIC),
        (b"\0\0\0\x14ftypqt  \0\0\0\0qt  ".to_vec(), "video", "photograph"),
        (b"hello".to_vec(), "not a picture", HEIC),
        (Vec::new(), "empty", ""),
    ];
    // Nikon's and Sony's files are TIFF inside, with raw values that nothing is said about.
    let mut nef = negative(1, Storage::Strips(8));
    let version = nef.windows(4).position(|w| w == [0x12, 0xC6, 1, 0]).unwrap();
    nef[version..version + 2].copy_from_slice(&0xC000u16.to_le_bytes());
    cases.push((nef, "raw file of a camera maker", "DNG"));
    for (bytes, name, advice) in cases {
        let said = decode(&bytes, &options()).unwrap_err().to_string();
        assert!(said.contains(name) && said.contains(advice), "{said}");
    }
    let said = decode(
        &negative(1, Storage::Strips(8)),
        &Options { encoding: Some(Encoding::Srgb), ..options() },
    );
    assert!(said.unwrap_err().to_string().contains("raw values are linear"));
}
