//! A script for Blender 4.0 and later that builds the material's nodes.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, Layered};
use super::template::filled;
use crate::Result;

/// The script and its textures below `folder`, and what they hold.
pub(super) fn encode(bundle: &Bundle, layered: &Layered, folder: &str) -> Result<(Files, Value)> {
    let roughness = bundle.roughness();
    let mut textures = vec![
        ("base_color", layered.base.clone()),
        ("normal", bundle.normals(1.0)),
        ("roughness", bundle.gray(|i| roughness[i])),
        (HEIGHT, bundle.height_texture()),
    ];
    match &layered.tint {
        Some(tint) => textures.push(("specular_tint", tint.clone())),
        None => textures.push(("metallic", bundle.gray(|i| layered.orm.value(i, 2)))),
    }
    let mut files = bundle.encode(&format!("{folder}textures/"), &textures)?;
    let names: Vec<&str> =
        files.iter().map(|(name, _)| name.strip_prefix(folder).unwrap_or(name)).collect();
    let script = script(bundle, layered, &names);
    files.insert(0, (format!("{folder}material.py"), script.into_bytes()));
    let description = json!({
        "script": "builds the material and a plane of the sample's size; run it in Blender 4.0 or later",
        "normal": "OpenGL: green up",
        "layers": super::glb::describe(layered),
    });
    Ok((files, description))
}

fn script(bundle: &Bundle, layered: &Layered, names: &[&str]) -> String {
    let [x, y] = bundle.sample_mm.map(|mm| mm / 1000.0);
    let [low, high] = bundle.height.range_mm();
    let middle = if high > low { -low / (high - low) } else { 0.5 };
    let (input, space) =
        if layered.tint.is_some() { ("Specular Tint", "sRGB") } else { ("Metallic", "Non-Color") };
    filled(
        include_str!("blender.py"),
        &[
            ("size", &format!("{x}, {y}")),
            ("ior", &layered.ior.to_string()),
            ("extension", if bundle.tileable { "REPEAT" } else { "EXTEND" }),
            ("range", &((high - low) / 1000.0).to_string()),
            ("middle", &middle.to_string()),
            ("base", names[0]),
            ("normal", names[1]),
            ("roughness", names[2]),
            ("height", names[3]),
            ("input", input),
            ("last", names[4]),
            ("space", space),
        ],
    )
}
