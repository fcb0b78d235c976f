//! Leave-one-out predictions of photographs.

use glam::{DVec3, Vec3};
use nalgebra::{SMatrix, SVector};

use crate::Result;
use crate::Svbrdf;
use crate::estimate::coordinates::{by_coordinate, natural, to_coordinate};
use crate::estimate::options::NoiseOptions;
use crate::estimate::{Noise, Prior, Solver};
use crate::loss::EPSILON;
use crate::observation::{Observation, View};
use crate::parallel;
use crate::render::PointView;
use crate::statistics::MAD_TO_SIGMA;
use crate::svbrdf::{CHANNELS, LOBES, channel};

/// Wide prior of the cells round the current maps, so that the photographs decide, not the fit to earlier
/// ones.
const PRIOR: Prior = Prior { sigma: [0.1, 0.1, 0.3, 0.3, 0.3, 0.1, 0.1, 0.1, 0.2] };
/// Log residual of the model's error in a cell.
const NOISE: f64 = 0.03;
/// Standard deviation of a highlight, as a share of it: a cell mixes normals and gloss of many texels.
const HIGHLIGHT_ERROR: f64 = 0.5;
/// Steps of each fit to the cells.
const STEPS: usize = 8;
/// A photograph may show a highlight that no other shows if its half vector is nearer to the sample's normal
/// than all others' by this angle, radians.
const NEARER: f64 = 0.035;

/// Difference between a cell of a photograph and its prediction from all other photographs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deviation {
    /// Logarithm of measured over predicted radiance, mean of the colours.
    pub log: f32,
    /// Root mean square of the colours' logarithms, in expected standard deviations.
    pub sigmas: f32,
    /// Share of the highlight in the predicted radiance.
    pub highlight: f32,
}

/// The cells of all photographs; `None` where a photograph has weight 0 or cannot be judged.
#[derive(Debug, Clone)]
pub(super) struct Deviations {
    pub photographs: Vec<Vec<Option<Deviation>>>,
    /// Cells that are no longer judged.
    forgotten: Vec<Vec<bool>>,
}

impl Deviations {
    /// Stops judging these cells.
    pub fn forget(&mut self, cells: &[bool]) {
        for (photograph, forgotten) in self.photographs.iter_mut().zip(&mut self.forgotten) {
            for cell in (0..cells.len()).filter(|&cell| cells[cell]) {
                (photograph[cell], forgotten[cell]) = (None, true);
            }
        }
    }

    /// These deviations without the cells that `earlier` no longer judges.
    pub fn without_forgotten(mut self, earlier: &Self) -> Self {
        for (i, forgotten) in earlier.forgotten.iter().enumerate() {
            for cell in (0..forgotten.len()).filter(|&cell| forgotten[cell]) {
                self.photographs[i][cell] = None;
            }
        }
        Self { forgotten: earlier.forgotten.clone(), ..self }
    }
}

