//! `report.html`, photographs held out, and the files of an interrupted fit.

mod common;

use std::path::{Path, PathBuf};

use common::{failure, maps, names, succeed, text};
use serde_json::Value;

/// A capture of known maps.
fn capture(dir: &Path, frames: &str) -> PathBuf {
    let (source, out) = (dir.join("maps"), dir.join("capture"));
    svbrdf::export::write_maps(&source, &maps(32), &svbrdf::export::MapsOptions::default())
        .unwrap();
    succeed(&["simulate", text(&source), "--out", text(&out), "--frames", frames]);
    out
}

/// Options of a fit that takes a second.
const FAST: [&str; 4] = ["--steps", "3", "--quiet", "--no-refine"];

fn fit(capture: &Path, out: &Path, options: &[&str]) {
    succeed(&[&["fit", text(capture), "--out", text(out)][..], &FAST, options].concat());
}

fn report(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap()
}

/// The data of the page, as its scripts see them.
fn data(page: &str) -> Value {
    let (_, rest) = page.split_once("id=\"data\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn the_page_holds_what_it_shows_and_loads_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path(), "3");
    // One photograph is bad: the page says why.
    std::fs::write(capture.join("frames/01.png"), b"no picture").unwrap();
    let out = dir.path().join("out");
    fit(&capture, &out, &[]);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
    for (at, _) in page.match_indices("http") {
        let address: String = page[at..].chars().take(26).collect();
        let allowed = address == "http://www.w3.org/2000/svg" || address.starts_with("http-equiv");
        assert!(allowed, "{address}");
    }
    for loads in ["<link rel=\"stylesheet", "<iframe", "<script src", "@import", "url("] {
        assert!(!page.contains(loads), "{loads}");
    }
    let data = data(&page);
    let photographs = data["photographs"].as_array().unwrap();
    let status: Vec<_> = photographs.iter().map(|p| p["status"].as_str().unwrap()).collect();
    assert_eq!(status, ["accepted", "rejected", "accepted"]);
    for p in photographs {
        let seen = p["status"] == "accepted";
        assert_eq!(p["thumbnail"].is_object(), seen);
        assert_eq!(p["outlines"].is_object(), seen);
    }
    assert!(photographs[1]["hint"].as_str().unwrap().contains("01.png"));
    assert_eq!(data["snapshots"].as_array().unwrap().len(), 1, "after one of two photographs");
    assert_eq!(data["presets"].as_array().unwrap().len(), 4);
    let warnings = data["warnings"].to_string();
    assert!(warnings.contains("1 of 3 photographs rejected"), "{warnings}");
    assert!(warnings.contains("Few photographs"), "{warnings}");

    fit(&capture, &dir.path().join("without"), &["--no-report"]);
    assert!(!names(&dir.path().join("without")).contains(&"report.html".to_owned()));
}

/// The outlines are where the photograph has them: the simulated board is white paper with black
/// squares, the sample's rectangle lies in its hole.
#[test]
fn outlines_lie_inside_of_the_photograph_and_of_each_other() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path(), "2");
    let out = dir.path().join("out");
    fit(&capture, &out, &[]);
    let data = data(&std::fs::read_to_string(out.join("report.html")).unwrap());
    for p in data["photographs"].as_array().unwrap() {
        let points = |name: &str| -> Vec<[f64; 2]> {
            serde_json::from_value(p["outlines"][name].clone()).unwrap()
        };
        let (board, sample) = (points("board"), points("sample"));
        let area = |polygon: &[[f64; 2]]| {
            let next = polygon.iter().cycle().skip(1);
            polygon.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
        };
        // Clockwise on the screen, as seen from above.
        assert!(area(&sample) > 0.01 && area(&board) > 1.3 * area(&sample));
        assert!(board.iter().flatten().all(|v| (0.0..=1.0).contains(v)), "{board:?}");
        let inside = |q: &[f64; 2]| {
            let next = board.iter().cycle().skip(1);
            board
                .iter()
                .zip(next)
                .all(|(a, b)| (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]) > 0.0)
        };
        assert!(sample.iter().all(inside), "{sample:?} in {board:?}");
    }
}

