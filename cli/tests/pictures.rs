//! `fit` on photographs without capture.json.

mod common;
#[path = "common/photos.rs"]
mod photos;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use common::{failure, maps, picture, run, succeed, text};
use image::RgbImage;
use image::imageops::{self, FilterType};
use moxcms::ColorProfile;
use photos::{Written, changed, to_display_p3};
use serde_json::Value;
use svbrdf::comparison::{delta_e_2000, lab};

const FAST: [&str; 8] =
    ["--sample-mm", "100", "--method", "classic", "--steps", "2", "--no-report", "--at-once"];

/// Three photographs of stripes in vivid colours on the default board.
static SHOTS: LazyLock<Vec<RgbImage>> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let mut known = maps(32);
    for i in 0..32 * 32 {
        let colour = [[0.5, 0.1, 0.05], [0.05, 0.45, 0.1], [0.1, 0.15, 0.5]][i % 32 / 4 % 3];
        for (c, v) in colour.into_iter().enumerate() {
            known.diffuse_mut()[c][i] = v;
        }
    }
    let (source, out) = (dir.path().join("known"), dir.path().join("simulated"));
    svbrdf::export::write_maps(&source, &known, &svbrdf::export::MapsOptions::default()).unwrap();
    succeed(&["simulate", text(&source), "--out", text(&out), "--frames", "3"]);
    // Half the size is enough, and four times as fast.
    let open = |i| {
        let shot = picture(out.join(format!("frames/{i:02}.png"))).into_rgb8();
        imageops::resize(&shot, shot.width() / 2, shot.height() / 2, FilterType::Triangle)
    };
    (0..3).map(open).collect()
});

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Fits quickly. Returns standard error.
fn fit(inputs: &[&Path], out: &Path) -> String {
    let inputs: Vec<&str> = inputs.iter().map(|path| text(path)).collect();
    let output = run(&[&["fit", "--out", text(out)][..], &FAST, &inputs].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    said
}

/// Fits the capture that an earlier fit has described.
fn fit_again(out: &Path, again: &Path) -> Vec<u8> {
    succeed(&[&["fit", text(out), "--out", text(again)][..], &FAST[2..]].concat());
    fs::read(again.join("maps.exr")).unwrap()
}

#[test]
fn exposure_order_and_camera_come_from_metadata() {
    let dir = tempfile::tempdir().unwrap();
    let shots = &*SHOTS;
    let folder = dir.path().join("Küche 台所");
    fs::create_dir(&folder).unwrap();
    // Exposures of the metadata, relative to the first in time: 1, 1/2, 3/4.
    let seconds = [([1, 50], 100, 18), ([1, 25], 100, 36), ([1, 100], 150, 18)];
    let truth = [1.0, 0.5, 0.75];
    for (i, shot) in shots.iter().enumerate() {
        let (time, subsec) = [
            ("2026:05:06 07:08:09", "1"),
            ("2026:05:06 07:08:09", "25"),
            ("2026:05:06 07:08:10", "0"),
        ][i];
        let written = Written {
            model: Some("Phone"),
            exposure: Some(seconds[i]),
            time: Some(time),
            subsec: Some(subsec),
            flash: Some(if i == 2 { 16 } else { 25 }),
            ..Written::default()
        };
        let darker = changed(shot, |rgb| rgb.map(|v| truth[i] * v));
        written.save(&folder.join(format!("foto {}.jpg", 9 - i)), &darker);
    }
    let other = Written { model: Some("Other"), ..Written::default() };
    other.save(&folder.join("anders.jpg"), &shots[0]);
    let out = dir.path().join("maps");
    let said = fit(&[&folder], &out);
    assert!(said.contains("anders.jpg: taken with Maker Other, most with Maker Phone"), "{said}");
    assert!(said.contains("foto 7.jpg: the flash did not fire"), "{said}");
    let capture = json(&out.join("capture.json"));
    let frames = capture["frames"].as_array().unwrap();
    let names: Vec<&str> =
        frames.iter().map(|f| f["image"].as_str().unwrap().rsplit_once('/').unwrap().1).collect();
    assert_eq!(names, ["foto 9.jpg", "foto 8.jpg", "foto 7.jpg"]);
    for (frame, truth) in frames.iter().zip(truth) {
        let exposure = frame["exposure"].as_f64().unwrap();
        assert!((exposure / truth - 1.0).abs() < 1e-6, "{exposure} for {truth}");
    }
    let report = json(&out.join("report.json"));
    let left_out = report["photographs"]["left_out"][0]["image"].as_str().unwrap();
    assert!(left_out.ends_with("anders.jpg"));
    assert!(report["frames"].as_array().unwrap().iter().all(|f| f["status"] == "accepted"));
    // The written capture repeats the run, also from another folder.
    let first = fs::read(out.join("maps.exr")).unwrap();
    assert_eq!(fit_again(&out, &dir.path().join("again")), first);
    let (moved, photos) = (dir.path().join("x/y"), dir.path().join("x/Küche 台所"));
    fs::create_dir(dir.path().join("x")).unwrap();
    fs::rename(&out, &moved).unwrap();
    fs::rename(&folder, photos).unwrap();
    assert_eq!(fit_again(&moved.join("capture.json"), &dir.path().join("moved")), first);
}

#[test]
fn zoomed_photographs_are_left_out_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("photos");
    fs::create_dir(&folder).unwrap();
    for (i, shot) in SHOTS.iter().enumerate() {
        let zoom = if i == 1 { ([13, 10], 35) } else { ([1, 1], 27) };
        let written = Written {
            model: Some("Phone"),
            exposure: Some(([1, 50], 100, 18)),
            zoom: Some(zoom),
            ..Written::default()
        };
        written.save(&folder.join(format!("{i}.jpg")), shot);
    }
    let out = dir.path().join("maps");
    let said = fit(&[&folder], &out);
    assert!(said.contains("1.jpg: digital zoom: 1.30 times, most none"), "{said}");
    assert!(!said.contains("lay it flat") && !said.contains("not linear"), "{said}");
    let report = json(&out.join("report.json"));
    assert_eq!(report["frames"].as_array().unwrap().len(), 2);
    let rows = report["frames"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["residual"].is_number() && row["contradicts"] == false));
}

