//! Anything as a picture file, then as a photograph of a board whose camera is not known: judged,
//! added, removed. The first byte chooses encoding, exposure and primaries.

use std::sync::{Arc, OnceLock};

use engine::calibration::Target;
use engine::networks::Networks;
use engine::photo::{Encoding, Photo, Primaries};
use engine::session::{Outcome, Scene, Session, Settings};

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    let Some((&choice, file)) = data.split_first() else { return false };
    let encoding = Encoding::ALL[usize::from(choice) % 5];
    let exposure = [1.0, 1e-30, 3e30, 0.5][usize::from(choice >> 3) % 4];
    let primaries = [Primaries::Rec709, Primaries::DisplayP3, Primaries::Rec2020];
    let Ok(photo) = Photo::decode(file, encoding, exposure) else { return false };
    assert!(photo.width() > 0 && photo.height() > 0);
    if u64::from(photo.width()) * u64::from(photo.height()) > 1 << 20 {
        return false;
    }
    let photo = photo.with_primaries(primaries[usize::from(choice >> 5) % 3]);
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    let networks = NETWORKS.get_or_init(|| Arc::new(Networks::embedded().expect("our own")));
    let scene = Scene::board(Target::default());
    let settings = Settings { threads: 1, ..Settings::default() };
    let session = Session::with_networks(scene, settings, networks.clone()).expect("defaults");
    session.pause();
    let probe = session.probe(&photo).expect("a photo is no misuse");
    assert!(probe.corners.iter().all(|corner| corner.px.is_finite()));
    match session.add_photo(&photo).expect("a photo is no misuse") {
        Outcome::Accepted(accepted) => {
            assert!(accepted.pose.is_some_and(|p| p.pose.translation.is_finite()));
            assert!(session.snapshot().is_ok());
            assert!(session.remove_photo(1).is_err() && session.remove_photo(0).is_ok());
            assert!(session.snapshot().is_err() && session.progress().photos == 0);
        }
        Outcome::Rejected(_) => assert!(session.snapshot().is_err()),
    }
    assert!(session.failure().is_none());
    true
}
