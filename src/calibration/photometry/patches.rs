//! Values of the gray patches below the ring in one photograph.

use glam::DVec2;

use crate::calibration::{Patch, Target};
use crate::geometry::{Camera, Pose};
use crate::photo::Photo;

/// A patch over the next brighter one: at most this, whatever tone curve is on.
const PATCH_STEP: f64 = 0.8;

/// Mean stored values of the black, the gray and the white patch in linear light; `None` where they
/// are not seen: out of view, covered, clipped, or the board was printed without them.
pub(super) fn patch_values(
    photo: &Photo,
    target: &Target,
    camera: &Camera,
    pose: &Pose,
) -> Option<[[f64; 3]; 3]> {
    let patches = target.patches.then(|| target.patches())?;
    let values = patches.map(|patch| patch_value(photo, camera, pose, &patch));
    let values = [values[0]?, values[1]?, values[2]?];
    let sums = values.map(|value| sum(&value));
    (sums[0] < PATCH_STEP * sums[1] && sums[1] < PATCH_STEP * sums[2]).then_some(values)
}

fn sum(value: &[f64; 3]) -> f64 {
    value.iter().sum()
}

/// Mean linear value of each channel over the inner half of a patch; `None` outside the photograph
/// or clipped.
pub(super) fn patch_value(
    photo: &Photo,
    camera: &Camera,
    pose: &Pose,
    patch: &Patch,
) -> Option<[f64; 3]> {
    const ACROSS: i32 = 9;
    let mut sum = [0.0; 3];
    for i in 0..ACROSS * ACROSS {
        let offset = DVec2::new(f64::from(i % ACROSS), f64::from(i / ACROSS)) - 4.0;
        let p = patch.centre_mm + offset * (0.5 * patch.side_mm / f64::from(ACROSS));
        let px = camera.project(pose.transform(p.extend(0.0)))?.round();
        let inside = px.cmpge(DVec2::ZERO).all()
            && px.x < f64::from(photo.width())
            && px.y < f64::from(photo.height());
        let (x, y) = (px.x as u32, px.y as u32);
        if !inside || photo.is_clipped(x, y) {
            return None;
        }
        let pixel = photo.pixel(x, y);
        (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
    }
    Some(sum.map(|v| v / f64::from(ACROSS * ACROSS)))
}
