//! Running the binary and small inputs for it.
#![allow(dead_code)] // each test file uses its part

#[path = "../../../tests/common/picture.rs"]
mod picture;

#[allow(unused_imports)] // as above
pub use picture::{picture, save_png};

use std::path::Path;
use std::process::{Command, Output};

use svbrdf::Svbrdf;

pub fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_svbrdf")).args(arguments).output().unwrap()
}

/// Exit status and standard error.
pub fn failure(arguments: &[&str]) -> (i32, String) {
    let output = run(arguments);
    (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
}

pub fn succeed(arguments: &[&str]) -> String {
    let output = run(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Bumpy maps with stripes of two albedos.
pub fn maps(size: usize) -> Svbrdf {
    let mut maps = Svbrdf::new(size, size);
    for i in 0..size * size {
        let (x, y) = (i % size, i / size);
        maps.normal_slopes_mut()[0][i] = 0.3 * (x as f32 * 0.7).sin();
        maps.normal_slopes_mut()[1][i] = 0.2 * (y as f32 * 0.5).cos();
        maps.diffuse_mut()[0][i] = if x / 4 % 2 == 0 { 0.2 } else { 0.6 };
    }
    maps
}

/// Names in a folder, sorted.
pub fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}
