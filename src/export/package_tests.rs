//! Checks that each renderer's formula applied to the exported values gives the maps.

use std::io::Cursor;

use exr::prelude::{ReadChannels as _, ReadLayers as _};

use serde_json::Value;

use super::*;
use crate::photo::Encoding;
use crate::svbrdf::channel;

#[path = "package_lobes_tests.rs"]
mod package_lobes;

/// Plastic, varnish, metals and mixtures with varying slopes: `w` x `h` texels.
fn materials(w: usize, h: usize) -> Svbrdf {
    let mut maps = Svbrdf::new(w, h);
    for i in 0..w * h {
        let (u, v) = (i as f32 / (w * h) as f32, (i * 7 % 11) as f32 / 11.0);
        let metal = if i % 3 == 0 { 1.0 } else { 0.0 };
        maps.normal_slopes_mut()[0][i] = 0.6 * (6.0 * u).sin();
        maps.normal_slopes_mut()[1][i] = 0.4 * (9.0 * v).cos();
        for c in 0..3 {
            let hue = 1.0 - 0.3 * c as f32 * v;
            maps.diffuse_mut()[c][i] = (1.0 - metal) * (0.05 + 0.6 * u) * hue;
            maps.specular_mut()[c][i] = 0.03 + 0.04 * v + metal * 0.7 * hue;
        }
        maps.roughness_mut()[i] = 0.1 + 0.8 * v;
    }
    maps
}

/// Encoded values of a picture, 0 to 1, four channels per texel.
fn picture(package: &Package, name: &str) -> Vec<[f32; 4]> {
    let bytes = package.file(name).unwrap_or_else(|| panic!("{name} is missing"));
    let picture = image::load_from_memory(bytes).unwrap().into_rgba32f();
    picture.pixels().map(|p| p.0).collect()
}

fn linear(encoded: f32) -> f32 {
    Encoding::Srgb.decode(f64::from(encoded)) as f32
}

fn exported(maps: &Svbrdf, formats: &[Format], texture: TextureFormat) -> Package {
    let options = ExportOptions { formats: formats.to_vec(), texture, ..Default::default() };
    export(maps, &options).unwrap()
}

fn json(package: &Package, name: &str) -> Value {
    serde_json::from_slice(package.file(name).unwrap()).unwrap()
}

/// Half a step of a stored value, plus single-precision rounding.
fn half_step(texture: TextureFormat) -> f32 {
    0.5 / if texture == TextureFormat::Png8 { 255.0 } else { 65535.0 } + 2e-6
}

/// The same for a linear channel, which is dithered in 8 bits: a whole step.
fn linear_step(texture: TextureFormat) -> f32 {
    if texture == TextureFormat::Png8 { 2.0 * half_step(texture) } else { half_step(texture) }
}

/// Checks that a stored colour is the nearest to a linear value.
fn check_colour(stored: f32, expected: f32, texture: TextureFormat, what: &str) {
    let encoded = Encoding::Srgb.encode(f64::from(expected.clamp(0.0, 1.0))) as f32;
    assert!((stored - encoded).abs() <= half_step(texture), "{what}: {stored} for {encoded}");
}

/// Parts of a GLB: JSON and images by name.
#[allow(clippy::type_complexity)] // a test helper
fn glb(package: &Package) -> (Value, Vec<(String, Vec<[f32; 4]>)>) {
    let bytes = package.file("material.glb").unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert!(&bytes[..4] == b"glTF" && word(8) == bytes.len());
    let json: Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    let data = &bytes[20 + word(12) + 8..];
    let images = json["images"].as_array().unwrap().iter().map(|image| {
        let view = &json["bufferViews"][image["bufferView"].as_u64().unwrap() as usize];
        let at = |key: &str| view[key].as_u64().unwrap() as usize;
        let file = &data[at("byteOffset")..][..at("byteLength")];
        let pixels = image::load_from_memory(file).unwrap().into_rgba32f();
        let name = image["name"].as_str().unwrap().to_owned();
        (name, pixels.pixels().map(|p| p.0).collect())
    });
    let images = images.collect();
    (json, images)
}

