//! Names the shared library's major version inside it.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let target = |key: &str| std::env::var(key).unwrap_or_default();
    let major = std::env::var("CARGO_PKG_VERSION_MAJOR").expect("set by cargo");
    match target("CARGO_CFG_TARGET_OS").as_str() {
        "linux" | "freebsd" => {
            println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libsvbrdf.so.{major}");
        }
        "android" => {
            // Android packages have no versioned names; devices may have pages of 16 KB.
            println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libsvbrdf.so");
            println!("cargo::rustc-cdylib-link-arg=-Wl,-z,max-page-size=16384");
        }
        _ => {}
    }
}
