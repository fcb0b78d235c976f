//! `svbrdf fit`

use std::path::PathBuf;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use svbrdf::Error;
use svbrdf::capture::{Capture, Frame, read_camera};
use svbrdf::export::{
    ExportOptions, Format, check_writable, export, write_atomic, write_preview, write_sized_maps,
};
use svbrdf::session::{Accepted, Budget, Method, Pushed, Session, Settings};

use crate::failure::{Failure, Result};

/// Find the maps of a capture
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  svbrdf fit examples/captures/tile --out maps\n  svbrdf fit capture --out maps --resolution 1024 --frames 5"
)]
pub struct Arguments {
    /// Folder with capture.json
    capture: PathBuf,
    /// Folder to write maps, preview and report into; made if missing
    #[arg(long)]
    out: PathBuf,
    /// Texels along each side: 256, 512, 1024 or 2048
    #[arg(long, default_value = "256", value_parser = ["256", "512", "1024", "2048"])]
    resolution: String,
    /// Use the first N photos only
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Latent code of the network and refinement, or inverse rendering without it
    #[arg(long, default_value = "deep", value_parser = ["deep", "classic"])]
    method: String,
    /// Leave out the per-texel refinement
    #[arg(long)]
    no_refine: bool,
    /// Steps of the optimisers on each photo, at most: fewer are faster and coarser
    #[arg(long, value_name = "N")]
    steps: Option<u32>,
    /// Take all photos in before the fit begins: faster, a little coarser
    #[arg(long)]
    at_once: bool,
    /// Threads; 0: one per core, at most 4
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Camera to use instead of the capture's (JSON, as `camera` in capture.json)
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Also export the maps, see `svbrdf export`: glb, usdz, materialx, unreal, unity-hdrp, unity-urp, blender
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', value_parser = crate::export::format)]
    export: Vec<Format>,
    /// No progress
    #[arg(long)]
    quiet: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let begun = Instant::now();
    let camera = arguments.camera.as_ref().map(read_camera).transpose().map_err(Failure::input)?;
    let capture = Capture::load_with_camera(&arguments.capture, camera).map_err(Failure::input)?;
    check_writable(&arguments.out)?;
    let settings = Settings {
        sample_mm: capture.sample_mm,
        resolution: arguments.resolution.parse().expect("one of four numbers"),
        method: if arguments.method == "classic" { Method::Classic } else { Method::Deep },
        refine: !arguments.no_refine,
        threads: arguments.threads,
        seed: arguments.seed,
        ..Settings::default()
    };
    let session = Session::new(capture.scene.clone(), settings)?;
    session.set_budget(Budget { steps: arguments.steps, ..Budget::default() })?;
    let used = arguments.frames.map_or(capture.frames.len(), |n| n as usize);
    let frames = &capture.frames[..used.min(capture.frames.len())];
    let bar = progress_bar(arguments.quiet);
    let mut rows = Vec::new();
    if arguments.at_once {
        session.pause();
    }
    for (index, frame) in frames.iter().enumerate() {
        let taken = Instant::now();
        let mut row = take(&session, frame, index)?;
        if row["status"] == "accepted" && !arguments.at_once {
            fit(&session, &format!("photo {index}"), &bar)?;
            add_losses(&mut row, &session);
            row["seconds"] = json!(taken.elapsed().as_secs_f64());
        }
        if !arguments.quiet {
            bar.suspend(|| eprintln!("{}", line(&row, frame, frames.len())));
        }
        rows.push(row);
    }
    if rows.iter().all(|row| row["status"] == "rejected") {
        let reasons: Vec<String> =
            rows.iter().zip(frames).map(|(r, f)| line(r, f, frames.len())).collect();
        let file = arguments.capture.join(svbrdf::capture::FILE_NAME);
        return Err(Failure::Input(format!(
            "{}: field `frames`: every photo was rejected; expected at least one that can be used\n{}",
            file.display(),
            reasons.join("\n")
        )));
    }
    if arguments.at_once {
        session.resume();
        fit(&session, "all photos", &bar)?;
        rows.iter_mut().for_each(|row| add_losses(row, &session));
        if !arguments.quiet {
            let (loss, seconds) = (session.progress().loss, begun.elapsed().as_secs_f64());
            bar.suspend(|| eprintln!("fit: loss {loss:.4}, {seconds:.1} s in all"));
        }
    }
    bar.finish_and_clear();
    let maps = session.snapshot()?;
    write_sized_maps(&arguments.out, &maps, capture.sample_mm)?;
    write_exports(arguments, &maps, capture.sample_mm, &rows)?;
    write_preview(arguments.out.join("preview.png"), &maps, capture.sample_mm)?;
    final_poses(&session, &mut rows);
    let camera = session.camera();
    let flash = camera.map(|_| json!({ "offset_mm": session.flash_offset_mm().to_array() }));
    let next_view = session.next_view().map(|v| {
        json!({ "direction": v.direction, "tilt_deg": v.tilt_deg, "azimuth_deg": v.azimuth_deg })
    });
    let camera_sigma = session
        .camera_sigma()
        .map(|s| json!({ "fx": s[0], "fy": s[1], "cx": s[2], "cy": s[3], "distortion": s[4..] }));
    let paper = session.paper().map(|p| {
        json!({ "aspect": p.paper.aspect, "bow_mm": p.paper.bow_mm,
                "aspect_sigma": p.sigma[0], "bow_sigma_mm": p.sigma[1..] })
    });
    let elevation = session.elevation().map(|e| json!({ "mm": e.mm, "sigma_mm": e.sigma_mm }));
    let report = json!({
        "frames": rows,
        "camera": camera,
        "camera_uncertainty": camera_sigma,
        "paper": paper,
        "elevation": elevation,
        "flash": flash,
        "next_view": next_view,
        "ambient_fraction": session.ambient_fraction(),
        "resolution": maps.width(),
        "method": arguments.method,
        "seconds_total": begun.elapsed().as_secs_f64(),
        "peak_memory_mib": peak_memory_mib(),
    });
    let text = serde_json::to_string_pretty(&report).map_err(|e| Failure::Other(e.to_string()))?;
    write_atomic(arguments.out.join("report.json"), format!("{text}\n").as_bytes())?;
    if !arguments.quiet {
        let out = arguments.out.display();
        eprintln!(
            "Look at {out}/preview.png; the maps are {out}/normal.png, diffuse.png, specular.png and roughness.png (floats: maps.exr)."
        );
    }
    Ok(())
}

