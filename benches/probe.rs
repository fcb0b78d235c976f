//! Processor time of a probe on one core, suitable for shared machines: `cargo bench --bench
//! probe`. Linux only.

use std::error::Error;
use std::fs;

use svbrdf::capture::Capture;
use svbrdf::photo::{Encoding, Photo};
use svbrdf::session::{Session, Settings};

/// Processor time of this thread, ms.
fn spent() -> Result<f64, Box<dyn Error>> {
    let line = fs::read_to_string("/proc/thread-self/schedstat")?;
    Ok(line.split(' ').next().unwrap_or("0").parse::<f64>()? / 1e6)
}

fn main() -> Result<(), Box<dyn Error>> {
    let capture = Capture::load(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile"))?;
    let settings = Settings { sample_mm: capture.sample_mm, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings)?;
    session.pause();
    for file in &capture.photos[..4] {
        session.add_photo(&file.read()?)?;
    }
    let picture = image::open(&capture.photos[5].path)?.to_rgb8();
    let wide = image::imageops::crop_imm(&picture, 0, 189, 2016, 1134).to_image();
    let filter = image::imageops::FilterType::CatmullRom;
    let preview = image::imageops::resize(&wide, 1280, 720, filter);
    let large = image::imageops::resize(&picture, 4032, 3024, filter);
    let empty = image::RgbImage::from_fn(1280, 720, |x, y| {
        image::Rgb([90 + ((x * 7 + y * 13) % 23) as u8; 3])
    });
    for (name, picture) in [("1280x720", preview), ("4032x3024", large), ("no board", empty)] {
        let (w, h) = picture.dimensions();
        let photo = Photo::from_rgb8(w, h, &picture, 3 * w as usize, Encoding::Srgb, 1.0)?;
        let mut times = Vec::new();
        for _ in 0..15 {
            let before = spent()?;
            let probe = session.probe(&photo)?;
            times.push(spent()? - before);
            assert_eq!(probe.rejection.is_none(), name != "no board", "{probe:?}");
        }
        times.sort_by(f64::total_cmp);
        println!("{name}: {:.1} ms, median {:.1} ms", times[0], times[7]);
    }
    Ok(())
}
