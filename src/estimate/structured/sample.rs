//! Photographs at a few texels, as the structured fit sees them.

use std::borrow::Cow;

use glam::DVec3;

use super::groups::Feature;
use crate::estimate::correction::Correction;
use crate::estimate::photographs::Photographs;
use crate::estimate::prior::{MIN_ROOT, is_albedo, to_coordinate};
use crate::loss::{EPSILON, log_residual};
use crate::observation::{Falloff, Observation, View};
use crate::parallel;
use crate::reflectance::reflect;
use crate::svbrdf::{CHANNELS, RANGE, Svbrdf, channel};

/// Coordinates of a texel: slopes, square roots of albedos, roughness.
pub(super) type Coordinates = [f64; CHANNELS];

/// One photograph at the sample's texels.
#[derive(Debug, Clone)]
pub(super) struct Photograph {
    pub view: View,
    /// Three planes of radiances, negative where saturated.
    pub radiance: Vec<f32>,
    pub weight: Vec<f32>,
}

/// A grid of texels with all photographs.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// Texel centres, mm.
    pub places: Vec<[f64; 2]>,
    pub photographs: Vec<Photograph>,
    observations: Vec<Observation>,
}

impl Sample {
    /// Photographs halved until they have at most `averaged` texels along the longer side, and of
    /// those a grid of at most `side`; their views as given.
    pub fn new(photographs: &Photographs, averaged: usize, side: usize) -> Self {
        let halvings = photographs.halvings_to(averaged);
        let stride = 1 << photographs.halvings_to(side).saturating_sub(halvings);
        let mut observations = photographs.level(halvings);
        if stride > 1 {
            observations = observations.iter().map(|o| o.strided(stride)).collect();
        }
        let (width, height) = observations.first().map_or((1, 1), |o| (o.width(), o.height()));
        let photograph = |(o, view): (&Observation, &View)| {
            let n = o.texels();
            Photograph {
                view: *view,
                radiance: (0..3 * n).map(|i| o.radiance(i / n, i % n)).collect(),
                weight: (0..n).map(|t| o.weight(t)).collect(),
            }
        };
        let given = photographs.given();
        let place = |t: usize| {
            let mm = |v: &View| v.texel_mm(width, height, t % width, t / width).map(f64::from);
            given.first().map_or([0.0; 2], mm)
        };
        Self {
            places: (0..width * height).map(place).collect(),
            photographs: observations.iter().zip(given).map(photograph).collect(),
            observations: observations.into_owned(),
        }
    }

    /// Colours of the texels as some of the photographs show them, see [`colours`].
    pub fn colours(&self, which: &[usize]) -> Vec<Feature> {
        let observations: Vec<_> = which.iter().map(|&i| self.observations[i].clone()).collect();
        let given: Vec<_> = which.iter().map(|&i| self.photographs[i].view).collect();
        colours(&observations, &given)
    }

    pub fn texels(&self) -> usize {
        self.places.len()
    }

    /// Coordinates of maps of the photographs' size, averaged as the sample's texels are.
    pub fn coordinates(&self, maps: &Svbrdf) -> Vec<Coordinates> {
        let width = self.observations.first().map_or(1, Observation::width);
        let mut maps = Cow::Borrowed(maps);
        while maps.width() > width {
            maps = Cow::Owned(maps.downsampled());
        }
        let at = |t: usize, c: usize| f64::from(to_coordinate(c, maps.plane(c)[t]));
        (0..self.texels()).map(|t| std::array::from_fn(|c| at(t, c))).collect()
    }
}

/// What texels' colours are without highlights, as roots of albedos: of what the photographs show of
/// each, taken for diffuse and flat, that at a third of their order from the darkest.
pub(super) fn colours(observations: &[Observation], given: &[View]) -> Vec<Feature> {
    let Some(first) = observations.first() else { return Vec::new() };
    let (width, height) = (first.width(), first.height());
    let lights: Vec<Lit> = given.iter().map(Lit::new).collect();
    parallel::values(width * height, |t| {
        let place = given[0].texel_mm(width, height, t % width, t / width).map(f64::from);
        let seen = observations.iter().zip(&lights).filter(|(o, _)| o.weight(t) > 0.0);
        let mut all: Vec<Feature> =
            seen.map(|(o, light)| root_albedo(o, light, t, place)).collect();
        let rank = all.len().saturating_sub(1) / 3;
        [0, 1, 2].map(|c| {
            all.sort_by(|a, b| a[c].total_cmp(&b[c]));
            all.get(rank).map_or(UNSEEN, |f| f[c])
        })
    })
}

