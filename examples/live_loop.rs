//! The loop of a camera app: judge the preview, add the photo, show the maps and the next view.
//!
//! ```sh
//! cargo run --release --example live_loop -- examples/captures/tile
//! ```
//!
//! The photographs of a capture stand for the camera. Only the end waits for the fit.

use std::error::Error;

use svbrdf::capture::Capture;
use svbrdf::session::{Outcome, Session, Settings};

/// Adds at most `most` photographs of a capture; returns how many were accepted.
pub fn run(folder: &str, most: usize) -> Result<usize, Box<dyn Error>> {
    let capture = Capture::load(folder)?;
    let settings = Settings { sample_mm: capture.sample_mm, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings)?;
    for file in capture.photos.iter().take(most) {
        let image = file.read()?;
        // An image of the preview, usually a smaller one. A probe changes nothing.
        let probe = session.probe(&image)?;
        if let Some(rejection) = probe.rejection {
            println!("not yet: {rejection}");
            continue;
        }
        match session.add_photo(&image)? {
            Outcome::Accepted(photo) => println!("photo {} is in the maps", photo.index + 1),
            Outcome::Rejected(reason) => println!("try again: {reason}"),
        }
        // The fit continues; its maps are there at any time.
        let maps = session.snapshot()?;
        println!("  maps of {} x {} texels", maps.width(), maps.height());
        if let Some(next) = session.next_view() {
            let (tilt, azimuth) = (next.tilt_deg, next.azimuth_deg);
            println!("  next: {tilt:.0} degrees off the vertical, towards {azimuth:.0} degrees");
        }
    }
    session.wait()?;
    println!("settled, mean error {:.4}", session.progress().loss);
    Ok(session.progress().photos)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: live_loop CAPTURE")?;
    run(&folder, usize::MAX).map(|_| ())
}
