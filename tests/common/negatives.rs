//! A writer of DNG files.

use std::path::Path;

/// How sensor values are stored.
#[derive(Clone, Copy, Debug)]
pub enum Storage {
    /// Uncompressed strips of so many rows.
    Strips(u32),
    /// Uncompressed tiles of a size.
    Tiles(u32, u32),
    /// Tiles of a size as lossless JPEG with a predictor and a number of components.
    Jpeg(u32, u32, u8, u32),
    /// Tiles of a size with a value of `Compression`, which an encoder makes of rows of values, bits and
    /// channels.
    Coded(u32, u32, u16, Encoder),
}

/// Rows of values, bits, and values of a pixel to the bytes of a tile.
pub type Encoder = fn(&[Vec<u16>], u32, u32) -> Vec<u8>;

/// Values of a field.
#[derive(Clone)]
pub enum Values {
    Bytes(Vec<u8>),
    Text(&'static str),
    Shorts(Vec<u16>),
    Longs(Vec<u32>),
    /// Rational numbers of either sign, in millionths.
    Millionths(Vec<f64>),
    Raw(Vec<u8>),
}

/// A file to be written.
#[derive(Clone)]
pub struct Negative {
    pub size: [u32; 2],
    pub bits: u32,
    /// Values of a pixel, side by side in `samples`: 1 behind colour filters, 3 of `LinearRaw`.
    pub channels: u32,
    pub samples: Vec<u16>,
    pub storage: Storage,
    pub big_endian: bool,
    /// Whether the raw picture lies in a directory below the first, as Adobe's converter does it.
    pub below: bool,
    /// Fields besides those of the storage; the last of a tag counts.
    pub fields: Vec<(u16, Values)>,
}

impl Negative {
    pub fn set(mut self, tag: u16, values: Values) -> Self {
        self.fields.retain(|(t, _)| *t != tag);
        self.fields.push((tag, values));
        self
    }

    pub fn without(mut self, tag: u16) -> Self {
        self.fields.retain(|(t, _)| *t != tag);
        self
    }

    pub fn save(&self, path: &Path) {
        std::fs::write(path, self.bytes()).unwrap();
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut file = if self.big_endian { b"MM\0\x2A".to_vec() } else { b"II\x2A\0".to_vec() };
        file.extend([0; 4]);
        let [w, h] = self.size;
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        for block in self.blocks() {
            offsets.push(file.len() as u32);
            counts.push(block.len() as u32);
            file.extend(block);
        }
        let compression = match self.storage {
            Storage::Jpeg(..) => 7,
            Storage::Coded(_, _, compression, _) => compression,
            _ => 1,
        };
        let mut raw = vec![
            (256, Values::Longs(vec![w])),
            (257, Values::Longs(vec![h])),
            (258, Values::Shorts(vec![self.bits as u16; self.channels as usize])),
            (259, Values::Shorts(vec![compression])),
            (262, Values::Shorts(vec![if self.channels == 1 { 32803 } else { 34892 }])),
            (277, Values::Shorts(vec![self.channels as u16])),
        ];
        raw.extend(match self.storage {
            Storage::Strips(rows) => vec![
                (273, Values::Longs(offsets)),
                (278, Values::Longs(vec![rows])),
                (279, Values::Longs(counts)),
            ],
            Storage::Tiles(w, h) | Storage::Jpeg(w, h, ..) | Storage::Coded(w, h, ..) => vec![
                (322, Values::Longs(vec![w])),
                (323, Values::Longs(vec![h])),
                (324, Values::Longs(offsets)),
                (325, Values::Longs(counts)),
            ],
        });
        let of_raw = |tag: &u16| {
            [256, 257, 258, 259, 262, 33421, 33422, 50829, 50975, 51009, 52547].contains(tag)
                || (50711..=50720).contains(tag)
        };
        let mut camera = Vec::new();
        for (tag, values) in &self.fields {
            let list = if of_raw(tag) || !self.below { &mut raw } else { &mut camera };
            list.retain(|(t, _)| t != tag);
            list.push((*tag, values.clone()));
        }
        let mut first = self.directory(&mut file, raw);
        if self.below {
            camera.push((262, Values::Shorts(vec![2])));
            camera.push((330, Values::Longs(vec![first])));
            first = self.directory(&mut file, camera);
        }
        let first = self.u32(first);
        file[4..8].copy_from_slice(&first);
        file
    }

    /// Puts a directory at the end of the file; where it lies.
    fn directory(&self, file: &mut Vec<u8>, mut fields: Vec<(u16, Values)>) -> u32 {
        fields.sort_by_key(|(tag, _)| *tag);
        let mut entries = self.u16(fields.len() as u16).to_vec();
        for (tag, values) in fields {
            let (kind, count, mut bytes) = self.encoded(&values);
            entries.extend(self.u16(tag));
            entries.extend(self.u16(kind));
            entries.extend(self.u32(count as u32));
            if bytes.len() <= 4 {
                bytes.resize(4, 0);
                entries.extend(bytes);
            } else {
                file.resize(file.len().next_multiple_of(2), 0);
                entries.extend(self.u32(file.len() as u32));
                file.extend(bytes);
            }
        }
        file.resize(file.len().next_multiple_of(2), 0);
        let at = file.len() as u32;
        file.extend(entries);
        file.extend([0; 4]);
        at
    }

