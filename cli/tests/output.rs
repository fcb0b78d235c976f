//! Files after closed streams, killed runs, and names of the wrong kind.
#![cfg(unix)]

mod common;

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use common::{failure, maps, names, succeed, text};
use serde_json::Value;
use svbrdf::export::{MapsOptions, write_maps};

/// A rectified capture of one small photograph.
fn capture(dir: &Path) -> PathBuf {
    let (source, out) = (dir.join("source"), dir.join("capture"));
    write_maps(&source, &maps(32), &MapsOptions::default()).unwrap();
    succeed(&["simulate", text(&source), "--out", text(&out), "--frames", "1", "--rectified"]);
    out
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_svbrdf"));
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Whether `report.json` is there and every file that it names is as it says.
fn is_complete(out: &Path) -> bool {
    let Ok(report) = fs::read(out.join("report.json")) else { return false };
    let report: Value = serde_json::from_slice(&report).unwrap();
    let files = report["files"].as_object().unwrap();
    assert!(files.len() >= 6, "{files:?}");
    for (name, known) in files {
        let bytes = fs::read(out.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        let hash = sha256(&bytes);
        assert_eq!(
            (known["bytes"].as_u64(), known["sha256"].as_str()),
            (Some(bytes.len() as u64), Some(hash.as_str())),
            "{name}"
        );
    }
    true
}

fn sha256(bytes: &[u8]) -> String {
    use sha2::{Digest, Sha256};
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A stream whose reader has gone away, or one whose disk is full.
fn streams() -> [(&'static str, Stdio); 2] {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let full = File::options().write(true).open("/dev/full").unwrap();
    [("closed", writer.into()), ("full", full.into())]
}

#[test]
fn streams_that_are_closed_or_full_cost_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let capture = capture(dir.path());
    let fast = ["--steps", "2", "--no-report", "--out"];
    for (name, stream) in streams() {
        let out = dir.path().join(format!("err-{name}"));
        let arguments = [&["fit", text(&capture)][..], &fast, &[text(&out)]].concat();
        assert_eq!(command(&arguments).stderr(stream).status().unwrap().code(), Some(0), "{name}");
        assert!(is_complete(&out), "{name}");
    }
    for (name, stream) in streams() {
        let out = dir.path().join(format!("out-{name}"));
        let arguments =
            [&["fit", text(&capture), "--log", "json"][..], &fast, &[text(&out)]].concat();
        assert_eq!(command(&arguments).stdout(stream).status().unwrap().code(), Some(0), "{name}");
        assert!(is_complete(&out), "{name}");
    }
    // Standard output is their only result: a full disk is a failure, a reader that leaves early is not.
    let source = dir.path().join("source");
    let board = dir.path().join("board.svg");
    for arguments in [["compare", text(&source), text(&source)], ["board", "--out", text(&board)]] {
        for (name, stream) in streams() {
            let mut run = command(&arguments);
            let output = run.stdout(stream).stderr(Stdio::piped()).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            let expected = if name == "full" { 1 } else { 0 };
            assert_eq!(output.status.code(), Some(expected), "{name}: {said}");
            assert_eq!(said.contains("standard output"), name == "full", "{said}");
        }
    }
    assert!(board.is_file());
    for (name, stream) in streams() {
        let status = command(&["compare", "nowhere", "nowhere"]).stderr(stream).status().unwrap();
        assert_eq!(status.code(), Some(2), "{name}");
    }
}

/// Runs into a complete folder are killed at all times: a report is there only with its own maps.
#[test]
fn killed_runs_leave_no_report_beside_other_maps() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, out) = (capture(dir.path()), dir.path().join("out"));
    let fit = |method: &str, extra: &[&str]| {
        let fixed =
            ["fit", text(&capture), "--out", text(&out), "--steps", "2", "--export", "unreal"];
        command(&[&fixed[..], &["--method", method], extra].concat())
    };
    let begun = std::time::Instant::now();
    assert_eq!(fit("deep", &[]).status().unwrap().code(), Some(0));
    let whole = begun.elapsed();
    assert!(is_complete(&out));
    let mut left = 0;
    for i in 0..14 {
        let mut child = fit("classic", &["--no-report"]).spawn().unwrap();
        std::thread::sleep(whole.mul_f64(0.1 * f64::from(i)));
        // It may have ended.
        let _ = child.kill();
        child.wait().unwrap();
        is_complete(&out);
        let page = out.join("report.html").exists();
        let report = fs::read_to_string(out.join("report.json")).unwrap_or_default();
        assert!(!page || !report.contains("classic"), "the page is of the other fit");
        left = left.max(temporaries(&out));
    }
    println!("at most {left} temporary files were left");
    assert_eq!(fit("classic", &["--no-report"]).status().unwrap().code(), Some(0));
    assert!(is_complete(&out) && temporaries(&out) == 0, "{:?}", names(&out));

    // `--skip-existing` accepts only the complete set of unchanged files.
    let skip = || {
        let output = fit("classic", &["--no-report", "--skip-existing", "--log", "json"])
            .stdout(Stdio::piped())
            .output()
            .unwrap();
        String::from_utf8_lossy(&output.stdout).contains("\"skipped\"")
    };
    assert!(skip());
    let exported = out.join("unreal/orm.png");
    let mut bytes = fs::read(&exported).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&exported, bytes).unwrap();
    assert!(!skip() && skip());
    fs::write(out.join("report.json"), "{}").unwrap();
    assert!(!skip() && skip());
}

