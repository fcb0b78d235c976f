//! Meaning of raw values: black level, full scale, filters, colours.

use crate::photo::{Bayer, BayerPattern, Primaries};
use glam::{DMat3, DVec3};

use super::tiff::Directory;

const CFA_SIZE: u16 = 33421;
const CFA_PATTERN: u16 = 33422;
const CFA_LAYOUT: u16 = 50711;
const BLACK_SIZE: u16 = 50713;
/// Black level.
pub const BLACK: u16 = 50714;
/// White level.
pub const WHITE: u16 = 50717;
const COLOR_MATRICES: [u16; 2] = [50721, 50722];
const CAMERA_CALIBRATIONS: [u16; 2] = [50723, 50724];
const ANALOG_BALANCE: u16 = 50727;
const AS_SHOT_NEUTRAL: u16 = 50728;
const AS_SHOT_WHITE_XY: u16 = 50729;
/// Iterations for light and matrix; each reduces the error about tenfold.
const ROUNDS: usize = 8;
const ILLUMINANTS: [u16; 2] = [50778, 50779];
/// Signatures of the camera calibration and of the profile that uses it.
const SIGNATURES: [u16; 2] = [50931, 50932];
/// Longest side of a black-level pattern.
const LONGEST_PATTERN: usize = 8;

/// XYZ to cone responses after Bradford, by rows.
const BRADFORD: [[f64; 3]; 3] =
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];

/// Reads the values from the first directory (the camera's) and from that of the raw picture.
pub fn read(camera: &Directory, raw: &Directory, bits: u32) -> Result<Bayer, String> {
    let (white_balance, color_matrix) = colours(camera)?;
    let full = f64::from((1u32 << bits) - 1);
    let white_level = raw.numbers(WHITE)?.and_then(|v| v.first().copied()).unwrap_or(full);
    let (pattern, black_level) = (pattern(raw)?, black_level(raw)?);
    let white_level = white_level as f32;
    Ok(Bayer { pattern, black_level, white_level, white_balance, color_matrix })
}

fn pattern(raw: &Directory) -> Result<BayerPattern, String> {
    let size = raw.exactly::<2>(CFA_SIZE)?.unwrap_or([2.0; 2]);
    let layout = raw.whole(CFA_LAYOUT)?.unwrap_or(1);
    let filters = raw.bytes(CFA_PATTERN)?.unwrap_or_default();
    match filters {
        _ if size != [2.0; 2] || layout != 1 => (),
        [0, 1, 1, 2] => return Ok(BayerPattern::Rggb),
        [1, 0, 2, 1] => return Ok(BayerPattern::Grbg),
        [1, 2, 0, 1] => return Ok(BayerPattern::Gbrg),
        [2, 1, 1, 0] => return Ok(BayerPattern::Bggr),
        _ => (),
    }
    let [rows, columns] = size;
    Err(format!("colour filters {rows} x {columns} other than Bayer's are not read"))
}

/// Black level at the four filter positions; means of larger patterns.
fn black_level(raw: &Directory) -> Result<[f32; 4], String> {
    let size = raw.exactly::<2>(BLACK_SIZE)?.unwrap_or([1.0; 2]).map(|n| n as usize);
    let [rows, columns] = size;
    let levels = raw.numbers(BLACK)?.unwrap_or_else(|| vec![0.0; rows.saturating_mul(columns)]);
    let is_known = size.iter().all(|n| (1..=LONGEST_PATTERN).contains(n));
    if !is_known || levels.len() != rows * columns {
        return Err(format!("{} black levels for {rows} x {columns} places", levels.len()));
    }
    Ok(std::array::from_fn(|place| {
        let at = |i: usize| {
            levels[(2 * (i / columns) + place / 2) % rows * columns
                + (2 * (i % columns) + place % 2) % columns]
        };
        let mean = (0..rows * columns).map(at).sum::<f64>() / (rows * columns) as f64;
        mean as f32
    }))
}

/// White balance, and the rows of the matrix from balanced values to linear Rec. 709. The white of
/// the scene becomes neutral, and green keeps its level.
pub fn colours(camera: &Directory) -> Result<([f32; 3], [[f32; 3]; 3]), String> {
    let matrices = Matrices::read(camera)?;
    let (neutral, from_xyz) = white(camera, &matrices)?;
    let to_xyz = from_xyz.inverse();
    let seen = to_xyz * neutral;
    let rec709_to_xyz = Primaries::Rec709.to_xyz();
    let bradford = rows(BRADFORD.as_flattened());
    let cones = bradford * rec709_to_xyz * DVec3::ONE / (bradford * seen);
    let adapted = bradford.inverse() * DMat3::from_diagonal(cones) * bradford;
    let matrix = rec709_to_xyz.inverse() * adapted * to_xyz * DMat3::from_diagonal(neutral);
    if !(seen.y > 0.0 && matrix.is_finite()) {
        return Err("its colour matrix has no inverse that makes the white".into());
    }
    let matrix = matrix.transpose().to_cols_array_2d().map(|row| row.map(|v| v as f32));
    Ok((neutral.recip().as_vec3().to_array(), matrix))
}

