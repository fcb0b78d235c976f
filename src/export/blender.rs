//! A script for Blender 4.0 and later that builds the material's nodes.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, Layered};
use super::lobes;
use super::template::filled;
use crate::Result;

/// The script and its textures below `folder`, and their description.
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
    let mut inputs = Vec::new();
    let [anisotropic, turns] =
        [0, 1].map(|part| bundle.of_anisotropy(|lobe| lobes::cycles(lobe)[part]));
    inputs.extend(anisotropic.map(|texture| ("Anisotropic", "anisotropic", texture)));
    inputs.extend(turns.map(|texture| ("Anisotropic Rotation", "anisotropic_rotation", texture)));
    if let Some([weight, roughness]) = bundle.maps.coat() {
        inputs.push(("Coat Weight", "coat_weight", bundle.gray(|i| weight[i])));
        inputs.push(("Coat Roughness", "coat_roughness", bundle.gray(|i| roughness[i])));
    }
    textures.extend(inputs.iter().map(|(_, stem, texture)| (*stem, texture.clone())));
    let mut files = bundle.encode(&format!("{folder}textures/"), &textures)?;
    let names: Vec<&str> =
        files.iter().map(|(name, _)| name.strip_prefix(folder).unwrap_or(name)).collect();
    let lines = inputs.iter().zip(&names[5..]);
    let lines =
        lines.map(|((label, ..), file)| format!("    \"{label}\": (\"{file}\", \"Non-Color\"),\n"));
    let script = script(bundle, layered, &names, &lines.collect::<String>());
    files.insert(0, (format!("{folder}material.py"), script.into_bytes()));
    let mut description = json!({
        "script": "builds the material and a plane of the sample's size; run it in Blender 4.0 or later",
        "normal": "OpenGL: green up",
        "layers": super::glb::describe(layered),
    });
    if bundle.anisotropy.is_some() {
        description["anisotropy"] = json!(
            "Cycles: ratio of both alphas = 1 / (1 - 0.9 anisotropic), at most 10; rotation in turns from u"
        );
    }
    if bundle.maps.coat().is_some() {
        description["coat"] = json!("Coat Weight and Coat Roughness, Coat IOR 1.5");
    }
    Ok((files, description))
}

fn script(bundle: &Bundle, layered: &Layered, names: &[&str], lobes: &str) -> String {
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
            ("lobes", lobes),
        ],
    )
}
