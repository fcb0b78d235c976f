#![no_main]

#[path = "../shared/files.rs"]
mod files;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    files::run(data);
});
