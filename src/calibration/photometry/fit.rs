//! Robust least squares for light, vignetting and ambient from the squares of all photos.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::Lobe;
use crate::geometry::Pose;
use crate::least_squares::{LeastSquares, Options, damped_step, minimise};

/// Cosine exponents of lenses: 0 (corrected in the camera) to 4 (natural fall-off) and more; and of
/// a flash's lobe: 1 (a bare diode) to 4.
const EXPONENT_MEAN: f64 = 2.0;
const EXPONENT_SIGMA: f64 = 2.0;
const CURVATURE_SIGMA: f64 = 3.0;
/// Quadrupole of a flash's pattern: an emitter and its lens are rarely round to better than some per
/// cent at the border of a photo, where the square of the sine is a tenth.
const PATTERN_SIGMA: f64 = 0.3;
/// Log of the true over the nominal albedo of black squares: toner is rarely measured.
const BLACK_SIGMA: f64 = 0.3;
/// Exposure metadata is rounded and flashes repeat to about this.
const SCALE_SIGMA: f64 = 0.02;
/// Least standard deviation of a square's log value that is believed: paper is not Lambertian and
/// lies not quite flat.
const MIN_SIGMA: f64 = 0.004;
/// Errors of the three channels of a square are the same error.
const CHANNEL_CORRELATION: f64 = 3.0;
/// Huber's threshold in sigma: 95 % efficiency for Gaussian errors.
const HUBER: f64 = 1.345;
/// Ordinary samples from which their spread is taken; fewer leave it to all.
const PLAIN_MIN: usize = 24;
/// Ambient share below which light from elsewhere still leaves a flash to be seen.
const AMBIENT_MAX: f64 = 0.98;
/// Spread of log values before any is known.
const START_SIGMA: f64 = 0.05;

/// Index of parameters; the scales of the photos follow, three each.
mod parameter {
    pub const EXPONENT: usize = 0;
    pub const CURVATURE: usize = 1;
    pub const AMBIENT: usize = 2;
    pub const LOG_SCALE: usize = 5;
    pub const OFFSET: usize = 8;
    pub const BLACK: usize = 11;
    pub const LOBE: usize = 14;
    pub const PATTERN: usize = 15;
    pub const FRAMES: usize = 17;
}

/// One channel of one square.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub frame: usize,
    pub channel: usize,
    pub white: bool,
    /// Logarithm of value / (exposure * nominal albedo).
    pub log_value: f64,
    pub board_mm: DVec3,
    /// Standard deviation relative to an ordinary square's.
    pub sigma: f64,
}

/// What is estimated and how firmly.
#[derive(Debug, Clone, Copy)]
pub(super) struct Problem {
    /// Distance at which the flash's irradiance is the unit, mm.
    pub reference_mm: f64,
    /// Start, or fixed value, of the flash offset in the camera frame, mm.
    pub offset_mm: DVec3,
    /// Standard deviation of the offset's prior per axis, mm; zero keeps an axis fixed.
    pub offset_sigma_mm: DVec3,
    /// Standard deviation of the prior of the ambient share, towards 0; zero fixes it at 0.
    pub ambient_sigma: f64,
}

/// Estimate.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    /// `ln V = -(exponent u + curvature u²)`, `u = -ln cos`.
    pub exponent: f64,
    pub curvature: f64,
    /// How the flash's intensity depends on direction.
    pub lobe: Lobe,
    /// Share of the ambient in the irradiance at the reference distance, per channel.
    pub ambient_share: [f64; 3],
    pub ambient_share_sigma: [f64; 3],
    /// Per photo and channel: log of value / (exposure * albedo) on the axis at the reference.
    pub log_scale: Vec<[f64; 3]>,
    pub offset_mm: DVec3,
    pub offset_sigma_mm: DVec3,
    /// True over nominal albedo of black squares.
    pub black_ratio: [f64; 3],
    /// Robust standard deviation of the residuals of log values.
    pub sigma: f64,
    /// The same for each photo; NaN for a photo without samples.
    pub frame_sigma: Vec<f64>,
}

