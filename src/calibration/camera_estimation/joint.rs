//! Levenberg-Marquardt over intrinsics and all poses.
//!
//! Poses enter only their own view's equations: the normal matrix is an arrow, and each step solves
//! the 9 x 9 Schur complement of the intrinsics, so that the cost grows linearly with views.

use super::super::projection::{Projection, moved};
use super::prior::CameraPrior;
use crate::geometry::{Camera, Pose};
use glam::DVec2;
use nalgebra::{Const, SMatrix, SVector};

/// fx, fy, cx, cy, k1, k2, p1, p2, k3.
pub(super) const INTRINSICS: usize = 9;
pub(super) type Intrinsics = SVector<f64, INTRINSICS>;
type Square = SMatrix<f64, INTRINSICS, INTRINSICS>;

const ITERATIONS: usize = 100;

/// Corners of one photograph.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// Positions on the board, mm.
    pub board: Vec<DVec2>,
    /// Where they were found, px.
    pub px: Vec<DVec2>,
    /// Whether they take part.
    pub inliers: Vec<bool>,
    /// Whether the photograph takes part.
    pub used: bool,
}

impl View {
    /// Distance of each corner from its projection, px; infinite where it does not project.
    pub fn residuals(&self, camera: &Camera, pose: &Pose) -> Vec<f64> {
        let residual = |(b, p): (&DVec2, &DVec2)| {
            let projected = camera.project(pose.transform(b.extend(0.0)));
            projected.map_or(f64::INFINITY, |q| q.distance(*p))
        };
        self.board.iter().zip(&self.px).map(residual).collect()
    }

    /// Sum of squared distances of the corners that take part.
    pub fn cost(&self, camera: &Camera, pose: &Pose) -> f64 {
        let residuals = self.residuals(camera, pose).into_iter().zip(&self.inliers);
        residuals.filter(|(_, inlier)| **inlier).map(|(r, _)| r * r).sum()
    }

    pub fn inlier_count(&self) -> usize {
        self.inliers.iter().filter(|i| **i).count()
    }
}

/// A camera and a pose for each view.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub camera: Camera,
    pub poses: Vec<Pose>,
}

/// The equations of one view, its pose eliminated from those of the intrinsics.
struct Block {
    pose: SMatrix<f64, 6, 6>,
    mixed: SMatrix<f64, INTRINSICS, 6>,
    gradient: SVector<f64, 6>,
}

/// Normal equations of the whole problem.
struct Equations {
    intrinsics: Square,
    gradient: Intrinsics,
    blocks: Vec<Option<Block>>,
}

/// The least-squares problem.
pub(super) struct Problem<'a> {
    pub prior: &'a CameraPrior,
    pub views: &'a [View],
    /// Standard deviation of a corner's coordinate that the prior is weighed against, px.
    pub noise_px: f64,
}

