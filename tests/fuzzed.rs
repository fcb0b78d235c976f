//! A short run of the fuzz targets on stable Rust: the committed seeds and changes of them, the
//! same every time. `SVBRDF_FUZZ_ROUNDS` multiplies their number.

// The targets know the library by this name.
extern crate svbrdf as engine;

#[path = "../fuzz/shared/capture_json.rs"]
mod capture_json;
#[path = "../fuzz/shared/files.rs"]
mod files;
#[path = "../fuzz/shared/mutate.rs"]
mod mutate;
#[path = "common/negatives.rs"]
#[allow(dead_code)] // of its storages, some
mod negatives;
#[path = "../fuzz/shared/photo.rs"]
mod photo;
#[path = "../fuzz/shared/session_state.rs"]
mod session_state;

use std::path::PathBuf;

use moxcms::ColorProfile;
use negatives::{Negative, Storage, Values};

fn seeds(target: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(target)
}

fn rounds(count: usize) -> usize {
    let times = std::env::var("SVBRDF_FUZZ_ROUNDS").ok().and_then(|v| v.parse().ok());
    count * times.unwrap_or(1_usize)
}

#[test]
fn capture_json() {
    let tokens: [&[u8]; 16] = [
        b"1e999",
        b"-1",
        b"0",
        b"null",
        b"[]",
        b"{}",
        b"\"\"",
        b"1e-320",
        b"4294967296",
        b"true",
        b"[[[[[[[[",
        b"\"srgb\"",
        b"\"charuco-ring\"",
        b"\"rectified\":true,",
        b"\xff",
        b"NaN",
    ];
    let good = mutate::each(&seeds("capture_json"), rounds(100_000), &tokens, capture_json::run);
    assert!(good > 500);
}

#[test]
fn photo() {
    let tokens: [&[u8]; 3] = [&[0xFF, 0xD9], b"IDAT", b"IEND"];
    let good = mutate::each(&seeds("photo"), rounds(600), &tokens, photo::run);
    assert!(good > 20);
}

/// Puts a seed where it belongs, if seeds are to be written.
fn seed(target: &str, name: &str, bytes: &[u8]) {
    if std::env::var_os("SVBRDF_UPDATE").is_some() {
        std::fs::create_dir_all(seeds(target)).unwrap();
        std::fs::write(seeds(target).join(name), bytes).unwrap();
    }
}

fn negative(storage: Storage, big_endian: bool, channels: u32) -> Vec<u8> {
    let negative = Negative {
        size: [18, 14],
        bits: 12,
        channels,
        samples: (0..18 * 14 * channels as u16).map(|i| 64 + (i * 29 % 4000)).collect(),
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
    };
    [&[0], negative.bytes().as_slice()].concat()
}

#[test]
fn files() {
    seed("files", "dng-strips", &negative(Storage::Strips(5), false, 1));
    seed("files", "dng-jpeg", &negative(Storage::Jpeg(16, 16, 1, 2), true, 1));
    seed("files", "dng-tiles", &negative(Storage::Tiles(16, 16), false, 1));
    seed("files", "dng-linear", &negative(Storage::Jpeg(16, 16, 4, 3), false, 3));
    let rgb: Vec<u8> = (0..24 * 16 * 3).map(|i| (i * 37 % 251) as u8).collect();
    let heic = heifer::encode_rgb8(24, 16, &rgb, &heifer::EncodeOptions::default()).unwrap();
    seed("files", "heic", &[&[0], heic.as_slice()].concat());
    let p3 = ColorProfile::new_display_p3().encode().unwrap();
    let gray = ColorProfile::new_gray_with_gamma(2.2).encode().unwrap();
    seed("files", "display-p3", &[&[1], p3.as_slice()].concat());
    seed("files", "gray", &[&[1], gray.as_slice()].concat());
    let turned = std::fs::read(seeds("photo").join("turned.jpg")).unwrap();
    seed("files", "exif", &[&[0], &turned[1..]].concat());
    let tokens: [&[u8]; 13] = [
        b"iCCP",
        b"cICP",
        b"hvcC",
        b"irot",
        &[0xFF, 0xC3],
        &[0xFF, 0xDA],
        &[0, 0, 1],
        &[1, 0, 0],
        &[0xFF; 4],
        b"Exif\0\0",
        b"curv",
        b"para",
        b"XYZ ",
    ];
    let good = mutate::each(&seeds("files"), rounds(20_000), &tokens, files::run);
    assert!(good > 1000);
}

/// Sessions without photographs, as they are saved now: with `SVBRDF_UPDATE` set.
fn update_session_seeds() {
    use engine::capture::Capture;
    use engine::observation::Falloff;
    use engine::session::{RectifiedFalloff, Scene, Session, Settings};
    let tile = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("examples/captures/tile");
    let board = Capture::load(tile).unwrap().scene;
    let falloff = RectifiedFalloff::Given(Falloff::None { power: [1.0; 3] });
    for (name, scene) in [("board", board), ("rectified", Scene::Rectified { falloff })] {
        let session = Session::new(scene, Settings::default()).unwrap();
        std::fs::write(seeds("session_state").join(name), session.save().unwrap()).unwrap();
    }
}

#[test]
fn session_state() {
    if std::env::var_os("SVBRDF_UPDATE").is_some() {
        update_session_seeds();
    }
    let numbers = [f64::NAN.to_le_bytes(), 1e300_f64.to_le_bytes(), u64::MAX.to_le_bytes()];
    let tokens: Vec<&[u8]> = numbers.iter().map(<[u8; 8]>::as_slice).collect();
    let good = mutate::each(&seeds("session_state"), rounds(300), &tokens, session_state::run);
    assert!(good > 20);
}
