//! Colours of PNG files: `cICP`, `iCCP`, `sRGB`, `gAMA` and `cHRM`, in the specification's order of
//! precedence.

use std::io::Cursor;

use png::{Decoder, Limits, SourceChromaticities};

use super::colours::Colours;

/// Largest unpacked profile, bytes. Real ones have some kilobytes, but three megabytes can expand
/// to a gigabyte.
const MAX_PROFILE: usize = 4 << 20;

/// Colours stated by a file. Unreadable files are reported by the picture reader.
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

/// Whether a profile chunk precedes the pixels. The decoder does not report profiles it could not unpack.
fn has_profile(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        match after.get(..4) {
            Some(b"iCCP") => return true,
            None | Some(b"IDAT") => return false,
            _ => (),
        }
        // Skip type, data and checksum.
        let length = u32::from_be_bytes(*length) as usize;
        rest = after.get(length.saturating_add(8)..).unwrap_or_default();
    }
    false
}
