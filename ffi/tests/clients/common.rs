//! Builds the library and its clients.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Arc, Mutex, OnceLock};

use tempfile::TempDir;

#[path = "../../../tests/common/picture.rs"]
mod picture;
use picture::picture;
#[allow(unused_imports)] // by clients in C and C++
pub use picture::save_png;

/// The repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Runs a command that has to succeed.
pub fn run(command: &mut Command) -> Output {
    let shown = format!("{command:?}");
    let output = command.output().unwrap_or_else(|e| panic!("{shown}: {e}"));
    assert!(
        output.status.success(),
        "{shown}: {}\n{}\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// Whether a program is there; says loudly when not.
pub fn has(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    if !found {
        skipped(&format!("{program} is not installed; what it checks is not checked"));
    }
    found
}

/// Reports a skipped check, and notes it in the list that `SVBRDF_SKIPPED` names: `tests/run.sh` counts them.
pub fn skipped(what: &str) {
    eprintln!("SKIPPED: {what}");
    if let Some(list) = env::var_os("SVBRDF_SKIPPED") {
        let mut file = fs::OpenOptions::new().create(true).append(true).open(list).unwrap();
        file.write_all(format!("{what}\n").as_bytes()).unwrap();
    }
}

/// The shared library: the file that `SVBRDF_LIBRARY` names, or else built with this test's profile. Cargo does
/// not build it for tests.
pub fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        if let Some(path) = env::var_os("SVBRDF_LIBRARY") {
            let path = root().join(path);
            assert!(path.is_file(), "SVBRDF_LIBRARY: {} is no file", path.display());
            return path;
        }
        // target/PROFILE/deps/this-test
        let this = env::current_exe().unwrap();
        let profile_dir = this.parent().unwrap().parent().unwrap();
        let mut build = Command::new(env!("CARGO"));
        // The default members, as tests are built: of one package alone, dependencies would have other
        // features and be compiled anew.
        build.current_dir(root()).args(["build", "--lib"]);
        match profile_dir.file_name().unwrap().to_str().unwrap() {
            "debug" => {}
            profile => {
                build.args(["--profile", profile]);
            }
        }
        run(&mut build);
        profile_dir.join("libsvbrdf.so")
    })
}

/// The library under both its names.
pub fn link_library(dir: &Path) {
    for name in ["libsvbrdf.so", "libsvbrdf.so.0"] {
        std::os::unix::fs::symlink(library(), dir.join(name)).unwrap();
    }
}

/// A folder in which the library has both its names, with the models and a capture.
pub fn workplace() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    link_library(dir.path());
    for (name, place) in [("models", "models"), ("capture", "examples/captures/tile")] {
        std::os::unix::fs::symlink(root().join(place), dir.path().join(name)).unwrap();
    }
    dir
}

/// The bundled capture's photos as PPM files: clients need no decoder.
pub fn write_photos(dir: &Path, count: usize) {
    for i in 0..count {
        let name = format!("examples/captures/tile/frames/{i:02}.jpg");
        let photo = picture(root().join(name)).into_rgb8();
        let mut ppm = format!("P6 {} {} 255\n", photo.width(), photo.height()).into_bytes();
        ppm.extend(photo.into_raw());
        fs::write(dir.join(format!("{i:02}.ppm")), ppm).unwrap();
    }
}

/// A client of the library, compiled once for all tests that run it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Build {
    pub compiler: &'static str,
    /// `c` or `cpp`: the folder of its sources in `tests`.
    pub language: &'static str,
    /// With AddressSanitizer and UndefinedBehaviorSanitizer, which end it at the first fault.
    pub sanitized: bool,
}

impl Build {
    /// Compiles it, warnings as errors.
    pub fn program(self) -> PathBuf {
        static PROGRAMS: Mutex<BTreeMap<Build, Arc<OnceLock<PathBuf>>>> =
            Mutex::new(BTreeMap::new());
        let program = Arc::clone(PROGRAMS.lock().unwrap().entry(self).or_default());
        program.get_or_init(|| self.compile()).clone()
    }

    fn compile(self) -> PathBuf {
        let Self { compiler, language, sanitized } = self;
        let kind = if sanitized { "sanitized" } else { "plain" };
        let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{compiler}-{kind}"));
        let _ = fs::remove_dir_all(&dir);
        fs::create_dir_all(&dir).unwrap();
        link_library(&dir);
        let mut sources: Vec<PathBuf> = fs::read_dir(root().join("tests").join(language))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == language))
            .collect();
        sources.sort();
        let standard = if language == "c" { "-std=c99" } else { "-std=c++17" };
        let sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
        let out = dir.join("client");
        let mut command = Command::new(compiler);
        command
            .args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow"])
            // usleep() and pthreads beside C99.
            .arg("-D_DEFAULT_SOURCE")
            .args(if sanitized { &sanitizers[..] } else { &[] })
            .arg("-I")
            .arg(root().join("include"))
            .args(sources)
            .arg("-L")
            .arg(&dir)
            .args(["-lsvbrdf", "-lm", "-lpthread", "-Wl,-rpath,$ORIGIN", "-o"])
            .arg(&out);
        run(&mut command);
        out
    }
}
