//! C and C++ clients of the shared library, compiled with warnings as errors, run plainly, under
//! AddressSanitizer and UndefinedBehaviorSanitizer, and under valgrind.
#![cfg(target_os = "linux")]

mod abi;
mod common;
mod examples;
mod packaging;

use std::path::Path;
use std::process::Command;

use common::{Build, has, library, root, run, workplace, write_photos};
use engine::board_sheet::{BoardSheet, Paper, SheetFormat};
use engine::calibration::{Target, TargetKind};
use engine::capture::Capture;
use engine::export::read_maps;
use engine::session::{Outcome, Session, Settings};

fn client(program: &Path, test: &str, dir: &Path) -> Command {
    let mut command = Command::new(program);
    command.arg(test).arg(dir);
    command
}

const C: Build = Build { compiler: "gcc", language: "c", sanitized: false };
const CPP: Build = Build { compiler: "g++", language: "cpp", sanitized: false };
const SANITIZED_C: Build = Build { sanitized: true, ..C };
const SANITIZED_CPP: Build = Build { sanitized: true, ..CPP };

#[test]
fn clients_compile_without_warnings_and_handle_bad_arguments() {
    let dir = workplace();
    let mut compiled = 0;
    let clang = [Build { compiler: "clang", ..C }, Build { compiler: "clang++", ..CPP }];
    for build in [C, CPP].into_iter().chain(clang) {
        if has(build.compiler) {
            let program = build.program();
            run(&mut client(&program, "bad-arguments", dir.path()));
            run(client(&program, "state", dir.path()).env("SVBRDF_TEST_QUICK", "1"));
            compiled += 1;
        }
    }
    assert!(compiled > 0, "no compiler at all");
}

#[test]
fn a_c_client_gets_the_maps_that_the_rust_library_finds() {
    let dir = workplace();
    write_photos(dir.path(), 1);
    let program = C.program();
    run(&mut client(&program, "board", dir.path()));
    for file in ["normal.png", "diffuse.png", "specular.png", "roughness.png", "preview.png"] {
        assert!(dir.path().join("maps").join(file).is_file(), "{file}");
    }
    let capture = Capture::load(root().join("examples/captures/tile")).unwrap();
    let settings = Settings { sample_mm: capture.sample_mm, threads: 2, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings).unwrap();
    let outcome = session.add_photo(&capture.photos[0].read().unwrap()).unwrap();
    assert!(matches!(outcome, Outcome::Accepted(_)));
    session.wait().unwrap();
    let (found, expected) =
        (read_maps(dir.path().join("maps")).unwrap(), session.snapshot().unwrap());
    let pairs = found.planes().iter().zip(expected.planes());
    let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // The same to the bit, but for slopes, which went through unit normals.
    assert!(difference < 1e-5, "{difference}");
}

#[test]
fn a_photo_in_every_layout_gives_the_same_pose() {
    let dir = workplace();
    write_photos(dir.path(), 1);
    let program = C.program();
    run(&mut client(&program, "layouts", dir.path()));
}

#[test]
fn photos_are_told_about() {
    let dir = workplace();
    write_photos(dir.path(), 2);
    let program = SANITIZED_C.program();
    run(&mut client(&program, "feedback", dir.path()));
    run(&mut client(&program, "looked-at", dir.path()));
}

#[test]
fn maps_are_shown_and_boards_printed() {
    let dir = workplace();
    let program = SANITIZED_C.program();
    run(&mut client(&program, "outputs", dir.path()));
    let kind = TargetKind::CharucoRing { dictionary: "DICT_4X4_250".into(), marker_mm: 8.0 };
    let charuco = Target { kind, ..Target::default() };
    for (file, target, paper, format) in [
        ("board.pdf", &Target::default(), Paper::A4, SheetFormat::Pdf),
        ("board.svg", &charuco, Paper::Letter, SheetFormat::Svg),
        ("board.png", &charuco, Paper::A4, SheetFormat::Png),
    ] {
        let expected = BoardSheet::new(target, paper).unwrap().encode(format).unwrap();
        assert!(std::fs::read(dir.path().join(file)).unwrap() == expected, "{file}");
    }
}

#[test]
fn maps_with_optional_lobes_are_taken_shown_and_written() {
    let dir = workplace();
    run(&mut client(&SANITIZED_C.program(), "lobes", dir.path()));
    let maps = read_maps(dir.path().join("lobes")).unwrap();
    let [x, y] = maps.anisotropy().unwrap();
    // Of the last texel, by hand: the ratio of alphas from roughness 0.43 and strength 0.46, turned by 1.875.
    let alpha = 0.43_f32.powi(2);
    let log_ratio = (1.0 + 0.46_f32.powi(2) * (1.0 - alpha) / alpha).ln();
    let (sin, cos) = (2.0 * 1.875_f32).sin_cos();
    let (x, y) = (x.last().unwrap(), y.last().unwrap());
    assert!((x - log_ratio * cos).hypot(y - log_ratio * sin) < 1e-3, "{x} {y}");
    let [weight, roughness] = maps.coat().unwrap().map(|plane| plane.last().unwrap());
    assert!(*weight == 0.5 && (roughness - 0.3).abs() < 1e-6, "{weight} {roughness}");
    let [r, g, b, roughness] = maps.sheen().unwrap().map(|plane| plane.last().unwrap());
    assert!([*r, *g, *b] == [0.2, 0.4, 0.6] && (roughness - 0.76).abs() < 1e-6);
}

