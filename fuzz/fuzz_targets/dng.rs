//! The command line's own sources.
#![no_main]
#![allow(dead_code)] // some of it is for folders

extern crate engine as svbrdf;

#[path = "../../cli/src/dng/mod.rs"]
mod dng;
#[path = "../shared/dng.rs"]
mod run;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    run::run(data);
});
