//! `svbrdf fit`

mod document;
mod held_out;
mod photographs;

use std::path::{Path, PathBuf};
use std::time::Instant;

use svbrdf::capture::{Capture, read_camera};
use svbrdf::export::{
    ExportOptions, Format, check_writable, export, write_atomic, write_preview, write_sized_maps,
};
use svbrdf::session::{Budget, Method, Session, Settings};

use self::document::Document;
use self::held_out::Errors;
use self::photographs::{Fit, Options};
use crate::failure::{Failure, Result};
use crate::interrupt::Interrupt;
use crate::report::{self, Subject};

/// Find the maps of a capture
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  svbrdf fit examples/captures/tile --out maps\n  svbrdf fit capture --out maps --resolution 1024 --frames 5\n  svbrdf fit capture --out maps --hold-out 2\n\nCtrl-C ends the fit in order: what is there is written, the exit status is 130."
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
    /// Predict the last K photos that can be used instead of fitting them: the error of that says how
    /// good the maps are
    #[arg(long, value_name = "K", default_value_t = 0)]
    hold_out: u32,
    /// Leave out report.html
    #[arg(long)]
    no_report: bool,
    /// Threads; 0: one per core, at most 4
    #[arg(long, default_value_t = 0)]
    threads: usize,
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
    let interrupt = Interrupt::listen()?;
    let camera = arguments.camera.as_ref().map(read_camera).transpose().map_err(Failure::input)?;
    let capture = Capture::load_with_camera(&arguments.capture, camera).map_err(Failure::input)?;
    check_writable(&arguments.out)?;
    let session = session(arguments, &capture)?;
    let options = Options {
        at_once: arguments.at_once,
        hold_out: arguments.hold_out as usize,
        quiet: arguments.quiet,
        report: !arguments.no_report,
    };
    let count = arguments.frames.map_or(capture.frames.len(), |n| n as usize);
    let frames = &capture.frames[..count.min(capture.frames.len())];
    let mut fit = Fit::new(options, frames, &session, &interrupt);
    fit.run()?;
    check_fitted(arguments, &fit)?;
    let maps = session.snapshot()?;
    write_sized_maps(&arguments.out, &maps, capture.sample_mm)?;
    write_exports(arguments, &maps, capture.sample_mm, fit.fitted())?;
    write_preview(arguments.out.join("preview.png"), &maps, capture.sample_mm)?;
    let held_out = fit.held_out()?;
    let errors = Errors::measure(&fit.stages, held_out)?;
    fit.finish_rows(&errors);
    let held_out = (arguments.hold_out > 0).then_some(&errors);
    let document = Document::new(&session, &fit, held_out, &arguments.method, maps.width(), begun);
    document.write(&arguments.out)?;
    if !arguments.no_report {
        let subject = Subject {
            report: &document.value,
            capture: &capture,
            frames,
            camera: session.camera(),
            maps: &maps,
            predictions: errors.indices.iter().copied().zip(&errors.predictions).collect(),
            name: name(&arguments.capture),
        };
        let page = report::page(&subject, &fit.recorder)?;
        write_atomic(arguments.out.join("report.html"), page.as_bytes())?;
    }
    let out = arguments.out.display();
    let first = if arguments.no_report { "preview.png" } else { "report.html" };
    fit.progress.say(&format!(
        "Look at {out}/{first}; the maps are {out}/normal.png, diffuse.png, specular.png and roughness.png (floats: maps.exr)."
    ));
    if interrupt.is_set() {
        let (fitted, all) = (fit.fitted(), frames.len());
        return Err(Failure::Interrupted(format!(
            "{out} holds maps and report of what was there: {fitted} of {all} photos in the fit"
        )));
    }
    Ok(())
}

/// Writes the formats of `--export` beside the maps.
fn write_exports(
    arguments: &Arguments,
    maps: &svbrdf::Svbrdf,
    sample_mm: [f32; 2],
    photographs: usize,
) -> Result<()> {
    if arguments.export.is_empty() {
        return Ok(());
    }
    let options = ExportOptions {
        formats: arguments.export.clone(),
        sample_mm,
        photographs: u32::try_from(photographs).ok(),
        ..ExportOptions::default()
    };
    Ok(export(maps, &options)?.write(&arguments.out)?)
}

fn session(arguments: &Arguments, capture: &Capture) -> Result<Session> {
    let settings = Settings {
        sample_mm: capture.sample_mm,
        resolution: arguments.resolution.parse().expect("one of four numbers"),
        method: if arguments.method == "classic" { Method::Classic } else { Method::Deep },
        refine: !arguments.no_refine,
        threads: arguments.threads,
        ..Settings::default()
    };
    let session = Session::new(capture.scene.clone(), settings)?;
    session.set_budget(Budget { steps: arguments.steps, ..Budget::default() })?;
    Ok(session)
}

/// Name of a capture: that of its folder.
fn name(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    whole.file_name().map_or_else(|| "capture".into(), |n| n.to_string_lossy().into_owned())
}

/// Refuses to go on without any photograph in the fit.
fn check_fitted(arguments: &Arguments, fit: &Fit) -> Result<()> {
    if fit.fitted() > 0 {
        return Ok(());
    }
    if fit.interrupted() {
        return Err(Failure::Interrupted("no photo was in the fit yet; nothing is written".into()));
    }
    let waiting = fit.waiting();
    if waiting > 0 {
        return Err(Failure::Input(format!(
            "--hold-out {}: {waiting} photos can be used; expected at least one more than are held out",
            arguments.hold_out
        )));
    }
    let file = arguments.capture.join(svbrdf::capture::FILE_NAME);
    Err(Failure::Input(format!(
        "{}: field `frames`: every photo was rejected; expected at least one that can be used\n{}",
        file.display(),
        fit.lines().join("\n")
    )))
}
