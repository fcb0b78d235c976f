//! What raw values mean: darkness, full scale, filters, colours.

use crate::frame::{Bayer, BayerPattern, Primaries};
use glam::{DMat3, DVec3};

use super::tiff::Directory;

const CFA_SIZE: u16 = 33421;
const CFA_PATTERN: u16 = 33422;
const CFA_LAYOUT: u16 = 50711;
const BLACK_SIZE: u16 = 50713;
const BLACK: u16 = 50714;
const WHITE: u16 = 50717;
const COLOR_MATRICES: [u16; 2] = [50721, 50722];
const CAMERA_CALIBRATIONS: [u16; 2] = [50723, 50724];
const ANALOG_BALANCE: u16 = 50727;
const AS_SHOT_NEUTRAL: u16 = 50728;
const ILLUMINANTS: [u16; 2] = [50778, 50779];
/// Signatures of the camera calibration and of the profile that it belongs to.
const SIGNATURES: [u16; 2] = [50931, 50932];
/// Standard illuminant D65 by Exif's number.
const D65: u32 = 21;
/// Longest side of a pattern of black levels.
const LONGEST_PATTERN: usize = 8;

/// XYZ to responses of the cones after Bradford, rows.
const BRADFORD: [[f64; 3]; 3] =
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];

/// Reads it from the first directory, which is the camera's, and that of the raw picture.
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

/// Darkness at the four places of the filters: means, where its pattern is larger.
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

/// White balance, and rows of the matrix from balanced values to linear Rec. 709. White as it was
/// when the photograph was taken comes out neutral, and green as bright as the sensor saw it.
fn colours(camera: &Directory) -> Result<([f32; 3], [[f32; 3]; 3]), String> {
    let neutral = camera.exactly::<3>(AS_SHOT_NEUTRAL)?.ok_or("no AsShotNeutral")?;
    if neutral.iter().any(|v| !(1e-3..=1e3).contains(v)) {
        return Err(format!("AsShotNeutral {neutral:?}; three positive numbers are expected"));
    }
    let neutral = DVec3::from_array(neutral) / neutral[1];
    let to_xyz = from_xyz(camera)?.inverse();
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

/// From XYZ to the camera's values: by the matrix for daylight (D65), else by the second one, which
/// is for the bluer light of the two.
fn from_xyz(camera: &Directory) -> Result<DMat3, String> {
    let mut found = [None; 2];
    for (i, found) in found.iter_mut().enumerate() {
        let Some(matrix) = camera.exactly::<9>(COLOR_MATRICES[i])? else { continue };
        *found = Some((i, matrix, camera.whole(ILLUMINANTS[i])? == Some(D65)));
    }
    let daylight = found.iter().flatten().find(|(.., is_daylight)| *is_daylight);
    let Some((i, matrix, _)) = daylight.or(found[1].as_ref()).or(found[0].as_ref()) else {
        return Err("no colour matrix of 3 x 3".into());
    };
    let balance = camera.exactly::<3>(ANALOG_BALANCE)?.unwrap_or([1.0; 3]);
    let mut own = DMat3::IDENTITY;
    let [calibration, profile] = SIGNATURES.map(|tag| camera.bytes(tag));
    if calibration?.unwrap_or(b"\0") == profile?.unwrap_or(b"\0")
        && let Some(values) = camera.exactly::<9>(CAMERA_CALIBRATIONS[*i])?
    {
        own = rows(&values);
    }
    Ok(DMat3::from_diagonal(balance.into()) * own * rows(matrix))
}

fn rows(values: &[f64]) -> DMat3 {
    DMat3::from_cols_slice(values).transpose()
}
