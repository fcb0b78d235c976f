//! Map errors of captures with known true maps.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use svbrdf::capture::Capture;
use svbrdf::comparison::{Differences, compare};
use svbrdf::export::{read_maps, resized};
use svbrdf::{Result, Svbrdf};

use crate::artifacts::{self, Artifacts};
use crate::clock::{Seconds, timed};
use crate::streaming::{Setup, Variant, capture_folders, push, withhold_camera};

/// Arguments of `svbrdf-eval captures`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Folders with capture.json and the true maps in truth/, or folders of such
    #[arg(required = true)]
    captures: Vec<PathBuf>,
    /// Numbers of accepted photographs
    #[arg(long, value_delimiter = ',', default_value = "1,2,4,8")]
    photos: Vec<usize>,
    /// Maps to evaluate
    #[arg(long, value_delimiter = ',', default_value = "first,latent,deep,classic")]
    methods: Vec<Variant>,
    /// Texels along each side of the maps
    #[arg(long, default_value_t = 256)]
    resolution: usize,
    /// Camera and flash of the capture, or estimated from the photographs
    #[arg(long, value_enum, default_value_t = CameraUse::Given)]
    camera: CameraUse,
}

/// Whether sessions get camera and flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraUse {
    /// As the capture says
    Given,
    /// Estimated even if the capture has them
    Withheld,
}

/// Errors after a number of photographs.
pub struct Row {
    pub photos: usize,
    pub differences: Differences,
    pub artifacts: Artifacts,
    /// Mean log-L1 of the fit.
    pub loss: f32,
    /// Time of these photographs, including reading.
    pub seconds: Seconds,
}

/// Map errors of `capture` after each of `counts` accepted photographs. Reports rejected
/// photographs on standard error.
pub fn errors(
    capture: &Capture,
    truth: &Svbrdf,
    counts: &[usize],
    variant: Variant,
    setup: &Setup,
) -> Result<Vec<Row>> {
    let session = setup.session(capture, variant)?;
    let mut seconds = Seconds::default();
    let mut rows = Vec::new();
    let mut accepted = Vec::new();
    for (index, file) in capture.photos.iter().enumerate() {
        if variant == Variant::First {
            session.pause();
        }
        let (rejection, taken) = timed(|| {
            let rejection = push(&session, file)?;
            if variant != Variant::First && rejection.is_none() {
                session.wait()?;
            }
            Ok::<_, svbrdf::Error>(rejection)
        });
        seconds += taken;
        if let Some(reason) = rejection? {
            eprintln!("{}: {reason}", file.path.display());
            continue;
        }
        accepted.push(index);
        let photos = accepted.len();
        if variant == Variant::First || counts.contains(&photos) {
            let maps = session.snapshot()?;
            let places = artifacts::places(&session, capture, &accepted);
            rows.push(Row {
                photos,
                differences: compare(&maps, truth)?,
                artifacts: Artifacts::of(&maps, Some(truth), capture.sample_mm, &places),
                loss: session.progress().loss,
                seconds,
            });
        }
        if variant == Variant::First || counts.iter().all(|&n| n <= photos) {
            break;
        }
    }
    Ok(rows)
}

/// Reads a capture and its true maps at a resolution.
pub fn with_truth(folder: &Path, resolution: usize) -> Result<(Capture, Svbrdf)> {
    let capture = Capture::load(folder)?;
    let truth = read_maps(folder.join("truth"))?;
    Ok((capture, resized(&truth, resolution, resolution)))
}

/// Runs the command; `setup` has its resolution replaced.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let setup = Setup { resolution: arguments.resolution, ..setup.clone() };
    for folder in capture_folders(&arguments.captures)? {
        let (mut capture, truth) = with_truth(&folder, setup.resolution)?;
        if arguments.camera == CameraUse::Withheld {
            withhold_camera(&mut capture);
        }
        println!("\n{}", folder.display());
        println!("method    N  render  normal  diffuse  specular  roughness  loss  seconds");
        for &variant in &arguments.methods {
            for row in errors(&capture, &truth, &arguments.photos, variant, &setup)? {
                let Differences { normal, diffuse, specular, roughness, render, .. } =
                    row.differences;
                println!(
                    "{:<8} {:>2}  {render:.4}  {normal:.4}  {diffuse:.4}   {specular:.4}    {roughness:.4}  {:.4}  {:6.1}",
                    variant.name(),
                    row.photos,
                    row.loss,
                    row.seconds.wall
                );
            }
        }
    }
    Ok(())
}