/// Pushes a photo; the row of the report.
fn take(session: &Session, frame: &Frame, index: usize) -> Result<Value> {
    let begun = Instant::now();
    let rejected = |reason: &str, hint: String| {
        json!({ "index": index, "status": "rejected", "reason": reason, "hint": hint,
                "seconds": begun.elapsed().as_secs_f64() })
    };
    let photo = match frame.read() {
        Ok(photo) => photo,
        // A damaged file is a bad photo; what is stated wrongly in the capture is not.
        Err(fault @ Error::Image { .. }) => return Ok(rejected("unreadable", fault.to_string())),
        Err(fault) => return Err(Failure::input(fault)),
    };
    let pushed = match frame.rectified {
        Some(view) => session.push_rectified(&photo, view.camera_mm, view.light_mm)?,
        None => session.push(&photo)?,
    };
    drop(photo);
    let accepted = match pushed {
        Pushed::Accepted(accepted) => accepted,
        Pushed::Rejected(reason) => return Ok(rejected(reason.code(), reason.to_string())),
    };
    let Accepted { pose, reprojection_rms_px, maps_seconds, hints, .. } = accepted;
    let hints: Vec<Value> =
        hints.iter().map(|h| json!({ "code": h.code(), "hint": h.to_string() })).collect();
    let rotation = pose.map(|p| p.rotation.transpose().to_cols_array_2d());
    Ok(json!({
        "index": index,
        "status": "accepted",
        "rotation": rotation,
        "translation_mm": pose.map(|p| p.translation.to_array()),
        "reprojection_rms_px": reprojection_rms_px,
        "seconds": begun.elapsed().as_secs_f64(),
        "first_maps_seconds": maps_seconds,
        "hints": hints,
    }))
}