/// Linear values in a PNG file that says so are those of the same picture in sRGB.
#[test]
fn a_linear_png_is_read_as_linear() {
    let dir = tempfile::tempdir().unwrap();
    let (plain, linear) = (dir.path().join("plain.png"), dir.path().join("linear.png"));
    Written::default().save(&plain, &SHOTS[0]);
    let deep = image::ImageBuffer::from_fn(SHOTS[0].width(), SHOTS[0].height(), |x, y| {
        let stored = |v: u8| {
            let value = svbrdf::photo::Encoding::Srgb.decode(f64::from(v) / 255.0);
            (65_535.0 * value).round() as u16
        };
        image::Rgb(SHOTS[0].get_pixel(x, y).0.map(stored))
    });
    let mut bytes = Vec::new();
    deep.write_with_encoder(image::codecs::png::PngEncoder::new(&mut bytes)).unwrap();
    // gAMA 100000 with its checksum, behind the header.
    let gama = [0, 0, 0, 4, b'g', b'A', b'M', b'A', 0, 1, 0x86, 0xA0, 0x31, 0xE8, 0x96, 0x5F];
    fs::write(&linear, [&bytes[..33], &gama, &bytes[33..]].concat()).unwrap();
    for path in [&plain, &linear] {
        let said = fit(&[path], &path.with_extension("maps"));
        assert!(!said.contains("not linear"), "{said}");
    }
    let (mean, worst) = difference(&plain.with_extension("maps"), &linear.with_extension("maps"));
    // Clipped pixels are told apart at another level of 16 bits.
    assert!(mean < 0.1 && worst < 1.0, "{mean} {worst}");
}

