//! `include/svbrdf.h` is what the crate's source says. `SVBRDF_UPDATE=1` writes it anew.

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
    let path = here.join("../include/svbrdf.h");
    if std::env::var_os("SVBRDF_UPDATE").is_some() {
        fs::write(&path, &made).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == made, "include/svbrdf.h is out of date; SVBRDF_UPDATE=1 writes it anew");
}

/// Drops `# Safety` and what follows it in a comment.
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
