//! `svbrdf render`

use std::f32::consts::PI;
use std::path::PathBuf;

use svbrdf::export::{read_maps, write_exr_image, write_png16_image};
use svbrdf::observation::{Falloff, View};

use crate::failure::{Failure, Result};
use crate::place;

/// Render maps from above under one light, as the fit does
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  svbrdf render maps --camera-mm 0,0,300 --light-mm 80,0,200 --out lit.png"
)]
pub struct Arguments {
    /// Folder with maps.exr or normal, diffuse, specular and roughness images
    maps: PathBuf,
    /// Camera position in mm (x right, y up, z out of the sample)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = position)]
    camera_mm: [f32; 3],
    /// Light position in mm
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = position)]
    light_mm: [f32; 3],
    /// Longer side of the sample in mm
    #[arg(long, default_value_t = 100.0, value_parser = length)]
    sample_mm: f32,
    /// Picture to write: .png (16-bit linear, clipped to [0, 1]) or .exr (floats)
    #[arg(long)]
    out: PathBuf,
}

fn position(text: &str) -> std::result::Result<[f32; 3], String> {
    let expected = "three finite numbers x,y,z with z > 0 expected";
    let numbers: Option<Vec<f32>> =
        text.split(',').map(|v| v.trim().parse().ok().filter(|v: &f32| v.is_finite())).collect();
    let numbers: Option<[f32; 3]> = numbers.and_then(|v| v.try_into().ok());
    numbers.filter(|p| p[2] > 0.0).ok_or_else(|| expected.to_owned())
}

/// A positive length in mm.
pub fn length(text: &str) -> std::result::Result<f32, String> {
    let value = text.parse().ok().filter(|v: &f32| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| "a positive length in mm expected".to_owned())
}

/// Size in mm of a sample whose longer side is given, texels being square.
pub fn sample_size(maps: &svbrdf::Svbrdf, longer_mm: f32) -> [f32; 2] {
    let (w, h) = (maps.width() as f32, maps.height() as f32);
    [longer_mm * w / w.max(h), longer_mm * h / w.max(h)]
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    place::file("--out", &arguments.out)?;
    let extension = arguments.out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let float = match extension.to_ascii_lowercase().as_str() {
        "png" => false,
        "exr" => true,
        _ => {
            let out = arguments.out.display();
            return Err(Failure::Input(format!(
                "--out {out}: a name ending in .png or .exr expected"
            )));
        }
    };
    let maps = read_maps(&arguments.maps).map_err(Failure::input)?;
    let view = View {
        sample_mm: sample_size(&maps, arguments.sample_mm),
        camera_mm: arguments.camera_mm,
        light_mm: arguments.light_mm,
        falloff: Falloff::None { power: [PI; 3] },
        ambient: [0.0; 3],
        mirrored: 1.0,
    };
    let mut rgb = vec![0.0; 3 * maps.texels()];
    svbrdf::render::render(&maps, &view, &mut rgb);
    let (width, height) = (maps.width(), maps.height());
    if float {
        write_exr_image(&arguments.out, width, height, &rgb)?;
    } else {
        write_png16_image(&arguments.out, width, height, &rgb)?;
    }
    Ok(())
}
