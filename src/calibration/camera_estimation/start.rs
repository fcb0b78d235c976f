//! Initial cameras.

use super::joint::View;
use super::prior::CameraPrior;
use crate::geometry::{Camera, Homography};
use glam::{DMat3, DVec2};

/// Focal lengths tried besides that of the homographies, relative to the prior mean.
const TRIED: [f64; 3] = [1.0, 0.55, 1.8];
/// Plausible focal lengths, relative to the picture's long side.
const PLAUSIBLE: std::ops::Range<f64> = 0.2..20.0;

/// Initial cameras, at least one.
pub(super) fn cameras(
    views: &[View],
    prior: &CameraPrior,
    earlier: Option<&Camera>,
) -> Vec<Camera> {
    let expected = &prior.camera;
    let mut cameras: Vec<Camera> = earlier
        .filter(|c| c.fault().is_none() && (c.width, c.height) == (expected.width, expected.height))
        .copied()
        .into_iter()
        .collect();
    let middle = DVec2::new(expected.cx, expected.cy);
    let long = f64::from(expected.width.max(expected.height));
    let closed_form = focal(views, middle).filter(|f| PLAUSIBLE.contains(&(f / long)));
    let with = |focal: f64| {
        let aspect = (expected.fy / expected.fx).sqrt();
        Camera { fx: focal / aspect, fy: focal * aspect, ..*expected }
    };
    cameras.extend(closed_form.map(with));
    if earlier.is_none() || closed_form.is_none() {
        let middle = (expected.fx * expected.fy).sqrt();
        cameras.extend(TRIED.map(|t| with(t * middle)));
    }
    cameras
}

/// Focal length for square pixels and a known principal point, by least squares over all homographies: the
/// first two columns of `K⁻¹ H` are orthogonal and of equal length. `None` if all views are fronto-parallel.
fn focal(views: &[View], middle: DVec2) -> Option<f64> {
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for view in views.iter().filter(|v| v.used) {
        let Some(h) = Homography::fit(&view.board, &view.px) else { continue };
        let centred = DMat3::from_translation(-middle) * h.0;
        let (p, q) = (centred.x_axis, centred.y_axis);
        let scale = (p.length_squared() + q.length_squared()).recip();
        // Both rows: a / f² + b = 0.
        let rows = [
            (p.truncate().dot(q.truncate()), p.z * q.z),
            (
                0.5 * (p.truncate().length_squared() - q.truncate().length_squared()),
                0.5 * (p.z * p.z - q.z * q.z),
            ),
        ];
        for (a, b) in rows.map(|(a, b)| (a * scale, b * scale)) {
            ab += a * b;
            aa += a * a;
            bb += b * b;
        }
    }
    if !(aa > 0.0 && bb > 0.0) || ab >= 0.0 {
        return None;
    }
    // The errors are in a, so regress a on b.
    Some((-ab / bb).sqrt()).filter(|f| f.is_finite())
}
