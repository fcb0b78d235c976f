//! Sections of a saved session and the numbers inside them, little-endian.
//!
//! `SVBRDFST`, major and minor version (`u16`), number of sections (`u32`), CRC-32 of these 16
//! bytes. Each section: four letters, length (`u64`), content, CRC-32 of all three. A version that
//! is newer in its minor number only may add sections, and fields at the end of sections; both are
//! skipped.

use half::f16;

use crate::observation::Packed;
use crate::{Error, Result, StateFault};

/// First bytes of a saved session.
pub(super) const MAGIC: &[u8; 8] = b"SVBRDFST";
/// Version written; another major version is another format.
pub(super) const MAJOR: u16 = 1;
pub(super) const MINOR: u16 = 0;

const HEADER: usize = 20;
const SECTION: usize = 16;

/// Four letters.
pub(super) type Tag = [u8; 4];

/// The fault of bytes that are not what was written.
pub(super) fn damaged(what: impl Into<String>) -> Error {
    Error::State(StateFault::Damaged(what.into()))
}

/// A saved session in the making.
pub(in crate::session) struct StateWriter {
    bytes: Vec<u8>,
    sections: u32,
}

impl StateWriter {
    pub(in crate::session) fn new() -> Self {
        Self { bytes: vec![0; HEADER], sections: 0 }
    }

    /// Adds a section.
    pub(super) fn section(&mut self, tag: &Tag, fill: impl FnOnce(&mut Writer)) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(tag);
        self.bytes.extend_from_slice(&[0; 8]);
        let mut writer = Writer(std::mem::take(&mut self.bytes));
        fill(&mut writer);
        self.bytes = writer.0;
        let length = (self.bytes.len() - start - 12) as u64;
        self.bytes[start + 4..start + 12].copy_from_slice(&length.to_le_bytes());
        let sum = crc32fast::hash(&self.bytes[start..]);
        self.bytes.extend_from_slice(&sum.to_le_bytes());
        self.sections += 1;
    }

    /// The whole file.
    pub(in crate::session) fn finish(self) -> Vec<u8> {
        self.finish_as(MAJOR, MINOR)
    }

    pub(super) fn finish_as(mut self, major: u16, minor: u16) -> Vec<u8> {
        let mut header = Vec::with_capacity(HEADER);
        header.extend_from_slice(MAGIC);
        header.extend_from_slice(&major.to_le_bytes());
        header.extend_from_slice(&minor.to_le_bytes());
        header.extend_from_slice(&self.sections.to_le_bytes());
        let sum = crc32fast::hash(&header);
        header.extend_from_slice(&sum.to_le_bytes());
        self.bytes[..HEADER].copy_from_slice(&header);
        self.bytes
    }
}

/// Content of a section.
pub(super) struct Writer(Vec<u8>);

macro_rules! write_numbers {
    ($($name:ident: $type:ty),*) => {
        $(pub(super) fn $name(&mut self, value: $type) {
            self.0.extend_from_slice(&value.to_le_bytes());
        })*
    };
}

impl Writer {
    write_numbers!(u8: u8, u16: u16, u32: u32, i32: i32, f32: f32, f64: f64);

    pub(super) fn flag(&mut self, value: bool) {
        self.u8(value.into());
    }

    /// Whether there is a value, then the value.
    pub(super) fn option<T>(&mut self, value: Option<T>, write: impl FnOnce(&mut Self, T)) {
        self.flag(value.is_some());
        if let Some(value) = value {
            write(self, value);
        }
    }

