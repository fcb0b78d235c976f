//! Photographs of a board with a sample that sticks out of its hole: known maps at a known height.
#![allow(dead_code)] // each test file uses its part

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use svbrdf::Svbrdf;
use svbrdf::calibration::Target;
use svbrdf::geometry::{Camera, Pose};
use svbrdf::observation::{Falloff, View};
use svbrdf::photo::Photo;
use svbrdf::random::Random;
use svbrdf::render::render;

pub const SAMPLE_MM: f64 = 100.0;
/// Distance of the first camera, mm.
const DISTANCE_MM: f64 = 260.0;
/// Flash in the camera frame, mm.
pub const FLASH_MM: DVec3 = DVec3::new(8.0, -12.0, 0.0);
/// Albedo of the table in the hole and round the board, and of the sample's sides.
const TABLE: f64 = 0.3;
const SIDE: f64 = 0.15;
/// Samples along each side of a pixel.
const SUPERSAMPLING: u32 = 2;

pub fn camera() -> Camera {
    Camera {
        width: 1512,
        height: 1134,
        fx: 1110.0,
        fy: 1110.0,
        cx: 754.0,
        cy: 570.0,
        distortion: [0.04, -0.06, 0.0, 0.0, 0.0],
    }
}

/// The first from above, the others from 10 to 45 degrees all round.
pub fn poses(count: u32, seed: u64) -> Vec<Pose> {
    let mut random = Random::new(seed);
    let golden = PI * (3.0 - 5.0f64.sqrt());
    (0..count)
        .map(|index| {
            let polar =
                if index == 0 { 0.05 } else { (10.0 + 35.0 * random.uniform()).to_radians() };
            let azimuth = golden * f64::from(index) + 0.4 * random.uniform();
            let distance = DISTANCE_MM * (1.0 + 0.12 * random.uniform());
            let outwards =
                DVec3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
            let aim = 10.0 * DVec3::new(random.uniform() - 0.5, random.uniform() - 0.5, 0.0);
            // The long side of the board runs along the long side of the picture.
            let roll = PI / 2.0 + 0.2 * (random.uniform() - 0.5);
            let forward = -outwards;
            let right = DVec3::new(roll.cos(), roll.sin(), 0.0).reject_from(forward).normalize();
            let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
            Pose { rotation, translation: -(rotation * (aim + outwards * distance)) }
        })
        .collect()
}

/// A photograph of maps `elevation_mm` above the default board, with noise.
pub fn photograph(maps: &Svbrdf, pose: &Pose, elevation_mm: f64, seed: u64) -> Photo {
    let camera = camera();
    let power_mm2 = PI * DISTANCE_MM * DISTANCE_MM;
    let (eye, light) = (pose.camera_centre(), pose.to_board(FLASH_MM));
    let up = DVec3::Z * elevation_mm;
    let view = View {
        sample_mm: [SAMPLE_MM as f32; 2],
        camera_mm: (eye - up).as_vec3().to_array(),
        light_mm: (light - up).as_vec3().to_array(),
        falloff: Falloff::InverseSquare { power_mm2: [power_mm2 as f32; 3] },
        ..View::default()
    };
    let mut seen = vec![0.0; 3 * maps.texels()];
    render(maps, &view, &mut seen);
    let n = maps.width();
    let top = |p: DVec2| -> [f64; 3] {
        let axis = |t: f64| {
            let t = (t * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            (t as usize, (t as usize + 1).min(n - 1), t.fract())
        };
        let (x0, x1, fx) = axis(p.x / SAMPLE_MM + 0.5);
        let (y0, y1, fy) = axis(0.5 - p.y / SAMPLE_MM);
        std::array::from_fn(|c| {
            let plane = &seen[c * n * n..][..n * n];
            let at = |x: usize, y: usize| f64::from(plane[y * n + x]);
            let upper = at(x0, y0) + fx * (at(x1, y0) - at(x0, y0));
            let lower = at(x0, y1) + fx * (at(x1, y1) - at(x0, y1));
            upper + fy * (lower - upper)
        })
    };
    let target = Target::default();
    let on_sample = |p: DVec3| p.truncate().abs().max_element() < 0.5 * SAMPLE_MM;
    let radiance = |ray: DVec3| -> [f64; 3] {
        let at = |z: f64| eye + ray * ((z - eye.z) / ray.z);
        if on_sample(at(elevation_mm)) {
            return top(at(elevation_mm).truncate());
        }
        let ground = at(0.0);
        let blocked = (0..8).any(|k| on_sample(at(elevation_mm * f64::from(k) / 8.0)));
        let grid = DVec2::new(
            0.5 * f64::from(target.cols) + ground.x / target.square_mm,
            0.5 * f64::from(target.rows) - ground.y / target.square_mm,
        );
        let (row, col) = (grid.y.floor() as i64, grid.x.floor() as i64);
        let albedo = if blocked {
            SIDE
        } else if !target.has_square(row, col) {
            TABLE
        } else if target.is_white(row, col) {
            target.white_albedo
        } else {
            target.black_albedo
        };
        let to_light = light - ground;
        let squared = to_light.length_squared();
        [albedo / PI * to_light.z / squared.sqrt() * power_mm2 / squared; 3]
    };
    let back = pose.rotation.transpose();
    let (w, h) = (camera.width, camera.height);
    let rows: Vec<Vec<f32>> = (0..h)
        .into_par_iter()
        .map(|y| {
            let mut random = Random::new(seed ^ (u64::from(y) << 32));
            let mut row = Vec::with_capacity(3 * w as usize);
            for x in 0..w {
                let centre = camera.undistort(DVec2::new(x.into(), y.into()));
                let mut sum = [0.0; 3];
                for k in 0..SUPERSAMPLING * SUPERSAMPLING {
                    let offset =
                        DVec2::new(f64::from(k % SUPERSAMPLING), f64::from(k / SUPERSAMPLING));
                    let offset = (offset + 0.5) / f64::from(SUPERSAMPLING) - 0.5;
                    let p = centre + offset / DVec2::new(camera.fx, camera.fy);
                    let value = radiance(back * p.extend(1.0));
                    (0..3).for_each(|c| sum[c] += value[c]);
                }
                for v in sum.map(|v| v / f64::from(SUPERSAMPLING * SUPERSAMPLING)) {
                    let sigma = (1e-6 + 2e-5 * v).sqrt();
                    row.push((v + sigma * random.bell()).clamp(0.0, 1.0) as f32);
                }
            }
            row
        })
        .collect();
    Photo::from_linear(w, h, rows.concat(), 1.0, 1.0).unwrap()
}

/// Kinds of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Material {
    /// Rounded light tiles with dark joints: albedo goes with height.
    Tiles,
    /// Blotched and bumpy, glossy.
    Leather,
    /// Flat and glossy, clouds of colour.
    Marble,
    /// Bumpy, one colour, glossy.
    Plaster,
    /// Flat and of one colour.
    Plain,
}

