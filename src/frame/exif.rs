//! The one number of a photograph's metadata that calibration asks for.

/// `FocalLengthIn35mmFilm`, mm, inside the Exif directory.
const FOCAL_35MM: u16 = 0xA405;
/// Pointer from the first directory to the Exif directory.
const EXIF_DIRECTORY: u16 = 0x8769;
const SHORT: u16 = 3;
const LONG: u16 = 4;
/// Lenses there are, mm.
const PLAUSIBLE: std::ops::RangeInclusive<f32> = 5.0..=2000.0;

/// Focal length on film 36 x 24 mm that shows as much, from an Exif block (a TIFF header and its
/// directories); `None` where it is absent, 0 (unknown) or damaged.
pub(super) fn focal_35mm(block: &[u8]) -> Option<f32> {
    let block = block.strip_prefix(b"Exif\0\0").unwrap_or(block);
    let tiff = Tiff { block, big: block.starts_with(b"MM") };
    if !tiff.big && !block.starts_with(b"II") {
        return None;
    }
    let exif = tiff.find(tiff.long(4)?, EXIF_DIRECTORY)?;
    let focal = tiff.find(exif, FOCAL_35MM)? as f32;
    PLAUSIBLE.contains(&focal).then_some(focal)
}

struct Tiff<'a> {
    block: &'a [u8],
    big: bool,
}

impl Tiff<'_> {
    fn bytes<const N: usize>(&self, at: u32) -> Option<[u8; N]> {
        let at = at as usize;
        self.block.get(at..at.checked_add(N)?)?.try_into().ok()
    }

    fn short(&self, at: u32) -> Option<u16> {
        let bytes = self.bytes(at)?;
        Some(if self.big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn long(&self, at: u32) -> Option<u32> {
        let bytes = self.bytes(at)?;
        Some(if self.big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// A single whole number of the directory at `at`.
    fn find(&self, at: u32, tag: u16) -> Option<u32> {
        let count = self.short(at)?;
        (0..u32::from(count)).find_map(|i| {
            let entry = at.checked_add(2 + 12 * i)?;
            if self.short(entry)? != tag {
                return None;
            }
            match self.short(entry.checked_add(2)?)? {
                SHORT => self.short(entry.checked_add(8)?).map(u32::from),
                LONG => self.long(entry.checked_add(8)?),
                _ => None,
            }
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A block with one entry in each directory.
    pub(crate) fn block(big: bool, focal: u16) -> Vec<u8> {
        let short = |v: u16| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let long = |v: u32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let mut block = if big { b"MM".to_vec() } else { b"II".to_vec() };
        block.extend(short(42));
        block.extend(long(8));
        for (tag, kind, value) in [
            (EXIF_DIRECTORY, LONG, long(26)),
            (FOCAL_35MM, SHORT, {
                let [a, b] = short(focal);
                [a, b, 0, 0]
            }),
        ] {
            block.extend(short(1));
            block.extend(short(tag));
            block.extend(short(kind));
            block.extend(long(1));
            block.extend(value);
            block.extend(long(0));
        }
        block
    }

    #[test]
    fn both_byte_orders_are_read() {
        for big in [false, true] {
            let block = block(big, 26);
            assert_eq!(focal_35mm(&block), Some(26.0));
            assert_eq!(focal_35mm(&[b"Exif\0\0".as_slice(), &block].concat()), Some(26.0));
        }
        assert_eq!(focal_35mm(&block(true, 0)), None);
    }

    #[test]
    fn damaged_blocks_give_nothing() {
        let good = block(false, 26);
        for end in 0..good.len() - 6 {
            assert_eq!(focal_35mm(&good[..end]), None, "{end}");
        }
        let mut far = good.clone();
        far[4..8].fill(0xFF);
        assert_eq!(focal_35mm(&far), None);
        assert_eq!(focal_35mm(b"XX**"), None);
    }
}
