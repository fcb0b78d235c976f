//! `ffi/swift`: the names of C that it uses are in the header. With the compiler of `tests/swift-tools.sh` it is
//! compiled and run; stand-ins replace Apple's frameworks.
#![cfg(target_os = "linux")]

#[allow(dead_code)] // Clients in C need more of it.
#[path = "clients/common.rs"]
mod common;

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::{has, library, root, run, skipped, workplace, write_photos};

fn package() -> PathBuf {
    root().join("ffi/swift")
}

fn sources() -> Vec<PathBuf> {
    let folder = package().join("Sources/SVBRDFScanner");
    let mut found: Vec<PathBuf> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

/// The Swift of the documentation, a block each.
fn documented() -> Vec<String> {
    let read = |page: &str| fs::read_to_string(root().join("docs").join(page)).unwrap();
    let text = read("embedding.md") + &read("live-loop.md");
    let blocks = text.split("```swift\n").skip(1);
    let found: Vec<_> = blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect();
    assert_eq!(found.len(), 2, "blocks of Swift");
    found
}

/// Without comments and text.
fn code_alone(source: &str, comment: (&str, &str)) -> String {
    let mut left = source;
    let mut code = String::new();
    while let Some(at) = left.find(['"', '/']) {
        code.push_str(&left[..at]);
        left = &left[at..];
        let end = if let Some(text) = left.strip_prefix('"') {
            text.find('"').map(|i| i + 2)
        } else if left.starts_with("//") {
            left.find('\n')
        } else if left.starts_with(comment.0) {
            left.find(comment.1).map(|i| i + comment.1.len())
        } else {
            code.push('/');
            Some(1)
        };
        left = &left[end.unwrap_or(left.len())..];
    }
    code + left
}

/// Words that begin with a prefix, and the text after each.
fn words<'a>(code: &'a str, prefix: &'a str) -> impl Iterator<Item = (&'a str, &'a str)> {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(prefix).filter_map(move |(at, _)| {
        let begins = !code[..at].ends_with(part);
        let length = code[at..].find(|c| !part(c)).unwrap_or(code.len() - at);
        begins.then(|| (&code[at..at + length], &code[at + length..]))
    })
}

/// The arguments in the parentheses at the beginning, split at the commas of that level.
fn arguments(text: &str) -> Vec<String> {
    let (mut depth, mut found) = (0, vec![String::new()]);
    for c in text.chars() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            _ => {}
        }
        match c {
            _ if depth == 0 => break,
            ',' if depth == 1 => found.push(String::new()),
            '(' if depth == 1 && found.len() == 1 && found[0].is_empty() => {}
            _ => found.last_mut().unwrap().push(c),
        }
    }
    found.retain(|argument| !argument.trim().is_empty());
    found
}

/// The declarations of the header: parameters of functions, fields of structs, other types, and constants.
struct Header {
    functions: BTreeMap<String, usize>,
    structs: BTreeMap<String, String>,
    types: Vec<String>,
    constants: Vec<String>,
}

impl Header {
    fn read() -> Self {
        let text = fs::read_to_string(root().join("include/svbrdf.h")).unwrap();
        let code = code_alone(&text, ("/*", "*/"));
        let mut functions = BTreeMap::new();
        let (mut structs, mut types) = (BTreeMap::new(), Vec::new());
        for (name, rest) in words(&code, "svbrdf_") {
            if let Some(parameters) = rest.strip_prefix('(') {
                let list = arguments(&format!("({parameters}"));
                let none = list.len() == 1 && list[0].trim() == "void";
                functions.insert(name.to_owned(), if none { 0 } else { list.len() });
            } else if let Some(fields) = rest.strip_prefix(" {") {
                structs.insert(name.to_owned(), fields.split('}').next().unwrap().to_owned());
            } else if rest.starts_with(';') || rest.starts_with(")(") {
                types.push(name.to_owned());
            }
        }
        let constants = code.lines().filter_map(|line| line.strip_prefix("#define "));
        let constants = constants.map(|l| l.split(' ').next().unwrap().to_owned()).collect();
        Self { functions, structs, types, constants }
    }

