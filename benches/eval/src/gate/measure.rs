//! Measurements of the gate.

use std::path::{Path, PathBuf};

use svbrdf::comparison::compare;
use svbrdf::estimate::Method;
use svbrdf::{Error, Result};

use super::figures::Figures;
use super::fresh;
use crate::clock::{Seconds, timed};
use crate::experiments::seed;
use crate::protocol::{self, Conditions, photographs};
use crate::streaming::{Setup, Variant, capture_folders, name};
use crate::{captures, heldout};

/// Numbers of photographs of captures at which errors count.
const CAPTURE_PHOTOS: [usize; 8] = [1, 2, 3, 4, 5, 6, 7, 8];
/// The same for synthetic photographs of known materials.
const MATERIAL_PHOTOS: [usize; 3] = [1, 2, 5];
/// The same for captures that predict photographs.
const FITTED: [usize; 7] = [1, 2, 3, 4, 5, 6, 7];
/// Orders of real photographs.
const ORDERS: usize = 4;

/// Captures generated for a run.
pub struct Fresh<'a> {
    pub seeds: &'a [u64],
    /// Folder to keep them in; `None`: temporary.
    pub keep: Option<&'a Path>,
}

/// Figures of the selected groups.
pub fn figures(data: &Path, groups: &[String], fresh: &Fresh, setup: &Setup) -> Result<Figures> {
    let setup = Setup { resolution: heldout::SIDE, ..setup.clone() };
    let mut figures = Figures::new(setup.threads);
    for group in groups {
        let (result, taken) = timed(|| match group.as_str() {
            "captures" => known_captures(&data.join("captures/dev"), &setup, &mut figures),
            "photos" => materials(&data.join("materials/validation"), &setup, &mut figures),
            "fresh" => {
                let mut of = |&seed| made(data, seed, fresh.keep, &setup, &mut figures);
                fresh.seeds.iter().try_for_each(&mut of)
            }
            _ => {
                let folders = folders(&data.join("captures").join(group))?;
                predictions(&folders, group, ORDERS, &setup, &mut figures)
            }
        });
        result?;
        eprintln!("{group}: {:.0} s", taken.wall);
    }
    Ok(figures)
}

fn known_captures(folder: &Path, setup: &Setup, figures: &mut Figures) -> Result<()> {
    let mut total = Seconds::default();
    let mut photos = 0;
    for folder in folders(folder)? {
        let (capture, truth) = captures::with_truth(&folder, setup.resolution)?;
        let rows = captures::errors(&capture, &truth, &CAPTURE_PHOTOS, Variant::Deep, setup)?;
        for row in &rows {
            let case = format!("{} N={}", name(&folder), row.photos);
            figures.add_maps("captures", case, row.differences.render, row.artifacts);
        }
        if let Some(last) = rows.last() {
            total += last.seconds;
            photos += last.photos;
        }
    }
    add_time(figures, "captures", total, photos);
    Ok(())
}

fn materials(folder: &Path, setup: &Setup, figures: &mut Figures) -> Result<()> {
    if !folder.is_dir() {
        return Err(missing(folder));
    }
    let crops = protocol::crops(&folder.to_owned().into())?;
    let mut total = Seconds::default();
    let most = MATERIAL_PHOTOS.into_iter().max().unwrap_or(0);
    for (index, crop) in crops.iter().enumerate() {
        let mut estimator = setup.estimator(Method::Deep, true);
        for observation in photographs(&crop.truth, most, seed(index), &Conditions::new(0.0)) {
            let (maps, taken) = timed(|| {
                estimator.add(observation)?;
                estimator.settle()
            });
            total += taken;
            let maps = maps?;
            if MATERIAL_PHOTOS.contains(&estimator.photos()) {
                let case = format!("{} N={}", crop.name, estimator.photos());
                figures.add("photos", case, compare(&maps, &crop.truth)?.render);
            }
        }
    }
    add_time(figures, "photos", total, most * crops.len());
    Ok(())
}

/// Captures generated for this run.
fn made(
    data: &Path,
    seed: u64,
    keep: Option<&Path>,
    setup: &Setup,
    figures: &mut Figures,
) -> Result<()> {
    eprintln!("fresh: seed {seed}");
    let own = || std::env::temp_dir().join(format!("svbrdf-fresh-{}", std::process::id()));
    let folder = keep.map_or_else(own, Path::to_owned).join(seed.to_string());
    let result = fresh::captures(data, seed, &folder).and_then(|captures| {
        for (kind, captures) in ["fresh, boards", "fresh, rectified"].into_iter().zip(&captures) {
            predictions(captures, kind, 1, setup, figures)?;
        }
        Ok(())
    });
    if keep.is_none() {
        std::fs::remove_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
    }
    result
}

fn predictions(
    captures: &[PathBuf],
    group: &str,
    orders: usize,
    setup: &Setup,
    figures: &mut Figures,
) -> Result<()> {
    let protocol = heldout::Protocol { fit: FITTED.to_vec(), orders, gain: true };
    for folder in captures {
        let kept = heldout::Kept::default();
        let records = heldout::evaluate(folder, &protocol, Variant::Deep, setup, kept)?;
        for (row, error, artifacts) in heldout::means(&records) {
            figures.add_maps(group, format!("{} {row}", name(folder)), error, artifacts);
        }
    }
    Ok(())
}

fn missing(folder: &Path) -> Error {
    Error::argument("data", format!("{}: no such folder", folder.display()))
}

fn folders(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Err(missing(folder));
    }
    capture_folders(&[folder.to_owned()])
}

fn add_time(figures: &mut Figures, group: &str, total: Seconds, photos: usize) {
    figures.seconds.insert(group.to_owned(), total.processor / photos.max(1) as f64);
}
