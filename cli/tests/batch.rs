//! Many captures in one go: `batch/fit-all.sh`.
#![cfg(unix)]

mod common;

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::SystemTime;

use common::{maps, succeed, text};
use svbrdf::export::{MapsOptions, write_maps};

/// Names that shells take apart.
const NAMES: [&str; 3] = ["a tile", "b $(x) 'y'", "c"];
const FAULTY: &str = "d faulty";

/// A small rectified capture under each name, and one without pictures.
fn captures(dir: &Path) -> PathBuf {
    let (source, captures) = (dir.join("source"), dir.join("captures"));
    write_maps(&source, &maps(32), &MapsOptions::default()).unwrap();
    for name in NAMES {
        let out = captures.join(name);
        succeed(&["simulate", text(&source), "--out", text(&out), "--frames", "1", "--rectified"]);
    }
    fs::create_dir(captures.join(FAULTY)).unwrap();
    captures
}

/// A folder of programs, without GNU parallel.
fn without_parallel(dir: &Path) -> PathBuf {
    let bin = dir.join("bin");
    fs::create_dir(&bin).unwrap();
    for name in
        ["sh", "basename", "cat", "grep", "mkdir", "mktemp", "rm", "tail", "tr", "wc", "xargs"]
    {
        let found =
            ["/usr/bin", "/bin"].iter().map(|d| Path::new(d).join(name)).find(|p| p.exists());
        symlink(found.unwrap_or_else(|| panic!("no {name}")), bin.join(name)).unwrap();
    }
    bin
}

/// Runs the script; some of the environment as pairs.
fn fit_all(captures: &Path, out: &Path, environment: &[(&str, &str)]) -> Output {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("batch/fit-all.sh");
    Command::new(script)
        .args([captures, out])
        .args(["--steps", "2", "--no-report"])
        .env("SVBRDF", env!("CARGO_BIN_EXE_svbrdf"))
        .env("SVBRDF_JOBS", "2")
        .envs(environment.iter().copied())
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn written(out: &Path, name: &str) -> Option<SystemTime> {
    fs::metadata(out.join(name).join("normal.png")).ok()?.modified().ok()
}

#[test]
fn all_captures_are_fitted_and_a_rerun_does_what_is_left() {
    let dir = tempfile::tempdir().unwrap();
    let (captures, out) = (captures(dir.path()), dir.path().join("the maps"));
    let first = fit_all(&captures, &out, &[]);
    assert_eq!(first.status.code(), Some(2), "{}", said(&first));
    assert!(said(&first).contains("d faulty: status 2: "), "{}", said(&first));
    assert!(said(&first).contains("3 of 4 captures are done, 1 are at fault"), "{}", said(&first));
    let times = NAMES.map(|name| written(&out, name).expect(name));
    assert_eq!(written(&out, FAULTY), None);
    assert!(out.join(FAULTY).with_extension("log").is_file() && !out.join(FAULTY).exists());
    // The fault is mended and one result is lost.
    fs::remove_dir(captures.join(FAULTY)).unwrap();
    fs::rename(captures.join(NAMES[2]), captures.join(FAULTY)).unwrap();
    fs::remove_file(out.join(NAMES[1]).join("maps.exr")).unwrap();
    let again = fit_all(&captures, &out, &[]);
    assert_eq!(again.status.code(), Some(0), "{}", said(&again));
    assert!(said(&again).contains("3 of 3 captures are done"), "{}", said(&again));
    assert_eq!(written(&out, NAMES[0]), Some(times[0]), "made again");
    assert!(written(&out, NAMES[1]) > Some(times[1]), "not made again");
    assert!(written(&out, FAULTY).is_some());
}

#[test]
fn shares_of_an_array_do_each_capture_once() {
    let dir = tempfile::tempdir().unwrap();
    let captures = captures(dir.path());
    let path = without_parallel(dir.path());
    let mut found: Vec<&str> = Vec::new();
    for task in ["1", "2"] {
        let out = dir.path().join(task);
        let array = [
            ("SLURM_ARRAY_TASK_ID", task),
            ("SLURM_ARRAY_TASK_MIN", "1"),
            ("SLURM_ARRAY_TASK_COUNT", "2"),
            ("PATH", text(&path)),
        ];
        let output = fit_all(&captures, &out, &array);
        let expected = if task == "1" { 0 } else { 2 };
        assert_eq!(output.status.code(), Some(expected), "{}", said(&output));
        found.extend(NAMES.into_iter().filter(|name| written(&out, name).is_some()));
    }
    found.sort_unstable();
    assert_eq!(found, NAMES);
    let beyond = [("SVBRDF_SHARES", "2"), ("JOB_COMPLETION_INDEX", "2")];
    let output = fit_all(&captures, &dir.path().join("out"), &beyond);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("counted from 0"));
}

#[test]
fn what_is_not_the_captures_fault_asks_for_another_try() {
    let dir = tempfile::tempdir().unwrap();
    let (captures, out) = (captures(dir.path()), dir.path().join("out"));
    // A folder where a map should go.
    fs::create_dir_all(out.join(NAMES[0]).join("normal.png")).unwrap();
    let output = fit_all(&captures, &out, &[]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("2 of 4 captures are done"), "{}", said(&output));
}
