//! Radiance of single texels, in double precision.

use glam::DVec3;

use crate::observation::{Falloff, View};
use crate::reflectance::reflect;
use crate::svbrdf::{CHANNELS, LOBES, channel};

/// A view in double precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointView {
    camera: DVec3,
    light: DVec3,
    power: [f64; 3],
    inverse_square: bool,
    ambient: [f64; 3],
    mirrored: f64,
}

/// Radiances of a texel and their derivatives by its natural parameters.
pub(crate) struct Radiance {
    pub value: [f64; 3],
    pub jacobian: [[f64; CHANNELS]; 3],
}

impl PointView {
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

    /// Radiances alone: with [`PointView::radiance`] inlined, what only derivatives need is left out.
    pub fn value(
        &self,
        natural: &[f64; CHANNELS],
        lobes: &[f64; LOBES],
        place: [f64; 2],
    ) -> [f64; 3] {
        self.radiance(natural, lobes, place).value
    }

    #[inline(always)]
    pub fn radiance(
        &self,
        natural: &[f64; CHANNELS],
        lobes: &[f64; LOBES],
        [x, y]: [f64; 2],
    ) -> Radiance {
        let at = DVec3::new(x, y, 0.0);
        let (to_light, to_camera) = (self.light - at, self.camera - at);
        let irradiance = self.irradiance(to_light);
        let (l, v) = (to_light.normalize().to_array(), to_camera.normalize().to_array());
        let mut reflection = reflect(natural, lobes, l, v);
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