#[test]
fn photographs_held_out_are_predicted_and_not_fitted() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path(), "5");
    // Neither the first nor a photograph that cannot be used counts among the last ones.
    std::fs::write(capture.join("frames/03.png"), b"no picture").unwrap();
    let (held, plain) = (dir.path().join("held"), dir.path().join("plain"));
    fit(&capture, &held, &["--hold-out", "2"]);
    fit(&capture, &plain, &["--frames", "2"]);
    let bytes = |dir: &Path| std::fs::read(dir.join("maps.exr")).unwrap();
    assert_eq!(bytes(&held), bytes(&plain), "the maps are those of the photographs fitted");

    let report = report(&held);
    let found = &report["held_out"];
    assert_eq!(found["photographs"], serde_json::json!([2, 4]));
    let after = found["after"].as_array().unwrap();
    assert_eq!(after.iter().map(|a| a["fitted"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2]);
    for (row, a) in after.iter().enumerate() {
        let each: Vec<f64> = serde_json::from_value(a["each"].clone()).unwrap();
        let mean = a["error"].as_f64().unwrap();
        assert!((mean - each.iter().sum::<f64>() / 2.0).abs() < 1e-12, "{row}");
        // Stripes of albedo 0.2 and 0.6 predicted by their mean would err by 0.15.
        assert!(each.iter().all(|e| (0.001..0.12).contains(e)), "{each:?}");
        // Such errors are some units of colour difference.
        assert!((0.05..20.0).contains(&a["delta_e00"].as_f64().unwrap()), "{row}");
    }
    // Simulated exposures are equal: the factor on brightness has little to do.
    for factor in found["brightness"].as_array().unwrap() {
        assert!((factor.as_f64().unwrap() - 1.0).abs() < 0.15, "{factor}");
    }
    let frames = report["frames"].as_array().unwrap();
    let index: Vec<u64> = frames.iter().map(|f| f["index"].as_u64().unwrap()).collect();
    assert_eq!(index, [0, 1, 2, 3, 4]);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame["status"], if i == 3 { "rejected" } else { "accepted" });
        assert_eq!(frame["held_out_error"].is_number(), i == 2 || i == 4);
        assert_eq!(frame["loss_after"].is_number(), i < 2);
        assert_eq!(frame["rotation"].is_array(), i != 3);
    }
    let data = data(&std::fs::read_to_string(held.join("report.html")).unwrap());
    assert_eq!(data["predictions"].as_array().unwrap().len(), 2);

    let out = dir.path().join("none");
    let all = ["fit", text(&capture), "--out", text(&out), "--hold-out", "4", "--quiet"];
    let (status, message) = failure(&all);
    assert_eq!(status, 2, "{message}");
    assert!(message.contains("--hold-out 4") && message.contains("4 photos"), "{message}");
    assert_eq!(names(&out), [""; 0]);
}

#[cfg(unix)]
mod interrupted {
    use super::*;
    use std::io::{BufRead, BufReader, Read};
    use std::process::{Command, Stdio};
    use std::time::Duration;

    /// Photographs of a fit that takes many minutes: no signal comes too late for it.
    const MANY: usize = 400;

    /// The bundled capture, its photographs again and again.
    fn endless(dir: &Path) -> PathBuf {
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/captures/tile");
        let text = std::fs::read_to_string(bundled.join("capture.json")).unwrap();
        let mut description: Value = serde_json::from_str(&text).unwrap();
        let frames = description["frames"].as_array().unwrap().clone();
        description["frames"] = frames.iter().cycle().take(MANY).cloned().collect();
        let capture = dir.join("endless");
        std::fs::create_dir(&capture).unwrap();
        std::fs::write(capture.join("capture.json"), description.to_string()).unwrap();
        std::os::unix::fs::symlink(bundled.join("frames"), capture.join("frames")).unwrap();
        capture
    }

    /// Fits a capture and sends a signal once `after` photographs are done: exit status, standard error from
    /// then on.
    fn fit_until(capture: &Path, out: &Path, signal: &str, after: usize) -> (Option<i32>, String) {
        let mut child = Command::new(env!("CARGO_BIN_EXE_svbrdf"))
            .args(["fit", text(capture), "--out", text(out)])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut errors = BufReader::new(child.stderr.take().unwrap());
        for _ in 0..after {
            let mut line = String::new();
            errors.read_line(&mut line).unwrap();
            assert!(line.contains("accepted"), "{line}");
        }
        let process = child.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &process]).status().unwrap().success());
        let mut rest = String::new();
        errors.read_to_string(&mut rest).unwrap();
        (child.wait().unwrap().code(), rest)
    }

    #[test]
    fn a_fit_ends_in_order_with_what_is_there() {
        let dir = tempfile::tempdir().unwrap();
        let capture = endless(dir.path());
        for signal in ["INT", "TERM"] {
            let out = dir.path().join(signal);
            let (status, said) = fit_until(&capture, &out, signal, 1);
            assert_eq!(status, Some(130), "{said}");
            assert!(said.contains("interrupted: "), "{said}");
            // A second photograph that was in time adds its classes.
            let mut files = names(&out);
            files.retain(|name| name != "class.png");
            assert_eq!(
                files,
                [
                    "diffuse.png",
                    "maps.exr",
                    "normal.png",
                    "preview.png",
                    "report.html",
                    "report.json",
                    "roughness.png",
                    "specular.png"
                ]
            );
            let report = report(&out);
            assert_eq!(report["interrupted"], true);
            let frames = report["frames"].as_array().unwrap().len();
            assert!((1..MANY).contains(&frames), "{frames} of {MANY} photographs");
            svbrdf::export::read_maps(&out).unwrap();
            let page = std::fs::read_to_string(out.join("report.html")).unwrap();
            assert!(data(&page)["warnings"].to_string().contains("Interrupted"));
        }
    }

    #[test]
    fn a_fit_that_ends_before_its_first_photograph_writes_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let (capture, all_but_one) = (endless(dir.path()), (MANY - 1).to_string());
        let mut child = Command::new(env!("CARGO_BIN_EXE_svbrdf"))
            .args(["fit", text(&capture), "--out", text(&out), "--hold-out", &all_but_one])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // The folder is there once signals are listened to.
        while !out.exists() {
            assert_eq!(child.try_wait().unwrap(), None);
            std::thread::sleep(Duration::from_millis(1));
        }
        let process = child.id().to_string();
        assert!(Command::new("kill").args(["-s", "INT", &process]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(130), "{said}");
        assert!(said.contains("nothing is written"), "{said}");
        assert_eq!(names(&out), [""; 0]);
    }
}
