//! Pictures without the board: other boards, checked fabrics, tiled floors, chessboards, text, codes, noise.

use super::common::{Random, Sample};
use super::test_data::test_data;
use super::{charuco, ring, scene};
use glam::{DMat3, DVec2, DVec3};
use std::path::{Path, PathBuf};
use svbrdf::calibration::{LumaImage, Target};

const WIDTH: usize = 960;
const HEIGHT: usize = 720;

/// Value at a point of a plane, in cells; the number varies it.
type Pattern = fn(DVec2, u64) -> f64;

/// A picture to be made.
pub struct Negative {
    pub name: String,
    kind: Kind,
    seed: u64,
}

enum Kind {
    Board(Box<Target>, f64, Sample),
    Pattern(Pattern),
    Noise(usize),
}

impl Negative {
    /// Whether the picture does show the target.
    pub fn shows(&self, target: &Target) -> bool {
        matches!(&self.kind, Kind::Board(board, _, Sample::Textured)
            if (board.rows, board.cols, board.hole) == (target.rows, target.cols, target.hole))
    }

    pub fn picture(&self) -> LumaImage {
        match &self.kind {
            Kind::Board(target, tilt, sample) => {
                let mut scene = scene(target, *tilt, [WIDTH as u32, HEIGHT as u32], self.seed);
                scene.sample = *sample;
                scene.luma()
            }
            Kind::Pattern(pattern) => self.render(*pattern),
            Kind::Noise(smoothings) => self.noise(*smoothings),
        }
    }

    /// A plane with the pattern, seen in perspective, with light falling off and noise.
    fn render(&self, pattern: Pattern) -> LumaImage {
        let mut random = Random::new(self.seed);
        let mut uniform = |low: f64, high: f64| low + (high - low) * random.uniform();
        let turn = DMat3::from_rotation_z(uniform(0.0, 6.3));
        let tilt = DMat3::from_rotation_x(uniform(0.0, 1.0));
        // Cells of the pattern across the picture.
        let cells = uniform(14.0, 32.0);
        let (normal, scale) = (turn * tilt * DVec3::Z, cells * 0.7);
        let (u, v) = (turn * tilt * DVec3::X, turn * tilt * DVec3::Y);
        let at = |x: f64, y: f64| {
            let ray = DVec3::new(x - 480.0, y - 360.0, 700.0) / 700.0;
            let facing = normal.dot(ray);
            if facing < 0.05 {
                return 0.1;
            }
            let p = ray / facing - normal;
            let light = 1.0 / (0.6 + 0.4 * (ray / facing).length_squared());
            light * pattern(scale * DVec2::new(p.dot(u), p.dot(v)), self.seed)
        };
        let data = (0..WIDTH * HEIGHT).map(|i| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            let sum: f64 = (0..9)
                .map(|k| at(x + f64::from(k % 3) / 3.0 - 0.33, y + f64::from(k / 3) / 3.0 - 0.33))
                .sum();
            sum / 9.0
        });
        let mut noise = Random::new(self.seed + 1);
        let data = data.map(|v| (v + 0.01 * noise.noise()).clamp(0.0, 1.0).sqrt() as f32).collect();
        LumaImage { width: WIDTH, height: HEIGHT, data }
    }

    fn noise(&self, smoothings: usize) -> LumaImage {
        let mut random = Random::new(self.seed);
        let mut data: Vec<f32> = (0..WIDTH * HEIGHT).map(|_| random.uniform() as f32).collect();
        for _ in 0..smoothings {
            let source = data.clone();
            for y in 1..HEIGHT - 1 {
                for x in 1..WIDTH - 1 {
                    let i = y * WIDTH + x;
                    let sides =
                        source[i - 1] + source[i + 1] + source[i - WIDTH] + source[i + WIDTH];
                    data[i] = 0.2 * (source[i] + sides);
                }
            }
        }
        // Full contrast again.
        let mean = data.iter().sum::<f32>() / data.len() as f32;
        let spread = data.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / data.len() as f32;
        let gain = 0.25 / spread.sqrt();
        data.iter_mut().for_each(|v| *v = (0.5 + gain * (*v - mean)).clamp(0.0, 1.0));
        LumaImage { width: WIDTH, height: HEIGHT, data }
    }
}

