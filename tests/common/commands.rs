//! Commands in the `sh` blocks of the documents.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Documents with commands of ours.
const DOCUMENTS: [&str; 6] = [
    "README.md",
    "CONTRIBUTING.md",
    "android-example/README.md",
    "cli/README.md",
    "ffi/packaging/README.md",
    "docs",
];

/// The commands of a document's `sh` blocks, without comments, continued lines joined.
pub fn commands(text: &str) -> Vec<String> {
    let blocks = text.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let joined: Vec<String> = blocks.map(|block| block.replace("\\\n", " ")).collect();
    let lines = joined.iter().flat_map(|block| block.lines());
    let bare = lines.map(|line| line.split(" #").next().unwrap().trim().to_owned());
    let parts = bare.flat_map(|line| line.split(" && ").map(str::to_owned).collect::<Vec<_>>());
    parts.filter(|line| !line.is_empty() && !line.starts_with('#')).collect()
}

/// Every document of the repository at `root` with its commands.
pub fn documents(root: &Path) -> Vec<(String, Vec<String>)> {
    let mut files: Vec<PathBuf> = Vec::new();
    for name in DOCUMENTS {
        let path = root.join(name);
        if path.is_dir() {
            let entries = std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
            files.extend(entries.filter(|path| path.extension().is_some_and(|e| e == "md")));
        } else {
            files.push(path);
        }
    }
    files.sort();
    let read = |path: &PathBuf| {
        let name = path.strip_prefix(root).unwrap().display().to_string();
        (name, commands(&std::fs::read_to_string(path).unwrap()))
    };
    files.iter().map(read).collect()
}

/// Whether a program accepts a command line: `--help` at its end answers only if everything before
/// it is valid. Returns the program's message otherwise.
pub fn understood(program: &str, arguments: &[&str]) -> Result<(), String> {
    // `MATERIALS_DIR...` and the like stand for one or more.
    let given = arguments.iter().map(|a| a.trim_end_matches("..."));
    let output = Command::new(program).args(given).arg("--help").output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(()) } else { Err(said) }
}
