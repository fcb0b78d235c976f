//! The structure of the sources: imports point one way, between modules and between the files
//! inside them; functions and files stay short; `unsafe` stays where it belongs.

mod imports;
mod source;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use imports::{imports, rings};
use source::Crate;

/// Each module of `src/` and the modules it may import. `error` (with its re-exports `Error`,
/// `Rejection`, `Result`, `StateFault`) and `parallel` are open to all.
const TABLE: &[(&str, &[&str])] = &[
    ("error", &[]),
    ("parallel", &[]),
    ("simd", &[]),
    ("little_endian", &[]),
    ("geometry", &[]),
    ("svbrdf", &["little_endian"]),
    ("uncertainty", &["svbrdf"]),
    ("threads", &[]),
    ("random", &[]),
    ("observation", &["little_endian", "svbrdf"]),
    ("photo", &["geometry", "little_endian"]),
    ("files", &["photo"]),
    ("interpolation", &[]),
    ("least_squares", &[]),
    ("statistics", &[]),
    ("calibration", &["photo", "geometry", "least_squares", "statistics"]),
    ("board_sheet", &["calibration"]),
    ("rectification", &["calibration", "photo", "geometry", "observation", "svbrdf"]),
    ("scene", &["calibration", "geometry", "observation"]),
    (
        "capture",
        &["calibration", "files", "photo", "geometry", "observation", "rectification", "scene"],
    ),
    ("reflectance", &["simd", "svbrdf", "observation"]),
    ("loss", &["simd"]),
    ("render", &["reflectance", "loss", "simd", "svbrdf", "observation"]),
    ("networks", &["interpolation", "observation", "render", "simd", "svbrdf"]),
    (
        "estimate",
        &[
            "uncertainty",
            "interpolation",
            "little_endian",
            "loss",
            "networks",
            "observation",
            "random",
            "reflectance",
            "render",
            "simd",
            "svbrdf",
        ],
    ),
    (
        "assessment",
        &[
            "uncertainty",
            "estimate",
            "loss",
            "observation",
            "random",
            "render",
            "statistics",
            "svbrdf",
        ],
    ),
    ("estimator", &["assessment", "estimate", "networks", "observation", "svbrdf"]),
    ("comparison", &["observation", "random", "render", "svbrdf"]),
    ("export", &["uncertainty", "photo", "render", "svbrdf", "observation"]),
    (
        "session",
        &[
            "assessment",
            "calibration",
            "uncertainty",
            "estimate",
            "photo",
            "geometry",
            "networks",
            "observation",
            "rectification",
            "render",
            "scene",
            "statistics",
            "svbrdf",
            "threads",
        ],
    ),
    ("guide", &["session"]),
];

/// Modules open to all.
const OPEN: &[&str] = &["error", "parallel"];

/// Files that may say `unsafe`: the SIMD back ends, their dispatch and the one call into the matrix
/// product.
const UNSAFE: &[&str] = &[
    "simd/avx2.rs",
    "simd/mod.rs",
    "simd/portable.rs",
    "simd/wasm.rs",
    "networks/decoder/gemm.rs",
];

/// Root files of the crates whose files and functions are checked.
const ROOTS: &[&str] = &[
    "src/lib.rs",
    "ffi/src/lib.rs",
    "ffi/python/src/lib.rs",
    "ffi/web/src/lib.rs",
    "cli/src/main.rs",
    "benches/eval/src/main.rs",
];

/// Most lines of a function, and of a file without its test modules.
const FUNCTION_LINES: usize = 80;
const FILE_LINES: usize = 500;

/// The crates of [`ROOTS`], read once.
static CRATES: LazyLock<Vec<Crate>> = LazyLock::new(|| {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    ROOTS.iter().map(|root| Crate::read(&repository.join(root))).collect()
});

fn library() -> &'static Crate {
    &CRATES[0]
}

/// Path from the repository on of a file that a crate names `name`.
fn path(root: &str, name: &str) -> String {
    format!("{}/{name}", root.rsplit_once('/').unwrap().0)
}

fn module(file: &str) -> &str {
    file.split(['/', '.']).next().unwrap()
}

/// Violations of a crate's rules about imports between its modules.
fn module_faults(source: &Crate, table: &[(&str, &[&str])]) -> Vec<String> {
    let known: BTreeMap<_, _> = table.iter().copied().collect();
    let mut faults = Vec::new();
    for (file, used) in imports(source) {
        let importer = module(&file);
        if importer == "lib" {
            continue;
        }
        let Some(allowed) = known.get(importer) else {
            faults.push(format!("{file}: module {importer} is not in the table"));
            continue;
        };
        for other in used {
            let import = module(&other);
            let fine = import == importer || OPEN.contains(&import) || allowed.contains(&import);
            if !fine {
                faults.push(format!("{file} imports {other}"));
            }
        }
    }
    faults
}

