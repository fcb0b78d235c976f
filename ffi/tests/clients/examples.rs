//! The examples in C and C++ compile without warnings and run, on the capture of the repository.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{has, link_library, root, run};

/// Compiles an example with the library beside it.
fn compiled(dir: &Path, compiler: &str, source: &str) -> PathBuf {
    let source = root().join("examples").join(source);
    let out = dir.join(source.file_name().unwrap()).with_extension("example");
    let standard = if compiler == "gcc" { "-std=c99" } else { "-std=c++17" };
    let mut command = Command::new(compiler);
    command
        .args([standard, "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-I"])
        .arg(root().join("include"))
        .arg(source)
        .arg("-L")
        .arg(dir)
        .args(["-lsvbrdf", "-lm", "-Wl,-rpath,$ORIGIN", "-o"])
        .arg(&out);
    run(&mut command);
    out
}

/// The last line that an example prints.
fn last_line(program: &Path, arguments: &[&str]) -> String {
    let output = run(Command::new(program).args(arguments));
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{text}");
    text.lines().last().unwrap_or_default().to_owned()
}

/// The number at the end of a line.
fn number(line: &str) -> f64 {
    line.rsplit(' ').next().unwrap().parse().unwrap()
}

#[test]
fn examples_run() {
    let tile = root().join("examples/captures/tile");
    let tile = tile.to_str().unwrap();
    for (compiler, language) in [("gcc", "c"), ("g++", "cpp")] {
        if !has(compiler) {
            continue;
        }
        let dir = tempfile::tempdir().unwrap();
        link_library(dir.path());
        let example = |name: &str, arguments: &[&str]| {
            let source = format!("{language}/{name}.{language}");
            last_line(&compiled(dir.path(), compiler, &source), arguments)
        };
        assert_eq!(example("live_loop", &[tile, "2"]), "2 photos used");
        let known = example("uncertainty", &[tile, "1", "2"]);
        assert!(known.starts_with("1 photos") && (0.01..0.5).contains(&number(&known)), "{known}");
        // A uniform albedo would be off by 0.125.
        let off = number(&example("rectified", &[]));
        assert!(off < 0.05, "{off}");
        let last = example("export_in_memory", &[]);
        assert!(last.contains("files") || last.ends_with(" bytes"), "{last}");
    }
}
