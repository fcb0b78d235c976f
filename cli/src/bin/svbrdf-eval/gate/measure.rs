//! What the gate measures.

use std::path::Path;

use svbrdf::comparison::compare;
use svbrdf::estimate::Method;
use svbrdf::{Error, Result};

use super::figures::Figures;
use crate::clock::{Seconds, timed};
use crate::experiments::seed;
use crate::protocol::{self, Conditions, photographs};
use crate::streaming::{Setup, Variant, capture_folders, name};
use crate::{captures, heldout};

/// Photographs of captures after which errors count.
const CAPTURE_PHOTOS: [usize; 4] = [1, 2, 4, 8];
/// The same of synthetic photographs of known materials.
const MATERIAL_PHOTOS: [usize; 3] = [1, 2, 5];
/// The same of captures that predict others.
const FITTED: [usize; 5] = [1, 2, 3, 5, 7];
/// Orders of real photographs.
const ORDERS: usize = 4;

/// Figures of the selected groups.
pub fn figures(data: &Path, groups: &[String], setup: &Setup) -> Result<Figures> {
    let setup = Setup { resolution: heldout::SIDE, ..setup.clone() };
    let mut figures = Figures::new(setup.threads);
    for group in groups {
        let (result, taken) = timed(|| match group.as_str() {
            "captures" => known_captures(&data.join("captures/dev"), &setup, &mut figures),
            "photos" => materials(&data.join("materials/validation"), &setup, &mut figures),
            _ => predictions(&data.join("captures").join(group), group, &setup, &mut figures),
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
            figures.add("captures", case, row.differences.render);
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
            if MATERIAL_PHOTOS.contains(&estimator.frames()) {
                let case = format!("{} N={}", crop.name, estimator.frames());
                figures.add("photos", case, compare(&maps, &crop.truth)?.render);
            }
        }
    }
    add_time(figures, "photos", total, most * crops.len());
    Ok(())
}

fn predictions(folder: &Path, group: &str, setup: &Setup, figures: &mut Figures) -> Result<()> {
    let protocol = heldout::Protocol { fit: FITTED.to_vec(), orders: ORDERS, gain: true };
    for folder in folders(folder)? {
        let records = heldout::evaluate(&folder, &protocol, Variant::Deep, setup, None)?;
        for (row, error) in heldout::means(&records) {
            figures.add(group, format!("{} {row}", name(&folder)), error);
        }
    }
    Ok(())
}

fn missing(folder: &Path) -> Error {
    Error::argument("data", format!("{}: no such folder", folder.display()))
}

fn folders(folder: &Path) -> Result<Vec<std::path::PathBuf>> {
    if !folder.is_dir() {
        return Err(missing(folder));
    }
    capture_folders(&[folder.to_owned()])
}

fn add_time(figures: &mut Figures, group: &str, total: Seconds, photos: usize) {
    figures.seconds.insert(group.to_owned(), total.processor / photos.max(1) as f64);
}
