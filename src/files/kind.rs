//! File type by content, because file names are unreliable.

use super::dng;
use crate::photo::is_tiff;

/// Format of a picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// JPEG, including Ultra HDR.
    Jpeg,
    /// PNG.
    Png,
    /// TIFF other than raw pictures.
    Tiff,
    /// OpenEXR.
    OpenExr,
    /// Digital negative.
    Dng,
    /// HEIF with HEVC: `.heic`, `.heif`.
    Heic,
    /// AVIF: HEIF with AV1.
    Avif,
    /// JPEG XL.
    JpegXl,
    /// WebP.
    WebP,
    /// A camera maker's own raw format: CR2, CR3, NEF, ARW, ORF, RW2, RAF, PEF and the like.
    MakerRaw,
    /// Portable any-map: PPM, PGM, PBM, PAM, PFM.
    NetPbm,
    /// Radiance HDR.
    Radiance,
    /// A video: MOV, MP4, AVI, Matroska.
    Video,
    /// A picture of another kind: GIF, BMP, Photoshop, JPEG 2000.
    Other,
}

/// Signatures at byte 0.
const BEGINNINGS: [(&[u8], Kind); 18] = [
    (&[0xFF, 0xD8, 0xFF], Kind::Jpeg),
    (b"\x89PNG\r\n\x1a\n", Kind::Png),
    (&[0x76, 0x2F, 0x31, 0x01], Kind::OpenExr),
    (&[0xFF, 0x0A], Kind::JpegXl),
    (b"\0\0\0\x0CJXL \r\n\x87\n", Kind::JpegXl),
    (b"II*\0\x10\0\0\0CR", Kind::MakerRaw),
    (b"IIRO", Kind::MakerRaw),
    (b"IIRS", Kind::MakerRaw),
    (b"MMOR", Kind::MakerRaw),
    (b"IIU\0", Kind::MakerRaw),
    (b"FUJIFILMCCD-RAW", Kind::MakerRaw),
    (b"FOVb", Kind::MakerRaw),
    (b"#?RADIANCE", Kind::Radiance),
    (b"#?RGBE", Kind::Radiance),
    (&[0x1A, 0x45, 0xDF, 0xA3], Kind::Video),
    (b"GIF8", Kind::Other),
    (b"8BPS", Kind::Other),
    (b"\0\0\0\x0CjP  \r\n\x87\n", Kind::Other),
];

/// Number of bytes from the start that [`Kind::of`] needs, except that it may take DNG and raw
/// files of makers for TIFF.
pub const HEAD_BYTES: usize = 4096;

impl Kind {
    /// The format by content; `None` for unknown data. From the first [`HEAD_BYTES`] alone, any
    /// file in TIFF format may be [`Kind::Tiff`].
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let known = BEGINNINGS.iter().find(|(start, _)| bytes.starts_with(start));
        if let Some((_, kind)) = known {
            return Some(*kind);
        }
        if bytes.get(4..8) == Some(b"ftyp") {
            return boxed(bytes);
        }
        if bytes.starts_with(b"BM") && bytes.get(6..10) == Some(&[0; 4]) {
            return Some(Self::Other);
        }
        if bytes.starts_with(b"RIFF") {
            return match bytes.get(8..12)? {
                b"WEBP" => Some(Self::WebP),
                b"AVI " => Some(Self::Video),
                _ => None,
            };
        }
        if is_net_pbm(bytes) {
            return Some(Self::NetPbm);
        }
        if is_tiff(bytes) {
            return Some(match dng::content(bytes) {
                dng::Content::Negative => Self::Dng,
                dng::Content::OtherRaw => Self::MakerRaw,
                dng::Content::Picture => Self::Tiff,
            });
        }
        None
    }

    /// Name with an article.
    pub fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "a JPEG picture",
            Self::Png => "a PNG picture",
            Self::Tiff => "a TIFF picture",
            Self::OpenExr => "an OpenEXR picture",
            Self::Dng => "a DNG file",
            Self::Heic => "a HEIC picture",
            Self::Avif => "an AVIF picture",
            Self::JpegXl => "a JPEG XL picture",
            Self::WebP => "a WebP picture",
            Self::MakerRaw => "a raw file of a camera maker",
            Self::NetPbm => "a PPM picture",
            Self::Radiance => "a Radiance HDR picture",
            Self::Video => "a video",
            Self::Other => "a picture of another format",
        }
    }

    /// Whether this build reads it.
    pub fn is_read(self) -> bool {
        let always =
            matches!(self, Self::Jpeg | Self::Png | Self::Tiff | Self::OpenExr | Self::Dng);
        always || (matches!(self, Self::Heic) && cfg!(feature = "heic"))
    }

    /// Advice for an unsupported file.
    pub fn advice(self) -> &'static str {
        match self {
            Self::Heic => {
                "convert it to JPEG or TIFF (iPhones write JPEG with Settings, Camera, Formats, Most Compatible)"
            }
            Self::MakerRaw => "convert it to DNG, with Adobe's DNG Converter for example",
            Self::Video => "photograph the sample with the flash instead",
            _ if cfg!(feature = "heic") => "convert it to JPEG, PNG, TIFF, OpenEXR, HEIC or DNG",
            _ => "convert it to JPEG, PNG, TIFF, OpenEXR or DNG",
        }
    }

    /// The formats that this build reads, for messages.
    pub fn all_read() -> &'static str {
        if cfg!(feature = "heic") {
            "JPEG, PNG, TIFF, OpenEXR, HEIC or DNG"
        } else {
            "JPEG, PNG, TIFF, OpenEXR or DNG"
        }
    }
}

