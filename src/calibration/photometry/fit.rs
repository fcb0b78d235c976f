//! Robust least squares for light, vignetting and ambient from the squares of all photos.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::lobe::Lobe;
use super::model::{Ink, Model, Problem, Sample, Shot, parameter};
use crate::least_squares::{LeastSquares, Options, damped_step, minimise};
use crate::photo::{LogCurve, ToneCurve};
use crate::statistics::{MAD_TO_SIGMA, median};

/// Cosine exponents of lenses: 0 (corrected in the camera) to 4 (natural fall-off) and more.
/// Exponents of a flash's lobe: 1 (a bare diode) to 4.
const EXPONENT_MEAN: f64 = 2.0;
const EXPONENT_SIGMA: f64 = 2.0;
const CURVATURE_SIGMA: f64 = 3.0;
/// Quadrupole of a flash's pattern. Emitter and lens are round to some per cent at the border of a
/// photo, where the squared sine is a tenth.
const PATTERN_SIGMA: f64 = 0.3;
/// Log of true over nominal albedo of black squares; toner is rarely measured.
const BLACK_SIGMA: f64 = 0.3;
/// The same for the gray patch, since printers spread or lighten midtones.
const GRAY_SIGMA: f64 = 0.3;
/// Largest step of a tone curve's log slopes.
const TONE_STEP: f64 = 0.4;
/// Lower limit of the standard deviation of a square's log value: paper is neither Lambertian nor flat.
const MIN_SIGMA: f64 = 0.004;
/// The same with a tone curve: the family approximates the curves of cameras to about 1 %.
pub(super) const TONE_MIN_SIGMA: f64 = 0.01;
/// Relative deviation up to which values above those of white squares are used, and the number of
/// levels tried for that limit.
const TONE_KNOWN: f64 = 0.25;
const TONE_LEVELS: usize = 64;
/// The three channels of a square share one error.
const CHANNEL_CORRELATION: f64 = 3.0;
/// Huber's threshold in sigmas, for 95 % efficiency with Gaussian errors.
const HUBER: f64 = 1.345;
/// Fewest ordinary samples that determine the spread alone; otherwise all samples do.
const PLAIN_MIN: usize = 24;
/// Largest veil share tried.
const VEIL_MAX: f64 = 0.3;
/// Initial spread of log values.
const START_SIGMA: f64 = 0.05;

#[derive(Debug, Clone)]
pub(super) struct Solution {
    /// `ln V = -(exponent u + curvature u²)`, `u = -ln cos`.
    pub exponent: f64,
    pub curvature: f64,
    /// Direction dependence of the flash's intensity.
    pub lobe: Lobe,
    /// Share of the ambient in the irradiance at the reference distance, per channel.
    pub ambient_share: [f64; 3],
    pub ambient_share_sigma: [f64; 3],
    /// Per photo and channel: log of value / (exposure * albedo) on the axis at the reference.
    pub log_scale: Vec<[f64; 3]>,
    /// Log of each photo's brightness over that of its stated exposure, and its standard deviation.
    pub log_gain: Vec<[f64; 2]>,
    /// Veil share and its standard deviation.
    pub veil: [f64; 2],
    /// Exponent of the darkening by bright surroundings, and its standard deviation.
    pub local_tone: [f64; 2],
    /// Index of the surroundings' scale for that.
    pub local_scale: usize,
    pub offset_mm: DVec3,
    pub offset_sigma_mm: DVec3,
    /// True over nominal albedo of black squares.
    pub black_ratio: [f64; 3],
    /// Parameters of the tone curve and their covariance.
    pub tone: [f64; 3],
    pub tone_covariance: [[f64; 3]; 3],
    /// All parameters of the fit.
    pub theta: DVector<f64>,
    /// Robust standard deviation of the residuals of log values.
    pub sigma: f64,
    /// The same for each photo; NaN without samples.
    pub photo_sigma: Vec<f64>,
}

/// Weights and scale depend on the residuals, so steps need not lower the cost.
const REFINEMENT: Options = Options {
    max_steps: 30,
    max_trials: 1,
    damping: 0.0,
    min_damping: 0.0,
    min_gain: 0.0,
    descent: false,
};
/// Smaller steps, in units of the parameters, end the iteration.
const STEP_MIN: f64 = 1e-7;

/// Gauss-Newton with Huber weights on the squares, Cauchy weights on the photos' scales (a wrong
/// exposure must not pull the others) and Gaussian priors elsewhere.
///
/// Starts at `start`, or else at the prior.
pub(super) fn solve(
    samples: &[Sample],
    shots: &[Shot],
    problem: &Problem,
    start: Option<&DVector<f64>>,
) -> Solution {
    let (fit, expected) = Fit::new(samples, shots, problem);
    let theta = start.map_or(expected, |start| fit.fixed(start));
    let (State { theta, sigma, covariance }, _) = minimise(&fit, State::new(theta), &REFINEMENT);
    fit.solution(&theta, sigma, &covariance)
}

