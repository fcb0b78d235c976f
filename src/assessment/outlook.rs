//! Expected gain of a further photograph: the reduction of the expected error of renderings.
//!
//! Each texel of a coarse grid has the covariance of its quadratic posterior. A photograph adds precision
//! where its residuals depend on the coordinates. The expected squared error of renderings is the trace of
//! the covariance times the mean squared derivatives of renderings from random directions. A new view may
//! reveal a highlight where the maps have none. Therefore the model is linearised at one sample of each
//! texel's posterior, not at the maps; the sum over texels approximates the expectation.

use nalgebra::{SMatrix, SVector};

use crate::estimate::Estimation;
use crate::estimate::coordinates::{by_coordinate, natural, range, to_coordinate};
use crate::loss::EPSILON;
use crate::observation::{Falloff, Observation, View};
use crate::parallel;
use crate::random::Random;
use crate::render::{PointView, Radiance};
use crate::svbrdf::halved;
use crate::svbrdf::{CHANNELS, LOBES};
use crate::{Error, Result, Svbrdf};

type Coordinates = SVector<f64, CHANNELS>;
type Matrix = SMatrix<f64, CHANNELS, CHANNELS>;
/// Derivatives of three colours by the coordinates.
type Jacobian = SMatrix<f64, 3, CHANNELS>;

/// Largest number of texels along the longer side. More change a view's gain, a sum over texels, by less than
/// 2 %.
const TEXELS: usize = 24;
/// Angle between views below which they share errors of the model, so that the second adds little, degrees.
const APART_DEG: f64 = 10.0;
/// Log residual of noise and errors of the model.
const NOISE: f64 = 0.03;
/// Renderings that maps are compared in; more change nothing.
const RENDERINGS: usize = 16;
/// Largest angle of their cameras and lights to the vertical, degrees.
const TILT_DEG: f64 = 70.0;
/// Texels per task.
const CHUNK: usize = 32;
/// Seed of posterior samples and renderings.
const SEED: u64 = 0x0071_0012;

/// A place to take a photograph from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Camera centre, mm, board frame.
    pub camera_mm: [f32; 3],
    /// Light position, mm, board frame.
    pub light_mm: [f32; 3],
}

/// A texel's posterior at the current maps.
struct Texel {
    at: Coordinates,
    lobes: [f64; LOBES],
    place: [f64; 2],
    covariance: Matrix,
    /// The covariance times the mean squared derivatives of renderings times the covariance.
    weighed: Matrix,
    /// Expected squared error of renderings.
    error: f64,
}

impl Estimation {
    /// Fraction, 0 to 1, by which a photograph from each place would lower the expected squared error of
    /// renderings. Places of camera and light are uncorrected, mm. The rest of the view is that of the latest
    /// photograph.
    ///
    /// # Errors
    /// Without photographs.
    pub fn outlook(&self, places: &[Place]) -> Result<Vec<f64>> {
        let photographs = self.photographs.working();
        let halvings = photographs.halvings_to(TEXELS);
        let observations = photographs.level(halvings);
        let first = observations.first().ok_or(Error::NoMaps)?;
        let maps = self.maps()?.strided(self.photographs.stride_log2());
        let maps = halved(&maps, halvings, Svbrdf::downsampled);
        let exposure = &photographs.correction().exposure;
        let last = photographs.given().last().ok_or(Error::NoMaps)?;
        let view = |&Place { camera_mm, light_mm }: &Place| {
            exposure.predict(&View { camera_mm, light_mm, ..*last })
        };
        let views: Vec<View> = places.iter().map(view).collect();
        let renderings = renderings(&first.view);
        let sigma = self.options.prior.sigma;
        let prior =
            Matrix::from_diagonal(&Coordinates::from_fn(|c, _| f64::from(sigma[c]).powi(-2)));
        let starts: Vec<usize> = (0..maps.texels()).step_by(CHUNK).collect();
        let sums = parallel::map_parts(starts.iter(), |_, &from| {
            let mut sums = vec![0.0; views.len() + 1];
            let mut random = Random::new(SEED + from as u64);
            for t in from..(from + CHUNK).min(maps.texels()) {
                let Some(texel) = Texel::new(&maps, t, &observations, &renderings, &prior) else {
                    continue;
                };
                sums[views.len()] += texel.error;
                let sampled = texel.sampled(&mut random);
                for (sum, view) in sums.iter_mut().zip(&views) {
                    *sum += texel.gain(&sampled, view);
                }
            }
            sums
        });
        let mut total = vec![0.0; views.len() + 1];
        for part in sums {
            total.iter_mut().zip(part).for_each(|(a, b)| *a += b);
        }
        let all = total.pop().unwrap_or_default().max(f64::MIN_POSITIVE);
        let given = photographs.given();
        let gains = total.into_iter().zip(&views);
        Ok(gains.map(|(gain, view)| gain / all * novelty(view, given)).collect())
    }
}