impl Problem<'_> {
    /// Squared residuals, px², with the prior's in units of the noise.
    pub fn cost(&self, state: &State) -> f64 {
        let prior: f64 = self.prior.terms(&state.camera).map(|(d, _)| d * d).sum();
        let corners: f64 = self
            .views
            .iter()
            .zip(&state.poses)
            .filter(|(view, _)| view.used)
            .map(|(view, pose)| view.cost(&state.camera, pose))
            .sum();
        corners + self.noise_px * self.noise_px * prior
    }

    /// The nearest minimum.
    pub fn minimise(&self, mut state: State) -> State {
        let mut cost = self.cost(&state);
        let mut damping = 1e-4;
        for _ in 0..ITERATIONS {
            let equations = self.equations(&state);
            let mut gain = 0.0;
            for _ in 0..12 {
                if let Some(next) = self.step(&state, &equations, damping) {
                    let next_cost = self.cost(&next);
                    if next_cost < cost {
                        gain = cost - next_cost;
                        (state, cost) = (next, next_cost);
                        damping = (0.1 * damping).max(1e-14);
                        break;
                    }
                }
                damping *= 8.0;
            }
            if gain <= 1e-13 * cost {
                break;
            }
        }
        state
    }

    /// Covariance of the intrinsics for corners of the assumed noise, poses marginalised; zero for
    /// those that are fixed. `None` where they are not determined.
    pub fn covariance(&self, state: &State) -> Option<Square> {
        let (schur, _, _) = self.equations(state).eliminated(0.0)?;
        let mut inverse = schur.cholesky()?.inverse();
        for (i, free) in self.prior.free().into_iter().enumerate() {
            if !free {
                inverse.row_mut(i).fill(0.0);
                inverse.column_mut(i).fill(0.0);
            }
        }
        Some(inverse * (self.noise_px * self.noise_px))
    }

    fn equations(&self, state: &State) -> Equations {
        let mut intrinsics = Square::zeros();
        let mut gradient = Intrinsics::zeros();
        let weight = self.noise_px * self.noise_px;
        for (deviation, row) in self.prior.terms(&state.camera) {
            intrinsics += row * row.transpose() * weight;
            gradient += row * (deviation * weight);
        }
        let mut blocks = Vec::with_capacity(self.views.len());
        for (view, pose) in self.views.iter().zip(&state.poses) {
            if !view.used {
                blocks.push(None);
                continue;
            }
            let mut block = Block {
                pose: SMatrix::zeros(),
                mixed: SMatrix::zeros(),
                gradient: SVector::zeros(),
            };
            let corners = view.board.iter().zip(&view.px).zip(&view.inliers);
            for ((board, px), _) in corners.filter(|(_, inlier)| **inlier) {
                let Some(p) = Projection::of(&state.camera, pose, board.extend(0.0)) else {
                    continue;
                };
                let error = p.px - *px;
                for (k, e) in [error.x, error.y].into_iter().enumerate() {
                    let by_camera = Intrinsics::from(p.by_intrinsics[k]);
                    let by_pose = SVector::<f64, 6>::from(p.by_pose[k]);
                    intrinsics += by_camera * by_camera.transpose();
                    gradient += by_camera * e;
                    block.pose += by_pose * by_pose.transpose();
                    block.mixed += by_camera * by_pose.transpose();
                    block.gradient += by_pose * e;
                }
            }
            blocks.push(Some(block));
        }
        for (i, free) in self.prior.free().into_iter().enumerate() {
            if !free {
                intrinsics.row_mut(i).fill(0.0);
                intrinsics.column_mut(i).fill(0.0);
                intrinsics[(i, i)] = 1.0;
                gradient[i] = 0.0;
                for block in blocks.iter_mut().flatten() {
                    block.mixed.row_mut(i).fill(0.0);
                }
            }
        }
        Equations { intrinsics, gradient, blocks }
    }

    fn step(&self, state: &State, equations: &Equations, damping: f64) -> Option<State> {
        let (schur, right, factors) = equations.eliminated(damping)?;
        let delta = -schur.cholesky()?.solve(&right);
        let camera = stepped(&state.camera, &delta);
        if camera.fault().is_some() {
            return None;
        }
        let mut poses = state.poses.clone();
        for ((pose, block), factor) in poses.iter_mut().zip(&equations.blocks).zip(&factors) {
            if let (Some(block), Some(factor)) = (block, factor) {
                let right = block.gradient + block.mixed.transpose() * delta;
                *pose = moved(pose, &(-factor.solve(&right)).into());
            }
        }
        Some(State { camera, poses })
    }
}

type PoseFactor = nalgebra::Cholesky<f64, Const<6>>;

impl Equations {
    /// Matrix and right side for the intrinsics alone, and the factors of the poses' blocks.
    fn eliminated(&self, damping: f64) -> Option<(Square, Intrinsics, Vec<Option<PoseFactor>>)> {
        let mut schur = self.intrinsics;
        for i in 0..INTRINSICS {
            schur[(i, i)] *= 1.0 + damping;
        }
        let mut right = self.gradient;
        let mut factors = Vec::with_capacity(self.blocks.len());
        for block in &self.blocks {
            let Some(block) = block else {
                factors.push(None);
                continue;
            };
            let mut damped = block.pose;
            for i in 0..6 {
                damped[(i, i)] *= 1.0 + damping;
            }
            let factor = damped.cholesky()?;
            schur -= block.mixed * factor.solve(&block.mixed.transpose());
            right -= block.mixed * factor.solve(&block.gradient);
            factors.push(Some(factor));
        }
        // Rounding must not cost the symmetry.
        Some((0.5 * (schur + schur.transpose()), right, factors))
    }
}