    fn encoded(&self, values: &Values) -> (u16, usize, Vec<u8>) {
        match values {
            Values::Bytes(v) => (1, v.len(), v.clone()),
            Values::Text(v) => (2, v.len() + 1, [v.as_bytes(), &[0]].concat()),
            Values::Shorts(v) => (3, v.len(), v.iter().flat_map(|v| self.u16(*v)).collect()),
            Values::Longs(v) => (4, v.len(), v.iter().flat_map(|v| self.u32(*v)).collect()),
            Values::Millionths(v) => {
                let number = |v: &f64| {
                    [self.u32(((v * 1e6).round() as i32).cast_unsigned()), self.u32(1_000_000)]
                };
                (10, v.len(), v.iter().flat_map(number).flatten().collect())
            }
            Values::Raw(v) => (7, v.len(), v.clone()),
        }
    }

    fn u16(&self, v: u16) -> [u8; 2] {
        if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() }
    }

    fn u32(&self, v: u32) -> [u8; 4] {
        if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() }
    }

    fn blocks(&self) -> Vec<Vec<u8>> {
        let [width, height] = self.size;
        let (w, h) = match self.storage {
            Storage::Strips(rows) => (width, rows),
            Storage::Tiles(w, h) | Storage::Jpeg(w, h, ..) | Storage::Coded(w, h, ..) => (w, h),
        };
        let mut blocks = Vec::new();
        for y0 in (0..height).step_by(h as usize) {
            for x0 in (0..width).step_by(w as usize) {
                let strip = matches!(self.storage, Storage::Strips(_));
                let y1 = if strip { height.min(y0 + h) } else { y0 + h };
                // Pixels outside repeat the last value.
                let n = self.channels as usize;
                let at = |x: u32, y: u32| {
                    let pixel = (y.min(height - 1) * width + x.min(width - 1)) as usize;
                    self.samples[n * pixel..n * (pixel + 1)].iter().copied()
                };
                let rows: Vec<Vec<u16>> =
                    (y0..y1).map(|y| (x0..x0 + w).flat_map(|x| at(x, y)).collect()).collect();
                blocks.push(match self.storage {
                    Storage::Jpeg(_, _, predictor, components) => {
                        jpeg(&rows, self.bits, predictor, components as usize)
                    }
                    Storage::Coded(_, _, _, encoder) => encoder(&rows, self.bits, self.channels),
                    _ => rows.iter().flat_map(|row| self.packed(row)).collect(),
                });
            }
        }
        blocks
    }

    fn packed(&self, row: &[u16]) -> Vec<u8> {
        if self.bits == 16 {
            return row.iter().flat_map(|v| self.u16(*v)).collect();
        }
        let mut bits = Packer::default();
        row.iter().for_each(|v| bits.push(u32::from(*v), self.bits));
        bits.finish(0)
    }
}

/// Packs bits, the highest first.
#[derive(Default)]
struct Packer {
    bits: Vec<bool>,
}

impl Packer {
    fn push(&mut self, value: u32, count: u32) {
        self.bits.extend((0..count).rev().map(|i| value >> i & 1 == 1));
    }

    fn finish(mut self, fill: u8) -> Vec<u8> {
        self.bits.resize(self.bits.len().next_multiple_of(8), fill == 1);
        let byte = |b: &[bool]| b.iter().fold(0, |v, bit| v << 1 | u8::from(*bit));
        self.bits.chunks(8).map(byte).collect()
    }
}

/// Lossless JPEG: one Huffman code whose words all have 5 bits.
fn jpeg(rows: &[Vec<u16>], bits: u32, predictor: u8, n: usize) -> Vec<u8> {
    let (height, width) = (rows.len() as u16, (rows[0].len() / n) as u16);
    let [h, w] = [height.to_be_bytes(), width.to_be_bytes()];
    let mut out = vec![0xFF, 0xD8, 0xFF, 0xC3, 0, 8 + 3 * n as u8, bits as u8];
    out.extend([h[0], h[1], w[0], w[1], n as u8]);
    (0..n).for_each(|c| out.extend([c as u8, 0x11, 0]));
    out.extend([0xFF, 0xC4, 0, 2 + 17 + 17, 0]);
    out.extend((1..=16).map(|length| if length == 5 { 17 } else { 0 }));
    out.extend(0..=16u8);
    out.extend([0xFF, 0xDA, 0, 6 + 2 * n as u8, n as u8]);
    (0..n).for_each(|c| out.extend([c as u8, 0]));
    out.extend([predictor, 0, 0]);
    let mut packer = Packer::default();
    for y in 0..rows.len() {
        for x in 0..rows[0].len() {
            let at = |x: usize, y: usize| i64::from(rows[y][x]);
            let predicted = if x < n && y == 0 {
                1 << (bits - 1)
            } else if y == 0 {
                at(x - n, y)
            } else if x < n {
                at(x, y - 1)
            } else {
                let (a, b, c) = (at(x - n, y), at(x, y - 1), at(x - n, y - 1));
                [a, b, c, a + b - c, a + ((b - c) >> 1), b + ((a - c) >> 1), (a + b) >> 1]
                    [usize::from(predictor) - 1]
            };
            // Differences are modulo 2^16, from -32767 to 32768.
            let difference = (at(x, y) - predicted + 32_767).rem_euclid(65_536) - 32_767;
            let size = 64 - difference.unsigned_abs().leading_zeros();
            packer.push(size, 5);
            if size < 16 {
                let low = if difference < 0 { difference - 1 } else { difference };
                packer.push(low as u32, size);
            }
        }
    }
    for byte in packer.finish(1) {
        out.push(byte);
        if byte == 0xFF {
            out.push(0);
        }
    }
    out.extend([0xFF, 0xD9]);
    out
}