/// glTF's formulas applied to the file give kd, F0, roughness and the normal.
#[test]
fn a_glb_holds_the_material_by_gltf_s_formulas() {
    let maps = materials(9, 5);
    for texture in [TextureFormat::Png8, TextureFormat::Png16] {
        let (json, images) = glb(&exported(&maps, &[Format::Glb], texture));
        let material = &json["materials"][0];
        let image = |path: &str| {
            let texture = material.pointer(path).unwrap()["index"].as_u64().unwrap() as usize;
            &images[json["textures"][texture]["source"].as_u64().unwrap() as usize].1
        };
        let extensions = "/extensions/KHR_materials_specular/specularColorTexture";
        let (base, tint) = (image("/pbrMetallicRoughness/baseColorTexture"), image(extensions));
        let orm = image("/pbrMetallicRoughness/metallicRoughnessTexture");
        let normal = image("/normalTexture");
        assert_eq!(material["pbrMetallicRoughness"]["metallicFactor"], 1);
        let ior = material["extensions"]["KHR_materials_ior"]["ior"].as_f64().unwrap();
        let interface = ((ior - 1.0) / (ior + 1.0)).powi(2) as f32;
        // One stored step changes square roots of albedos by less than two; base and specular colour add up.
        let near = |shown: f32, wanted: f32, what: &str| {
            let off = (shown.max(0.0).sqrt() - wanted.sqrt()).abs();
            assert!(off < 4.0 * half_step(texture) + 1e-3, "{what}: {shown} for {wanted}");
        };
        for i in 0..maps.texels() {
            let m = orm[i][2];
            let s = [0, 1, 2].map(|c| interface * linear(tint[i][c]));
            let below = 1.0 - s.into_iter().fold(0.0, f32::max);
            for c in 0..3 {
                let (kd, f0) = (maps.diffuse()[c][i], maps.specular()[c][i]);
                let b = linear(base[i][c]);
                near((1.0 - m) * b * below, kd, "kd");
                near(m * b + (1.0 - m) * s[c], f0, "F0");
                // In importers without the extensions, metals are not black.
                let (plain_kd, plain_f0) = (0.96 * (1.0 - m) * b, m * b + 0.04 * (1.0 - m));
                assert!((plain_kd - kd).abs() < 0.04 && (plain_f0 - f0).abs() < 0.04, "{i}");
                let n = maps.normal(i % 9, i / 9)[c];
                assert!((2.0 * normal[i][c] - 1.0 - n).abs() <= 2.0 * linear_step(texture));
            }
            assert!((orm[i][1] - maps.roughness()[i]).abs() <= linear_step(texture));
        }
    }
}

#[test]
fn a_glb_states_size_and_borders() {
    let maps = materials(20, 17);
    let options = ExportOptions { sample_mm: [80.0, 68.0], tile: true, ..Default::default() };
    let (json, _) = glb(&export(&maps, &options).unwrap());
    let corner = json["accessors"][0]["max"].as_array().unwrap();
    assert!((corner[0].as_f64().unwrap() - 0.04).abs() < 1e-8);
    assert!((corner[1].as_f64().unwrap() - 0.034).abs() < 1e-8);
    assert_eq!(json["samplers"][0]["wrapS"], 10497);
    let options = ExportOptions { metallic: true, ..Default::default() };
    let package = export(&maps, &options).unwrap();
    let (json, images) = glb(&package);
    assert!(json.get("extensionsUsed").is_none() && images.len() == 3);
    assert_eq!(json["samplers"][0]["wrapS"], 33071);
    let error = &super::tests::json(&package, "material.json")["exports"]["glb"]["rms_error"];
    // Metalness approximates a dielectric's F0 from 0.03 to 0.07 and coloured metals well.
    assert!(
        error["diffuse"].as_f64().unwrap() < 0.05 && error["specular"].as_f64().unwrap() < 0.05
    );
}

