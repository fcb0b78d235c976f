//! The board with the sample, and its picture in the camera.

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};
use svbrdf::calibration::{Patch, Target};
use svbrdf::geometry::{Camera, Pose};
use svbrdf::random::Random;

use super::light::Light;
use super::surface::Surface;

/// Distance of the first camera, mm.
pub const DISTANCE_MM: f64 = 260.0;
/// Albedo of the paper between board and sample and round the board.
const BACKGROUND: f64 = 0.3;
/// Sides of a raised sample, and heights at which they are looked for.
const SIDE_RADIANCE: f64 = 0.05;
const SIDE_STEPS: u32 = 8;
/// The gray patch prints darker than planned, as inks spread: true over planned albedo.
pub const GRAY_PRINTED: f64 = 0.88;
/// Samples along each side of a pixel, and of one that is blurred.
pub const SUPERSAMPLING: u32 = 3;
pub const BLURRED_SUPERSAMPLING: u32 = 2;

/// The camera of all photographs.
pub fn camera() -> Camera {
    Camera {
        width: 2016,
        height: 1512,
        fx: 1480.0,
        fy: 1480.0,
        cx: 1005.0,
        cy: 760.0,
        distortion: [0.04, -0.06, 0.0, 0.0, 0.0],
    }
}

/// Intensity of the flash times mm²: white at the first distance comes out at its albedo.
pub fn power_mm2() -> f64 {
    PI * DISTANCE_MM * DISTANCE_MM
}

/// The first camera looks from above, the others from up to 45 degrees all round; one that is to see the
/// highlight `near` the middle of the sample from 2 to 9.
pub fn pose(index: u32, near: bool, random: &mut Random) -> Pose {
    let golden = PI * (3.0 - 5.0f64.sqrt());
    let polar = match (index, near) {
        (0, _) => 0.05,
        (_, true) => (2.0 + 7.0 * random.uniform()).to_radians(),
        (_, false) => (10.0 + 35.0 * random.uniform()).to_radians(),
    };
    let azimuth = golden * f64::from(index) + 0.4 * random.uniform();
    let distance = DISTANCE_MM * (1.0 + 0.12 * (index.min(1) as f64) * random.uniform());
    let outwards =
        DVec3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let aim = DVec3::new(random.uniform() - 0.5, random.uniform() - 0.5, 0.0) * 10.0;
    // The long side of the board runs along the long side of the picture.
    let roll = PI / 2.0 + 0.2 * (random.uniform() - 0.5);
    let forward = -outwards;
    let right = DVec3::new(roll.cos(), roll.sin(), 0.0).reject_from(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let centre = aim + outwards * distance;
    Pose { rotation, translation: -(rotation * centre) }
}

/// The scene of one photograph.
pub struct Scene<'a> {
    pub surface: &'a Surface<'a>,
    pub target: Target,
    pub camera: Camera,
    pub pose: Pose,
    pub elevation_mm: f64,
    /// Board frame.
    pub light: Light,
    /// Radiance of the sample's texels: three planes.
    pub radiance: Vec<f32>,
}

impl<'a> Scene<'a> {
    /// Lights the sample by a flash at `flash_mm` in the camera frame whose strength goes with a power
    /// of the cosine to the camera's axis, and by so much of a room.
    pub fn new(
        surface: &'a Surface<'a>,
        target: Target,
        pose: Pose,
        elevation_mm: f64,
        (flash_mm, exponent): (DVec3, f64),
        room: f64,
    ) -> Self {
        let axis = pose.rotation.transpose() * DVec3::Z;
        let place = pose.to_board(flash_mm);
        let light = Light { place, axis, exponent, power_mm2: power_mm2(), room };
        let camera = camera();
        let mut scene =
            Self { surface, target, camera, pose, elevation_mm, light, radiance: Vec::new() };
        scene.radiance = surface.radiance(scene.eye(), &scene.above(&light));
        scene
    }

    /// The camera relative to the plane of the sample's border.
    pub fn eye(&self) -> DVec3 {
        self.pose.camera_centre() - DVec3::Z * self.elevation_mm
    }

    /// A light relative to that plane.
    fn above(&self, light: &Light) -> Light {
        Light { place: light.place - DVec3::Z * self.elevation_mm, ..*light }
    }

    /// The light of an ideal photograph: the flash alone, alike to all sides, relative to that plane.
    pub fn ideal_light(&self) -> Light {
        Light { exponent: 0.0, room: 0.0, ..self.above(&self.light) }
    }

