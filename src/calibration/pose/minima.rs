//! Minima of the reprojection error of a plane's points over poses.

use super::super::projection::{Projection, moved};
use crate::geometry::{Camera, Homography, Pose};
use crate::least_squares::{LeastSquares, Options, damped_step, minimise};
use crate::statistics::median;
use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

/// Corners within this many standard deviations, or within this distance, are inliers.
const TRIM_SIGMA: f64 = 3.5;
const TRIM_MIN_PX: f64 = 0.15;

const REFINEMENT: Options = Options {
    max_steps: 50,
    max_trials: 10,
    damping: 1e-4,
    min_damping: 1e-12,
    min_gain: 1e-12,
    descent: true,
};

/// Corners by their positions on the board, mm, and in the picture, px.
pub(super) struct Problem<'a> {
    pub camera: &'a Camera,
    pub board: &'a [DVec3],
    pub px: &'a [DVec2],
}

/// A minimum of the reprojection error.
pub(in super::super) struct Fit {
    pub pose: Pose,
    /// For each corner, whether it is an inlier.
    pub inliers: Vec<bool>,
    /// Sum of squared residuals of the inliers, px².
    pub cost: f64,
    /// Median residual of all corners, px.
    median: f64,
}

/// The one or two poses that nearly explain corners at board positions (mm), refined, the better one first.
pub(in super::super) fn pose_minima(camera: &Camera, board: &[DVec3], px: &[DVec2]) -> Vec<Fit> {
    let problem = Problem { camera, board, px };
    let mut minima: Vec<Fit> = problem.start_poses().into_iter().map(|p| problem.fit(p)).collect();
    minima.retain(|fit| fit.median.is_finite());
    minima.sort_by(|a, b| a.median.total_cmp(&b.median));
    minima
}

impl Fit {
    /// RMS reprojection error of the inliers, px.
    pub fn rms(&self) -> f64 {
        let count = self.inliers.iter().filter(|i| **i).count();
        (self.cost / count as f64).sqrt()
    }
}

