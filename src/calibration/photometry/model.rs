//! Predicted value of a square as a function of light, lens, print and tone curve.

use glam::DVec3;
use nalgebra::DVector;

use super::lobe::Lobe;
use crate::geometry::Pose;
use crate::photo::{Lift, LogCurve, Surround, ToneCurve};

/// Index of each parameter. The scales of the photos follow, three each.
pub(super) mod parameter {
    pub const EXPONENT: usize = 0;
    pub const CURVATURE: usize = 1;
    pub const AMBIENT: usize = 2;
    pub const LOG_SCALE: usize = 5;
    pub const OFFSET: usize = 8;
    pub const BLACK: usize = 11;
    pub const LOBE: usize = 14;
    pub const PATTERN: usize = 15;
    pub const GRAY: usize = 17;
    pub const TONE: usize = 18;
    pub const VEIL: usize = 21;
    pub const LOCAL: usize = 22;
    pub const FRAMES: usize = 23;
}

/// View of a photograph, and the orientation of its pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shot {
    pub pose: Pose,
    /// Turned by 180 degrees after capture: the flash lies on the opposite side.
    pub turned: bool,
}

impl Shot {
    /// Sign of the flash offset along the photograph's axes.
    fn sign(&self) -> DVec3 {
        if self.turned { DVec3::new(-1.0, -1.0, 1.0) } else { DVec3::ONE }
    }

    /// The flash in this camera's frame, from the offset shared by all photographs.
    pub fn offset(&self, shared: DVec3) -> DVec3 {
        self.sign() * shared
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ink {
    None,
    Black,
    /// The middle patch.
    Gray,
}

/// One channel of one square.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub frame: usize,
    pub channel: usize,
    pub ink: Ink,
    /// Log of the stored linear value; full scale is 1.
    pub log_stored: f64,
    /// Logarithm of stored value / (exposure * nominal albedo).
    pub log_value: f64,
    pub board_mm: DVec3,
    /// Standard deviation relative to an ordinary square's.
    pub sigma: f64,
    /// Mean of a wide surrounding, in the units of the value; 0 if unknown.
    pub surround: f64,
    /// Log of the surroundings at each scale over the photograph's mean of them.
    pub log_surround: [f64; Surround::SCALES.len()],
}

/// Unknowns with their priors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Problem {
    /// Distance at which the flash's irradiance is 1, mm.
    pub reference_mm: f64,
    /// Start or fixed value of the flash offset in the camera frame, mm.
    pub offset_mm: DVec3,
    /// Prior standard deviation of the offset per axis, mm; zero fixes an axis.
    pub offset_sigma_mm: DVec3,
    /// Prior standard deviation of the ambient share around 0; zero fixes it at 0.
    pub ambient_sigma: f64,
    /// Prior standard deviation of the tone curve's parameters around the identity; zero fixes it.
    pub tone_sigma: f64,
    /// Largest ambient share allowed.
    pub ambient_max: f64,
    /// Width of the Cauchy prior of a photograph's log gain.
    pub gain_width: f64,
    /// Prior standard deviation of the veil share around 0; zero fixes it at 0.
    pub veil_sigma: f64,
    /// Prior standard deviation of the exponent of darkening by bright surroundings; zero fixes it at 0.
    pub local_sigma: f64,
    /// Index of the surroundings' scale.
    pub local_scale: usize,
    /// Prior standard deviation of the lens and flash exponents below their mean.
    pub exponent_sigma_below: f64,
}

impl Default for Problem {
    /// A flash at the camera's centre, linear values through a clean lens.
    fn default() -> Self {
        Self {
            reference_mm: 1.0,
            offset_mm: DVec3::ZERO,
            offset_sigma_mm: DVec3::ZERO,
            ambient_sigma: 0.1,
            tone_sigma: 0.0,
            ambient_max: 0.5,
            gain_width: 0.02,
            veil_sigma: 0.0,
            local_sigma: 0.0,
            local_scale: 0,
            exponent_sigma_below: 2.0,
        }
    }
}

/// Curves of cameras have slopes of 1/2 to 2, and more in highlights.
const TONE_SIGMA: f64 = 0.5;
/// Fingerprints and screen protectors veil some per cent.
const VEIL_SIGMA: f64 = 0.05;
/// HDR and night modes reduce the contrast of large areas.
const LOCAL_SIGMA: f64 = 0.2;

impl Problem {
    /// The problem with a free tone curve.
    pub fn with_tone_curve(&self) -> Self {
        Self { tone_sigma: TONE_SIGMA, ..*self }
    }

    /// The problem with free local tone mapping at a scale of surroundings.
    pub fn with_local_tone(&self, local_scale: usize) -> Self {
        Self { local_sigma: LOCAL_SIGMA, local_scale, ..*self }
    }

