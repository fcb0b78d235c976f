//! Fits the maps of a capture photograph by photograph, like a camera app:
//!
//! ```sh
//! cargo run --release --example fit -- examples/captures/tile maps
//! ```

use std::error::Error;

use svbrdf::capture::Capture;
use svbrdf::export::{MapsOptions, write_maps, write_preview};
use svbrdf::session::{Outcome, Session, Settings};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(folder), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("usage: fit CAPTURE OUT".into());
    };
    let capture = Capture::load(folder)?;
    let settings = Settings { sample_mm: capture.sample_mm, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings)?;
    for file in &capture.photos {
        let photo = file.read()?;
        let outcome = match file.rectified {
            Some(view) => session.add_rectified_photo(&photo, view.camera_mm, view.light_mm)?,
            None => session.add_photo(&photo)?,
        };
        let name = file.path.display();
        match outcome {
            Outcome::Accepted(accepted) => {
                println!("{name}: maps after {:.2} s", accepted.maps_seconds);
                for hint in &accepted.hints {
                    println!("  {hint}");
                }
            }
            // Rejections do not end the capture.
            Outcome::Rejected(reason) => {
                println!("{name}: {reason}");
                continue;
            }
        }
        // The fit continues in the background; maps are available at any time.
        session.wait()?;
        println!("  settled, mean error {:.4}", session.progress().loss);
        if let Some(view) = session.next_view() {
            println!("  next: {:.0} degrees off the vertical", view.tilt_deg);
        }
    }
    let maps = session.snapshot()?;
    write_maps(&out, &maps, &MapsOptions::default())?;
    write_preview(format!("{out}/preview.png"), &maps, capture.sample_mm)?;
    println!("maps are in {out}");
    Ok(())
}
