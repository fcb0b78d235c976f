//! USDZ: a stored zip archive with a text layer and textures, for AR Quick Look and others.
//!
//! The material is a `UsdPreviewSurface` with metalness, because Quick Look ignores the specular workflow, and
//! an OpenPBR network for programs that read MaterialX.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, number};
use super::convert::MetallicModel;
use super::openpbr::OpenPbr;
use super::template::filled;
use crate::Result;

/// Encodes the file; also returns its description.
pub(super) fn encode(bundle: &Bundle) -> Result<(Vec<u8>, Value)> {
    let splits = bundle.splits(MetallicModel::LOSSLESS);
    let roughness = bundle.roughness();
    let mut textures = vec![
        ("base_color", bundle.colour(|i| splits.texels[i].base)),
        ("normal", bundle.normals(1.0)),
        ("orm", bundle.data(|i| [bundle.occlusion[i], roughness[i], splits.texels[i].metallic])),
    ];
    textures.extend(bundle.coat_texture().map(|texture| ("coat", texture)));
    let open = OpenPbr::new(bundle, &bundle.layered());
    let preview = textures.len();
    let mut images = bundle.encode("textures/", &textures)?;
    let textures: Vec<_> =
        open.images.iter().map(|(name, _, texture)| (*name, texture.clone())).collect();
    images.extend(bundle.encode("textures/open_pbr/", &textures)?);
    let names: Vec<&str> = images.iter().map(|(name, _)| name.as_str()).collect();
    let layer = layer(bundle, names.split_at(preview), &open);
    let mut files: Files = vec![("material.usda".into(), layer.into_bytes())];
    files.extend(images);
    let [diffuse, specular] = splits.rms;
    let mut description = json!({
        "workflow": "UsdPreviewSurface, metallic: kd = (1 - m) base, F0 = 0.04 (1 - m) + m base; \
                     least squares",
        "rms_error": { "diffuse": number(diffuse), "specular": number(specular) },
        "mtlx": "OpenPBR, as the export materialx has it",
    });
    if bundle.maps.coat().is_some() {
        description["coat"] = json!("clearcoat; R weight, G roughness");
    }
    Ok((archive(&files), description))
}

/// The inputs of a coat, and its texture.
const COAT_INPUTS: &str = r#"                float inputs:clearcoat.connect = </Sample/Looks/Surface/Coat.outputs:r>
                float inputs:clearcoatRoughness.connect = </Sample/Looks/Surface/Coat.outputs:g>
"#;
const COAT_TEXTURE: &str = r#"
            def Shader "Coat"
            {
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @{{coat}}@
                token inputs:sourceColorSpace = "raw"
                float2 inputs:st.connect = </Sample/Looks/Surface/Coordinates.outputs:result>
                token inputs:wrapS = "{{wrap}}"
                token inputs:wrapT = "{{wrap}}"
                float outputs:r
                float outputs:g
            }
"#;

/// The scene. Images have the bottom row at t = 0.
fn layer(bundle: &Bundle, (names, open_names): (&[&str], &[&str]), open: &OpenPbr) -> String {
    let [x, y] = bundle.sample_mm.map(|mm| (mm / 2000.0).to_string());
    let wrap = if bundle.tileable { "repeat" } else { "clamp" };
    let address = if bundle.tileable { "periodic" } else { "clamp" };
    let coat = names.get(3).map(|coat| filled(COAT_TEXTURE, &[("coat", coat), ("wrap", wrap)]));
    filled(
        include_str!("scene.usda"),
        &[
            ("x", &x),
            ("y", &y),
            ("wrap", wrap),
            ("base", names[0]),
            ("normal", names[1]),
            ("orm", names[2]),
            ("coat_inputs", if coat.is_some() { COAT_INPUTS } else { "" }),
            ("coat_texture", coat.as_deref().unwrap_or_default()),
            ("open_pbr", &open.nodes(open_names, names[1], address)),
        ],
    )
}

/// Alignment of each file's data, for memory mapping.
const ALIGNMENT: usize = 64;

/// A zip archive of stored files, by the USDZ specification.
fn archive(files: &Files) -> Vec<u8> {
    const LOCAL_HEADER: usize = 30;
    const EXTRA_HEADER: usize = 4;
    let mut out = Vec::new();
    let mut directory = Vec::new();
    for (name, bytes) in files {
        let offset = out.len();
        let data = offset + LOCAL_HEADER + name.len();
        let mut padding = data.next_multiple_of(ALIGNMENT) - data;
        if (1..EXTRA_HEADER).contains(&padding) {
            padding += ALIGNMENT;
        }
        let common = entry(name, bytes, padding);
        out.extend_from_slice(b"PK\x03\x04");
        out.extend_from_slice(&common);
        out.extend_from_slice(name.as_bytes());
        if padding > 0 {
            // An extra field of the kind that USD's writer uses for padding.
            out.extend_from_slice(&0x1986u16.to_le_bytes());
            out.extend_from_slice(&((padding - EXTRA_HEADER) as u16).to_le_bytes());
            out.resize(out.len() + padding - EXTRA_HEADER, 0);
        }
        out.extend_from_slice(bytes);

        directory.extend_from_slice(b"PK\x01\x02");
        directory.extend_from_slice(&10u16.to_le_bytes()); // made by version 1.0
        directory.extend_from_slice(&entry(name, bytes, 0));
        directory.extend_from_slice(&[0; 10]); // comment, disk, attributes
        directory.extend_from_slice(&(offset as u32).to_le_bytes());
        directory.extend_from_slice(name.as_bytes());
    }
    let start = out.len();
    let count = (files.len() as u16).to_le_bytes();
    out.extend_from_slice(&directory);
    out.extend_from_slice(b"PK\x05\x06");
    out.extend_from_slice(&[0; 4]);
    out.extend_from_slice(&count);
    out.extend_from_slice(&count);
    out.extend_from_slice(&(directory.len() as u32).to_le_bytes());
    out.extend_from_slice(&(start as u32).to_le_bytes());
    out.extend_from_slice(&[0; 2]);
    out
}

/// Common part of local headers and directory: version needed to length of the extra field.
fn entry(name: &str, bytes: &[u8], extra: usize) -> Vec<u8> {
    /// 1980-01-01, the earliest date of zip, so that equal maps give equal bytes.
    const DATE: u16 = 0x21;
    let size = (bytes.len() as u32).to_le_bytes();
    let mut out = Vec::with_capacity(26);
    for number in [10, 0, 0, 0, DATE] {
        out.extend_from_slice(&u16::to_le_bytes(number));
    }
    out.extend_from_slice(&crc32fast::hash(bytes).to_le_bytes());
    out.extend_from_slice(&size);
    out.extend_from_slice(&size);
    out.extend_from_slice(&(name.len() as u16).to_le_bytes());
    out.extend_from_slice(&(extra as u16).to_le_bytes());
    out
}
