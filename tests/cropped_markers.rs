//! Views that crop a ring with markers: a few corners on two sides suffice.

#[path = "common/captures.rs"]
mod captures;
mod common;

use common::{Random, Scene, charuco, looking_at};
use glam::{DVec2, UVec2};
use svbrdf::Rejection;
use svbrdf::calibration::{LumaImage, Target, TargetKind, detect, estimate_pose};
use svbrdf::geometry::{Camera, Pose};

/// A photograph with its truth.
struct View {
    name: String,
    luma: LumaImage,
    target: Target,
    camera: Camera,
    pose: Pose,
}

impl View {
    fn px(&self, row: u32, col: u32) -> DVec2 {
        let p = self.target.grid_mm(row.into(), col.into()).extend(0.0);
        self.camera.project(self.pose.transform(p)).unwrap()
    }

    /// The part that shows blocks of squares (first row, first column, end row, end column).
    fn part(&self, blocks: &[[u32; 4]]) -> Self {
        let corners = blocks
            .iter()
            .flat_map(|b| [(b[0], b[1]), (b[0], b[3]), (b[2], b[1]), (b[2], b[3])])
            .map(|(row, col)| self.px(row, col));
        let (low, high) =
            corners.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let size = UVec2::new(self.luma.width as u32, self.luma.height as u32);
        let low = low.max(DVec2::ZERO).as_uvec2();
        let high = (high.as_uvec2() + 1).min(size);
        let (width, height) = ((high.x - low.x) as usize, (high.y - low.y) as usize);
        let data = (0..height)
            .flat_map(|y| {
                let first = (y + low.y as usize) * self.luma.width + low.x as usize;
                self.luma.data[first..first + width].iter().copied()
            })
            .collect();
        let camera = Camera {
            width: width as u32,
            height: height as u32,
            cx: self.camera.cx - f64::from(low.x),
            cy: self.camera.cy - f64::from(low.y),
            ..self.camera
        };
        let luma = LumaImage { width, height, data };
        Self { name: self.name.clone(), luma, target: self.target.clone(), camera, ..*self }
    }

    fn corners_in_view(&self) -> usize {
        let size = DVec2::new(self.luma.width as f64, self.luma.height as f64);
        let inside = |p: DVec2| p.min_element() > 6.0 && (size - 1.0 - p).min_element() > 6.0;
        self.target.corners().into_iter().filter(|&(r, c)| inside(self.px(r, c))).count()
    }

    /// Corners found and the error of the view direction in degrees; panics on a wrong label.
    fn look(&self) -> Result<(usize, f64), Rejection> {
        let detection = detect(&self.luma, &self.target)?;
        for c in &detection.corners {
            let off = c.px.distance(self.px(c.row, c.col));
            assert!(off < 3.0, "{}: ({}, {}) is {off} px off", self.name, c.row, c.col);
        }
        let found = estimate_pose(&self.camera, &self.target, &detection.corners)?;
        let direction = |p: &Pose| p.camera_centre().normalize();
        let degrees = direction(&found.pose).angle_between(direction(&self.pose)).to_degrees();
        Ok((detection.corners.len(), degrees))
    }
}

/// Blocks of squares in view: round each corner of the board, and strips across two opposite sides.
fn parts(target: &Target) -> Vec<(&'static str, Vec<[u32; 4]>)> {
    let (rows, cols) = (target.rows, target.cols);
    let (r, c) = (rows / 2 - 2, cols / 2 - 2);
    vec![
        ("upper left", vec![[0, 0, 6, 6]]),
        ("upper right", vec![[0, cols - 6, 6, cols]]),
        ("lower left", vec![[rows - 6, 0, rows, 6]]),
        ("lower right", vec![[rows - 6, cols - 6, rows, cols]]),
        ("top and bottom", vec![[0, c, rows, c + 4]]),
        ("left and right", vec![[r, 0, r + 4, cols]]),
        ("upper half", vec![[0, 0, rows / 2, cols]]),
        ("right half", vec![[0, cols / 2, rows, cols]]),
    ]
}

fn check(view: &View) -> (usize, usize) {
    let (mut found, mut all) = (0, 0);
    for (name, blocks) in parts(&view.target) {
        let part = view.part(&blocks);
        let in_view = part.corners_in_view();
        if in_view < 6 {
            continue;
        }
        all += 1;
        match part.look() {
            Ok((corners, degrees)) => {
                println!("{}, {name}: {corners}/{in_view}, {degrees:.3} degrees", view.name);
                // Few corners close together tell a direction less well: a corner of the board is
                // 50 mm wide, its corners are good to some 0.05 px of 75.
                assert!(degrees < 2.0, "{}, {name}: {degrees} degrees", view.name);
                found += 1;
            }
            Err(reason) => println!("{}, {name}: {in_view} in view, {reason}", view.name),
        }
    }
    (found, all)
}

fn rendered(tilt: f64, roll: f64, seed: u64) -> View {
    let target = charuco(17, 16, 2);
    let camera = Camera {
        width: 1440,
        height: 1080,
        fx: 1050.0,
        fy: 1052.0,
        cx: 722.0,
        cy: 541.0,
        distortion: [0.08, -0.12, 5e-4, -4e-4, 0.0],
    };
    let azimuth = 360.0 * Random::new(seed).uniform();
    let pose = looking_at(tilt, azimuth, roll, 195.0);
    let scene =
        Scene { blur_px: 0.7, noise: 0.01, ..Scene::new(target.clone(), camera, pose, seed) };
    let name = format!("{tilt} degrees, turned {roll}");
    View { name, luma: scene.luma(), target, camera, pose: scene.pose }
}

#[test]
fn parts_of_rendered_rings_are_placed() {
    let (mut found, mut all) = (0, 0);
    for (k, (tilt, roll)) in [(5.0, 0.0), (25.0, 90.0), (45.0, 181.0)].into_iter().enumerate() {
        let (f, a) = check(&rendered(tilt, roll, 7 + k as u64));
        (found, all) = (found + f, all + a);
    }
    println!("{found} of {all} parts");
    assert!(all >= 20 && found == all, "{found} of {all}");
}

#[test]
fn parts_of_photographs_are_placed() {
    let Some(captures) = captures::all() else { return };
    let (mut found, mut all) = (0, 0);
    for capture in captures {
        if !matches!(capture.target.kind, TargetKind::CharucoRing { .. }) {
            continue;
        }
        for (index, shot) in capture.photos.iter().enumerate() {
            let (f, a) = check(&View {
                name: format!("{}/{index}", capture.name),
                luma: LumaImage::from_photo(&shot.photo()),
                target: capture.target.clone(),
                camera: capture.camera,
                pose: shot.pose,
            });
            (found, all) = (found + f, all + a);
        }
    }
    println!("{found} of {all} parts");
    assert!(found as f64 >= 0.95 * all as f64, "{found} of {all}");
}
