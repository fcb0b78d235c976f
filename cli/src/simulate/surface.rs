//! The sample's surface and its reflected radiance.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use svbrdf::Svbrdf;
use svbrdf::observation::{Falloff, View};
use svbrdf::render::render;
use svbrdf::svbrdf::{Anisotropy, lobe};

use super::light::Light;
use super::reflectance::{Alphas, COAT_F0, Coat, Reflectance, Sheen, Texel};

/// Where the room is brightest, azimuth, and by how much more than its mean at the horizon.
const ROOM_AZIMUTH: f64 = 0.6;
const ROOM_CONTRAST: f64 = 0.9;
/// Meeting a bowed surface takes so few steps: each leaves the bow's slope times the last error.
const STEPS: usize = 4;

/// A bowed rectangle that reflects as maps say.
pub struct Surface<'a> {
    pub maps: &'a Svbrdf,
    pub sample_mm: [f32; 2],
    /// Height of the middle above the border, mm.
    pub bow_mm: f64,
    /// `None`: the library's renderer.
    pub reflectance: Option<Reflectance>,
}

impl Surface<'_> {
    /// Position relative to half the sides: -1 to 1 on the sample.
    fn relative(&self, p: DVec2) -> DVec2 {
        2.0 * p / DVec2::from(self.sample_mm.map(f64::from))
    }

    /// Whether a point lies within the sample's outline.
    pub fn contains(&self, p: DVec2) -> bool {
        self.relative(p).abs().max_element() < 1.0
    }

    /// Height above the border, mm; 0 outside.
    fn height(&self, p: DVec2) -> f64 {
        if !self.contains(p) {
            return 0.0;
        }
        let q = self.relative(p);
        self.bow_mm * (1.0 - q.x * q.x) * (1.0 - q.y * q.y)
    }

    /// Slopes `n.x / n.z`, `n.y / n.z` of the bow.
    fn slopes(&self, p: DVec2) -> DVec2 {
        let q = self.relative(p);
        let half = 0.5 * DVec2::from(self.sample_mm.map(f64::from));
        let across = DVec2::new(q.x * (1.0 - q.y * q.y), q.y * (1.0 - q.x * q.x));
        2.0 * self.bow_mm * across / half
    }

    /// Where a ray from `eye` meets the surface whose border lies at `elevation_mm`; for rays that
    /// pass by, where it meets the plane of the border.
    pub fn hit(&self, eye: DVec3, ray: DVec3, elevation_mm: f64) -> DVec2 {
        let at = |z: f64| (eye + ray * ((z - eye.z) / ray.z)).truncate();
        let mut p = at(elevation_mm);
        if self.bow_mm != 0.0 {
            for _ in 0..STEPS {
                p = at(elevation_mm + self.height(p));
            }
        }
        p
    }

    /// Radiance of every texel, three planes; camera and light relative to the border's plane.
    pub fn radiance(&self, eye: DVec3, light: &Light) -> Vec<f32> {
        let view = View {
            sample_mm: self.sample_mm,
            camera_mm: eye.as_vec3().to_array(),
            light_mm: light.place.as_vec3().to_array(),
            falloff: Falloff::InverseSquare { power_mm2: [light.power_mm2 as f32; 3] },
            ambient: [0.0; 3],
            mirrored: 1.0,
        };
        let mut radiance = vec![0.0; 3 * self.maps.texels()];
        match &self.reflectance {
            None => render(self.maps, &view, &mut radiance),
            Some(reflectance) => {
                let texel = |i: usize| self.shade(reflectance, &view, i, eye, light);
                let n = self.maps.texels();
                let texels: Vec<[f64; 3]> = (0..n).into_par_iter().map(texel).collect();
                for (i, texel) in texels.iter().enumerate() {
                    (0..3).for_each(|c| radiance[c * n + i] = texel[c] as f32);
                }
            }
        }
        if light.room > 0.0 {
            add_room(self.maps, &view, light.room, &mut radiance);
        }
        radiance
    }

    /// Radiance of texel `i` from the flash.
    fn shade(
        &self,
        reflectance: &Reflectance,
        view: &View,
        i: usize,
        eye: DVec3,
        light: &Light,
    ) -> [f64; 3] {
        let (w, h) = (self.maps.width(), self.maps.height());
        let place = DVec2::from(view.texel_mm(w, h, i % w, i / w).map(f64::from));
        let point = place.extend(self.height(place));
        let texel = |plane: &[f32]| f64::from(plane[i]);
        let lobe = |lobe: usize| self.maps.lobe(lobe).map_or(0.0, |plane| plane[i]);
        let stretch = [lobe::ANISOTROPY_X, lobe::ANISOTROPY_Y].map(lobe);
        let anisotropy = (stretch != [0.0; 2]).then(|| {
            let lobe = Anisotropy::new(self.maps.roughness()[i], stretch);
            let direction = DVec2::from_angle(lobe.angle.into());
            Alphas { direction, along: lobe.along.into(), across: lobe.across.into() }
        });
        let [weight, coat] = [lobe::COAT, lobe::COAT_ROUGHNESS].map(|l| f64::from(lobe(l)));
        let colour = [0, 1, 2].map(|c| f64::from(lobe(lobe::SHEEN + c)));
        let sheen = f64::from(lobe(lobe::SHEEN_ROUGHNESS));
        let bow = self.slopes(place);
        let relief = DVec2::from(self.maps.normal_slopes().map(texel));
        let texel = Texel {
            normal: (bow + relief).extend(1.0).normalize(),
            level: bow.extend(1.0).normalize(),
            diffuse: self.maps.diffuse().map(texel),
            f0: self.maps.specular().map(texel),
            roughness: texel(self.maps.roughness()),
            place,
            anisotropy,
            coat: (weight > 0.0).then_some(Coat { weight, alpha: coat * coat }),
            sheen: (colour != [0.0; 3]).then_some(Sheen { colour, roughness: sheen }),
        };
        let to = |from: DVec3| (from - point).normalize();
        let irradiance = light.irradiance(point);
        reflectance.reflect(&texel, to(light.place), to(eye)).map(|v| v * irradiance)
    }

    /// Planes of radiance between texel centres at a point of the sample.
    pub fn sample(&self, radiance: &[f32], p: DVec2) -> [f64; 3] {
        let (w, h) = (self.maps.width(), self.maps.height());
        let axis = |t: f64, n: usize| {
            let t = (t * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            (t as usize, (t as usize + 1).min(n - 1), t.fract())
        };
        let [width, height] = self.sample_mm.map(f64::from);
        let ((x0, x1, fx), (y0, y1, fy)) =
            (axis(p.x / width + 0.5, w), axis(0.5 - p.y / height, h));
        std::array::from_fn(|c| {
            let plane = &radiance[c * w * h..][..w * h];
            let at = |x: usize, y: usize| f64::from(plane[y * w + x]);
            let top = at(x0, y0) + fx * (at(x1, y0) - at(x0, y0));
            let bottom = at(x0, y1) + fx * (at(x1, y1) - at(x0, y1));
            top + fy * (bottom - top)
        })
    }
}