/// Mean and largest difference of two diffuse maps, averaged over 4 x 4 texels.
fn difference(a: &Path, b: &Path) -> (f64, f64) {
    let [a, b] = [a, b].map(|dir| svbrdf::export::read_maps(dir).unwrap());
    let (w, mut each) = (a.width(), Vec::new());
    for block in 0..(w / 4).pow(2) {
        let (x, y) = (4 * (block % (w / 4)), 4 * (block / (w / 4)));
        let mean = |maps: &svbrdf::Svbrdf| {
            [0, 1, 2].map(|c| {
                let plane = maps.diffuse()[c];
                let sum: f32 = (0..16).map(|i| plane[(y + i / 4) * w + x + i % 4]).sum();
                f64::from(sum) / 16.0
            })
        };
        each.push(delta_e_2000(lab(mean(&a)), lab(mean(&b))));
    }
    (each.iter().sum::<f64>() / each.len() as f64, each.iter().copied().fold(0.0, f64::max))
}

/// The base picture of an Ultra HDR file names the gain map in its XMP.
#[test]
fn a_gain_map_is_left_out_and_said() {
    let dir = tempfile::tempdir().unwrap();
    let (plain, ultra) = (dir.path().join("plain.jpg"), dir.path().join("ultra.jpg"));
    Written::default().save(&plain, &SHOTS[0]);
    let xmp =
        b"http://ns.adobe.com/xap/1.0/\0<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:Description \
        xmlns:hdrgm=\"http://ns.adobe.com/hdr-gain-map/1.0/\" hdrgm:Version=\"1.0\"/></x:xmpmeta>";
    let jpeg = fs::read(&plain).unwrap();
    let length = u16::try_from(xmp.len() + 2).unwrap().to_be_bytes();
    fs::write(&ultra, [&jpeg[..2], &[0xFF, 0xE1], &length, xmp, &jpeg[2..]].concat()).unwrap();
    let [without, with] = [&plain, &ultra].map(|path| {
        let out = path.with_extension("maps");
        let said = fit(&[path], &out);
        assert_eq!(said.contains("gain map"), path == &ultra, "{said}");
        out
    });
    let hints = &json(&with.join("report.json"))["frames"][0]["hints"];
    assert!(hints.as_array().unwrap().iter().any(|hint| hint["code"] == "gain_map"), "{hints}");
    let exr = |out: &Path| fs::read(out.join("maps.exr")).unwrap();
    assert_eq!(exr(&without), exr(&with));
}

#[test]
fn a_display_p3_picture_gives_the_colours_of_a_rec_709_one() {
    let dir = tempfile::tempdir().unwrap();
    let shot = &SHOTS[0];
    let wide = changed(shot, to_display_p3);
    // The same light with another curve as well.
    let steep = {
        let mut steep = wide.clone();
        for (to, from) in steep.pixels_mut().zip(wide.pixels()) {
            let linear = from.0.map(|v| svbrdf::photo::Encoding::Srgb.decode(f64::from(v) / 255.0));
            to.0 = linear.map(|v| (255.0 * v.powf(1.0 / 1.8)).round() as u8);
        }
        steep
    };
    let p3 = ColorProfile::new_display_p3();
    let mut p3_steep = p3.clone();
    let gamma = moxcms::curve_from_gamma(1.8);
    p3_steep.red_trc = Some(gamma.clone());
    p3_steep.green_trc = Some(gamma.clone());
    p3_steep.blue_trc = Some(gamma);
    p3_steep.cicp = None;
    let tagged = |profile: &ColorProfile| Some(profile.encode().unwrap());
    let broken = tagged(&p3).map(|bytes| bytes[..bytes.len() / 3].to_vec());
    let cases = [
        ("plain", shot, None),
        ("srgb", shot, tagged(&ColorProfile::new_srgb())),
        ("p3", &wide, tagged(&p3)),
        ("gamma", &steep, tagged(&p3_steep)),
        ("broken", shot, broken),
        ("untagged", &wide, None),
    ];
    let results = cases.map(|(name, picture, profile)| {
        // The errors of JPEG differ from one encoding to the other.
        let (path, out) = (dir.path().join(format!("{name}.png")), dir.path().join(name));
        Written { profile, ..Written::default() }.save(&path, picture);
        let said = fit(&[&path], &out);
        assert_eq!(said.contains("ICC profile cannot be used"), name == "broken", "{said}");
        (name, out)
    });
    let plain = &results[0].1;
    let exr = |out: &PathBuf| fs::read(out.join("maps.exr")).unwrap();
    for (name, out) in &results[1..] {
        let (mean, worst) = difference(plain, out);
        println!("{name}: {mean:.3} in the mean, {worst:.3} at worst");
        match *name {
            "srgb" | "broken" => assert_eq!(exr(plain), exr(out), "{name}"),
            "untagged" => assert!(mean > 2.0, "{mean}: the test cannot tell"),
            // 8 bits are rounded differently in each.
            _ => assert!(mean < 0.3 && worst < 1.0, "{name}: {mean} {worst}"),
        }
    }
}

