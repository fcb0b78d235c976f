//! A small renderer of photographs of the target, independent of the code under test except for
//! the camera's and the target's definitions.
#![allow(dead_code)] // each test file uses its part

use glam::{DMat3, DVec2, DVec3};
use svbrdf::calibration::{Hole, LumaImage, Paper, Target, TargetKind};
use svbrdf::geometry::{Camera, Pose};
use svbrdf::photo::Photo;

/// The sample in the hole.
#[derive(Clone, Copy, PartialEq)]
pub enum Sample {
    /// Dark, with spots and lines.
    Textured,
    /// Bare paper.
    Paper,
    /// The checkerboard goes on.
    Checkerboard,
}

/// A photograph to be made.
pub struct Scene {
    pub target: Target,
    pub camera: Camera,
    pub pose: Pose,
    pub sample: Sample,
    /// Gaussian blur (sigma), px.
    pub blur_px: f64,
    /// Motion during exposure, px.
    pub motion_px: DVec2,
    /// Noise of a white pixel relative to it.
    pub noise: f64,
    /// Centre and radius (px) of round saturated reflections.
    pub glare: Vec<(DVec2, f64)>,
    /// Centre and half axes (px) of dark round things in front of the board.
    pub occluders: Vec<(DVec2, DVec2)>,
    /// A point on a shadow's edge (px), the direction into it, and the share of light that it leaves.
    pub shadow: Option<(DVec2, DVec2, f64)>,
    /// Level of white.
    pub exposure: f64,
    /// How the print differs from its plan.
    pub paper: Paper,
    pub seed: u64,
}

/// A ring so many squares wide.
pub fn ring(rows: u32, cols: u32, wide: u32) -> Target {
    Target {
        rows,
        cols,
        square_mm: 10.0,
        hole: Hole { row_start: wide, col_start: wide, row_end: rows - wide, col_end: cols - wide },
        ..Target::default()
    }
}

/// The same with markers.
pub fn charuco(rows: u32, cols: u32, wide: u32) -> Target {
    let kind = TargetKind::CharucoRing { dictionary: "DICT_4X4_250".to_owned(), marker_mm: 7.2 };
    Target { kind, ..ring(rows, cols, wide) }
}

pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mean 0, variance 1 (sum of four uniform numbers).
    pub fn noise(&mut self) -> f64 {
        (0..4).map(|_| self.uniform() - 0.5).sum::<f64>() * 3f64.sqrt()
    }
}

/// A pose that looks at the board's centre from `tilt` off its normal.
pub fn looking_at(tilt_deg: f64, azimuth_deg: f64, roll_deg: f64, distance: f64) -> Pose {
    let (tilt, azimuth) = (tilt_deg.to_radians(), azimuth_deg.to_radians());
    let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
    let facing = DMat3::from_rotation_x(std::f64::consts::PI);
    Pose {
        rotation: DMat3::from_axis_angle(axis, tilt)
            * DMat3::from_rotation_z(roll_deg.to_radians())
            * facing,
        translation: DVec3::new(0.0, 0.0, distance),
    }
}

impl Scene {
    /// A sharp, well exposed photograph with a little noise.
    pub fn new(target: Target, camera: Camera, pose: Pose, seed: u64) -> Self {
        Self {
            target,
            camera,
            pose,
            sample: Sample::Textured,
            blur_px: 0.6,
            motion_px: DVec2::ZERO,
            noise: 0.008,
            glare: Vec::new(),
            occluders: Vec::new(),
            shadow: None,
            exposure: 0.7,
            paper: Paper::default(),
            seed,
        }
    }

    /// Height of the sheet at a point of the board's plane, mm: parabolas across the board, their
    /// mean over the corners 0. The sample lies flat.
    fn height(&self) -> impl Fn(DVec2) -> f64 {
        let t = &self.target;
        let half = 0.5 * t.square_mm * DVec2::new(t.cols.into(), t.rows.into());
        let square = move |p: DVec2| (p / half) * (p / half);
        let corners = t.corners();
        let sum: DVec2 = corners.iter().map(|&(r, c)| square(t.grid_mm(r.into(), c.into()))).sum();
        let mean = sum / corners.len() as f64;
        let low = t.grid_mm(t.hole.row_end.into(), t.hole.col_start.into());
        let high = t.grid_mm(t.hole.row_start.into(), t.hole.col_end.into());
        let bow = DVec2::from_array(self.paper.bow_mm);
        move |p| {
            let inside = p.cmpgt(low).all() && p.cmplt(high).all();
            if inside { 0.0 } else { bow.dot(square(p) - mean) }
        }
    }

