//! Full checkerboards in real photographs (`calibration` of the test data).

#[path = "common/picture.rs"]
mod picture;
#[path = "common/test_data.rs"]
mod test_data;

use picture::picture;
use std::path::{Path, PathBuf};
use svbrdf::calibration::{Detection, Hole, LumaImage, Target, TopLeft, detect, estimate_pose};
use svbrdf::geometry::Camera;
use test_data::test_data;

fn folder(name: &str) -> Option<PathBuf> {
    test_data(&format!("calibration/{name}"))
}

fn photos(folder: &Path, part: &str) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "jpg"))
        .filter(|p| p.file_name().unwrap().to_string_lossy().starts_with(part))
        .collect();
    files.sort();
    files
}

/// Camera files are close to a square-root scale already.
fn luma(path: &Path) -> LumaImage {
    let gray = picture(path).into_luma8();
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    let data = gray.into_raw().into_iter().map(|v| f32::from(v) / 255.0).collect();
    LumaImage { width, height, data }
}

/// A full board of so many squares.
fn full(rows: u32, cols: u32, square_mm: f64, top_left: TopLeft) -> Target {
    let hole = Hole { row_start: 0, col_start: 0, row_end: 0, col_end: 0 };
    Target { rows, cols, square_mm, hole, top_left, ..Target::default() }
}

/// Numbers of corners found, for the photographs in which the board is.
fn counts(files: &[PathBuf], target: &Target) -> Vec<(PathBuf, Detection)> {
    let mut found = Vec::new();
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy();
        match detect(&luma(file), target) {
            Ok(detection) => {
                println!("{name}: {} corners", detection.corners.len());
                found.push((file.clone(), detection));
            }
            Err(reason) => println!("{name}: {reason}"),
        }
    }
    found
}

#[test]
fn boards_of_the_stereo_set_are_found_and_fit_the_published_camera() {
    let Some(folder) = folder("opencv_stereo") else { return };
    let target = full(7, 10, 25.0, TopLeft::Black);
    let left = photos(&folder, "left");
    let found = counts(&left, &target);
    assert_eq!(found.len(), left.len());
    let whole = found.iter().filter(|(_, d)| d.corners.len() == 54).count();
    assert!(whole + 2 >= left.len(), "{whole} whole boards of {}", left.len());
    // left_intrinsics.yml of the set.
    let camera = Camera {
        width: 640,
        height: 480,
        fx: 535.915_733_961_632,
        fy: 535.915_733_961_632,
        cx: 342.283_154_733_08,
        cy: 235.570_829_097_882,
        distortion: [-0.266_372_609, -0.038_588_899, 0.001_783_195, -0.000_281_221, 0.238_391_531],
    };
    for (file, detection) in &found {
        let estimate = estimate_pose(&camera, &target, &detection.corners).unwrap();
        println!("{}: {:.3} px", file.display(), estimate.rms_px);
        // The set's own calibration leaves 0.2 px on average.
        assert!(estimate.rms_px < 0.4);
    }
    assert_eq!(counts(&photos(&folder, "right"), &target).len(), 13);
}

#[test]
fn boards_of_a_wide_action_camera_are_found() {
    let Some(folder) = folder("udacity_gopro/calibration_wide") else { return };
    let files = photos(&folder, "GOPR");
    let black = counts(&files, &full(7, 9, 30.0, TopLeft::Black));
    let white = counts(&files, &full(7, 9, 30.0, TopLeft::White));
    // One photograph shows too little of the board.
    assert!(black.len() + 1 >= files.len(), "{} of {}", black.len(), files.len());
    assert!(black.iter().all(|(_, d)| d.corners.len() >= 46));
    // The other colouring of the same grid must not be taken for it.
    assert!(white.is_empty());
}