/// Unreal: `kd = (1 - m) base`, `F0 = 0.08 specular (1 - m) + m base`, green downwards.
#[test]
fn unreal_s_textures_are_its_formulas() {
    let maps = materials(9, 5);
    let package = exported(&maps, &[Format::Unreal], TextureFormat::Png16);
    let (base, orm) =
        (picture(&package, "unreal/base_color.png"), picture(&package, "unreal/orm.png"));
    let specular = picture(&package, "unreal/specular.png");
    let normal = picture(&package, "unreal/normal.png");
    for i in 0..maps.texels() {
        let metallic = orm[i][2];
        for c in 0..3 {
            let b = linear(base[i][c]);
            let (kd, f0) =
                ((1.0 - metallic) * b, 0.08 * specular[i][0] * (1.0 - metallic) + metallic * b);
            // Coloured metals and dielectrics below 0.08 have exactly this form.
            assert!((kd - maps.diffuse()[c][i]).abs() < 1e-2, "kd {i}");
            assert!((f0 - maps.specular()[c][i]).abs() < 1e-2, "F0 {i}");
        }
        if i % 3 != 0 {
            let f0 = maps.specular()[0][i];
            assert!(metallic == 0.0 && (specular[i][0] - f0 / 0.08).abs() < 1e-4);
        }
        let n = maps.normal(i % 9, i / 9);
        assert!((2.0 * normal[i][1] - 1.0 + n[1]).abs() < 1e-4, "green points down");
        assert!((orm[i][1] - maps.roughness()[i]).abs() < 1e-4);
    }
}

#[test]
fn unity_s_textures_are_its_formulas() {
    let maps = materials(9, 5);
    let package = exported(&maps, &[Format::UnityHdrp, Format::UnityUrp], TextureFormat::Png8);
    let (mask, base) = (
        picture(&package, "unity-hdrp/mask_map.png"),
        picture(&package, "unity-hdrp/base_map.png"),
    );
    let specular = picture(&package, "unity-urp/specular_map.png");
    let below = picture(&package, "unity-urp/base_map.png");
    let texture = TextureFormat::Png8;
    for i in 0..maps.texels() {
        let roughness = maps.roughness()[i];
        let f0 = maps.specular().map(|plane| plane[i]);
        let largest = f0.into_iter().fold(0.0, f32::max);
        for smoothness in [mask[i][3], specular[i][3]] {
            assert!((smoothness - (1.0 - roughness)).abs() <= linear_step(texture));
        }
        assert_eq!(mask[i][2], 1.0);
        for c in 0..3 {
            let kd = maps.diffuse()[c][i];
            check_colour(specular[i][c], f0[c], texture, "F0");
            check_colour(below[i][c], kd / (1.0 - largest), texture, "base");
            let (m, b) = (mask[i][0], linear(base[i][c]));
            assert!(((1.0 - m) * b - kd).abs() < 0.05);
            assert!((0.04 * (1.0 - m) + m * b - f0[c]).abs() < 0.05);
        }
    }
}

/// Every folder is complete: it has the files that scripts and documents name, and each has a description.
#[test]
fn every_format_is_complete() {
    let maps = materials(16, 16);
    for texture in TextureFormat::ALL {
        let options = ExportOptions {
            formats: Format::ALL.to_vec(),
            texture,
            tile: true,
            photographs: Some(5),
            ..Default::default()
        };
        let package = export(&maps, &options).unwrap();
        let record = json(&package, "material.json");
        assert_eq!(record["estimated"]["photographs"], 5);
        assert_eq!((&record["size_mm"][0], &record["tileable"]), (&100.0.into(), &true.into()));
        for format in Format::ALL {
            assert_eq!(Format::from_name(format.name()), Some(format));
            assert!(record["exports"][format.name()].is_object(), "{}", format.name());
        }
        let text = |name: &str| String::from_utf8(package.file(name).unwrap().to_vec()).unwrap();
        let extension = texture.extension();
        for (folder, text, names) in [
            ("materialx", text("materialx/material.mtlx"), 5),
            ("blender", text("blender/material.py"), 5),
        ] {
            let found: Vec<_> = text
                .split('"')
                .filter(|part| part.starts_with("textures/"))
                .map(|part| format!("{folder}/{part}"))
                .collect();
            assert_eq!(found.len(), names);
            for name in found {
                assert!(package.file(&name).is_some(), "{name}");
                assert!(name.ends_with(extension) || name.ends_with("height.png"), "{name}");
            }
        }
        for name in ["maps/maps.exr", "tile.png", "height.exr", "unreal/material.json"] {
            assert!(package.file(name).is_some(), "{name}");
        }
        let mut names: Vec<_> = package.files.iter().map(|f| &f.0).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), package.files.len(), "no name twice");
    }
    assert_eq!(Format::from_name("gltf"), None);
}

