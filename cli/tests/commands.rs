//! The commands that need no fit.

mod common;

use common::{failure, maps, names, picture, save_png, succeed, text};
use glam::{DMat3, DVec2, DVec3};
use svbrdf::capture::Capture;
use svbrdf::export::{MapsOptions, write_maps};
use svbrdf::geometry::Pose;
use svbrdf::observation::View;
use svbrdf::session::Scene;
use svbrdf::svbrdf::channel;

#[test]
fn help_gives_an_example_for_every_command() {
    for command in ["fit", "render", "export", "board", "calibrate", "simulate", "compare"] {
        let help = succeed(&[command, "--help"]);
        assert!(help.contains(&format!("svbrdf {command} ")), "{help}");
        assert!(help.contains("Example"), "{help}");
    }
}

#[test]
fn render_writes_what_the_library_renders() {
    let dir = tempfile::tempdir().unwrap();
    let maps = maps(16);
    write_maps(dir.path(), &maps, &MapsOptions::default()).unwrap();
    let view = View {
        sample_mm: [100.0, 100.0],
        camera_mm: [0.0, 0.0, 300.0],
        light_mm: [-60.0, 20.0, 200.0],
        ..View::default()
    };
    let mut rgb = vec![0.0; 3 * 256];
    svbrdf::render::render(&maps, &view, &mut rgb);
    for (name, tolerance) in [("a.exr", 1e-5), ("a.png", 1.0 / 65535.0)] {
        let out = dir.path().join(name);
        let light = "--light-mm=-60,20,200";
        succeed(&[
            "render",
            text(dir.path()),
            "--camera-mm",
            "0,0,300",
            light,
            "--out",
            text(&out),
        ]);
        let image = picture(&out).into_rgb32f();
        for (i, pixel) in image.pixels().enumerate() {
            for c in 0..3 {
                let expected = rgb[c * 256 + i];
                let expected = if name == "a.png" { expected.clamp(0.0, 1.0) } else { expected };
                assert!((pixel[c] - expected).abs() <= tolerance, "{name} {i} {c}");
            }
        }
    }
}

#[test]
fn render_refuses_bad_input() {
    let dir = tempfile::tempdir().unwrap();
    let empty = text(dir.path());
    let out = dir.path().join("a.png");
    let render = |camera: &str, out: &str| {
        failure(&["render", empty, "--camera-mm", camera, "--light-mm", "0,0,9", "--out", out])
    };
    for (camera, out, status, says) in [
        ("0,0,NaN", text(&out), 2, "finite numbers"),
        ("0,0", text(&out), 2, "three"),
        ("0,0,-5", text(&out), 2, "z > 0"),
        ("0,0,5", "picture.bmp", 2, ".exr"),
        ("0,0,5", text(&out), 2, "normal"),
    ] {
        let (found, message) = render(camera, out);
        assert_eq!(found, status, "{message}");
        assert!(message.contains(says), "{message}");
    }
    write_maps(dir.path(), &maps(4), &MapsOptions::default()).unwrap();
    // Below a regular file nothing can be written.
    let below = dir.path().join("normal.png/a.png");
    let (status, message) = render("0,0,5", text(&below));
    assert_eq!(status, 1, "{message}");
    assert!(message.contains("normal.png"), "{message}");
    assert!(!names(dir.path()).iter().any(|name| name.contains("tmp")));
}

