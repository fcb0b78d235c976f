//! USDZ: a stored zip archive with a text layer and textures, for AR Quick Look and others.
//!
//! The material is a `UsdPreviewSurface` with metalness: Quick Look ignores the specular workflow.

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, number};
use super::convert::MetallicModel;
use crate::Result;

/// The bytes of a file, and what it holds.
pub(super) fn encode(bundle: &Bundle) -> Result<(Vec<u8>, Value)> {
    let splits = bundle.splits(MetallicModel::LOSSLESS);
    let roughness = bundle.roughness();
    let textures = [
        ("base_color", bundle.colour(|i| splits.texels[i].base)),
        ("normal", bundle.normals(1.0)),
        ("orm", bundle.data(|i| [bundle.occlusion[i], roughness[i], splits.texels[i].metallic])),
    ];
    let images = bundle.encode("textures/", &textures)?;
    let names: Vec<&str> = images.iter().map(|(name, _)| name.as_str()).collect();
    let mut files: Files = vec![("material.usda".into(), layer(bundle, &names).into_bytes())];
    files.extend(images);
    let [diffuse, specular] = splits.rms;
    let description = json!({
        "workflow": "UsdPreviewSurface, metallic: kd = (1 - m) base, F0 = 0.04 (1 - m) + m base; \
                     least squares",
        "rms_error": { "diffuse": number(diffuse), "specular": number(specular) },
    });
    Ok((archive(&files), description))
}

/// The scene. Images have the bottom row at t = 0.
fn layer(bundle: &Bundle, names: &[&str]) -> String {
    let [x, y] = bundle.sample_mm.map(|mm| mm / 2000.0);
    let wrap = if bundle.tileable { "repeat" } else { "clamp" };
    let [base, normal, orm] = [names[0], names[1], names[2]];
    let texture = |name: &str, file: &str, space: &str, more: &str| {
        format!(
            r#"
            def Shader "{name}"
            {{
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @{file}@
                token inputs:sourceColorSpace = "{space}"
                float2 inputs:st.connect = </Sample/Looks/Surface/Coordinates.outputs:result>
                token inputs:wrapS = "{wrap}"
                token inputs:wrapT = "{wrap}"
{more}            }}
"#
        )
    };
    let normals = "                float4 inputs:scale = (2, 2, 2, 1)
                float4 inputs:bias = (-1, -1, -1, 0)
                float3 outputs:rgb
";
    let textures = [
        texture("BaseColor", base, "sRGB", "                float3 outputs:rgb\n"),
        texture("Normal", normal, "raw", normals),
        texture(
            "OcclusionRoughnessMetallic",
            orm,
            "raw",
            "                float outputs:r\n                float outputs:g\n                float outputs:b\n",
        ),
    ]
    .concat();
    format!(
        r#"#usda 1.0
(
    defaultPrim = "Sample"
    doc = "Made by svbrdf"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "Sample" (
    kind = "component"
)
{{
    def Mesh "Plane" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        float3[] extent = [(-{x}, -{y}, 0), ({x}, {y}, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        rel material:binding = </Sample/Looks/Surface>
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (
            interpolation = "vertex"
        )
        point3f[] points = [(-{x}, -{y}, 0), ({x}, -{y}, 0), ({x}, {y}, 0), (-{x}, {y}, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
    }}

    def Scope "Looks"
    {{
        def Material "Surface"
        {{
            token outputs:surface.connect = </Sample/Looks/Surface/Preview.outputs:surface>

            def Shader "Preview"
            {{
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = </Sample/Looks/Surface/BaseColor.outputs:rgb>
                float inputs:ior = 1.5
                float inputs:metallic.connect = </Sample/Looks/Surface/OcclusionRoughnessMetallic.outputs:b>
                normal3f inputs:normal.connect = </Sample/Looks/Surface/Normal.outputs:rgb>
                float inputs:occlusion.connect = </Sample/Looks/Surface/OcclusionRoughnessMetallic.outputs:r>
                float inputs:roughness.connect = </Sample/Looks/Surface/OcclusionRoughnessMetallic.outputs:g>
                int inputs:useSpecularWorkflow = 0
                token outputs:surface
            }}

            def Shader "Coordinates"
            {{
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 outputs:result
            }}
{textures}        }}
    }}
}}
"#
    )
}

/// Where the data of every file begins, so that it can be mapped.
const ALIGNMENT: usize = 64;

/// A zip archive of stored files, as the USDZ specification asks for.
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
            // An extra field of the kind that USD's own writer uses for padding.
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

/// The part that local headers and directory share: version needed to length of the extra field.
fn entry(name: &str, bytes: &[u8], extra: usize) -> Vec<u8> {
    /// 1980-01-01, the first day zip knows: the same maps give the same bytes.
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