/// Temporary files in a folder and those inside.
fn temporaries(dir: &Path) -> usize {
    let entries = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path());
    entries
        .map(|path| {
            if path.is_dir() {
                temporaries(&path)
            } else {
                usize::from(path.extension().is_some_and(|e| e == "tmp"))
            }
        })
        .sum()
}

/// A rectified capture of one small photograph, `times` times.
fn repeated(dir: &Path, times: usize) -> PathBuf {
    let capture = capture(dir);
    let file = capture.join("capture.json");
    let mut description: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    let frame = description["frames"][0].clone();
    description["frames"] = vec![frame; times].into();
    fs::write(file, description.to_string()).unwrap();
    capture
}

/// A closed terminal ends a fit in order; under `nohup` it does not.
#[test]
fn a_closed_terminal_ends_a_fit_in_order() {
    // A fit of so many photographs takes minutes: no signal comes too late for it.
    for (ignored, photographs) in [(false, 400), (true, 3)] {
        let dir = tempfile::tempdir().unwrap();
        let capture = repeated(dir.path(), photographs);
        let out = dir.path().join(if ignored { "ignored" } else { "heard" });
        // A run under `nohup` would hand its ignored signal on to this test.
        let start = if ignored {
            ["sh", "-c", "trap '' HUP; exec \"$@\"", "sh"].as_slice()
        } else {
            &["env", "--default-signal=HUP"]
        };
        let mut child = Command::new(start[0])
            .args(&start[1..])
            .arg(env!("CARGO_BIN_EXE_svbrdf"))
            .args(["fit", text(&capture), "--out", text(&out), "--log", "json", "--steps", "60"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut events = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        while !line.contains("\"photo\"") {
            line.clear();
            assert!(events.read_line(&mut line).unwrap() > 0, "no photo");
        }
        let process = child.id().to_string();
        assert!(Command::new("kill").args(["-s", "HUP", &process]).status().unwrap().success());
        std::io::copy(&mut events.by_ref(), &mut std::io::sink()).unwrap();
        let expected = if ignored { 0 } else { 130 };
        assert_eq!(child.wait().unwrap().code(), Some(expected), "ignored: {ignored}");
        assert!(is_complete(&out));
        let report: Value =
            serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
        assert_eq!(report["interrupted"], !ignored);
    }
}

#[test]
fn names_of_the_wrong_kind_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let (file, folder, source) = (at("file"), at("folder"), at("source"));
    fs::write(&file, b"mine").unwrap();
    fs::create_dir(&folder).unwrap();
    write_maps(&source, &maps(8), &MapsOptions::default()).unwrap();
    let (file, folder, source) = (text(&file), text(&folder), text(&source));
    let position = ["--camera-mm", "0,0,9", "--light-mm", "0,0,9", "--out"];
    for (arguments, expected) in [
        (vec!["fit", source, "--out", file], "a folder"),
        (vec!["export", source, "--format", "glb", "--out", file], "a folder"),
        (vec!["simulate", source, "--out", file], "a folder"),
        ([&["render", source][..], &position, &[folder]].concat(), "the name of a file"),
        (vec!["board", "--out", folder], "the name of a file"),
        (vec!["calibrate", folder, "--board", "ring"], "expected photographs"),
        (vec!["fit", source, "--out", folder, "--threads", "65"], "0..=64"),
        (vec!["fit", source, "--out", folder, "--board", "ring:17x16:0.0115"], "lengths are in mm"),
    ] {
        let (status, said) = failure(&arguments);
        assert!(status == 2 && said.contains(expected), "{arguments:?}: {status} {said}");
    }
    assert_eq!(fs::read(file).unwrap(), b"mine");
    assert!(names(Path::new(folder)).is_empty());
}
