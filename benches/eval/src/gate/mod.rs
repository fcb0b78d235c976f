//! Compares the figures of this build with those of an earlier build, to detect losses of accuracy or speed.

mod figures;
mod fresh;
mod made;
mod measure;
mod summary;

use std::path::PathBuf;

use svbrdf::export::write_atomic;
use svbrdf::{Error, Result};

use self::figures::Figures;
use crate::clock::timed;
use crate::streaming::Setup;

/// Environment variable with the default folder of the test data.
const DATA_VARIABLE: &str = "SVBRDF_TEST_DATA";

/// Arguments of `svbrdf-eval gate`.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub struct Arguments {
    /// Test data: captures/dev, captures/real, captures/faults,
    /// captures/lobes, materials [default:
    /// $SVBRDF_TEST_DATA]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Figures to compare with
    #[arg(long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// File for the figures
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Groups to measure
    #[arg(long, value_delimiter = ',', default_value = "captures,photos,real,faults,lobes",
        value_parser = ["captures", "photos", "real", "faults", "lobes", "fresh"])]
    groups: Vec<String>,
    /// Seeds of the captures of the group fresh [default: the day]
    #[arg(long, value_name = "SEED", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// Folder that keeps the captures of the group fresh; those already there are used as they are
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Do not fail where only time is worse, e.g. beside other work
    #[arg(long)]
    ignore_time: bool,
}

const HELP: &str = "captures: rendering errors of captures/dev after 1 to 8 photographs. photos: \
rendering errors of the middle crop of every material of materials/validation after 1, 2 and 5 \
synthetic photographs. real: held-out errors of captures/real, four orders, 1 to 7 photographs; \
faults and lobes: of captures/faults and captures/lobes, the same numbers. fresh: of twenty-four \
captures for each seed, made for the run with faults, lobes that maps cannot hold among them: \
twelve of a board, twelve rectified; two thirds of materials that no network has seen, the others \
generated, of even gloss and little relief; two photographs without faults are predicted. A change \
of the estimator counts by fresh with three seeds, and by real and faults. Artifacts are as \
`svbrdf-eval artifacts` has them; their limits are 1 degree, 3 degrees for parts, 0.06 of log F0, \
0.02 of roughness. Time is the processor's, seconds per photograph from reading it to the end of its \
fit.\n\nExit status 1 where the geometric mean of a group is worse than the baseline's by more than \
1 %, the mean of an artifact or the time by more than 5 %, or a case of the baseline is missing.";

/// Runs the command; returns whether nothing exceeds the baseline's limits.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<bool> {
    let data = match &arguments.data {
        Some(data) => data.clone(),
        None => std::env::var_os(DATA_VARIABLE).map(PathBuf::from).ok_or_else(|| {
            Error::argument("data", format!("neither --data nor {DATA_VARIABLE} given"))
        })?,
    };
    let baseline = arguments.baseline.as_deref().map(Figures::read).transpose()?;
    let seeds = match &arguments.seeds[..] {
        [] => vec![fresh::seed_of_today()],
        seeds => seeds.to_vec(),
    };
    let (figures, taken) = timed(|| {
        let fresh = measure::Fresh { seeds: &seeds, keep: arguments.keep.as_deref() };
        measure::figures(&data, &arguments.groups, &fresh, setup)
    });
    let figures = figures?;
    if let Some(path) = &arguments.write {
        write_atomic(path, figures.to_json().as_bytes())?;
    }
    let verdict = figures.compare(baseline.as_ref(), &arguments.groups);
    println!("{}", verdict.table);
    println!("{}", summary::table(&figures, baseline.as_ref()));
    println!("{:.0} s, {:.0} s of processor time", taken.wall, taken.processor);
    let mut worse = verdict.worse;
    if !arguments.ignore_time {
        worse.extend(verdict.slower);
    }
    for complaint in &worse {
        println!("worse: {complaint}");
    }
    if let Some(path) = &arguments.baseline {
        let result = if worse.is_empty() { "passed" } else { "failed" };
        println!("gate {result}, compared with {}", path.display());
    }
    Ok(worse.is_empty())
}
