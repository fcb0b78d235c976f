//! `svbrdf calibrate` on rendered and real photographs.

mod common;
#[path = "../../tests/common/test_data.rs"]
mod test_data;

use std::path::{Path, PathBuf};

use common::{failure, maps, picture, run, save_png, succeed, text};
use serde_json::Value;
use svbrdf::capture::read_camera;
use test_data::test_data;

/// Photos of the default board with a known camera.
fn photos(dir: &Path, count: usize) -> (PathBuf, Vec<PathBuf>) {
    let (source, out) = (dir.join("maps"), dir.join("capture"));
    svbrdf::export::write_maps(&source, &maps(32), &svbrdf::export::MapsOptions::default())
        .unwrap();
    succeed(&["simulate", text(&source), "--out", text(&out), "--frames", &count.to_string()]);
    let files = (0..count).map(|i| out.join(format!("frames/{i:02}.png"))).collect();
    (out, files)
}

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("a number expected, found {v}"))
}

#[test]
fn a_camera_is_found_and_one_bad_photo_does_not_fail_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, files) = photos(dir.path(), 5);
    let small = dir.path().join("small.png");
    let photo = picture(&files[0]);
    save_png(&small, photo.resize(1008, 756, image::imageops::FilterType::Triangle));
    let blank = dir.path().join("blank.png");
    save_png(&blank, image::RgbImage::new(photo.width(), photo.height()));
    let broken = dir.path().join("broken.png");
    std::fs::write(&broken, &std::fs::read(&files[0]).unwrap()[..9999]).unwrap();
    let out = dir.path().join("camera.json");
    let mut arguments = vec!["calibrate", "--board", "ring", "--json", "--out", text(&out)];
    arguments.extend([&small, &blank, &broken].map(|p| text(p)));
    arguments.extend(files.iter().map(|p| text(p)));
    let printed: Value = serde_json::from_str(&succeed(&arguments)).unwrap();
    let written: Value = serde_json::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
    assert_eq!(printed, written);

    let given = std::fs::read_to_string(capture.join("capture.json")).unwrap();
    let given: Value = serde_json::from_str(&given).unwrap();
    assert_eq!((printed["width"].as_u64(), printed["height"].as_u64()), (Some(2016), Some(1512)));
    for key in ["fx", "fy", "cx", "cy"] {
        let (found, truth) = (number(&printed[key]), number(&given["camera"][key]));
        let sigma = number(&printed["uncertainty"][key]);
        // Formal errors of five photos are a fraction of a pixel; the corners' own bias adds as
        // much.
        assert!((found - truth).abs() < 4.0 * sigma + 1.0, "{key}: {found} +- {sigma}, {truth}");
        assert!(sigma > 0.0 && sigma < 5.0, "{key} {sigma}");
    }
    assert_eq!(printed["distortion"].as_array().unwrap().len(), 5);
    assert!(number(&printed["rms_px"]) < 0.2);
    let images = printed["images"].as_array().unwrap();
    let status: Vec<&str> = images.iter().map(|i| i["status"].as_str().unwrap()).collect();
    assert_eq!(status[0], "wrong_size");
    assert_eq!(status[1..3], ["board_not_found", "unreadable"]);
    assert_eq!(status[3..], ["used"; 5]);
    for image in &images[3..] {
        assert!(number(&image["corners"]) > 100.0 && number(&image["rms_px"]) < 0.3, "{image}");
    }
    for image in &images[..3] {
        assert!(!image["reason"].as_str().unwrap().is_empty());
        assert_eq!(number(&image["corners"]), 0.0);
    }
    // The file is a camera for `fit`.
    assert_eq!(read_camera(&out).unwrap().fx, number(&printed["fx"]));
    // People get lines.
    let lines = succeed(&["calibrate", "--board", "ring", text(&files[0]), text(&files[1])]);
    assert!(lines.contains("fx") && lines.contains("used"), "{lines}");
}

