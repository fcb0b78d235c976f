//! Reads the rendered captures of the test data with their true poses.
#![allow(dead_code)] // each test file uses its part

#[path = "picture.rs"]
mod picture;
#[path = "test_data.rs"]
mod test_data;

#[allow(unused_imports)] // as above
pub use picture::picture;
#[allow(unused_imports)]
pub use test_data::test_data;

use glam::{DMat3, DVec3};
use std::path::{Path, PathBuf};
use svbrdf::calibration::{Hole, Target, TargetKind, TopLeft};
use svbrdf::geometry::{Camera, Pose};
use svbrdf::photo::Photo;

/// A folder of photographs.
pub struct Capture {
    pub name: String,
    pub target: Target,
    pub camera: Camera,
    pub photos: Vec<TruePhoto>,
}

/// A photograph not read yet, and its true pose.
pub struct TruePhoto {
    image: PathBuf,
    encoding: String,
    pub pose: Pose,
}

impl TruePhoto {
    pub fn photo(&self) -> Photo {
        photo(&self.image, &self.encoding)
    }
}

/// All captures, or `None` without test data.
pub fn all() -> Option<Vec<Capture>> {
    let root = test_data("captures/dev")?;
    let mut folders: Vec<PathBuf> =
        std::fs::read_dir(&root).unwrap().map(|e| e.unwrap().path()).collect();
    folders.sort();
    Some(folders.iter().map(|f| read(f)).collect())
}

fn read(folder: &Path) -> Capture {
    let capture = read_json(&folder.join("capture.json"));
    let truth = read_json(&folder.join("truth/truth.json"));
    let frames = capture["frames"].as_array().unwrap().iter().enumerate();
    Capture {
        name: folder.file_name().unwrap().to_string_lossy().into_owned(),
        target: target_of(&capture["board"]),
        camera: serde_json::from_value(capture["camera"].clone()).unwrap(),
        photos: frames
            .map(|(index, frame)| TruePhoto {
                image: folder.join(frame["image"].as_str().unwrap()),
                encoding: frame["encoding"].as_str().unwrap().to_owned(),
                pose: pose_of(&truth["frames"][index]),
            })
            .collect(),
    }
}

fn read_json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn target_of(board: &serde_json::Value) -> Target {
    let count = |v: &serde_json::Value| v.as_u64().unwrap() as u32;
    let hole = &board["hole_squares"];
    Target {
        kind: match board["kind"].as_str().unwrap() {
            "checkerboard-ring" => TargetKind::CheckerboardRing,
            _ => TargetKind::CharucoRing {
                dictionary: board["dictionary"].as_str().unwrap().to_owned(),
                marker_mm: board["marker_mm"].as_f64().unwrap(),
            },
        },
        rows: count(&board["rows"]),
        cols: count(&board["cols"]),
        square_mm: board["square_mm"].as_f64().unwrap(),
        hole: Hole {
            row_start: count(&hole[0]),
            col_start: count(&hole[1]),
            row_end: count(&hole[2]),
            col_end: count(&hole[3]),
        },
        white_albedo: board["white_albedo"].as_f64().unwrap(),
        black_albedo: board["black_albedo"].as_f64().unwrap(),
        top_left: match board["top_left"].as_str().unwrap() {
            "black" => TopLeft::Black,
            _ => TopLeft::White,
        },
        patches: false,
    }
}

fn photo(path: &Path, encoding: &str) -> Photo {
    let image = picture(path);
    let (width, height) = (image.width(), image.height());
    let rgb: Vec<f32> = match encoding {
        "srgb" => {
            let curve: Vec<f32> = (0..256)
                .map(|i| match i as f32 / 255.0 {
                    v if v <= 0.04045 => v / 12.92,
                    v => ((v + 0.055) / 1.055).powf(2.4),
                })
                .collect();
            image.into_rgb8().into_raw().into_iter().map(|v| curve[usize::from(v)]).collect()
        }
        _ => image.into_rgb16().into_raw().into_iter().map(|v| f32::from(v) / 65535.0).collect(),
    };
    Photo::from_linear(width, height, rgb, 1.0, 1.0).unwrap()
}

fn pose_of(frame: &serde_json::Value) -> Pose {
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let vector = |v: &serde_json::Value| DVec3::new(number(&v[0]), number(&v[1]), number(&v[2]));
    let rows = &frame["R"];
    Pose {
        rotation: DMat3::from_cols(vector(&rows[0]), vector(&rows[1]), vector(&rows[2]))
            .transpose(),
        translation: vector(&frame["t"]),
    }
}

/// Angle between two poses' rotations.
pub fn angle_deg(a: &Pose, b: &Pose) -> f64 {
    let turn = a.rotation * b.rotation.transpose();
    let cosine = 0.5 * (turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0);
    cosine.clamp(-1.0, 1.0).acos().to_degrees()
}