#[test]
fn a_turned_picture_gives_the_same_maps() {
    let dir = tempfile::tempdir().unwrap();
    let shot = &SHOTS[0];
    let [upright, turned] = ["upright", "turned"].map(|name| dir.path().join(name));
    let path = |out: &Path| out.with_extension("png");
    Written::default().save(&path(&upright), shot);
    let tagged = Written { orientation: Some(6), ..Written::default() };
    tagged.save(&path(&turned), &imageops::rotate270(shot));
    let maps = [upright, turned].map(|out| {
        fit(&[&path(&out)], &out);
        fs::read(out.join("maps.exr")).unwrap()
    });
    assert_eq!(maps[0], maps[1]);
}

/// A phone above a table takes itself for held upright in one photograph and not in the next; lens
/// and flash stay where they are in the phone.
#[test]
fn photographs_lie_as_the_sensor_saw_them() {
    let dir = tempfile::tempdir().unwrap();
    let shots = &*SHOTS;
    // The last two, mirrored: the maps are the mirror image's then, however the phone was held.
    let maps = [[1, 1, 1], [1, 3, 6], [2, 2, 2], [2, 5, 7]].map(|orientations| {
        let folder = dir.path().join(format!("photos{orientations:?}"));
        fs::create_dir(&folder).unwrap();
        for (i, (shot, orientation)) in shots.iter().zip(orientations).enumerate() {
            let written = Written { orientation: Some(orientation), ..Written::default() };
            written.save(&folder.join(format!("{i}.png")), shot);
        }
        let out = folder.with_extension("maps");
        fit(&[&folder], &out);
        let maps = fs::read(out.join("maps.exr")).unwrap();
        assert_eq!(fit_again(&out, &folder.with_extension("again")), maps);
        let capture = json(&out.join("capture.json"));
        let turn = |i: usize| capture["frames"][i]["turn"].as_u64().unwrap_or(0);
        let turns = [0, 1, 2].map(turn);
        assert!([[0; 3], [0, 180, 270], [0, 90, 270]].contains(&turns), "{turns:?}");
        maps
    });
    assert_eq!(maps[0], maps[1]);
    assert_eq!(maps[2], maps[3]);
}

