//! Levenberg-Marquardt over intrinsics, paper and all poses.
//!
//! A pose affects only the equations of its own view, so the normal matrix is an arrow. Each step solves the
//! 12 x 12 Schur complement of the shared parameters; the cost grows linearly with the views.

use super::super::paper::{PARAMETERS, Sheet};
use super::super::projection::{Projection, moved};
use super::prior::{CameraPrior, INTRINSICS};
use crate::geometry::{Camera, Pose};
use crate::least_squares::{LeastSquares, Options, minimise};
use glam::{DVec2, DVec3};
use nalgebra::{Const, SMatrix, SVector};

/// Intrinsics, then the paper's aspect and bows.
pub(super) const SHARED: usize = INTRINSICS + PARAMETERS;
type Shared = SVector<f64, SHARED>;
type Square = SMatrix<f64, SHARED, SHARED>;

const REFINEMENT: Options = Options {
    max_steps: 100,
    max_trials: 12,
    damping: 1e-4,
    min_damping: 1e-14,
    min_gain: 1e-13,
    descent: true,
};

/// Corners of one photograph.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// Planned positions on the board, mm.
    pub board: Vec<DVec2>,
    /// Detected positions, px.
    pub px: Vec<DVec2>,
    /// Whether each corner is used.
    pub inliers: Vec<bool>,
    /// Whether the photograph is used.
    pub used: bool,
}

impl View {
    /// Reprojection error of each corner, px; infinite if it does not project.
    pub fn residuals(&self, camera: &Camera, sheet: &Sheet, pose: &Pose) -> Vec<f64> {
        let residual = |(b, p): (&DVec2, &DVec2)| {
            let projected = camera.project(pose.transform(sheet.at(*b)));
            projected.map_or(f64::INFINITY, |q| q.distance(*p))
        };
        self.board.iter().zip(&self.px).map(residual).collect()
    }

    /// Sum of the squared errors of the corners used.
    pub fn cost(&self, camera: &Camera, sheet: &Sheet, pose: &Pose) -> f64 {
        let residuals = self.residuals(camera, sheet, pose).into_iter().zip(&self.inliers);
        residuals.filter(|(_, inlier)| **inlier).map(|(r, _)| r * r).sum()
    }

    pub fn inlier_count(&self) -> usize {
        self.inliers.iter().filter(|i| **i).count()
    }
}

/// A camera, the printed sheet, and a pose for each view.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub camera: Camera,
    pub sheet: Sheet,
    pub poses: Vec<Pose>,
}

/// Equations of one view, before elimination of its pose.
struct Block {
    pose: SMatrix<f64, 6, 6>,
    mixed: SMatrix<f64, SHARED, 6>,
    gradient: SVector<f64, 6>,
}

/// Normal equations of the whole problem.
pub(super) struct Equations {
    shared: Square,
    gradient: Shared,
    blocks: Vec<Option<Block>>,
}

/// The least-squares problem.
pub(super) struct Problem<'a> {
    pub prior: &'a CameraPrior,
    pub views: &'a [View],
    /// Standard deviation of a corner's coordinate, which weighs the prior, px.
    pub noise_px: f64,
    /// Which of the shared parameters are free.
    pub free: [bool; SHARED],
}

impl Problem<'_> {
    /// Squared residuals, px². The prior is scaled by the noise variance.
    pub fn cost(&self, state: &State) -> f64 {
        let camera: f64 = self.prior.terms(&state.camera).map(|(d, _)| d * d).sum();
        let paper: f64 = state.sheet.paper.deviations().iter().map(|(d, _)| d * d).sum();
        let corners: f64 = self
            .views
            .iter()
            .zip(&state.poses)
            .filter(|(view, _)| view.used)
            .map(|(view, pose)| view.cost(&state.camera, &state.sheet, pose))
            .sum();
        corners + self.noise_px * self.noise_px * (camera + paper)
    }

    /// The nearest minimum.
    pub fn minimise(&self, state: State) -> State {
        minimise(self, state, &REFINEMENT).0
    }

    /// Covariance of the shared parameters for the assumed corner noise, poses marginalised; zero
    /// for fixed parameters. `None` if they are not determined.
    pub fn covariance(&self, state: &State) -> Option<Square> {
        let (schur, _, _) = self.equations(state).eliminated(0.0)?;
        let mut inverse = schur.cholesky()?.inverse();
        for (i, free) in self.free.into_iter().enumerate() {
            if !free {
                inverse.row_mut(i).fill(0.0);
                inverse.column_mut(i).fill(0.0);
            }
        }
        Some(inverse * (self.noise_px * self.noise_px))
    }

    fn equations(&self, state: &State) -> Equations {
        let mut shared = Square::zeros();
        let mut gradient = Shared::zeros();
        let weight = self.noise_px * self.noise_px;
        for (deviation, row) in self.prior.terms(&state.camera) {
            let row = row.push(0.0).push(0.0).push(0.0);
            shared += row * row.transpose() * weight;
            gradient += row * (deviation * weight);
        }
        for (i, (deviation, slope)) in state.sheet.paper.deviations().into_iter().enumerate() {
            shared[(INTRINSICS + i, INTRINSICS + i)] += slope * slope * weight;
            gradient[INTRINSICS + i] += slope * deviation * weight;
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
                let point = state.sheet.at(*board);
                let Some(p) = Projection::of(&state.camera, pose, point) else { continue };
                let slopes = state.sheet.slopes(*board).map(|s| pose.rotation * s);
                let error = p.px - *px;
                for (k, e) in [error.x, error.y].into_iter().enumerate() {
                    let [.., gx, gy, gz] = p.by_pose[k];
                    let by_point = DVec3::new(gx, gy, gz);
                    let by_shared = Shared::from_fn(|i, _| match i.checked_sub(INTRINSICS) {
                        None => p.by_intrinsics[k][i],
                        Some(i) => by_point.dot(slopes[i]),
                    });
                    let by_pose = SVector::<f64, 6>::from(p.by_pose[k]);
                    shared += by_shared * by_shared.transpose();
                    gradient += by_shared * e;
                    block.pose += by_pose * by_pose.transpose();
                    block.mixed += by_shared * by_pose.transpose();
                    block.gradient += by_pose * e;
                }
            }
            blocks.push(Some(block));
        }
        for (i, free) in self.free.into_iter().enumerate() {
            if !free {
                shared.row_mut(i).fill(0.0);
                shared.column_mut(i).fill(0.0);
                shared[(i, i)] = 1.0;
                gradient[i] = 0.0;
                for block in blocks.iter_mut().flatten() {
                    block.mixed.row_mut(i).fill(0.0);
                }
            }
        }
        Equations { shared, gradient, blocks }
    }

    fn step(&self, state: &State, equations: &Equations, damping: f64) -> Option<State> {
        let (schur, right, factors) = equations.eliminated(damping)?;
        let delta = -schur.cholesky()?.solve(&right);
        let camera = stepped(&state.camera, &delta);
        let paper = state.sheet.paper.moved(&std::array::from_fn(|i| delta[INTRINSICS + i]));
        if camera.fault().is_some() || !paper.is_plausible() {
            return None;
        }
        let sheet = Sheet { paper, ..state.sheet };
        let mut poses = state.poses.clone();
        for ((pose, block), factor) in poses.iter_mut().zip(&equations.blocks).zip(&factors) {
            if let (Some(block), Some(factor)) = (block, factor) {
                let right = block.gradient + block.mixed.transpose() * delta;
                *pose = moved(pose, &(-factor.solve(&right)).into());
            }
        }
        Some(State { camera, sheet, poses })
    }
}

