//! What a session needs stays below its own estimate. A test of its own: memory is the process's.
#![cfg(target_os = "linux")]

use std::sync::Arc;

use svbrdf::Error;
use svbrdf::frame::Photo;
use svbrdf::initial_estimate::Networks;
use svbrdf::session::{RectifiedFalloff, Scene, Session, Settings};

/// Resident memory, bytes: `VmRSS` now, `VmHWM` at most since [`forget_peak`].
fn resident(what: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with(what)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
}

/// Where that is not allowed, the peak is that of the sessions before as well.
fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

fn scene() -> Scene {
    Scene::Rectified { falloff: RectifiedFalloff::InverseSquareAuto }
}

#[test]
fn the_estimate_of_memory_holds() {
    let networks = Arc::new(Networks::embedded().unwrap());
    networks.prepare(256, 256).unwrap();
    let mut found = Vec::new();
    for (resolution, photos) in [(256, 3), (512, 2)] {
        let estimate = |photos: usize| {
            // A limit that is too small says what is needed for the first photograph.
            let settings =
                Settings { resolution, memory_limit_bytes: Some(1), ..Default::default() };
            match Session::with_networks(scene(), settings, networks.clone()) {
                Err(Error::MemoryLimit { needed, .. }) => {
                    // 7 bytes a texel, and as much again for the levels below.
                    needed + (photos as u64 - 1) * 14 * (resolution * resolution) as u64
                }
                _ => panic!("a byte is not enough"),
            }
        };
        forget_peak();
        let before = resident("VmRSS:");
        let settings = Settings { resolution, threads: 2, ..Settings::default() };
        let session = Session::with_networks(scene(), settings, networks.clone()).unwrap();
        for i in 0..photos {
            let side = resolution as u32;
            let rgb: Vec<f32> =
                (0..3 * side * side).map(|v| 0.2 + 0.1 * ((v / 3 + i) % 7) as f32).collect();
            let photo = Photo::from_linear(side, side, rgb, 1.0, f32::INFINITY).unwrap();
            let camera_mm = [20.0 * i as f32, 10.0, 150.0];
            session.push_rectified(&photo, camera_mm, camera_mm).unwrap();
            session.wait().unwrap();
        }
        let (used, estimate) = (resident("VmHWM:") - before, estimate(photos as usize));
        println!(
            "{resolution} texels, {photos} photographs: {} MiB used, {} estimated",
            used >> 20,
            estimate >> 20
        );
        found.push((used, estimate));
    }
    for (used, estimate) in found {
        assert!(used < estimate, "{used} of {estimate}");
        // An estimate that is far too high is of no use either.
        assert!(used > estimate / 4, "{used} of {estimate}");
    }
}