#[test]
fn compare_measures_differences() {
    let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut changed = maps(16);
    write_maps(a.path(), &changed, &MapsOptions::default()).unwrap();
    for first in [channel::DIFFUSE, channel::ROUGHNESS] {
        changed.plane_mut(first).iter_mut().for_each(|v| *v += 0.1);
    }
    write_maps(b.path(), &changed, &MapsOptions::default()).unwrap();
    let compare = |a: &std::path::Path, b: &std::path::Path| -> serde_json::Value {
        serde_json::from_str(&succeed(&["compare", text(a), text(b), "--json"])).unwrap()
    };
    let same = compare(a.path(), a.path());
    let keys = ["normal", "diffuse", "specular", "roughness", "render"];
    let added = ["normal_deg", "diffuse_delta_e00", "specular_delta_e00"];
    for key in keys.into_iter().chain(added) {
        assert_eq!(same[key].as_f64(), Some(0.0), "{key}");
    }
    let other = compare(a.path(), b.path());
    let is = |key: &str, expected: f64| (other[key].as_f64().unwrap() - expected).abs() < 1e-6;
    // One of three channels of the diffuse albedo is off by 0.1.
    assert!(is("diffuse", 0.1 / 3.0f64.sqrt()) && is("roughness", 0.1), "{other}");
    assert!(is("normal", 0.0) && is("specular", 0.0), "{other}");
    let render = other["render"].as_f64().unwrap();
    assert!(render > 0.005 && render < 0.1, "{other}");
    // From (0.2, 0.5, 0.5) or (0.6, 0.5, 0.5) to red ones that are 0.1 brighter: some units.
    let seen = other["diffuse_delta_e00"].as_f64().unwrap();
    assert!((2.0..20.0).contains(&seen), "{other}");
    assert_eq!(compare(a.path(), b.path()), other);
    // Another size is resampled.
    write_maps(b.path(), &maps(16).upsampled(), &MapsOptions::default()).unwrap();
    assert!(compare(b.path(), a.path())["diffuse"].as_f64().unwrap() < 0.06);
}

#[test]
fn boards_are_to_scale() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    for name in ["b.svg", "b.pdf", "b.png"] {
        succeed(&["board", "--out", text(&path(name))]);
    }
    let svg = std::fs::read_to_string(path("b.svg")).unwrap();
    assert!(svg.contains("width=\"210mm\" height=\"297mm\""));
    let squares = svg.matches("width=\"11.500\" height=\"11.500\"").count();
    // 17 x 16 squares less the hole's 11 x 10, half of them black.
    assert_eq!(squares, (17 * 16 - 11 * 10) / 2);
    let pdf = std::fs::read_to_string(path("b.pdf")).unwrap();
    assert_eq!(pdf.matches(" 32.5984 32.5984 re f").count(), squares);
    assert!(pdf.starts_with("%PDF-") && pdf.contains("/MediaBox [0 0 595.2756 841.8898]"));
    // The cross-reference table points at the objects.
    let table: Vec<&str> = pdf.split("xref\n").nth(1).unwrap().lines().collect();
    for (i, entry) in table[2..6].iter().enumerate() {
        let at: usize = entry[..10].parse().unwrap();
        assert!(pdf[at..].starts_with(&format!("{} 0 obj", i + 1)));
    }
    let bytes = std::fs::read(path("b.png")).unwrap();
    // 23622 px/m; the checksum as zlib gives it.
    assert_eq!(&bytes[33..54], b"\0\0\0\x09pHYs\0\0\x5c\x46\0\0\x5c\x46\x01\x14\x94\x43\x41");
    let png = picture(path("b.png")).into_luma8();
    assert_eq!(png.dimensions(), (4961, 7016));
    // Along the second row of squares the colour changes at every square of the ring's corner.
    let at =
        |x: f64, y: f64| png.get_pixel((x * 600.0 / 25.4) as u32, (y * 600.0 / 25.4) as u32)[0];
    for col in 0..16 {
        let x = 13.0 + 11.5 * (f64::from(col) + 0.5);
        assert_eq!(at(x, 20.0 + 11.5 * 0.5), if col % 2 == 0 { 0 } else { 255 });
        assert_eq!(at(x, 20.0 + 11.5 * 1.5), if col % 2 == 0 { 255 } else { 0 });
    }
    // Letter: the same ring on another page.
    let letter = path("letter.svg");
    let said = succeed(&["board", "--paper", "letter", "--out", text(&letter)]);
    let svg = std::fs::read_to_string(letter).unwrap();
    assert!(svg.contains("width=\"215.9mm\" height=\"279.4mm\""));
    assert_eq!(svg.matches("width=\"11.500\" height=\"11.500\"").count(), squares);
    let board: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(board["board"]["hole_squares"], serde_json::json!([3, 3, 14, 13]));
    let (status, message) = failure(&["board", "--board", "ring:17x16:14", "--out", "board.png"]);
    assert!(status == 2 && message.contains("too large"), "{message}");
    let many = "charuco-ring:17x16:11.5:3,3,14,13:8:DICT_4X4_50";
    let (status, message) = failure(&["board", "--board", many, "--out", "board.png"]);
    assert!(status == 2 && message.contains("DICT_4X4_250"), "{message}");
    let (status, message) = failure(&["board", "--out", "board.doc"]);
    assert!(status == 2 && message.contains(".svg"), "{message}");
}