    /// The problem with a free veil.
    pub fn with_veil(&self) -> Self {
        Self { veil_sigma: VEIL_SIGMA, ..*self }
    }
}

/// Irradiance of a flash without lobe, relative to that at the reference distance and facing it,
/// with its gradient by the light's position. `None` behind the board.
fn irradiance(light: DVec3, point: DVec3, reference_mm: f64) -> Option<(f64, DVec3)> {
    let v = light - point;
    if v.z <= 0.0 {
        return None;
    }
    let d2 = v.length_squared();
    let k = reference_mm * reference_mm / (d2 * d2.sqrt());
    Some((k * v.z, k * (DVec3::Z - v * (3.0 * v.z / d2))))
}

/// `-ln cos` of the angle at `from` between the optical axis and a point, both in the camera frame,
/// and its gradient by `from`.
fn log_secant(from: DVec3, point: DVec3) -> (f64, DVec3) {
    let w = point - from;
    let d2 = w.length_squared();
    (0.5 * (d2 / (w.z * w.z)).ln(), DVec3::Z / w.z - w / d2)
}

/// Quadrupole of the unit direction from `from` to a point, both in the camera frame: `x² - y²` and
/// `2 x y`, with their gradients by `from`.
fn quadrupole(from: DVec3, point: DVec3) -> ([f64; 2], [DVec3; 2]) {
    let v = point - from;
    let d2 = v.length_squared();
    let values = [(v.x * v.x - v.y * v.y) / d2, 2.0 * v.x * v.y / d2];
    let by_v = [DVec3::new(2.0 * v.x, -2.0 * v.y, 0.0), DVec3::new(2.0 * v.y, 2.0 * v.x, 0.0)];
    let gradient = |i: usize| (v * (2.0 * values[i]) - by_v[i]) / d2;
    (values, [gradient(0), gradient(1)])
}

/// Most parameters of a residual: all, without the tone curve's, and without the veil's too.
const OWN: usize = 17;
const LIGHT: usize = 14;
const VEILED: usize = 13;

/// Deviation of a sample from the model, in logs of stored values.
pub(super) struct Residual {
    pub value: f64,
    derivatives: [(usize, f64); OWN],
    used: usize,
}

impl Residual {
    /// Non-zero derivatives with their parameters.
    pub fn derivatives(&self) -> &[(usize, f64)] {
        &self.derivatives[..self.used]
    }
}

pub(super) struct Model<'a> {
    shots: &'a [Shot],
    problem: &'a Problem,
    theta: &'a DVector<f64>,
    /// `None` for linear values.
    curve: Option<LogCurve>,
}

impl<'a> Model<'a> {
    pub fn new(shots: &'a [Shot], problem: &'a Problem, theta: &'a DVector<f64>) -> Self {
        let log_slopes = std::array::from_fn(|k| theta[parameter::TONE + k]);
        let curve = ToneCurve { log_slopes, ..ToneCurve::default() };
        let curve = (problem.tone_sigma > 0.0).then(|| LogCurve::new(curve));
        Self { shots, problem, theta, curve }
    }

    /// Residual of a sample with its non-zero derivatives; `None` for a light behind the board.
    ///
    /// With a tone curve, the difference of radiances is divided by the curve's slope. Noise acts
    /// on stored values, so a curve that compresses all radiances must not lower it.
    pub fn residual(&self, sample: &Sample) -> Option<Residual> {
        use parameter::{
            AMBIENT, BLACK, CURVATURE, EXPONENT, FRAMES, GRAY, LOBE, LOCAL, LOG_SCALE, OFFSET,
            PATTERN, TONE, VEIL,
        };
        let Self { problem, theta, .. } = self;
        let (c, shot) = (sample.channel, &self.shots[sample.frame]);
        let pose = &shot.pose;
        let offset = DVec3::new(theta[OFFSET], theta[OFFSET + 1], theta[OFFSET + 2]);
        let offset = shot.offset(offset);
        let (g, by_light) =
            irradiance(pose.to_board(offset), sample.board_mm, problem.reference_mm)?;
        let by_light = pose.rotation * by_light; // by the light's position in the camera frame
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
        let (ink, inked) = match sample.ink {
            Ink::None => (BLACK + c, 0.0),
            Ink::Black => (BLACK + c, 1.0),
            Ink::Gray => (GRAY, 1.0),
        };
        let model = theta[LOG_SCALE + c] + theta[frame] + inked * theta[ink] + total.ln()
            - u * (theta[EXPONENT] + u * theta[CURVATURE])
            - theta[LOCAL] * sample.log_surround[problem.local_scale];
        let by_pattern = share * live / pattern;
        let by_offset = share * (by_light / g - theta[LOBE] * u_by_light)
            + by_pattern * (theta[PATTERN] * along_by + theta[PATTERN + 1] * across_by);
        let by_offset = shot.sign() * by_offset;
        let mut residual = Residual {
            value: model - sample.log_value,
            derivatives: [
                (EXPONENT, -u),
                (CURVATURE, -u * u),
                (AMBIENT + c, (1.0 - flash) / total),
                (LOBE, -share * u_light),
                (LOG_SCALE + c, 1.0),
                (OFFSET, by_offset.x),
                (OFFSET + 1, by_offset.y),
                (OFFSET + 2, by_offset.z),
                (ink, inked),
                (PATTERN, by_pattern * along),
                (PATTERN + 1, by_pattern * across),
                (frame, 1.0),
                (LOCAL, -sample.log_surround[problem.local_scale]),
                (VEIL, 0.0),
                (TONE, 0.0),
                (TONE + 1, 0.0),
                (TONE + 2, 0.0),
            ],
            used: VEILED,
        };
        if problem.veil_sigma > 0.0 && sample.surround > 0.0 {
            residual.veil(model, theta[VEIL], sample);
        }
        if let Some(curve) = &self.curve {
            residual.put_on(&curve.at(sample.log_stored));
        }
        Some(residual)
    }
}

