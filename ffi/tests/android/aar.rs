//! `android-example/aar.sh`: what it packs, and what it refuses.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{has, library, root, run};
use crate::{class_path, example, kotlin, native, tools};

/// Libraries that stand in for those of a device, which only the NDK links: named, aligned and
/// depending on others as those are.
fn stand_ins(dir: &Path, alignment: u32) -> PathBuf {
    let folder = dir.join(format!("aligned-{alignment}"));
    fs::create_dir(&folder).unwrap();
    let source = folder.join("stand-in.c");
    fs::write(&source, "int stand_in(void) { return 0; }\n").unwrap();
    for (name, depends) in [("svbrdf", None), ("svbrdf_jni", Some("-lsvbrdf"))] {
        run(Command::new("gcc")
            .args(["-shared", "-fPIC", "-nostdlib", "-Wl,--no-as-needed"])
            .arg(format!("-Wl,-soname,lib{name}.so"))
            .arg(format!("-Wl,-z,max-page-size={alignment}"))
            .arg(&source)
            .arg("-L")
            .arg(&folder)
            .args(depends)
            .arg("-o")
            .arg(folder.join(format!("lib{name}.so"))));
    }
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
    let folder = stand_ins(dir, 16384);
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
    // What it was compiled against.
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

/// Apps in both languages, against what is in the archive alone.
fn clients_compile(dir: &Path, tools: &Path, classes: &Path) {
    let lib = tools.join("kotlinc/lib");
    let libraries = [lib.join("kotlin-stdlib.jar"), lib.join("kotlinx-coroutines-core-jvm.jar")];
    let path = class_path(&[&libraries[0], &libraries[1], classes]);
    let app = dir.join("App.kt");
    fs::write(
        &app,
        "import java.io.File\nimport org.svbrdf.scanner.*\n\
         suspend fun scan(photo: Photo, folder: File): Pushed =\n\
         MaterialScanner(ScanOptions(elevationMm = 1.0), ScannerFlows()).use { scanner ->\n\
         val pushed = scanner.pushSuspending(photo, PhotoInfo(flash = Flash.TORCH))\n\
         if (scanner.awaitSuspending(1000)) scanner.exportSuspending(folder)\n\
         pushed }\n",
    )
    .unwrap();
    kotlin(tools, &path, &[app], &[], &dir.join("app"));
    let java = dir.join("Client.java");
    fs::write(
        &java,
        "import java.io.File;\nimport org.svbrdf.scanner.*;\n\
         class Client { static boolean scan(Photo photo, File folder) {\n\
         try (MaterialScanner scanner = new MaterialScanner(new ScanOptions(88f, 88f))) {\n\
         Pushed pushed = scanner.push(photo);\n\
         if (pushed instanceof Pushed.Accepted) { scanner.await(); scanner.export(folder); }\n\
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
    let Some(tools) = tools() else { return };
    if !has("readelf") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let (dir, out) = (dir.path(), dir.path().join("repository"));
    let refused = |abi: &str, folder: &Path, why: &str| {
        let packed = pack(&out, &tools, &[(abi, folder)]);
        let said = String::from_utf8_lossy(&packed.stderr).into_owned();
        assert!(!packed.status.success() && said.contains(why), "{why}: {said}");
        assert!(!out.join("org").exists(), "nothing is packed");
    };
    let good = stand_ins(dir, 16384);
    refused("arm64-v8a", &good, "not for AArch64");
    refused("x86_64", &stand_ins(dir, 4096), "16 KB");
    // The desktop's own.
    let desktop = dir.join("desktop");
    fs::create_dir(&desktop).unwrap();
    for name in ["libsvbrdf.so", "libsvbrdf.so.0"] {
        fs::copy(library(), desktop.join(name)).unwrap();
    }
    native(&desktop);
    refused("x86_64", &desktop, "SONAME");
    fs::copy(good.join("libsvbrdf.so"), desktop.join("libsvbrdf.so")).unwrap();
    refused("x86_64", &desktop, "it needs what Android does not have");
    let usage = Command::new(example().join("aar.sh")).current_dir(root()).output().unwrap();
    assert_eq!(usage.status.code(), Some(2));
}