/// Root albedo of texels that no photograph shows.
const UNSEEN: f32 = 0.4;

fn root_albedo(observation: &Observation, light: &Lit, t: usize, place: [f64; 2]) -> Feature {
    let white = light.white(place);
    std::array::from_fn(|c| {
        let albedo = f64::from(observation.radiance(c, t).abs()) / white[c].max(1e-9);
        albedo.clamp(1e-4, 1.0).sqrt() as f32
    })
}

/// A corrected view in double precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit {
    camera: DVec3,
    light: DVec3,
    power: [f64; 3],
    inverse_square: bool,
    ambient: [f64; 3],
    mirrored: f64,
}

/// Radiances of a texel and their derivatives by its natural parameters.
pub(super) struct Radiance {
    pub value: [f64; 3],
    pub jacobian: [[f64; CHANNELS]; 3],
}

impl Lit {
    pub fn new(view: &View) -> Self {
        let (power, inverse_square) = match view.falloff {
            Falloff::None { power } => (power, false),
            Falloff::InverseSquare { power_mm2 } => (power_mm2, true),
        };
        let vector = |v: [f32; 3]| glam::Vec3::from(v).as_dvec3();
        Self {
            camera: vector(view.camera_mm),
            light: vector(view.light_mm),
            power: power.map(f64::from),
            inverse_square,
            ambient: view.ambient.map(f64::from),
            mirrored: f64::from(view.mirrored),
        }
    }

    /// Of photograph `index` of a fit.
    pub fn with(view: &View, correction: &Correction, index: usize) -> Self {
        Self::new(&correction.apply(view, index))
    }

    pub fn moved(mut self, axis: usize, by: f64) -> Self {
        self.light[axis] += by;
        self
    }

    fn irradiance(&self, offset: DVec3) -> f64 {
        if self.inverse_square { offset.length_squared().max(1e-6).recip() } else { 1.0 }
    }

    /// Radiance of a flat white texel.
    fn white(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let to_light = self.light - DVec3::new(x, y, 0.0);
        let cosine = (to_light.z / to_light.length().max(1e-6)).max(1e-3);
        let shared = cosine * self.irradiance(to_light) / std::f64::consts::PI;
        self.power.map(|p| p * shared)
    }

    pub fn radiance(&self, natural: &[f64; CHANNELS], [x, y]: [f64; 2]) -> Radiance {
        let at = DVec3::new(x, y, 0.0);
        let (to_light, to_camera) = (self.light - at, self.camera - at);
        let irradiance = self.irradiance(to_light);
        let (l, v) = (to_light.normalize().to_array(), to_camera.normalize().to_array());
        let mut reflection = reflect(natural, l, v);
        for c in 0..3 {
            let e = irradiance * self.power[c];
            reflection.jacobian[c].iter_mut().for_each(|d| *d *= e);
            let (d, s) = (channel::DIFFUSE + c, channel::SPECULAR + c);
            let mirrored = self.ambient[c] * self.mirrored;
            reflection.jacobian[c][d] += self.ambient[c];
            reflection.jacobian[c][s] += mirrored;
            reflection.value[c] =
                e * reflection.value[c] + self.ambient[c] * natural[d] + mirrored * natural[s];
        }
        Radiance { value: reflection.value, jacobian: reflection.jacobian }
    }
}

/// Range of a coordinate.
pub(super) fn range(c: usize) -> (f64, f64) {
    let (low, high) = (f64::from(RANGE[c].0), f64::from(RANGE[c].1));
    match c {
        channel::ROUGHNESS => (MIN_ROUGHNESS, high),
        _ if is_albedo(c) => (f64::from(MIN_ROOT), high.sqrt()),
        _ => (low, high),
    }
}

/// Least roughness that a few texels can tell.
const MIN_ROUGHNESS: f64 = 0.06;

/// Natural parameters of coordinates.
pub(super) fn natural(x: &Coordinates) -> [f64; CHANNELS] {
    std::array::from_fn(|c| if is_albedo(c) { x[c] * x[c] } else { x[c] })
}

/// Log residual of a rendering, and whether it says anything: a saturated value that is explained
/// does not.
pub(super) fn residual(rendered: f64, observed: f32) -> (f64, bool) {
    let observed = f64::from(observed);
    let residual = log_residual(rendered.max(0.0), observed);
    (residual, observed >= 0.0 || residual < 0.0)
}

/// `1 / (rendered + 0.01)`.
pub(super) fn by_log(rendered: f64) -> f64 {
    (rendered.max(0.0) + f64::from(EPSILON)).recip()
}