/// Irradiance of a flash without lobe relative to that at the reference distance, facing it, and
/// the gradient with respect to the light's position. `None` behind the board.
fn irradiance(light: DVec3, point: DVec3, reference_mm: f64) -> Option<(f64, DVec3)> {
    let v = light - point;
    if v.z <= 0.0 {
        return None;
    }
    let d2 = v.length_squared();
    let k = reference_mm * reference_mm / (d2 * d2.sqrt());
    Some((k * v.z, k * (DVec3::Z - v * (3.0 * v.z / d2))))
}

/// `-ln cos` of the angle at `from` between the optical axis and the direction to a point, both in
/// the camera frame, and its gradient with respect to `from`.
fn log_secant(from: DVec3, point: DVec3) -> (f64, DVec3) {
    let w = point - from;
    let d2 = w.length_squared();
    (0.5 * (d2 / (w.z * w.z)).ln(), DVec3::Z / w.z - w / d2)
}

/// Quadrupole of the unit direction to a point from `from`, both in the camera frame: `x² - y²` and
/// `2 x y`, and their gradients with respect to `from`.
fn quadrupole(from: DVec3, point: DVec3) -> ([f64; 2], [DVec3; 2]) {
    let v = point - from;
    let d2 = v.length_squared();
    let values = [(v.x * v.x - v.y * v.y) / d2, 2.0 * v.x * v.y / d2];
    let by_v = [DVec3::new(2.0 * v.x, -2.0 * v.y, 0.0), DVec3::new(2.0 * v.y, 2.0 * v.x, 0.0)];
    let gradient = |i: usize| (v * (2.0 * values[i]) - by_v[i]) / d2;
    (values, [gradient(0), gradient(1)])
}

/// Number of parameters that a residual depends on.
const OWN: usize = 12;

/// Residual of a sample and its non-zero derivatives.
fn residual(
    sample: &Sample,
    pose: &Pose,
    theta: &DVector<f64>,
    problem: &Problem,
) -> Option<(f64, [(usize, f64); OWN])> {
    use parameter::{
        AMBIENT, BLACK, CURVATURE, EXPONENT, FRAMES, LOBE, LOG_SCALE, OFFSET, PATTERN,
    };
    let c = sample.channel;
    let offset = DVec3::new(theta[OFFSET], theta[OFFSET + 1], theta[OFFSET + 2]);
    let (g, by_light) = irradiance(pose.to_board(offset), sample.board_mm, problem.reference_mm)?;
    let by_light = pose.rotation * by_light; // of the light's position in the camera frame
    let point = pose.transform(sample.board_mm);
    let u = log_secant(DVec3::ZERO, point).0;
    let (u_light, u_by_light) = log_secant(offset, point);
    let lobe = (-theta[LOBE] * u_light).exp();
    let ([along, across], [along_by, across_by]) = quadrupole(offset, point);
    let pattern = 1.0 + theta[PATTERN] * along + theta[PATTERN + 1] * across;
    let (pattern, live) =
        (pattern.max(Lobe::MIN_PATTERN), f64::from(u8::from(pattern > Lobe::MIN_PATTERN)));
    let flash = g * lobe * pattern;
    let q = theta[AMBIENT + c];
    let total = (1.0 - q) * flash + q;
    let share = (1.0 - q) * flash / total;
    let frame = FRAMES + 3 * sample.frame + c;
    let black = if sample.white { 0.0 } else { 1.0 };
    let model = theta[LOG_SCALE + c] + theta[frame] + black * theta[BLACK + c] + total.ln()
        - u * (theta[EXPONENT] + u * theta[CURVATURE]);
    let by_pattern = share * live / pattern;
    let by_offset = share * (by_light / g - theta[LOBE] * u_by_light)
        + by_pattern * (theta[PATTERN] * along_by + theta[PATTERN + 1] * across_by);
    Some((
        model - sample.log_value,
        [
            (EXPONENT, -u),
            (CURVATURE, -u * u),
            (AMBIENT + c, (1.0 - flash) / total),
            (LOBE, -share * u_light),
            (LOG_SCALE + c, 1.0),
            (OFFSET, by_offset.x),
            (OFFSET + 1, by_offset.y),
            (OFFSET + 2, by_offset.z),
            (BLACK + c, black),
            (PATTERN, by_pattern * along),
            (PATTERN + 1, by_pattern * across),
            (frame, 1.0),
        ],
    ))
}

fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// How light and lens are found. Weights and scale follow the residuals, so that steps are taken as
/// they come.
const REFINEMENT: Options = Options {
    max_steps: 30,
    max_trials: 1,
    damping: 0.0,
    min_damping: 0.0,
    min_gain: 0.0,
    descent: false,
};
/// Steps below this, in units of the parameters, are the last.
const STEP_MIN: f64 = 1e-7;

/// Gauss-Newton with Huber weights on the squares, Cauchy weights on the photos' scales (a wrong
/// exposure in the metadata must not pull the others) and Gaussian priors elsewhere.
pub(super) fn solve(samples: &[Sample], poses: &[Pose], problem: &Problem) -> Solution {
    let (fit, theta) = Fit::new(samples, poses, problem);
    let (State { theta, sigma, covariance }, _) = minimise(&fit, State::new(theta), &REFINEMENT);
    fit.solution(&theta, sigma, &covariance)
}

/// Parameters, and what the step that led to them has found.
struct State {
    theta: DVector<f64>,
    /// Robust standard deviation of the residuals before the step.
    sigma: f64,
    /// Inverse of the step's normal matrix.
    covariance: DMatrix<f64>,
}

impl State {
    fn new(theta: DVector<f64>) -> Self {
        let n = theta.len();
        Self { theta, sigma: START_SIGMA, covariance: DMatrix::zeros(n, n) }
    }
}

/// The problem with its data.
struct Fit<'a> {
    samples: &'a [Sample],
    poses: &'a [Pose],
    problem: &'a Problem,
    /// Prior mean and standard deviation; infinite: free, zero: fixed.
    prior: Vec<(f64, f64)>,
}

/// Normal equations with the weights of one state.
struct Equations {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    sigma: f64,
}

impl<'a> Fit<'a> {
    /// The problem and where its solution is looked for first.
    fn new(samples: &'a [Sample], poses: &'a [Pose], problem: &'a Problem) -> (Self, DVector<f64>) {
        use parameter::{
            AMBIENT, BLACK, CURVATURE, EXPONENT, FRAMES, LOBE, LOG_SCALE, OFFSET, PATTERN,
        };
        let n = FRAMES + 3 * poses.len();
        let mut theta = DVector::zeros(n);
        theta[EXPONENT] = EXPONENT_MEAN;
        theta[LOBE] = EXPONENT_MEAN;
        for (k, v) in problem.offset_mm.to_array().into_iter().enumerate() {
            theta[OFFSET + k] = v;
        }
        let mut prior = vec![(0.0, SCALE_SIGMA); n];
        prior[EXPONENT] = (EXPONENT_MEAN, EXPONENT_SIGMA);
        prior[LOBE] = (EXPONENT_MEAN, EXPONENT_SIGMA);
        prior[CURVATURE] = (0.0, CURVATURE_SIGMA);
        prior[PATTERN..PATTERN + 2].fill((0.0, PATTERN_SIGMA));
        for c in 0..3 {
            prior[AMBIENT + c] = (0.0, problem.ambient_sigma);
            prior[LOG_SCALE + c] = (0.0, f64::INFINITY);
            prior[BLACK + c] = (0.0, BLACK_SIGMA);
            prior[OFFSET + c] = (problem.offset_mm[c], problem.offset_sigma_mm[c]);
            // Start at the median, so that outliers do not enter the first weights.
            let any_white = samples.iter().any(|s| s.channel == c && s.white);
            let mut list: Vec<f64> = samples
                .iter()
                .filter(|s| s.channel == c && (s.white || !any_white))
                .filter_map(|s| residual(s, &poses[s.frame], &theta, problem).map(|r| -r.0))
                .collect();
            if list.is_empty() {
                prior[LOG_SCALE + c] = (0.0, 1.0); // all clipped: undetermined, yet solvable
            } else {
                theta[LOG_SCALE + c] = median(&mut list);
            }
        }
        (Self { samples, poses, problem, prior }, theta)
    }

