//! Where board and sample lie in a photograph, and from where it was taken.

use glam::{DMat3, DVec2, DVec3};
use serde_json::{Value, json};
use svbrdf::geometry::Pose;
use svbrdf::session::Scene;

use super::subject::Subject;

/// Points along each edge: lenses bend it.
const POINTS: u32 = 6;

/// Pose of a row of `report.json`.
fn pose(row: &Value) -> Option<Pose> {
    let rows: [[f64; 3]; 3] = serde_json::from_value(row["rotation"].clone()).ok()?;
    let translation: [f64; 3] = serde_json::from_value(row["translation_mm"].clone()).ok()?;
    let rotation = DMat3::from_cols_array_2d(&rows).transpose();
    Some(Pose { rotation, translation: DVec3::from_array(translation) })
}

/// Camera position in spherical coordinates: angle off the top and azimuth counter-clockwise from
/// the sample's +X, degrees; distance, mm.
pub fn view(subject: &Subject, row: &Value) -> Option<Value> {
    let index = row["index"].as_u64()? as usize;
    let centre = match subject.photos[index].rectified {
        Some(view) if row["status"] == "accepted" => {
            DVec3::from_array(view.camera_mm.map(f64::from))
        }
        _ => pose(row)?.camera_centre(),
    };
    Some(json!({
        "off_top_deg": centre.truncate().length().atan2(centre.z).to_degrees(),
        "azimuth_deg": centre.y.atan2(centre.x).to_degrees().rem_euclid(360.0),
        "distance_mm": centre.length(),
    }))
}

/// Outlines of board and sample in parts of the photograph's width and height.
pub fn outlines(subject: &Subject, row: &Value) -> Option<Value> {
    let Scene::Board { target, .. } = &subject.capture.scene else { return None };
    let (camera, pose) = (subject.camera?, pose(row)?);
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let polygon = |corners: [DVec3; 4]| -> Option<Vec<[f64; 2]>> {
        let mut points = Vec::new();
        for (i, from) in corners.iter().enumerate() {
            for k in 0..POINTS {
                let p = from.lerp(corners[(i + 1) % 4], f64::from(k) / f64::from(POINTS));
                // Pixel positions count from the centre of the first pixel.
                let px = (camera.project(pose.transform(p))? + 0.5) / size;
                points.push(px.to_array());
            }
        }
        Some(points)
    };
    let (rows, cols) = (f64::from(target.rows), f64::from(target.cols));
    let board = [(0.0, 0.0), (0.0, cols), (rows, cols), (rows, 0.0)]
        .map(|(row, col)| target.grid_mm(row, col).extend(0.0));
    let [w, h] = subject.capture.sample_mm.map(|v| 0.5 * f64::from(v));
    let z = subject.report["elevation"]["mm"].as_f64().unwrap_or(0.0);
    let sample = [(-w, h), (w, h), (w, -h), (-w, -h)].map(|(x, y)| DVec3::new(x, y, z));
    Some(json!({ "board": polygon(board), "sample": polygon(sample) }))
}