/// The camera after a step.
fn stepped(camera: &Camera, delta: &Intrinsics) -> Camera {
    let mut next = *camera;
    next.fx += delta[0];
    next.fy += delta[1];
    next.cx += delta[2];
    next.cy += delta[3];
    for (k, d) in next.distortion.iter_mut().zip(delta.iter().skip(4)) {
        *k += d;
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    /// Gradient of cost and prior, and the Gauss-Newton matrix's use of them, by differences.
    #[test]
    fn the_gradient_is_that_of_the_cost() {
        let mut prior = CameraPrior::ordinary(1200, 900);
        prior.camera.distortion = [0.01; 5];
        let camera = Camera {
            fx: 950.0,
            fy: 940.0,
            cx: 610.0,
            cy: 430.0,
            distortion: [0.1, -0.2, 0.001, 0.002, 0.05],
            ..prior.camera
        };
        let pose = |x: f64| Pose {
            rotation: DMat3::from_axis_angle(DVec3::new(1.0, x, 0.1).normalize(), 2.8),
            translation: DVec3::new(5.0, -8.0, 250.0),
        };
        let state = State { camera, poses: vec![pose(0.1), pose(-0.3)] };
        let board: Vec<DVec2> = (0..30)
            .map(|i| DVec2::new(f64::from(i % 6) - 2.5, f64::from(i / 6) - 2.0) * 20.0)
            .collect();
        let views: Vec<View> = state
            .poses
            .iter()
            .map(|pose| View {
                board: board.clone(),
                px: board
                    .iter()
                    .map(|b| camera.project(pose.transform(b.extend(0.0))).unwrap() + b * 0.01)
                    .collect(),
                inliers: (0..30).map(|i| i % 7 != 3).collect(),
                used: true,
            })
            .collect();
        let problem = Problem { prior: &prior, views: &views, noise_px: 0.3 };
        let equations = problem.equations(&state);
        let size = [1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5];
        for i in 0..INTRINSICS {
            let at = |h: f64| {
                let mut delta = Intrinsics::zeros();
                delta[i] = h;
                problem.cost(&State { camera: stepped(&camera, &delta), ..state.clone() })
            };
            let slope = (at(size[i]) - at(-size[i])) / (4.0 * size[i]);
            let analytic = equations.gradient[i];
            // Third derivatives and rounding of a cost of about 10.
            assert!(
                (slope - analytic).abs() < 1e-4 * (1.0 + analytic.abs()),
                "{i} {slope} {analytic}"
            );
        }
        for i in 0..6 {
            let at = |h: f64| {
                let mut step = [0.0; 6];
                step[i] = h;
                let mut next = state.clone();
                next.poses[1] = moved(&next.poses[1], &step);
                problem.cost(&next)
            };
            let slope = (at(1e-6) - at(-1e-6)) / 4e-6;
            let analytic = equations.blocks[1].as_ref().unwrap().gradient[i];
            assert!((slope - analytic).abs() < 1e-4 * (1.0 + analytic.abs()), "pose {i}");
        }
        // The reduced system gives the same step as the full one.
        let (schur, right, _) = equations.eliminated(0.0).unwrap();
        let delta = -schur.cholesky().unwrap().solve(&right);
        let n = INTRINSICS + 12;
        let mut full = nalgebra::DMatrix::zeros(n, n);
        let mut g = nalgebra::DVector::zeros(n);
        full.view_mut((0, 0), (9, 9)).copy_from(&equations.intrinsics);
        g.rows_mut(0, 9).copy_from(&equations.gradient);
        for (k, block) in equations.blocks.iter().flatten().enumerate() {
            let at = INTRINSICS + 6 * k;
            full.view_mut((at, at), (6, 6)).copy_from(&block.pose);
            full.view_mut((0, at), (9, 6)).copy_from(&block.mixed);
            full.view_mut((at, 0), (6, 9)).copy_from(&block.mixed.transpose());
            g.rows_mut(at, 6).copy_from(&block.gradient);
        }
        let expected = -full.cholesky().unwrap().solve(&g);
        for i in 0..INTRINSICS {
            assert!((delta[i] - expected[i]).abs() < 1e-6 * (1e-3 + expected[i].abs()), "{i}");
        }
    }
}
