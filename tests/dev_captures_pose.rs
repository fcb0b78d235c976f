//! Detector and pose on rendered photographs with known poses (`captures/dev` of the test data).

#[path = "common/captures.rs"]
mod captures;

use captures::{Capture, angle_deg};
use std::time::Instant;
use svbrdf::calibration::{LumaImage, detect, estimate_pose};

/// Accuracy of a pose for accurate maps: 0.15 degrees bend a normal by less than the print's flatness does, and half a
/// millimetre at 250 mm changes the flash's strength by 0.4 %.
const DEGREES_MAX: f64 = 0.15;
const CENTRE_MM_MAX: f64 = 0.5;
const RMS_PX_MAX: f64 = 0.35;

#[test]
fn every_photograph_is_accepted_with_the_right_pose() {
    let Some(all) = captures::all() else { return };
    println!(
        "{:28} {:>9} {:>6} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7} {:>7}",
        "photo", "corners", "tilt", "deg", "mm", "rms px", "true px", "blur", "luma ms", "ms"
    );
    let mut faults = Vec::new();
    for Capture { name, target, camera, photos } in all {
        let in_view = target.corners().len();
        for (index, shot) in photos.iter().enumerate() {
            let photo = shot.photo();
            let name = format!("{name}/{index}");
            let start = Instant::now();
            let luma = LumaImage::from_photo(&photo);
            let luma_ms = 1e3 * start.elapsed().as_secs_f64();
            let start = Instant::now();
            let found = detect(&luma, &target)
                .and_then(|d| Ok((estimate_pose(&camera, &target, &d.corners)?, d)));
            let ms = 1e3 * start.elapsed().as_secs_f64();
            let (estimate, detection) = match found {
                Ok(found) => found,
                Err(reason) => {
                    println!("{name:28} {reason} {luma_ms:7.1} {ms:7.1}");
                    faults.push(name);
                    continue;
                }
            };
            let true_pose = shot.pose;
            let degrees = angle_deg(&estimate.pose, &true_pose);
            let mm = (estimate.pose.camera_centre() - true_pose.camera_centre()).length();
            let squares = detection.corners.iter().map(|c| {
                let p = target.grid_mm(c.row.into(), c.col.into()).extend(0.0);
                camera.project(true_pose.transform(p)).unwrap().distance_squared(c.px)
            });
            let true_rms = (squares.sum::<f64>() / detection.corners.len() as f64).sqrt();
            println!(
                "{name:28} {:>4}/{in_view:<4} {:6.1} {degrees:8.4} {mm:8.4} {:8.4} {true_rms:8.4} {:7.2} {luma_ms:7.1} {ms:7.1}",
                detection.corners.len(),
                true_pose.view_angle().to_degrees(),
                estimate.rms_px,
                detection.blur_px,
            );
            if degrees > DEGREES_MAX || mm > CENTRE_MM_MAX || estimate.rms_px > RMS_PX_MAX {
                faults.push(name);
            }
        }
    }
    assert!(faults.is_empty(), "{faults:?}");
}