#[test]
fn pictures_that_cannot_be_used_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let folder = dir.path().join("photos");
    fs::create_dir(&folder).unwrap();
    let refused = |extra: &[&str], expected: &[&str]| {
        let (status, said) =
            failure(&[&["fit", text(&folder), "--out", text(&out)][..], extra].concat());
        assert_eq!(status, 2, "{said}");
        expected.iter().for_each(|part| assert!(said.contains(part), "{part}: {said}"));
        assert!(!out.join("capture.json").exists());
    };
    refused(&[], &["photos: neither capture.json nor photographs", "JPEG"]);
    fs::write(folder.join("IMG_1.JPG"), b"\0\0\0\x18ftypavif\0\0\0\0mif1avif").unwrap();
    fs::write(folder.join("IMG_2.CR3"), b"\0\0\0\x14ftypcrx \0\0\0\0crx ").unwrap();
    refused(&[], &["IMG_1.JPG: an AVIF picture", "convert it", "IMG_2.CR3", "convert it to DNG"]);
    fs::write(folder.join("text.jpg"), b"no picture").unwrap();
    refused(&[], &["text.jpg", "unreadable", "every photo was rejected"]);
    refused(&["--sample-mm", "300"], &["--sample-mm 300x300", "115x126.5"]);
    refused(&["--board", "dots"], &["--board dots"]);
    let (status, said) = failure(&["fit", text(&folder), "--out", text(&folder)]);
    assert!(status == 2 && said.contains("another folder"), "{said}");
    for i in 0..500 {
        fs::write(folder.join(format!("{i}.jpg")), b"").unwrap();
    }
    refused(&[], &["501 photographs; expected at most 100", "--frames"]);
    let nowhere = dir.path().join("nowhere.jpg");
    let (status, said) = failure(&["fit", text(&nowhere), "--out", text(&out)]);
    assert!(status == 2 && said.contains("nowhere.jpg: no such file"), "{said}");
}

#[test]
fn a_cut_photograph_is_left_out_and_a_complete_fit_is_skipped() {
    let dir = tempfile::tempdir().unwrap();
    let shot = &SHOTS[0];
    let (good, cut) = (dir.path().join("a good one.jpg"), dir.path().join("cut.jpg"));
    Written::default().save(&good, shot);
    let bytes = fs::read(&good).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let out = dir.path().join("out");
    let said = fit(&[&good, &cut, &good], &out);
    assert!(said.contains("cut.jpg: rejected (unreadable)"), "{said}");
    assert!(said.contains("no exposure in the metadata"), "{said}");
    let report = json(&out.join("report.json"));
    assert_eq!(report["frames"].as_array().unwrap().len(), 2, "the same file counts once");
    assert_eq!(report["frames"][1]["reason"], "unreadable");
    // Nothing is done where everything is there, whatever the photographs.
    let skip = |extra: &[&str]| {
        let fixed = ["fit", text(&cut), "--out", text(&out), "--skip-existing"];
        run(&[&fixed[..], &FAST, extra].concat())
    };
    let skipped = skip(&["--log", "json"]);
    assert_eq!(skipped.status.code(), Some(0));
    let events = String::from_utf8(skipped.stdout).unwrap();
    let first: Value = serde_json::from_str(events.lines().next().unwrap()).unwrap();
    assert_eq!(first["event"], "skipped");
    // A fit with other settings, or whose files are gone, is made again; this one fails.
    assert_eq!(skip(&["--resolution", "512"]).status.code(), Some(2));
    fs::remove_file(out.join("normal.png")).unwrap();
    assert_eq!(skip(&[]).status.code(), Some(2));
}