    pub(super) fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|&v| self.f64(v));
    }

    pub(super) fn f32s(&mut self, values: &[f32]) {
        self.0.reserve(4 * values.len());
        values.iter().for_each(|&v| self.f32(v));
    }

    pub(super) fn u16s(&mut self, values: &[u16]) {
        self.0.reserve(2 * values.len());
        values.iter().for_each(|&v| self.u16(v));
    }

    /// Half floats; what is too large becomes the largest. Zero is kept, and what is not zero stays
    /// so: a sign or a positive weight means something.
    pub(super) fn halves(&mut self, values: &[f32]) {
        self.0.reserve(2 * values.len());
        for &v in values {
            let size = v.abs().min(f16::MAX.to_f32());
            let mut half = f16::from_f32(size.copysign(v));
            if half.to_bits() & 0x7FFF == 0 && v != 0.0 {
                half = f16::from_bits(half.to_bits() | 1);
            }
            self.0.extend_from_slice(&half.to_le_bytes());
        }
    }

    /// Radiances and weights as they are.
    pub(super) fn packed(&mut self, values: &[Packed]) {
        self.0.reserve(2 * values.len());
        values.iter().for_each(|v| self.0.extend_from_slice(&v.to_le_bytes()));
    }

    pub(super) fn bytes(&mut self, values: &[u8]) {
        self.0.extend_from_slice(values);
    }

    pub(super) fn text(&mut self, text: &str) {
        self.u32(text.len() as u32);
        self.bytes(text.as_bytes());
    }
}

/// The sections of a saved session, checked.
#[derive(Debug)]
pub(super) struct Sections<'a> {
    /// Whether later versions may have added fields.
    pub(super) newer_minor: bool,
    sections: Vec<(Tag, &'a [u8])>,
}

impl<'a> Sections<'a> {
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self> {
        let (header, mut rest) = match bytes.split_at_checked(HEADER) {
            Some(parts) => parts,
            None if !bytes.is_empty() && MAGIC.starts_with(&bytes[..bytes.len().min(8)]) => {
                return Err(Error::State(StateFault::Truncated));
            }
            None => return Err(Error::State(StateFault::Foreign)),
        };
        if !header.starts_with(MAGIC) {
            return Err(Error::State(StateFault::Foreign));
        }
        let (stated, sum) = header.split_at(16);
        if crc32fast::hash(stated).to_le_bytes() != sum {
            return Err(damaged("the checksum of the header does not match"));
        }
        let number = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
        let (major, minor) = (number(8), number(10));
        if major > MAJOR {
            return Err(Error::State(StateFault::Newer { found: major, known: MAJOR }));
        }
        let count = u32::from_le_bytes([header[12], header[13], header[14], header[15]]);
        let mut sections = Vec::new();
        for _ in 0..count {
            let (tag, section, after) = section(rest)?;
            sections.push((tag, section));
            rest = after;
        }
        if !rest.is_empty() {
            return Err(damaged("there are bytes after the last section"));
        }
        Ok(Self { newer_minor: major == MAJOR && minor > MINOR, sections })
    }

    /// Contents of all sections of that name, in their order.
    pub(super) fn all(&self, tag: &Tag) -> impl Iterator<Item = Reader<'a>> {
        let newer_minor = self.newer_minor;
        let named = self.sections.iter().filter(move |(t, _)| t == tag);
        named.map(move |&(_, bytes)| Reader { bytes, newer_minor })
    }

    /// Content of a section that has to be there.
    pub(super) fn one(&self, tag: &Tag) -> Result<Reader<'a>> {
        self.all(tag)
            .next()
            .ok_or_else(|| damaged(format!("section {} is missing", String::from_utf8_lossy(tag))))
    }

    /// Names and contents.
    #[cfg(test)]
    pub(super) fn raw(&self) -> &[(Tag, &'a [u8])] {
        &self.sections
    }
}

/// The first section of some bytes: its name, its content, the bytes after it.
fn section(bytes: &[u8]) -> Result<(Tag, &[u8], &[u8])> {
    let truncated = || Error::State(StateFault::Truncated);
    let start = bytes.get(..12).ok_or_else(truncated)?;
    let tag = [start[0], start[1], start[2], start[3]];
    let mut length = [0; 8];
    length.copy_from_slice(&start[4..]);
    let length = usize::try_from(u64::from_le_bytes(length)).map_err(|_| truncated())?;
    let all = length.checked_add(SECTION).filter(|&n| n <= bytes.len()).ok_or_else(truncated)?;
    let (whole, after) = bytes.split_at(all);
    let (content, sum) = whole.split_at(12 + length);
    if crc32fast::hash(content).to_le_bytes() != sum {
        return Err(damaged(format!(
            "the checksum of section {} does not match",
            String::from_utf8_lossy(&tag)
        )));
    }
    Ok((tag, &content[12..], after))
}

