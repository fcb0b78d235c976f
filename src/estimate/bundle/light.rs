//! Radiance of a texel under a corrected view, in double precision.

use glam::DVec3;

use crate::estimate::prior::{Coordinates, is_albedo, range};
use crate::loss::EPSILON;
use crate::observation::{Falloff, View};
use crate::reflectance::reflect;
use crate::svbrdf::{CHANNELS, channel};

/// A view in double precision.
#[derive(Debug, Clone, Copy)]
pub(in crate::estimate) struct Lit {
    camera: DVec3,
    light: DVec3,
    power: [f64; 3],
    inverse_square: bool,
    ambient: [f64; 3],
    mirrored: f64,
}

/// Radiances of a texel and their derivatives.
pub(in crate::estimate) struct Radiance {
    pub value: [f64; 3],
    /// By the natural parameters.
    pub jacobian: [[f64; CHANNELS]; 3],
    /// By the place of the light, 1/mm.
    pub by_place: [[f64; 3]; 3],
    /// By its power.
    pub by_power: [f64; 3],
}

/// How a view changes with a parameter.
pub(super) struct Change {
    place: [f64; 3],
    power: [f64; 3],
    /// Of ambient light, and of what of it is mirrored.
    ambient: [f64; 3],
    mirrored: [f64; 3],
}

impl Change {
    /// Of two views, of which one is `by` before and one `by` after.
    pub fn between(before: &Lit, after: &Lit, by: f64) -> Self {
        let slope = |of: fn(&Lit) -> [f64; 3]| {
            let (before, after) = (of(before), of(after));
            std::array::from_fn(|i| (after[i] - before[i]) / (2.0 * by))
        };
        Self {
            place: slope(|l| l.light.to_array()),
            power: slope(|l| l.power),
            ambient: slope(|l| l.ambient),
            mirrored: slope(|l| l.ambient.map(|a| a * l.mirrored)),
        }
    }

    /// The derivatives of a texel's radiances.
    pub fn of(&self, here: &Radiance, natural: &[f64; CHANNELS]) -> [f64; 3] {
        std::array::from_fn(|c| {
            let [diffuse, specular] = [channel::DIFFUSE, channel::SPECULAR].map(|m| natural[m + c]);
            let place = here.by_place[c].iter().zip(self.place).map(|(by, d)| by * d).sum::<f64>();
            let room = diffuse * self.ambient[c] + specular * self.mirrored[c];
            place + here.by_power[c] * self.power[c] + room
        })
    }
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

    fn irradiance(&self, offset: DVec3) -> f64 {
        if self.inverse_square { offset.length_squared().max(1e-6).recip() } else { 1.0 }
    }

    /// Radiance of a flat white texel.
    pub fn white(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let to_light = self.light - DVec3::new(x, y, 0.0);
        let cosine = (to_light.z / to_light.length().max(1e-6)).max(1e-3);
        let shared = cosine * self.irradiance(to_light) / std::f64::consts::PI;
        self.power.map(|p| p * shared)
    }

    /// Radiances alone: with [`Lit::radiance`] inlined, what only derivatives need is left out.
    pub fn value(&self, natural: &[f64; CHANNELS], place: [f64; 2]) -> [f64; 3] {
        self.radiance(natural, place).value
    }

    #[inline(always)]
    pub fn radiance(&self, natural: &[f64; CHANNELS], [x, y]: [f64; 2]) -> Radiance {
        let at = DVec3::new(x, y, 0.0);
        let (to_light, to_camera) = (self.light - at, self.camera - at);
        let (irradiance, distance) = (self.irradiance(to_light), to_light.length());
        let (l, v) = (to_light / distance, to_camera.normalize().to_array());
        let mut reflection = reflect(natural, l.to_array(), v);
        let by_power = reflection.value.map(|value| irradiance * value);
        let fall = if self.inverse_square { 2.0 } else { 0.0 };
        let mut by_place = [[0.0; 3]; 3];
        for c in 0..3 {
            let e = irradiance * self.power[c];
            let by_light = DVec3::from(reflection.by_light[c]);
            let along = by_light.dot(l) + fall * reflection.value[c];
            by_place[c] = (e / distance * (by_light - along * l)).to_array();
            reflection.jacobian[c].iter_mut().for_each(|d| *d *= e);
            let (d, s) = (channel::DIFFUSE + c, channel::SPECULAR + c);
            let mirrored = self.ambient[c] * self.mirrored;
            reflection.jacobian[c][d] += self.ambient[c];
            reflection.jacobian[c][s] += mirrored;
            reflection.value[c] =
                e * reflection.value[c] + self.ambient[c] * natural[d] + mirrored * natural[s];
        }
        Radiance { value: reflection.value, jacobian: reflection.jacobian, by_place, by_power }
    }
}

/// Natural parameters of coordinates.
pub(in crate::estimate) fn natural(x: &Coordinates) -> [f64; CHANNELS] {
    std::array::from_fn(|c| if is_albedo(c) { x[c] * x[c] } else { x[c] })
}

/// Derivative of a natural parameter by its coordinate.
pub(in crate::estimate) fn by_coordinate(x: &Coordinates, c: usize) -> f64 {
    if is_albedo(c) { 2.0 * x[c] } else { 1.0 }
}

/// `1 / (rendered + 0.01)`.
pub(super) fn by_log(rendered: f64) -> f64 {
    (rendered.max(0.0) + f64::from(EPSILON)).recip()
}

/// A coordinate within its range.
pub(super) fn clamped(c: usize, x: f64) -> f64 {
    let (low, high) = range(c);
    x.clamp(low, high)
}