    /// Albedo at a point of the board's plane, mm.
    fn albedo(&self, p: DVec2) -> f64 {
        let t = &self.target;
        let grid = DVec2::new(
            p.x / t.square_mm + 0.5 * f64::from(t.cols),
            0.5 * f64::from(t.rows) - p.y / t.square_mm,
        );
        let (row, col) = (grid.y.floor() as i64, grid.x.floor() as i64);
        let hole = row >= t.hole.row_start.into()
            && row < t.hole.row_end.into()
            && col >= t.hole.col_start.into()
            && col < t.hole.col_end.into();
        let inside = row >= 0 && col >= 0 && row < t.rows.into() && col < t.cols.into();
        if !inside {
            // A margin of paper, then the table.
            let margin = (grid - grid.clamp(DVec2::ZERO, DVec2::new(t.cols.into(), t.rows.into())))
                .abs()
                .max_element();
            let table = 0.2 + 0.1 * (p.x * 0.21 + (p.y * 0.13).sin()).sin();
            return if margin < 1.5 { t.white_albedo } else { table };
        }
        if hole && self.sample != Sample::Checkerboard {
            let low = DVec2::new(t.hole.col_start.into(), t.hole.row_start.into());
            let high = DVec2::new(t.hole.col_end.into(), t.hole.row_end.into());
            let edge = (grid - low).min(high - grid).min_element();
            if self.sample == Sample::Paper || edge < 0.4 {
                return t.white_albedo;
            }
            // Bricks with joints along lattice lines: edges where a detector might expect some.
            let brick = (grid.x + 0.5 * (grid.y.floor() % 2.0)).fract();
            let joint = brick < 0.12 || grid.y.fract() < 0.12;
            let shade = 0.25 + 0.2 * (3.7 * grid.x + (2.9 * grid.y).cos() * 2.0).sin();
            return if joint { 0.6 } else { shade };
        }
        if !t.is_white(row, col) {
            return t.black_albedo;
        }
        if let TargetKind::CharucoRing { marker_mm, .. } = &t.kind {
            let m = marker_mm / t.square_mm;
            let q = (grid.fract() - 0.5) / m + 0.5;
            if q.cmpge(DVec2::ZERO).all() && q.cmplt(DVec2::ONE).all() {
                let white = t.marker(row, col).is_some_and(|marker| {
                    let module = (q * f64::from(marker.modules())).as_uvec2();
                    marker.is_white(module.y, module.x)
                });
                return if white { t.white_albedo } else { t.black_albedo };
            }
        }
        t.white_albedo
    }

    /// Linear radiance, 1 is saturation.
    pub fn linear(&self) -> Vec<f32> {
        let (w, h) = (self.camera.width as usize, self.camera.height as usize);
        let centre = self.pose.camera_centre();
        let to_board = self.pose.rotation.transpose();
        let (height, aspect) = (self.height(), self.paper.aspect);
        let steps = if self.paper.bow_mm == [0.0; 2] { 0 } else { 5 };
        // Planned position of the point that a pixel sees.
        let seen = |ray: DVec2| {
            let d = to_board * ray.extend(1.0);
            let at = |z: f64| (centre + d * ((z - centre.z) / d.z)).truncate();
            (d.z < -1e-6).then(|| {
                let p = (0..steps).fold(at(0.0), |p, _| at(height(p)));
                DVec2::new(p.x, p.y / aspect)
            })
        };
        let d0 = self.pose.translation.length();
        let mut data = vec![0.0f32; w * h];
        // Rays through pixels' upper left corners, interpolated between every fourth: curved by
        // distortion, they are off by a few thousandths of a pixel at most.
        let coarse: Vec<Vec<DVec2>> = (0..=h / 4 + 1)
            .map(|j| {
                let at = |i: usize| DVec2::new(i as f64, j as f64) * 4.0 - 0.5;
                (0..=w / 4 + 1).map(|i| self.camera.undistort(at(i))).collect()
            })
            .collect();
        let rays = |y: usize| -> Vec<DVec2> {
            let v = (y % 4) as f64 / 4.0;
            let (upper, lower) = (&coarse[y / 4], &coarse[y / 4 + 1]);
            (0..=w)
                .map(|x| {
                    let (i, u) = (x / 4, (x % 4) as f64 / 4.0);
                    let top = upper[i].lerp(upper[i + 1], u);
                    top.lerp(lower[i].lerp(lower[i + 1], u), v)
                })
                .collect()
        };
        let shade = |rays: &[DVec2]| -> Vec<f64> {
            rays.iter().map(|r| seen(*r).map_or(0.1, |b| self.albedo(b))).collect()
        };
        let mut next = rays(0);
        let mut next_shade = shade(&next);
        for y in 0..h {
            let row = std::mem::replace(&mut next, rays(y + 1));
            let upper = std::mem::replace(&mut next_shade, shade(&next));
            for x in 0..w {
                let (dx, dy) = (row[x + 1] - row[x], next[x] - row[x]);
                let ray = row[x] + 0.5 * (dx + dy);
                let first = upper[x];
                let others = [upper[x + 1], next_shade[x], next_shade[x + 1]];
                let albedo = if others.iter().all(|a| (a - first).abs() < 0.03) {
                    first
                } else {
                    let sum = (0..64).map(|k| {
                        let (u, v) = (f64::from(k % 8), f64::from(k / 8));
                        let r = row[x] + dx * ((u + 0.5) / 8.0) + dy * ((v + 0.5) / 8.0);
                        seen(r).map_or(0.1, |b| self.albedo(b))
                    });
                    sum.sum::<f64>() / 64.0
                };
                // The flash sits at the camera: inverse square and cosine.
                let light = seen(ray).map_or(0.0, |b| {
                    let to_light = centre - b.extend(0.0);
                    d0 * d0 / to_light.length_squared() * to_light.normalize().z
                });
                data[y * w + x] =
                    (self.exposure / self.target.white_albedo * albedo * light) as f32;
            }
        }
        self.hidden(&mut data, w);
        self.blurred(&mut data, w, h);
        let mut random = Random::new(self.seed);
        for (i, v) in data.iter_mut().enumerate() {
            let p = DVec2::new((i % w) as f64, (i / w) as f64);
            let mut level = f64::from(*v);
            for (centre, radius) in &self.glare {
                level += 3.0 * (-(p.distance_squared(*centre)) / (radius * radius)).exp();
            }
            let sigma = self.noise * (level.min(1.0) + 0.01).sqrt();
            *v = (level + sigma * random.noise()).clamp(0.0, 1.0) as f32;
        }
        data
    }