impl Solution {
    /// The tone curve with its limit of validity: above the white squares, values are used while
    /// their relative deviation is at most [`TONE_KNOWN`].
    pub fn tone_curve(&self, samples: &[Sample]) -> ToneCurve {
        let curve = ToneCurve { log_slopes: self.tone, unknown_from: 0.0 };
        if curve.is_identity() {
            return curve;
        }
        let white = samples.iter().filter(|s| s.ink == Ink::None);
        let white = median(white.map(|s| s.log_stored)).unwrap_or(f64::NAN);
        let log = LogCurve::new(curve);
        let from = log.at(white).by_parameters;
        let sigma = |log_stored: f64| {
            let to = log.at(log_stored).by_parameters;
            let d: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
            let row = |i: usize| (0..3).map(|j| self.tone_covariance[i][j] * d[j]).sum::<f64>();
            (0..3).map(|i| d[i] * row(i)).sum::<f64>().sqrt()
        };
        let levels = (0..TONE_LEVELS).map(|i| white * (1.0 - i as f64 / TONE_LEVELS as f64));
        let unknown = levels.into_iter().find(|level| sigma(*level) > TONE_KNOWN);
        ToneCurve { unknown_from: unknown.map_or(0.0, |level| level.exp() as f32), ..curve }
    }
}

/// Twice the negative log posterior up to a constant, for squares with standard deviation `sigma`.
pub(super) fn misfit(
    samples: &[Sample],
    shots: &[Shot],
    problem: &Problem,
    solution: &Solution,
    sigma: f64,
) -> f64 {
    let (fit, _) = Fit::new(samples, shots, problem);
    let mut theta = solution.theta.clone();
    if problem.tone_sigma == 0.0 {
        // The linear fit excludes the gray patch, so solve for its ratio here.
        theta[parameter::GRAY] = fit.gray(&theta);
    }
    let model = fit.model(&theta);
    let squares = samples.iter().filter_map(|s| {
        let (r, s) = (model.residual(s)?.value.abs(), sigma * s.sigma);
        let loss = if r < HUBER * s { r * r } else { HUBER * s * (2.0 * r - HUBER * s) };
        Some(loss / (CHANNEL_CORRELATION * s * s))
    });
    squares.sum::<f64>() + fit.prior_misfit(&theta)
}