    fn residual(&self, s: &Sample, theta: &DVector<f64>) -> Option<(f64, [(usize, f64); OWN])> {
        residual(s, &self.poses[s.frame], theta, self.problem)
    }

    /// Robust standard deviation of the residuals of ordinary squares.
    fn sigma(&self, theta: &DVector<f64>) -> f64 {
        // The weights of black and of glaring squares are cautious, not noise: their residuals
        // say little about paper.
        let plain = self.samples.iter().filter(|s| s.sigma <= 1.0).count() >= PLAIN_MIN;
        let used = self.samples.iter().filter(|s| !plain || s.sigma <= 1.0);
        let mut list: Vec<f64> =
            used.filter_map(|s| Some(self.residual(s, theta)?.0.abs() / s.sigma)).collect();
        (1.4826 * median(&mut list)).max(MIN_SIGMA)
    }

    /// Adds the priors to the equations of the squares; fixed parameters get a row of their own.
    fn add_prior(
        &self,
        theta: &DVector<f64>,
        normal: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        for (i, &(mean, sigma)) in self.prior.iter().enumerate() {
            if sigma == 0.0 {
                normal.row_mut(i).fill(0.0);
                normal.column_mut(i).fill(0.0);
                normal[(i, i)] = 1.0;
                gradient[i] = 0.0;
                continue;
            }
            let off = theta[i] - mean;
            let mut precision = sigma.powi(-2);
            if i >= parameter::FRAMES {
                precision /= 1.0 + off * off * precision;
            }
            normal[(i, i)] += precision;
            gradient[i] += precision * off;
        }
    }

    fn solution(&self, theta: &DVector<f64>, sigma: f64, covariance: &DMatrix<f64>) -> Solution {
        use parameter::{
            AMBIENT, BLACK, CURVATURE, EXPONENT, FRAMES, LOBE, LOG_SCALE, OFFSET, PATTERN,
        };
        let spread =
            |i: usize| if self.prior[i].1 == 0.0 { 0.0 } else { covariance[(i, i)].sqrt() };
        let three = |i: usize| -> [f64; 3] { std::array::from_fn(|c| theta[i + c]) };
        let frames = 0..self.poses.len();
        let frame_sigma = |frame: usize| {
            let used = self.samples.iter().filter(|s| s.frame == frame);
            let mut list: Vec<f64> =
                used.filter_map(|s| Some(self.residual(s, theta)?.0.abs())).collect();
            1.4826 * median(&mut list)
        };
        let log_scale =
            |f: usize| std::array::from_fn(|c| theta[LOG_SCALE + c] + theta[FRAMES + 3 * f + c]);
        Solution {
            exponent: theta[EXPONENT],
            curvature: theta[CURVATURE],
            lobe: Lobe { exponent: theta[LOBE], pattern: [theta[PATTERN], theta[PATTERN + 1]] },
            ambient_share: three(AMBIENT),
            ambient_share_sigma: std::array::from_fn(|c| spread(AMBIENT + c)),
            log_scale: frames.clone().map(log_scale).collect(),
            black_ratio: three(BLACK).map(f64::exp),
            offset_mm: DVec3::from_array(three(OFFSET)),
            offset_sigma_mm: DVec3::from_array(std::array::from_fn(|c| spread(OFFSET + c))),
            sigma,
            frame_sigma: frames.map(frame_sigma).collect(),
        }
    }
}

