//! Prediction errors: some photographs are fitted, others are rendered from the maps and compared.

mod board;
mod npy;
mod orders;
mod pictures;
mod score;
mod table;
mod truth;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ArgAction;
use svbrdf::capture::{Capture, PhotoFile};
use svbrdf::export::{resized, write_atomic};
use svbrdf::observation::{Falloff, View};
use svbrdf::rectification::from_rectified;
use svbrdf::render::render;
use svbrdf::session::{LightCorrection, RectifiedFalloff, Scene, Session};
use svbrdf::{Error, Result, Svbrdf};

use self::orders::{Part, Plan, plans};
use self::score::HeldOut;
pub use self::score::SIDE;
pub use self::table::{Record, means};
use crate::artifacts::{self, Artifacts, Place};
use crate::streaming::{Setup, Variant, capture_folders, name, push};

/// Arguments of `svbrdf-eval heldout`.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub struct Arguments {
    /// Captures, or folders of captures
    #[arg(required = true)]
    captures: Vec<PathBuf>,
    #[command(flatten)]
    protocol: Protocol,
    /// Estimator of the maps
    #[arg(long, default_value = "deep", value_parser = ["deep", "classic"])]
    method: String,
    /// Leave out the per-texel refinement
    #[arg(long)]
    no_refine: bool,
    /// Folder for pictures: photograph, prediction, difference (gray: none)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder for the maps at each number of photographs (first order), and a sheet of them all:
    /// normal, diffuse, F0, roughness; the last row is the truth where it is known
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
    /// File for the errors of every predicted photograph
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

const HELP: &str = "Errors are root-mean-square differences of values encoded with gamma 2.2 in \
[0, 1], at 256 texels a side. Rectified captures of four photographs and more are fitted in \
several orders, each of which holds its last two out; of three photographs every one is held out \
once, and the first alone predicts the others. Captures of a board are fitted in the order of the \
file; those with truth/heldout predict its frames, others their last two. Artifacts are as \
`svbrdf-eval artifacts` has them.";

/// The photographs to fit, and the comparison of predictions.
#[derive(Clone, clap::Args)]
pub struct Protocol {
    /// Numbers of photographs to fit
    #[arg(long, value_delimiter = ',', default_value = "1,2,3,5,7")]
    pub fit: Vec<usize>,
    /// Orders of the photographs of rectified captures, at most
    #[arg(long, default_value_t = 4)]
    pub orders: usize,
    /// One brightness factor per held-out photograph
    #[arg(long, value_name = "BOOL", action = ArgAction::Set, default_value_t = true,
        num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub gain: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let variant = match (arguments.method.as_str(), arguments.no_refine) {
        ("classic", _) => Variant::Classic,
        (_, true) => Variant::Latent,
        _ => Variant::Deep,
    };
    let setup = Setup { resolution: SIDE, ..setup.clone() };
    let mut all = Vec::new();
    for folder in capture_folders(&arguments.captures)? {
        let kept = Kept { pictures: arguments.out.as_deref(), maps: arguments.maps.as_deref() };
        let records = evaluate(&folder, &arguments.protocol, variant, &setup, kept)?;
        table::print(&records);
        all.extend(records);
    }
    table::print_summary(&all);
    if let Some(path) = &arguments.json {
        write_atomic(path, table::json(&all).as_bytes())?;
    }
    Ok(())
}

/// Output folders for inspection.
#[derive(Clone, Copy, Default)]
pub struct Kept<'a> {
    /// Predicted photographs.
    pub pictures: Option<&'a Path>,
    /// Maps.
    pub maps: Option<&'a Path>,
}

/// Errors of every held-out photograph of a capture.
pub fn evaluate(
    folder: &Path,
    protocol: &Protocol,
    variant: Variant,
    setup: &Setup,
    kept: Kept,
) -> Result<Vec<Record>> {
    let capture = Capture::load(folder)?;
    let (ideal, truth) = (truth::held_out(folder, &capture)?, artifacts::truth(folder)?);
    let plans = courses(folder, &capture, ideal.as_deref(), protocol)?;
    let ideal: Option<Vec<HeldOut>> =
        ideal.map(|photographs| photographs.into_iter().map(|(_, photo)| photo).collect());
    let mut records = Vec::new();
    for (order, plan) in plans.iter().enumerate() {
        let course = Course::run(&capture, plan, &protocol.fit, variant, setup)?;
        if let (0, Some(out)) = (order, kept.maps) {
            pictures::write_maps(out, &name(folder), &course.stages(), truth.as_ref())?;
        }
        let own = match &ideal {
            None => course.photographs(&capture, plan)?,
            Some(_) => Vec::new(),
        };
        let photographs = ideal.as_ref().unwrap_or(&own);
        for stage in &course.stages {
            let artifacts =
                Artifacts::of(&stage.maps, truth.as_ref(), capture.sample_mm, &stage.places);
            for (&frame, photograph) in plan.held_out.iter().zip(photographs) {
                // An ideal photograph has its true light, others the common correction.
                let view = match &ideal {
                    Some(_) => photograph.view,
                    None => stage.correction.predict(&photograph.view),
                };
                let radiance = rendered(&stage.maps, &view, photograph.side);
                let record = Record {
                    capture: name(folder),
                    variant,
                    part: plan.part,
                    fitted: stage.fitted,
                    order,
                    photograph: name(&capture.photos[frame].path),
                    score: photograph.score(&radiance, protocol.gain),
                    artifacts,
                };
                if let Some(out) = kept.pictures {
                    pictures::write(out, &record, photograph, &radiance, protocol.gain)?;
                }
                records.push(record);
            }
        }
    }
    Ok(records)
}