    /// The faults of a piece of Swift.
    fn faults(&self, swift: &str) -> Vec<String> {
        let code = code_alone(swift, ("/*", "*/"));
        let mut faults = Vec::new();
        for (name, _) in words(&code, "SVBRDF_") {
            if !self.constants.iter().any(|known| known == name) {
                faults.push(format!("{name} is not in the header"));
            }
        }
        for (name, rest) in words(&code, "svbrdf_") {
            let given = rest.starts_with('(').then(|| arguments(rest));
            if let Some(&expected) = self.functions.get(name) {
                if let Some(given) = given.filter(|given| given.len() != expected) {
                    let given = given.len();
                    faults.push(format!("{name}: {given} arguments, the header has {expected}"));
                }
            } else if let Some(fields) = self.structs.get(name) {
                for argument in given.unwrap_or_default() {
                    let label = argument.split(':').next().unwrap().trim().to_owned();
                    if !words(fields, &label).any(|(word, _)| word == label) {
                        faults.push(format!("{name} has no field {label}"));
                    }
                }
            } else if !self.types.iter().any(|known| known == name) {
                faults.push(format!("{name} is not in the header"));
            }
        }
        faults
    }
}

#[test]
fn what_the_package_names_of_c_is_in_the_header() {
    let header = Header::read();
    assert!(
        header.functions.len() > 70 && header.structs.len() > 10,
        "the header is not understood"
    );
    assert_eq!(header.functions["svbrdf_session_add_photo_async"], 5);
    assert_eq!(header.functions["svbrdf_version"], 0);
    let mut called = 0;
    for path in sources() {
        let text = fs::read_to_string(&path).unwrap();
        let faults = header.faults(&text);
        assert!(faults.is_empty(), "{}: {faults:?}", path.display());
        called += words(&code_alone(&text, ("/*", "*/")), "svbrdf_session_").count();
    }
    assert!(called > 20, "{called} functions of sessions");
    for block in documented() {
        assert!(header.faults(&block).is_empty(), "{:?}", header.faults(&block));
    }
}

#[test]
fn what_is_not_in_the_header_is_found() {
    let header = Header::read();
    for (swift, fault) in [
        ("svbrdf_session_pauze(s)", "svbrdf_session_pauze is not in the header"),
        ("svbrdf_session_pause(s, (1, 2))", "svbrdf_session_pause: 2 arguments, the header has 1"),
        ("svbrdf_version(x)", "svbrdf_version: 1 arguments, the header has 0"),
        ("svbrdf_transfer(SVBRDF_TRANSFER_LOG)", "SVBRDF_TRANSFER_LOG is not in the header"),
        ("svbrdf_plane(data: p, rows: 3)", "svbrdf_plane has no field rows"),
    ] {
        assert_eq!(header.faults(swift), [fault]);
    }
    let fine = "svbrdf_maps_copy(a, b(1, 2), c, d[1, 2], e, f) // svbrdf_none\n\"svbrdf_none\"";
    assert!(header.faults(fine).is_empty());
}

/// The oldest systems that the package names are those that its library is built for, and its headers lie
/// where two libraries' do not meet.
#[test]
fn the_script_and_the_package_agree() {
    let script = fs::read_to_string(package().join("xcframework.sh")).unwrap();
    let manifest = fs::read_to_string(package().join("Package.swift")).unwrap();
    for (variable, platform) in
        [("IPHONEOS_DEPLOYMENT_TARGET", ".iOS(.v"), ("MACOSX_DEPLOYMENT_TARGET", ".macOS(.v")]
    {
        let built = script.split(&format!("{variable}:-")).nth(1).unwrap();
        let built = built.split('}').next().unwrap().trim_end_matches(".0");
        let named = manifest.split(platform).nth(1).unwrap().split(')').next().unwrap();
        assert_eq!(built, named, "{variable}");
    }
    assert!(script.contains("headers/SVBRDF"), "headers in a folder of the module's name");
}

/// A compiler, with the C library that it was built for.
struct Swift {
    root: PathBuf,
    work: PathBuf,
}

impl Swift {
    /// `None`, said loudly, where `tests/swift-tools.sh` has not run.
    fn found(work: &Path) -> Option<Self> {
        // target/PROFILE/deps/this-test
        let this = env::current_exe().unwrap();
        let tools = this.ancestors().nth(3).unwrap().join("swift-tools");
        if !tools.join("complete").is_file() {
            skipped("tests/swift-tools.sh has not run; ffi/swift is not compiled");
            return None;
        }
        let include = root().join("include/svbrdf.h");
        let module =
            format!("module SVBRDF [system] {{ header \"{}\" export * }}\n", include.display());
        fs::create_dir(work.join("c")).unwrap();
        fs::write(work.join("c/module.modulemap"), module).unwrap();
        Some(Self { root: tools.join("root"), work: work.to_owned() })
    }

    fn libraries(&self) -> PathBuf {
        self.root.join("usr/libexec/swift/lib/swift/linux")
    }

