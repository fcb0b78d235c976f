//! Sets the shared library's version name, keeps it loaded until the process ends, and strips unused symbols.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let target = |key: &str| std::env::var(key).unwrap_or_default();
    let major = std::env::var("CARGO_PKG_VERSION_MAJOR").expect("set by cargo");
    let link = |argument: &str| println!("cargo::rustc-cdylib-link-arg=-Wl,{argument}");
    let elf = match target("CARGO_CFG_TARGET_OS").as_str() {
        "linux" | "freebsd" => {
            link(&format!("-soname,libsvbrdf.so.{major}"));
            true
        }
        "android" => {
            // Android packages have no versioned names; some devices have 16 KB pages.
            link("-soname,libsvbrdf.so");
            link("-z,max-page-size=16384");
            true
        }
        _ => false,
    };
    // Threads that have called the library run its thread-local destructors when they end, even
    // after `dlclose`. Android's C library unloads their code, unlike glibc.
    if elf {
        link("-z,nodelete");
    }
    // The profile's own `strip` would also remove names from the tests' backtraces. Builds with
    // debug information (`dist-debug`, CARGO_PROFILE_RELEASE_DEBUG) keep everything.
    if elf && target("PROFILE") == "release" && target("DEBUG") == "false" {
        link("--strip-all");
    }
}
