//! Sensor values as strips or tiles hold them.

use crate::frame::MAX_PIXELS;

use super::lossless_jpeg;
use super::tiff::{Directory, Tiff};

const WIDTH: u16 = 256;
const HEIGHT: u16 = 257;
const BITS: u16 = 258;
const COMPRESSION: u16 = 259;
const STRIP_OFFSETS: u16 = 273;
const SAMPLES_PER_PIXEL: u16 = 277;
const ROWS_PER_STRIP: u16 = 278;
const STRIP_BYTES: u16 = 279;
const TILE_WIDTH: u16 = 322;
const TILE_HEIGHT: u16 = 323;
const TILE_OFFSETS: u16 = 324;
const TILE_BYTES: u16 = 325;
const PLANAR: u16 = 284;
const SAMPLE_FORMAT: u16 = 339;
const LINEARIZATION: u16 = 50712;

/// Part of a picture, px.
#[derive(Clone, Copy)]
pub struct Area {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// Sensor values, row by row; those of a pixel side by side.
pub struct Raw {
    pub size: [u32; 2],
    /// Bits of a stored value.
    pub bits: u32,
    pub samples: Vec<u16>,
}

/// How the values are cut into blocks: strips or tiles.
struct Blocks {
    size: [usize; 2],
    /// Whether those at the lower end are as high as the others.
    padded: bool,
    offsets: Vec<f64>,
    bytes: Vec<f64>,
}

/// Width and height of a picture.
pub fn size(directory: &Directory) -> Result<[u32; 2], String> {
    let [w, h] = [WIDTH, HEIGHT].map(|tag| directory.whole(tag));
    let (w, h) = (w?.unwrap_or(0), h?.unwrap_or(0));
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > MAX_PIXELS {
        return Err(format!("{w} x {h} px; 1 to {MAX_PIXELS} pixels are supported"));
    }
    Ok([w, h])
}

/// Reads the values, so many of each pixel, with the linearization table applied.
pub fn read(tiff: &Tiff, directory: &Directory, channels: usize) -> Result<Raw, String> {
    let size = size(directory)?;
    let number = |tag, default| Ok::<u32, String>(directory.whole(tag)?.unwrap_or(default));
    let (bits, samples) = (number(BITS, 1)?, number(SAMPLES_PER_PIXEL, 1)?);
    let fits = samples as usize == channels && number(PLANAR, 1)? == 1;
    if (samples, channels) == (1, 3) {
        return Err(
            "its sensor sees no colours (black and white): use a camera that does, or convert it to TIFF for gray maps".into()
        );
    }
    if !(8..=16).contains(&bits) || !fits || number(SAMPLE_FORMAT, 1)? != 1 {
        return Err(format!(
            "{samples} values of {bits} bits a pixel; {channels} side by side, whole numbers of 8 to 16 bits, are expected"
        ));
    }
    let compression = number(COMPRESSION, 1)?;
    if ![1, 7].contains(&compression) {
        let name = match compression {
            34892 => " (lossy JPEG)",
            52546 => " (JPEG XL)",
            _ => "",
        };
        return Err(format!(
            "compression {compression}{name} is not read; uncompressed (1) and lossless JPEG (7) are: convert it with Adobe's DNG Converter"
        ));
    }
    let blocks = Blocks::read(directory, size)?;
    let [width, height] = size.map(|n| n as usize);
    let mut out = vec![0; channels * width * height];
    let across = width.div_ceil(blocks.size[0]);
    for (i, (offset, bytes)) in blocks.offsets.iter().zip(&blocks.bytes).enumerate() {
        let (x, y) = (i % across * blocks.size[0], i / across * blocks.size[1]);
        let rows = if blocks.padded { blocks.size[1] } else { blocks.size[1].min(height - y) };
        let truncated = || format!("truncated: block {i} of the raw picture lies behind the end");
        let data = tiff.range(*offset as usize, *bytes as usize).ok_or_else(truncated)?;
        let line = channels * blocks.size[0];
        let values = match compression {
            1 => unpacked(data, [line, rows], bits, tiff.is_big_endian())?,
            _ => lossless_jpeg::decode(data, line * rows)?,
        };
        let inside = line.min(channels * (width - x));
        for (row, values) in values.chunks_exact(line).take(height - y).enumerate() {
            let start = channels * ((y + row) * width + x);
            out[start..start + inside].copy_from_slice(&values[..inside]);
        }
    }
    linearize(directory, &mut out)?;
    Ok(Raw { size, bits, samples: out })
}

impl Blocks {
    fn read(directory: &Directory, [width, height]: [u32; 2]) -> Result<Self, String> {
        let number = |tag| directory.whole(tag);
        let tile = number(TILE_WIDTH)?.zip(number(TILE_HEIGHT)?);
        let (size, [offsets, bytes]) = match tile {
            Some((w, h)) => ([w, h], [TILE_OFFSETS, TILE_BYTES]),
            None => {
                let rows = number(ROWS_PER_STRIP)?.unwrap_or(height).min(height);
                ([width, rows], [STRIP_OFFSETS, STRIP_BYTES])
            }
        };
        let [w, h] = size.map(u64::from);
        let across = u64::from(width).div_ceil(w.max(1));
        let down = u64::from(height).div_ceil(h.max(1));
        // Tiles may stick out, but not hold many times the picture.
        if w * h == 0 || (across * w).saturating_mul(down * h) > 2 * MAX_PIXELS {
            return Err(format!("blocks of {w} x {h} px for {width} x {height}"));
        }
        let list = |tag| Ok::<_, String>(directory.numbers(tag)?.unwrap_or_default());
        let (mut offsets, mut bytes) = (list(offsets)?, list(bytes)?);
        let count = (across * down) as usize;
        if offsets.len() < count || bytes.len() < count {
            return Err(format!("{} blocks of {count} are in the file", offsets.len()));
        }
        offsets.truncate(count);
        bytes.truncate(count);
        Ok(Self { size: size.map(|n| n as usize), padded: tile.is_some(), offsets, bytes })
    }
}

/// Uncompressed values; rows begin at whole bytes. Those of 16 bits are in the file's byte order,
/// others packed with the highest bit first.
fn unpacked(data: &[u8], [w, h]: [usize; 2], bits: u32, big: bool) -> Result<Vec<u16>, String> {
    let line = (w * bits as usize).div_ceil(8);
    let Some(data) = data.get(..line * h) else {
        return Err(format!("truncated: {} bytes where {} are expected", data.len(), line * h));
    };
    let mut values = Vec::with_capacity(w * h);
    if bits == 16 {
        let read = if big { u16::from_be_bytes } else { u16::from_le_bytes };
        values.extend(data.as_chunks::<2>().0.iter().map(|pair| read(*pair)));
        return Ok(values);
    }
    for row in data.chunks_exact(line) {
        let (mut hold, mut count) = (0u32, 0);
        let mut bytes = row.iter();
        for _ in 0..w {
            while count < bits {
                hold = hold << 8 | u32::from(*bytes.next().unwrap_or(&0));
                count += 8;
            }
            count -= bits;
            values.push((hold >> count & ((1 << bits) - 1)) as u16);
        }
    }
    Ok(values)
}

fn linearize(directory: &Directory, samples: &mut [u16]) -> Result<(), String> {
    let Some(table) = directory.numbers(LINEARIZATION)? else { return Ok(()) };
    let table: Vec<u16> = table.iter().map(|v| *v as u16).collect();
    let last = *table.last().ok_or("an empty linearization table")?;
    for value in samples {
        *value = table.get(usize::from(*value)).copied().unwrap_or(last);
    }
    Ok(())
}