/// Deviations of each photograph from its prediction.
pub(super) fn deviations(
    maps: &Svbrdf,
    photographs: &[Observation],
    options: &NoiseOptions,
) -> Result<Deviations> {
    let of_all = fitted(maps, photographs, options)?;
    let each =
        parallel::map(photographs.len(), |i| left_out(maps, &of_all, photographs, i, options));
    let each = each.into_iter().collect::<Result<Vec<_>>>()?;
    // All photographs share errors of model and light.
    let mut all: Vec<f32> = each.iter().flatten().flatten().map(|raw| raw.rms).collect();
    let middle = all.len() / 2;
    let usual = match all.is_empty() {
        true => 0.0,
        false => MAD_TO_SIGMA as f32 * *all.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    let deviation = |raw: Raw| Deviation {
        log: raw.log,
        highlight: raw.highlight,
        sigmas: raw.rms / (raw.variance + usual * usual + (NOISE * NOISE) as f32).sqrt(),
    };
    let photographs: Vec<Vec<Option<Deviation>>> = each
        .into_iter()
        .map(|cells| cells.into_iter().map(|c| c.map(deviation)).collect())
        .collect();
    let forgotten = photographs.iter().map(|cells| vec![false; cells.len()]).collect();
    Ok(Deviations { photographs, forgotten })
}

/// A deviation and the variance of its prediction.
#[derive(Debug, Clone, Copy)]
struct Raw {
    log: f32,
    rms: f32,
    variance: f32,
    highlight: f32,
}

/// Maps of the cells, fitted to photographs.
fn fitted(mean: &Svbrdf, photographs: &[Observation], options: &NoiseOptions) -> Result<Svbrdf> {
    let mut maps = mean.clone();
    let noise = Noise { scale: NOISE as f32, huber: options.huber };
    let mut solver = Solver::new(&mut maps, photographs, &PRIOR, noise)?;
    for _ in 0..STEPS {
        solver.step(&mut maps, mean, photographs)?;
    }
    Ok(maps)
}

fn left_out(
    mean: &Svbrdf,
    of_all: &Svbrdf,
    photographs: &[Observation],
    index: usize,
    options: &NoiseOptions,
) -> Result<Vec<Option<Raw>>> {
    let others: Vec<Observation> = photographs
        .iter()
        .enumerate()
        .filter(|(i, _)| *i != index)
        .map(|(_, o)| o.clone())
        .collect();
    let maps = fitted(mean, &others, options)?;
    let lit: Vec<PointView> = others.iter().map(|o| PointView::new(&o.view)).collect();
    let photograph = &photographs[index];
    let own = PointView::new(&photograph.view);
    let cell = |t: usize| {
        if photograph.weight(t) <= 0.0 {
            return None;
        }
        let (width, height) = (maps.width(), maps.height());
        let place = photograph.view.texel_mm(width, height, t % width, t / width).map(f64::from);
        let point = Point::new(&maps, t, place);
        let mut information =
            Matrix::from_diagonal(&Coordinates::from_fn(|c, _| f64::from(PRIOR.sigma[c]).powi(-2)));
        for (other, lit) in others.iter().zip(&lit) {
            let weight = f64::from(other.weight(t)) / (NOISE * NOISE);
            let (rendered, jacobian) = logarithms(lit, &point);
            for c in 0..3 {
                let counts =
                    other.radiance(c, t) >= 0.0 || rendered[c] < f64::from(-other.radiance(c, t));
                let row = jacobian.row(c);
                information += row.transpose() * row * if counts { weight } else { 0.0 };
            }
        }
        let (rendered, jacobian) = logarithms(&own, &point);
        let covariance = information.cholesky()?.inverse();
        let variance = (jacobian * covariance * jacobian.transpose()).trace() / 3.0;
        let predicted = highlight(&own, &point);
        let highlight = predicted.max(highlight(&own, &Point::new(of_all, t, place)));
        let variance = variance + (HIGHLIGHT_ERROR * highlight).powi(2);
        let log = std::array::from_fn::<f64, 3, _>(|c| {
            let measured = f64::from(photograph.radiance(c, t));
            let log =
                ((measured.abs() + f64::from(EPSILON)) / (rendered[c] + f64::from(EPSILON))).ln();
            // A saturated value is a lower bound.
            if measured < 0.0 { log.max(0.0) } else { log }
        });
        let rms = (log.iter().map(|v| v * v).sum::<f64>() / 3.0).sqrt();
        let mean = log.iter().sum::<f64>() / 3.0;
        let seeing = others.iter().filter(|other| other.weight(t) > 0.0);
        let nearest = seeing.map(|o| tilt(&o.view, place)).fold(f64::INFINITY, f64::min);
        if mean > 0.0 && tilt(&photograph.view, place) < nearest - NEARER {
            return None;
        }
        let [log, rms, variance, highlight] = [mean, rms, variance, predicted].map(|v| v as f32);
        let raw = Raw { log, rms, variance, highlight };
        (raw.rms.is_finite() && raw.variance.is_finite()).then_some(raw)
    };
    Ok((0..maps.texels()).map(cell).collect())
}

/// Angle between the half vector at a place and the sample's normal.
fn tilt(view: &View, [x, y]: [f64; 2]) -> f64 {
    let towards =
        |to: [f32; 3]| (Vec3::from(to).as_dvec3() - DVec3::new(x, y, 0.0)).normalize_or_zero();
    (towards(view.camera_mm) + towards(view.light_mm)).normalize_or_zero().z.clamp(-1.0, 1.0).acos()
}

/// Coordinates and optional lobes of a texel.
struct Point {
    at: [f64; CHANNELS],
    lobes: [f64; LOBES],
    place: [f64; 2],
}

impl Point {
    fn new(maps: &Svbrdf, texel: usize, place: [f64; 2]) -> Self {
        let at = std::array::from_fn(|c| f64::from(to_coordinate(c, maps.plane(c)[texel])));
        Self { at, lobes: maps.lobes_at(texel), place }
    }
}

/// The highlight's share of the radiance.
fn highlight(view: &PointView, point: &Point) -> f64 {
    let mut without = natural(&point.at);
    without[channel::SPECULAR..][..3].fill(0.0);
    let sum = |parameters| view.value(parameters, &point.lobes, point.place).iter().sum::<f64>();
    1.0 - (sum(&without) / sum(&natural(&point.at)).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

type Coordinates = SVector<f64, CHANNELS>;
type Matrix = SMatrix<f64, CHANNELS, CHANNELS>;

/// Radiances, and derivatives of their logarithms by the coordinates.
fn logarithms(view: &PointView, point: &Point) -> ([f64; 3], SMatrix<f64, 3, CHANNELS>) {
    let Point { at, lobes, place } = point;
    let radiance = view.radiance(&natural(at), lobes, *place);
    let scale = radiance.value.map(|v| (v.max(0.0) + f64::from(EPSILON)).recip());
    let by = |c: usize, p: usize| radiance.jacobian[c][p] * by_coordinate(at, p) * scale[c];
    (radiance.value.map(|v| v.max(0.0)), SMatrix::from_fn(by))
}
