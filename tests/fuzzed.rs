//! A short run of the fuzz targets on stable Rust: the committed seeds and changes of them, the
//! same every time. `SVBRDF_FUZZ_ROUNDS` multiplies their number.

// The targets know the library by this name.
extern crate svbrdf as engine;

#[path = "../fuzz/shared/capture_json.rs"]
mod capture_json;
#[path = "../fuzz/shared/mutate.rs"]
mod mutate;
#[path = "../fuzz/shared/photo.rs"]
mod photo;
#[path = "../fuzz/shared/session_state.rs"]
mod session_state;

use std::path::PathBuf;

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
    let good = mutate::each(&seeds("session_state"), rounds(3000), &tokens, session_state::run);
    assert!(good > 100);
}