/// Brushed, lacquered and velvety maps, through the commands that read and write them.
#[test]
fn lobes_go_through_every_command() {
    let dir = tempfile::tempdir().unwrap();
    let [source, plain, out] = ["maps", "plain", "out"].map(|name| dir.path().join(name));
    let mut known = maps(32);
    write_maps(&plain, &known, &MapsOptions::default()).unwrap();
    let lobes = [0.5, -0.7, 0.8, 0.3, 0.3, 0.2, 0.0, 0.6].map(|v| vec![v; known.texels()]);
    known.set_lobes(lobes.concat()).unwrap();
    write_maps(&source, &known, &MapsOptions::default()).unwrap();
    let export = ["export", text(&source), "--format", "usdz,glb", "--out", text(&out)];
    let exported = std::process::Command::new(env!("CARGO_BIN_EXE_svbrdf")).args(export).output();
    let said = String::from_utf8(exported.unwrap().stderr).unwrap();
    let remarks: Vec<&str> = said.lines().filter(|line| line.contains("anisotropy")).collect();
    assert!(remarks.len() == 1 && remarks[0].starts_with("usdz"), "{said}");
    let options: [(&[&str], &str); 3] = [
        (&[], "coat.png"),
        (&["--real"], "anisotropy.png"),
        (&["--real", "--lobe", "sheen"], "sheen_roughness.png"),
    ];
    for (faults, texture) in options {
        let capture = dir.path().join(texture);
        let simulate = ["simulate", text(&source), "--out", text(&capture), "--rectified"];
        succeed(&[&simulate, &["--frames", "1"][..], faults].concat());
        assert!(capture.join("truth").join(texture).is_file());
    }
    let compare = |other: &std::path::Path| -> serde_json::Value {
        let said = succeed(&["compare", text(&source), text(other), "--json"]);
        serde_json::from_str(&said).unwrap()
    };
    let same = compare(&dir.path().join("coat.png/truth"));
    let near = |name: &str| same[name].as_f64().unwrap() < 1e-5;
    let names = ["render", "anisotropy", "coat", "coat_roughness", "sheen", "sheen_roughness"];
    assert!(names.into_iter().all(near), "{same}");
    let other = compare(&plain);
    assert!(other["anisotropy"].is_null() && other["render"].as_f64().unwrap() > 1e-3, "{other}");
}

