//! `svbrdf compare`

use std::path::PathBuf;

use serde_json::json;
use svbrdf::comparison;
use svbrdf::export::{read_maps, resized};

use crate::failure::{Failure, Result};
use crate::terminal;

/// Compare two sets of maps: root-mean-square differences of the maps and of 100 renderings, mean angle
/// of the normals (degrees), mean colour difference of the albedos (CIEDE2000), and of the lobes that both have
#[derive(clap::Args)]
#[command(after_help = "Example:\n  svbrdf compare maps truth --json")]
pub struct Arguments {
    /// Folder of maps
    a: PathBuf,
    /// Folder of maps; if the sizes differ, those of A are resampled
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let a = read_maps(&arguments.a).map_err(Failure::input)?;
    let b = read_maps(&arguments.b).map_err(Failure::input)?;
    let a = resized(&a, b.width(), b.height());
    let d = comparison::compare(&a, &b)?;
    let mut results = vec![
        ("normal", d.normal),
        ("diffuse", d.diffuse),
        ("specular", d.specular),
        ("roughness", d.roughness),
        ("render", d.render),
        ("normal_deg", d.normal_deg),
        ("diffuse_delta_e00", d.diffuse_delta_e),
        ("specular_delta_e00", d.specular_delta_e),
    ];
    let lobes = [
        ("anisotropy", d.anisotropy),
        ("coat", d.coat),
        ("coat_roughness", d.coat_roughness),
        ("sheen", d.sheen),
        ("sheen_roughness", d.sheen_roughness),
    ];
    results.extend(lobes.into_iter().filter_map(|(name, value)| Some((name, value?))));
    if arguments.json {
        let object: serde_json::Map<_, _> =
            results.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
        terminal::print(&format!("{}\n", serde_json::Value::Object(object)))
    } else {
        let lines = results.iter().map(|(name, value)| format!("{name:<18} {value:.6}\n"));
        terminal::print(&lines.collect::<String>())
    }
}
