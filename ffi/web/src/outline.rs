//! Where board and sample lie in a photograph, and from where it was taken.

use serde_json::{Value, json};
use svbrdf::calibration::Target;
use svbrdf::geometry::{Camera, Pose};

/// Points along each edge: lenses bend it.
const POINTS: u32 = 6;

/// Outlines in parts of the picture's width and height; the view's angle off the top and azimuth,
/// degrees, and distance, mm.
pub fn place(
    target: &Target,
    sample_mm: [f32; 2],
    camera: &Camera,
    pose: &Pose,
    elevation_mm: f64,
) -> Value {
    let (rows, cols) = (f64::from(target.rows), f64::from(target.cols));
    let board = [(0.0, 0.0), (0.0, cols), (rows, cols), (rows, 0.0)].map(|(row, col)| {
        let at = target.grid_mm(row, col);
        [at.x, at.y, 0.0]
    });
    let [w, h] = sample_mm.map(|v| 0.5 * f64::from(v));
    let sample = [(-w, h), (w, h), (w, -h), (-w, -h)].map(|(x, y)| [x, y, elevation_mm]);
    let centre = pose.camera_centre();
    json!({
        "board": outline(camera, pose, board),
        "sample": outline(camera, pose, sample),
        "off_top_deg": centre.x.hypot(centre.y).atan2(centre.z).to_degrees(),
        "azimuth_deg": centre.y.atan2(centre.x).to_degrees().rem_euclid(360.0),
        "distance_mm": centre.length(),
    })
}

/// The outline of four corners; `None` where a part of it lies behind the camera.
fn outline(camera: &Camera, pose: &Pose, corners: [[f64; 3]; 4]) -> Option<Vec<[f64; 2]>> {
    let mut points = Vec::new();
    for (i, from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % 4];
        for k in 0..POINTS {
            let t = f64::from(k) / f64::from(POINTS);
            let at: [f64; 3] = std::array::from_fn(|c| from[c] + t * (to[c] - from[c]));
            // Pixel positions count from the centre of the first pixel.
            let px = camera.project(pose.transform(at.into()))? + 0.5;
            points.push([px.x / f64::from(camera.width), px.y / f64::from(camera.height)]);
        }
    }
    Some(points)
}
