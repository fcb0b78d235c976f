//! `android-example/aar.sh`: the contents of the archive, and the refusals.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{has, library, run};
use crate::{class_path, example, kotlin, tools};

/// How the linker is told to make libraries that devices load.
const LOADED: [&str; 2] = ["-Wl,-z,max-page-size=16384", "-Wl,-z,nodelete"];

/// Links a shared library without the desktop's own.
fn link(folder: &Path, name: &str, source: &str, flags: &[&str]) {
    let file = folder.join(format!("{name}.c"));
    fs::write(&file, source).unwrap();
    run(Command::new("gcc")
        .args(["-shared", "-fPIC", "-nostdlib", "-fno-builtin", "-Wl,--no-as-needed"])
        .arg(format!("-Wl,-soname,lib{name}.so"))
        .arg(&file)
        .arg("-L")
        .arg(folder)
        .args(flags)
        .arg("-o")
        .arg(folder.join(format!("lib{name}.so"))));
}

/// Libraries that stand in for those of a device, which only the NDK links: named and aligned as those are, with
/// their exports, and depending on a C library whose symbols name their release as Android's do. `more` is added
/// to the source of libsvbrdf.
fn stand_ins(dir: &Path, name: &str, more: &str, flags: &[&str]) -> PathBuf {
    let folder = dir.join(name);
    fs::create_dir(&folder).unwrap();
    let versions = folder.join("c.map");
    let map = "LIBC { global: malloc; local: *; };\n\
               LIBC_O { global: mblen; } LIBC;\n\
               LIBC_P { global: getrandom; } LIBC_O;\n";
    fs::write(&versions, map).unwrap();
    let script = format!("-Wl,--version-script={}", versions.display());
    let libc = "void malloc(void) {} void mblen(void) {} void getrandom(void) {}\n";
    link(&folder, "c", libc, &[&script]);
    let symbols = include_str!("../../symbols.txt").lines().filter(|s| s.starts_with("svbrdf_"));
    let mut source: String = symbols.map(|s| format!("void {s}(void) {{}}\n")).collect();
    source += "void malloc(void); void mblen(void); void getrandom(void);\n\
               __attribute__((visibility(\"hidden\"))) void uses(void) { malloc(); mblen(); }\n";
    link(&folder, "svbrdf", &(source + more), &[flags, &["-lc"]].concat());
    let jni = "void svbrdf_version(void); void JNI_OnLoad(void) { svbrdf_version(); }\n";
    link(&folder, "svbrdf_jni", jni, &[flags, &["-lsvbrdf", "-lc"]].concat());
    folder
}

fn pack(out: &Path, tools: &Path, libraries: &[(&str, &Path)]) -> Output {
    let mut command = Command::new(example().join("aar.sh"));
    command.arg(out).env("KOTLIN_HOME", tools.join("kotlinc"));
    for (abi, folder) in libraries {
        command.arg(format!("{abi}={}", folder.display()));
    }
    command.output().unwrap()
}

fn entries(archive: &Path) -> Vec<String> {
    let listed = run(Command::new("jar").arg("tf").arg(archive));
    let listed = String::from_utf8(listed.stdout).unwrap();
    let mut names: Vec<_> =
        listed.lines().filter(|name| !name.ends_with('/')).map(str::to_owned).collect();
    names.sort();
    names
}