/// The sessions of a capture, whose frames may have known ideal versions.
fn courses(
    folder: &Path,
    capture: &Capture,
    ideal: Option<&[(usize, HeldOut)]>,
    protocol: &Protocol,
) -> Result<Vec<Plan>> {
    let count = capture.photos.len();
    let plans = match (ideal, &capture.scene) {
        (Some(ideal), _) => {
            let held_out: Vec<usize> = ideal.iter().map(|(i, _)| *i).collect();
            let fitted = (0..count).filter(|i| !held_out.contains(i)).collect();
            vec![Plan { part: Part::Orders, fitted, held_out }]
        }
        (None, Scene::Board { .. }) => plans(count, 1),
        (None, Scene::Rectified { .. }) => plans(count, protocol.orders),
    };
    if plans.is_empty() {
        let message = format!("{}: one photograph, two or more expected", folder.display());
        return Err(Error::argument("captures", message));
    }
    Ok(plans)
}

fn rendered(maps: &Svbrdf, view: &View, side: usize) -> Vec<f32> {
    let maps = resized(maps, side, side);
    let mut radiance = vec![0.0; 3 * maps.texels()];
    render(&maps, view, &mut radiance);
    radiance
}

/// A session after the photographs to fit, with its maps on the way.
struct Course {
    session: Session,
    /// Indices of accepted frames.
    accepted: Vec<usize>,
    stages: Vec<Stage>,
}

/// State of a session on the way.
struct Stage {
    /// Number of photographs pushed.
    fitted: usize,
    maps: Arc<Svbrdf>,
    correction: LightCorrection,
    /// Of the accepted photographs.
    places: Vec<Place>,
}

impl Course {
    fn run(
        capture: &Capture,
        plan: &Plan,
        counts: &[usize],
        variant: Variant,
        setup: &Setup,
    ) -> Result<Self> {
        let session = setup.session(capture, variant)?;
        let mut course = Self { session, accepted: Vec::new(), stages: Vec::new() };
        let most = counts.iter().copied().max().unwrap_or(0);
        for (i, &index) in plan.fitted.iter().enumerate().take(most) {
            let file = &capture.photos[index];
            match push(&course.session, file)? {
                Some(reason) => eprintln!("{}: {reason}", file.path.display()),
                None => {
                    course.session.wait()?;
                    course.accepted.push(index);
                }
            }
            if counts.contains(&(i + 1)) && !course.accepted.is_empty() {
                let session = &course.session;
                course.stages.push(Stage {
                    fitted: i + 1,
                    maps: session.snapshot()?,
                    correction: session.light_correction(),
                    places: artifacts::places(session, capture, &course.accepted),
                });
            }
        }
        Ok(course)
    }

    /// Maps by number of photographs.
    fn stages(&self) -> Vec<(usize, &Svbrdf)> {
        self.stages.iter().map(|stage| (stage.fitted, &*stage.maps)).collect()
    }

    /// The photographs to predict, with their true views.
    fn photographs(&self, capture: &Capture, plan: &Plan) -> Result<Vec<HeldOut>> {
        let Scene::Rectified { falloff } = capture.scene else {
            return board::photographs(&self.session, capture, &self.accepted, &plan.held_out);
        };
        let falloff = match falloff {
            RectifiedFalloff::Given(falloff) => falloff,
            // As the session chooses it: the distance of the first photograph.
            RectifiedFalloff::InverseSquareAuto => {
                let first = capture.photos[plan.fitted[0]].rectified;
                let camera_mm = first.map_or([0.0; 3], |view| view.camera_mm);
                let square: f32 = camera_mm.iter().map(|v| v * v).sum();
                Falloff::InverseSquare { power_mm2: [std::f32::consts::PI * square; 3] }
            }
        };
        plan.held_out
            .iter()
            .map(|&index| rectified(&capture.photos[index], capture.sample_mm, falloff))
            .collect()
    }
}

/// A rectified photograph from its file.
fn rectified(file: &PhotoFile, sample_mm: [f32; 2], falloff: Falloff) -> Result<HeldOut> {
    let place = file
        .rectified
        .ok_or_else(|| Error::Internal(format!("{}: no camera and light", file.path.display())))?;
    let view = View {
        sample_mm,
        camera_mm: place.camera_mm,
        light_mm: place.light_mm,
        falloff,
        ..View::default()
    };
    let observation = from_rectified(&file.read()?, view, SIDE, SIDE)
        .map_err(|e| Error::Image { path: file.path.clone(), message: e.to_string() })?;
    let n = observation.texels();
    // Negative radiances mark saturated values.
    let observed =
        (0..3 * n).map(|i| file.exposure * observation.radiance(i / n, i % n).abs()).collect();
    Ok(HeldOut { view, exposure: file.exposure, observed, side: SIDE, seen: None })
}
