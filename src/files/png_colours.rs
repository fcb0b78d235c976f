//! Colours of PNG files: `cICP`, `iCCP`, `sRGB`, `gAMA` and `cHRM`, in the order in which the
//! specification prefers them.

use std::io::Cursor;

use png::{Decoder, Limits, SourceChromaticities};

use super::colours::Colours;

/// Largest profile that is unpacked, bytes: real ones have a few kilobytes, but a file of three
/// megabytes can hold one of a gigabyte.
const MAX_PROFILE: usize = 4 << 20;

/// What a file states; files that cannot be read are left to the reader of pictures.
pub fn read(bytes: &[u8]) -> Colours {
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: MAX_PROFILE });
    decoder.set_ignore_text_chunk(true);
    let unusable =
        || Colours::Unusable("its ICC profile cannot be used (damaged, or too large)".into());
    let Ok(reader) = decoder.read_info() else {
        return if has_profile(bytes) { unusable() } else { Colours::Srgb };
    };
    let info = reader.info();
    if let Some(points) = info.coding_independent_code_points {
        let (primaries, transfer) = (points.color_primaries, points.transfer_function);
        return match points.is_video_full_range_image {
            true => Colours::of_code_points(primaries, transfer),
            false => Colours::Unusable("its narrow range of values (cICP) cannot be used".into()),
        };
    }
    if let Some(profile) = &info.icc_profile {
        return Colours::of_icc(profile);
    }
    if has_profile(bytes) {
        return unusable();
    }
    let chromaticities = info.chrm_chunk.map(chromaticities);
    let gamma = info.gama_chunk.map(|gamma| f64::from(gamma.into_scaled()) / 1e5);
    if info.srgb.is_some() || (gamma.is_none() && chromaticities.is_none()) {
        return Colours::Srgb;
    }
    Colours::of_gamma(gamma, chromaticities)
}

fn chromaticities(c: SourceChromaticities) -> [[f64; 2]; 4] {
    [c.white, c.red, c.green, c.blue].map(|(x, y)| [x, y].map(|v| f64::from(v.into_scaled()) / 1e5))
}

/// Whether there is a chunk with a profile before the pixels: the decoder keeps silent about those
/// that it could not unpack.
fn has_profile(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        match after.get(..4) {
            Some(b"iCCP") => return true,
            None | Some(b"IDAT") => return false,
            _ => (),
        }
        // Type and checksum.
        let length = u32::from_be_bytes(*length) as usize;
        rest = after.get(length.saturating_add(8)..).unwrap_or_default();
    }
    false
}