/// Camera values of the scene's white with green 1, and the matrix from XYZ to camera for that light.
fn white(camera: &Directory, matrices: &Matrices) -> Result<(DVec3, DMat3), String> {
    let neutral = match camera.exactly::<3>(AS_SHOT_NEUTRAL)? {
        Some(neutral) => DVec3::from_array(neutral),
        None => {
            let [x, y] = camera
                .exactly::<2>(AS_SHOT_WHITE_XY)?
                .ok_or("neither AsShotNeutral nor AsShotWhiteXY")?;
            if !(x > 0.0 && y > 0.0 && x + y < 1.0) {
                return Err(format!("AsShotWhiteXY {x}, {y}; a chromaticity is expected"));
            }
            matrices.at(temperature([x, y])) * DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
        }
    };
    if !neutral.to_array().iter().all(|v| (1e-3..=1e3).contains(v)) {
        return Err(format!("white of {neutral:?}; three positive numbers are expected"));
    }
    let neutral = neutral / neutral.y;
    // The matrix depends on the light's temperature and vice versa: iterate from daylight.
    let mut from_xyz = matrices.at(f64::INFINITY);
    for _ in 0..ROUNDS {
        let xyz = from_xyz.inverse() * neutral;
        let sum = xyz.element_sum();
        if !(sum > 0.0 && xyz.y > 0.0) {
            break;
        }
        from_xyz = matrices.at(temperature([xyz.x / sum, xyz.y / sum]));
    }
    Ok((neutral, from_xyz))
}

/// XYZ to camera values under one or two lights.
struct Matrices {
    /// Temperature of the light, K, and matrix; the redder light first.
    lights: Vec<(f64, DMat3)>,
}

impl Matrices {
    fn read(camera: &Directory) -> Result<Self, String> {
        let balance = camera.exactly::<3>(ANALOG_BALANCE)?.unwrap_or([1.0; 3]);
        let balance = DMat3::from_diagonal(balance.into());
        let [calibration, profile] = SIGNATURES.map(|tag| camera.bytes(tag));
        let is_own = calibration?.unwrap_or(b"\0") == profile?.unwrap_or(b"\0");
        let mut found = Vec::new();
        for i in 0..2 {
            let Some(matrix) = camera.exactly::<9>(COLOR_MATRICES[i])? else { continue };
            let own = camera.exactly::<9>(CAMERA_CALIBRATIONS[i])?.filter(|_| is_own);
            let own = own.map_or(DMat3::IDENTITY, |values| rows(&values));
            let light = camera.whole(ILLUMINANTS[i])?.and_then(illuminant);
            found.push((light, balance * own * rows(&matrix)));
        }
        let lights = match found[..] {
            [] => return Err("no colour matrix of 3 x 3".into()),
            [(Some(a), first), (Some(b), second)] if a < b => vec![(a, first), (b, second)],
            [(Some(a), first), (Some(b), second)] if a > b => vec![(b, second), (a, first)],
            // If neither light is known, the second is the bluer one.
            [.., (_, last)] => vec![(0.0, last)],
        };
        Ok(Self { lights })
    }

    /// The matrix under a light, K, interpolated in reciprocal temperatures as in DNG.
    fn at(&self, kelvin: f64) -> DMat3 {
        match self.lights[..] {
            [(red, first), (blue, second)] => {
                let share = (kelvin.recip() - blue.recip()) / (red.recip() - blue.recip());
                let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
                first * share + second * (1.0 - share)
            }
            _ => self.lights[0].1,
        }
    }
}

/// Correlated colour temperature of a chromaticity, K, after McCamy (1992).
fn temperature([x, y]: [f64; 2]) -> f64 {
    let n = (x - 0.3320) / (0.1858 - y);
    let kelvin = ((449.0 * n + 3525.0) * n + 6823.3) * n + 5520.33;
    if kelvin.is_finite() { kelvin.clamp(1000.0, 50_000.0) } else { 6504.0 }
}

/// Temperature of a light by Exif's number, K.
fn illuminant(number: u32) -> Option<f64> {
    Some(match number {
        3 | 17 => 2856.0,
        24 => 3200.0,
        15 => 3525.0,
        2 | 14 => 4150.0,
        18 => 4874.0,
        13 | 23 => 5003.0,
        1 | 4 | 9 | 20 => 5503.0,
        12 => 6430.0,
        10 | 21 => 6504.0,
        19 => 6774.0,
        11 | 22 => 7504.0,
        _ => return None,
    })
}

fn rows(values: &[f64]) -> DMat3 {
    DMat3::from_cols_slice(values).transpose()
}
