//! Photographs that wait to be pushed, as memory of their session.

use super::Session;
use super::memory::{self, Held};
use crate::Result;

impl Session {
    /// Counts `bytes` that a caller holds of a photograph until it is pushed as memory of this session,
    /// if they fit beside what is held already: `photo_bytes` are those of the photograph that will be
    /// made of them, `pixels` its pixels. What may be held may be pushed, one after the other, but for
    /// what photographs keep of themselves until the board is settled. Waits for nothing.
    ///
    /// # Errors
    /// [`Error::MemoryLimit`](crate::Error::MemoryLimit).
    pub fn hold(&self, bytes: u64, photo_bytes: u64, pixels: u64) -> Result<Held> {
        let frames = self.shared.lock().progress.frames;
        self.beside.hold(&self.settings, frames, [bytes, photo_bytes, pixels])
    }

    /// Refuses what would need more than is allowed, with what callers hold.
    pub(super) fn check_memory(&self, photographs: usize, beside: u64) -> Result<()> {
        memory::check(&self.settings, photographs, beside.saturating_add(self.beside.held()))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::memory::{DETECTION, needed};
    use super::super::settings::Settings;
    use super::*;
    use crate::Error;
    use crate::frame::{Encoding, Photo};
    use crate::initial_estimate::Networks;
    use crate::session::{RectifiedFalloff, Scene};

    const SIDE: u32 = 256;
    const PHOTO: u64 = 3 * (SIDE as u64).pow(2);

    /// A session that may need so many bytes more than for one photograph.
    fn session(more: u64) -> Session {
        let scene = Scene::Rectified { falloff: RectifiedFalloff::InverseSquareAuto };
        let limit = needed(&Settings::default(), 1, 0) + more;
        let settings =
            Settings { threads: 1, memory_limit_bytes: Some(limit), ..Settings::default() };
        Session::with_networks(scene, settings, Arc::new(Networks::embedded().unwrap())).unwrap()
    }

    #[test]
    fn what_is_held_is_counted_until_it_is_dropped() {
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
        // What may be held may be pushed meanwhile.
        let rgb = vec![100; PHOTO as usize];
        let row = 3 * SIDE as usize;
        let photo = Photo::from_rgb8(SIDE, SIDE, &rgb, row, Encoding::Srgb, 1.0).unwrap();
        assert!(session.push_rectified(&photo, [0.0, 0.0, 200.0], [0.0, 0.0, 200.0]).is_ok());
        assert!(matches!(hold(0), Err(Error::MemoryLimit { .. })), "one is in the maps, two wait");
        drop(first);
        drop(second);
        assert!(hold(1000).is_ok() && hold(u64::MAX).is_err());
    }
}
