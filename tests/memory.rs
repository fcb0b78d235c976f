//! A session's memory stays below its own estimate. A test of its own, since memory is the process's.
#![cfg(target_os = "linux")]

use std::process::Command;
use std::sync::Arc;

use svbrdf::Error;
use svbrdf::networks::Networks;
use svbrdf::photo::Photo;
use svbrdf::session::{RectifiedFalloff, Scene, Session, Settings};

/// Resident memory, bytes: `VmRSS` now, `VmHWM` at most since [`forget_peak`].
fn resident(what: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with(what)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
}

/// If that is not allowed, the peak includes the preparation of the networks.
fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

fn scene() -> Scene {
    Scene::Rectified { falloff: RectifiedFalloff::InverseSquareAuto }
}

/// Bytes that a session at a resolution used, and its estimate.
fn case(resolution: usize, photos: usize) -> [u64; 2] {
    let networks = Arc::new(Networks::embedded().unwrap());
    networks.prepare(256, 256).unwrap();
    // The error of too small a limit has the estimate for the first photograph.
    let settings = Settings { resolution, memory_limit_bytes: Some(1), ..Default::default() };
    let estimate = match Session::with_networks(scene(), settings, networks.clone()) {
        Err(Error::MemoryLimit { needed, .. }) => {
            // Six bytes a texel, and of the levels that are fitted, 256 and 512, twice as many.
            let fitted = [256, 512].into_iter().filter(|&side| side <= resolution);
            let texels = resolution.pow(2) + 2 * fitted.map(|side| side.pow(2)).sum::<usize>();
            needed + (photos as u64 - 1) * 6 * texels as u64
        }
        _ => panic!("a byte is not enough"),
    };
    forget_peak();
    let before = resident("VmRSS:");
    let settings = Settings { resolution, threads: 2, ..Settings::default() };
    let session = Session::with_networks(scene(), settings, networks).unwrap();
    for i in 0..photos {
        let side = resolution as u32;
        let rgb: Vec<f32> =
            (0..3 * side * side).map(|v| 0.2 + 0.1 * ((v / 3 + i as u32) % 7) as f32).collect();
        let photo = Photo::from_linear(side, side, rgb, 1.0, f32::INFINITY).unwrap();
        let camera_mm = [20.0 * i as f32, 10.0, 150.0];
        session.add_rectified_photo(&photo, camera_mm, camera_mm).unwrap();
        session.wait().unwrap();
    }
    [resident("VmHWM:") - before, estimate]
}

/// Names the case for a process of its own: freed memory of another session is not returned to the system.
const CASE: &str = "SVBRDF_MEMORY_CASE";

#[test]
fn the_estimate_of_memory_holds() {
    let cases = [("256", 256, 3), ("512", 512, 2)];
    if let Ok(name) = std::env::var(CASE) {
        let (_, resolution, photos) = cases.into_iter().find(|c| c.0 == name).unwrap();
        let [used, estimate] = case(resolution, photos);
        println!(
            "{resolution} texels, {photos} photographs: {} MiB used, {} estimated",
            used >> 20,
            estimate >> 20
        );
        assert!(used < estimate, "{used} of {estimate}");
        // An estimate that is far too high is of no use either.
        assert!(used > estimate / 4, "{used} of {estimate}");
        return;
    }
    for (name, ..) in cases {
        let own = std::env::current_exe().unwrap();
        let status = Command::new(own).arg("--nocapture").env(CASE, name).status().unwrap();
        assert!(status.success(), "{name}: {status}");
    }
}
