//! Checks of optional lobes in exported packages.

use super::*;
use crate::svbrdf::{LOBES, lobe};

/// The materials with lobes: ratios of both alphas up to 4 in all directions, a coat and sheen on some.
fn lobed(w: usize, h: usize) -> Svbrdf {
    let mut maps = materials(w, h);
    let n = maps.texels();
    let mut lobes = vec![0.0; LOBES * n];
    for i in 0..n {
        let (t, turn) = (i as f32 / n as f32, (i * 7 % 23) as f32 / 4.0);
        lobes[lobe::ANISOTROPY_X * n + i] = 1.4 * t * turn.cos();
        lobes[lobe::ANISOTROPY_Y * n + i] = 1.4 * t * turn.sin();
        lobes[lobe::COAT * n + i] = (i % 3) as f32 / 2.0;
        lobes[lobe::COAT_ROUGHNESS * n + i] = 0.1 + 0.5 * t;
        for c in 0..3 {
            lobes[(lobe::SHEEN + c) * n + i] = 0.1 * ((i + c) % 4) as f32;
        }
        lobes[lobe::SHEEN_ROUGHNESS * n + i] = 0.3 + 0.6 * t;
    }
    maps.set_lobes(lobes).unwrap();
    maps.roughness_mut().iter_mut().for_each(|v| *v = 0.2 + 0.4 * *v);
    maps
}

/// Alphas along and across, and the doubled angle of the direction as a vector.
fn alphas(maps: &Svbrdf, i: usize) -> ([f32; 2], [f32; 2]) {
    let [u, v] = maps.anisotropy().unwrap().map(|plane| plane[i]);
    let (alpha, m) = (maps.roughness()[i].powi(2), u.hypot(v));
    ([alpha * (0.5 * m).exp(), alpha * (-0.5 * m).exp()], [u / m, v / m])
}

/// Checks a stored vector against a direction given by its doubled angle, unless anisotropy is negligible.
fn check_direction(
    stored: &[f32; 4],
    up: f32,
    (lobe, [cos, sin]): ([f32; 2], [f32; 2]),
    what: &str,
) {
    let [x, y] = [2.0 * stored[0] - 1.0, up * (2.0 * stored[1] - 1.0)];
    let (found, square) = ([x * x - y * y, 2.0 * x * y], x * x + y * y);
    assert!((square - 1.0).abs() < 1e-3, "{what}: a unit vector");
    let off = (found[0] - cos).hypot(found[1] - sin);
    assert!(off < 2e-3 || lobe[0] / lobe[1] < 1.001, "{what}: {off}");
}

/// Every format's formulas applied to its files give both alphas, the direction, the coat and the sheen.
#[test]
fn lobes_are_stored_as_each_format_has_them() {
    let maps = lobed(9, 5);
    let package = exported(&maps, &Format::ALL, TextureFormat::Png16);
    let [weight, coat_roughness] = maps.coat().unwrap();
    let (json_of_glb, images) = glb(&package);
    let extensions = &json_of_glb["materials"][0]["extensions"];
    let image = |texture: &Value| {
        let texture = texture["index"].as_u64().unwrap() as usize;
        &images[json_of_glb["textures"][texture]["source"].as_u64().unwrap() as usize].1
    };
    let anisotropy = image(&extensions["KHR_materials_anisotropy"]["anisotropyTexture"]);
    let coat = &extensions["KHR_materials_clearcoat"];
    let (weights, roughnesses) =
        (image(&coat["clearcoatTexture"]), image(&coat["clearcoatRoughnessTexture"]));
    let sheen = &extensions["KHR_materials_sheen"];
    assert_eq!(sheen["sheenColorTexture"], sheen["sheenRoughnessTexture"]);
    let sheen = image(&sheen["sheenColorTexture"]);
    assert_eq!(coat["clearcoatNormalTexture"], json_of_glb["materials"][0]["normalTexture"]);
    let orm =
        image(&json_of_glb["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"]);
    assert_eq!(json_of_glb["extensionsUsed"].as_array().unwrap().len(), 5);
    let unreal = ["orm", "tangent", "anisotropy", "clear_coat"];
    let unreal = unreal.map(|name| picture(&package, &format!("unreal/{name}.png")));
    let hdrp = ["mask_map", "tangent_map", "anisotropy_map", "coat_mask_map"];
    let hdrp = hdrp.map(|name| picture(&package, &format!("unity-hdrp/{name}.png")));
    let urp = picture(&package, "unity-urp/clear_coat_map.png");
    let blender = ["roughness", "anisotropic", "anisotropic_rotation", "coat_weight"];
    let blender = blender.map(|name| picture(&package, &format!("blender/textures/{name}.png")));
    let open = ["open_pbr_roughness", "open_pbr_anisotropy", "tangent", "coat_roughness"];
    let open = open.map(|name| picture(&package, &format!("materialx/textures/{name}.png")));
    let near = |found: [f32; 2], expected: [f32; 2], what: &str| {
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 5e-3, "{what}: {found} for {expected}");
        }
    };
    for i in 0..maps.texels() {
        let lobe = alphas(&maps, i);
        let [along, across] = lobe.0;
        let mixed = |across: f32, strength: f32| across + (1.0 - across) * strength * strength;
        let stored = orm[i][1] * orm[i][1];
        near([mixed(stored, anisotropy[i][2]), stored], lobe.0, "glTF");
        check_direction(&anisotropy[i], 1.0, lobe, "glTF");
        let kulla = |r: f32, a: f32| [r * r * (1.0 + a), r * r * (1.0 - a)];
        near(kulla(unreal[0][i][1], unreal[2][i][0]), lobe.0, "Unreal");
        check_direction(&unreal[1][i], -1.0, lobe, "Unreal");
        near(kulla(1.0 - hdrp[0][i][3], hdrp[2][i][0]), lobe.0, "HDRP");
        check_direction(&hdrp[1][i], 1.0, lobe, "HDRP");
        let (r, s) = (blender[0][i][0], (1.0 - 0.9 * blender[1][i][0]).sqrt());
        near([r * r / s, r * r * s], lobe.0, "Cycles");
        let turned = std::f32::consts::TAU * blender[2][i][0];
        check_direction(
            &[0.5 * turned.cos() + 0.5, 0.5 * turned.sin() + 0.5, 0.0, 0.0],
            1.0,
            lobe,
            "Cycles",
        );
        let w = weight[i];
        let given = open[0][i][0];
        let through = (given.powi(4) + 2.0 * coat_roughness[i].powi(4)).min(1.0).powf(0.25);
        let (r, a) = (given + w * (through - given), open[1][i][0]);
        let wide = r * r * (2.0 / (1.0 + (1.0 - a).powi(2))).sqrt();
        // A coat may be rougher than the layer below it.
        if given > 0.01 {
            near([wide, (1.0 - a) * wide], [along, across], "OpenPBR");
        }
        check_direction(&open[2][i], 1.0, lobe, "OpenPBR");
        for stored in [weights[i][0], unreal[3][i][0], hdrp[3][i][0], urp[i][0], blender[3][i][0]] {
            assert!((stored - w).abs() < 1e-4, "weight");
        }
        let roughness = [roughnesses[i][1], unreal[3][i][1], 1.0 - urp[i][1], open[3][i][0]];
        assert!(roughness.iter().all(|r| (r - coat_roughness[i]).abs() < 1e-4), "its roughness");
        for (c, plane) in maps.sheen().unwrap().into_iter().enumerate() {
            let stored = if c < 3 { linear(sheen[i][c]) } else { sheen[i][c] };
            assert!((stored - plane[i]).abs() < 1e-4, "sheen {c}: {stored} for {}", plane[i]);
        }
    }
}

