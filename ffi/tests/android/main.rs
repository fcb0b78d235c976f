//! `android-example` without Google's tools: the binding and its native code on the desktop JVM,
//! the app compiled against Android's class library and packed. `tests/android-tools.sh` installs
//! their tools.
#![cfg(target_os = "linux")]

mod aar;
#[allow(dead_code)] // Clients in C need more of it.
#[path = "../clients/common.rs"]
mod common;
mod defaults;

use std::env;
use std::f32::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::{has, library, root, run, skipped, workplace, write_photos};
use engine::export::read_maps;
use engine::observation::{Falloff, View};
use engine::render::render;

fn example() -> PathBuf {
    root().join("android-example")
}

/// Where `tests/android-tools.sh` has put things; `None`, said loudly, when it has not.
fn tools() -> Option<PathBuf> {
    // target/PROFILE/deps/this-test
    let this = env::current_exe().unwrap();
    let tools = this.ancestors().nth(3).unwrap().join("android-tools");
    if !tools.join("kotlinc/lib/kotlin-compiler.jar").is_file()
        || !tools.join("root/usr/share/java/com.android.dx.jar").is_file()
    {
        skipped("tests/android-tools.sh has not run; android-example is not checked");
        return None;
    }
    ["java", "javac", "gcc"].iter().all(|program| has(program)).then_some(tools)
}