#[test]
fn height_states_its_range() {
    let mut maps = Svbrdf::new(32, 32);
    for i in 0..32 * 32 {
        maps.normal_slopes_mut()[0][i] = (i as f32 / 9.0).sin();
    }
    let package = exported(&maps, &[Format::Glb], TextureFormat::Jpeg);
    let range = json(&package, "material.json")["height"]["range_mm"].clone();
    let [low, high] = [0, 1].map(|i| range[i].as_f64().unwrap() as f32);
    let stored = picture(&package, "height.png");
    let exr = package.file("height.exr").unwrap();
    let floats = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(exr))
        .unwrap();
    let mm: Vec<f32> = floats.layer_data.channel_data.list[0].sample_data.values_as_f32().collect();
    for (a, b) in stored.iter().zip(mm) {
        assert!((low + a[0] * (high - low) - b).abs() <= (high - low) / 65535.0);
    }
    assert!(stored.iter().any(|v| v[0] == 0.0) && stored.iter().any(|v| v[0] == 1.0));
}

#[test]
fn invalid_exports_name_the_fault() {
    let fault = |maps: &Svbrdf, change: fn(&mut ExportOptions)| {
        let mut options = ExportOptions::default();
        change(&mut options);
        export(maps, &options).unwrap_err().to_string()
    };
    let maps = materials(4, 4);
    let none: fn(&mut ExportOptions) = |_| {};
    assert!(fault(&Svbrdf::new(1, 1), none).contains("1 x 1 texels"));
    assert!(fault(&Svbrdf::new(1, 9), none).contains("1 x 9 texels"));
    for (options, name) in [
        ((|o| o.formats.clear()) as fn(&mut ExportOptions), "formats"),
        (|o| o.sample_mm = [f32::NAN, 1.0], "sample_mm"),
        (|o| o.sample_mm = [1.0, 0.0], "sample_mm"),
        (|o| o.max_size = Some(1), "max_size"),
        (|o| o.tile = true, "maps"),
    ] {
        let fault = fault(&maps, options);
        assert!(fault.starts_with(name), "{fault}");
    }
    for (plane, name) in
        [(channel::DIFFUSE + 1, "diffuse green"), (channel::ROUGHNESS, "roughness")]
    {
        let mut maps = maps.clone();
        maps.plane_mut(plane)[6] = f32::NAN;
        let fault = fault(&maps, none);
        assert!(fault.contains(name) && fault.contains("column 2, row 1"), "{fault}");
    }
}

#[test]
fn packages_are_written_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let package = exported(&materials(8, 8), &[Format::Unreal, Format::Glb], TextureFormat::Png8);
    let out = dir.path().join("deep/er");
    package.write(&out).unwrap();
    for (name, bytes) in &package.files {
        assert_eq!(&std::fs::read(out.join(name)).unwrap(), bytes);
    }
    // A folder blocks the last file: no file remains, and the error names it.
    let taken = dir.path().join("taken");
    std::fs::create_dir_all(taken.join("material.json")).unwrap();
    let fault = package.write(&taken).unwrap_err();
    assert!(matches!(&fault, Error::Io { path, .. } if path.ends_with("material.json")), "{fault}");
    assert_eq!(std::fs::read_dir(&taken).unwrap().count(), 1, "only what stood there");
    let file = dir.path().join("file");
    std::fs::write(&file, b"").unwrap();
    assert!(matches!(package.write(file.join("below")), Err(Error::Io { .. })));
}

#[test]
fn textures_are_limited_in_size() {
    let options =
        ExportOptions { formats: vec![Format::UnityUrp], max_size: Some(10), ..Default::default() };
    let package = export(&materials(40, 20), &options).unwrap();
    let base = image::load_from_memory(package.file("unity-urp/base_map.png").unwrap()).unwrap();
    assert_eq!((base.width(), base.height()), (10, 5));
    assert_eq!(json(&package, "material.json")["size_mm"][0], 100.0);
}