/// Reads the content of a section.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    newer_minor: bool,
}

macro_rules! read_numbers {
    ($($name:ident: $type:ty),*) => {
        $(pub(super) fn $name(&mut self) -> Result<$type> {
            let mut bytes = [0; size_of::<$type>()];
            bytes.copy_from_slice(self.take(size_of::<$type>())?);
            Ok(<$type>::from_le_bytes(bytes))
        })*
    };
}

impl<'a> Reader<'a> {
    read_numbers!(u8: u8, u32: u32, u64: u64, i32: i32);

    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let (taken, rest) =
            self.bytes.split_at_checked(count).ok_or_else(|| damaged("a section is too short"))?;
        self.bytes = rest;
        Ok(taken)
    }

    /// Whether every field has been read.
    pub(super) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Every field has been read.
    pub(super) fn end(self) -> Result<()> {
        if self.bytes.is_empty() || self.newer_minor {
            return Ok(());
        }
        Err(damaged("a section is too long"))
    }

    /// A finite number.
    pub(super) fn f32(&mut self) -> Result<f32> {
        finite(f32::from_bits(self.u32()?))
    }

    /// A finite number.
    pub(super) fn f64(&mut self) -> Result<f64> {
        let value = f64::from_bits(self.u64()?);
        if value.is_finite() { Ok(value) } else { Err(damaged(NOT_A_NUMBER)) }
    }

    /// Any number, infinite ones and NaN included.
    pub(super) fn any_f64(&mut self) -> Result<f64> {
        Ok(f64::from_bits(self.u64()?))
    }

    /// Any number, infinite ones and NaN included.
    pub(super) fn any_f32(&mut self) -> Result<f32> {
        Ok(f32::from_bits(self.u32()?))
    }

    pub(super) fn flag(&mut self) -> Result<bool> {
        match self.u8()? {
            0 => Ok(false),
            1 => Ok(true),
            other => Err(damaged(format!("{other} is not a boolean"))),
        }
    }

    pub(super) fn option<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T>,
    ) -> Result<Option<T>> {
        if self.flag()? { read(self).map(Some) } else { Ok(None) }
    }

    /// A number of items of at least `bytes_each` that follow.
    pub(super) fn count(&mut self, bytes_each: usize) -> Result<usize> {
        let count = self.u32()? as usize;
        if count.checked_mul(bytes_each).is_none_or(|n| n > self.bytes.len()) {
            return Err(damaged("a section is too short"));
        }
        Ok(count)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for v in &mut values {
            *v = self.f64()?;
        }
        Ok(values)
    }

    pub(super) fn three_f32s(&mut self) -> Result<[f32; 3]> {
        Ok([self.f32()?, self.f32()?, self.f32()?])
    }

    pub(super) fn f32s(&mut self, count: usize) -> Result<Vec<f32>> {
        let bytes = self.take(count.saturating_mul(4))?;
        bytes.as_chunks::<4>().0.iter().map(|&b| finite(f32::from_le_bytes(b))).collect()
    }

    pub(super) fn u16s(&mut self, count: usize) -> Result<Vec<u16>> {
        let bytes = self.take(count.saturating_mul(2))?;
        Ok(bytes.as_chunks::<2>().0.iter().map(|&b| u16::from_le_bytes(b)).collect())
    }

    pub(super) fn halves(&mut self, count: usize) -> Result<Vec<f32>> {
        let bytes = self.take(count.saturating_mul(2))?;
        bytes.as_chunks::<2>().0.iter().map(|&b| finite(f16::from_le_bytes(b).to_f32())).collect()
    }

    pub(super) fn packed(&mut self, count: usize) -> Result<Vec<Packed>> {
        let bytes = self.take(count.saturating_mul(2))?;
        let values = bytes.as_chunks::<2>().0.iter().map(|&b| Packed::from_le_bytes(b));
        let checked = |v: Packed| {
            if f16::from_bits(v).is_finite() { Ok(v) } else { Err(damaged(NOT_A_NUMBER)) }
        };
        values.map(checked).collect()
    }

    pub(super) fn text(&mut self) -> Result<String> {
        let count = self.count(1)?;
        let text = std::str::from_utf8(self.take(count)?);
        Ok(text.map_err(|_| damaged("a string is not valid UTF-8"))?.to_owned())
    }
}

