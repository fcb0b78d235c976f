//! Compares the stated deviations of the maps with their errors.

mod table;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use svbrdf::assessment::Evidence;
use svbrdf::estimate::Method;
use svbrdf::random::Random;
use svbrdf::{Error, Result, Svbrdf};

use self::table::{Group, MAPS, Table};
use crate::captures::with_truth;
use crate::experiments::seed;
use crate::protocol::{self, Conditions, crops, photographs};
use crate::statistics::median;
use crate::streaming::{Setup, Variant, capture_folders, push};

/// Arguments of `svbrdf-eval uncertainty`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Folders with capture.json and the true maps in truth/, or folders of such
    captures: Vec<PathBuf>,
    /// Folder with a folder per material, photographed twice: without noise, and as captures may be
    #[arg(long)]
    materials: Option<PathBuf>,
    /// Use every nth material only
    #[arg(long, default_value_t = 1)]
    every: usize,
    /// Numbers of photographs
    #[arg(long, value_delimiter = ',', default_value = "1,2,5,8")]
    photos: Vec<usize>,
    /// File for terms and errors of some texels, from which deviations are calibrated
    #[arg(long)]
    record: Option<PathBuf>,
}

/// Approximate number of sampled texels per estimate.
const SAMPLES: usize = 500;
/// Median roughness from which on a material counts as matte.
const MATTE: f64 = 0.45;
/// Destination of the evidence.
struct Judge {
    table: Table,
    record: Option<(PathBuf, BufWriter<File>)>,
    cases: usize,
}

impl Judge {
    /// Compares an estimate with the truth.
    fn add(&mut self, evidence: &Evidence, truth: &Svbrdf, photos: usize) -> Result<()> {
        let uncertainty = evidence.uncertainty()?;
        let (maps, n) = (evidence.maps(), truth.texels());
        let roughness = truth.roughness().iter().map(|v| f64::from(*v));
        let matte = median(roughness).is_some_and(|middle| middle >= MATTE);
        let group = Group { case: self.cases, photos, matte };
        let stride = (n / SAMPLES).max(1) | 1;
        for t in (stride / 2..n).step_by(stride) {
            for (map, (_, range)) in MAPS.into_iter().enumerate() {
                let error = |c: usize| (maps.plane(c)[t] - truth.plane(c)[t]).abs();
                let errors: Vec<f32> = range.map(error).collect();
                let deviation = uncertainty.planes()[map * n + t];
                if let Some((path, file)) = &mut self.record {
                    // Row: case, photographs, map, number of errors, terms, errors.
                    let head = [self.cases, photos, map, errors.len()].map(|v| v as f32);
                    let row = head.into_iter().chain(evidence.terms(map, t));
                    let row = row.chain((0..3).map(|i| errors.get(i).copied().unwrap_or(0.0)));
                    let bytes: Vec<u8> = row.flat_map(f32::to_le_bytes).collect();
                    file.write_all(&bytes).map_err(|e| Error::io(path.clone(), e))?;
                }
                self.table.add(group, map, deviation, &errors);
            }
        }
        Ok(())
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let open = |path: &PathBuf| -> Result<_> {
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        Ok((path.clone(), BufWriter::new(file)))
    };
    let record = arguments.record.as_ref().map(open).transpose()?;
    let mut judge = Judge { table: Table::default(), record, cases: 0 };
    if !arguments.captures.is_empty() {
        for folder in capture_folders(&arguments.captures)? {
            of_capture(&folder, &arguments.photos, setup, &mut judge)?;
        }
    }
    if let Some(folder) = &arguments.materials {
        of_materials(folder, arguments, setup, &mut judge)?;
    }
    judge.table.print(&arguments.photos);
    Ok(())
}

fn of_capture(folder: &Path, photos: &[usize], setup: &Setup, judge: &mut Judge) -> Result<()> {
    let (capture, truth) = with_truth(folder, setup.resolution)?;
    let session = setup.session(&capture, Variant::Deep)?;
    let mut accepted = 0;
    for file in &capture.photos {
        if let Some(reason) = push(&session, file)? {
            eprintln!("{}: {reason}", file.path.display());
            continue;
        }
        accepted += 1;
        session.wait()?;
        if photos.contains(&accepted) {
            judge.add(&session.evidence()?, &truth, accepted)?;
        }
        if photos.iter().all(|&n| n <= accepted) {
            break;
        }
    }
    judge.cases += 1;
    eprintln!("{}", folder.display());
    Ok(())
}

fn of_materials(
    folder: &Path,
    arguments: &Arguments,
    setup: &Setup,
    judge: &mut Judge,
) -> Result<()> {
    let mut of = protocol::Arguments::from(folder.to_owned());
    of.every = arguments.every;
    let most = arguments.photos.iter().copied().max().unwrap_or(1);
    for (index, crop) in crops(&of)?.iter().enumerate() {
        let truth = crop.truth.downsampled();
        let random = Conditions::random(&mut Random::new(77 + index as u64));
        for conditions in [Conditions::new(0.0), random] {
            let mut estimator = setup.estimator(Method::Deep, true);
            let observations = photographs(&truth, most, seed(index), &conditions);
            for (i, observation) in observations.into_iter().enumerate() {
                estimator.add(observation)?;
                let wanted = arguments.photos.contains(&(i + 1));
                // As in a capture, the fit settles before the next photograph.
                if wanted || i < 5 {
                    estimator.settle()?;
                }
                if wanted {
                    judge.add(&estimator.evidence()?, &truth, i + 1)?;
                }
            }
            judge.cases += 1;
        }
        eprintln!("{}", crop.name);
    }
    Ok(())
}
