//! Maps texels to pixels, with an `f64` set-up per run of texels and evaluation in `f32`.

use glam::{DVec2, DVec3};

use crate::geometry::{Camera, Pose};
use crate::photo::Photo;

/// Texels per run.
pub(super) const LANES: usize = 64;

/// Projection of the sample.
pub(super) struct Mapping {
    camera: Camera,
    /// Upper left corner of the top view, camera frame.
    origin: DVec3,
    /// Step of one texel right, camera frame.
    right: DVec3,
    /// Step of one texel down, camera frame.
    down: DVec3,
    /// Light, camera frame.
    light: DVec3,
    sample_mm: DVec2,
    size: DVec2,
}

/// Pixel positions of a run of texels.
pub(super) struct Positions {
    pub x: [f32; LANES],
    pub y: [f32; LANES],
    /// Squared tangent of the angle to the optical axis at the camera.
    pub tan2: [f32; LANES],
    /// Tangents of the direction from the light, camera frame.
    pub from_light: [[f32; LANES]; 2],
}

impl Default for Positions {
    fn default() -> Self {
        Self { x: [0.0; LANES], y: [0.0; LANES], tan2: [0.0; LANES], from_light: [[0.0; LANES]; 2] }
    }
}

/// Rectangle of pixel positions.
pub(super) struct Bounds {
    low: DVec2,
    high: DVec2,
}

/// Rectangle of whole pixels, half open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Area {
    pub x0: u32,
    pub y0: u32,
    pub x1: u32,
    pub y1: u32,
}

impl Area {
    pub fn len(&self) -> usize {
        (self.x1 - self.x0) as usize * (self.y1 - self.y0) as usize
    }
}

impl Bounds {
    /// Reach of interpolation (two pixels) and dilation of saturation (one), plus less than one for
    /// the curvature of a run's border between projected points.
    const MARGIN: f64 = 4.0;

    /// Pixels of the photo that interpolation may read; `None` if all lie outside.
    pub fn pixels_in(&self, photo: &Photo) -> Option<Area> {
        let (w, h) = (f64::from(photo.width()), f64::from(photo.height()));
        let low = (self.low - Self::MARGIN).floor().max(DVec2::ZERO);
        let high = (self.high + Self::MARGIN).ceil().min(DVec2::new(w, h));
        (low.x < high.x && low.y < high.y).then_some(Area {
            x0: low.x as u32,
            y0: low.y as u32,
            x1: high.x as u32,
            y1: high.y as u32,
        })
    }
}

impl Mapping {
    pub fn new(
        camera: &Camera,
        pose: &Pose,
        light: DVec3,
        sample_mm: [f32; 2],
        height_mm: f32,
        width: usize,
        height: usize,
    ) -> Self {
        let sample_mm = DVec2::new(sample_mm[0].into(), sample_mm[1].into());
        let size = DVec2::new(width as f64, height as f64);
        let texel = sample_mm / size;
        let corner = DVec3::new(-0.5 * sample_mm.x, 0.5 * sample_mm.y, height_mm.into());
        Self {
            camera: *camera,
            origin: pose.transform(corner),
            right: pose.rotation.x_axis * texel.x,
            light,
            down: -pose.rotation.y_axis * texel.y,
            sample_mm,
            size,
        }
    }

    /// Board position of texel coordinate `x` (0: left edge of the sample), mm.
    pub fn x_mm(&self, x: f64) -> f64 {
        self.sample_mm.x * (x / self.size.x - 0.5)
    }

    /// Board position of texel coordinate `y` (0: upper edge of the sample), mm.
    pub fn y_mm(&self, y: f64) -> f64 {
        self.sample_mm.y * (0.5 - y / self.size.y)
    }

    fn point(&self, x: f64, y: f64) -> DVec3 {
        self.origin + x * self.right + y * self.down
    }

