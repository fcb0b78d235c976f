//! Directories of TIFF files.

/// Most values per field; lists of tiles are the longest.
const MOST_VALUES: usize = 1 << 20;
/// Most directories below one field.
const MOST_DIRECTORIES: usize = 64;
/// Bytes of a directory's entry.
const ENTRY: usize = 12;

/// A file with a TIFF header.
#[derive(Clone, Copy)]
pub struct Tiff<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

/// A list of fields that describe a picture.
pub struct Directory<'a> {
    tiff: Tiff<'a>,
    fields: Vec<Field<'a>>,
}

struct Field<'a> {
    tag: u16,
    kind: u16,
    count: usize,
    /// `None` if beyond the end of the file.
    data: Option<&'a [u8]>,
}

impl<'a> Tiff<'a> {
    pub fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let big_endian = match bytes.get(..4) {
            Some(b"II\x2A\0") => false,
            Some(b"MM\0\x2A") => true,
            _ => return Err("not a DNG file: it has no TIFF header".into()),
        };
        Ok(Self { bytes, big_endian })
    }

    pub fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    /// The directory referred to by the header.
    pub fn first(&self) -> Result<Directory<'a>, String> {
        self.directory(self.long(4).ok_or("truncated in its header")? as usize)
    }

    /// The directories referred to by a field.
    pub fn below(&self, parent: &Directory<'a>, tag: u16) -> Result<Vec<Directory<'a>>, String> {
        let offsets = parent.numbers(tag)?.unwrap_or_default();
        if offsets.len() > MOST_DIRECTORIES {
            return Err(format!("tag {tag} names {} directories", offsets.len()));
        }
        offsets.into_iter().map(|at| self.directory(at as usize)).collect()
    }

    /// A range of the file.
    pub fn range(&self, start: usize, count: usize) -> Option<&'a [u8]> {
        self.bytes.get(start..start.checked_add(count)?)
    }

    fn directory(&self, at: usize) -> Result<Directory<'a>, String> {
        let truncated = || format!("truncated: the directory at byte {at} is not whole");
        let count = usize::from(self.short(at).ok_or_else(truncated)?);
        let entries = self.range(at + 2, ENTRY * count).ok_or_else(truncated)?;
        let fields = (0..entries.len() / ENTRY).filter_map(|i| self.field(at + 2 + ENTRY * i));
        Ok(Directory { tiff: *self, fields: fields.collect() })
    }

    fn field(&self, at: usize) -> Option<Field<'a>> {
        let (tag, kind, count) =
            (self.short(at)?, self.short(at + 2)?, self.long(at + 4)? as usize);
        let bytes = count.saturating_mul(width(kind)?);
        let start = if bytes <= 4 { at + 8 } else { self.long(at + 8)? as usize };
        Some(Field { tag, kind, count, data: self.range(start, bytes) })
    }

    fn short(&self, at: usize) -> Option<u16> {
        Some(self.u16(self.range(at, 2)?.try_into().ok()?))
    }

    fn long(&self, at: usize) -> Option<u32> {
        Some(self.u32(self.range(at, 4)?.try_into().ok()?))
    }

    fn u16(&self, bytes: [u8; 2]) -> u16 {
        if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
    }

    fn u32(&self, bytes: [u8; 4]) -> u32 {
        if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    fn u64(&self, bytes: [u8; 8]) -> u64 {
        if self.big_endian { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) }
    }

    /// A value of a field as a number.
    fn number(&self, kind: u16, bytes: &[u8]) -> Option<f64> {
        let four = |at: usize| Some(self.u32(bytes.get(at..at + 4)?.try_into().ok()?));
        let two = || Some(self.u16(bytes.try_into().ok()?));
        Some(match kind {
            1 | 2 | 7 => f64::from(*bytes.first()?),
            3 => f64::from(two()?),
            4 | 13 => f64::from(four(0)?),
            5 => f64::from(four(0)?) / f64::from(four(4)?),
            6 => f64::from(bytes.first()?.cast_signed()),
            8 => f64::from(two()?.cast_signed()),
            9 => f64::from(four(0)?.cast_signed()),
            10 => f64::from(four(0)?.cast_signed()) / f64::from(four(4)?.cast_signed()),
            11 => f64::from(f32::from_bits(four(0)?)),
            12 => f64::from_bits(self.u64(bytes.try_into().ok()?)),
            _ => return None,
        })
    }
}

impl<'a> Directory<'a> {
    /// Raw bytes of a field.
    pub fn bytes(&self, tag: u16) -> Result<Option<&'a [u8]>, String> {
        let Some(field) = self.fields.iter().find(|field| field.tag == tag) else {
            return Ok(None);
        };
        let data = field.data.ok_or_else(|| format!("truncated: tag {tag} lies behind the end"))?;
        Ok(Some(data))
    }

    /// The finite numbers of a field.
    pub fn numbers(&self, tag: u16) -> Result<Option<Vec<f64>>, String> {
        let Some(data) = self.bytes(tag)? else { return Ok(None) };
        let field = self.fields.iter().find(|field| field.tag == tag);
        let (kind, count) = field.map_or((0, 0), |field| (field.kind, field.count));
        if count > MOST_VALUES {
            return Err(format!("tag {tag} has {count} values; at most {MOST_VALUES} are read"));
        }
        let values = data.chunks_exact(width(kind).unwrap_or(1));
        let values: Option<Vec<f64>> =
            values.map(|v| self.tiff.number(kind, v).filter(|v| v.is_finite())).collect();
        values.map(Some).ok_or_else(|| format!("tag {tag} holds what is not a number"))
    }

    /// Exactly `N` numbers of a field.
    pub fn exactly<const N: usize>(&self, tag: u16) -> Result<Option<[f64; N]>, String> {
        let Some(values) = self.numbers(tag)? else { return Ok(None) };
        let count = values.len();
        let wrong = |_| format!("tag {tag} has {count} values; {N} are expected");
        values.try_into().map(Some).map_err(wrong)
    }

    /// The first number of a field, which must be a non-negative integer.
    pub fn whole(&self, tag: u16) -> Result<Option<u32>, String> {
        let first = self.numbers(tag)?.and_then(|values| values.first().copied());
        let Some(value) = first else { return Ok(None) };
        let is_whole = value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value);
        is_whole.then_some(Some(value as u32)).ok_or_else(|| format!("tag {tag} is {value}"))
    }
}

/// Bytes of a value.
fn width(kind: u16) -> Option<usize> {
    Some(match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 => 8,
        _ => return None,
    })
}