#[test]
fn photos_are_added_without_waiting() {
    let dir = workplace();
    write_photos(dir.path(), 1);
    let program = SANITIZED_C.program();
    run(&mut client(&program, "flow", dir.path()));
}

#[test]
fn a_cpp_client_streams_a_capture() {
    if !has("g++") {
        return;
    }
    let dir = workplace();
    write_photos(dir.path(), 2);
    let program = CPP.program();
    run(&mut client(&program, "board", dir.path()));
    run(&mut client(&program, "handles", dir.path()));
}

#[test]
fn sanitizers_find_nothing() {
    let dir = workplace();
    for (build, tests) in [
        (
            SANITIZED_C,
            &[
                "bad-arguments",
                "maps",
                "inputs",
                "lifecycle",
                "threads",
                "races",
                "progress",
                "state",
                "capture",
            ][..],
        ),
        (
            SANITIZED_CPP,
            &[
                "bad-arguments",
                "handles",
                "lobes",
                "state",
                "capture",
                "destroyed-inside",
                "pixel-formats",
            ][..],
        ),
    ] {
        let program = build.program();
        let symbols = run(Command::new("nm").arg("-D").arg(&program));
        assert!(
            String::from_utf8_lossy(&symbols.stdout).contains("__asan_init"),
            "{build:?} did not link AddressSanitizer"
        );
        for test in tests {
            run(&mut client(&program, test, dir.path()));
        }
    }
}

fn under_valgrind(test: &str, quick: bool) {
    if !has("valgrind") {
        return;
    }
    let dir = workplace();
    let program = C.program();
    let mut command = Command::new("valgrind");
    command
        // Without it one of the library's threads may keep the others from running.
        .arg("--fair-sched=yes")
        .args(["--quiet", "--error-exitcode=9", "--leak-check=full"])
        .args(["--errors-for-leak-kinds=definite", "--show-leak-kinds=definite"])
        .arg(&program)
        .arg(test)
        .arg(dir.path());
    if quick {
        command.env("SVBRDF_TEST_QUICK", "1");
    }
    run(&mut command);
}

#[test]
fn valgrind_finds_nothing() {
    under_valgrind("bad-arguments", true);
    under_valgrind("lifecycle", true);
    under_valgrind("state", true);
}

#[test]
#[ignore = "takes ten minutes and more: the networks run under valgrind"]
fn valgrind_finds_nothing_in_photos_and_maps() {
    under_valgrind("maps", false);
}

#[test]
fn only_the_headers_functions_are_exported() {
    let listed = run(Command::new("nm").args(["-D", "--defined-only"]).arg(library()));
    let listed = String::from_utf8(listed.stdout).unwrap();
    let mut symbols: Vec<&str> =
        listed.lines().filter_map(|line| line.split_whitespace().last()).collect();
    symbols.sort_unstable();
    let listed = include_str!("../../symbols.txt").lines();
    let mut listed: Vec<_> = listed.filter(|line| line.starts_with("svbrdf_")).collect();
    listed.sort_unstable();
    assert_eq!(symbols, listed);
    let header = std::fs::read_to_string(root().join("include/svbrdf.h")).unwrap();
    for symbol in symbols {
        assert!(header.contains(&format!("{symbol}(")), "{symbol} is not in the header");
    }
    let dynamic = run(Command::new("readelf").arg("-d").arg(library()));
    let dynamic = String::from_utf8_lossy(&dynamic.stdout).into_owned();
    assert!(dynamic.contains("[libsvbrdf.so.0]"), "{dynamic}");
    assert!(dynamic.contains("NODELETE"), "{dynamic}");
}

/// Loaded by hand and unloaded while threads that called it go on.
#[test]
fn the_library_outlives_its_unloading() {
    if !has("gcc") {
        return;
    }
    let dir = workplace();
    let program = dir.path().join("unload");
    run(Command::new("gcc")
        .args(["-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(root().join("include"))
        .arg(root().join("ffi/tests/clients/unload.c"))
        .args(["-ldl", "-lpthread", "-o"])
        .arg(&program));
    let capture = root().join("examples/captures/tile");
    run(Command::new(program).arg(dir.path().join("libsvbrdf.so")).arg(capture));
}