    /// Applies the shadow and the occluders.
    fn hidden(&self, data: &mut [f32], w: usize) {
        if self.occluders.is_empty() && self.shadow.is_none() {
            return;
        }
        for (i, v) in data.iter_mut().enumerate() {
            let p = DVec2::new((i % w) as f64, (i / w) as f64);
            if let Some((edge, into, left)) = self.shadow {
                // A penumbra of some 30 px.
                let t = 0.5 + 0.5 * ((p - edge).dot(into.normalize()) / 15.0).tanh();
                *v *= (1.0 - t * (1.0 - left)) as f32;
            }
            for (centre, half) in &self.occluders {
                if ((p - *centre) / *half).length_squared() < 1.0 {
                    *v = (self.exposure * (0.1 + 0.05 * (0.05 * (p.x + p.y)).sin())) as f32;
                }
            }
        }
    }

    fn blurred(&self, data: &mut Vec<f32>, w: usize, h: usize) {
        let mut taps: Vec<Vec<(isize, isize, f32)>> = Vec::new();
        if self.blur_px > 0.0 {
            let reach = (3.5 * self.blur_px).ceil() as isize;
            let weight = |k: isize| (-0.5 * (k as f64 / self.blur_px).powi(2)).exp() as f32;
            let sum: f32 = (-reach..=reach).map(weight).sum();
            taps.push((-reach..=reach).map(|k| (k, 0, weight(k) / sum)).collect());
            taps.push((-reach..=reach).map(|k| (0, k, weight(k) / sum)).collect());
        }
        let length = self.motion_px.length().ceil() as isize;
        if length > 0 {
            let n = 2 * length + 1;
            let at = |k: isize| self.motion_px * (k as f64 / n as f64);
            taps.push(
                (-length..=length)
                    .map(|k| {
                        let d = at(k).round();
                        (d.x as isize, d.y as isize, 1.0 / n as f32)
                    })
                    .collect(),
            );
        }
        for taps in taps {
            let source = std::mem::replace(data, vec![0.0; w * h]);
            for y in 0..h {
                let out = &mut data[y * w..][..w];
                for &(dx, dy, weight) in &taps {
                    let sy = (y as isize + dy).clamp(0, h as isize - 1) as usize;
                    let row = &source[sy * w..][..w];
                    // Columns past the border repeat it.
                    for (x, o) in out.iter_mut().enumerate() {
                        let sx = (x as isize + dx).clamp(0, w as isize - 1) as usize;
                        *o += weight * row[sx];
                    }
                }
            }
        }
    }

    /// The photograph as the detector takes it, through an 8-bit sRGB file.
    pub fn luma(&self) -> LumaImage {
        let rgb = self.linear().into_iter().flat_map(|v| [eight_bit(v); 3]).collect();
        let photo =
            Photo::from_linear(self.camera.width, self.camera.height, rgb, 1.0, 1.0).unwrap();
        LumaImage::from_photo(&photo)
    }

    /// True pixel of a grid point.
    pub fn corner_px(&self, row: u32, col: u32) -> DVec2 {
        let p = self.paper.place(&self.target, self.target.grid_mm(row.into(), col.into()));
        self.camera.project(self.pose.transform(p)).unwrap_or(DVec2::splat(-1e6))
    }

    /// Corners of the target at least `margin` px inside the picture.
    pub fn corners_in_view(&self, margin: f64) -> usize {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let inside = self.target.corners().into_iter().filter(|&(row, col)| {
            let p = self.corner_px(row, col);
            p.min_element() >= margin && (size - 1.0 - p).min_element() >= margin
        });
        inside.count()
    }
}

/// Rounds a linear value as an 8-bit sRGB file does.
fn eight_bit(v: f32) -> f32 {
    let coded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let coded = (coded * 255.0).round() / 255.0;
    if coded <= 0.040_45 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}
