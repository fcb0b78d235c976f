//! Sensor values in strips or tiles.

use crate::parallel;
use crate::photo::{MAX_PIXELS, size_fault};

use super::colour::WHITE;
#[cfg(feature = "jxl")]
use super::jpeg_xl;
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
const INTERLEAVES: [u16; 2] = [52547, 50975];
/// Values of `Compression`.
const UNCOMPRESSED: u32 = 1;
const LOSSLESS_JPEG: u32 = 7;
const LOSSY_JPEG: u32 = 34892;
const JPEG_XL: u32 = 52546;

/// Part of a picture, px.
#[derive(Clone, Copy)]
pub struct Area {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// Sensor values, row by row, channels interleaved.
pub struct Raw {
    pub size: [u32; 2],
    /// Bits per stored value.
    pub bits: u32,
    pub samples: Vec<u16>,
}

/// Division into blocks: strips or tiles.
struct Blocks {
    size: [usize; 2],
    /// Whether the last row of blocks has full height.
    padded: bool,
    offsets: Vec<f64>,
    bytes: Vec<f64>,
}

/// Width and height of a picture.
pub fn size(directory: &Directory) -> Result<[u32; 2], String> {
    let [w, h] = [WIDTH, HEIGHT].map(|tag| directory.whole(tag));
    let (w, h) = (w?.unwrap_or(0), h?.unwrap_or(0));
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > MAX_PIXELS {
        return Err(size_fault([w, h], MAX_PIXELS));
    }
    Ok([w, h])
}

/// Reads `channels` values per pixel and applies the linearization table.
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
    let compression = number(COMPRESSION, UNCOMPRESSED)?;
    check_compression(compression)?;
    let bits = if compression == JPEG_XL { jpeg_xl_bits(directory, bits)? } else { bits };
    let blocks = Blocks::read(directory, size)?;
    let [width, height] = size.map(|n| n as usize);
    let across = width.div_ceil(blocks.size[0]);
    let row = channels * width * blocks.size[1];
    let mut out = vec![0; channels * width * height];
    // Decode one row of blocks at a time, to avoid holding all of them twice.
    for (down, out) in out.chunks_mut(row).enumerate() {
        let rows = out.len() / (channels * width);
        let decoded = parallel::map(across, |i| {
            let seen = [blocks.size[0].min(width - i * blocks.size[0]), rows];
            let coded = Coded { compression, bits, channels, big_endian: tiff.is_big_endian() };
            coded.decode(blocks.data(tiff, down * across + i)?, blocks.stored(rows), seen)
        });
        for (i, block) in decoded.into_iter().enumerate() {
            let (line, values) = block?;
            let x = i * blocks.size[0];
            let inside = channels * blocks.size[0].min(width - x);
            for (values, out) in
                values.chunks_exact(line).zip(out.chunks_exact_mut(channels * width))
            {
                out[channels * x..channels * x + inside].copy_from_slice(&values[..inside]);
            }
        }
    }
    let mut out = deinterleaved(directory, out, [width, height], channels)?;
    linearize(directory, &mut out)?;
    Ok(Raw { size, bits, samples: out })
}

fn check_compression(compression: u32) -> Result<(), String> {
    let jpeg_xl = cfg!(feature = "jxl").then_some(JPEG_XL);
    if [UNCOMPRESSED, LOSSLESS_JPEG].into_iter().chain(jpeg_xl).any(|read| read == compression) {
        return Ok(());
    }
    let name = match compression {
        LOSSY_JPEG => " (lossy JPEG)",
        JPEG_XL => " (JPEG XL)",
        _ => "",
    };
    let jpeg_xl = jpeg_xl.map_or("", |_| ", JPEG XL (52546)");
    Err(format!(
        "compression {compression}{name} is not read; uncompressed (1), lossless JPEG (7){jpeg_xl} are: convert it with Adobe's DNG Converter"
    ))
}

/// Bits of values decoded from JPEG XL, where they are 0 to 1. Adobe's library uses 16 bits whatever is
/// stored, and the levels of most files follow. If levels or table match the stored bits, those apply.
fn jpeg_xl_bits(directory: &Directory, stored: u32) -> Result<u32, String> {
    let largest = match directory.numbers(LINEARIZATION)? {
        Some(table) => table.len().saturating_sub(1) as f64,
        None => directory.numbers(WHITE)?.unwrap_or_default().into_iter().fold(0.0, f64::max),
    };
    let is_of_stored = largest > 0.0 && largest < f64::from(1u32 << stored);
    Ok(if is_of_stored { stored } else { 16 })
}

/// Coding of a block.
struct Coded {
    compression: u32,
    bits: u32,
    channels: usize,
    big_endian: bool,
}

impl Coded {
    /// Values of a block of `size` pixels, of which `seen` lie inside the picture, and the number
    /// of values per row.
    fn decode(
        &self,
        data: &[u8],
        size: [usize; 2],
        #[cfg_attr(not(feature = "jxl"), expect(unused_variables))] seen: [usize; 2],
    ) -> Result<(usize, Vec<u16>), String> {
        let line = self.channels * size[0];
        match self.compression {
            UNCOMPRESSED => {
                Ok((line, unpacked(data, [line, size[1]], self.bits, self.big_endian)?))
            }
            #[cfg(feature = "jxl")]
            JPEG_XL => {
                let (width, values) =
                    jpeg_xl::decode(data, [size, seen], self.channels, self.bits)?;
                Ok((self.channels * width, values))
            }
            _ => Ok((line, lossless_jpeg::decode(data, line * size[1])?)),
        }
    }
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
        // Tiles may extend beyond the picture, but not by many times its size.
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

    fn data<'a>(&self, tiff: &Tiff<'a>, block: usize) -> Result<&'a [u8], String> {
        let (start, count) = (self.offsets[block] as usize, self.bytes[block] as usize);
        let truncated =
            || format!("truncated: block {block} of the raw picture lies behind the end");
        tiff.range(start, count).ok_or_else(truncated)
    }

    /// Size of a block that shows `rows` rows.
    fn stored(&self, rows: usize) -> [usize; 2] {
        [self.size[0], if self.padded { self.size[1] } else { rows }]
    }
}

/// Restores the order of rows and columns. Some files store every second one first, so that all
/// pixels of one filter colour are adjacent.
fn deinterleaved(
    directory: &Directory,
    stored: Vec<u16>,
    size: [usize; 2],
    channels: usize,
) -> Result<Vec<u16>, String> {
    let mut sources = [Vec::new(), Vec::new()];
    let mut is_in_order = true;
    for (axis, tag) in INTERLEAVES.into_iter().enumerate() {
        let (count, fields) = (size[axis], directory.whole(tag)?.unwrap_or(1) as usize);
        if fields == 0 || fields > count {
            return Err(format!("tag {tag} is {fields}; 1 to {count} fields are expected"));
        }
        is_in_order &= fields == 1;
        // The rows are divided among the fields; the first fields get the remainder.
        let start = |field: usize| field * (count / fields) + field.min(count % fields);
        sources[axis] = (0..count).map(|i| start(i % fields) + i / fields).collect();
    }
    if is_in_order {
        return Ok(stored);
    }
    let [columns, rows] = &sources;
    let mut out = Vec::with_capacity(stored.len());
    for row in rows {
        for column in columns {
            let at = channels * (row * size[0] + column);
            out.extend_from_slice(&stored[at..at + channels]);
        }
    }
    Ok(out)
}

/// Uncompressed values; rows begin at whole bytes. 16-bit values have the file's byte order, others
/// are packed with the highest bit first.
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