#[test]
fn the_scanner_is_packed_for_gradle() {
    let Some(tools) = tools() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (dir, out) = (dir.path(), dir.path().join("repository"));
    let folder = stand_ins(dir, "good", "", &LOADED);
    let packed = pack(&out, &tools, &[("x86_64", &folder)]);
    assert!(packed.status.success(), "{}", String::from_utf8_lossy(&packed.stderr));
    let version = env!("CARGO_PKG_VERSION");
    let name =
        |ending: &str| out.join(format!("org/svbrdf/scanner/{version}/scanner-{version}{ending}"));
    let licences =
        ["META-INF/licenses/svbrdf/LICENSE-APACHE", "META-INF/licenses/svbrdf/LICENSE-MIT"];
    let expected = [
        "AndroidManifest.xml",
        "META-INF/com/android/build/gradle/aar-metadata.properties",
        licences[0],
        licences[1],
        "R.txt",
        "classes.jar",
        "jni/x86_64/libsvbrdf.so",
        "jni/x86_64/libsvbrdf_jni.so",
        "proguard.txt",
    ];
    assert_eq!(entries(&name(".aar")), expected);
    let aar = dir.join("unpacked");
    fs::create_dir(&aar).unwrap();
    run(Command::new("jar").current_dir(&aar).arg("xf").arg(name(".aar")));
    let text = |file: &str| fs::read_to_string(aar.join(file)).unwrap();
    let manifest = text("AndroidManifest.xml");
    for part in
        ["package=\"org.svbrdf.scanner\"", "minSdkVersion=\"26\"", "targetSdkVersion=\"36\""]
    {
        assert!(manifest.contains(part), "{part}");
    }
    assert_eq!(text("R.txt"), "");
    assert!(text("proguard.txt").contains("-keep class org.svbrdf.scanner.Native"));
    assert!(text(expected[1]).lines().all(|line| line.split('=').count() == 2));
    assert!(text(licences[1]).contains("MIT License"));
    let library = |folder: &Path| fs::read(folder.join("libsvbrdf.so")).unwrap();
    assert!(library(&aar.join("jni/x86_64")) == library(&folder));

    let classes = entries(&aar.join("classes.jar"));
    for class in ["MaterialScanner", "ScannerFlows", "SuspendingKt", "Native"] {
        assert!(classes.contains(&format!("org/svbrdf/scanner/{class}.class")), "{class}");
    }
    assert!(classes.contains(&"META-INF/svbrdf-scanner.kotlin_module".into()));
    assert!(
        classes.iter().all(|c| c.starts_with("org/svbrdf/scanner/") || c.starts_with("META-INF"))
    );
    assert!(entries(&name("-sources.jar")).contains(&"org/svbrdf/scanner/Photo.kt".into()));
    pom_is_right(&fs::read_to_string(name(".pom")).unwrap(), version, &tools);
    for ending in [".aar", ".pom", "-sources.jar"] {
        let sum = run(Command::new("sha256sum").arg(name(ending))).stdout;
        let stated = fs::read_to_string(name(&format!("{ending}.sha256"))).unwrap();
        assert!(String::from_utf8(sum).unwrap().starts_with(stated.trim()), "{ending}");
    }
    clients_compile(dir, &tools, &aar.join("classes.jar"));
}

fn pom_is_right(pom: &str, version: &str, tools: &Path) {
    for part in [
        "<groupId>org.svbrdf</groupId>",
        "<artifactId>scanner</artifactId>",
        &format!("<version>{version}</version>"),
        "<packaging>aar</packaging>",
    ] {
        assert!(pom.contains(part), "{part}");
    }
    // The stated version is the one that it was compiled with.
    let coroutines = tools.join("kotlinc/lib/kotlinx-coroutines-core-jvm.jar");
    let stated = Command::new("unzip")
        .arg("-p")
        .arg(coroutines)
        .arg("META-INF/kotlinx_coroutines_core.version")
        .output();
    if let Ok(stated) = stated {
        let stated = String::from_utf8(stated.stdout).unwrap();
        assert!(pom.contains(&format!("<version>{}</version>", stated.trim())), "{stated}");
    }
}

