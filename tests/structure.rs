//! The module table: imports inside the library point one way only, and `unsafe` stays where it
//! belongs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Each module of `src/` and the modules it may import. `error` (with its re-exports `Error`,
/// `Rejection`, `Result`, `StateFault`) and `parallel` are open to all.
const TABLE: &[(&str, &[&str])] = &[
    ("error", &[]),
    ("parallel", &[]),
    ("simd", &[]),
    ("geometry", &[]),
    ("svbrdf", &[]),
    ("observation", &["svbrdf"]),
    ("frame", &["geometry"]),
    ("calibration", &["frame", "geometry"]),
    ("rectification", &["calibration", "frame", "geometry", "observation", "svbrdf"]),
    ("reflectance", &["simd", "svbrdf", "observation"]),
    ("loss", &["simd"]),
    ("render", &["reflectance", "loss", "simd", "svbrdf", "observation"]),
    ("network", &["simd", "svbrdf"]),
    ("initial_estimate", &["network", "observation", "svbrdf"]),
    ("latent_fit", &["initial_estimate", "network", "render", "loss", "svbrdf", "observation"]),
    ("refinement", &["reflectance", "render", "loss", "simd", "svbrdf", "observation"]),
    ("light_refinement", &["loss", "observation", "refinement", "render", "svbrdf"]),
    ("propagation", &["observation", "refinement", "render", "svbrdf"]),
    ("completion", &["initial_estimate", "observation", "refinement", "render", "svbrdf"]),
    ("classic", &["render", "loss", "svbrdf", "observation"]),
    ("random", &[]),
    ("comparison", &["observation", "random", "render", "svbrdf"]),
    ("export", &["frame", "render", "svbrdf", "observation"]),
    (
        "session",
        &[
            "calibration",
            "classic",
            "completion",
            "frame",
            "geometry",
            "initial_estimate",
            "latent_fit",
            "light_refinement",
            "network",
            "observation",
            "propagation",
            "rectification",
            "refinement",
            "render",
            "svbrdf",
        ],
    ),
    ("capture", &["calibration", "frame", "geometry", "observation", "rectification", "session"]),
];

/// Files that may say `unsafe`: the SIMD dispatch and the one call into the matrix product.
const UNSAFE: &[&str] = &["simd.rs", "simd/mod.rs", "network/gemm.rs"];

fn sources(dir: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Library sources with comments and test modules removed, by path below `src/`.
fn library() -> BTreeMap<String, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    files
        .into_iter()
        .filter(|path| !path.file_stem().unwrap().to_str().unwrap().ends_with("tests"))
        .map(|path| {
            let text = fs::read_to_string(&path).unwrap();
            let code: String = text
                .lines()
                .take_while(|line| !line.starts_with("#[cfg(test)]"))
                .map(|line| line.split("//").next().unwrap())
                .flat_map(|line| [line, "\n"])
                .collect();
            let name = path.strip_prefix(&root).unwrap().to_str().unwrap().replace('\\', "/");
            (name, code)
        })
        .collect()
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// First path segments after `crate::`, groups `crate::{a, b}` included.
fn imports(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        if code[..at].ends_with(is_word) {
            continue;
        }
        let rest = &code[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let (mut depth, mut start) = (1, true);
            let mut name = String::new();
            for c in group.chars() {
                match c {
                    '{' => depth += 1,
                    '}' => depth -= 1,
                    ',' if depth == 1 => start = true,
                    c if is_word(c) && start && depth == 1 => {
                        name.push(c);
                        continue;
                    }
                    _ => {}
                }
                if !name.is_empty() {
                    found.push(std::mem::take(&mut name));
                    start = c == ',';
                }
                if depth == 0 {
                    break;
                }
            }
        } else {
            found.push(rest.chars().take_while(|&c| is_word(c)).collect());
        }
    }
    found
}

#[test]
fn imports_point_one_way() {
    let table: BTreeMap<_, _> = TABLE.iter().copied().collect();
    let mut faults = Vec::new();
    for (file, code) in library() {
        let module = file.split(['/', '.']).next().unwrap();
        if module == "lib" {
            continue;
        }
        let Some(allowed) = table.get(module) else {
            faults.push(format!("{file}: module {module} is not in the table"));
            continue;
        };
        for import in imports(&code) {
            let own = import == module || import == "error" || import == "parallel";
            let re_exported =
                matches!(import.as_str(), "Error" | "Rejection" | "Result" | "StateFault");
            let name = if import == "Svbrdf" { "svbrdf" } else { import.as_str() };
            if !own && !re_exported && !allowed.contains(&name) && name != module {
                faults.push(format!("{file} imports {import}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_table_points_downward() {
    for (i, (module, allowed)) in TABLE.iter().enumerate() {
        for import in *allowed {
            let j = TABLE.iter().position(|(name, _)| name == import).unwrap();
            assert!(j < i, "{module} may not import {import}: it stands below it in the table");
        }
    }
}

#[test]
fn unsafe_code_stays_in_its_corners() {
    for (file, code) in library() {
        let says_unsafe = code.match_indices("unsafe").any(|(at, word)| {
            !code[..at].ends_with(is_word) && !code[at + word.len()..].starts_with(is_word)
        });
        assert!(!says_unsafe || UNSAFE.contains(&file.as_str()), "{file} says unsafe");
    }
}

#[test]
fn the_import_scanner_sees_all_forms() {
    let code = "use crate::a::B; use crate::{c::{D, e}, f, Result}; fn g() { crate::h::i() }";
    assert_eq!(imports(code), ["a", "c", "f", "Result", "h"]);
}