/// Scripts and documents name existing files, and each format states its omissions.
#[test]
fn lobes_are_named_where_there_are_some() {
    let text = |package: &Package, name: &str| {
        String::from_utf8(package.file(name).unwrap().to_vec()).unwrap()
    };
    let inputs = [
        ("materialx/material.mtlx", ["geometry_tangent", "geometry_coat_normal", "fuzz_weight"]),
        (
            "blender/material.py",
            ["\"Anisotropic Rotation\": (", "\"Coat Roughness\": (", "\"Sheen Tint\": ("],
        ),
    ];
    let with = exported(&lobed(9, 5), &Format::ALL, TextureFormat::Png8);
    let without = exported(&materials(9, 5), &Format::ALL, TextureFormat::Png8);
    for (file, names) in inputs {
        for name in names {
            assert!(text(&with, file).contains(name), "{name}");
            assert!(!text(&without, file).contains(name), "{name}");
        }
    }
    let usdz = |package: &Package| {
        String::from_utf8_lossy(package.file("material.usdz").unwrap()).into_owned()
    };
    assert!(usdz(&with).contains("inputs:clearcoatRoughness.connect"));
    assert!(!usdz(&without).contains("clearcoat"));
    for name in
        ["inputs:fuzz_color.connect", "inputs:geometry_tangent.connect", "OpenPBR_open_pbr_ior"]
    {
        assert!(usdz(&with).contains(name) && !usdz(&without).contains(name), "{name}");
    }
    assert!(usdz(&without).contains("textures/open_pbr/specular_color.png"));
    assert!(without.remarks.is_empty() && with.remarks.len() == 4, "{:?}", with.remarks);
    let record = json(&with, "material.json");
    for format in ["usdz", "unreal", "unity-urp", "unity-hdrp"] {
        let remark = with.remarks.iter().find(|remark| remark.starts_with(format)).unwrap();
        let left_out = record["exports"][format]["left_out"].as_str().unwrap();
        assert!(remark.ends_with(left_out), "{remark}");
    }
    assert_eq!(record["estimated"]["maps"][5], "coat");
    assert_eq!(record["estimated"]["maps"][6], "sheen");
    assert_eq!(json(&without, "material.json")["estimated"]["maps"].as_array().unwrap().len(), 4);
    let mut broken = lobed(9, 5);
    let mut lobes = broken.lobes().to_vec();
    lobes[9 * 5 + 12] = f32::NAN;
    broken.set_lobes(lobes).unwrap();
    let fault = export(&broken, &ExportOptions::default()).unwrap_err().to_string();
    assert!(fault.contains("column 3, row 1"), "{fault}");
}
