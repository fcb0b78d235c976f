//! Projection with its derivatives by pose and by intrinsics.

use crate::geometry::{Camera, Pose};
use glam::{DMat3, DVec2, DVec3};

/// A projected point with the derivatives of its pixel (x, then y): rows of the Jacobian for
/// refinement of pose and camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// The pixel.
    pub px: DVec2,
    /// By the pose: rotation vector of a small rotation after that of the pose (camera axes), then
    /// translation in mm.
    pub by_pose: [[f64; 6]; 2],
    /// By fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub by_intrinsics: [[f64; 9]; 2],
}

impl Projection {
    /// Projects a board point, mm; `None` behind the camera and beyond the fold of the distortion,
    /// as [`Camera::project`].
    pub fn of(camera: &Camera, pose: &Pose, board: DVec3) -> Option<Self> {
        let turned = pose.rotation * board;
        let point = turned + pose.translation;
        let px = camera.project(point)?;
        let [k1, k2, p1, p2, k3] = camera.distortion;
        let inverse = point.z.recip();
        let (x, y) = (point.x * inverse, point.y * inverse);
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let radial = 1.0 + k1 * r2 + k2 * r4 + k3 * r6;
        let slope = k1 + 2.0 * k2 * r2 + 3.0 * k3 * r4;
        let distorted = camera.distort(DVec2::new(x, y));
        let dxx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x;
        let dxy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let dyy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x;
        let by_point = [
            DVec3::new(dxx, dxy, -(dxx * x + dxy * y)) * (camera.fx * inverse),
            DVec3::new(dxy, dyy, -(dxy * x + dyy * y)) * (camera.fy * inverse),
        ];
        // d(w x turned) / dw: the row vector g becomes turned x g.
        let by_pose = by_point.map(|g| {
            let w = turned.cross(g);
            [w.x, w.y, w.z, g.x, g.y, g.z]
        });
        let (fx, fy) = (camera.fx, camera.fy);
        let by_intrinsics = [
            [
                distorted.x,
                0.0,
                1.0,
                0.0,
                fx * x * r2,
                fx * x * r4,
                fx * 2.0 * x * y,
                fx * (r2 + 2.0 * x * x),
                fx * x * r6,
            ],
            [
                0.0,
                distorted.y,
                0.0,
                1.0,
                fy * y * r2,
                fy * y * r4,
                fy * (r2 + 2.0 * y * y),
                fy * 2.0 * x * y,
                fy * y * r6,
            ],
        ];
        Some(Self { px, by_pose, by_intrinsics })
    }
}

/// The pose after a small step, in the parameters of [`Projection::by_pose`].
pub(super) fn moved(pose: &Pose, step: &[f64; 6]) -> Pose {
    let turn = DVec3::new(step[0], step[1], step[2]);
    let angle = turn.length();
    let rotation = if angle > 0.0 {
        DMat3::from_axis_angle(turn / angle, angle) * pose.rotation
    } else {
        pose.rotation
    };
    Pose { rotation, translation: pose.translation + DVec3::new(step[3], step[4], step[5]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let camera = Camera {
            width: 2016,
            height: 1512,
            fx: 1450.0,
            fy: 1460.0,
            cx: 1000.0,
            cy: 760.0,
            distortion: [0.05, -0.08, 0.002, -0.003, 0.02],
        };
        let pose = Pose {
            rotation: DMat3::from_axis_angle(DVec3::new(1.0, 0.2, -0.1).normalize(), 2.8),
            translation: DVec3::new(5.0, -8.0, 250.0),
        };
        let perturbed = |i: usize, h: f64| {
            let mut c = camera;
            match i {
                0 => c.fx += h,
                1 => c.fy += h,
                2 => c.cx += h,
                3 => c.cy += h,
                _ => c.distortion[i - 4] += h,
            }
            c
        };
        for board in [DVec3::new(70.0, -40.0, 0.0), DVec3::new(-20.0, 80.0, 3.0)] {
            let p = Projection::of(&camera, &pose, board).unwrap();
            assert_eq!(p.px, camera.project(pose.transform(board)).unwrap());
            let h = 1e-6;
            for i in 0..6 {
                let at = |h: f64| {
                    let mut step = [0.0; 6];
                    step[i] = h;
                    camera.project(moved(&pose, &step).transform(board)).unwrap()
                };
                let slope = (at(h) - at(-h)) / (2.0 * h);
                // Tolerance: rounding of pixels around 1e3 over 2e-6 gives 1e-7; slopes reach 2e3.
                let tolerance = 1e-6 * (1.0 + slope.length());
                assert!((slope.x - p.by_pose[0][i]).abs() < tolerance, "pose {i}");
                assert!((slope.y - p.by_pose[1][i]).abs() < tolerance, "pose {i}");
            }
            for i in 0..9 {
                let at = |h: f64| perturbed(i, h).project(pose.transform(board)).unwrap();
                let slope = (at(h) - at(-h)) / (2.0 * h);
                let tolerance = 1e-6 * (1.0 + slope.length());
                assert!((slope.x - p.by_intrinsics[0][i]).abs() < tolerance, "intrinsic {i}");
                assert!((slope.y - p.by_intrinsics[1][i]).abs() < tolerance, "intrinsic {i}");
            }
        }
    }
}