/// Parameters, with by-products of the last step.
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
    shots: &'a [Shot],
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
    /// The problem and its start.
    fn new(samples: &'a [Sample], shots: &'a [Shot], problem: &'a Problem) -> (Self, DVector<f64>) {
        use parameter::{
            AMBIENT, BLACK, CURVATURE, EXPONENT, FRAMES, GRAY, LOBE, LOCAL, LOG_SCALE, OFFSET,
            PATTERN, TONE, VEIL,
        };
        let n = FRAMES + 3 * shots.len();
        let mut theta = DVector::zeros(n);
        theta[EXPONENT] = EXPONENT_MEAN;
        theta[LOBE] = EXPONENT_MEAN;
        for (k, v) in problem.offset_mm.to_array().into_iter().enumerate() {
            theta[OFFSET + k] = v;
        }
        let mut prior = vec![(0.0, problem.gain_width); n];
        prior[EXPONENT] = (EXPONENT_MEAN, EXPONENT_SIGMA);
        prior[LOBE] = (EXPONENT_MEAN, EXPONENT_SIGMA);
        prior[CURVATURE] = (0.0, CURVATURE_SIGMA);
        prior[PATTERN..PATTERN + 2].fill((0.0, PATTERN_SIGMA));
        prior[GRAY] = (0.0, GRAY_SIGMA);
        prior[VEIL] = (0.0, problem.veil_sigma);
        prior[LOCAL] = (0.0, problem.local_sigma);
        prior[TONE..TONE + 3].fill((0.0, problem.tone_sigma));
        // Print errors are common to the channels; with a curve they must not count three times.
        let black_sigma = BLACK_SIGMA * if problem.tone_sigma > 0.0 { 3.0_f64.sqrt() } else { 1.0 };
        let start = theta.clone();
        let model = Model::new(shots, problem, &start);
        for c in 0..3 {
            prior[AMBIENT + c] = (0.0, problem.ambient_sigma);
            prior[LOG_SCALE + c] = (0.0, f64::INFINITY);
            prior[BLACK + c] = (0.0, black_sigma);
            prior[OFFSET + c] = (problem.offset_mm[c], problem.offset_sigma_mm[c]);
            // Start at the median, to keep outliers out of the first weights.
            let white = |s: &Sample| s.ink == Ink::None;
            let any_white = samples.iter().any(|s| s.channel == c && white(s));
            let scales = samples
                .iter()
                .filter(|s| s.channel == c && (white(s) || !any_white))
                .filter_map(|s| Some(-model.residual(s)?.value));
            match median(scales) {
                Some(scale) => theta[LOG_SCALE + c] = scale,
                // All clipped: undetermined, but the system stays regular.
                None => prior[LOG_SCALE + c] = (0.0, 1.0),
            }
        }
        (Self { samples, shots, problem, prior }, theta)
    }

    /// Log ratio of the gray patch that fits its samples.
    fn gray(&self, theta: &DVector<f64>) -> f64 {
        let model = self.model(theta);
        let gray = self.samples.iter().filter(|s| s.ink == Ink::Gray);
        let off = |s| Some(theta[parameter::GRAY] - model.residual(s)?.value);
        median(gray.filter_map(off)).unwrap_or(0.0)
    }

    /// Prior part of [`misfit`]; the channels share one error.
    fn prior_misfit(&self, theta: &DVector<f64>) -> f64 {
        use parameter::{AMBIENT, BLACK, FRAMES};
        let term = |(i, &(mean, sigma)): (usize, &(f64, f64))| {
            if sigma == 0.0 || sigma.is_infinite() {
                return 0.0;
            }
            let off = theta[i] - mean;
            let squared = (off / self.prior_sigma(i, off)).powi(2);
            match i {
                // Wrong exposures and bright rooms are common: heavy tails.
                _ if i >= FRAMES || (AMBIENT..AMBIENT + 3).contains(&i) => {
                    (1.0 + squared).ln() / CHANNEL_CORRELATION
                }
                _ if (BLACK..BLACK + 3).contains(&i) => {
                    ((theta[i] - mean) / BLACK_SIGMA).powi(2) / CHANNEL_CORRELATION
                }
                _ => squared,
            }
        };
        self.prior.iter().enumerate().map(term).sum()
    }

    /// Prior standard deviation of a parameter on the side of the mean given by the sign of `off`.
    fn prior_sigma(&self, parameter: usize, off: f64) -> f64 {
        match parameter {
            parameter::EXPONENT | parameter::LOBE if off < 0.0 => self.problem.exponent_sigma_below,
            _ => self.prior[parameter].1,
        }
    }

    /// Parameters with the fixed ones at their means.
    fn fixed(&self, theta: &DVector<f64>) -> DVector<f64> {
        let at = |(i, &(mean, sigma)): (usize, &(f64, f64))| {
            if sigma == 0.0 { mean } else { theta[i] }
        };
        DVector::from_iterator(theta.len(), self.prior.iter().enumerate().map(at))
    }

    fn model<'b>(&'b self, theta: &'b DVector<f64>) -> Model<'b> {
        Model::new(self.shots, self.problem, theta)
    }

    /// Robust standard deviation of the residuals of ordinary squares.
    fn sigma(&self, model: &Model) -> f64 {
        // Black and glaring squares have small weights by precaution; their residuals say little about paper.
        let plain = self.samples.iter().filter(|s| s.sigma <= 1.0).count() >= PLAIN_MIN;
        let used = self.samples.iter().filter(|s| !plain || s.sigma <= 1.0);
        let off = median(used.filter_map(|s| Some(model.residual(s)?.value.abs() / s.sigma)));
        let least = if self.problem.tone_sigma > 0.0 { TONE_MIN_SIGMA } else { MIN_SIGMA };
        off.map_or(least, |off| (MAD_TO_SIGMA * off).max(least))
    }

    /// Adds the priors to the equations of the squares. Fixed parameters get unit rows.
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
            let mut precision = self.prior_sigma(i, off).powi(-2);
            if i >= parameter::FRAMES {
                precision /= 1.0 + off * off * precision;
            }
            normal[(i, i)] += precision;
            gradient[i] += precision * off;
        }
    }

    fn solution(&self, theta: &DVector<f64>, sigma: f64, covariance: &DMatrix<f64>) -> Solution {
        use parameter::{
            AMBIENT, BLACK, CURVATURE, EXPONENT, FRAMES, LOBE, LOCAL, LOG_SCALE, OFFSET, PATTERN,
            TONE, VEIL,
        };
        let model = self.model(theta);
        let free = |i: usize, j: usize| {
            if self.problem.tone_sigma == 0.0 { 0.0 } else { covariance[(TONE + i, TONE + j)] }
        };
        let spread =
            |i: usize| if self.prior[i].1 == 0.0 { 0.0 } else { covariance[(i, i)].sqrt() };
        let three = |i: usize| -> [f64; 3] { std::array::from_fn(|c| theta[i + c]) };
        let frames = 0..self.shots.len();
        let photo_sigma = |frame: usize| {
            let used = self.samples.iter().filter(|s| s.frame == frame);
            let off = median(used.filter_map(|s| Some(model.residual(s)?.value.abs())));
            MAD_TO_SIGMA * off.unwrap_or(f64::NAN)
        };
        let log_scale =
            |f: usize| std::array::from_fn(|c| theta[LOG_SCALE + c] + theta[FRAMES + 3 * f + c]);
        let log_gain = |f: usize| {
            let own = FRAMES + 3 * f;
            [(0..3).map(|c| theta[own + c]).sum::<f64>() / 3.0, spread(own + 1)]
        };
        Solution {
            exponent: theta[EXPONENT],
            curvature: theta[CURVATURE],
            lobe: Lobe { exponent: theta[LOBE], pattern: [theta[PATTERN], theta[PATTERN + 1]] },
            ambient_share: three(AMBIENT),
            ambient_share_sigma: std::array::from_fn(|c| spread(AMBIENT + c)),
            log_scale: frames.clone().map(log_scale).collect(),
            log_gain: frames.clone().map(log_gain).collect(),
            veil: [theta[VEIL], spread(VEIL)],
            local_tone: [theta[LOCAL], spread(LOCAL)],
            local_scale: self.problem.local_scale,
            black_ratio: three(BLACK).map(f64::exp),
            tone: three(TONE),
            tone_covariance: std::array::from_fn(|i| std::array::from_fn(|j| free(i, j))),
            offset_mm: DVec3::from_array(three(OFFSET)),
            offset_sigma_mm: DVec3::from_array(std::array::from_fn(|c| spread(OFFSET + c))),
            theta: theta.clone(),
            sigma,
            photo_sigma: frames.map(photo_sigma).collect(),
        }
    }
}