    /// A program of Debian 13, on any.
    fn program(&self, program: &Path, libraries: &Path) -> Command {
        let mut command = Command::new(self.root.join("usr/lib64/ld-linux-x86-64.so.2"));
        let system = self.root.join("usr/lib/x86_64-linux-gnu");
        let own = self.root.join("usr/libexec/swift/lib");
        let path =
            [&system, &self.libraries(), &own, libraries].map(|p| p.to_str().unwrap()).join(":");
        command.arg("--library-path").arg(path).arg(program).env("SWIFT_BACKTRACE", "enable=no");
        command
    }

    /// Compiles a module or a program's part with warnings as errors, in a language mode.
    fn compile(&self, mode: &str, module: &str, sources: &[PathBuf], extra: &[&str], out: &Path) {
        let frontend = self.root.join("usr/libexec/swift/bin/swift-frontend");
        let mut command = self.program(&frontend, &self.work);
        command
            .args(["-frontend", "-parse-as-library", "-warnings-as-errors", "-wmo"])
            .args(["-strict-concurrency=complete", "-swift-version", mode, "-sdk", "/"])
            .arg("-resource-dir")
            .arg(self.root.join("usr/libexec/swift/lib/swift"))
            .arg("-I")
            .arg(self.work.join("c"))
            .arg("-I")
            .arg(&self.work)
            .args(["-module-name", module])
            .args(extra)
            .args(sources)
            .arg("-o")
            .arg(out);
        run(&mut command);
    }
}

/// Compiles with stand-ins for Apple's frameworks, so that the code for these is checked too.
fn compiles_as_for_apple(swift: &Swift, mode: &str) {
    let apple = swift.work.join(format!("apple-{mode}"));
    fs::create_dir(&apple).unwrap();
    let beside = ["-I", apple.to_str().unwrap()];
    for module in ["CoreVideo", "Metal", "AVFoundation"] {
        let source = package().join(format!("check/stand-ins/{module}.swift"));
        let out = apple.join(format!("{module}.swiftmodule"));
        swift.compile(mode, module, &[source], &["-emit-module", beside[0], beside[1]], &out);
    }
    let out = apple.join("SVBRDFScanner.swiftmodule");
    let emit = ["-emit-module", beside[0], beside[1]];
    swift.compile(mode, "SVBRDFScanner", &sources(), &emit, &out);
    swift.compile(
        mode,
        "SVBRDFScanner",
        &sources(),
        &["-c", beside[0], beside[1]],
        &apple.join("a.o"),
    );
    let example = package().join("Example/CaptureController.swift");
    let out = apple.join("example.o");
    swift.compile(mode, "example", &[example], &["-c", beside[0], beside[1]], &out);
    for (i, block) in documented().into_iter().enumerate() {
        let source = apple.join(format!("block{i}.swift"));
        fs::write(&source, block).unwrap();
        let out = apple.join(format!("block{i}.o"));
        swift.compile(mode, "example", &[source], &["-c", beside[0], beside[1]], &out);
    }
}

#[test]
fn the_package_compiles_and_scans() {
    let dir = workplace();
    let dir = dir.path();
    let Some(swift) = Swift::found(dir) else { return };
    if !has("gcc") {
        return;
    }
    for mode in ["5", "6"] {
        compiles_as_for_apple(&swift, mode);
    }
    let module = dir.join("SVBRDFScanner.swiftmodule");
    swift.compile("6", "SVBRDFScanner", &sources(), &["-emit-module"], &module);
    let (scanner, check) = (dir.join("scanner.o"), dir.join("check.o"));
    swift.compile("6", "SVBRDFScanner", &sources(), &["-c"], &scanner);
    swift.compile("6", "check", &[package().join("check/Check.swift")], &["-c"], &check);
    let program = dir.join("check");
    run(Command::new("gcc")
        .args([&check, &scanner, &swift.libraries().join("x86_64/swiftrt.o")])
        .arg("-L")
        .arg(swift.libraries())
        .arg("-L")
        .arg(library().parent().unwrap())
        .args(["-lswiftCore", "-lswift_Concurrency", "-lswift_StringProcessing", "-lswiftGlibc"])
        .args(["-lswiftSwiftOnoneSupport", "-lswiftDispatch", "-ldispatch", "-lBlocksRuntime"])
        .args(["-lFoundation", "-lFoundationEssentials", "-lFoundationInternationalization"])
        // Of a newer C library than this system's.
        .args(["-lsvbrdf", "-lm", "-Wl,--allow-shlib-undefined", "-o"])
        .arg(&program));
    write_photos(dir, 2);
    let done = run(swift.program(&program, dir).args([dir, &dir.join("maps")]));
    assert_eq!(String::from_utf8(done.stdout).unwrap().trim(), "done");
}