const NOT_A_NUMBER: &str = "a value is not a number";

fn finite(value: f32) -> Result<f32> {
    if value.is_finite() { Ok(value) } else { Err(damaged(NOT_A_NUMBER)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_keep_signs_zeros_and_sizes() {
        let values = [0.0, -0.0, 1e-9, -1e-9, 0.25, -0.731, 1e9, 1.0];
        let mut writer = StateWriter::new();
        writer.section(b"TEST", |w| w.halves(&values));
        let bytes = writer.finish();
        let sections = Sections::read(&bytes).unwrap();
        let back = sections.one(b"TEST").unwrap().halves(values.len()).unwrap();
        assert_eq!(back[..2], [0.0, 0.0]);
        assert!(back[2] > 0.0 && back[3] < 0.0 && back[6] == 65504.0);
        for i in [4, 5, 7] {
            // eleven bits
            assert!((back[i] - values[i]).abs() <= values[i].abs() / 2048.0);
        }
    }

    #[test]
    fn every_flipped_bit_and_every_missing_byte_is_noticed() {
        let mut writer = StateWriter::new();
        writer.section(b"ONE ", |w| w.text("some text"));
        writer.section(b"TWO ", |w| w.f32s(&[1.0, 2.0]));
        let bytes = writer.finish();
        assert!(Sections::read(&bytes).is_ok());
        for bit in 0..8 * bytes.len() {
            let mut bad = bytes.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(matches!(Sections::read(&bad), Err(Error::State(_))), "bit {bit}");
        }
        for end in 0..bytes.len() {
            let fault = Sections::read(&bytes[..end]).unwrap_err();
            let expected = if end == 0 { StateFault::Foreign } else { StateFault::Truncated };
            assert!(matches!(fault, Error::State(f) if f == expected), "{end} bytes");
        }
        assert!(Sections::read(&[&bytes[..], b"x"].concat()).is_err());
    }

    #[test]
    fn newer_minor_versions_are_read_newer_major_ones_are_named() {
        let write = |major, minor| {
            let mut writer = StateWriter::new();
            writer.section(b"OLD ", |w| {
                w.u32(7);
                w.u32(8); // a field that this version does not know
            });
            writer.section(b"NEW ", |w| w.u32(9));
            writer.finish_as(major, minor)
        };
        let bytes = write(MAJOR, MINOR + 1);
        let mut reader = Sections::read(&bytes).unwrap().one(b"OLD ").unwrap();
        assert_eq!(reader.u32().unwrap(), 7);
        assert!(reader.end().is_ok());
        let bytes = write(MAJOR, MINOR);
        let mut reader = Sections::read(&bytes).unwrap().one(b"OLD ").unwrap();
        assert_eq!(reader.u32().unwrap(), 7);
        assert!(reader.end().is_err(), "nothing unknown is passed over in what we write");
        let fault = Sections::read(&write(MAJOR + 1, 0)).unwrap_err();
        let expected = StateFault::Newer { found: MAJOR + 1, known: MAJOR };
        assert!(matches!(fault, Error::State(f) if f == expected));
    }
}