impl LeastSquares for Problem<'_> {
    type State = State;
    type Equations = Equations;

    fn cost(&self, state: &State) -> f64 {
        self.cost(state)
    }

    fn linearise(&self, state: &State) -> Equations {
        self.equations(state)
    }

    fn step(&self, state: &State, equations: &Equations, damping: f64) -> Option<State> {
        self.step(state, equations, damping)
    }
}

type PoseFactor = nalgebra::Cholesky<f64, Const<6>>;

impl Equations {
    /// Reduced matrix and right side of the shared parameters, and the factors of the pose blocks.
    fn eliminated(&self, damping: f64) -> Option<(Square, Shared, Vec<Option<PoseFactor>>)> {
        let mut schur = self.shared;
        for i in 0..SHARED {
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
        // Rounding must not break the symmetry.
        Some((0.5 * (schur + schur.transpose()), right, factors))
    }
}

fn stepped(camera: &Camera, delta: &Shared) -> Camera {
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
    use super::super::super::paper::Paper;
    use super::super::super::target::Target;
    use super::*;
    use glam::DMat3;

    /// Compares gradient and Gauss-Newton matrix of corners and prior with finite differences.
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
        let sheet = Sheet::new(&Target::default(), Paper { aspect: 1.01, bow_mm: [0.7, -1.5] });
        let state = State { camera, sheet, poses: vec![pose(0.1), pose(-0.3)] };
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
        let free = [true; SHARED];
        let problem = Problem { prior: &prior, views: &views, noise_px: 0.3, free };
        let equations = problem.equations(&state);
        let size = [1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5, 1e-6, 1e-4, 1e-4];
        for i in 0..SHARED {
            let at = |h: f64| {
                let mut delta = Shared::zeros();
                delta[i] = h;
                let paper = sheet.paper.moved(&std::array::from_fn(|i| delta[INTRINSICS + i]));
                problem.cost(&State {
                    camera: stepped(&camera, &delta),
                    sheet: Sheet { paper, ..sheet },
                    ..state.clone()
                })
            };
            let slope = (at(size[i]) - at(-size[i])) / (4.0 * size[i]);
            let analytic = equations.gradient[i];
            // Tolerance: third derivatives, and rounding of a cost of about 10.
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
        let n = SHARED + 12;
        let mut full = nalgebra::DMatrix::zeros(n, n);
        let mut g = nalgebra::DVector::zeros(n);
        full.view_mut((0, 0), (SHARED, SHARED)).copy_from(&equations.shared);
        g.rows_mut(0, SHARED).copy_from(&equations.gradient);
        for (k, block) in equations.blocks.iter().flatten().enumerate() {
            let at = SHARED + 6 * k;
            full.view_mut((at, at), (6, 6)).copy_from(&block.pose);
            full.view_mut((0, at), (SHARED, 6)).copy_from(&block.mixed);
            full.view_mut((at, 0), (6, SHARED)).copy_from(&block.mixed.transpose());
            g.rows_mut(at, 6).copy_from(&block.gradient);
        }
        let expected = -full.cholesky().unwrap().solve(&g);
        for i in 0..SHARED {
            assert!((delta[i] - expected[i]).abs() < 1e-6 * (1e-3 + expected[i].abs()), "{i}");
        }
    }
}