    /// Radiance of an ideal photograph in the top view, `side * side` texels, row by row.
    pub fn ideal(&self, side: usize) -> Vec<[f64; 3]> {
        let radiance = self.surface.radiance(self.eye(), &self.ideal_light());
        let size = DVec2::from(self.surface.sample_mm.map(f64::from));
        let part = |i: usize| (i as f64 + 0.5) / side as f64 - 0.5;
        let place = |i: usize| size * DVec2::new(part(i % side), -part(i / side));
        (0..side * side).map(|i| self.seen_at(&radiance, place(i))).collect()
    }

    /// Radiance of the surface behind a point of the border's plane.
    fn seen_at(&self, radiance: &[f32], p: DVec2) -> [f64; 3] {
        let eye = self.eye();
        self.surface.sample(radiance, self.surface.hit(eye, p.extend(0.0) - eye, 0.0))
    }

    /// Radiance from where a ray from the camera ends: sample, its sides, or the board.
    fn radiance(&self, eye: DVec3, ray: DVec3) -> [f64; 3] {
        let at = |z: f64| (eye + ray * ((z - eye.z) / ray.z)).truncate();
        let top = self.surface.hit(eye, ray, self.elevation_mm);
        if self.surface.contains(top) {
            return self.surface.sample(&self.radiance, top);
        }
        let height = |i: u32| self.elevation_mm * f64::from(i) / f64::from(SIDE_STEPS);
        if (0..SIDE_STEPS).any(|i| self.surface.contains(at(height(i)))) {
            return [SIDE_RADIANCE; 3];
        }
        let p = at(0.0);
        let target = &self.target;
        let albedo = printed_albedo(target, p);
        let ground = p.extend(0.0);
        let cosine = (self.light.place - ground).normalize().z.max(0.0);
        let flash = cosine * self.light.irradiance(ground) / PI;
        [albedo * (flash + self.light.room); 3]
    }

    /// Mean radiance over `samples * samples` places of a pixel; the distortion is taken as constant
    /// within it.
    pub fn pixel(&self, x: u32, y: u32, samples: u32) -> [f64; 3] {
        let centre = self.camera.undistort(DVec2::new(x.into(), y.into()));
        let origin = self.pose.camera_centre();
        let back = self.pose.rotation.transpose();
        let samples = if self.is_plain(origin, back * centre.extend(1.0)) { 1 } else { samples };
        let mut sum = [0.0; 3];
        let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(samples) - 0.5;
        for (i, j) in (0..samples).flat_map(|i| (0..samples).map(move |j| (i, j))) {
            let p = centre + DVec2::new(offset(i) / self.camera.fx, offset(j) / self.camera.fy);
            let ray = back * p.extend(1.0);
            if ray.z < -1e-9 {
                let value = self.radiance(origin, ray);
                (0..3).for_each(|c| sum[c] += value[c]);
            }
        }
        sum.map(|v| v / f64::from(samples * samples))
    }

    /// Whether a ray from the camera ends well outside the board, where a pixel shows one albedo.
    fn is_plain(&self, eye: DVec3, ray: DVec3) -> bool {
        let p = (eye - ray * (eye.z / ray.z)).truncate();
        let (rows, cols) = (f64::from(self.target.rows), f64::from(self.target.cols));
        let beyond = p.abs() - 0.5 * self.target.square_mm * DVec2::new(cols, rows);
        !self.target.patches
            && beyond.max_element() > self.target.square_mm + self.elevation_mm.abs()
    }

    /// Radiance of a rectified photograph at the point `p` of the border's plane: that of the surface behind it.
    pub fn rectified(&self, p: DVec2) -> [f64; 3] {
        self.seen_at(&self.radiance, p)
    }
}

/// Albedo of the printed sheet.
fn printed_albedo(target: &Target, p: DVec2) -> f64 {
    let within = |patch: &&Patch| (p - patch.centre_mm).abs().max_element() < 0.5 * patch.side_mm;
    if target.patches
        && let Some(patch) = target.patches().iter().find(within)
    {
        let printed = if patch.gray == 0.0 || patch.gray == 1.0 { 1.0 } else { GRAY_PRINTED };
        return printed * target.patch_albedo(patch);
    }
    let row = (0.5 * f64::from(target.rows) - p.y / target.square_mm).floor() as i64;
    let col = (0.5 * f64::from(target.cols) + p.x / target.square_mm).floor() as i64;
    match (target.has_square(row, col), target.is_white(row, col)) {
        (false, _) => BACKGROUND,
        (true, true) => target.white_albedo,
        (true, false) => target.black_albedo,
    }
}
