//! Adds photographs until the roughness is known well enough.
//!
//! ```sh
//! cargo run --release --example uncertainty -- examples/captures/tile 0.05
//! ```

use std::error::Error;

use svbrdf::capture::Capture;
use svbrdf::session::{Session, Settings};

/// Adds at most `most` photographs of a capture, until the standard deviation of the roughness is at most `enough`.
/// Returns the deviation after each.
pub fn run(folder: &str, most: usize, enough: f32) -> Result<Vec<f32>, Box<dyn Error>> {
    let capture = Capture::load(folder)?;
    let settings = Settings { sample_mm: capture.sample_mm, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings)?;
    let mut deviations = Vec::new();
    for file in capture.photos.iter().take(most) {
        if !session.add_photo(&file.read()?)?.is_accepted() {
            continue;
        }
        // Deviations are meaningful once the fit has settled.
        session.wait()?;
        let uncertainty = session.snapshot_with_uncertainty()?.uncertainty;
        // Of the whole map, and of its texels.
        let whole = uncertainty.of_maps();
        let texels = uncertainty.roughness();
        let unknown = texels.iter().filter(|deviation| **deviation > enough).count();
        println!(
            "{} photos: roughness within {:.3}, {:.0} % of the texels not within {enough}; normals within {:.3}",
            session.progress().photos,
            whole.roughness,
            100.0 * unknown as f32 / texels.len() as f32,
            whole.normal,
        );
        deviations.push(whole.roughness);
        if whole.roughness <= enough {
            break;
        }
    }
    Ok(deviations)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(folder), Some(enough)) = (arguments.next(), arguments.next()) else {
        return Err("usage: uncertainty CAPTURE DEVIATION".into());
    };
    run(&folder, usize::MAX, enough.parse()?).map(|_| ())
}