/// Writes the formats of `--export` beside the maps.
fn write_exports(
    arguments: &Arguments,
    maps: &svbrdf::Svbrdf,
    sample_mm: [f32; 2],
    rows: &[Value],
) -> Result<()> {
    if arguments.export.is_empty() {
        return Ok(());
    }
    let accepted = rows.iter().filter(|row| row["status"] == "accepted").count();
    let options = ExportOptions {
        formats: arguments.export.clone(),
        sample_mm,
        photographs: u32::try_from(accepted).ok(),
        ..ExportOptions::default()
    };
    Ok(export(maps, &options)?.write(&arguments.out)?)
}

/// Waits for the fit.
fn fit(session: &Session, what: &str, bar: &ProgressBar) -> Result<()> {
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| session.wait());
        while !waiting.is_finished() {
            show(session, what, bar);
            std::thread::sleep(Duration::from_millis(40));
        }
        waiting.join().unwrap_or_else(|_| Err(Error::Internal("waiting failed".into())))
    })?;
    Ok(())
}

/// What the fit made of an accepted photo, and of those before.
fn add_losses(row: &mut Value, session: &Session) {
    if row["status"] == "accepted" {
        let progress = session.progress();
        row["loss_before"] = json!(progress.loss_before);
        row["loss_after"] = json!(progress.loss);
    }
}

/// Later photos better the poses of earlier ones where the camera is estimated.
fn final_poses(session: &Session, rows: &mut [Value]) {
    let accepted = rows.iter_mut().filter(|row| row["status"] == "accepted");
    for (row, known) in accepted.zip(session.poses()) {
        row["rotation"] = json!(known.pose.rotation.transpose().to_cols_array_2d());
        row["translation_mm"] = json!(known.pose.translation.to_array());
        row["reprojection_rms_px"] = json!(known.reprojection_rms_px);
    }
}

/// A bar on a terminal, nothing elsewhere.
fn progress_bar(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{msg} [{bar:40}] {percent}%") {
        bar.set_style(style);
    }
    bar
}

fn show(session: &Session, what: &str, bar: &ProgressBar) {
    let progress = session.progress();
    let left = progress.seconds_left.map_or(String::new(), |s| format!(", {s:.0} s left"));
    bar.set_message(format!("{what}, loss {:.4}{left}", progress.loss));
    bar.set_position((1000.0 * progress.fraction) as u64);
}

/// One line about a photo.
fn line(row: &Value, frame: &Frame, count: usize) -> String {
    let place = format!(
        "photo {}/{count} {}",
        row["index"].as_u64().unwrap_or(0) + 1,
        frame.path.display()
    );
    let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
    if row["status"] == "accepted" {
        let hints = row["hints"].as_array().into_iter().flatten();
        let hints: String =
            hints.filter_map(|h| Some(format!("; {}", h["hint"].as_str()?))).collect();
        let losses = match (row["loss_before"].as_f64(), row["loss_after"].as_f64()) {
            (Some(before), Some(after)) => format!("loss {before:.4} -> {after:.4}, "),
            _ => String::new(),
        };
        format!("{place}: accepted, {losses}{:.1} s{hints}", number("seconds"))
    } else {
        let text = |key: &str| row[key].as_str().unwrap_or_default();
        format!("{place}: rejected ({}): {}", text("reason"), text("hint"))
    }
}

/// Largest resident memory so far, where the system tells.
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}