/// Maps of a material.
pub fn maps(material: Material, n: usize) -> Svbrdf {
    let mut random = Random::new(material as u64 + 11);
    let mut noise = |octaves: &[(usize, f64)]| -> Vec<f64> {
        let mut sum = vec![0.0; n * n];
        for &(cells, amplitude) in octaves {
            let grid: Vec<f64> =
                (0..(cells + 3) * (cells + 3)).map(|_| amplitude * random.bell()).collect();
            for (i, v) in sum.iter_mut().enumerate() {
                let at = |k: usize| (k as f64 + 0.5) / n as f64 * cells as f64;
                let (x, y) = (at(i % n), at(i / n));
                let bell = |t: f64| match t.abs() {
                    t if t < 0.5 => 0.75 - t * t,
                    t if t < 1.5 => 0.5 * (1.5 - t) * (1.5 - t),
                    _ => 0.0,
                };
                let (cx, cy) = (x.round(), y.round());
                for k in 0..9 {
                    let (gx, gy) = (cx + f64::from(k % 3) - 1.0, cy + f64::from(k / 3) - 1.0);
                    let node = (gy + 1.0) as usize * (cells + 3) + (gx + 1.0) as usize;
                    *v += grid[node] * bell(x - gx) * bell(y - gy);
                }
            }
        }
        sum
    };
    let fine = noise(&[(40, 0.25), (80, 0.12), (160, 0.05)]);
    let cloud = noise(&[(5, 1.0), (11, 0.6), (23, 0.4), (60, 0.25)]);
    let tile = |i: usize| {
        let at = |k: usize, count: f64| {
            let t = ((k as f64 + 0.5) / n as f64 * count).fract();
            (t.min(1.0 - t) * 8.0).min(1.0)
        };
        let t = at(i % n, 5.0).min(at(i / n, 7.0));
        t * t * (3.0 - 2.0 * t)
    };
    // Heights in mm.
    let height: Vec<f64> = match material {
        Material::Tiles => (0..n * n).map(|i| 0.8 * tile(i) + 0.1 * fine[i]).collect(),
        Material::Leather | Material::Plaster => fine.iter().map(|v| 0.6 * v).collect(),
        _ => vec![0.0; n * n],
    };
    let mut out = Svbrdf::new(n, n);
    let mut set = |plane: usize, i: usize, v: f64| out.planes_mut()[plane * n * n + i] = v as f32;
    let mm = SAMPLE_MM / n as f64;
    for i in 0..n * n {
        let (x, y) = (i % n, i / n);
        let z = |x: usize, y: usize| height[y.min(n - 1) * n + x.min(n - 1)];
        let dx = (z(x + 1, y) - z(x.saturating_sub(1), y)) / (2.0 * mm);
        let dy = (z(x, y.saturating_sub(1)) - z(x, y + 1)) / (2.0 * mm);
        set(0, i, -dx);
        set(1, i, -dy);
        let (diffuse, specular, roughness) = match material {
            Material::Tiles => {
                let t = tile(i);
                (
                    DVec3::new(0.12, 0.11, 0.1).lerp(DVec3::new(0.5, 0.35, 0.25), t),
                    0.04,
                    0.7 - 0.35 * t,
                )
            }
            Material::Leather => (DVec3::new(0.3, 0.18, 0.1) * (1.0 + 0.08 * cloud[i]), 0.05, 0.4),
            Material::Marble => (DVec3::new(0.5, 0.5, 0.45) * (1.0 + 0.15 * cloud[i]), 0.04, 0.25),
            Material::Plaster => (DVec3::splat(0.45), 0.04, 0.5),
            Material::Plain => (DVec3::new(0.35, 0.4, 0.45), 0.04, 0.4),
        };
        for c in 0..3 {
            set(2 + c, i, diffuse[c].clamp(0.02, 0.95));
            set(5 + c, i, specular);
        }
        set(8, i, roughness);
    }
    out
}
