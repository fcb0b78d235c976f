//! `svbrdf calibrate`: a camera from photographs of a printed board.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use svbrdf::Error;
use svbrdf::calibration::{
    CameraEstimate, CameraPrior, Corner, Detection, LumaImage, PaperEstimate, Target, detect,
    estimate_camera, estimate_camera_and_paper,
};
use svbrdf::export::write_atomic;
use svbrdf::files;

use crate::board_text::targets;
use crate::failure::{Failure, Result};
use crate::place;
use crate::terminal;

/// Calibrate a camera from photographs of a printed board
#[derive(clap::Args)]
#[command(after_help = "Boards:
  checkerboard:ROWSxCOLS:SQUARE_MM            full board, inner corners
  ring[:ROWSxCOLS:SQUARE_MM[:R0,C0,R1,C1]]    ring of squares round a hole, squares; the
                                              missing block half open (default: ring three wide)
  charuco-ring:ROWSxCOLS:SQUARE_MM[:R0,C0,R1,C1[:MARKER_MM[:DICTIONARY]]]

Examples:
  svbrdf calibrate photos/*.jpg --board checkerboard:6x9:25 --json
  svbrdf calibrate photos/*.jpg --board ring --out camera.json")]
pub struct Arguments {
    /// Photographs of the board, all of the same size
    #[arg(required = true, value_name = "IMAGES")]
    images: Vec<PathBuf>,
    /// Layout of the board, see below
    #[arg(long)]
    board: String,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Also write the JSON to a file, for `svbrdf fit --camera`
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Focal length in pixels, if roughly known (to 3 %)
    #[arg(long, value_name = "PX")]
    focal: Option<f64>,
}

/// One photo.
struct Image<'a> {
    path: &'a Path,
    /// Set where it cannot be used.
    status: Option<&'static str>,
    message: String,
    size: (u32, u32),
    /// Prior of the camera.
    prior: Option<CameraPrior>,
    corners: Vec<Corner>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let targets = targets(&arguments.board)?;
    if let Some(focal) = arguments.focal
        && !(focal.is_finite() && focal > 0.0)
    {
        return Err(Failure::Input(format!("--focal {focal}: a positive number of px expected")));
    }
    if let Some(out) = &arguments.out {
        place::file("--out", out)?;
    }
    if let Some(folder) = arguments.images.iter().find(|path| path.is_dir()) {
        let folder = folder.display();
        return Err(Failure::Input(format!(
            "{folder}: a folder; expected photographs, such as {folder}/*.jpg"
        )));
    }
    let mut images =
        arguments.images.iter().map(|path| look(path, &targets)).collect::<Result<Vec<_>>>()?;
    let size = usual_size(&images);
    for image in images.iter_mut().filter(|i| i.status.is_none() && i.size != size) {
        image.status = Some("wrong_size");
        image.message = format!(
            "the photo is {}x{} px, the others {}x{}",
            image.size.0, image.size.1, size.0, size.1
        );
    }
    let found: Vec<&[Corner]> =
        images.iter().filter(|i| i.status.is_none()).map(|i| i.corners.as_slice()).collect();
    let nothing = |reason: &str| {
        let lines: Vec<String> =
            images.iter().map(|i| format!("{}: {}", i.path.display(), i.message)).collect();
        Failure::Input(format!("{reason}\n{}", lines.join("\n")))
    };
    if found.is_empty() {
        return Err(nothing("no photo shows the board; expected at least one"));
    }
    let stated = images.iter().filter(|i| i.status.is_none()).find_map(|i| i.prior);
    let mut prior = stated.unwrap_or(CameraPrior::ordinary(size.0, size.1));
    if let Some(focal) = arguments.focal {
        prior = prior.with_focal(focal, 0.03);
    }
    let estimate = estimate_camera(&targets[0], &found, &prior, None)
        .map_err(|reason| nothing(&format!("no camera explains the photos: {reason}")))?;
    // The camera assumes a flat print as planned, which most are; deviations are reported beside it.
    let paper = estimate_camera_and_paper(&targets[0], &found, &prior, Some(&estimate.camera))
        .map_or_else(|_| PaperEstimate::default(), |both| both.paper);
    let value = report(&images, &estimate, &paper);
    let text = serde_json::to_string_pretty(&value).map_err(|e| Failure::Other(e.to_string()))?;
    if let Some(out) = &arguments.out {
        write_atomic(out, format!("{text}\n").as_bytes())?;
    }
    if arguments.json {
        terminal::print(&format!("{text}\n"))
    } else {
        terminal::print(&summary(&value, &estimate))
    }
}

/// Finds the board in a photo. Only a file that is not there is a fault.
fn look<'a>(path: &'a Path, targets: &[Target]) -> Result<Image<'a>> {
    let mut image = Image {
        path,
        status: None,
        message: String::new(),
        size: (0, 0),
        prior: None,
        corners: Vec::new(),
    };
    let read = files::read(path, &files::Options { exposure: Some(1.0), ..Default::default() });
    let photo = match read {
        Ok(decoded) => decoded.photo,
        Err(fault @ Error::Image { .. }) => {
            image.status = Some("unreadable");
            image.message = fault.to_string();
            return Ok(image);
        }
        Err(fault) => return Err(Failure::Input(fault.to_string())),
    };
    image.size = (photo.width(), photo.height());
    image.prior = photo.focal_35mm().map(|_| CameraPrior::of_photo(&photo));
    let luma = LumaImage::from_photo(&photo);
    drop(photo);
    let mut best: std::result::Result<Detection, _> = detect(&luma, &targets[0]);
    for target in &targets[1..] {
        let other = detect(&luma, target);
        let better = match (&best, &other) {
            (Err(_), Ok(_)) => true,
            (Ok(a), Ok(b)) => b.corners.len() > a.corners.len(),
            _ => false,
        };
        if better {
            best = other;
        }
    }
    match best {
        Ok(detection) => image.corners = detection.corners,
        Err(reason) => {
            image.status = Some(reason.code());
            image.message = reason.to_string();
        }
    }
    Ok(image)
}

/// The size most photos with a board have; of several, the first photo's.
fn usual_size(images: &[Image]) -> (u32, u32) {
    let mut counts: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for image in images.iter().filter(|i| i.status.is_none()) {
        *counts.entry(image.size).or_default() += 1;
    }
    let most = counts.values().copied().max().unwrap_or(0);
    let first = images.iter().find(|i| counts.get(&i.size) == Some(&most));
    first.map_or((0, 0), |i| i.size)
}

fn report(images: &[Image], estimate: &CameraEstimate, paper: &PaperEstimate) -> Value {
    let mut views = estimate.views.iter();
    let rows: Vec<Value> = images
        .iter()
        .map(|image| {
            let name = image.path.display().to_string();
            if let Some(status) = image.status {
                return json!({ "image": name, "status": status, "reason": image.message,
                               "corners": 0, "rms_px": null });
            }
            let view = views.next().expect("one view for each photo with a board");
            let status = if view.used { "used" } else { "left_out" };
            let rms = view.rms_px.is_finite().then_some(view.rms_px);
            let mut row = json!({ "image": name, "status": status,
                                  "corners": view.inliers.iter().filter(|i| **i).count(),
                                  "found": image.corners.len(), "rms_px": rms });
            if !view.used {
                row["reason"] = "its corners do not fit the camera of the others".into();
            }
            row
        })
        .collect();
    let camera = &estimate.camera;
    let sigma = estimate.sigma();
    let PaperEstimate { paper, sigma: spread } = paper;
    json!({
        "width": camera.width,
        "height": camera.height,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "distortion": camera.distortion,
        "rms_px": estimate.rms_px,
        "uncertainty": {
            "fx": sigma[0],
            "fy": sigma[1],
            "cx": sigma[2],
            "cy": sigma[3],
            "distortion": sigma[4..],
        },
        "paper": {
            "aspect": paper.aspect,
            "bow_mm": paper.bow_mm,
            "aspect_sigma": spread[0],
            "bow_sigma_mm": spread[1..],
        },
        "images": rows,
    })
}

/// Text for people.
fn summary(value: &Value, estimate: &CameraEstimate) -> String {
    let camera = &estimate.camera;
    let sigma = estimate.sigma();
    let mut text =
        format!("{}x{} px, RMS {:.3} px\n", camera.width, camera.height, estimate.rms_px);
    let names = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];
    let [k1, k2, p1, p2, k3] = camera.distortion;
    let values = [camera.fx, camera.fy, camera.cx, camera.cy, k1, k2, p1, p2, k3];
    for ((name, value), sigma) in names.iter().zip(values).zip(sigma) {
        let digits = if name.starts_with(['f', 'c']) { 2 } else { 5 };
        text += &format!("{name} {value:12.digits$} +- {sigma:.digits$}\n");
    }
    for row in value["images"].as_array().into_iter().flatten() {
        let of = |key: &str| row[key].as_str().unwrap_or_default();
        let number = row["rms_px"].as_f64().map_or(String::new(), |v| format!(", RMS {v:.3} px"));
        let reason =
            if of("reason").is_empty() { String::new() } else { format!(": {}", of("reason")) };
        text += &format!(
            "{}: {}, {} corners{number}{reason}\n",
            of("image"),
            of("status"),
            row["corners"]
        );
    }
    text
}
