#![no_main]

#[path = "../shared/photo.rs"]
mod photo;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    photo::run(data);
});
