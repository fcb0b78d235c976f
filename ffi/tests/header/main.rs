//! `include/svbrdf.h` matches the crate's source. `SVBRDF_UPDATE=1` writes it again.

mod order;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

#[test]
fn the_committed_header_is_up_to_date() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(here.join("cbindgen.toml")).unwrap();
    let bindings = cbindgen::Builder::new().with_crate(here).with_config(config).generate();
    let mut made = Vec::new();
    bindings.unwrap().write(&mut made);
    // Safety sections are for Rust; the header's own words say the same.
    let made = without_safety_sections(&String::from_utf8(made).unwrap());
    let symbols = fs::read_to_string(here.join("symbols.txt")).unwrap();
    let made = order::arrange(&made, &symbols, &types_of_constants(&here.join("src")));
    let made = order::with_short_comments(&made);
    let path = here.join("../include/svbrdf.h");
    if std::env::var_os("SVBRDF_UPDATE").is_some() {
        fs::write(&path, &made).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == made, "include/svbrdf.h is out of date; SVBRDF_UPDATE=1 writes it anew");
}

#[test]
fn every_constant_has_an_enumerator() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let enums = fs::read_to_string(here.join("../include/svbrdf/enums.hpp")).unwrap();
    let lines: Vec<_> = enums.lines().map(|line| line.trim().trim_end_matches(',')).collect();
    let types = types_of_constants(&here.join("src"));
    assert!(types.len() > 100, "{} constants", types.len());
    for (constant, of) in types {
        let ends = format!(" = {constant}");
        let found = lines.iter().filter(|line| line.ends_with(&ends)).count();
        assert_eq!(found, 1, "{constant} of {of} in include/svbrdf/enums.hpp");
        assert!(enums.contains(&format!(": {of} {{")), "{of}");
    }
}

/// The header's type of each constant that has one.
fn types_of_constants(folder: &Path) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(types_of_constants(&path));
            continue;
        }
        for line in fs::read_to_string(&path).unwrap().lines() {
            let constant = line.strip_prefix("pub const ").and_then(|rest| rest.split_once(": "));
            let typed = constant.and_then(|(name, rest)| Some((name, rest.split_once(" = ")?.0)));
            if let Some((name, of)) = typed.filter(|(_, of)| of.starts_with("svbrdf_")) {
                found.insert(name.to_owned(), of.to_owned());
            }
        }
    }
    found
}

/// Drops `# Safety` and the rest of a comment.
fn without_safety_sections(header: &str) -> String {
    let mut out: Vec<&str> = Vec::new();
    let mut dropping = false;
    for line in header.lines() {
        if line.trim() == "* # Safety" {
            dropping = true;
            // The empty line before it.
            if out.last().is_some_and(|l| l.trim() == "*") {
                out.pop();
            }
        }
        dropping &= line.trim() != "*/";
        if !dropping {
            out.push(line);
        }
    }
    out.join("\n") + "\n"
}
