//! Repair of JPEG files without an end marker.

/// More than the look-ahead of decoders.
const AHEAD: usize = 64;
/// Entropy-coded bytes without markers, which begin with different bits.
const FILLINGS: [u8; 2] = [0x00, 0xFE];
const END: [u8; 2] = [0xFF, 0xD9];

/// Whether the markers of a file lead to its end-of-image marker. Segments are skipped by length,
/// because an embedded thumbnail has its own end marker.
pub fn is_complete(bytes: &[u8]) -> bool {
    let mut at = 2;
    loop {
        // Skip entropy-coded data and fill bytes up to the next marker; FF00 is a stuffed FF.
        while bytes
            .get(at)
            .zip(bytes.get(at + 1))
            .is_some_and(|(&a, &b)| a != 0xFF || b == 0x00 || b == 0xFF)
        {
            at += 1;
        }
        match bytes.get(at + 1) {
            None => return false,
            Some(0xD9) => return true,
            Some(0x01 | 0xD0..=0xD8) => at += 2,
            Some(_) => match (bytes.get(at + 2), bytes.get(at + 3)) {
                (Some(&high), Some(&low)) => {
                    at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2);
                }
                _ => return false,
            },
        }
    }
}

/// The file with an end marker, if only that was missing. Decoders silently replace missing data by
/// gray, so the picture is complete if bytes appended to the data do not change it.
pub fn with_end(bytes: &[u8], pixels: impl Fn(&[u8]) -> Option<Vec<u8>>) -> Option<Vec<u8>> {
    let data = bytes.len() - bytes.iter().rev().take_while(|byte| **byte == 0xFF).count();
    let ended = |filling: &[u8]| [&bytes[..data], filling, &END].concat();
    let [a, b] = FILLINGS.map(|byte| pixels(&ended(&[byte; AHEAD])));
    (a.is_some() && a == b).then(|| ended(&[]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    use image::codecs::jpeg::JpegDecoder;
    use image::{DynamicImage, ImageFormat};

    fn pixels(bytes: &[u8]) -> Option<Vec<u8>> {
        let decoder = JpegDecoder::new(Cursor::new(bytes)).ok()?;
        Some(DynamicImage::from_decoder(decoder).ok()?.into_bytes())
    }

    /// Truncates at every byte: a file counts as complete exactly if its picture is unchanged.
    #[test]
    fn nothing_but_the_end_may_be_missing() {
        for detail in [3, 61] {
            let picture = image::RgbImage::from_fn(72, 40, |x, y| {
                image::Rgb([(x * detail) as u8, (y * 5) as u8, ((x * y) % 251) as u8])
            });
            let mut whole = Cursor::new(Vec::new());
            DynamicImage::from(picture).write_to(&mut whole, ImageFormat::Jpeg).unwrap();
            let whole = whole.into_inner();
            let expected = pixels(&whole).unwrap();
            assert!(is_complete(&whole));
            for cut in 1..=2 {
                let bytes = &whole[..whole.len() - cut];
                assert!(!is_complete(bytes));
                let mended = with_end(bytes, pixels).expect("only the end is missing");
                assert_eq!(pixels(&mended).unwrap(), expected, "{cut}");
            }
            let scan = whole.windows(2).position(|pair| pair == [0xFF, 0xDA]).unwrap() + 14;
            for end in scan..whole.len() - 2 {
                if let Some(mended) = with_end(&whole[..end], pixels) {
                    assert!(pixels(&mended).unwrap() == expected, "{end} of {}", whole.len());
                }
            }
        }
    }
}