/// A number in [0, 1) for a cell.
fn hash(cell: DVec2, seed: u64) -> f64 {
    let (x, y) = (cell.x as i64 as u64, cell.y as i64 as u64);
    let mix = x.wrapping_mul(0x9E37_79B9).wrapping_add(y.wrapping_mul(0x85EB_CA6B_0001));
    let mut random = Random::new(mix ^ seed.wrapping_mul(77));
    random.uniform();
    random.uniform()
}

fn odd(cell: DVec2) -> bool {
    ((cell.x + cell.y) as i64).rem_euclid(2) == 1
}

/// Two-coloured tiles.
fn floor(p: DVec2, seed: u64) -> f64 {
    let worn = 0.06 * hash(p.floor(), seed);
    if odd(p.floor()) { 0.7 + worn } else { 0.08 + worn }
}

/// The floor under a rug.
fn floor_with_rug(p: DVec2, seed: u64) -> f64 {
    let half = DVec2::new(4.0 + (seed % 3) as f64, 4.5 + (seed % 4) as f64);
    let inside = (p.abs() - half).max_element() < 0.0;
    if inside { 0.3 + 0.1 * (9.0 * p.x).sin() * (7.0 * p.y).cos() } else { floor(p, seed) }
}

/// Tiles of one colour and joints.
fn tiles(p: DVec2, seed: u64) -> f64 {
    let joint = p.fract_gl().min_element() < 0.07;
    if joint { 0.15 } else { 0.5 + 0.3 * hash(p.floor(), seed) }
}

/// Woven checks: white, half, full, wavy as cloth lies.
fn gingham(p: DVec2, seed: u64) -> f64 {
    let phase = seed as f64;
    let p = p + 0.12 * DVec2::new((0.7 * p.y + phase).sin(), (0.6 * p.x + 2.0 * phase).sin());
    let band = |v: f64| v.rem_euclid(2.0) < 1.0;
    let thread = 0.04 * (40.0 * p.x).sin() * (40.0 * p.y).sin();
    let dyed = usize::from(band(p.x)) + usize::from(band(p.y));
    [0.8, 0.35, 0.08][dyed] + thread
}

/// Checks printed on cloth.
fn printed_checks(p: DVec2, seed: u64) -> f64 {
    let phase = seed as f64;
    let p = p + 0.15 * DVec2::new((0.5 * p.y + phase).sin(), (0.4 * p.x - phase).cos());
    if odd(p.floor()) { 0.75 } else { 0.1 }
}

/// Bands of many widths.
fn tartan(p: DVec2, seed: u64) -> f64 {
    let band = |v: f64, k: u64| {
        let at = v.rem_euclid(6.0);
        let edges = [0.0, 1.7, 2.1, 3.4, 4.0, 4.3];
        let i = edges.iter().rposition(|e| at >= *e).unwrap_or(0);
        hash(DVec2::new(i as f64, 0.0), seed + k)
    };
    0.1 + 0.7 * band(p.x, 0) * band(p.y, 1)
}

/// A chessboard with men on it.
fn chess(p: DVec2, seed: u64) -> f64 {
    if p.abs().max_element() > 4.6 {
        return 0.35;
    }
    if p.abs().max_element() > 4.0 {
        return 0.2;
    }
    let cell = p.floor();
    let taken = hash(cell, seed) < 0.3 && (p - cell - 0.5).length() < 0.33;
    match (taken, odd(cell)) {
        (true, _) => 0.05 + 0.7 * hash(cell, seed + 3).round(),
        (false, true) => 0.65,
        (false, false) => 0.1,
    }
}