impl Texel {
    fn new(
        maps: &Svbrdf,
        t: usize,
        observations: &[Observation],
        renderings: &[View],
        prior: &Matrix,
    ) -> Option<Self> {
        let at = Coordinates::from_fn(|c, _| f64::from(to_coordinate(c, maps.plane(c)[t])));
        let (width, height) = (maps.width(), maps.height());
        let place = observations[0].view.texel_mm(width, height, t % width, t / width);
        let place = place.map(f64::from);
        let lobes = maps.lobes_at(t);
        let mut information = *prior;
        for observation in observations {
            let weight = f64::from(observation.weight(t));
            let (rendered, mut jacobian) =
                radiance(&PointView::new(&observation.view), &at, &lobes, place);
            for c in 0..3 {
                let observed = observation.radiance(c, t);
                // A saturated value that the rendering reaches is no constraint.
                let counts = observed >= 0.0 || rendered[c] < f64::from(-observed);
                let scale = weight.sqrt() * by_log(rendered[c]);
                jacobian.row_mut(c).scale_mut(if counts { scale } else { 0.0 });
            }
            information += jacobian.transpose() * jacobian;
        }
        let covariance = information.cholesky()?.inverse();
        let mut appearance = Matrix::zeros();
        for view in renderings {
            let (rendered, mut jacobian) = radiance(&PointView::new(view), &at, &lobes, place);
            for c in 0..3 {
                // Renderings are clipped at white.
                jacobian.row_mut(c).scale_mut(rendered[c].max(1.0).recip());
            }
            appearance += jacobian.transpose() * jacobian / renderings.len() as f64;
        }
        let weighed = covariance * appearance * covariance;
        let error = (appearance * covariance).trace();
        Some(Self { at, lobes, place, covariance, weighed, error })
    }

    /// A sample of the posterior.
    fn sampled(&self, random: &mut Random) -> Coordinates {
        let noise = Coordinates::from_fn(|_, _| random.bell());
        let by = self.covariance.cholesky().map_or(Coordinates::zeros(), |root| root.l() * noise);
        Coordinates::from_fn(|c, _| {
            let (low, high) = range(c);
            (self.at[c] + by[c]).clamp(low, high)
        })
    }

    /// Reduction of the expected squared error by a view if the texel is at `at`.
    fn gain(&self, at: &Coordinates, view: &View) -> f64 {
        let (rendered, mut jacobian) = radiance(&PointView::new(view), at, &self.lobes, self.place);
        for c in 0..3 {
            jacobian.row_mut(c).scale_mut(by_log(rendered[c]));
        }
        let weight = foreshortening(view, self.place).max(1e-3);
        let mut known = jacobian * self.covariance * jacobian.transpose();
        for c in 0..3 {
            known[(c, c)] += weight.recip();
        }
        let gained = jacobian * self.weighed * jacobian.transpose();
        known.cholesky().map_or(0.0, |known| known.solve(&gained).trace())
    }
}

/// Share of a view's information that earlier views do not have, because views that are close share errors of
/// the model.
fn novelty(view: &View, earlier: &[View]) -> f64 {
    let direction = |view: &View| towards(view.camera_mm, [0.0; 2]).0;
    let angles = earlier.iter().map(|other| direction(view).angle_between(direction(other)));
    let nearest = angles.fold(f64::INFINITY, f64::min).to_degrees();
    1.0 - (-(nearest / APART_DEG).powi(2)).exp()
}

/// Derivative of a log residual by the radiance, in units of the noise.
fn by_log(rendered: f64) -> f64 {
    ((rendered.max(0.0) + f64::from(EPSILON)) * NOISE).recip()
}

/// Random views that renderings are compared in.
fn renderings(like: &View) -> Vec<View> {
    let mut random = Random::new(SEED);
    let distance = norm(like.camera_mm);
    let limit = TILT_DEG.to_radians();
    let mut place = || random.direction(limit).map(|v| (v * f64::from(distance)) as f32);
    let power = [std::f32::consts::PI; 3];
    (0..RENDERINGS)
        .map(|_| View {
            camera_mm: place(),
            light_mm: place(),
            falloff: Falloff::None { power },
            ambient: [0.0; 3],
            ..*like
        })
        .collect()
}

fn norm(v: [f32; 3]) -> f32 {
    v.iter().map(|v| v * v).sum::<f32>().sqrt()
}

/// Unit vector from a place on the sample to a point, and its distance.
fn towards(to: [f32; 3], [x, y]: [f64; 2]) -> (glam::DVec3, f64) {
    let offset = glam::Vec3::from(to).as_dvec3() - glam::DVec3::new(x, y, 0.0);
    let distance = offset.length().max(1e-6);
    (offset / distance, distance)
}

fn foreshortening(view: &View, place: [f64; 2]) -> f64 {
    towards(view.camera_mm, place).0.z
}

/// Radiances of a texel and their derivatives by its coordinates.
fn radiance(
    view: &PointView,
    at: &Coordinates,
    lobes: &[f64; LOBES],
    place: [f64; 2],
) -> ([f64; 3], Jacobian) {
    let x: [f64; CHANNELS] = (*at).into();
    let Radiance { value, jacobian, .. } = view.radiance(&natural(&x), lobes, place);
    (value, Jacobian::from_fn(|c, p| jacobian[c][p] * by_coordinate(&x, p)))
}
