//! Anything as what a picture's file says of itself: the first byte chooses an ICC profile or a whole
//! file with an Exif block.

use std::io::Cursor;

use crate::metadata::Metadata;
use crate::profile::Profile;

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    let Some((&choice, data)) = data.split_first() else { return false };
    if choice % 2 == 0 {
        let Ok(profile) = Profile::parse(data) else { return false };
        let mut rgb = [0.0, 0.5, 1.0, -0.0, 2.0, f32::MIN_POSITIVE];
        profile.apply(&mut rgb, 1.0);
        assert!(rgb.iter().all(|v| v.is_finite() && *v >= 0.0), "{rgb:?}");
        profile.is_srgb();
        return true;
    }
    let found = Metadata::within(&mut Cursor::new(data));
    assert!(found.exposure.is_none_or(|v| v.is_finite() && v > 0.0));
    assert!(found.focal_mm.is_none_or(|v| v.is_finite() && v > 0.0));
    found != Metadata::default()
}
