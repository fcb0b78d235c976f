//! Textures as Unreal and Unity read them.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, Splits, number};
use super::convert::MetallicModel;
use crate::Result;

fn lost(splits: &Splits) -> Value {
    json!({ "diffuse": number(splits.rms[0]), "specular": number(splits.rms[1]) })
}

/// Unreal's default lit model: DirectX normals, occlusion, roughness and metalness in one texture,
/// `Specular` = F0 / 0.08 of the dielectric part.
pub(super) fn unreal(bundle: &Bundle, folder: &str) -> Result<(Files, Value)> {
    let splits = bundle.splits(MetallicModel::UNREAL);
    let (texels, roughness) = (&splits.texels, bundle.roughness());
    let textures = [
        ("base_color", bundle.colour(|i| texels[i].base)),
        ("normal", bundle.normals(-1.0)),
        ("orm", bundle.data(|i| [bundle.occlusion[i], roughness[i], texels[i].metallic])),
        ("specular", bundle.gray(|i| texels[i].dielectric / 0.08)),
        (HEIGHT, bundle.height_texture()),
    ];
    let description = json!({
        "base_color": "sRGB; kd = (1 - m) base",
        "normal": "DirectX: green down",
        "orm": "linear; R occlusion, G roughness, B metallic",
        "specular": "linear; F0 = 0.08 specular (1 - m) + m base",
        "rms_error": lost(&splits),
    });
    Ok((bundle.encode(folder, &textures)?, description))
}

/// Unity's HDRP Lit shader: metallic workflow with a mask map.
pub(super) fn unity_hdrp(bundle: &Bundle, folder: &str) -> Result<(Files, Value)> {
    let splits = bundle.splits(MetallicModel::LOSSLESS);
    let (texels, roughness) = (&splits.texels, bundle.roughness());
    let mask = |i: usize| [texels[i].metallic, bundle.occlusion[i], 1.0, 1.0 - roughness[i]];
    let textures = [
        ("base_map", bundle.colour(|i| texels[i].base)),
        ("normal_map", bundle.normals(1.0)),
        ("mask_map", bundle.rgba(false, mask)),
        (HEIGHT, bundle.height_texture()),
    ];
    let description = json!({
        "base_map": "sRGB; kd = (1 - m) base, F0 = 0.04 (1 - m) + m base",
        "normal_map": "OpenGL: green up",
        "mask_map": "linear; R metallic, G occlusion, B detail mask (1), A smoothness = 1 - roughness",
        "rms_error": lost(&splits),
    });
    Ok((bundle.encode(folder, &textures)?, description))
}

/// Unity's URP Lit shader in its specular set-up.
pub(super) fn unity_urp(bundle: &Bundle, folder: &str) -> Result<(Files, Value)> {
    let roughness = bundle.roughness();
    let specular = |i: usize| {
        let [r, g, b] = bundle.albedos(i).specular;
        [r, g, b, 1.0 - roughness[i]]
    };
    let textures = [
        ("base_map", bundle.colour(|i| bundle.albedos(i).base_below_coat())),
        ("normal_map", bundle.normals(1.0)),
        ("specular_map", bundle.rgba(true, specular)),
        ("occlusion_map", bundle.gray(|i| bundle.occlusion[i])),
        (HEIGHT, bundle.height_texture()),
    ];
    let description = json!({
        "workflow": "Specular; smoothness from the alpha of the specular map",
        "base_map": "sRGB; kd = (1 - max F0) base",
        "normal_map": "OpenGL: green up",
        "specular_map": "RGB F0, sRGB; A smoothness = 1 - roughness, linear",
        "occlusion_map": "linear",
    });
    Ok((bundle.encode(folder, &textures)?, description))
}
