//! `svbrdf export`

use std::path::{Path, PathBuf};

use serde_json::Value;
use svbrdf::export::{ExportOptions, Format, TextureFormat, export, read_maps, read_sample_mm};
use svbrdf::{Error, Svbrdf};

use crate::failure::{Failure, Result};
use crate::place;
use crate::render::{length, sample_size};
use crate::terminal;

/// Export maps to glTF, USD, MaterialX, Unreal, Unity and Blender
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  svbrdf export maps --format glb --out material\n  svbrdf export maps --format unreal,blender --tile --texture png16 --out material"
)]
pub struct Arguments {
    /// Folder with maps.exr or normal, diffuse, specular and roughness pictures
    maps: PathBuf,
    /// Formats, separated by commas
    #[arg(long, required = true, value_delimiter = ',', value_parser = format)]
    format: Vec<Format>,
    /// Folder for the files; created if missing
    #[arg(long)]
    out: PathBuf,
    /// For GLB, MaterialX and Blender: use base colour and metalness instead of a specular colour
    #[arg(long)]
    metallic: bool,
    /// Make the maps seamless
    #[arg(long)]
    tile: bool,
    /// File format of the textures
    #[arg(long, default_value = "png8", value_parser = ["png8", "png16", "jpeg"])]
    texture: String,
    /// Largest side of the textures, texels
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..))]
    max_size: Option<u32>,
    /// Longer side of the sample in mm [default: as the maps state, otherwise 100]
    #[arg(long, value_parser = length)]
    sample_mm: Option<f32>,
}

/// One of the names of formats.
pub fn format(name: &str) -> std::result::Result<Format, String> {
    let names = Format::ALL.map(Format::name).join(", ");
    Format::from_name(name).ok_or_else(|| format!("one of {names} expected"))
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let dir = &arguments.maps;
    place::folder("--out", &arguments.out)?;
    let maps = read_maps(dir).map_err(Failure::input)?;
    let options = ExportOptions {
        formats: arguments.format.clone(),
        sample_mm: sample_mm(dir, &maps, arguments.sample_mm)?,
        metallic: arguments.metallic,
        tile: arguments.tile,
        texture: TextureFormat::from_name(&arguments.texture).expect("one of three names"),
        max_size: arguments.max_size.map(|texels| texels as usize),
        photographs: photographs(dir),
    };
    let package = export(&maps, &options).map_err(|fault| match fault {
        // The maps come from a file, so the message names it.
        Error::Argument { argument, message } => {
            Failure::Input(format!("{}: field `{argument}`: {message}", dir.display()))
        }
        other => other.into(),
    })?;
    package.remarks.iter().for_each(terminal::say);
    Ok(package.write(&arguments.out)?)
}

/// Size of the sample: as given, as the maps' files state, or a guess that is reported.
fn sample_mm(dir: &Path, maps: &Svbrdf, longer: Option<f32>) -> Result<[f32; 2]> {
    if let Some(longer) = longer {
        return Ok(sample_size(maps, longer));
    }
    if let Some(stated) = read_sample_mm(dir).map_err(Failure::input)? {
        return Ok(stated);
    }
    terminal::say(format!(
        "{}: the maps do not state their size; 100 mm taken (--sample-mm)",
        dir.display()
    ));
    Ok(sample_size(maps, 100.0))
}

/// Photographs that the fit beside the maps has accepted.
fn photographs(dir: &Path) -> Option<u32> {
    let text = std::fs::read_to_string(dir.join("report.json")).ok()?;
    let report: Value = serde_json::from_str(&text).ok()?;
    let frames = report["frames"].as_array()?;
    let accepted = frames.iter().filter(|frame| frame["status"] == "accepted").count();
    u32::try_from(accepted).ok()
}