#[test]
fn faults_exit_with_2() {
    let dir = tempfile::tempdir().unwrap();
    let blank = dir.path().join("blank.png");
    save_png(&blank, image::RgbImage::new(640, 480));
    let out = dir.path().join("camera.json");
    for (board, says) in [
        ("checkerboard:6x9:25", "board_not_found no board found"),
        ("checkerboard:6x9", "SQUARE_MM"),
        ("checkerboard:6x9:0", "SQUARE_MM"),
        ("checkerboard:6:25", "ROWSxCOLS"),
        ("checkerboard:2x3:25", "20 inner corners"),
        ("dots:6x9:25", "not a kind of board"),
        ("ring:17x17:10", "odd"),
        ("ring:17x16:10:1,2", "whole numbers"),
        ("charuco-ring:17x16:10:3,3,14,13:12", "marker_mm"),
    ] {
        let (status, message) =
            failure(&["calibrate", text(&blank), "--board", board, "--out", text(&out)]);
        assert_eq!(status, 2, "{message}");
        let says = says.strip_prefix("board_not_found ").unwrap_or(says);
        assert!(message.contains(says), "{board}: {message}");
        assert!(!out.exists());
    }
    let (status, message) = failure(&["calibrate", "nowhere.png", "--board", "ring"]);
    assert!(status == 2 && message.contains("nowhere.png"), "{message}");
    assert_eq!(run(&["calibrate", "--board", "ring"]).status.code(), Some(2));
    assert_eq!(run(&["calibrate", text(&blank)]).status.code(), Some(2));
}

#[test]
fn real_photographs_give_the_published_camera() {
    let Some(folder) = test_data("calibration/opencv_stereo") else { return };
    // The set has no tenth.
    let numbers = (1..=14).filter(|i| *i != 10);
    let files: Vec<PathBuf> = numbers.map(|i| folder.join(format!("left{i:02}.jpg"))).collect();
    for board in ["checkerboard:6x9:25", "checkerboard:9x6:25"] {
        let mut arguments = vec!["calibrate", "--json", "--board", board];
        arguments.extend(files.iter().map(|p| text(p)));
        let printed: Value = serde_json::from_str(&succeed(&arguments)).unwrap();
        // left_intrinsics.yml: 535.916, to within 1 %.
        for key in ["fx", "fy"] {
            assert!((number(&printed[key]) / 535.916 - 1.0).abs() < 0.01, "{printed}");
        }
        assert!(number(&printed["rms_px"]) < 0.2);
        assert!(printed["images"].as_array().unwrap().iter().all(|i| i["status"] == "used"));
    }
}

#[test]
fn a_capture_without_camera_and_flash_is_fitted_and_reports_what_it_used() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, _) = photos(dir.path(), 3);
    let file = capture.join("capture.json");
    let given: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let mut value = given.clone();
    value.as_object_mut().unwrap().remove("camera");
    value.as_object_mut().unwrap().remove("flash");
    std::fs::write(&file, value.to_string()).unwrap();
    let out = dir.path().join("out");
    let quick = ["--method", "classic", "--steps", "2", "--quiet"];
    succeed(&[&["fit", text(&capture), "--out", text(&out)][..], &quick].concat());
    let report = std::fs::read_to_string(out.join("report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    let truth = std::fs::read_to_string(capture.join("truth/truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let focal = number(&report["camera"]["fx"]) / number(&given["camera"]["fx"]);
    assert!((focal - 1.0).abs() < 0.005, "{}", report["camera"]);
    assert!(number(&report["camera_uncertainty"]["fx"]) > 0.0);
    let normal = |frame: &Value| [0, 1, 2].map(|i| number(&frame["rotation"][i][2]));
    for (frame, truth) in
        report["frames"].as_array().unwrap().iter().zip(truth["frames"].as_array().unwrap())
    {
        assert_eq!(frame["status"], "accepted");
        let (a, b) = (normal(frame), normal(truth));
        let apart = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt().to_degrees();
        assert!(apart < 0.2, "{frame}");
    }
    for i in 0..3 {
        let off =
            number(&report["flash"]["offset_mm"][i]) - number(&given["flash"]["offset_mm"][i]);
        assert!(off.abs() < 2.0, "{}", report["flash"]);
    }
}
