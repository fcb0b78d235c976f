//! An installed library is found by CMake and pkg-config, and the example built with it runs.

use std::path::Path;
use std::process::Command;

use crate::common::{has, library, root, run, save_png};

fn install(prefix: &Path) {
    run(Command::new(root().join("ffi/install.sh"))
        .arg(prefix)
        .env("SVBRDF_BUILT", library().parent().unwrap()));
    for file in [
        "include/svbrdf.h",
        "include/svbrdf.hpp",
        "include/svbrdf/core.hpp",
        "include/svbrdf/enums.hpp",
        "include/svbrdf/image.hpp",
        "include/svbrdf/maps.hpp",
        "include/svbrdf/results.hpp",
        "include/svbrdf/session.hpp",
        "lib/libsvbrdf.so",
        "lib/libsvbrdf.so.0",
        "lib/pkgconfig/svbrdf.pc",
        "lib/cmake/svbrdf/svbrdf-config.cmake",
        "lib/cmake/svbrdf/svbrdf-config-version.cmake",
    ] {
        assert!(prefix.join(file).is_file(), "{file}");
    }
}

#[test]
fn the_cmake_example_builds_and_streams_a_capture() {
    if !has("cmake") || !has("c++") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let (prefix, build, out) = (dir.path().join("p"), dir.path().join("b"), dir.path().join("o"));
    install(&prefix);
    let configure = |version: &str| {
        let mut command = Command::new("cmake");
        command.arg("-S").arg(dir.path().join("source")).arg("-B").arg(&build);
        command.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display()));
        std::fs::create_dir_all(dir.path().join("source")).unwrap();
        let lists = std::fs::read_to_string(root().join("examples/cpp/CMakeLists.txt")).unwrap();
        let lists =
            lists.replace("find_package(svbrdf 0.1 ", &format!("find_package(svbrdf {version} "));
        std::fs::write(dir.path().join("source/CMakeLists.txt"), lists).unwrap();
        std::fs::copy(root().join("examples/cpp/main.cpp"), dir.path().join("source/main.cpp"))
            .unwrap();
        command
    };
    for version in ["0.2", "1.0", "0.1.99"] {
        let refused = configure(version).output().unwrap();
        assert!(!refused.status.success(), "version {version} was found");
    }
    run(&mut configure("0.1"));
    run(Command::new("cmake").arg("--build").arg(&build));
    // A capture of two photos and one that cannot be used.
    let capture = dir.path().join("capture");
    std::fs::create_dir_all(&capture).unwrap();
    let tile = root().join("examples/captures/tile");
    let text = std::fs::read_to_string(tile.join("capture.json")).unwrap();
    let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let frames = value["frames"].as_array_mut().unwrap();
    frames.truncate(3);
    frames[1]["image"] = "black.png".into();
    std::fs::write(capture.join("capture.json"), value.to_string()).unwrap();
    std::os::unix::fs::symlink(tile.join("frames"), capture.join("frames")).unwrap();
    save_png(capture.join("black.png"), image::RgbImage::new(2016, 1512));
    let output = run(Command::new(build.join("svbrdf-stream")).arg(&capture).arg(&out).arg("0.2"));
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{}", text.replace('\r', "\n"));
    assert!(text.contains("photo 2 cannot be used: too dark"));
    assert!(text.contains("2 photos, maps in"));
    assert!(text.contains("degrees off the vertical"), "where to go next");
    assert!(out.join("normal.png").is_file() && !out.join("session.state").exists());
    let wrong = Command::new(build.join("svbrdf-stream")).arg("/nowhere").arg(&out).output();
    assert_eq!(wrong.unwrap().status.code(), Some(1));
}

/// Code blocks of a language in the pages about embedding.
fn examples(language: &str) -> Vec<String> {
    let read = |page: &str| std::fs::read_to_string(root().join("docs").join(page)).unwrap();
    let text = read("embedding.md") + &read("live-loop.md") + &read("guided-capture.md");
    let opening = format!("```{language}\n");
    let blocks = text.split(&opening).skip(1);
    blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect()
}