fn sources(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn class_path(parts: &[&Path]) -> String {
    parts.iter().map(|p| p.to_str().unwrap()).collect::<Vec<_>>().join(":")
}

/// For compilers in Java, which end before it pays to optimise them.
const BRIEF: [&str; 3] = ["-Xmx1g", "-XX:TieredStopAtLevel=1", "-XX:+UseSerialGC"];

/// Compiles Kotlin into a folder of classes, warnings as errors.
fn kotlin(tools: &Path, class_path: &str, sources: &[PathBuf], extra: &[&str], out: &Path) {
    let mut command = Command::new("java");
    command
        .args(BRIEF)
        .arg("-cp")
        .arg(tools.join("kotlinc/lib/kotlin-compiler.jar"))
        .arg("org.jetbrains.kotlin.cli.jvm.K2JVMCompiler")
        .arg("-kotlin-home")
        .arg(tools.join("kotlinc"))
        .args(["-Werror", "-jvm-target", "1.8", "-cp", class_path])
        .args(extra)
        .arg("-d")
        .arg(out)
        .args(sources);
    run(&mut command);
}

/// The JDK's folder, which has jni.h.
fn java_home() -> PathBuf {
    let shown = run(Command::new("java").args(["-XshowSettings:properties", "-version"]));
    let shown = String::from_utf8_lossy(&shown.stderr).into_owned();
    let home = shown.lines().find_map(|line| line.trim().strip_prefix("java.home = "));
    PathBuf::from(home.expect("java.home"))
}

/// The Kotlin of `docs/live-loop.md` as a file: it is only compiled.
fn live_loop(dir: &Path) -> PathBuf {
    let page = fs::read_to_string(root().join("docs/live-loop.md")).unwrap();
    let code = page.split("```kotlin\n").nth(1).unwrap().split("```").next().unwrap();
    let path = dir.join("LiveLoop.kt");
    fs::write(&path, code).unwrap();
    path
}

/// Compiles the JNI code into `dir`, beside the library.
fn native(dir: &Path) {
    let include = java_home().join("include");
    let mut command = Command::new("gcc");
    command
        .args(["-std=c11", "-O1", "-g", "-fPIC", "-shared", "-fvisibility=hidden"])
        .args(["-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror", "-Wl,-z,nodelete"])
        .arg("-I")
        .arg(&include)
        .arg("-I")
        .arg(include.join("linux"))
        .arg("-I")
        .arg(root().join("include"))
        .args(sources(&example().join("scanner/src/main/cpp"), "c"))
        .arg("-L")
        .arg(dir)
        .args(["-lsvbrdf", "-lpthread", "-Wl,-rpath,$ORIGIN", "-o"])
        .arg(dir.join("libsvbrdf_jni.so"));
    run(&mut command);
    let exported =
        run(Command::new("nm").args(["-D", "--defined-only"]).arg(dir.join("libsvbrdf_jni.so")));
    let exported = String::from_utf8_lossy(&exported.stdout).into_owned();
    let names: Vec<&str> = exported.lines().filter_map(|l| l.split_whitespace().last()).collect();
    assert_eq!(names, ["JNI_OnLoad"]);
}

#[test]
fn the_binding_works_on_the_desktop_jvm() {
    let Some(tools) = tools() else { return };
    library();
    let dir = workplace();
    let dir = dir.path();
    native(dir);
    write_photos(dir, 3);
    let lib = tools.join("kotlinc/lib");
    let runtime =
        [lib.join("kotlin-stdlib.jar"), lib.join("kotlinx-coroutines-core-jvm.jar"), dir.into()];
    let [stdlib, coroutines, _] = &runtime;
    let mut files = sources(&example().join("scanner/src/main/kotlin"), "kt");
    for file in &files {
        let text = fs::read_to_string(file).unwrap();
        assert!(!text.contains("import android"), "{}", file.display());
    }
    files.extend(sources(&example().join("desktop-test"), "kt"));
    files.push(live_loop(dir));
    let classes = dir.join("classes");
    kotlin(&tools, &class_path(&[stdlib, coroutines]), &files, &[], &classes);

    let out = dir.join("maps");
    let mut java = Command::new("timeout");
    java.args(["3600", "java", "-Xcheck:jni", "-Xmx512m", "-cp"])
        .arg(class_path(&[&classes, stdlib, coroutines]))
        .arg(format!("-Djava.library.path={}", dir.display()))
        // else file names are ASCII
        .env("LC_ALL", "C.UTF-8")
        .arg("org.svbrdf.scanner.ScannerTestKt")
        .args([dir, &root().join("include/svbrdf.h"), &out]);
    let done = run(&mut java);
    let said =
        [done.stdout, done.stderr].map(|s| String::from_utf8_lossy(&s).into_owned()).concat();
    println!("{said}");
    assert_eq!(said.matches("done: ").count(), 18, "{said}");
    // What -Xcheck:jni complains about.
    assert!(!said.contains("WARNING in native") && !said.contains("WARNING: JNI"), "{said}");
    assert!(!said.contains("FATAL"), "{said}");

    relit_as_the_library_renders(&out);
    gltf_is_well_formed(&fs::read(out.join("material.glb")).unwrap());
}

/// The preview's picture against the renderer of the fit, from the maps that were written.
fn relit_as_the_library_renders(out: &Path) {
    let maps = read_maps(out).unwrap();
    let view = View {
        sample_mm: [88.0, 88.0],
        camera_mm: [0.0, 0.0, 250.0],
        light_mm: [60.0, 40.0, 200.0],
        falloff: Falloff::None { power: [0.8 * PI; 3] },
        ..View::default()
    };
    let mut rgb = vec![0.0; 3 * maps.texels()];
    render(&maps, &view, &mut rgb);
    let raw = fs::read(out.join("relit.rgba")).unwrap();
    assert_eq!(raw.len(), 4 * maps.texels());
    let (mut sum, mut worst) = (0.0_f64, 0.0_f32);
    for (i, pixel) in raw.chunks_exact(4).enumerate() {
        assert_eq!(pixel[3], 255);
        for c in 0..3 {
            let linear = rgb[c * maps.texels() + i].clamp(0.0, 1.0);
            let srgb = match linear <= 0.0031308 {
                true => 12.92 * linear,
                false => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
            };
            let difference = (f32::from(pixel[c]) - 255.0 * srgb).abs();
            sum += f64::from(difference);
            worst = worst.max(difference);
        }
    }
    // Rounding alone.
    let mean = sum / (3 * maps.texels()) as f64;
    assert!(mean < 0.3 && worst < 0.51, "mean {mean}, worst {worst}");
}

fn gltf_is_well_formed(file: &[u8]) {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&file[..4], word(4), word(8)), (&b"glTF"[..], 2, file.len()));
    let json_bytes = word(12);
    assert_eq!(&file[16..20], b"JSON");
    let json: serde_json::Value = serde_json::from_slice(&file[20..20 + json_bytes]).unwrap();
    let data = &file[28 + json_bytes..];
    assert_eq!(
        (word(20 + json_bytes), &file[24 + json_bytes..28 + json_bytes]),
        (data.len(), &b"BIN\0"[..])
    );
    assert_eq!(json["buffers"][0]["byteLength"], data.len());
    let view = |i: usize| {
        let view = &json["bufferViews"][i];
        let offset = view["byteOffset"].as_u64().unwrap() as usize;
        assert_eq!(offset % 4, 0);
        &data[offset..offset + view["byteLength"].as_u64().unwrap() as usize]
    };
    let float =
        |view: &[u8], i: usize| f32::from_le_bytes(view[4 * i..4 * i + 4].try_into().unwrap());
    // The first corner: -X, +Y, where the maps begin.
    let corner = [0, 1, 2].map(|i| float(view(0), i));
    assert_eq!(corner, [-0.044, 0.044, 0.0]);
    // Readers compare these to the bit.
    let least = json["accessors"][0]["min"].as_array().unwrap();
    assert_eq!(least[0].as_f64().unwrap() as f32, corner[0]);
    assert_eq!([0, 1].map(|i| float(view(3), i)), [0.0, 0.0]);
    let material = &json["materials"][0];
    assert!(material["extensions"]["KHR_materials_ior"]["ior"].as_f64().unwrap() > 1.0);
    for image in json["images"].as_array().unwrap() {
        let png = image::load_from_memory(view(image["bufferView"].as_u64().unwrap() as usize));
        assert_eq!(png.unwrap().into_rgb8().dimensions(), (256, 256));
    }
}