impl Residual {
    /// Replaces a share of the square's light by that of its surroundings.
    fn veil(&mut self, model: f64, share: f64, sample: &Sample) {
        self.used = LIGHT;
        let clear = model.exp();
        let veiled = (1.0 - share) * clear + share * sample.surround;
        let kept = (1.0 - share) * clear / veiled;
        for (_, derivative) in &mut self.derivatives[..VEILED] {
            *derivative *= kept;
        }
        self.derivatives[VEILED].1 = (sample.surround - clear) / veiled;
        self.value = veiled.ln() - sample.log_value;
    }

    fn put_on(&mut self, lift: &Lift) {
        self.used = OWN;
        for (k, by) in lift.by_parameters.into_iter().enumerate() {
            self.derivatives[LIGHT + k].1 = -by;
        }
        self.value = (self.value - lift.log_gain) / lift.slope;
        for (_, derivative) in &mut self.derivatives {
            *derivative /= lift.slope;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    /// Compares the derivatives with central differences.
    #[test]
    fn derivatives_match_finite_differences() {
        let pose = Pose {
            rotation: DMat3::from_rotation_x(std::f64::consts::PI - 0.4),
            translation: DVec3::new(4.0, -3.0, 250.0),
        };
        let mut theta = DVector::zeros(parameter::FRAMES + 3);
        let values = [
            3.0, -1.0, 0.1, 0.05, 0.2, 0.4, 0.2, 0.1, 8.0, -5.0, 1.0, 0.0, 0.1, 0.0, 1.7, 0.4,
            -0.3, 0.2, 0.4, -0.3, 0.6, 0.05, 0.1, 0.0, 0.02, 0.0,
        ];
        for (i, v) in values.into_iter().enumerate() {
            theta[i] = v;
        }
        for (ink, tone_sigma, veil_sigma, turned) in [
            (Ink::Black, 0.0, 0.1, false),
            (Ink::None, 0.5, 0.0, true),
            (Ink::Gray, 0.5, 0.1, false),
            (Ink::None, 0.0, 0.1, true),
        ] {
            let shots = [Shot { pose, turned }];
            let problem = Problem {
                reference_mm: 240.0,
                offset_mm: DVec3::ZERO,
                offset_sigma_mm: DVec3::ONE,
                ambient_sigma: 0.1,
                tone_sigma,
                veil_sigma,
                local_sigma: 0.1,
                local_scale: 2,
                ..Problem::default()
            };
            let at = |theta: &DVector<f64>, log_value| {
                let board_mm = DVec3::new(-60.0, 45.0, 0.0);
                let (frame, channel, log_stored, sigma) = (0, 1, -1.3, 1.0);
                let surround = 0.4;
                let sample = Sample {
                    frame,
                    channel,
                    ink,
                    log_stored,
                    log_value,
                    board_mm,
                    sigma,
                    surround,
                    log_surround: [0.2, 0.3, 0.4],
                };
                Model::new(&shots, &problem, theta).residual(&sample).unwrap()
            };
            // Residual 0, because its derivatives omit the change of the curve's slope.
            let (a, b) = (at(&theta, 0.0).value, at(&theta, 1.0).value);
            let log_value = a / (a - b);
            for &(i, analytic) in at(&theta, log_value).derivatives() {
                let h = 1e-5;
                let shifted = |d: f64| {
                    let mut shifted = theta.clone();
                    shifted[i] += d;
                    at(&shifted, log_value).value
                };
                let numeric = (shifted(h) - shifted(-h)) / (2.0 * h);
                // Tolerance of central differences in f64: rounding 1e-16 / h, truncation h².
                assert!((numeric - analytic).abs() < 1e-8, "{ink:?} {i}: {numeric} {analytic}");
            }
        }
    }
}
