//! Faults of captures and the messages of `fit`.

mod common;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use std::path::{Path, PathBuf};

use common::{failure, maps, names, picture, run, succeed, text};
use serde_json::Value;
use svbrdf::svbrdf::channel;

/// A capture of two photos made by `simulate`.
fn capture(dir: &Path) -> PathBuf {
    let (source, out) = (dir.join("maps"), dir.join("capture"));
    svbrdf::export::write_maps(&source, &maps(32), &svbrdf::export::MapsOptions::default())
        .unwrap();
    succeed(&["simulate", text(&source), "--out", text(&out), "--frames", "2"]);
    out
}

#[test]
fn faults_of_the_description_exit_with_2_and_write_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    let file = capture.join("capture.json");
    let good = std::fs::read_to_string(&file).unwrap();
    for (from, to, field, expected) in [
        ("\"fx\": 1480.0", "\"fx\": NaN", "fx", "finite"),
        ("\"height\": 1512,", "", "camera.height", "whole number"),
        ("\"srgb\"", "\"rec2020\"", "frames[0].encoding", "linear"),
        ("frames/01.png", "frames/99.png", "frames[1].image", "image file"),
        ("svbrdf-capture/1", "svbrdf-capture/9", "format", "svbrdf-capture/1"),
    ] {
        assert!(good.contains(from), "{from} in {good}");
        std::fs::write(&file, good.replacen(from, to, 1)).unwrap();
        let out = dir.path().join("out");
        let (status, message) = failure(&["fit", text(&capture), "--out", text(&out)]);
        assert_eq!(status, 2, "{message}");
        for part in ["capture.json", field, expected] {
            assert!(message.contains(part), "{part}: {message}");
        }
        assert!(!out.exists());
    }
    std::fs::write(&file, good).unwrap();
    let below = file.join("below");
    let (status, message) = failure(&["fit", text(&capture), "--out", text(&below)]);
    assert!(status == 1 && message.contains("below"), "{message}");
    let (status, message) = failure(&["fit", text(&capture), "--out", "x", "--resolution", "300"]);
    assert!(status == 2 && message.contains("512"), "{message}");
}

/// Photos that no fit can use, with their reasons.
fn bad_photos(capture: &Path) -> Vec<(&'static str, Vec<u8>, Vec<&'static str>)> {
    let encode = |image: &image::RgbImage, format| {
        let mut bytes = Vec::new();
        match format {
            image::ImageFormat::Png => image.write_with_encoder(PngEncoder::new(&mut bytes)),
            _ => image.write_with_encoder(JpegEncoder::new(&mut bytes)),
        }
        .unwrap();
        bytes
    };
    let photo = picture(capture.join("frames/00.png")).into_rgb8();
    let (w, h) = photo.dimensions();
    let png = |level| {
        encode(&image::RgbImage::from_pixel(w, h, image::Rgb([level; 3])), image::ImageFormat::Png)
    };
    let jpeg = encode(&photo, image::ImageFormat::Jpeg);
    vec![
        ("cut short", jpeg[..jpeg.len() / 2].to_vec(), vec!["unreadable"]),
        ("empty", Vec::new(), vec!["unreadable"]),
        ("black", png(0), vec!["too_dark"]),
        ("white", png(255), vec!["clipped"]),
        ("gray", png(128), vec!["board_not_found"]),
        (
            "small",
            encode(&image::RgbImage::new(64, 48), image::ImageFormat::Png),
            vec!["wrong_size"],
        ),
    ]
}

#[test]
fn a_bad_photo_is_rejected_with_its_reason_and_the_others_count() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    for (what, bytes, reasons) in bad_photos(&capture) {
        std::fs::write(capture.join("frames/01.png"), &bytes).unwrap();
        let out = dir.path().join("out");
        let quick = ["--method", "classic", "--steps", "2", "--quiet"];
        succeed(&[&["fit", text(&capture), "--out", text(&out)][..], &quick].concat());
        let report = std::fs::read_to_string(out.join("report.json")).unwrap();
        let report: Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["frames"][0]["status"], "accepted", "{what}");
        assert_eq!(report["frames"][1]["status"], "rejected", "{what}");
        let reason = report["frames"][1]["reason"].as_str().unwrap();
        assert!(reasons.contains(&reason), "{what}: {reason}");
        assert!(!report["frames"][1]["hint"].as_str().unwrap().is_empty());
    }
}

#[test]
fn all_photos_at_once_are_fitted_together() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    let maps = ["first", "second"].map(|name| {
        let out = dir.path().join(name);
        succeed(&[
            "fit",
            text(&capture),
            "--out",
            text(&out),
            "--at-once",
            "--steps",
            "4",
            "--quiet",
        ]);
        let report = std::fs::read_to_string(out.join("report.json")).unwrap();
        let report: Value = serde_json::from_str(&report).unwrap();
        for frame in report["frames"].as_array().unwrap() {
            assert_eq!(frame["status"], "accepted");
            // one fit to all of them
            assert_eq!(frame["loss_after"], report["frames"][0]["loss_after"]);
            assert!(frame["loss_after"].as_f64() < frame["loss_before"].as_f64(), "{frame}");
        }
        std::fs::read(out.join("maps.exr")).unwrap()
    });
    assert_eq!(maps[0], maps[1]);
}

#[test]
fn a_capture_of_bad_photos_only_exits_with_2_and_leaves_no_maps() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    let bad = bad_photos(&capture);
    for (index, name) in ["frames/00.png", "frames/01.png"].into_iter().enumerate() {
        std::fs::write(capture.join(name), &bad[index + 1].1).unwrap();
    }
    let out = dir.path().join("out");
    let output = run(&["fit", text(&capture), "--out", text(&out), "--quiet"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("00.png") && message.contains("unreadable"), "{message}");
    assert_eq!(names(&out), [""; 0]);
}

