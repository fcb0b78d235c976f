//! Anything as a raw photograph.

use crate::dng;

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    let Ok(photo) = dng::develop(data, 1.0) else { return false };
    assert!(photo.width() > 0 && photo.height() > 0);
    assert_eq!(photo.to_linear().len(), 3 * (photo.width() * photo.height()) as usize);
    if photo.is_finite() {
        assert!(photo.to_linear().iter().all(|v| v.is_finite()));
    }
    true
}