/// Adds the reflection of a room: diffuse its mean radiance, specular and coat that of the mirrored direction.
fn add_room(maps: &Svbrdf, view: &View, ambient: f64, radiance: &mut [f32]) {
    let (w, n) = (maps.width(), maps.texels());
    let bright = DVec3::new(ROOM_AZIMUTH.cos(), ROOM_AZIMUTH.sin(), 0.0);
    for i in 0..n {
        let [x, y] = view.texel_mm(w, maps.height(), i % w, i / w);
        let slopes = DVec2::from(maps.normal_slopes().map(|plane| f64::from(plane[i])));
        let normal = slopes.extend(1.0).normalize();
        let eye = glam::Vec3::from(view.camera_mm) - glam::Vec3::new(x, y, 0.0);
        let mirrored = (-eye.as_dvec3().normalize()).reflect(normal);
        // its mean over all directions, weighted by their cosine, is 1
        let room = 1.0 + ROOM_CONTRAST * mirrored.dot(bright);
        let coat = maps.lobe(lobe::COAT).map_or(0.0, |plane| COAT_F0 * f64::from(plane[i]));
        for c in 0..3 {
            let diffuse = f64::from(maps.diffuse()[c][i]);
            let specular = f64::from(maps.specular()[c][i]);
            radiance[c * n + i] +=
                (ambient * ((1.0 - coat) * (diffuse + specular * room) + coat * room)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::reflectance::Model;

    fn surface(maps: &Svbrdf, bow_mm: f64) -> Surface<'_> {
        let reflectance = Some(Reflectance::new(Model::ggx()));
        Surface { maps, sample_mm: [100.0, 80.0], bow_mm, reflectance }
    }

    /// Without faults the texel-by-texel renderer agrees with the library's up to the latter's masking:
    /// 2 % of a highlight below 25 degrees, which is a quarter of the radiance.
    #[test]
    fn a_flat_surface_of_ggx_is_what_the_library_renders() {
        let maps = Svbrdf::new(16, 12);
        let own = surface(&maps, 0.0);
        let library = Surface { reflectance: None, ..surface(&maps, 0.0) };
        let eye = DVec3::new(30.0, -50.0, 220.0);
        let light = Light {
            place: DVec3::new(35.0, -45.0, 225.0),
            axis: -DVec3::Z,
            exponent: 0.0,
            power_mm2: 1e5,
            room: 0.03,
        };
        let [a, b] = [own, library].map(|s| s.radiance(eye, &light));
        assert!(a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 1e-2));
    }

    /// The same of a material with all lobes, near the top, where the library's masking is right.
    #[test]
    fn lobes_of_maps_are_what_the_library_renders() {
        let mut maps = Svbrdf::new(16, 12);
        let lobes = [0.6, 0.8, 0.7, 0.3, 0.4, 0.3, 0.0, 0.6];
        let lobes = lobes.iter().flat_map(|v| vec![*v; 16 * 12]).collect();
        maps.set_lobes(lobes).unwrap();
        let own = surface(&maps, 0.0);
        let library = Surface { reflectance: None, ..surface(&maps, 0.0) };
        let light = Light {
            place: DVec3::new(5.0, 8.0, 225.0),
            axis: -DVec3::Z,
            exponent: 0.0,
            power_mm2: 1e5,
            room: 0.03,
        };
        let eye = DVec3::new(-20.0, 30.0, 220.0);
        let [a, b] = [own, library].map(|s| s.radiance(eye, &light));
        assert!(a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 1e-2));
        let plain = Surface { maps: &Svbrdf::new(16, 12), ..surface(&maps, 0.0) };
        let c = plain.radiance(eye, &light);
        assert!(a.iter().zip(&c).any(|(a, c)| (a / c - 1.0).abs() > 0.1));
    }

    /// Off its axis the flash is weaker by the power of the cosine, on a surface alike to all sides.
    #[test]
    fn a_flash_with_a_lobe_is_weaker_to_the_sides() {
        let mut maps = Svbrdf::new(3, 3);
        (0..3).for_each(|c| maps.specular_mut()[c].fill(0.0));
        let surface = surface(&maps, 0.0);
        let at = |exponent| {
            let place = DVec3::new(0.0, 0.0, 100.0);
            let light = Light { place, axis: -DVec3::Z, exponent, power_mm2: 1e4, room: 0.0 };
            surface.radiance(place, &light)
        };
        let (even, lobed) = (at(0.0), at(2.0));
        // the middle texel lies below it; another 33.3 mm to the side: cos² = 1 / (1 + 1/9)
        assert!((lobed[4] / even[4] - 1.0).abs() < 1e-6);
        assert!((lobed[3] / even[3] - 0.9).abs() < 1e-4, "{}", lobed[3] / even[3]);
    }

    /// The point that a ray is said to meet lies on the ray and on the surface.
    #[test]
    fn rays_meet_the_bow() {
        let maps = Svbrdf::new(4, 4);
        let surface = surface(&maps, 0.6);
        let (eye, through) = (DVec3::new(150.0, 20.0, 200.0), DVec3::new(10.0, -5.0, 2.0));
        let p = surface.hit(eye, through - eye, 2.0);
        let point = p.extend(2.0 + surface.height(p));
        let off = (point - eye).normalize().cross((through - eye).normalize()).length();
        assert!(off < 1e-6 && surface.height(p) > 0.5, "{off}");
    }

    /// Slopes of the normal are the negative derivatives of the height.
    #[test]
    fn slopes_are_those_of_the_height() {
        let maps = Svbrdf::new(4, 4);
        let surface = surface(&maps, 0.6);
        let (p, step) = (DVec2::new(20.0, -13.0), 1e-4);
        for (axis, slope) in [(DVec2::X, surface.slopes(p).x), (DVec2::Y, surface.slopes(p).y)] {
            let rise = surface.height(p + step * axis) - surface.height(p - step * axis);
            assert!((slope + rise / (2.0 * step)).abs() < 1e-6);
        }
    }
}
