//! Textures for Unreal and Unity.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, Splits, number};
use super::convert::MetallicModel;
use super::lobes;
use crate::Result;

fn lost(splits: &Splits) -> Value {
    json!({ "diffuse": number(splits.rms[0]), "specular": number(splits.rms[1]) })
}

/// Roughness and anisotropy of a texel in the convention of Unreal and HDRP.
fn arithmetic(bundle: &Bundle, i: usize) -> [f32; 2] {
    let lobes = bundle.anisotropy.as_ref();
    lobes.map_or([bundle.roughness()[i], 0.0], |lobes| lobes::arithmetic(&lobes[i]))
}

/// Description of that convention.
const ANISOTROPY: &str = "linear; alpha = roughness^2 (1 + anisotropy) along the tangent, roughness^2 (1 - anisotropy) across it";

/// Unreal's default lit model: DirectX normals, occlusion, roughness and metalness in one texture,
/// `Specular` = F0 / 0.08 of the dielectric part.
pub(super) fn unreal(bundle: &Bundle, folder: &str) -> Result<(Files, Value)> {
    let splits = bundle.splits(MetallicModel::UNREAL);
    let texels = &splits.texels;
    let orm = |i: usize| [bundle.occlusion[i], arithmetic(bundle, i)[0], texels[i].metallic];
    let mut textures = vec![
        ("base_color", bundle.colour(|i| texels[i].base)),
        ("normal", bundle.normals(-1.0)),
        ("orm", bundle.data(orm)),
        ("specular", bundle.gray(|i| texels[i].dielectric / 0.08)),
        (HEIGHT, bundle.height_texture()),
    ];
    let mut description = json!({
        "base_color": "sRGB; kd = (1 - m) base",
        "normal": "DirectX: green down",
        "orm": "linear; R occlusion, G roughness, B metallic",
        "specular": "linear; F0 = 0.08 specular (1 - m) + m base",
        "rms_error": lost(&splits),
    });
    if let Some(tangents) = bundle.tangents(-1.0) {
        textures.push(("tangent", tangents));
        textures
            .extend(bundle.of_anisotropy(|l| lobes::arithmetic(l)[1]).map(|t| ("anisotropy", t)));
        description["tangent"] =
            json!("linear, (v + 1) / 2; DirectX: green down; to the input Tangent");
        description["anisotropy"] = json!(ANISOTROPY);
    }
    if let Some(coat) = bundle.coat_texture() {
        textures.push(("clear_coat", coat));
        description["clear_coat"] =
            json!("linear; shading model Clear Coat: R Clear Coat, G Clear Coat Roughness");
    }
    Ok((bundle.encode(folder, &textures)?, description))
}

/// Unity's HDRP Lit shader: metallic workflow with a mask map.
pub(super) fn unity_hdrp(bundle: &Bundle, folder: &str) -> Result<(Files, Value)> {
    let splits = bundle.splits(MetallicModel::LOSSLESS);
    let texels = &splits.texels;
    let mask =
        |i: usize| [texels[i].metallic, bundle.occlusion[i], 1.0, 1.0 - arithmetic(bundle, i)[0]];
    let mut textures = vec![
        ("base_map", bundle.colour(|i| texels[i].base)),
        ("normal_map", bundle.normals(1.0)),
        ("mask_map", bundle.rgba(false, mask)),
        (HEIGHT, bundle.height_texture()),
    ];
    let mut description = json!({
        "base_map": "sRGB; kd = (1 - m) base, F0 = 0.04 (1 - m) + m base",
        "normal_map": "OpenGL: green up",
        "mask_map": "linear; R metallic, G occlusion, B detail mask (1), A smoothness = 1 - roughness",
        "rms_error": lost(&splits),
    });
    if let Some(tangents) = bundle.tangents(1.0) {
        textures.push(("tangent_map", tangents));
        let anisotropy = bundle.of_anisotropy(|lobe| lobes::arithmetic(lobe)[1]);
        textures.extend(anisotropy.map(|texture| ("anisotropy_map", texture)));
        description["tangent_map"] =
            json!("linear, (v + 1) / 2; OpenGL: green up; material type Anisotropy");
        description["anisotropy_map"] = json!(ANISOTROPY);
    }
    if let Some([weight, _]) = bundle.maps.coat() {
        textures.push(("coat_mask_map", bundle.gray(|i| weight[i])));
        description["coat_mask_map"] = json!("linear; weight of a smooth coat");
    }
    Ok((bundle.encode(folder, &textures)?, description))
}

/// Unity's URP Lit shader in its specular set-up.
pub(super) fn unity_urp(bundle: &Bundle, folder: &str) -> Result<(Files, Value)> {
    let roughness = bundle.roughness();
    let specular = |i: usize| {
        let [r, g, b] = bundle.albedos(i).specular;
        [r, g, b, 1.0 - roughness[i]]
    };
    let mut textures = vec![
        ("base_map", bundle.colour(|i| bundle.albedos(i).base_below_coat())),
        ("normal_map", bundle.normals(1.0)),
        ("specular_map", bundle.rgba(true, specular)),
        ("occlusion_map", bundle.gray(|i| bundle.occlusion[i])),
        (HEIGHT, bundle.height_texture()),
    ];
    let mut description = json!({
        "workflow": "Specular; smoothness from the alpha of the specular map",
        "base_map": "sRGB; kd = (1 - max F0) base",
        "normal_map": "OpenGL: green up",
        "specular_map": "RGB F0, sRGB; A smoothness = 1 - roughness, linear",
        "occlusion_map": "linear",
    });
    if let Some(coat) = bundle.of_coat(|[weight, roughness]| [weight, 1.0 - roughness, 0.0]) {
        textures.push(("clear_coat_map", coat));
        description["clear_coat_map"] = json!("linear; Complex Lit: R mask, G smoothness");
    }
    Ok((bundle.encode(folder, &textures)?, description))
}
