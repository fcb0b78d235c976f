//! Focal length from a photograph's metadata.

use exif::{In, Reader, Tag};

/// Plausible focal lengths, mm.
const PLAUSIBLE: std::ops::RangeInclusive<f32> = 5.0..=2000.0;

/// Focal length with the same field of view on 36 x 24 mm film, from an Exif block (a TIFF header
/// and its directories); `None` if absent, 0 (unknown) or damaged.
pub(super) fn focal_35mm(mut block: Vec<u8>) -> Option<f32> {
    if block.starts_with(b"Exif\0\0") {
        block.drain(..6);
    }
    let mut reader = Reader::new();
    let read = reader.continue_on_error(true).read_raw(block);
    let exif = read.or_else(|fault| fault.distill_partial_result(|_| ())).ok()?;
    let field = exif.get_field(Tag::FocalLengthIn35mmFilm, In::PRIMARY)?;
    let focal = field.value.get_uint(0)? as f32;
    PLAUSIBLE.contains(&focal).then_some(focal)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const EXIF_DIRECTORY: u16 = 0x8769;
    const FOCAL_35MM: u16 = 0xA405;
    const SHORT: u16 = 3;
    const LONG: u16 = 4;

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
            assert_eq!(focal_35mm(block.clone()), Some(26.0));
            assert_eq!(focal_35mm([b"Exif\0\0".as_slice(), &block].concat()), Some(26.0));
        }
        assert_eq!(focal_35mm(block(true, 0)), None);
    }

    #[test]
    fn damaged_blocks_give_nothing() {
        let good = block(false, 26);
        for end in 0..good.len() - 6 {
            assert_eq!(focal_35mm(good[..end].to_vec()), None, "{end}");
        }
        let mut far = good.clone();
        far[4..8].fill(0xFF);
        assert_eq!(focal_35mm(far), None);
        assert_eq!(focal_35mm(b"XX**".to_vec()), None);
    }
}