/// Whether a file begins like a portable any-map: letter and digit, then a number or a comment.
fn is_net_pbm(bytes: &[u8]) -> bool {
    let &[b'P', b'1'..=b'7' | b'F' | b'f', space, next, ..] = bytes else { return false };
    space.is_ascii_whitespace() && (next.is_ascii_digit() || [b'#', b'W'].contains(&next))
}

/// Kind of a file made of boxes, by its list of brands.
fn boxed(bytes: &[u8]) -> Option<Kind> {
    let length = u32::from_be_bytes(*bytes.first_chunk()?) as usize;
    let list = bytes.get(8..length.min(bytes.len()))?;
    // The second word is a version.
    let brands: Vec<&[u8]> =
        list.chunks_exact(4).enumerate().filter(|(i, _)| *i != 1).map(|(_, b)| b).collect();
    let has = |wanted: &[&[u8; 4]]| brands.iter().any(|b| wanted.iter().any(|w| *b == *w));
    if has(&[b"avif", b"avis"]) {
        Some(Kind::Avif)
    } else if has(&[b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx"]) {
        Some(Kind::Heic)
    } else if has(&[b"crx "]) {
        Some(Kind::MakerRaw)
    } else if has(&[b"jxl "]) {
        Some(Kind::JpegXl)
    } else if has(&[b"mif1", b"msf1"]) {
        Some(Kind::Other)
    } else if has(&[
        b"qt  ", b"isom", b"iso2", b"mp41", b"mp42", b"avc1", b"M4V ", b"3gp4", b"3gp5",
    ]) {
        Some(Kind::Video)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ftyp(brands: &[&[u8; 4]]) -> Vec<u8> {
        let mut bytes = (12 + 4 * brands.len() as u32).to_be_bytes().to_vec();
        bytes.extend(b"ftyp");
        bytes.extend(brands[0]);
        bytes.extend([0; 4]);
        brands[1..].iter().for_each(|brand| bytes.extend(*brand));
        bytes.extend([0; 9]);
        bytes
    }

    #[test]
    fn content_tells_what_a_file_is() {
        for (bytes, kind) in [
            (b"\xFF\xD8\xFF\xE0....".to_vec(), Kind::Jpeg),
            (b"\x89PNG\r\n\x1a\n".to_vec(), Kind::Png),
            (ftyp(&[b"heic", b"mif1"]), Kind::Heic),
            (ftyp(&[b"mif1", b"mif1", b"heic"]), Kind::Heic),
            (ftyp(&[b"avif", b"mif1", b"miaf"]), Kind::Avif),
            (ftyp(&[b"mif1", b"avif"]), Kind::Avif),
            (ftyp(&[b"crx ", b"isom"]), Kind::MakerRaw),
            (b"\xFF\x0A\0\0".to_vec(), Kind::JpegXl),
            (b"\0\0\0\x0CJXL \r\n\x87\n".to_vec(), Kind::JpegXl),
            (b"RIFF\0\0\0\0WEBPVP8 ".to_vec(), Kind::WebP),
            (b"II*\0\x10\0\0\0CR\x02\0".to_vec(), Kind::MakerRaw),
            (b"FUJIFILMCCD-RAW 0201".to_vec(), Kind::MakerRaw),
            (b"II*\0\x08\0\0\0\0\0".to_vec(), Kind::Tiff),
            (b"MM\0+\0\x08\0\0".to_vec(), Kind::Tiff),
            (ftyp(&[b"qt  "]), Kind::Video),
            (ftyp(&[b"isom", b"iso2", b"avc1", b"mp41"]), Kind::Video),
            (b"RIFF\0\0\0\0AVI LIST".to_vec(), Kind::Video),
            (b"P6\n640 480 255\n".to_vec(), Kind::NetPbm),
            (b"P5 # by a scanner\n".to_vec(), Kind::NetPbm),
            (b"#?RADIANCE\nFORMAT".to_vec(), Kind::Radiance),
        ] {
            assert_eq!(Kind::of(&bytes), Some(kind), "{bytes:?}");
        }
        for other in [
            &b"hello"[..],
            b"",
            b"RIFF\0\0\0\0WAVE",
            &ftyp(&[b"M4A "]),
            b"\0\0\0\0ftyp",
            b"P6 was here",
        ] {
            assert_eq!(Kind::of(other), None, "{other:?}");
        }
    }
}