impl Problem<'_> {
    /// A pose from the homography, and its mirror image about the line of sight.
    fn start_poses(&self) -> Vec<Pose> {
        let rays: Vec<DVec2> = self.px.iter().map(|p| self.camera.undistort(*p)).collect();
        // A bent sheet is approximately a plane.
        let plane: Vec<DVec2> = self.board.iter().map(|b| b.truncate()).collect();
        let Some(homography) = robust_homography(&plane, &rays) else { return Vec::new() };
        let h = homography.0;
        let scale = 2.0 / (h.x_axis.length() + h.y_axis.length());
        let scale = if h.z_axis.z < 0.0 { -scale } else { scale };
        let (a, b, translation) = (h.x_axis * scale, h.y_axis * scale, h.z_axis * scale);
        // The nearest rotation spreads the two axes symmetrically to a right angle.
        let (sum, difference) = ((a + b).normalize(), (a - b).normalize());
        let difference = (difference - sum * sum.dot(difference)).normalize();
        let (x, y) = (
            (sum + difference) * std::f64::consts::FRAC_1_SQRT_2,
            (sum - difference) * std::f64::consts::FRAC_1_SQRT_2,
        );
        let first = Pose { rotation: DMat3::from_cols(x, y, x.cross(y)), translation };
        let middle = plane.iter().sum::<DVec2>() / plane.len() as f64;
        let centre = first.transform(middle.extend(0.0));
        let sight = centre.normalize();
        let normal = first.rotation.z_axis;
        let mirrored = 2.0 * sight * sight.dot(normal) - normal;
        // Both normals face the camera.
        let turn = DMat3::from_quat(DQuat::from_rotation_arc(normal, mirrored));
        let rotation = turn * first.rotation;
        let second = Pose { rotation, translation: centre - rotation * middle.extend(0.0) };
        [first, second]
            .into_iter()
            .filter(|p| p.rotation.is_finite() && p.translation.is_finite())
            .collect()
    }

    /// Levenberg-Marquardt with rejection of outlying corners.
    fn fit(&self, start: Pose) -> Fit {
        let mut inliers = vec![true; self.px.len()];
        let mut pose = start;
        let mut middle = f64::INFINITY;
        for _ in 0..6 {
            pose = self.refine(pose, &inliers).0;
            let residuals = self.residuals(&pose);
            middle = median(residuals.iter().copied()).unwrap_or(f64::INFINITY);
            // The median length of a two-dimensional normal vector is 1.177 sigma.
            let limit = (TRIM_SIGMA * middle / 1.177).max(TRIM_MIN_PX);
            let next: Vec<bool> = residuals.iter().map(|r| *r <= limit).collect();
            if next == inliers {
                break;
            }
            inliers = next;
        }
        let (pose, cost) = self.refine(pose, &inliers);
        Fit { pose, inliers, cost, median: middle }
    }

    /// The minimum near a pose, and its cost.
    fn refine(&self, pose: Pose, inliers: &[bool]) -> (Pose, f64) {
        let (pose, summary) = minimise(&Trimmed { problem: self, inliers }, pose, &REFINEMENT);
        (pose, summary.cost)
    }

    fn residuals(&self, pose: &Pose) -> Vec<f64> {
        let residual = |(b, p): (&DVec3, &DVec2)| {
            let projected = self.camera.project(pose.transform(*b));
            projected.map_or(f64::INFINITY, |q| q.distance(*p))
        };
        self.board.iter().zip(self.px).map(residual).collect()
    }

    /// Sum of squared residuals of the inliers, px².
    pub fn cost(&self, pose: &Pose, inliers: &[bool]) -> f64 {
        let used = self.residuals(pose).into_iter().zip(inliers).filter(|(_, i)| **i);
        used.map(|(r, _)| r * r).sum()
    }

    /// Matrix and gradient for a small rotation in camera axes (radians) and a translation (mm).
    pub fn normal_equations(
        &self,
        pose: &Pose,
        inliers: &[bool],
    ) -> (SMatrix<f64, 6, 6>, SVector<f64, 6>) {
        let mut normal = SMatrix::zeros();
        let mut gradient = SVector::zeros();
        for ((b, p), _) in self.board.iter().zip(self.px).zip(inliers).filter(|(_, i)| **i) {
            let Some(projection) = Projection::of(self.camera, pose, *b) else { continue };
            let error = projection.px - *p;
            for (row, e) in projection.by_pose.iter().zip([error.x, error.y]) {
                let row = SVector::<f64, 6>::from(*row);
                normal += row * row.transpose();
                gradient += row * e;
            }
        }
        (normal, gradient)
    }
}

/// The problem for the inliers only.
struct Trimmed<'a> {
    problem: &'a Problem<'a>,
    inliers: &'a [bool],
}

impl LeastSquares for Trimmed<'_> {
    type State = Pose;
    type Equations = (SMatrix<f64, 6, 6>, SVector<f64, 6>);

    fn cost(&self, pose: &Pose) -> f64 {
        self.problem.cost(pose, self.inliers)
    }

    fn linearise(&self, pose: &Pose) -> Self::Equations {
        self.problem.normal_equations(pose, self.inliers)
    }

    fn step(
        &self,
        pose: &Pose,
        (normal, gradient): &Self::Equations,
        damping: f64,
    ) -> Option<Pose> {
        Some(moved(pose, &damped_step(normal, gradient, damping)?.into()))
    }
}

/// Homography by repeated fits to the best three quarters of the points.
fn robust_homography(board: &[DVec2], rays: &[DVec2]) -> Option<Homography> {
    let mut homography = Homography::fit(board, rays)?;
    for _ in 0..4 {
        let mut order: Vec<(f64, usize)> = (0..board.len())
            .map(|i| (homography.apply(board[i]).distance(rays[i]), i))
            .filter(|r| r.0.is_finite())
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.truncate((3 * board.len()).div_ceil(4));
        let kept = |all: &[DVec2]| order.iter().map(|&(_, i)| all[i]).collect::<Vec<_>>();
        homography = Homography::fit(&kept(board), &kept(rays)).unwrap_or(homography);
    }
    Some(homography)
}
