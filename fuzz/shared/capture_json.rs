//! Anything as the description of a capture.

use std::path::Path;

use engine::capture::Capture;
use engine::session::Scene;

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    // The repository, or its folder of targets.
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = if here.ends_with("fuzz") { here.join("..") } else { here.to_owned() };
    let Ok(capture) = Capture::parse(root.join("examples/captures/tile"), data) else {
        return false;
    };
    // An accepted description is usable.
    assert!(!capture.photos.is_empty());
    assert!(capture.sample_mm.iter().all(|v| v.is_finite() && *v > 0.0));
    assert!(capture.photos.iter().all(|f| f.exposure.is_finite() && f.exposure > 0.0));
    if let Scene::Board { target, camera, .. } = &capture.scene {
        assert!(target.fault().is_none() && camera.is_none_or(|c| c.fault().is_none()));
        assert!(!target.corners().is_empty());
    }
    true
}