/// Rings of files, functions and files that are too long.
fn file_faults(root: &str, source: &Crate) -> Vec<String> {
    let mut faults: Vec<String> = rings(&imports(source))
        .iter()
        .map(|ring| format!("{root}: ring {}", ring.join(" -> ")))
        .collect();
    for file in &source.files {
        let path = path(root, &file.name);
        if file.lines > FILE_LINES {
            faults.push(format!("{path} has {} lines", file.lines));
        }
        for function in file.functions.iter().filter(|f| f.lines > FUNCTION_LINES) {
            faults.push(format!("{path}: {} has {} lines", function.name, function.lines));
        }
    }
    faults
}

#[test]
fn imports_point_one_way() {
    let faults = module_faults(library(), TABLE);
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
fn no_files_import_each_other_and_none_is_long() {
    let mut faults = Vec::new();
    for (root, source) in ROOTS.iter().zip(&*CRATES) {
        faults.extend(file_faults(root, source));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn unsafe_code_stays_in_its_corners() {
    for file in &library().files {
        let allowed = UNSAFE.contains(&file.name.as_str());
        assert!(!file.says_unsafe || allowed, "{} says unsafe", file.name);
    }
}

/// The target is built with cargo-fuzz alone: no test compiles it.
#[test]
fn the_fuzz_target_of_c_calls_has_every_module_of_the_c_library() {
    let modules = |file: &str| -> Vec<String> {
        let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
        let names =
            text.lines().filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod "));
        names.map(|name| name.trim_end_matches(';').to_owned()).collect()
    };
    let mut built = modules("fuzz/fuzz_targets/c_calls.rs");
    built.retain(|name| name != "c_calls");
    assert_eq!(built, modules("ffi/src/lib.rs"));
}

/// Writes a crate and reads it.
fn planted(files: &[(&str, &str)]) -> Crate {
    let dir = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    Crate::read(&dir.path().join("src/lib.rs"))
}

#[test]
fn a_ring_between_files_of_a_module_is_named() {
    // Through a re-export, and with an inner module that only tests have.
    let source = planted(&[
        ("src/lib.rs", "mod a; pub use a::Shown;"),
        ("src/a/mod.rs", "mod one; mod two; pub use one::Shown;"),
        ("src/a/one.rs", "pub struct Shown(pub super::two::Inner);"),
        ("src/a/two.rs", "pub struct Inner; fn f() -> Option<crate::Shown> { None }"),
        ("src/a/three.rs", "not even Rust"),
    ]);
    let faults = file_faults("src/lib.rs", &source);
    assert_eq!(faults, ["src/lib.rs: ring a/one.rs -> a/two.rs -> a/one.rs"]);
}

#[test]
fn a_ring_through_the_parent_module_is_named() {
    let source = planted(&[
        ("src/lib.rs", "mod a;"),
        ("src/a.rs", "mod child; use child::Part; pub struct Whole(Part); const N: usize = 1;"),
        ("src/a/child.rs", "use super::*; pub struct Part([u8; N]);"),
    ]);
    let faults = file_faults("src/lib.rs", &source);
    assert_eq!(faults, ["src/lib.rs: ring a.rs -> a/child.rs -> a.rs"]);
}

#[test]
fn imports_that_run_upward_are_named() {
    let source = planted(&[
        ("src/lib.rs", "mod low; mod high; mod odd;"),
        ("src/low.rs", "pub fn f() { assert!(crate::high::g()) }"),
        ("src/high.rs", "use crate::{low::{self}}; pub fn g() -> bool { low::f(); true }"),
        ("src/odd.rs", ""),
    ]);
    let faults = module_faults(&source, &[("low", &[]), ("high", &["low"])]);
    assert_eq!(faults, ["low.rs imports high.rs", "odd.rs: module odd is not in the table"]);
}

#[test]
fn lines_of_functions_and_files_are_counted_without_tests() {
    let long = |lines: usize| format!("fn long() {{\n{}}}\n", "    ();\n".repeat(lines));
    let tests = format!("#[cfg(test)]\nmod tests {{\n{}}}\n", long(600));
    let lib = format!("//! Root.\n{}{tests}", long(79));
    let source = planted(&[("src/lib.rs", &lib)]);
    assert_eq!((source.files[0].lines, source.files[0].functions.len()), (82, 1));
    let faults = file_faults("src/lib.rs", &source);
    assert_eq!(faults, ["src/lib.rs: long has 81 lines"]);
}

#[test]
fn only_code_outside_tests_says_unsafe() {
    let source = planted(&[
        ("src/lib.rs", "mod a; mod b; mod c; #[cfg(test)] mod t { unsafe fn f() {} }"),
        ("src/a.rs", "//! unsafe\nfn f() { let _ = \"unsafe\"; }"),
        ("src/b.rs", "fn f() { unsafe { g() } }"),
        ("src/c.rs", "struct S; unsafe impl Send for S {}"),
    ]);
    let said: Vec<bool> = source.files.iter().map(|f| f.says_unsafe).collect();
    assert_eq!(said, [false, false, true, true]);
}
