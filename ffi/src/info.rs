//! Version and features.

use std::ffi::{CStr, c_char};

/// Major version of this header. Libraries of another one do not fit.
pub const SVBRDF_VERSION_MAJOR: u32 = 0;
/// Minor version of this header. Libraries of a newer one fit.
pub const SVBRDF_VERSION_MINOR: u32 = 1;
/// Patch version of this header.
pub const SVBRDF_VERSION_PATCH: u32 = 0;

/// svbrdf_features(): the models are inside the library.
pub const SVBRDF_FEATURE_EMBEDDED_MODELS: u64 = 1;
/// svbrdf_features(): YUV buffers are taken.
pub const SVBRDF_FEATURE_YUV: u64 = 2;
/// svbrdf_features(): raw sensor buffers are taken.
pub const SVBRDF_FEATURE_RAW: u64 = 4;
/// svbrdf_features(): files are read, see svbrdf_session_add_photo_file().
pub const SVBRDF_FEATURE_FILES: u64 = 8;

/// Version of the library, e.g. "0.1.0". Static, never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(version) => version,
            Err(_) => panic!("a version without NUL"),
        };
    VERSION.as_ptr()
}

/// Version of the library as a number: major * 65536 + minor * 256 + patch.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_version_number() -> u32 {
    SVBRDF_VERSION_MAJOR << 16 | SVBRDF_VERSION_MINOR << 8 | SVBRDF_VERSION_PATCH
}

/// Features of this build: an OR of SVBRDF_FEATURE_ values.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_features() -> u64 {
    let models = if cfg!(feature = "embedded-models") { SVBRDF_FEATURE_EMBEDDED_MODELS } else { 0 };
    let files = if cfg!(feature = "files") { SVBRDF_FEATURE_FILES } else { 0 };
    models | files | SVBRDF_FEATURE_YUV | SVBRDF_FEATURE_RAW
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_has_the_version_of_the_package() {
        let header =
            format!("{SVBRDF_VERSION_MAJOR}.{SVBRDF_VERSION_MINOR}.{SVBRDF_VERSION_PATCH}");
        assert_eq!(header, env!("CARGO_PKG_VERSION"));
    }
}
