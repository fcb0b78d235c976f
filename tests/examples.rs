//! Each example runs, on the capture of the repository.
#![cfg(feature = "embedded-models")]

#[allow(dead_code)] // `main`
#[path = "../examples/export_in_memory.rs"]
mod export_in_memory;
#[allow(dead_code)]
#[path = "../examples/live_loop.rs"]
mod live_loop;
#[allow(dead_code)]
#[path = "../examples/rectified.rs"]
mod rectified;
#[allow(dead_code)]
#[path = "../examples/uncertainty.rs"]
mod uncertainty;

const CAPTURE: &str = "examples/captures/tile";

#[test]
fn the_live_loop_uses_the_photographs() {
    assert_eq!(live_loop::run(CAPTURE, 2).unwrap(), 2);
}

#[test]
fn photographs_are_added_until_the_roughness_is_known() {
    let deviations = uncertainty::run(CAPTURE, 3, 1.0).unwrap();
    assert!(deviations.len() == 1 && (0.01..0.5).contains(&deviations[0]), "{deviations:?}");
    assert_eq!(uncertainty::run(CAPTURE, 2, 0.0).unwrap().len(), 2);
}

#[test]
fn maps_become_files_in_memory() {
    let files = export_in_memory::run("examples/captures/tile/truth").unwrap();
    let file = |name: &str| files.iter().find(|(n, _)| n == name).map(|(_, bytes)| &bytes[..4]);
    assert_eq!(file("material.glb"), Some(&b"glTF"[..]));
    assert_eq!(file("normal.png"), Some(&b"\x89PNG"[..]));
    assert!(file("unreal/orm.png").is_some());
}

#[test]
fn rectified_photographs_determine_the_albedo() {
    // A uniform albedo would be off by 0.125.
    let error = rectified::run().unwrap();
    assert!(error < 0.05, "{error}");
}