#[test]
fn the_examples_of_the_documentation_compile() {
    let dir = tempfile::tempdir().unwrap();
    let check = |compiler: &str, flags: &[&str], name: &str, source: String| {
        if !has(compiler) {
            return;
        }
        let path = dir.path().join(name);
        std::fs::write(&path, source).unwrap();
        run(Command::new(compiler)
            .args(["-fsyntax-only", "-Wall", "-Wextra", "-Werror"])
            .args(flags)
            .arg("-I")
            .arg(root().join("include"))
            .arg(path));
    };
    let fragment = "#include \"svbrdf.h\"\nvoid example(svbrdf_session_options options, \
                    svbrdf_session *session, svbrdf_status *s)\n{\nsvbrdf_status status = 0;\n";
    let mut whole = 0;
    for (i, block) in examples("c").into_iter().enumerate() {
        let source = if block.starts_with("#include") {
            whole += 1;
            block
        } else {
            format!("{fragment}{block}\n(void)options; *s = status;\n}}\n")
        };
        check("gcc", &["-std=c99"], &format!("{i}.c"), source);
    }
    for (i, block) in examples("cpp").into_iter().enumerate() {
        whole += 1;
        let photo = "#include <cstdint>\nstruct Photo { const std::uint8_t* data; \
                     std::uint32_t width, height; };\n";
        check("g++", &["-std=c++17"], &format!("{i}.cpp"), format!("{photo}{block}"));
    }
    assert!(whole >= 6);
}

#[test]
fn pkg_config_names_what_a_compiler_needs() {
    if !has("pkg-config") || !has("gcc") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    install(dir.path());
    let flags = run(Command::new("pkg-config")
        .args(["--cflags", "--libs", "svbrdf"])
        .env("PKG_CONFIG_PATH", dir.path().join("lib/pkgconfig")));
    let flags = String::from_utf8(flags.stdout).unwrap();
    let source = dir.path().join("a.c");
    std::fs::write(
        &source,
        "#include <svbrdf.h>\n#include <stdio.h>\nint main(void) { puts(svbrdf_version()); return 0; }\n",
    )
    .unwrap();
    let program = dir.path().join("a");
    run(Command::new("gcc").arg(&source).arg("-o").arg(&program).args(flags.split_whitespace()));
    let output = run(Command::new(&program).env("LD_LIBRARY_PATH", dir.path().join("lib")));
    assert_eq!(String::from_utf8(output.stdout).unwrap().trim(), env!("CARGO_PKG_VERSION"));
}

#[test]
fn symbols_are_put_apart() {
    if !has("gcc") || !has("objcopy") || !has("nm") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let (source, built) = (dir.path().join("a.c"), dir.path().join("libsvbrdf.so"));
    std::fs::write(
        &source,
        "static int inner(int x) { return x; }\nint outer(int x) { return inner(x); }\n",
    )
    .unwrap();
    run(Command::new("gcc").args(["-g", "-shared", "-fPIC", "-o"]).arg(&built).arg(&source));
    let out = dir.path().join("out");
    run(Command::new(root().join("ffi/symbols.sh")).arg(&built).arg(&out));
    let (ships, apart) = (out.join("libsvbrdf.so"), out.join("libsvbrdf.so.debug"));
    let names = |arguments: &[&str], path: &Path| {
        String::from_utf8(run(Command::new("nm").args(arguments).arg(path)).stdout).unwrap()
    };
    assert_eq!(names(&["-D"], &ships), names(&["-D"], &built), "what is exported differs");
    assert!(names(&["-D"], &ships).contains("outer"));
    assert!(!names(&[], &ships).contains("inner") && names(&[], &apart).contains("inner"));
    let sections = run(Command::new("readelf").arg("-S").arg(&apart)).stdout;
    assert!(String::from_utf8_lossy(&sections).contains(".debug_line"));
    let link = run(Command::new("readelf").args(["-p", ".gnu_debuglink"]).arg(&ships)).stdout;
    assert!(String::from_utf8_lossy(&link).contains("libsvbrdf.so.debug"));
}

#[test]
fn the_library_ships_without_symbols() {
    if !has("readelf") {
        return;
    }
    let sections = run(Command::new("readelf").args(["-S", "-W"]).arg(library())).stdout;
    let sections = String::from_utf8_lossy(&sections).into_owned();
    assert!(sections.contains(".dynsym"));
    assert!(!sections.contains(".symtab") && !sections.contains(".debug_"), "{sections}");
}
