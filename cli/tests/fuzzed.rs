//! A short run of the fuzz targets of what the command line reads itself, on stable Rust: the committed
//! seeds and changes of them, the same every time. `SVBRDF_FUZZ_ROUNDS` multiplies their number,
//! `SVBRDF_UPDATE` writes the seeds anew.
#![allow(dead_code)] // some of it is for folders

#[path = "../../fuzz/shared/described.rs"]
mod described;
#[path = "../src/dng/mod.rs"]
mod dng;
#[path = "../src/pictures/metadata.rs"]
mod metadata;
#[path = "../../fuzz/shared/mutate.rs"]
mod mutate;
#[path = "common/negatives.rs"]
mod negatives;
#[path = "../src/pictures/profile.rs"]
mod profile;
#[path = "../../fuzz/shared/dng.rs"]
mod run_dng;

use std::fs;
use std::path::{Path, PathBuf};

use moxcms::ColorProfile;
use negatives::{Negative, Storage, Values};

fn seeds(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target)
}

fn rounds(count: usize) -> usize {
    let times = std::env::var("SVBRDF_FUZZ_ROUNDS").ok().and_then(|v| v.parse().ok());
    count * times.unwrap_or(1_usize)
}

/// Puts a seed where it belongs, if seeds are to be written.
fn seed(target: &str, name: &str, bytes: &[u8]) {
    if std::env::var_os("SVBRDF_UPDATE").is_some() {
        fs::create_dir_all(seeds(target)).unwrap();
        fs::write(seeds(target).join(name), bytes).unwrap();
    }
}

fn negative(storage: Storage, big_endian: bool) -> Negative {
    Negative {
        size: [18, 14],
        bits: 12,
        samples: (0..18 * 14).map(|i| 64 + (i * 29 % 4000)).collect(),
        storage,
        big_endian,
        below: big_endian,
        fields: vec![
            (274, Values::Shorts(vec![6])),
            (33421, Values::Shorts(vec![2, 2])),
            (33422, Values::Bytes(vec![0, 1, 1, 2])),
            (50706, Values::Bytes(vec![1, 4, 0, 0])),
            (50714, Values::Longs(vec![64])),
            (50717, Values::Longs(vec![4095])),
            (50719, Values::Longs(vec![2, 2])),
            (50720, Values::Longs(vec![12, 10])),
            (50721, Values::Millionths(vec![0.9, -0.3, 0.0, -0.4, 1.2, 0.2, 0.0, 0.1, 0.6])),
            (50728, Values::Millionths(vec![0.5, 1.0, 0.6])),
            (50778, Values::Shorts(vec![21])),
        ],
    }
}

#[test]
fn dng() {
    seed("dng", "strips", &negative(Storage::Strips(5), false).bytes());
    seed("dng", "jpeg", &negative(Storage::Jpeg(16, 16, 1, 2), true).bytes());
    seed("dng", "tiles", &negative(Storage::Tiles(16, 16), false).bytes());
    let tokens: [&[u8]; 5] = [&[0xFF, 0xC3], &[0xFF, 0xDA], &[0, 0, 1], &[1, 0, 0], &[0xFF; 4]];
    let good = mutate::each(&seeds("dng"), rounds(20_000), &tokens, run_dng::run);
    assert!(good > 1000);
}

#[test]
fn described() {
    let p3 = ColorProfile::new_display_p3().encode().unwrap();
    let gray = ColorProfile::new_gray_with_gamma(2.2).encode().unwrap();
    seed("described", "display-p3", &[&[0], p3.as_slice()].concat());
    seed("described", "gray", &[&[0], gray.as_slice()].concat());
    let turned = fs::read(seeds("photo").join("turned.jpg")).unwrap();
    seed("described", "exif", &[&[1], &turned[1..]].concat());
    let raw = negative(Storage::Strips(14), true).bytes();
    seed("described", "tiff", &[&[1], raw.as_slice()].concat());
    let tokens: [&[u8]; 4] = [b"Exif\0\0", b"curv", b"para", b"XYZ "];
    let good = mutate::each(&seeds("described"), rounds(2000), &tokens, described::run);
    assert!(good > 100);
}
