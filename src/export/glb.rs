//! Binary glTF 2.0: a flat rectangle of the sample's size with the maps as its material.

use serde_json::{Map, Value, json};

use super::bundle::{Bundle, Layered, number};
use super::textures::Texture;
use crate::Result;

/// Description of a GLB, with the extensions of the optional lobes.
pub(super) fn describe_all(bundle: &Bundle, layered: &Layered) -> Value {
    let mut description = describe(layered);
    if bundle.anisotropy.is_some() {
        description["anisotropy"] = json!(
            "KHR_materials_anisotropy: R, G direction, B strength; alpha along = mix(roughness^2, 1, strength^2)"
        );
    }
    if bundle.maps.coat().is_some() {
        description["coat"] = json!("KHR_materials_clearcoat: R weight, G roughness");
    }
    if bundle.maps.sheen().is_some() {
        description["sheen"] = json!("KHR_materials_sheen: RGB colour, A roughness");
    }
    description
}

/// The part of the description common with MaterialX and Blender.
pub(super) fn describe(layered: &Layered) -> Value {
    let error = |[diffuse, specular]: [f32; 2]| json!({ "diffuse": number(diffuse), "specular": number(specular) });
    match (&layered.tint, layered.rms) {
        (None, rms) => json!({
            "workflow": "metallic: kd = 0.96 (1 - m) base, F0 = 0.04 (1 - m) + m base; least squares",
            "rms_error": error(rms.unwrap_or_default()),
        }),
        (Some(_), None) => json!({
            "workflow": "KHR_materials_specular and KHR_materials_ior: base = kd / (1 - max F0), \
                         specular colour = F0 / F0 of the index of refraction",
            "ior": number(layered.ior),
        }),
        (Some(_), Some(rms)) => json!({
            "workflow": "KHR_materials_specular and KHR_materials_ior, S = specular colour * F0 of the \
                         index of refraction: kd = (1 - m) base (1 - max S), F0 = m base + (1 - m) S",
            "ior": number(layered.ior),
            "rms_error": error([0.0; 2]),
            "rms_error_without_extensions": error(rms),
        }),
    }
}

pub(super) fn encode(bundle: &Bundle, layered: &Layered) -> Result<Vec<u8>> {
    let mut textures = vec![("baseColor", layered.base.clone()), ("normal", bundle.normals(1.0))];
    textures.push(("occlusionRoughnessMetallic", layered.orm.clone()));
    textures.extend(layered.tint.clone().map(|tint| ("specularColor", tint)));
    textures.extend(bundle.anisotropy_texture().map(|texture| ("anisotropy", texture)));
    textures.extend(bundle.coat_texture().map(|texture| ("clearcoat", texture)));
    textures.extend(bundle.sheen_texture().map(|texture| ("sheen", texture)));
    let (material, extensions) = material(bundle, &textures, layered.ior);
    let images = bundle.encode("", &textures)?;

    let half = bundle.sample_mm.map(|mm| mm / 2000.0);
    let mut data = Data::default();
    data.geometry(half);
    let geometry_views = data.views.len();
    for (_, bytes) in &images {
        data.push(bytes, None);
    }
    data.pad();
    let count = images.len();
    let mut root = json!({
        "asset": { "version": "2.0", "generator": concat!("svbrdf ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "sample" }],
        "meshes": [{ "name": "sample", "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3 },
            "indices": 4,
            "material": 0,
        }] }],
        "materials": [material],
        "textures": (0..count).map(|i| json!({ "source": i, "sampler": 0 })).collect::<Vec<_>>(),
        "samplers": [sampler(bundle.tileable)],
        "images": (0..count).map(|i| json!({
            "name": textures[i].0,
            "mimeType": textures[i].1.format(bundle.texture).mime_type(),
            "bufferView": geometry_views + i,
        })).collect::<Vec<_>>(),
        "accessors": accessors(half),
        "bufferViews": data.views,
        "buffers": [{ "byteLength": data.bytes.len() }],
    });
    if !extensions.is_empty() {
        root["extensionsUsed"] = json!(extensions);
    }
    Ok(container(&root, &data.bytes))
}

