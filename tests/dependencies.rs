//! Dependencies of the crates: licences, the oldest Rust, and consistent versions.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use serde_json::Value;
use spdx::{Expression, LicenseReq, Licensee, ParseMode};

/// Crates of which binaries or packages are made.
const SHIPPED: [&str; 5] = ["svbrdf", "svbrdf-cli", "svbrdf-ffi", "svbrdf-models", "svbrdf-python"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Cargo's metadata of the workspace on this platform, for which the build has downloaded everything.
static METADATA: LazyLock<Value> = LazyLock::new(|| {
    let rustc = Command::new("rustc").arg("-vV").output().unwrap();
    let rustc = String::from_utf8(rustc.stdout).unwrap();
    let host = rustc.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    let output = Command::new(env!("CARGO"))
        .current_dir(root())
        .args(["metadata", "--format-version=1", "--locked", "--offline"])
        .args(["--filter-platform", host])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
});

fn array<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().unwrap_or_else(|| panic!("no {key}"))
}

/// Packages by their id.
fn packages() -> BTreeMap<&'static str, &'static Value> {
    array(&METADATA, "packages").iter().map(|p| (p["id"].as_str().unwrap(), p)).collect()
}

/// Packages that are linked into the shipped crates or build them, without those of tests.
fn shipped() -> Vec<&'static Value> {
    let packages = packages();
    let nodes: BTreeMap<_, _> = array(&METADATA["resolve"], "nodes")
        .iter()
        .map(|node| (node["id"].as_str().unwrap(), array(node, "deps")))
        .collect();
    let ours = |p: &&Value| SHIPPED.contains(&p["name"].as_str().unwrap());
    let mut open: Vec<_> = packages.iter().filter(|(_, p)| ours(p)).map(|(id, _)| *id).collect();
    assert_eq!(open.len(), SHIPPED.len());
    let mut seen = BTreeSet::new();
    while let Some(id) = open.pop() {
        if seen.insert(id) {
            let needed = nodes[id].iter().filter(|dependency| {
                array(dependency, "dep_kinds").iter().any(|kind| kind["kind"] != "dev")
            });
            open.extend(needed.map(|dependency| dependency["pkg"].as_str().unwrap()));
        }
    }
    seen.into_iter().map(|id| packages[id]).collect()
}

fn allowed(config: &str, table: Option<&str>, key: &str) -> Vec<String> {
    let config: toml::Table = read(config).parse().unwrap();
    let list = match table {
        Some(table) => &config[table][key],
        None => &config[key],
    };
    list.as_array().unwrap().iter().map(|l| l.as_str().unwrap().to_owned()).collect()
}

/// Whether a licence expression can be kept with the licences of a list.
fn is_covered(expression: &str, allowed: &[Licensee]) -> bool {
    let expression = Expression::parse_mode(expression, ParseMode::LAX)
        .unwrap_or_else(|e| panic!("{expression}: {e}"));
    expression.evaluate(|wanted: &LicenseReq| allowed.iter().any(|have| have.satisfies(wanted)))
}

#[test]
fn licences_of_all_that_ships_are_allowed() {
    let list = allowed("ffi/packaging/deny.toml", Some("licenses"), "allow");
    assert_eq!(list, allowed("ffi/packaging/about.toml", None, "accepted"));
    let list: Vec<_> = list.iter().map(|name| Licensee::parse(name).unwrap()).collect();
    for (expression, fine) in [
        ("MIT/Apache-2.0", true),
        ("LGPL-2.1-or-later OR MIT", true),
        ("(MIT OR Apache-2.0) AND IJG", true),
        ("GPL-2.0-only", false),
        ("MIT AND MPL-2.0", false),
    ] {
        assert_eq!(is_covered(expression, &list), fine, "{expression}");
    }
    let shipped = shipped();
    assert!(shipped.len() > 100, "{} crates", shipped.len());
    for package in shipped {
        let (name, licence) = (&package["name"], &package["license"]);
        let licence = licence.as_str().unwrap_or_else(|| panic!("{name} states no licence"));
        assert!(is_covered(licence, &list), "{name}: {licence} is not in ffi/packaging/deny.toml");
    }
}

fn numbers(version: &str) -> [u64; 3] {
    let mut parts = version.split('.').map(|part| part.parse().unwrap());
    std::array::from_fn(|_| parts.next().unwrap_or(0))
}

#[test]
fn the_stated_rust_is_new_enough_for_all_dependencies() {
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    let stated = manifest["workspace"]["package"]["rust-version"].as_str().unwrap();
    for package in shipped() {
        let Some(needed) = package["rust_version"].as_str() else { continue };
        let name = &package["name"];
        assert!(numbers(needed) <= numbers(stated), "{name} needs Rust {needed}, not {stated}");
    }
    for document in ["README.md", "CONTRIBUTING.md"] {
        assert!(read(document).contains(stated), "{document} does not say Rust {stated}");
    }
}

#[test]
fn versions_agree() {
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    let version = manifest["workspace"]["package"]["version"].as_str().unwrap();
    for package in packages().values().filter(|p| p["source"].is_null()) {
        assert_eq!(package["version"], version, "{}", package["name"]);
        for dependency in array(package, "dependencies") {
            // A crate of this repository: the registry needs to know which one.
            if dependency["path"].is_string() && !package["publish"].is_array() {
                let (name, wanted) = (&dependency["name"], &dependency["req"]);
                assert_eq!(wanted, &format!("^{version}"), "{name} in {}", package["name"]);
            }
        }
    }
    let changelog = read("CHANGELOG.md");
    let latest = changelog.lines().find_map(|line| line.strip_prefix("## ")).unwrap();
    assert_eq!(latest.split(' ').next(), Some(version), "CHANGELOG.md begins with {latest}");
    let port: Value = serde_json::from_str(&read("ffi/packaging/vcpkg/svbrdf/vcpkg.json")).unwrap();
    assert_eq!(port["version"], version, "the port of vcpkg");
    let extension = "ffi/blender/extension/blender_manifest.toml";
    let manifest: toml::Table = read(extension).parse().unwrap();
    assert_eq!(manifest["version"].as_str(), Some(version), "{extension}");
    let app = read("android-example/app/build.gradle.kts");
    assert!(app.contains(&format!("versionName = \"{version}\"")), "the Android app");
    let debian: toml::Table = read("ffi/Cargo.toml").parse().unwrap();
    let debian = &debian["package"]["metadata"]["deb"];
    let [major, _, _] = numbers(version);
    assert_eq!(debian["name"].as_str(), Some(&*format!("libsvbrdf{major}")));
    let dev = debian["variants"]["dev"]["depends"].as_str();
    assert_eq!(dev, Some(&*format!("libsvbrdf{major} (= {version}-1)")));
    assert!(read("ffi/Cargo.toml").contains(&format!("\"usr/lib/libsvbrdf.so.{version}\"")));
}

/// Crates with their features, as a selection of packages has them.
fn selected(arguments: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .current_dir(root())
        .args(["tree", "--locked", "--offline", "--prefix", "none", "--format", "{p}|{f}"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    // A crate that was shown before is marked.
    lines.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
}

/// Otherwise `tests/python.sh` compiles tract and the library once more: minutes.
#[test]
fn the_wheel_has_the_features_of_the_workspace() {
    let workspace = selected(&["--workspace", "--edges", "normal,build,dev"]);
    let wheel = selected(&["--package", "svbrdf-python", "--edges", "normal,build"]);
    let other: Vec<_> = wheel.difference(&workspace).collect();
    assert!(!wheel.is_empty() && other.is_empty(), "add the missing features: {other:?}");
}
