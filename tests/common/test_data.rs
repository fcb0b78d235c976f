//! The folder of further captures and materials that some tests need.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

/// A file or folder below the one that `SVBRDF_TEST_DATA` names; `None` where that is not set, which
/// the end of the run counts (`tests/run.sh` names the list in `SVBRDF_SKIPPED`).
///
/// # Panics
/// When the folder is named and `part` is not in it.
pub fn test_data(part: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("SVBRDF_TEST_DATA") else {
        let thread = std::thread::current();
        let test = thread.name().unwrap_or("a test");
        eprintln!("SKIPPED: SVBRDF_TEST_DATA is not set, {test} checks nothing of {part}");
        if let Some(list) = std::env::var_os("SVBRDF_SKIPPED") {
            let mut file = OpenOptions::new().create(true).append(true).open(list).unwrap();
            // One write: tests run side by side.
            file.write_all(format!("{test} {part}\n").as_bytes()).unwrap();
        }
        return None;
    };
    let path = PathBuf::from(root).join(part);
    assert!(path.exists(), "{} is missing", path.display());
    Some(path)
}
