//! `svbrdf-eval artifacts`: visible faults of maps that rendering errors hardly reveal.

mod colours;
mod measure;
mod regression;

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde_json::Value;
use svbrdf::capture::Capture;
use svbrdf::export::read_maps;
use svbrdf::geometry::Pose;
use svbrdf::session::Session;
use svbrdf::{Error, Result, Svbrdf};

pub use self::measure::{Artifacts, Place};

/// Arguments of `svbrdf-eval artifacts`.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub struct Arguments {
    /// Maps as `svbrdf fit` wrote them, with report.json
    maps: PathBuf,
    /// Capture that they were fitted to
    capture: PathBuf,
    /// True maps [default: those in the capture's truth/, where there are any]
    #[arg(long, value_name = "DIR")]
    truth: Option<PathBuf>,
}

const HELP: &str = "tilt: angle between the mean normal and the true one, degrees, and the largest \
of 4 x 4 parts. baked: of the errors of log F0 and roughness, averaged over 16 x 16 blocks, the \
standard deviation of what the photographs' highlights explain beyond colour. Without true maps the \
sample counts as flat and each colour's gloss as even.";

/// The true maps of a capture, if present.
pub fn truth(folder: &Path) -> Result<Option<Svbrdf>> {
    let truth = folder.join("truth");
    let has = |name: &str| truth.join(name).is_file();
    (has("maps.exr") || has("normal.png")).then(|| read_maps(&truth)).transpose()
}

/// Positions of the accepted photographs of a session, given by their frames.
pub fn places(session: &Session, capture: &Capture, accepted: &[usize]) -> Vec<Place> {
    let poses = session.poses();
    if poses.is_empty() {
        return accepted.iter().filter_map(|&i| rectified(capture, i)).collect();
    }
    let flash = session.flash_offset_mm();
    poses.iter().map(|known| place(&known.pose, flash)).collect()
}

fn rectified(capture: &Capture, frame: usize) -> Option<Place> {
    let view = capture.photos.get(frame)?.rectified?;
    let [camera, light] = [view.camera_mm, view.light_mm].map(|p| glam::Vec3::from(p).as_dvec3());
    Some(Place { camera, light })
}

fn place(pose: &Pose, flash: DVec3) -> Place {
    Place { camera: pose.camera_centre(), light: pose.to_board(flash) }
}

/// Positions from the `report.json` beside maps.
fn reported(maps: &Path, capture: &Capture) -> Result<Vec<Place>> {
    let path = maps.join("report.json");
    let fault = |field: &str, message: String| Error::Field {
        path: path.clone(),
        field: field.to_owned(),
        message,
        expected: "a report of `svbrdf fit`".to_owned(),
    };
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
    let report: Value =
        serde_json::from_slice(&bytes).map_err(|e| fault("(file)", e.to_string()))?;
    let numbers = |value: &Value| -> Vec<f64> {
        let list = value.as_array().map(Vec::as_slice).unwrap_or_default();
        list.iter().filter_map(Value::as_f64).collect()
    };
    let vector = |value: &Value| <[f64; 3]>::try_from(numbers(value)).ok().map(DVec3::from_array);
    let flash = vector(&report["flash"]["offset_mm"]).unwrap_or_default();
    let frames = report["frames"].as_array().map(Vec::as_slice).unwrap_or_default();
    let mut places = Vec::new();
    for (i, frame) in frames.iter().enumerate().filter(|(_, f)| f["status"] == "accepted") {
        let rows = frame["rotation"].as_array().map(Vec::as_slice).unwrap_or_default();
        let rows: Vec<DVec3> = rows.iter().filter_map(vector).collect();
        let known = match (&rows[..], vector(&frame["translation_mm"])) {
            (&[x, y, z], Some(translation)) => {
                let rotation = DMat3::from_cols(x, y, z).transpose();
                Some(place(&Pose { rotation, translation }, flash))
            }
            _ => rectified(capture, frame["index"].as_u64().map_or(i, |index| index as usize)),
        };
        let field = format!("frames[{i}]");
        places.push(known.ok_or_else(|| fault(&field, "found no pose".to_owned()))?);
    }
    Ok(places)
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let capture = Capture::load(&arguments.capture)?;
    let maps = read_maps(&arguments.maps)?;
    let truth = match &arguments.truth {
        Some(folder) => Some(read_maps(folder)?),
        None => truth(&arguments.capture)?,
    };
    let places = reported(&arguments.maps, &capture)?;
    let found = Artifacts::of(&maps, truth.as_ref(), capture.sample_mm, &places);
    let against = if truth.is_some() { "the true maps" } else { "a flat sample of even colours" };
    println!("{} photographs, against {against}", places.len());
    println!("tilt              {:8.3} degrees", found.tilt);
    println!("largest of parts  {:8.3} degrees", found.tilt_of_parts);
    println!("baked log F0      {:8.4}", found.baked_f0);
    println!("baked roughness   {:8.4}", found.baked_roughness);
    Ok(())
}
