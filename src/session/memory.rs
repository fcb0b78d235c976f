//! Estimates the memory that a session needs before it is allocated.

use std::sync::{Arc, Mutex};

use super::settings::Settings;
use crate::photo::Photo;
use crate::threads::lock;
use crate::{Error, Result, estimate};

/// Bytes of a pixel of a board's photograph while its corners are looked for.
pub(super) const DETECTION: u64 = 16;
/// Largest number of pixels of a reduced photograph.
const REDUCED: u64 = 2560 * 2560;
/// Threads, tables, and the photo network's temporary buffers.
const BASE: u64 = 24 << 20;

/// Estimate for a number of photographs. `kept` are bytes of unrectified photographs.
pub(super) fn needed(settings: &Settings, photographs: usize, kept: u64) -> u64 {
    (BASE + estimate::bytes_needed(settings.resolution, photographs)).saturating_add(kept)
}

/// Bytes while a photograph is added, with the `kept` bytes of the earlier ones.
pub(super) fn while_pushed(photo: &Photo, kept: u64) -> u64 {
    let pixels = u64::from(photo.width()) * u64::from(photo.height());
    kept + photo.stored_bytes() as u64 + DETECTION * pixels
}

/// Bytes while a photograph is probed: its own, and those of detection on a reduced version.
pub(super) fn while_probed(photo: &Photo) -> u64 {
    photo.stored_bytes() as u64 + DETECTION * REDUCED
}

/// Checks the estimate against the limit.
///
/// # Errors
/// [`Error::MemoryLimit`].
pub(super) fn check(settings: &Settings, photographs: usize, kept: u64) -> Result<()> {
    let Some(limit) = settings.memory_limit_bytes else { return Ok(()) };
    let needed = needed(settings, photographs, kept);
    if needed <= limit { Ok(()) } else { Err(Error::MemoryLimit { needed, limit }) }
}

/// Number and bytes of the photographs that callers hold until they are added.
#[derive(Default)]
pub(super) struct Waiting(Arc<Mutex<(usize, u64)>>);

/// Memory of a photograph that waits to be added, see [`Session::hold`](super::Session::hold); counted until dropped.
pub struct Held {
    waiting: Arc<Mutex<(usize, u64)>>,
    bytes: u64,
}

impl Waiting {
    /// Counts another photograph.
    ///
    /// # Errors
    /// [`Error::MemoryLimit`] if the session could not add it.
    pub(super) fn hold(
        &self,
        settings: &Settings,
        photos: usize,
        kept: u64,
        [bytes, photo_bytes, pixels]: [u64; 3],
    ) -> Result<Held> {
        let taken_in = photo_bytes.saturating_add(DETECTION.saturating_mul(pixels));
        let mut waiting = lock(&self.0);
        let (count, sum) = (waiting.0 + 1, waiting.1.saturating_add(bytes));
        check(settings, photos + count, kept.saturating_add(sum).saturating_add(taken_in))?;
        *waiting = (count, sum);
        Ok(Held { waiting: self.0.clone(), bytes })
    }

    /// Bytes that callers hold.
    pub(super) fn bytes(&self) -> u64 {
        lock(&self.0).1
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let mut waiting = lock(&self.waiting);
        *waiting = (waiting.0 - 1, waiting.1 - self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::networks::Networks;
    use crate::photo::Encoding;
    use crate::session::{RectifiedFalloff, Scene, Session};

    const SIDE: u32 = 256;
    const PHOTO: u64 = 3 * (SIDE as u64).pow(2);

    /// A session whose limit exceeds the need of one photograph by this many bytes.
    fn session(more: u64) -> Session {
        let scene = Scene::Rectified { falloff: RectifiedFalloff::InverseSquareAuto };
        let limit = needed(&Settings::default(), 1, 0) + more;
        let settings =
            Settings { threads: 1, memory_limit_bytes: Some(limit), ..Settings::default() };
        Session::with_networks(scene, settings, Arc::new(Networks::embedded().unwrap())).unwrap()
    }

    #[test]
    fn held_photographs_are_counted_until_they_are_dropped() {
        let pixels = u64::from(SIDE).pow(2);
        let taken_in = PHOTO + DETECTION * pixels;
        let more = needed(&Settings::default(), 2, 0) - needed(&Settings::default(), 1, 0);
        let session = session(taken_in + 1000 + more);
        let hold = |bytes| session.hold(bytes, PHOTO, pixels);
        let first = hold(600).unwrap();
        assert!(
            matches!(hold(401), Err(Error::MemoryLimit { needed, limit }) if needed == limit + 1)
        );
        let second = hold(400).unwrap();
        // A photograph that may be held may also be added meanwhile.
        let rgb = vec![100; PHOTO as usize];
        let row = 3 * SIDE as usize;
        let photo = Photo::from_rgb8(SIDE, SIDE, &rgb, row, Encoding::Srgb, 1.0).unwrap();
        assert!(session.add_rectified_photo(&photo, [0.0, 0.0, 200.0], [0.0, 0.0, 200.0]).is_ok());
        assert!(matches!(hold(0), Err(Error::MemoryLimit { .. })), "one is in the maps, two wait");
        drop(first);
        drop(second);
        assert!(hold(1000).is_ok() && hold(u64::MAX).is_err());
    }
}