/// Compiles apps in both languages against the archive alone.
fn clients_compile(dir: &Path, tools: &Path, classes: &Path) {
    let lib = tools.join("kotlinc/lib");
    let libraries = [lib.join("kotlin-stdlib.jar"), lib.join("kotlinx-coroutines-core-jvm.jar")];
    let path = class_path(&[&libraries[0], &libraries[1], classes]);
    let app = dir.join("App.kt");
    fs::write(
        &app,
        "import java.io.File\nimport org.svbrdf.scanner.*\n\
         suspend fun scan(photo: Photo, folder: File): Outcome =\n\
         MaterialScanner(ScanOptions(elevationMm = 1.0), ScannerFlows()).use { scanner ->\n\
         val outcome = scanner.addPhotoSuspending(photo, PhotoInfo(flash = Flash.TORCH))\n\
         if (scanner.awaitSuspending(1000)) scanner.exportSuspending(folder)\n\
         outcome }\n",
    )
    .unwrap();
    kotlin(tools, &path, &[app], &[], &dir.join("app"));
    let java = dir.join("Client.java");
    fs::write(
        &java,
        "import java.io.File;\nimport org.svbrdf.scanner.*;\n\
         class Client { static boolean scan(Photo photo, File folder) {\n\
         try (MaterialScanner scanner = new MaterialScanner(new ScanOptions(88f, 88f))) {\n\
         Outcome outcome = scanner.addPhoto(photo);\n\
         if (outcome instanceof Outcome.Accepted) { scanner.await(); scanner.export(folder); }\n\
         return scanner.getProgress().getSettled(); } } }\n",
    )
    .unwrap();
    run(Command::new("javac")
        .args(["-Xlint:all", "-Werror", "-cp", &path, "-d"])
        .arg(dir.join("java"))
        .arg(&java));
}

#[test]
fn libraries_that_no_device_loads_are_refused() {
    if !has("readelf") || !has("gcc") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let check = |abi: &str, folder: &Path| {
        let given = format!("{abi}={}", folder.display());
        Command::new(example().join("aar.sh")).args(["check", &given]).output().unwrap()
    };
    let refused = |abi: &str, folder: &Path, why: &str| {
        let looked = check(abi, folder);
        let said = String::from_utf8_lossy(&looked.stderr).into_owned();
        assert!(!looked.status.success() && said.contains(why), "{why}: {said}");
    };
    let good = stand_ins(dir, "good", "", &LOADED);
    let looked = check("x86_64", &good);
    assert!(looked.status.success(), "{}", String::from_utf8_lossy(&looked.stderr));
    refused("arm64-v8a", &good, "not for AArch64");
    let hidden = "__attribute__((visibility(\"hidden\")))";
    for (name, more, flags, why) in [
        ("pages", "", &["-Wl,-z,nodelete", "-Wl,-z,max-page-size=4096"][..], "16 KB"),
        ("unloaded", "", &LOADED[..1], "nodelete is missing"),
        (
            "newer",
            &format!("{hidden} void more(void) {{ getrandom(); }}\n"),
            &LOADED,
            "getrandom@LIBC_P is not in API 26",
        ),
        (
            "nowhere",
            &format!("void gone(void); {hidden} void more(void) {{ gone(); }}\n"),
            &LOADED,
            "gone is not in API 26",
        ),
        ("exports", "void more(void) {}\n", &LOADED, "more is exported"),
        (
            "relocated",
            "__asm__(\".text\\n.quad svbrdf_version\");\n",
            &[LOADED[0], LOADED[1], "-Wl,-z,notext"],
            "TEXTREL",
        ),
    ] {
        refused("x86_64", &stand_ins(dir, name, more, flags), why);
    }
    // One of ours is missing.
    let renamed = [LOADED[0], LOADED[1], "-Dsvbrdf_version=JNI_OnLoad"];
    refused("x86_64", &stand_ins(dir, "renamed", "", &renamed), "svbrdf_version is not exported");
    // The desktop's own.
    let desktop = dir.join("desktop");
    fs::create_dir(&desktop).unwrap();
    for name in ["libsvbrdf.so", "libsvbrdf.so.0"] {
        fs::copy(library(), desktop.join(name)).unwrap();
    }
    refused("x86_64", &desktop, "SONAME");
    refused("x86_64", &desktop, "it needs what Android does not have");
    for arguments in [&[][..], &["check"]] {
        let usage = Command::new(example().join("aar.sh")).args(arguments).output().unwrap();
        assert_eq!(usage.status.code(), Some(2));
    }
}

#[test]
fn nothing_is_packed_of_libraries_that_no_device_loads() {
    let Some(tools) = tools() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (dir, out) = (dir.path(), dir.path().join("repository"));
    let packed = pack(&out, &tools, &[("x86_64", &stand_ins(dir, "unloaded", "", &LOADED[..1]))]);
    assert!(!packed.status.success() && !out.join("org").exists());
}