#[test]
fn simulated_captures_show_board_and_sample_where_the_truth_says() {
    let dir = tempfile::tempdir().unwrap();
    let known = maps(32);
    write_maps(dir.path().join("maps"), &known, &MapsOptions::default()).unwrap();
    let (source, out) = (dir.path().join("maps"), dir.path().join("capture"));
    let simulate = |out: &std::path::Path| {
        succeed(&["simulate", text(&source), "--out", text(out), "--frames", "2", "--seed", "3"]);
    };
    simulate(&out);
    let capture = Capture::load(&out).unwrap();
    let Scene::Board { target, camera: Some(camera), .. } = &capture.scene else { panic!() };
    let kept = svbrdf::export::read_maps(out.join("truth")).unwrap();
    // Slopes pass through unit normals: a few roundings.
    assert!(kept.planes().iter().zip(known.planes()).all(|(a, b)| (a - b).abs() < 1e-6));
    let truth = std::fs::read_to_string(out.join("truth/truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    for (i, file) in capture.photos.iter().enumerate() {
        let number = |v: &serde_json::Value| v.as_f64().unwrap();
        let pose = &truth["frames"][i];
        let rows: Vec<f64> = (0..9).map(|k| number(&pose["rotation"][k / 3][k % 3])).collect();
        let rotation = DMat3::from_cols_slice(&rows).transpose();
        assert!((rotation.determinant() - 1.0).abs() < 1e-9);
        let translation = DVec3::from_array([0, 1, 2].map(|k| number(&pose["translation_mm"][k])));
        let pose = Pose { rotation, translation };
        let photo = file.read().unwrap();
        let see = |p: DVec2| {
            let px = camera.project(pose.transform(p.extend(0.0))).unwrap();
            photo.pixel(px.x.round() as u32, px.y.round() as u32)[1]
        };
        for (row, col) in [(0, 0), (0, 14), (16, 0), (16, 14), (8, 1)] {
            let centre = |c: i32| {
                let half = |v: i32| f64::from(v) + 0.5;
                see(target.grid_mm(half(row), half(c)))
            };
            let (here, beside) = (centre(col), centre(col + 1));
            let white = target.is_white(row.into(), col.into());
            let (bright, dark) = if white { (here, beside) } else { (beside, here) };
            // 0.8 against 0.05; neighbours see the light almost alike.
            assert!((12.0..20.0).contains(&(bright / dark)), "frame {i}: {bright} {dark}");
        }
    }
    let again = dir.path().join("again");
    simulate(&again);
    for name in ["capture.json", "frames/01.png", "truth/maps.exr"] {
        let read = |dir: &std::path::Path| std::fs::read(dir.join(name)).unwrap();
        assert!(read(&out) == read(&again), "{name}");
    }
}

/// Photographs with faults keep to their truth: the capture does not tell where the flash is, the
/// same seed has the same faults, and rectified photographs show the sample where the faults say.
#[test]
fn simulated_faults_are_those_of_the_truth() {
    let dir = tempfile::tempdir().unwrap();
    let mut known = maps(64);
    // matt and flat: a texel's brightness is its albedo under the light
    known.normal_slopes_mut()[0].fill(0.0);
    known.normal_slopes_mut()[1].fill(0.0);
    for c in 0..3 {
        known.specular_mut()[c].fill(0.0);
        known.diffuse_mut()[c].fill(0.3);
    }
    let source = dir.path().join("maps");
    write_maps(&source, &known, &MapsOptions::default()).unwrap();
    let simulate = |out: &std::path::Path, seed: &str| {
        let (source, out) = (text(&source), text(out));
        let real = ["--frames", "3", "--real", "--rectified", "--lobe", "ggx"];
        let options = [&real[..], &["--seed", seed]].concat();
        succeed(&[&["simulate", source, "--out", out], &options[..]].concat());
    };
    let [a, again, b] = ["a", "again", "b"].map(|name| dir.path().join(name));
    simulate(&a, "5");
    simulate(&again, "5");
    simulate(&b, "6");
    let read = |dir: &std::path::Path, name: &str| std::fs::read(dir.join(name)).unwrap();
    for name in ["capture.json", "frames/02.jpg", "truth/truth.json"] {
        assert!(read(&a, name) == read(&again, name) && read(&a, name) != read(&b, name), "{name}");
    }
    let truth: serde_json::Value = serde_json::from_slice(&read(&a, "truth/truth.json")).unwrap();
    let lobe = truth["faults"]["flash_exponent"].as_f64().unwrap();
    let capture = Capture::load(&a).unwrap();
    assert_eq!(capture.photos.len(), 3);
    for (file, truth) in capture.photos.iter().zip(truth["frames"].as_array().unwrap()) {
        let told = file.rectified.unwrap();
        assert_eq!(told.camera_mm, told.light_mm);
        let light = DVec3::from_array([0, 1, 2].map(|k| truth["light_mm"][k].as_f64().unwrap()));
        let offset = (light - glam::Vec3::from(told.light_mm).as_dvec3()).length();
        assert!((3.0..12.0).contains(&offset), "{offset}");
        // Middle of the sample: kd / pi * cos * power / d², power = pi * 260², times the exposure.
        // The bow is at most 0.6 mm, 0.5 % of 1/d²; JPEG of a smooth picture errs by a level.
        let exposure = truth["faults"]["exposure"].as_f64().unwrap();
        // The flash is weaker beside the camera's axis.
        let axis = [0, 1, 2].map(|k| truth["rotation"][2][k].as_f64().unwrap());
        let flash = (-light.normalize()).dot(DVec3::from_array(axis)).powf(lobe);
        let expected = exposure * 0.3 * 260.0 * 260.0 * flash * light.z / light.length().powi(3);
        let photo = file.read().unwrap();
        let found = f64::from(photo.pixel(32, 32)[1]);
        assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
    }
}

/// Of a board the same, in a picture that its detector finds the board in.
#[test]
fn simulated_faults_of_a_board_do_not_tell_the_flash() {
    let dir = tempfile::tempdir().unwrap();
    let (source, out) = (dir.path().join("maps"), dir.path().join("capture"));
    write_maps(&source, &maps(32), &MapsOptions::default()).unwrap();
    succeed(&["simulate", text(&source), "--out", text(&out), "--frames", "1", "--real"]);
    let capture = Capture::load(&out).unwrap();
    let Scene::Board { target, camera: Some(_), flash_offset_mm: None, .. } = &capture.scene else {
        panic!("{:?}", capture.scene)
    };
    let photo = capture.photos[0].read().unwrap();
    let luma = svbrdf::calibration::LumaImage::from_photo(&photo);
    assert!(svbrdf::calibration::detect(&luma, target).is_ok());
}

#[test]
fn export_writes_every_format() {
    let dir = tempfile::tempdir().unwrap();
    let source = dir.path().join("maps");
    svbrdf::export::write_maps(
        &source,
        &maps(16),
        &svbrdf::export::MapsOptions { sample_mm: Some([64.0, 64.0]), uncertainty: None },
    )
    .unwrap();
    std::fs::write(
        source.join("report.json"),
        r#"{ "frames": [{ "status": "accepted" }, { "status": "rejected" }] }"#,
    )
    .unwrap();
    let out = dir.path().join("out");
    succeed(&[
        "export",
        text(&source),
        "--format",
        "glb,usdz,materialx,unreal,unity-hdrp,unity-urp,blender",
        "--out",
        text(&out),
        "--metallic",
        "--tile",
        "--texture",
        "png16",
        "--max-size",
        "16",
    ]);
    let record = std::fs::read_to_string(out.join("material.json")).unwrap();
    let record: serde_json::Value = serde_json::from_str(&record).unwrap();
    // The size is read from the maps, the count of photographs from the report beside them.
    assert_eq!(record["size_mm"], serde_json::json!([64.0, 64.0]));
    assert_eq!(record["estimated"]["photographs"], 1);
    for file in [
        "material.glb",
        "material.usdz",
        "materialx/material.mtlx",
        "unreal/orm.png",
        "unity-hdrp/mask_map.png",
        "unity-urp/specular_map.png",
        "blender/material.py",
        "height.png",
        "height.exr",
        "tile.png",
        "maps/maps.exr",
    ] {
        assert!(out.join(file).is_file(), "{file}");
    }
    for folder in ["materialx", "unreal", "unity-hdrp", "unity-urp", "blender"] {
        assert!(out.join(folder).join("material.json").is_file(), "{folder}");
    }
    succeed(&[
        "render",
        text(&out.join("maps")),
        "--camera-mm",
        "0,0,300",
        "--light-mm",
        "0,0,300",
        "--out",
        text(&out.join("lit.png")),
    ]);
}

/// Every fault of the input is told with the file and the field, and leaves nothing behind.
#[test]
fn what_cannot_be_exported_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let source = dir.path().join("maps");
    let check = |format: &str, status: i32, words: &[&str]| {
        let said = failure(&["export", text(&source), "--format", format, "--out", text(&out)]);
        for word in words {
            assert!(said.0 == status && said.1.contains(word), "{said:?}");
        }
        assert!(!out.exists());
    };
    check("glb", 2, &["maps", "normal"]);
    write_maps(&source, &maps(8), &MapsOptions::default()).unwrap();
    check("gltf", 2, &["--format", "gltf", "unity-urp"]);
    check("glb,", 2, &["--format"]);
    let exr = source.join("maps.exr");
    std::fs::remove_file(&exr).unwrap();
    save_png(source.join("roughness.png"), image::GrayImage::new(3, 3));
    check("glb", 2, &["roughness.png", "8 x 8"]);
    std::fs::remove_file(source.join("roughness.png")).unwrap();
    check("glb", 2, &["roughness"]);
    let mut broken = maps(8);
    broken.roughness_mut()[3] = f32::NAN;
    write_maps(&source, &broken, &MapsOptions::default()).unwrap();
    check("glb", 2, &["maps.exr", "roughness.Y", "NaN"]);
    write_maps(&source, &svbrdf::Svbrdf::new(1, 1), &MapsOptions::default()).unwrap();
    check("usdz", 2, &[text(&source), "1 x 1 texels"]);
    write_maps(&source, &maps(8), &MapsOptions::default()).unwrap();
    std::fs::write(&out, b"a file").unwrap();
    let inside = out.join("inside");
    let said = failure(&["export", text(&source), "--format", "glb", "--out", text(&inside)]);
    assert!(said.0 == 1 && said.1.contains(text(&inside)), "{said:?}");
}
