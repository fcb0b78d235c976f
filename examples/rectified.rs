//! Maps from photographs in memory that are rectified already, each with the positions of camera and light.
//!
//! ```sh
//! cargo run --release --example rectified
//! ```
//!
//! The photographs are rendered from known maps, which the estimated ones are compared with.

use std::error::Error;

use svbrdf::Svbrdf;
use svbrdf::observation::{Falloff, View};
use svbrdf::photo::Photo;
use svbrdf::render::render;
use svbrdf::session::{RectifiedFalloff, Scene, Session, Settings};

const SIDE: usize = 256;
/// A sample of 100 mm a side under a light of the same strength at all distances.
const SAMPLE_MM: [f32; 2] = [100.0, 100.0];
const FALLOFF: Falloff = Falloff::None { power: [std::f32::consts::PI; 3] };

/// Linear values of a photograph, three a pixel: a camera and a flash at `mm` above the sample.
fn pixels(maps: &Svbrdf, mm: [f32; 3]) -> Vec<f32> {
    let view = View {
        sample_mm: SAMPLE_MM,
        camera_mm: mm,
        light_mm: mm,
        falloff: FALLOFF,
        ..View::default()
    };
    let mut planes = vec![0.0; 3 * maps.texels()];
    render(maps, &view, &mut planes);
    let n = maps.texels();
    (0..n).flat_map(|i| [planes[i], planes[n + i], planes[2 * n + i]]).collect()
}

/// Root mean square error of the diffuse albedo.
pub fn run() -> Result<f32, Box<dyn Error>> {
    let mut truth = Svbrdf::new(SIDE, SIDE);
    for (channel, plane) in truth.diffuse_mut().into_iter().enumerate() {
        for (i, v) in plane.iter_mut().enumerate() {
            let stripe = (i % SIDE / 32 + channel).is_multiple_of(2);
            *v = if stripe { 0.4 } else { 0.15 };
        }
    }
    let scene = Scene::Rectified { falloff: RectifiedFalloff::Given(FALLOFF) };
    let session = Session::new(scene, Settings { sample_mm: SAMPLE_MM, ..Settings::default() })?;
    for mm in [[0.0, 0.0, 150.0], [60.0, 0.0, 140.0], [-50.0, 50.0, 140.0]] {
        let side = SIDE as u32;
        // No value of these photographs is saturated.
        let photo = Photo::from_linear(side, side, pixels(&truth, mm), 1.0, f32::INFINITY)?;
        let outcome = session.add_rectified_photo(&photo, mm, mm)?;
        println!(
            "camera at {mm:?} mm: {}",
            if outcome.is_accepted() { "used" } else { "not used" }
        );
    }
    session.wait()?;
    let maps = session.snapshot()?;
    let pairs = maps.diffuse().into_iter().zip(truth.diffuse());
    let squares = pairs.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)));
    let error = (squares.sum::<f32>() / (3 * maps.texels()) as f32).sqrt();
    println!("diffuse albedo off by {error:.4}");
    Ok(error)
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