#[test]
fn the_app_compiles_against_androids_classes_and_is_packed() {
    let Some(tools) = tools() else { return };
    if !["aapt", "zipalign", "apksigner", "keytool"].iter().all(|tool| installed(tool)) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let main = example().join("app/src/main");
    let android = tools.join("root/usr/share/java/com.android.android-23.jar");
    let (generated, classes) = (dir.join("generated"), dir.join("classes"));
    fs::create_dir(&generated).unwrap();
    fs::create_dir(&classes).unwrap();
    // Gradle puts the package in.
    let manifest = fs::read_to_string(main.join("AndroidManifest.xml")).unwrap();
    let manifest = manifest.replace("<manifest ", "<manifest package=\"org.svbrdf.example\" ");
    fs::write(dir.join("AndroidManifest.xml"), manifest).unwrap();
    let unaligned = dir.join("unaligned.apk");
    run(Command::new("aapt")
        .args(["package", "-f", "-m", "--min-sdk-version", "26", "--target-sdk-version", "29"])
        .arg("-J")
        .arg(&generated)
        .arg("-M")
        .arg(dir.join("AndroidManifest.xml"))
        .arg("-S")
        .arg(main.join("res"))
        .args(["-I", "/usr/share/android-framework-res/framework-res.apk", "-F"])
        .arg(&unaligned));
    run(Command::new("javac")
        .args(["--release", "8", "-Xlint:-options", "-cp"])
        .arg(&android)
        .arg("-d")
        .arg(&classes)
        .args(sources(&generated, "java"))
        .args(sources(&main.join("java"), "java")));

    let lib = tools.join("kotlinc/lib");
    let libraries = [lib.join("kotlin-stdlib.jar"), lib.join("kotlinx-coroutines-core-jvm.jar")];
    let mut files = sources(&example().join("scanner/src/main/kotlin"), "kt");
    files.extend(sources(&main.join("kotlin"), "kt"));
    // dx knows no invokedynamic; Gradle's D8 does.
    let for_dx =
        ["-no-jdk", "-Xlambdas=class", "-Xsam-conversions=class", "-Xstring-concat=inline"];
    let path = class_path(&[&android, &classes, &libraries[0], &libraries[1]]);
    kotlin(&tools, &path, &files, &for_dx, &classes);

    // Of our classes alone: Kotlin's own take dx longer, and are none of ours.
    run(Command::new("java")
        .args(BRIEF)
        .arg("-cp")
        .arg(tools.join("root/usr/share/java/com.android.dx.jar"))
        .args(["com.android.dx.command.Main", "--dex", "--min-sdk-version=26"])
        .arg(format!("--output={}", dir.join("classes.dex").display()))
        .arg(&classes));
    run(Command::new("aapt").current_dir(dir).args(["add", "unaligned.apk", "classes.dex"]));
    let apk = dir.join("app.apk");
    run(Command::new("zipalign").arg("4").args([&unaligned, &apk]));
    let key = dir.join("key");
    run(Command::new("keytool")
        .args(["-genkeypair", "-keyalg", "RSA", "-dname", "CN=test", "-storepass", "testtest"])
        .args(["-alias", "test", "-keystore"])
        .arg(&key));
    run(Command::new("apksigner")
        .args(["sign", "--ks-pass", "pass:testtest", "--ks"])
        .arg(&key)
        .arg(&apk));
    run(Command::new("apksigner").args(["verify", "--min-sdk-version", "26"]).arg(&apk));
    let listed = run(Command::new("aapt").args(["list", "-a"]).arg(&apk));
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    for part in ["classes.dex", "res/layout/scan.xml", "org.svbrdf.example.ScanActivity"] {
        assert!(listed.contains(part), "{part} is not in the package:\n{listed}");
    }
    println!("{} bytes, without native libraries", fs::metadata(&apk).unwrap().len());
}

/// Like [`has`], for programs that do not know `--version`.
fn installed(program: &str) -> bool {
    let path = env::var_os("PATH").unwrap_or_default();
    let found = env::split_paths(&path).any(|folder| folder.join(program).is_file());
    if !found {
        skipped(&format!("{program} is not installed; the app is not checked"));
    }
    found
}
