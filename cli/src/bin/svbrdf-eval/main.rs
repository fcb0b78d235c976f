//! Evaluation on known materials: the tables and figures of Gao et al. 2019, one command each.

mod experiments;
mod protocol;
mod report;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Parser, Subcommand};
use svbrdf::initial_estimate::Networks;

/// Errors of the maps and of 100 novel renderings after synthetic photographs of known materials
///
/// Photographs follow the paper: the first from above, the others from random places, light at the
/// camera, no fall-off. Tables are Markdown: root-mean-square errors, averaged over the crops, and
/// the mean square of the renderings (the paper's measure).
#[derive(Parser)]
#[command(name = "svbrdf-eval", version)]
struct Arguments {
    #[command(subcommand)]
    table: Table,
    /// Folder with a folder per material: normal, diffuse, specular, roughness
    #[arg(global = true, default_value = "materials")]
    materials: PathBuf,
    /// Crops of 256x256 texels of each material
    #[arg(long, global = true, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=4))]
    crops: u8,
    /// Use the materials whose names contain this only
    #[arg(long, global = true)]
    only: Option<String>,
    /// Use every nth material only
    #[arg(long, global = true, default_value_t = 1)]
    every: usize,
    /// Networks to use instead of the embedded ones
    #[arg(long, global = true)]
    models: Option<PathBuf>,
    /// Standard deviation of multiplicative noise
    #[arg(long, global = true, default_value_t = 0.0)]
    noise: f32,
    /// Threads; 0: one per core
    #[arg(long, global = true, default_value_t = 0)]
    threads: usize,
    /// A line per crop
    #[arg(long, global = true)]
    verbose: bool,
}

#[derive(Subcommand)]
enum Table {
    /// Table 1: errors after several numbers of photographs, deep, without refinement, classic
    Photos {
        /// Numbers of photographs
        #[arg(long, value_delimiter = ',', default_value = "1,2,5,20")]
        photos: Vec<usize>,
        /// Leave out the baseline
        #[arg(long)]
        no_classic: bool,
    },
    /// Table 2: wrong light directions, ambient light
    Disturbances {
        /// Number of photographs
        #[arg(long, default_value_t = 20)]
        photos: usize,
    },
    /// Figure 14: saturated pixels, under-exposure
    Exposure {
        /// Number of photographs
        #[arg(long, default_value_t = 5)]
        photos: usize,
    },
    /// Figures 16 and 17: a first photograph from 45 degrees, a bad start, the encoded truth
    Start {
        /// Numbers of photographs
        #[arg(long, value_delimiter = ',', default_value = "1,2,5")]
        photos: Vec<usize>,
    },
    /// Records of fits, from which the completion network learns (`training/`)
    Fits {
        /// Numbers of photographs after which to record
        #[arg(long, value_delimiter = ',', default_value = "2,3,5,8,12")]
        photos: Vec<usize>,
        /// Folder to write; records that it has are left
        #[arg(long)]
        out: PathBuf,
        /// Chooses cameras and noise
        #[arg(long, default_value_t = 0)]
        seed: u64,
    },
    /// Error and time by the size of the maps, of whole materials
    Resolution {
        /// Texels a side
        #[arg(long, value_delimiter = ',', default_value = "256,512,1024,2048")]
        sides: Vec<usize>,
        /// Number of photographs
        #[arg(long, default_value_t = 5)]
        photos: usize,
    },
}

fn run(arguments: &Arguments) -> svbrdf::Result<()> {
    let networks = Arc::new(match &arguments.models {
        Some(folder) => Networks::from_folder(folder)?,
        None => Networks::embedded()?,
    });
    let crops = || protocol::crops(arguments);
    match &arguments.table {
        Table::Photos { photos, no_classic } => {
            experiments::photos(arguments, &networks, &crops()?, photos, !no_classic)
        }
        Table::Disturbances { photos } => {
            experiments::disturbances(arguments, &networks, &crops()?, *photos)
        }
        Table::Exposure { photos } => {
            experiments::exposure(arguments, &networks, &crops()?, *photos)
        }
        Table::Start { photos } => experiments::start(arguments, &networks, &crops()?, photos),
        Table::Fits { photos, out, seed } => {
            experiments::fits(&networks, &crops()?, photos, out, *seed)
        }
        Table::Resolution { sides, photos } => {
            experiments::resolution(arguments, &networks, sides, *photos)
        }
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build_global();
    if let Err(error) = pool {
        eprintln!("error: {error}");
        return ExitCode::FAILURE;
    }
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
