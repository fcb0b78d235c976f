//! Feeds the photographs of a capture to a session one at a time, like `svbrdf fit`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ValueEnum;
use svbrdf::capture::{Capture, FILE_NAME, PhotoFile};
use svbrdf::estimate::EstimateOptions;
use svbrdf::estimator::Estimator;
use svbrdf::networks::Networks;
use svbrdf::session::{Method, Outcome, Scene, Session, Settings};
use svbrdf::{Error, Rejection, Result};

/// Maps to evaluate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Variant {
    /// Maps of the first photograph before any optimisation
    First,
    /// Latent fit without refinement
    Latent,
    /// Latent fit and refinement
    Deep,
    /// Inverse rendering on the maps, the baseline
    Classic,
}

impl Variant {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::First => "first",
            Self::Latent => "latent",
            Self::Deep => "deep",
            Self::Classic => "classic",
        }
    }
}

/// Settings common to the sessions of an evaluation.
#[derive(Clone)]
pub struct Setup {
    pub networks: Arc<Networks>,
    /// Options of the estimator.
    pub options: EstimateOptions,
    /// Threads of the fit; 0: one per core, at most 4.
    pub threads: usize,
    /// Texels along each side of the maps.
    pub resolution: usize,
}

impl Setup {
    /// A session for a capture.
    pub fn session(&self, capture: &Capture, variant: Variant) -> Result<Session> {
        let method = if variant == Variant::Classic { Method::Classic } else { Method::Deep };
        let settings = Settings {
            sample_mm: capture.sample_mm,
            resolution: self.resolution,
            method,
            refine: variant != Variant::Latent,
            threads: self.threads,
            ..Settings::default()
        };
        let (scene, networks) = (capture.scene.clone(), self.networks.clone());
        Session::with_options(scene, settings, networks, self.options.clone())
    }

    /// An estimate of rectified photographs.
    pub fn estimator(&self, method: Method, refine: bool) -> Estimator {
        Estimator::with_options(self.networks.clone(), method, refine, self.options.clone())
    }
}

/// Adds a photograph; returns the reason of a rejection.
pub fn push(session: &Session, file: &PhotoFile) -> Result<Option<Rejection>> {
    let photo = file.read()?;
    let outcome = match file.rectified {
        Some(view) => session.add_rectified_photo(&photo, view.camera_mm, view.light_mm)?,
        None => session.add_photo(&photo)?,
    };
    Ok(match outcome {
        Outcome::Accepted(_) => None,
        Outcome::Rejected(reason) => Some(reason),
    })
}

/// Takes camera and flash out of a capture of a board, so that the session estimates them.
pub fn withhold_camera(capture: &mut Capture) {
    if let Scene::Board { camera, flash_offset_mm, .. } = &mut capture.scene {
        (*camera, *flash_offset_mm) = (None, None);
    }
}

/// Capture folders among `paths`. Another folder stands for the captures in it, sorted.
pub fn capture_folders(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut folders = Vec::new();
    for path in paths {
        if path.join(FILE_NAME).is_file() {
            folders.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
        let mut inside: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|folder| folder.join(FILE_NAME).is_file())
            .collect();
        if inside.is_empty() {
            let message = format!("{}: neither a capture nor a folder of captures", path.display());
            return Err(Error::argument("captures", message));
        }
        inside.sort();
        folders.append(&mut inside);
    }
    Ok(folders)
}

/// Last part of a path, to name a capture or a photograph.
pub fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
