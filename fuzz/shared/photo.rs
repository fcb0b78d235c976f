//! Anything as a picture file, then as a photograph of a board whose camera is not known. The first
//! byte chooses encoding and exposure.

use std::sync::{Arc, OnceLock};

use engine::calibration::Target;
use engine::frame::{Encoding, Photo};
use engine::initial_estimate::Networks;
use engine::session::{Pushed, Scene, Session, Settings};

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    let Some((&choice, file)) = data.split_first() else { return false };
    let encoding = Encoding::ALL[usize::from(choice) % 3];
    let exposure = [1.0, 1e-30, 3e30, 0.5][usize::from(choice >> 2) % 4];
    let Ok(photo) = Photo::decode(file, encoding, exposure) else { return false };
    assert!(photo.width() > 0 && photo.height() > 0);
    if u64::from(photo.width()) * u64::from(photo.height()) > 1 << 20 {
        return false;
    }
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    let networks = NETWORKS.get_or_init(|| Arc::new(Networks::embedded().expect("our own")));
    let scene = Scene::Board {
        target: Target::default(),
        camera: None,
        flash_offset_mm: None,
        elevation_mm: None,
    };
    let settings = Settings { threads: 1, ..Settings::default() };
    let session = Session::with_networks(scene, settings, networks.clone()).expect("defaults");
    session.pause();
    match session.push(&photo).expect("a photo is no misuse") {
        Pushed::Accepted(accepted) => {
            assert!(accepted.pose.is_some_and(|p| p.translation.is_finite()));
            assert!(session.snapshot().is_ok());
        }
        Pushed::Rejected(_) => assert!(session.snapshot().is_err()),
    }
    assert!(session.failure().is_none());
    true
}
