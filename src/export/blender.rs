//! A script for Blender 4.0 and later that builds the material's nodes.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, Layered};
use super::lobes;
use super::template::filled;
use crate::Result;

/// Colour space of data.
const LINEAR: &str = "Non-Color";

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
    let mut input = |label, stem, space, texture| inputs.push((label, stem, space, texture));
    if let Some(texture) = anisotropic {
        input("Anisotropic", "anisotropic", LINEAR, texture);
    }
    if let Some(texture) = turns {
        input("Anisotropic Rotation", "anisotropic_rotation", LINEAR, texture);
    }
    if let Some([weight, roughness]) = bundle.maps.coat() {
        input("Coat Weight", "coat_weight", LINEAR, bundle.gray(|i| weight[i]));
        input("Coat Roughness", "coat_roughness", LINEAR, bundle.gray(|i| roughness[i]));
    }
    if let Some([r, g, b, roughness]) = bundle.maps.sheen() {
        let fuzz = |i: usize| lobes::fuzz([r[i], g[i], b[i]], roughness[i]);
        input("Sheen Weight", "sheen_weight", LINEAR, bundle.gray(|i| fuzz(i).weight));
        input("Sheen Roughness", "sheen_roughness", LINEAR, bundle.gray(|i| fuzz(i).roughness));
        input("Sheen Tint", "sheen_tint", "sRGB", bundle.colour(|i| fuzz(i).tint));
    }
    textures.extend(inputs.iter().map(|(_, stem, _, texture)| (*stem, texture.clone())));
    let mut files = bundle.encode(&format!("{folder}textures/"), &textures)?;
    let names: Vec<&str> =
        files.iter().map(|(name, _)| name.strip_prefix(folder).unwrap_or(name)).collect();
    let lines = inputs.iter().zip(&names[5..]);
    let lines = lines.map(|((label, _, space, _), file)| {
        format!("    \"{label}\": (\"{file}\", \"{space}\"),\n")
    });
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
    if bundle.maps.sheen().is_some() {
        description["sheen"] = json!(format!("Sheen Weight, Roughness and Tint: {}", lobes::FUZZ));
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
