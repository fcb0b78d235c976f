//! Errors of the maps of captures whose truth is known, after so many photographs.
//!
//! `cargo run --release --example evaluate_captures -- CAPTURE_DIR... [key=value ...]`
//!
//! A `CAPTURE_DIR` holds `capture.json` and the true maps in `truth/`. Keys: `photos` (1,2,4,8),
//! `methods` (first, latent, deep, classic), `resolution` (256), `threads` (0: up to 4), `camera`
//! (`given`, `withheld`: camera and flash are estimated), `models` (networks to use instead of the
//! embedded ones).
//! `first` are the maps before any optimisation, `latent` those without refinement.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use svbrdf::Svbrdf;
use svbrdf::capture::Capture;
use svbrdf::comparison::{Differences, compare};
use svbrdf::export::{read_maps, resized};
use svbrdf::initial_estimate::Networks;
use svbrdf::session::{Method, Pushed, Scene, Session, Settings};

type Failure = Box<dyn std::error::Error>;

fn print(
    name: &str,
    photos: usize,
    maps: &Svbrdf,
    truth: &Svbrdf,
    session: &Session,
    begun: Instant,
) {
    let Ok(d) = compare(maps, truth) else { return };
    let Differences { normal, diffuse, specular, roughness, render } = d;
    println!(
        "{name:<8} {photos:>2}  {render:.4}  {normal:.4}  {diffuse:.4}   {specular:.4}    {roughness:.4}  {:.4}  {:6.1}",
        session.progress().loss,
        begun.elapsed().as_secs_f64()
    );
}

fn evaluate(
    folder: &Path,
    photos: &[usize],
    methods: &[&str],
    base: &Settings,
    networks: &Arc<Networks>,
    withheld: bool,
) -> Result<(), Failure> {
    let mut capture = Capture::load(folder)?;
    if let Scene::Board { camera, flash_offset_mm, .. } = &mut capture.scene
        && withheld
    {
        (*camera, *flash_offset_mm) = (None, None);
    }
    let truth = read_maps(folder.join("truth"))?;
    let truth = resized(&truth, base.resolution, base.resolution);
    println!("\n{}", folder.display());
    println!("method    N  render  normal  diffuse  specular  roughness  loss  seconds");
    for &name in methods {
        let method = if name == "classic" { Method::Classic } else { Method::Deep };
        let settings = Settings {
            sample_mm: capture.sample_mm,
            method,
            refine: name == "deep",
            ..base.clone()
        };
        let session = Session::with_networks(capture.scene.clone(), settings, networks.clone())?;
        let begun = Instant::now();
        let mut accepted = 0;
        for frame in &capture.frames {
            let photo = frame.read()?;
            if name == "first" {
                session.pause();
            }
            let pushed = match frame.rectified {
                Some(view) => session.push_rectified(&photo, view.camera_mm, view.light_mm)?,
                None => session.push(&photo)?,
            };
            match pushed {
                Pushed::Accepted(_) => accepted += 1,
                Pushed::Rejected(reason) => {
                    println!("{}: {reason}", frame.path.display());
                    continue;
                }
            }
            if name == "first" {
                print(name, accepted, &*session.snapshot()?, &truth, &session, begun);
                break;
            }
            session.wait()?;
            if photos.contains(&accepted) {
                print(name, accepted, &*session.snapshot()?, &truth, &session, begun);
            }
            if photos.iter().all(|&n| n <= accepted) {
                break;
            }
        }
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let mut folders = Vec::new();
    let mut base = Settings::default();
    let mut withheld = false;
    let mut networks = None;
    let (mut photos, mut methods) = (vec![1, 2, 4, 8], "first,latent,deep,classic".to_owned());
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            None => folders.push(PathBuf::from(argument)),
            Some(("photos", v)) => {
                photos =
                    v.split(',').map(str::parse).collect::<Result<_, std::num::ParseIntError>>()?
            }
            Some(("methods", v)) => methods = v.to_owned(),
            Some(("resolution", v)) => base.resolution = v.parse()?,
            Some(("threads", v)) => base.threads = v.parse()?,
            Some(("models", v)) => networks = Some(Networks::from_folder(Path::new(v))?),
            Some(("camera", v)) => withheld = v == "withheld",
            Some((key, _)) => return Err(format!("{key}: no such key").into()),
        }
    }
    if folders.is_empty() {
        return Err("usage: evaluate_captures CAPTURE_DIR... [key=value ...]".into());
    }
    let methods: Vec<&str> = methods.split(',').collect();
    let networks = Arc::new(networks.map_or_else(Networks::embedded, Ok)?);
    for folder in &folders {
        evaluate(folder, &photos, &methods, &base, &networks, withheld)?;
    }
    Ok(())
}