    /// Positions of [`LANES`] texels from `x0` on, at `sub_x` (0 to 1) inside each and at texel
    /// coordinate `y`.
    pub fn project(&self, x0: usize, sub_x: f64, y: f64, out: &mut Positions) {
        let start = self.point(x0 as f64 + sub_x, y);
        // A projective scale keeps all f32 quantities near 1.
        let scale = start.z.recip();
        let (start, step) = ((start * scale).as_vec3(), (self.right * scale).as_vec3());
        let light = (self.light * scale).as_vec3();
        let [k1, k2, p1, p2, k3] = self.camera.distortion.map(|v| v as f32);
        let (fx, fy) = (self.camera.fx as f32, self.camera.fy as f32);
        let (cx, cy) = (self.camera.cx as f32, self.camera.cy as f32);
        for lane in 0..LANES {
            let i = lane as f32;
            let point = [start.x + i * step.x, start.y + i * step.y, start.z + i * step.z];
            let inverse = 1.0 / point[2];
            let (x, y) = (point[0] * inverse, point[1] * inverse);
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let xy = x * y;
            out.x[lane] = fx * (x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * x * x)) + cx;
            out.y[lane] = fy * (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * xy) + cy;
            out.tan2[lane] = r2;
            let from_light = [point[0] - light.x, point[1] - light.y, point[2] - light.z];
            let inverse = 1.0 / from_light[2];
            out.from_light[0][lane] = from_light[0] * inverse;
            out.from_light[1][lane] = from_light[1] * inverse;
        }
    }

    /// Pixels covered by a step of one texel right and one down: the larger value of both ends of a run.
    pub fn footprint(&self, x0: usize, columns: usize, y: f64) -> (f64, f64) {
        let at = |x: f64, y: f64| self.camera.project(self.point(x, y));
        let step = |x: f64| {
            let (l, r) = (at(x - 0.5, y)?, at(x + 0.5, y)?);
            let (t, b) = (at(x, y - 0.5)?, at(x, y + 0.5)?);
            Some(((r - l).length(), (b - t).length()))
        };
        let (first, last) = (x0 as f64 + 0.5, (x0 + columns) as f64 - 0.5);
        let (a, b) = (step(first).unwrap_or((0.0, 0.0)), step(last).unwrap_or((0.0, 0.0)));
        (a.0.max(b.0), a.1.max(b.1))
    }

    /// Bounds of a rectangle of texels in the photo; `None` if it does not project.
    pub fn bounds(&self, x0: usize, y0: usize, columns: usize, rows: usize) -> Option<Bounds> {
        let mut bounds =
            Bounds { low: DVec2::splat(f64::INFINITY), high: DVec2::splat(f64::NEG_INFINITY) };
        const STEPS: usize = 4;
        for i in 0..=STEPS {
            let along = i as f64 / STEPS as f64;
            let (x, y) = (along * columns as f64, along * rows as f64);
            for (x, y) in [(x, 0.0), (x, rows as f64), (0.0, y), (columns as f64, y)] {
                let p = self.camera.project(self.point(x0 as f64 + x, y0 as f64 + y))?;
                bounds.low = bounds.low.min(p);
                bounds.high = bounds.high.max(p);
            }
        }
        Some(bounds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    /// Compares the f32 evaluation with the f64 chain board -> camera -> pixel, on a large sensor.
    #[test]
    fn single_precision_is_good_to_a_hundredth_of_a_pixel() {
        let camera = Camera {
            width: 8000,
            height: 6000,
            fx: 5800.0,
            fy: 5810.0,
            cx: 3990.0,
            cy: 3020.0,
            distortion: [0.06, -0.08, 5e-4, -3e-4, 0.01],
        };
        let (w, h) = (1000, 700);
        for tilt in [0.0, 0.7, 1.2] {
            let pose = Pose {
                rotation: DMat3::from_rotation_z(0.6)
                    * DMat3::from_rotation_x(std::f64::consts::PI - tilt),
                translation: DVec3::new(3.0, -5.0, 180.0),
            };
            let mapping = Mapping::new(&camera, &pose, DVec3::ZERO, [100.0, 70.0], 1.5, w, h);
            let mut positions = Positions::default();
            let mut worst = 0.0_f64;
            for y in (0..h).step_by(37) {
                for x0 in (0..w).step_by(LANES) {
                    mapping.project(x0, 0.25, y as f64 + 0.5, &mut positions);
                    for lane in 0..LANES {
                        let (x, y) = ((x0 + lane) as f64 + 0.25, y as f64 + 0.5);
                        let board = DVec3::new(mapping.x_mm(x), mapping.y_mm(y), 1.5);
                        let exact = camera.project(pose.transform(board)).unwrap();
                        let found = DVec2::new(positions.x[lane].into(), positions.y[lane].into());
                        worst = worst.max((found - exact).length());
                    }
                }
            }
            assert!(worst < 0.01, "tilt {tilt}: {worst} px");
        }
    }
}
