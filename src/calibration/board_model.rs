//! Predicts grid points of the board without a camera: a homography followed by two radial terms
//! about the picture's centre. The error of a few per cent of a cell is small enough to predict
//! corners and to reject false ones.

use crate::geometry::Homography;
use crate::least_squares::{LeastSquares, Options, damped_step, minimise};
use crate::statistics::median;
use glam::{DMat2, DMat3, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

/// Prior standard deviation of the radial terms, at the picture's corner.
const RADIAL_PRIOR: f64 = 0.15;
/// Corner noise that weighs the prior against the corners, px.
const NOISE_PX: f64 = 0.5;
/// Weight of the prior of each radial term.
const PRIOR: f64 = (NOISE_PX / RADIAL_PRIOR) * (NOISE_PX / RADIAL_PRIOR);
/// Lower limit of the scale of the Cauchy weights, px.
const SCALE_MIN_PX: f64 = 0.3;
/// Number of updates of the scale from the residuals.
const ROUNDS: usize = 10;
const STEPS: Options = Options {
    max_steps: 2,
    max_trials: 6,
    damping: 1e-3,
    min_damping: 0.0,
    min_gain: 1e-6,
    descent: true,
};
/// Eight numbers of the homography, two radial terms.
const N: usize = 10;

/// Grid positions `(column, row)` to pixels: `c + p (1 + k r² + l r⁴)` with
/// `p = H (column, row) - c`, `r = |p| / R`, `c` the picture's centre and `R` half its diagonal.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoardModel {
    homography: DMat3,
    radial: [f64; 2],
    centre: DVec2,
    radius: f64,
}

impl BoardModel {
    /// Fits the model to corners with Cauchy weights scaled by the median residual. `None` for
    /// fewer than four corners or collinear ones.
    pub fn fit(size: (usize, usize), grid: &[DVec2], px: &[DVec2]) -> Option<Self> {
        let centre = 0.5 * DVec2::new(size.0 as f64 - 1.0, size.1 as f64 - 1.0);
        let radius = centre.length().max(1.0);
        let homography = Homography::fit(grid, px)?.0;
        // An origin inside the board keeps the matrix's last element away from 0.
        let middle = grid.iter().sum::<DVec2>() / grid.len() as f64;
        let to_middle = DMat3::from_translation(middle);
        let local = homography * to_middle;
        if local.z_axis.z.abs() < 1e-12 {
            return None;
        }
        let mut model =
            Self { homography: local * local.z_axis.z.recip(), radial: [0.0; 2], centre, radius };
        let grid: Vec<DVec2> = grid.iter().map(|g| *g - middle).collect();
        for _ in 0..ROUNDS {
            let residuals = grid.iter().zip(px).map(|(g, p)| (model.project(*g) - *p).length());
            let scale = (2.0 * median(residuals)?).max(SCALE_MIN_PX);
            let (next, summary) = minimise(&Corners { grid: &grid, px, scale }, model, &STEPS);
            model = next;
            if summary.steps < STEPS.max_steps {
                break;
            }
        }
        model.homography *= DMat3::from_translation(-middle);
        model.homography.is_finite().then_some(model)
    }

    /// Pixel of a grid position; far outside the picture for positions behind the camera.
    pub fn project(&self, grid: DVec2) -> DVec2 {
        let q = self.homography * grid.extend(1.0);
        if q.z <= 0.0 {
            return DVec2::splat(-1e9);
        }
        let p = q.truncate() / q.z - self.centre;
        let r2 = p.length_squared() / (self.radius * self.radius);
        let [k, l] = self.radial;
        // Beyond its turning point the radial polynomial is invalid.
        if 1.0 + r2 * (3.0 * k + 5.0 * l * r2) <= 0.0 {
            return DVec2::splat(-1e9);
        }
        self.centre + p * (1.0 + r2 * (k + l * r2))
    }

    /// Pixels per column (first column of the matrix) and per row (second).
    pub fn cell(&self, grid: DVec2) -> DMat2 {
        const STEP: f64 = 0.25;
        let slope = |d: DVec2| (self.project(grid + d) - self.project(grid - d)) / (2.0 * STEP);
        DMat2::from_cols(slope(DVec2::new(STEP, 0.0)), slope(DVec2::new(0.0, STEP)))
    }

    /// The model for the picture at twice the size in both directions.
    pub fn doubled(&self, size: (usize, usize)) -> Self {
        let enlarge = DMat3::from_cols(
            DVec3::new(2.0, 0.0, 0.0),
            DVec3::new(0.0, 2.0, 0.0),
            DVec3::new(0.5, 0.5, 1.0),
        );
        let centre = 0.5 * DVec2::new(size.0 as f64 - 1.0, size.1 as f64 - 1.0);
        Self {
            homography: enlarge * self.homography,
            radial: self.radial,
            centre,
            radius: centre.length().max(1.0),
        }
    }

    /// The model of the same picture in new grid coordinates, which `m` maps to the present ones.
    pub fn in_grid(&self, m: DMat3) -> Self {
        Self { homography: self.homography * m, ..*self }
    }