/// A file that another one takes the place of is read again, and its first photo is taken back.
#[test]
fn overwritten_photographs_are_read_again() {
    let dir = tempfile::tempdir().unwrap();
    let (incoming, out) = (dir.path().join("incoming"), dir.path().join("out"));
    fs::create_dir(&incoming).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_svbrdf"))
        .args(["fit", "--watch", text(&incoming), "--out", text(&out), "--log", "json"])
        .args(&FAST[..7])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut until = |name: &str| loop {
        let event: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        if event["event"] == name {
            break event;
        }
    };
    let mut first = None;
    for shot in [&SHOTS[0], &SHOTS[2]] {
        let aside = dir.path().join("shot.jpg");
        Written::default().save(&aside, shot);
        fs::rename(&aside, incoming.join("shot.jpg")).unwrap();
        assert_eq!(until("photo")["status"], "accepted");
        assert_eq!(until("maps")["photographs"], 1);
        let maps = fs::read(out.join("maps.exr")).unwrap();
        assert_ne!(first.replace(maps.clone()), Some(maps));
    }
    fs::create_dir(incoming.join("100APPLE")).unwrap();
    assert!(until("left_out")["image"].as_str().unwrap().ends_with("100APPLE"));
    let process = child.id().to_string();
    assert!(Command::new("kill").args(["-s", "INT", &process]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let report = json(&out.join("report.json"));
    let rows = report["frames"].as_array().unwrap();
    assert_eq!((&rows[0]["reason"], &rows[1]["status"]), (&"replaced".into(), &"accepted".into()));
    assert_eq!(json(&out.join("capture.json"))["frames"].as_array().unwrap().len(), 1);
    // The maps are those of the second photograph alone.
    let alone = dir.path().join("alone");
    succeed(&[&["fit", text(&out), "--out", text(&alone)][..], &FAST[2..7]].concat());
    assert_eq!(Some(fs::read(alone.join("maps.exr")).unwrap()), first);
}

#[test]
fn photographs_are_taken_as_they_arrive() {
    let dir = tempfile::tempdir().unwrap();
    let shots = &*SHOTS;
    let (incoming, out) = (dir.path().join("incoming"), dir.path().join("out"));
    fs::create_dir(&incoming).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_svbrdf"))
        .args(["fit", "--watch", text(&incoming), "--out", text(&out), "--log", "json"])
        .args(&FAST[..7])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut until = |name: &str| loop {
        let event: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        if event["event"] == name {
            break event;
        }
    };
    let photo = |name: &str, shot: &RgbImage| {
        let path = dir.path().join(name);
        Written::default().save(&path, shot);
        fs::read(path).unwrap()
    };
    // Each in one piece: a file that does not grow for a moment counts as complete.
    let put = |name: &str, bytes: &[u8]| {
        let whole = dir.path().join("whole");
        fs::write(&whole, bytes).unwrap();
        fs::rename(whole, incoming.join(name)).unwrap();
    };
    put("one.jpg", &photo("one.jpg", &shots[0]));
    assert_eq!(until("photo")["status"], "accepted");
    assert_eq!(until("maps")["photographs"], 1);
    let first = fs::read(out.join("maps.exr")).unwrap();
    // Somebody tidies up; a picture of another format, under another name.
    let aside = dir.path().join("aside.jpg");
    fs::rename(incoming.join("one.jpg"), &aside).unwrap();
    put("x.jpg", b"\0\0\0\x18ftypavif\0\0\0\0mif1avif");
    let left_out = until("left_out");
    assert!(left_out["reason"].as_str().unwrap().contains("an AVIF picture"), "{left_out}");
    // A file that stands still halfway is refused, and taken when the rest has come.
    let bytes = photo("two.jpg", &shots[1]);
    put("two.jpg", &bytes[..bytes.len() / 2]);
    assert_eq!(until("photo")["reason"], "unreadable");
    put("two.jpg", &bytes);
    assert_eq!(until("photo")["status"], "accepted");
    assert_eq!(until("maps")["photographs"], 2);
    let process = child.id().to_string();
    assert!(Command::new("kill").args(["-s", "INT", &process]).status().unwrap().success());
    assert_eq!(until("failed")["status"], 130);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let second = fs::read(out.join("maps.exr")).unwrap();
    assert_ne!(first, second);
    assert_eq!(json(&out.join("capture.json"))["frames"].as_array().unwrap().len(), 2);
    assert_eq!(json(&out.join("report.json"))["interrupted"], false);
    fs::rename(aside, incoming.join("one.jpg")).unwrap();
    let again = dir.path().join("again");
    let settings = &FAST[2..7];
    succeed(&[&["fit", text(&out), "--out", text(&again)][..], settings].concat());
    assert_eq!(fs::read(again.join("maps.exr")).unwrap(), second);
}
