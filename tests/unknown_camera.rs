//! Rendered captures with camera and flash withheld (`captures/dev` of the test data).

#[path = "common/test_data.rs"]
mod test_data;

use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::Value;
use svbrdf::capture::Capture;
use svbrdf::geometry::Pose;
use svbrdf::session::{Method, Outcome, Session, Settings};
use test_data::test_data;

/// Largest error of a view's direction once all photographs are in, degrees.
const VIEW_DEG_MAX: f64 = 0.2;
const FLASH_MM_MAX: f64 = 2.0;
const AMBIENT_MAX: f64 = 0.02;

fn read_json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn vector(v: &Value) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|i| v[i].as_f64().unwrap()))
}

fn pose(frame: &Value) -> Pose {
    let rows: [DVec3; 3] = std::array::from_fn(|i| vector(&frame["R"][i]));
    Pose {
        rotation: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(),
        translation: vector(&frame["t"]),
    }
}

fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// The capture's description without camera and flash.
fn stripped(folder: &Path) -> tempfile::TempDir {
    let mut value = read_json(&folder.join("capture.json"));
    let object = value.as_object_mut().unwrap();
    object.remove("camera").unwrap();
    object.remove("flash").unwrap();
    for frame in object["frames"].as_array_mut().unwrap() {
        frame["image"] = folder.join(frame["image"].as_str().unwrap()).to_str().unwrap().into();
    }
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("capture.json"), value.to_string()).unwrap();
    dir
}

#[test]
fn camera_flash_and_ambient_come_from_the_photographs() {
    let Some(root) = test_data("captures/dev") else { return };
    let mut folders: Vec<_> = std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path()).collect();
    folders.sort();
    println!(
        "{:24} {:>6} {:>9} {:>9} {:>8} {:>9} {:>9} {:>9}",
        "capture", "photos", "view deg", "normal", "focal %", "flash mm", "ambient", "push s"
    );
    let mut faults = Vec::new();
    for folder in folders {
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let given = read_json(&folder.join("capture.json"));
        let truth = read_json(&folder.join("truth/truth.json"));
        let dir = stripped(&folder);
        let capture = Capture::load(dir.path()).unwrap();
        let settings = Settings {
            sample_mm: capture.sample_mm,
            method: Method::Classic,
            ..Settings::default()
        };
        let session = Session::new(capture.scene.clone(), settings).unwrap();
        // Calibration alone: the fit waits.
        session.pause();
        let mut last = [0.0; 3];
        for (index, file) in capture.photos.iter().enumerate() {
            let photo = file.read().unwrap();
            let begun = std::time::Instant::now();
            let Outcome::Accepted(_) = session.add_photo(&photo).unwrap() else {
                panic!("{name}/{index} was rejected")
            };
            let seconds = begun.elapsed().as_secs_f64();
            assert!(session.snapshot().is_ok());
            let poses = session.poses();
            assert_eq!(poses.len(), index + 1);
            let (mut view, mut normal) = (0.0f64, 0.0f64);
            for (known, frame) in poses.iter().zip(truth["frames"].as_array().unwrap()) {
                let truth = pose(frame);
                // Where the camera stands above the sample, and where the sample's normal points
                // in the camera's frame.
                let known = known.pose;
                view = view.max(angle_deg(known.camera_centre(), truth.camera_centre()));
                normal = normal.max(angle_deg(known.rotation.z_axis, truth.rotation.z_axis));
            }
            let camera = session.camera().unwrap();
            let focal = 100.0 * (camera.fx / given["camera"]["fx"].as_f64().unwrap() - 1.0);
            let offset = vector(&truth["flash"]["offset_camera_mm"]);
            let flash = session.flash_offset_mm().distance(offset);
            let ambient = f64::from(session.ambient_fraction())
                - truth["ambient"]["fraction"].as_f64().unwrap();
            println!(
                "{name:24} {:6} {view:9.4} {normal:9.4} {focal:8.3} {flash:9.2} {ambient:9.4} {seconds:9.2}",
                index + 1
            );
            last = [view.max(normal), flash, ambient.abs()];
        }
        println!("  focal sigma {:.2} px", session.camera_sigma().unwrap()[0]);
        // These prints are as planned.
        let paper = session.paper().unwrap();
        println!("  {paper:?}");
        assert!((paper.paper.aspect - 1.0).abs() < 1e-3);
        assert!(paper.paper.bow_mm.iter().all(|b| b.abs() < 0.1));
        if last[0] > VIEW_DEG_MAX || last[1] > FLASH_MM_MAX || last[2] > AMBIENT_MAX {
            faults.push((name, last));
        }
    }
    assert!(faults.is_empty(), "{faults:?}");
}