/// Weight of a residual of a sample among others of standard deviation `sigma`.
fn weight(sample: &Sample, residual: f64, sigma: f64) -> f64 {
    let s = sigma * sample.sigma;
    (HUBER * s / residual.abs()).min(1.0) / (CHANNEL_CORRELATION * s * s)
}

impl LeastSquares for Fit<'_> {
    type State = State;
    type Equations = Equations;

    /// With the weights of the state itself, priors apart.
    fn cost(&self, state: &State) -> f64 {
        let residuals =
            self.samples.iter().filter_map(|s| Some((s, self.residual(s, &state.theta)?.0)));
        residuals.map(|(s, r)| weight(s, r, state.sigma) * r * r).sum()
    }

    fn linearise(&self, state: &State) -> Equations {
        let n = self.prior.len();
        let sigma = self.sigma(&state.theta);
        let mut normal = DMatrix::<f64>::zeros(n, n);
        let mut gradient = DVector::<f64>::zeros(n);
        for sample in self.samples {
            let Some((r, jacobian)) = self.residual(sample, &state.theta) else { continue };
            let weight = weight(sample, r, sigma);
            for &(i, ji) in &jacobian {
                gradient[i] += weight * ji * r;
                for &(j, jj) in &jacobian {
                    normal[(i, j)] += weight * ji * jj;
                }
            }
        }
        self.add_prior(&state.theta, &mut normal, &mut gradient);
        Equations { normal, gradient, sigma }
    }

    fn step(&self, state: &State, equations: &Equations, damping: f64) -> Option<State> {
        let Equations { normal, gradient, sigma } = equations;
        let mut theta = &state.theta + damped_step(normal, gradient, damping)?;
        for c in 0..3 {
            let ambient = &mut theta[parameter::AMBIENT + c];
            *ambient = ambient.clamp(0.0, AMBIENT_MAX);
        }
        let covariance = normal.clone().cholesky()?.inverse();
        Some(State { theta, sigma: *sigma, covariance })
    }

    fn is_settled(&self, before: &State, after: &State) -> bool {
        (&after.theta - &before.theta).amax() < STEP_MIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    /// The derivatives by which the fit steps, against central differences.
    #[test]
    fn derivatives_match_finite_differences() {
        let pose = Pose {
            rotation: DMat3::from_rotation_x(std::f64::consts::PI - 0.4),
            translation: DVec3::new(4.0, -3.0, 250.0),
        };
        let problem = Problem {
            reference_mm: 240.0,
            offset_mm: DVec3::ZERO,
            offset_sigma_mm: DVec3::ONE,
            ambient_sigma: 0.1,
        };
        let sample = Sample {
            frame: 0,
            channel: 1,
            white: false,
            log_value: 0.3,
            board_mm: DVec3::new(-60.0, 45.0, 0.0),
            sigma: 1.0,
        };
        let mut theta = DVector::zeros(parameter::FRAMES + 3);
        let values = [
            3.0, -1.0, 0.1, 0.05, 0.2, 0.4, 0.2, 0.1, 8.0, -5.0, 1.0, 0.0, 0.1, 0.0, 1.7, 0.4,
            -0.3, 0.0, 0.02, 0.0,
        ];
        for (i, v) in values.into_iter().enumerate() {
            theta[i] = v;
        }
        let (_, jacobian) = residual(&sample, &pose, &theta, &problem).unwrap();
        for (i, analytic) in jacobian {
            let h = 1e-5;
            let at = |d: f64| {
                let mut shifted = theta.clone();
                shifted[i] += d;
                residual(&sample, &pose, &shifted, &problem).unwrap().0
            };
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            // Central differences in f64: rounding 1e-16 / h, truncation h².
            assert!((numeric - analytic).abs() < 1e-8, "{i}: {numeric} {analytic}");
        }
    }
}
