//! What the command line says.

use std::path::PathBuf;

use svbrdf::export::Format;

use crate::progress::Log;

/// Find the maps of a capture, or of photographs
#[derive(clap::Args)]
#[command(after_help = "Examples:
  svbrdf fit photos/*.jpg --out maps
  svbrdf fit photos --out maps --sample-mm 100x80
  svbrdf fit --watch incoming --out maps
  svbrdf fit examples/captures/tile --out maps
  svbrdf fit capture --out maps --resolution 1024 --frames 5
  svbrdf fit capture --out maps --hold-out 2

Photographs without capture.json: exposure, order and camera are read from their metadata, colours
from their ICC profiles; the capture.json they amount to is written beside the maps.

Ctrl-C ends the fit in order: what is there is written, the exit status is 130.")]
pub struct Arguments {
    /// Folder with capture.json; or photographs, files or a folder of them
    #[arg(required = true, value_name = "CAPTURE|PHOTOS")]
    pub capture: Vec<PathBuf>,
    /// Folder to write maps, preview and report into; made if missing
    #[arg(long)]
    pub out: PathBuf,
    /// Take photographs as they arrive in the folder, until Ctrl-C; the maps are written after each
    #[arg(long, conflicts_with_all = ["frames", "at_once", "hold_out"])]
    pub watch: bool,
    /// Width and height of the sample in photographs without capture.json [default: a square that
    /// the board's hole holds with 5 mm to spare: 105x105]
    #[arg(long, value_name = "W[xH]", value_parser = sample_mm)]
    pub sample_mm: Option<[f32; 2]>,
    /// Board in photographs without capture.json, see `svbrdf board` [default: ring]
    #[arg(long)]
    pub board: Option<String>,
    /// Texels along each side: 256, 512, 1024 or 2048
    #[arg(long, default_value = "256", value_parser = ["256", "512", "1024", "2048"])]
    pub resolution: String,
    /// Use the first N photos only
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// Latent code of the network and refinement, or inverse rendering without it
    #[arg(long, default_value = "deep", value_parser = ["deep", "classic"])]
    pub method: String,
    /// Leave out the per-texel refinement
    #[arg(long)]
    pub no_refine: bool,
    /// Steps of the optimisers on each photo, at most: fewer are faster and coarser
    #[arg(long, value_name = "N")]
    pub steps: Option<u32>,
    /// Take all photos in before the fit begins: faster, a little coarser
    #[arg(long)]
    pub at_once: bool,
    /// Predict the last K photos that can be used instead of fitting them: the error of that says how
    /// good the maps are
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub hold_out: u32,
    /// Do nothing if the folder already holds everything of a fit with this resolution and method
    #[arg(long, conflicts_with = "watch")]
    pub skip_existing: bool,
    /// Leave out report.html
    #[arg(long)]
    pub no_report: bool,
    /// Threads; 0: one per core, at most 4
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Camera to use instead of the capture's (JSON, as `camera` in capture.json)
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Also export the maps, see `svbrdf export`: glb, usdz, materialx, unreal, unity-hdrp, unity-urp, blender
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', value_parser = crate::export::format)]
    pub export: Vec<Format>,
    /// No progress
    #[arg(long)]
    pub quiet: bool,
    /// Lines for people on standard error, or JSON objects for programs on standard output
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
