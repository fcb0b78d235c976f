//! The C ABI is compatible with the last release, and the comparison detects breaking changes.

use std::process::{Command, Output};

use crate::common::{has, root, run};

fn compare(header: &str) -> Output {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("svbrdf.h");
    std::fs::write(&path, header).unwrap();
    Command::new(root().join("ffi/abi.sh")).env("SVBRDF_HEADER", path).output().unwrap()
}

#[test]
fn the_abi_is_that_of_the_last_release() {
    if has("clang") {
        run(&mut Command::new(root().join("ffi/abi.sh")));
    }
}

#[test]
fn changes_that_break_programs_are_named() {
    if !has("clang") {
        return;
    }
    let header = std::fs::read_to_string(root().join("include/svbrdf.h")).unwrap();
    let changed = |from: &str, to: &str| {
        assert_eq!(header.matches(from).count(), 1, "{from}");
        compare(&header.replace(from, to))
    };
    for (from, to, names) in [
        ("#define SVBRDF_PIXEL_RGB16 3", "#define SVBRDF_PIXEL_RGB16 11", "SVBRDF_PIXEL_RGB16 3"),
        ("int64_t timeout_ms);", "int32_t timeout_ms);", "svbrdf_session_wait("),
        ("svbrdf_status svbrdf_session_pause(struct svbrdf_session *session);", "", "_pause("),
        ("float seconds;", "double seconds;", "svbrdf_budget at 8 float seconds"),
        (
            "float seconds;",
            "float before; float seconds;",
            "svbrdf_budget at 12 uint32_t max_steps",
        ),
        // A plane does not tell its size: arrays of them would no longer fit.
        ("} svbrdf_plane;", "size_t more; } svbrdf_plane;", "svbrdf_plane bytes"),
    ] {
        let output = changed(from, to);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{to}: {said}");
        assert!(said.contains(names), "{to}: {said}");
    }
    for (from, to) in [
        ("} svbrdf_budget;", "double more; } svbrdf_budget;"),
        ("int64_t timeout_ms);", "int64_t milliseconds); svbrdf_status svbrdf_more(void);"),
    ] {
        let output = changed(from, to);
        assert!(output.status.success(), "{to}: {}", String::from_utf8_lossy(&output.stderr));
    }
}
