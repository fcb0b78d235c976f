//! Commands in the documents: those of a first hour run as they stand; of all others, programs, files,
//! targets, options and values exist.

#[path = "../../tests/common/commands.rs"]
mod commands;
mod common;

use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::Command;

use commands::{commands, documents, understood};
use common::{maps, succeed, text};

/// Packages of the workspace.
const PACKAGES: [&str; 6] =
    ["svbrdf", "svbrdf-cli", "svbrdf-eval", "svbrdf-ffi", "svbrdf-models", "svbrdf-opencv-oracle"];
/// Programs of others, which are taken as they are.
const ELSEWHERE: [&str; 10] =
    ["cc", "cd", "cmake", "conan", "gradle", "python", "rustup", "sbatch", "vcpkg", "heif-convert"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Targets that a cargo command names.
fn cargo_faults(arguments: &[&str]) -> Option<String> {
    let exists = |path: String| root().join(path).exists();
    for pair in arguments.windows(2) {
        let (option, name) = (pair[0], pair[1]);
        let found = match option {
            "--example" => exists(format!("examples/{name}.rs")),
            "--bench" => exists(format!("benches/{name}.rs")),
            "--test" => {
                ["tests", "ffi/tests", "cli/tests", "benches/eval/tests"].iter().any(|folder| {
                    exists(format!("{folder}/{name}.rs"))
                        || exists(format!("{folder}/{name}/main.rs"))
                })
            }
            "--bin" => ["svbrdf", "svbrdf-eval"].contains(&name),
            "--path" => exists(name.to_owned()),
            "-p" | "--exclude" => PACKAGES.contains(&name),
            "--profile" => {
                let text = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
                text.contains(&format!("[profile.{name}]"))
            }
            _ => true,
        };
        if !found {
            return Some(format!("{option} {name} does not exist"));
        }
    }
    None
}

/// The fault of a command, if it has one.
fn fault(command: &str) -> Option<String> {
    let words = command.split_whitespace().skip_while(|word| {
        // SVBRDF_SHARE=0 and the like.
        word.split_once('=').is_some_and(|(name, _)| {
            name.chars().all(|c| c.is_ascii_uppercase() || c == '_') && !name.is_empty()
        })
    });
    let words: Vec<&str> = words.collect();
    let (program, arguments) = words.split_first()?;
    match *program {
        "svbrdf" => understood(env!("CARGO_BIN_EXE_svbrdf"), arguments).err(),
        // Its own tests check its arguments.
        "svbrdf-eval" => None,
        "cargo" => cargo_faults(arguments),
        path if path.contains('/') => {
            let mode = std::fs::metadata(root().join(path)).map(|file| file.permissions().mode());
            match mode {
                Ok(mode) if mode & 0o100 != 0 => None,
                Ok(_) => Some("is not executable".into()),
                Err(error) => Some(error.to_string()),
            }
        }
        other if ELSEWHERE.contains(&other) => None,
        _ => Some("is no program that the documents may name".into()),
    }
}

#[test]
fn commands_of_the_documents_exist() {
    let mut faults = Vec::new();
    let mut checked = 0;
    for (document, commands) in documents(root()) {
        for command in commands {
            checked += 1;
            if let Some(what) = fault(&command) {
                faults.push(format!("{document}: `{command}`: {what}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(checked > 60, "{checked} commands");
}

#[test]
fn wrong_commands_are_seen() {
    let block =
        "x\n```sh\nA=1 svbrdf fit a \\\n  --out b   # why\n\n# only words\ncd x && make y\n```\n";
    assert_eq!(commands(block), ["A=1 svbrdf fit a    --out b", "cd x", "make y"]);
    for (command, expected) in [
        ("svbrdf fit capture --out maps --resolution 512", ""),
        ("svbrdf fit capture --out maps --resolution 300", "300"),
        ("svbrdf fit capture --outt maps", "--outt"),
        ("svbrdf fitt capture", "fitt"),
        ("cargo run --release --example evaluate_captures -- X", "evaluate_captures"),
        ("cargo run --release --bin svbrdf-evil -- photos DIR", "svbrdf-evil"),
        ("cargo build --profile fast", "fast"),
        ("tests/run.sh --quick", ""),
        ("tests/walk.sh", "No such file"),
        ("Cargo.toml/x", "Not a directory"),
        ("make all", "no program"),
    ] {
        let said = fault(command).unwrap_or_default();
        assert_eq!(said.is_empty(), expected.is_empty(), "{command}: {said}");
        assert!(said.contains(expected), "{command}: {said}");
    }
}

/// The commands of a first hour, in their order: README and quick start.
#[test]
fn the_first_hour_runs() {
    let dir = tempfile::tempdir().unwrap();
    symlink(root().join("examples"), dir.path().join("examples")).unwrap();
    // Photographs of the default board round a sample, as a reader would take them.
    let source = dir.path().join("source");
    svbrdf::export::write_maps(&source, &maps(32), &svbrdf::export::MapsOptions::default())
        .unwrap();
    let taken = dir.path().join("taken");
    let frames = ["--frames", "2", "--jpeg", "92"];
    succeed(&[&["simulate", text(&source), "--out", text(&taken)][..], &frames].concat());
    std::fs::rename(taken.join("frames"), dir.path().join("photos")).unwrap();
    for (document, commands) in documents(root()) {
        if document != "README.md" && document != "docs/quick-start.md" {
            continue;
        }
        let mut ran = 0;
        for command in commands.iter().filter(|command| command.starts_with("svbrdf ")) {
            let arguments: Vec<&str> = command.split_whitespace().skip(1).collect();
            let mut expanded: Vec<String> = Vec::new();
            for argument in arguments {
                match argument.strip_suffix("/*.jpg") {
                    Some(folder) => {
                        let entries = std::fs::read_dir(dir.path().join(folder)).unwrap();
                        let names = entries.map(|entry| entry.unwrap().file_name());
                        expanded.extend(names.map(|n| format!("{folder}/{}", n.to_str().unwrap())));
                    }
                    None => expanded.push(argument.to_owned()),
                }
            }
            let mut run = Command::new(env!("CARGO_BIN_EXE_svbrdf"));
            let output = run.args(&expanded).current_dir(dir.path()).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{document}: {command}: {said}");
            let out = expanded.iter().position(|argument| argument == "--out").unwrap();
            let made = dir.path().join(&expanded[out + 1]);
            assert!(made.exists(), "{document}: {command}: {} is missing", made.display());
            ran += 1;
        }
        assert!(ran >= 3, "{document}: {ran} commands");
        for file in ["maps/report.html", "maps/normal.png", "material/material.glb", "board.pdf"] {
            assert!(dir.path().join(file).is_file(), "{document}: {file}");
        }
    }
}