/// The material of the named textures, and the extensions it uses.
fn material(bundle: &Bundle, textures: &[(&str, Texture)], ior: f32) -> (Value, Vec<&'static str>) {
    let index = |name: &str| textures.iter().position(|(own, _)| *own == name);
    let mut extensions = Map::new();
    let mut used = Vec::new();
    let mut extend = |name: &'static str, value: Value| {
        extensions.insert(name.into(), value);
        used.push(name);
    };
    if let Some(anisotropy) = index("anisotropy") {
        let texture = json!({ "index": anisotropy });
        let value = json!({ "anisotropyStrength": 1, "anisotropyTexture": texture });
        extend("KHR_materials_anisotropy", value);
    }
    if let Some(coat) = index("clearcoat") {
        let texture = json!({ "index": coat });
        let value = json!({
            "clearcoatFactor": 1,
            "clearcoatTexture": texture,
            "clearcoatRoughnessFactor": 1,
            "clearcoatRoughnessTexture": texture,
            "clearcoatNormalTexture": { "index": 1 },
        });
        extend("KHR_materials_clearcoat", value);
    }
    if let Some(sheen) = index("sheen") {
        let texture = json!({ "index": sheen });
        let value = json!({
            "sheenColorFactor": [1, 1, 1],
            "sheenColorTexture": texture,
            "sheenRoughnessFactor": 1,
            "sheenRoughnessTexture": texture,
        });
        extend("KHR_materials_sheen", value);
    }
    if let Some(tint) = index("specularColor") {
        extend("KHR_materials_ior", json!({ "ior": number(ior) }));
        let value = json!({ "specularColorTexture": { "index": tint } });
        extend("KHR_materials_specular", value);
    }
    let mut material = json!({
        "name": "svbrdf",
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 },
            "metallicRoughnessTexture": { "index": 2 },
            "metallicFactor": 1,
        },
        "normalTexture": { "index": 1 },
        "occlusionTexture": { "index": 2 },
        "extras": {
            "size_mm": bundle.sample_mm.map(number),
            "height_range_mm": bundle.height.range_mm().map(number),
        },
    });
    if !extensions.is_empty() {
        material["extensions"] = Value::Object(extensions);
    }
    (material, used)
}

/// Trilinear; repeats if tileable, otherwise clamps.
fn sampler(tileable: bool) -> Value {
    const LINEAR: u32 = 9729;
    const LINEAR_MIPMAP_LINEAR: u32 = 9987;
    let wrap = if tileable { 10497 } else { 33071 };
    json!({
        "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap,
    })
}

fn accessors(half: [f32; 2]) -> Value {
    const FLOAT: u32 = 5126;
    const UNSIGNED_SHORT: u32 = 5123;
    let [x, y] = half;
    json!([
        { "bufferView": 0, "componentType": FLOAT, "count": 4, "type": "VEC3",
          "min": [-x, -y, 0.0], "max": [x, y, 0.0] },
        { "bufferView": 1, "componentType": FLOAT, "count": 4, "type": "VEC3" },
        { "bufferView": 2, "componentType": FLOAT, "count": 4, "type": "VEC4" },
        { "bufferView": 3, "componentType": FLOAT, "count": 4, "type": "VEC2" },
        { "bufferView": 4, "componentType": UNSIGNED_SHORT, "count": 6, "type": "SCALAR" },
    ])
}

/// The binary chunk and its buffer views.
#[derive(Default)]
struct Data {
    bytes: Vec<u8>,
    views: Vec<Value>,
}

impl Data {
    /// A quad in the x-y plane that faces +z, metres; row 0 of the maps lies at +y.
    fn geometry(&mut self, [x, y]: [f32; 2]) {
        const VERTICES: Option<u32> = Some(34962);
        const INDICES: Option<u32> = Some(34963);
        let positions = [[-x, y, 0.0], [-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0]];
        self.push(&little(positions.as_flattened()), VERTICES);
        self.push(&little([[0.0, 0.0, 1.0]; 4].as_flattened()), VERTICES);
        self.push(&little([[1.0, 0.0, 0.0, 1.0]; 4].as_flattened()), VERTICES);
        let corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]];
        self.push(&little(corners.as_flattened()), VERTICES);
        let indices = [0u16, 1, 2, 0, 2, 3].map(u16::to_le_bytes);
        self.push(indices.as_flattened(), INDICES);
    }

    fn push(&mut self, bytes: &[u8], target: Option<u32>) {
        self.pad();
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.bytes.extend_from_slice(bytes);
    }

    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

fn little(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Header, JSON chunk and binary chunk.
fn container(root: &Value, data: &[u8]) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + data.len();
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(b"glTF");
    for number in [2, total, json.len()] {
        out.extend_from_slice(&(number as u32).to_le_bytes());
    }
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&json);
    out.extend_from_slice(&(data.len() as u32).to_le_bytes());
    out.extend_from_slice(b"BIN\0");
    out.extend_from_slice(data);
    out
}
