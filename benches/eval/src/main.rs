//! Evaluation: prediction of held-out photographs, known materials (the tables and figures of Gao
//! et al. 2019), and a gate against losses of accuracy and speed.

mod ablations;
mod artifacts;
mod captures;
mod clock;
mod experiments;
mod fits;
mod gate;
mod hashes;
mod heldout;
mod next_view;
mod overrides;
mod protocol;
mod report;
mod statistics;
mod streaming;
mod uncertainty;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Parser, Subcommand};
use svbrdf::estimate::EstimateOptions;
use svbrdf::networks::Networks;
use svbrdf::{Error, Result};

use crate::streaming::Setup;

/// Measure errors of estimated maps, on captures, real photographs and known materials
///
/// Rendered photographs of known materials follow the paper: the first from above, the others from
/// random positions, light at the camera, no fall-off. The tables are Markdown. They give
/// root-mean-square errors of the maps and of 100 new renderings, averaged over the crops, and the
/// mean square of the renderings (the paper's measure).
#[derive(Parser)]
#[command(name = "svbrdf-eval", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Networks to use instead of the embedded ones
    #[arg(long, global = true)]
    models: Option<PathBuf>,
    /// Threads; 0: one per core, at most 4 for each session. `hashes` takes a list
    #[arg(long, global = true, value_delimiter = ',', default_value = "0")]
    threads: Vec<usize>,
    #[command(flatten)]
    overrides: overrides::Overrides,
}

#[derive(Subcommand)]
enum Command {
    /// Errors of the maps of captures whose true maps are known
    Captures(captures::Arguments),
    /// Tilt of maps and highlights baked into their gloss
    Artifacts(artifacts::Arguments),
    /// Errors of photographs that were not fitted, predicted from those that were
    Heldout(heldout::Arguments),
    /// Errors of photographs that were not fitted, without one part of the estimator after the other
    Ablations(ablations::Arguments),
    /// Whether the stated deviations of the maps match their errors
    Uncertainty(uncertainty::Arguments),
    /// Errors with photographs from suggested views, from a circle, and from random positions
    NextView(next_view::Arguments),
    /// Compare errors and time with those of an earlier build
    Gate(gate::Arguments),
    /// Hashes of the maps, to show that a change leaves the results unchanged
    Hashes(hashes::Arguments),
    /// Table 1: errors after several numbers of photographs, deep, without refinement, classic
    Photos {
        #[command(flatten)]
        materials: protocol::Arguments,
        /// Numbers of photographs
        #[arg(long, value_delimiter = ',', default_value = "1,2,5,20")]
        photos: Vec<usize>,
        /// Skip the baseline
        #[arg(long)]
        no_classic: bool,
    },
    /// Table 2: wrong light directions, ambient light
    Disturbances {
        #[command(flatten)]
        materials: protocol::Arguments,
        /// Number of photographs
        #[arg(long, default_value_t = 20)]
        photos: usize,
    },
    /// Figure 14: saturated pixels, under-exposure
    Exposure {
        #[command(flatten)]
        materials: protocol::Arguments,
        /// Number of photographs
        #[arg(long, default_value_t = 5)]
        photos: usize,
    },
    /// Figures 16 and 17: a first photograph from 45 degrees, a bad start, the encoded truth
    Start {
        #[command(flatten)]
        materials: protocol::Arguments,
        /// Numbers of photographs
        #[arg(long, value_delimiter = ',', default_value = "1,2,5")]
        photos: Vec<usize>,
    },
    /// Write records of fits, to train the completion network (`training/`)
    Fits(fits::Arguments),
    /// Errors and times by resolution, of uncropped materials
    Resolution {
        #[command(flatten)]
        materials: protocol::Arguments,
        /// Texels a side
        #[arg(long, value_delimiter = ',', default_value = "256,512,1024,2048")]
        sides: Vec<usize>,
        /// Number of photographs
        #[arg(long, default_value_t = 5)]
        photos: usize,
    },
}

/// Default texels per side of the maps.
const RESOLUTION: usize = 256;

/// Runs a command; returns whether it found no fault.
fn run(arguments: &Arguments) -> Result<bool> {
    let networks = Arc::new(match &arguments.models {
        Some(folder) => Networks::from_folder(folder)?,
        None => Networks::embedded()?,
    });
    let options = arguments.overrides.apply(&EstimateOptions::default())?;
    let setup = |threads| {
        let (networks, options) = (networks.clone(), options.clone());
        Setup { networks, options, threads, resolution: RESOLUTION }
    };
    if let Command::Hashes(of) = &arguments.command {
        hashes::run(of, &setup(0), &arguments.threads)?;
        return Ok(true);
    }
    let &[threads] = &arguments.threads[..] else {
        return Err(Error::argument("threads", "one number expected"));
    };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Error::Internal(format!("no threads: {e}")))?;
    let setup = setup(threads);
    match &arguments.command {
        Command::Artifacts(of) => artifacts::run(of)?,
        Command::Captures(of) => captures::run(of, &setup)?,
        Command::Heldout(of) => heldout::run(of, &setup)?,
        Command::Ablations(of) => ablations::run(of, &setup)?,
        Command::Uncertainty(of) => uncertainty::run(of, &setup)?,
        Command::NextView(of) => next_view::run(of, &setup)?,
        Command::Fits(of) => fits::run(of, &setup)?,
        Command::Gate(of) => return gate::run(of, &setup),
        tables => print_table(tables, &setup)?,
    }
    Ok(true)
}

/// Runs a command that photographs known materials.
fn print_table(command: &Command, setup: &Setup) -> Result<()> {
    let crops = protocol::crops;
    match command {
        Command::Photos { materials: of, photos, no_classic } => {
            experiments::photos(of, setup, &crops(of)?, photos, !no_classic)
        }
        Command::Disturbances { materials: of, photos } => {
            experiments::disturbances(of, setup, &crops(of)?, *photos)
        }
        Command::Exposure { materials: of, photos } => {
            experiments::exposure(of, setup, &crops(of)?, *photos)
        }
        Command::Start { materials: of, photos } => {
            experiments::start(of, setup, &crops(of)?, photos)
        }
        Command::Resolution { materials: of, sides, photos } => {
            experiments::resolution(of, setup, sides, *photos)
        }
        Command::Artifacts(_)
        | Command::Captures(_)
        | Command::Heldout(_)
        | Command::Ablations(_)
        | Command::Uncertainty(_)
        | Command::NextView(_)
        | Command::Fits(_)
        | Command::Gate(_)
        | Command::Hashes(_) => Ok(()),
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
