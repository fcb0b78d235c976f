//! Names the shared library's major version inside it, keeps it loaded until the process ends, and leaves symbols
//! out that nobody asked for.

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
            // Android packages have no versioned names; devices may have pages of 16 KB.
            link("-soname,libsvbrdf.so");
            link("-z,max-page-size=16384");
            true
        }
        _ => false,
    };
    // Threads that have called the library run destructors of its thread-local values when they end, also after
    // `dlclose`. Android's C library does not keep the code for them as glibc does.
    if elf {
        link("-z,nodelete");
    }
    // The profile's own `strip` would take the names out of the tests' backtraces as well. With debug
    // information (`dist-debug`, CARGO_PROFILE_RELEASE_DEBUG) everything stays.
    if elf && target("PROFILE") == "release" && target("DEBUG") == "false" {
        link("--strip-all");
    }
}
