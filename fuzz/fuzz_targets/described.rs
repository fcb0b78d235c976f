//! The command line's own sources.
#![no_main]
#![allow(dead_code)] // some of it is for folders

extern crate engine as svbrdf;

#[path = "../shared/described.rs"]
mod described;
#[path = "../../cli/src/dng/mod.rs"]
mod dng;
#[path = "../../cli/src/pictures/metadata.rs"]
mod metadata;
#[path = "../../cli/src/pictures/profile.rs"]
mod profile;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    described::run(data);
});
