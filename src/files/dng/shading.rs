//! Gain maps (`OpcodeList2`, big endian), which correct lens shading.

use super::tiff::Directory;

const OPCODES: u16 = 51009;
const GAIN_MAP: u32 = 9;
/// Most opcodes accepted.
const MOST_OPCODES: u32 = 64;
/// Plausible gains.
const GAINS: std::ops::RangeInclusive<f32> = 0.01..=100.0;

/// Gains on a grid over the picture, for some of its pixels.
struct GainMap {
    /// Top, left, bottom, right of the affected pixels, and their steps down and across.
    area: [usize; 4],
    pitch: [usize; 2],
    /// Down and across: number of points, their distance, and the position of the first, in heights
    /// and widths of the picture.
    points: [usize; 2],
    spacing: [f64; 2],
    origin: [f64; 2],
    gains: Vec<f32>,
}

/// Gain of every pixel of a picture of `size`, equal for all channels; `None` if the file has no gain maps.
pub fn gains(
    raw: &Directory,
    size: [usize; 2],
    channels: usize,
) -> Result<Option<Vec<f32>>, String> {
    let Some(mut list) = raw.bytes(OPCODES)? else { return Ok(None) };
    let count = u32_of(&mut list)?;
    if count > MOST_OPCODES {
        return Err(format!("{count} opcodes; at most {MOST_OPCODES} are read"));
    }
    let mut gains = None;
    for _ in 0..count {
        let [code, _version, _flags, bytes] = four(&mut list)?;
        let body = take(&mut list, bytes as usize)?;
        if code == GAIN_MAP {
            let gains = gains.get_or_insert_with(|| vec![1.0; size[0] * size[1]]);
            GainMap::parse(body, channels)?.multiply(gains, size);
        }
    }
    Ok(gains)
}

impl GainMap {
    fn parse(mut body: &[u8], channels: usize) -> Result<Self, String> {
        let body = &mut body;
        let area = four(body)?.map(|v| v as usize);
        let [plane, planes, down, across] = four(body)?;
        let points = [u32_of(body)? as usize, u32_of(body)? as usize];
        let spacing = [f64_of(body)?, f64_of(body)?];
        let origin = [f64_of(body)?, f64_of(body)?];
        let map_planes = u32_of(body)?;
        let count = points[0].saturating_mul(points[1]);
        let is_known =
            plane == 0 && planes as usize == channels && map_planes == 1 && down > 0 && across > 0;
        if !is_known || count == 0 || spacing.iter().chain(&origin).any(|v| !v.is_finite()) {
            return Err("a gain map of a kind that is not read".into());
        }
        let bytes = take(body, count.saturating_mul(4))?;
        let gains: Vec<f32> =
            bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_be_bytes(*bytes)).collect();
        if gains.iter().any(|gain| !GAINS.contains(gain)) {
            return Err("a gain map with impossible gains".into());
        }
        let pitch = [down as usize, across as usize];
        Ok(Self { area, pitch, points, spacing, origin, gains })
    }

    fn multiply(&self, gains: &mut [f32], [width, height]: [usize; 2]) {
        let [top, left, bottom, right] = self.area;
        for y in (top..bottom.min(height)).step_by(self.pitch[0]) {
            let (y0, y1, v) = self.between(0, (y as f64 + 0.5) / height as f64);
            for x in (left..right.min(width)).step_by(self.pitch[1]) {
                let (x0, x1, u) = self.between(1, (x as f64 + 0.5) / width as f64);
                let at = |y: usize, x: usize| self.gains[y * self.points[1] + x];
                let upper = at(y0, x0) * (1.0 - u) + at(y0, x1) * u;
                let lower = at(y1, x0) * (1.0 - u) + at(y1, x1) * u;
                gains[y * width + x] *= upper * (1.0 - v) + lower * v;
            }
        }
    }

    /// The two points around a position along an axis, and the weight of the second.
    fn between(&self, axis: usize, place: f64) -> (usize, usize, f32) {
        let last = self.points[axis] - 1;
        let at = (place - self.origin[axis]) / self.spacing[axis];
        // A single point has no spacing.
        let at = if at.is_finite() { at.clamp(0.0, last as f64) } else { 0.0 };
        let first = at as usize;
        (first, (first + 1).min(last), (at - first as f64) as f32)
    }
}

fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Result<&'a [u8], String> {
    let (taken, rest) = bytes.split_at_checked(count).ok_or("truncated list of opcodes")?;
    *bytes = rest;
    Ok(taken)
}

fn u32_of(bytes: &mut &[u8]) -> Result<u32, String> {
    Ok(take(bytes, 4)?.iter().fold(0, |value, byte| value << 8 | u32::from(*byte)))
}

fn f64_of(bytes: &mut &[u8]) -> Result<f64, String> {
    let bits = take(bytes, 8)?.iter().fold(0, |value, byte| value << 8 | u64::from(*byte));
    Ok(f64::from_bits(bits))
}

fn four(bytes: &mut &[u8]) -> Result<[u32; 4], String> {
    Ok([u32_of(bytes)?, u32_of(bytes)?, u32_of(bytes)?, u32_of(bytes)?])
}
