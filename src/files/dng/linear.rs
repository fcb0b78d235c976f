//! Demosaicked raw pictures (`LinearRaw`), such as Apple's ProRAW.

use super::colour;
use super::raw::{Area, Raw};
use super::tiff::Directory;
use crate::photo::Photo;

/// Full scale of the result.
const FULL: f32 = 1.0;

/// Linear Rec. 709 of the active area. A pixel with a clipped channel is saturated. Full scale is
/// the clipping level of the channel with the smallest gain.
pub fn developed(
    camera: &Directory,
    directory: &Directory,
    raw: &Raw,
    active: Area,
    gains: Option<&[f32]>,
    exposure: f32,
) -> Result<Photo, String> {
    let (balance, matrix) = colour::colours(camera)?;
    let smallest = balance.iter().fold(f32::INFINITY, |a, &b| a.min(b));
    let [black, white] = levels(directory, raw.bits)?;
    let scale: [f32; 3] = std::array::from_fn(|c| balance[c] / smallest / (white[c] - black[c]));
    let [width, height] = [active.width as usize, active.height as usize];
    let mut rgb = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        let start = (active.y as usize + y) * raw.size[0] as usize + active.x as usize;
        let line = raw.samples[3 * start..3 * (start + width)].as_chunks::<3>().0;
        for (x, pixel) in line.iter().enumerate() {
            let stored = pixel.map(f32::from);
            let gain = gains.map_or(1.0, |gains| gains[y * width + x]);
            let v: [f32; 3] = std::array::from_fn(|c| {
                ((stored[c] - black[c]).max(0.0) * scale[c] * gain).min(FULL)
            });
            let clipped = v.contains(&FULL) || (0..3).any(|c| stored[c] >= white[c]);
            rgb.extend(matrix.map(|m| {
                let value = (m[0] * v[0] + m[1] * v[1] + m[2] * v[2]).max(0.0);
                if clipped { value.max(FULL) } else { value }
            }));
        }
    }
    Photo::from_linear(active.width, active.height, rgb, exposure / smallest, FULL)
        .map_err(|fault| fault.to_string())
}

/// Black and white levels of the three channels.
fn levels(directory: &Directory, bits: u32) -> Result<[[f32; 3]; 2], String> {
    let full = ((1u32 << bits) - 1) as f32;
    let black = three(directory, colour::BLACK, 0.0)?;
    let white = three(directory, colour::WHITE, full)?;
    let is_sound = (0..3).all(|c| black[c] >= 0.0 && white[c] > black[c]);
    is_sound.then_some([black, white]).ok_or_else(|| {
        format!("black levels {black:?} and white levels {white:?}; the latter are to be larger")
    })
}

/// One number per channel, or one for all; the mean of a larger black-level pattern.
fn three(directory: &Directory, tag: u16, default: f32) -> Result<[f32; 3], String> {
    let Some(values) = directory.numbers(tag)? else { return Ok([default; 3]) };
    if values.is_empty() || (values.len() != 1 && !values.len().is_multiple_of(3)) {
        return Err(format!("tag {tag} has {} values; one or three are expected", values.len()));
    }
    let of = |c: usize| {
        let own: Vec<f64> = values.iter().skip(c % values.len()).step_by(3).copied().collect();
        (own.iter().sum::<f64>() / own.len() as f64) as f32
    };
    Ok(if values.len() == 1 { [values[0] as f32; 3] } else { [of(0), of(1), of(2)] })
}