    fn moved(&self, step: &SVector<f64, N>) -> Self {
        let h = &self.homography;
        let homography = DMat3::from_cols(
            h.x_axis + DVec3::new(step[0], step[1], step[2]),
            h.y_axis + DVec3::new(step[3], step[4], step[5]),
            h.z_axis + DVec3::new(step[6], step[7], 0.0),
        );
        Self { homography, radial: [self.radial[0] + step[8], self.radial[1] + step[9]], ..*self }
    }
}

/// Corners to fit, with Cauchy weights of scale `scale` px.
struct Corners<'a> {
    grid: &'a [DVec2],
    px: &'a [DVec2],
    scale: f64,
}

impl LeastSquares for Corners<'_> {
    type State = BoardModel;
    type Equations = (SMatrix<f64, N, N>, SVector<f64, N>);

    fn cost(&self, model: &BoardModel) -> f64 {
        let square = self.scale * self.scale;
        let corner = |(g, p): (&DVec2, &DVec2)| {
            let error = model.project(*g) - *p;
            square * (error.length_squared() / square).ln_1p()
        };
        let prior: f64 = model.radial.iter().map(|term| PRIOR * term * term).sum();
        self.grid.iter().zip(self.px).map(corner).sum::<f64>() + prior
    }

    fn linearise(&self, model: &BoardModel) -> Self::Equations {
        let mut normal = SMatrix::<f64, N, N>::zeros();
        let mut gradient = SVector::<f64, N>::zeros();
        let [k, l] = model.radial;
        let scale2 = model.radius * model.radius;
        for (g, target) in self.grid.iter().zip(self.px) {
            let q = model.homography * g.extend(1.0);
            let inverse = q.z.recip();
            let p = q.truncate() * inverse - model.centre;
            let r2 = p.length_squared() / scale2;
            let stretch = 1.0 + r2 * (k + l * r2);
            let error = model.centre + p * stretch - *target;
            // Corners that the model places behind the camera have almost no weight.
            let seen = model.project(*g) - *target;
            let weight = (1.0 + seen.length_squared() / (self.scale * self.scale)).recip();
            // d(pixel)/d(p), then d(p)/d(homography).
            let bend = 2.0 * (k + 2.0 * l * r2) / scale2;
            let (dxx, dxy, dyy) =
                (stretch + bend * p.x * p.x, bend * p.x * p.y, stretch + bend * p.y * p.y);
            let u = p + model.centre;
            for (dx, dy, along, e) in [(dxx, dxy, p.x, error.x), (dxy, dyy, p.y, error.y)] {
                let dz = -(dx * u.x + dy * u.y);
                let a = [dx * inverse, dy * inverse, dz * inverse];
                let row = SVector::<f64, N>::from([
                    a[0] * g.x,
                    a[1] * g.x,
                    a[2] * g.x,
                    a[0] * g.y,
                    a[1] * g.y,
                    a[2] * g.y,
                    a[0],
                    a[1],
                    along * r2,
                    along * r2 * r2,
                ]);
                normal += row * row.transpose() * weight;
                gradient += row * (weight * e);
            }
        }
        for (i, term) in model.radial.iter().enumerate() {
            normal[(8 + i, 8 + i)] += PRIOR;
            gradient[8 + i] += PRIOR * term;
        }
        (normal, gradient)
    }

    fn step(
        &self,
        model: &BoardModel,
        (normal, gradient): &Self::Equations,
        damping: f64,
    ) -> Option<BoardModel> {
        Some(model.moved(&damped_step(normal, gradient, damping)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distorted_ring_with_false_corners_is_fitted() {
        let size = (1000, 700);
        let truth = BoardModel {
            homography: DMat3::from_cols(
                DVec3::new(42.0, 5.0, 2e-3),
                DVec3::new(-6.0, 35.0, -8e-3),
                DVec3::new(180.0, 90.0, 1.0),
            ),
            radial: [-0.17, 0.03],
            centre: DVec2::new(499.5, 349.5),
            radius: DVec2::new(499.5, 349.5).length(),
        };
        let grid: Vec<DVec2> = (0..15)
            .flat_map(|c| (0..12).map(move |r| DVec2::new(f64::from(c), f64::from(r))))
            .filter(|g| g.x < 1.5 || g.y < 1.5 || g.x > 12.5 || g.y > 9.5)
            .collect();
        let mut px: Vec<DVec2> = grid.iter().map(|g| truth.project(*g)).collect();
        for i in (0..px.len()).step_by(15) {
            px[i] += DVec2::new(9.0, -7.0);
        }
        let model = BoardModel::fit(size, &grid, &px).unwrap();
        for (i, (g, p)) in grid.iter().zip(&px).enumerate().filter(|(i, _)| i % 15 != 0) {
            // Tolerance: a twentieth of a cell, since false corners keep some Cauchy weight.
            assert!((model.project(*g) - *p).length() < 1.5, "{i}");
        }
        let twice = model.doubled((2000, 1400));
        let g = DVec2::new(3.0, 7.5);
        assert!((twice.project(g) - (2.0 * model.project(g) + 0.5)).length() < 0.05);
        let cell = model.cell(g);
        assert!((cell.x_axis - (model.project(g + DVec2::X) - model.project(g))).length() < 2.0);
    }

    #[test]
    fn corners_on_a_line_are_refused() {
        let grid: Vec<DVec2> = (0..9).map(|i| DVec2::new(f64::from(i), 3.0)).collect();
        assert!(BoardModel::fit((100, 100), &grid, &grid).is_none());
    }
}
