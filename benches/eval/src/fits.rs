//! Records of fits for the training of the completion network.

use std::path::{Path, PathBuf};

use svbrdf::capture::{Capture, PhotoFile};
use svbrdf::estimate::{Method, coordinates};
use svbrdf::observation::Observation;
use svbrdf::random::Random;
use svbrdf::session::{Observed, Outcome, Scene, Session};
use svbrdf::{Error, Result, Svbrdf};

use crate::captures::with_truth;
use crate::experiments::seed;
use crate::protocol::{self, Conditions, crops};
use crate::streaming::{Setup, Variant, capture_folders, name, push};

/// Arguments of `svbrdf-eval fits`.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    materials: protocol::Arguments,
    /// Captures whose true maps are known (`svbrdf simulate --real`), in place of materials
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "materials")]
    captures: Vec<PathBuf>,
    /// Numbers of photographs after which to record
    #[arg(long, value_delimiter = ',', default_value = "2,3,5,8,12")]
    photos: Vec<usize>,
    /// Folder to write; records that it has are left
    #[arg(long)]
    out: PathBuf,
    /// Chooses cameras and noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// Records input and target of the learned prior as half floats: `NAME-COUNT.f16` (see
/// [`svbrdf::estimate::FitRecord::planes`]) and `NAME-truth.f16` in the same coordinates. Names of
/// materials end with the seed.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let Arguments { captures, out, .. } = arguments;
    std::fs::create_dir_all(out).map_err(|e| Error::io(out, e))?;
    let recorder = Recorder { setup, counts: &arguments.photos, out };
    if captures.is_empty() {
        return of_materials(arguments, &recorder);
    }
    for folder in capture_folders(captures)? {
        let stem = name(&folder);
        if recorder.is_new(&stem) {
            let (capture, truth) = with_truth(&folder, setup.resolution)?;
            let observations = observations(&capture, setup, recorder.most())?;
            let roughly = matches!(capture.scene, Scene::Rectified { .. });
            recorder.record(&stem, &truth, observations, roughly)?;
        }
    }
    Ok(())
}

fn of_materials(arguments: &Arguments, recorder: &Recorder) -> Result<()> {
    for (index, crop) in crops(&arguments.materials)?.iter().enumerate() {
        let stem = format!("{}-{}", crop.name.replace(' ', "_"), arguments.seed);
        if recorder.is_new(&stem) {
            let chosen = 7777 * arguments.seed + seed(index);
            let conditions = Conditions::random(&mut Random::new(chosen));
            let most = recorder.most();
            let observations = protocol::photographs(&crop.truth, most, chosen, &conditions);
            recorder.record(&stem, &crop.truth, observations, false)?;
        }
    }
    Ok(())
}

/// The first photographs of a capture, each as calibrated on arrival.
fn observations(capture: &Capture, setup: &Setup, most: usize) -> Result<Vec<Observation>> {
    let session = setup.session(capture, Variant::Deep)?;
    session.pause();
    let mut observations = Vec::new();
    for file in capture.photos.iter().take(most) {
        match observe(&session, file)? {
            Outcome::Accepted(Observed { observation, .. }) => observations.push(observation),
            Outcome::Rejected(reason) => eprintln!("{}: {reason}", file.path.display()),
        }
        push(&session, file)?;
    }
    Ok(observations)
}

fn observe(session: &Session, file: &PhotoFile) -> Result<Outcome<Observed>> {
    let photo = file.read()?;
    match file.rectified {
        Some(view) => session.observe_rectified(&photo, view.camera_mm, view.light_mm),
        None => session.observe(&photo),
    }
}

struct Recorder<'a> {
    setup: &'a Setup,
    counts: &'a [usize],
    out: &'a Path,
}

impl Recorder<'_> {
    /// Number of photographs in the largest record.
    fn most(&self) -> usize {
        self.counts.iter().copied().max().unwrap_or(2)
    }

    fn path(&self, stem: &str, what: &str) -> PathBuf {
        self.out.join(format!("{stem}-{what}.f16"))
    }

    fn is_new(&self, stem: &str) -> bool {
        !self.path(stem, "truth").exists()
    }

    /// Fits photographs one by one. `roughly` says whether their lights are only roughly known. One
    /// photograph gives no record.
    fn record(
        &self,
        stem: &str,
        truth: &Svbrdf,
        observations: Vec<Observation>,
        roughly: bool,
    ) -> Result<()> {
        let mut estimator = self.setup.estimator(Method::Deep, true);
        estimator.correct_lights(roughly);
        estimator.keep_record();
        for observation in observations {
            estimator.add(observation)?;
            estimator.settle()?;
            let count = estimator.photos();
            if let Some(record) = estimator.record().filter(|_| self.counts.contains(&count)) {
                write_halves(&self.path(stem, &count.to_string()), &record.planes())?;
            }
        }
        write_halves(&self.path(stem, "truth"), &coordinates(truth))?;
        eprintln!("{stem}");
        Ok(())
    }
}

fn write_halves(path: &Path, values: &[f32]) -> Result<()> {
    let bytes: Vec<u8> =
        values.iter().flat_map(|&v| half::f16::from_f32(v).to_le_bytes()).collect();
    std::fs::write(path, bytes).map_err(|e| Error::io(path, e))
}