/// Lines of letters.
fn text(p: DVec2, seed: u64) -> f64 {
    let line = (p.y / 1.5).floor();
    let letter = (p.x / 0.8).floor();
    let inside = DVec2::new(p.x / 0.8 - letter, p.y / 1.5 - line);
    let space = hash(DVec2::new(letter, line), seed) < 0.17;
    if space || inside.x > 0.8 || inside.y > 0.7 {
        return 0.8;
    }
    let dot = (inside * DVec2::new(6.0, 10.0)).floor() + 10.0 * DVec2::new(letter, line);
    if hash(dot, seed + 1) < 0.45 { 0.06 } else { 0.8 }
}

/// Black and white modules at random.
fn code(p: DVec2, seed: u64) -> f64 {
    if hash(p.floor(), seed) < 0.5 { 0.06 } else { 0.8 }
}

/// A checkerboard with a third of the squares missing.
fn broken_board(p: DVec2, seed: u64) -> f64 {
    let missing = hash((p / 3.0).floor(), seed) < 0.33;
    if missing { 0.5 } else { floor(p, seed) }
}

/// Every picture.
pub fn all() -> Vec<Negative> {
    let mut negatives = Vec::new();
    let mut add = |name: String, kind: Kind| {
        let seed = 100 + negatives.len() as u64;
        negatives.push(Negative { name, kind, seed });
    };
    let boards = [
        (15, 16, 3),
        (19, 16, 3),
        (17, 14, 3),
        (17, 18, 3),
        (16, 16, 3),
        (18, 16, 3),
        (17, 16, 4),
        (17, 16, 3),
        (15, 14, 2),
        (19, 16, 2),
        (17, 18, 2),
        (15, 18, 2),
        (17, 17, 2),
        (13, 12, 2),
        (11, 10, 2),
        (9, 10, 3),
    ];
    for (rows, cols, wide) in boards {
        for tilt in [5.0, 40.0] {
            let name = format!("board {rows} x {cols}, {wide} wide, {tilt} degrees");
            add(name, Kind::Board(Box::new(ring(rows, cols, wide)), tilt, Sample::Textured));
        }
    }
    for (rows, cols) in [(13, 12), (15, 16), (17, 14), (16, 15)] {
        for tilt in [10.0, 30.0] {
            let name = format!("markers {rows} x {cols}, {tilt} degrees");
            add(name, Kind::Board(Box::new(charuco(rows, cols, 2)), tilt, Sample::Textured));
        }
    }
    for (rows, cols) in [(17, 16), (9, 8)] {
        for tilt in [0.0, 30.0] {
            let name = format!("whole board {rows} x {cols}, {tilt} degrees");
            add(name, Kind::Board(Box::new(ring(rows, cols, 3)), tilt, Sample::Checkerboard));
        }
    }
    let patterns: [(&str, Pattern); 10] = [
        ("floor", floor),
        ("floor with rug", floor_with_rug),
        ("tiles", tiles),
        ("gingham", gingham),
        ("printed checks", printed_checks),
        ("tartan", tartan),
        ("chess", chess),
        ("text", text),
        ("code", code),
        ("broken board", broken_board),
    ];
    for (name, pattern) in patterns {
        for k in 0..8 {
            add(format!("{name} {k}"), Kind::Pattern(pattern));
        }
    }
    for smoothings in [0, 1, 3, 8, 20, 60] {
        add(format!("noise smoothed {smoothings} times"), Kind::Noise(smoothings));
    }
    negatives
}

/// Photographs of materials and of full checkerboards in the test data, or `None` without it.
pub fn photographs() -> Option<Vec<PathBuf>> {
    let mut files = Vec::new();
    for (folder, stride) in
        [("materials", 3), ("calibration/opencv_stereo", 1), ("calibration/udacity_gopro", 2)]
    {
        let mut found = Vec::new();
        collect(&test_data(folder)?, &mut found);
        found.sort();
        files.extend(found.into_iter().step_by(stride));
    }
    Some(files)
}

/// JPEG files below a folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for path in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "jpg") {
            let name = path.file_name().unwrap().to_string_lossy();
            let material = path.components().any(|c| c.as_os_str() == "materials");
            if !material || name.contains("diffuse") {
                files.push(path);
            }
        }
    }
}