/// A metal shows the room: brighter to one side, it would pass for other gloss in each photograph.
#[test]
fn a_metal_in_an_uneven_room_is_told_from_the_room() {
    let dir = tempfile::tempdir().unwrap();
    let mut known = maps(256);
    // Two metals, each of a colour of its own.
    let is_smooth = |i: usize| (i / 256 / 32 + i % 256 / 32).is_multiple_of(2);
    let mut fill = |c: usize, smooth: f32, rough: f32| {
        for (i, v) in known.plane_mut(c).iter_mut().enumerate() {
            *v = if is_smooth(i) { smooth } else { rough };
        }
    };
    for c in 0..3 {
        fill(channel::DIFFUSE + c, 0.02, 0.05);
        fill(channel::SPECULAR + c, 0.6, 0.6);
    }
    fill(channel::ROUGHNESS, 0.3, 0.45);
    let (source, out) = (dir.path().join("maps"), dir.path().join("capture"));
    svbrdf::export::write_maps(&source, &known, &svbrdf::export::MapsOptions::default()).unwrap();
    let room = ["--frames", "4", "--ambient", "0.08"];
    succeed(&[&["simulate", text(&source), "--out", text(&out)][..], &room].concat());
    let fitted = dir.path().join("maps-of-it");
    succeed(&["fit", text(&out), "--out", text(&fitted)]);
    let report = std::fs::read_to_string(fitted.join("report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    let ambient = report["ambient_fraction"].as_f64().unwrap();
    assert!((ambient - 0.08).abs() < 0.01, "{ambient}");
    let found = svbrdf::export::read_maps(&fitted).unwrap();
    let d = svbrdf::comparison::compare(&found, &known).unwrap();
    // A smooth metal shows little beside the room and four highlights.
    assert!(d.render < 0.14 && d.roughness < 0.1, "{d:?}");
}

/// A camera's tone curve is found, undone and told: in the rows, the report and its page.
#[test]
fn tone_mapped_photographs_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let [source, capture, out] = ["maps", "capture", "out"].map(|name| dir.path().join(name));
    svbrdf::export::write_maps(&source, &maps(32), &svbrdf::export::MapsOptions::default())
        .unwrap();
    let few = ["--frames", "2", "--tone", "filmic", "--patches"];
    succeed(&[&["simulate", text(&source), "--out", text(&capture)], &few[..]].concat());
    let read = |path: &Path| -> Value {
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    };
    assert_eq!(read(&capture.join("truth/truth.json"))["tone"], "filmic");
    let description = read(&capture.join("capture.json"));
    assert_eq!(description["board"]["patches"], true);
    assert_eq!(description["frames"][0]["image"], "frames/00.jpg");
    let quick = ["--out", text(&out), "--steps", "1", "--no-refine", "--at-once"];
    succeed(&[&["fit", text(&capture)], &quick[..]].concat());
    let report = read(&out.join("report.json"));
    let undone = "the camera's tone curve was estimated and undone";
    for frame in report["frames"].as_array().unwrap() {
        let hint = &frame["hints"][0];
        assert!(hint["code"] == "not_linear", "{frame}");
        assert!(hint["hint"].as_str().unwrap().ends_with(undone), "{frame}");
    }
    // The curve has a shoulder.
    let slopes = &report["tone_curve"]["log_slopes"];
    assert!(slopes[2].as_f64().unwrap() > 0.5, "{slopes}");
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Tone-mapped photographs") && page.contains("estimated and undone"));
}

/// One bar for all photographs, however many of them can be used.
#[test]
fn the_fraction_of_a_fit_never_falls() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    std::fs::write(capture.join("frames/00.png"), b"no picture").unwrap();
    let out = dir.path().join("out");
    let fit = ["fit", text(&capture), "--out", text(&out), "--no-report", "--log", "json"];
    let events: Vec<Value> =
        succeed(&fit).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let told = events.iter().filter(|event| event["event"] == "progress");
    let told: Vec<f64> = told.map(|event| event["fraction"].as_f64().unwrap()).collect();
    println!("{told:?}");
    // A fast fit tells little of it.
    assert!(told.is_sorted() && told.iter().all(|f| (0.0..=1.0).contains(f)), "{told:?}");
}

/// `-v` tells of photographs, `-vv` also of phases in their order, with the photographs fitted; neither is on
/// without it.
#[test]
fn verbose_fits_say_what_they_did() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    std::fs::write(capture.join("frames/01.png"), b"no picture").unwrap();
    let out = dir.path().join("out");
    let said = |verbose: &[&str]| {
        let fit = ["fit", text(&capture), "--out", text(&out), "--no-report", "--steps", "20"];
        let output = run(&[&fit[..], &["--quiet"], verbose].concat());
        assert!(output.status.success() && output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(said(&[]), "");
    let info = said(&["-v"]);
    assert!(info.contains("INFO photo accepted index=0"), "{info}");
    assert!(!info.contains("DEBUG"), "{info}");
    let debug = said(&["-vv"]);
    let at = |what: &str| debug.find(what).unwrap_or_else(|| panic!("{what} is not in {debug}"));
    let latent = at("DEBUG fit{photos=1}: phase ended phase=latent steps=");
    assert!(at("INFO photo accepted") < latent && latent < at("phase=texels"), "{debug}");
    assert!(at("calibrated photos=1 focal_px=") < latent, "{debug}");
}
