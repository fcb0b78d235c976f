//! The arguments of `fit`.

use std::path::PathBuf;

use svbrdf::export::Format;

use crate::progress::Log;

/// Make maps from photographs, or from a folder with capture.json
#[derive(clap::Args)]
#[command(after_help = "Examples:
  svbrdf fit photos/*.jpg --out maps
  svbrdf fit photos --out maps --sample-mm 100x80
  svbrdf fit --watch incoming --out maps
  svbrdf fit examples/captures/tile --out maps
  svbrdf fit capture --out maps --resolution 1024 --frames 5
  svbrdf fit capture --out maps --hold-out 2

Without capture.json, exposure, order and camera are read from the metadata of the photographs, and
colours from their ICC profiles. The resulting capture.json is written beside the maps.

Ctrl-C, SIGTERM or a closed terminal end the fit: the current maps are written, and the exit status is 130.")]
pub struct Arguments {
    /// Folder with capture.json, or photographs: files, or a folder of them
    #[arg(required = true, value_name = "CAPTURE|PHOTOS")]
    pub capture: Vec<PathBuf>,
    /// Folder for maps, preview and report; created if missing
    #[arg(long)]
    pub out: PathBuf,
    /// Read photographs as they arrive in the folder, until Ctrl-C; write the maps after each
    #[arg(long, conflicts_with_all = ["frames", "at_once", "hold_out"])]
    pub watch: bool,
    /// Without capture.json: width and height of the sample [default: a square that fits the board's
    /// hole with 5 mm to spare: 105x105]
    #[arg(long, value_name = "W[xH]", value_parser = sample_mm)]
    pub sample_mm: Option<[f32; 2]>,
    /// Without capture.json: the board, as for `svbrdf board` [default: ring]
    #[arg(long)]
    pub board: Option<String>,
    /// Texels along each side of the maps
    #[arg(long, default_value = "256", value_parser = ["256", "512", "1024", "2048"])]
    pub resolution: String,
    /// Use only the first N photographs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// deep: networks and refinement; classic: inverse rendering without networks, a baseline
    #[arg(long, default_value = "deep", value_parser = ["deep", "classic"])]
    pub method: String,
    /// Skip the per-texel refinement
    #[arg(long)]
    pub no_refine: bool,
    /// Largest number of optimiser steps for each photograph; fewer are faster and less accurate
    #[arg(long, value_name = "N")]
    pub steps: Option<u32>,
    /// Take in all photographs before the fit begins: faster, slightly less accurate
    #[arg(long)]
    pub at_once: bool,
    /// Hold out the last K usable photographs and predict them from the maps: their error says how good
    /// the maps are
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub hold_out: u32,
    /// Do nothing if the folder already contains a complete fit with this resolution and method
    #[arg(long, conflicts_with = "watch")]
    pub skip_existing: bool,
    /// Do not write report.html
    #[arg(long)]
    pub no_report: bool,
    /// Number of threads, at most 64; 0: one per core, at most 4
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=64))]
    pub threads: u32,
    /// Camera to use instead of that of the capture (JSON, as `camera` in capture.json)
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Also export the maps, as `svbrdf export` does: glb, usdz, materialx, unreal, unity-hdrp, unity-urp, blender
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', value_parser = crate::export::format)]
    pub export: Vec<Format>,
    /// Do not show progress
    #[arg(long)]
    pub quiet: bool,
    /// Form of the messages
    #[arg(long, value_enum, default_value = "text")]
    pub log: Log,
}

/// Width and height, or one number for both.
fn sample_mm(text: &str) -> std::result::Result<[f32; 2], String> {
    let (width, height) = text.split_once(['x', 'X']).unwrap_or((text, text));
    let length = |text: &str| text.parse::<f32>().ok().filter(|mm| (1.0..=1e4).contains(mm));
    length(width)
        .zip(length(height))
        .map(|(width, height)| [width, height])
        .ok_or_else(|| "expected mm such as 100 or 100x80, from 1 to 10000".into())
}