/// Weight of a residual for samples of standard deviation `sigma`.
fn weight(sample: &Sample, residual: f64, sigma: f64) -> f64 {
    let s = sigma * sample.sigma;
    (HUBER * s / residual.abs()).min(1.0) / (CHANNEL_CORRELATION * s * s)
}

impl LeastSquares for Fit<'_> {
    type State = State;
    type Equations = Equations;

    /// Cost with the weights of `state`, without priors.
    fn cost(&self, state: &State) -> f64 {
        let model = self.model(&state.theta);
        let residuals = self.samples.iter().filter_map(|s| Some((s, model.residual(s)?.value)));
        residuals.map(|(s, r)| weight(s, r, state.sigma) * r * r).sum()
    }

    fn linearise(&self, state: &State) -> Equations {
        let n = self.prior.len();
        let model = self.model(&state.theta);
        let sigma = self.sigma(&model);
        let mut normal = DMatrix::<f64>::zeros(n, n);
        let mut gradient = DVector::<f64>::zeros(n);
        for sample in self.samples {
            let Some(residual) = model.residual(sample) else { continue };
            let r = residual.value;
            let weight = weight(sample, r, sigma);
            for &(i, ji) in residual.derivatives() {
                gradient[i] += weight * ji * r;
                for &(j, jj) in residual.derivatives() {
                    normal[(i, j)] += weight * ji * jj;
                }
            }
        }
        self.add_prior(&state.theta, &mut normal, &mut gradient);
        Equations { normal, gradient, sigma }
    }

    fn step(&self, state: &State, equations: &Equations, damping: f64) -> Option<State> {
        let Equations { normal, gradient, sigma } = equations;
        let mut step = damped_step(normal, gradient, damping)?;
        let tone = parameter::TONE..parameter::TONE + 3;
        let largest = tone.clone().map(|i| step[i].abs()).fold(TONE_STEP, f64::max);
        step *= TONE_STEP / largest;
        let mut theta = &state.theta + step;
        for i in tone {
            theta[i] = theta[i].clamp(-ToneCurve::MAX_LOG_SLOPE, ToneCurve::MAX_LOG_SLOPE);
        }
        for c in 0..3 {
            let ambient = &mut theta[parameter::AMBIENT + c];
            *ambient = ambient.clamp(0.0, self.problem.ambient_max);
        }
        theta[parameter::VEIL] = theta[parameter::VEIL].clamp(0.0, VEIL_MAX);
        let covariance = normal.clone().cholesky()?.inverse();
        Some(State { theta, sigma: *sigma, covariance })
    }

    fn is_settled(&self, before: &State, after: &State) -> bool {
        (&after.theta - &before.theta).amax() < STEP_MIN
    }
}
