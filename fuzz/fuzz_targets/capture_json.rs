#![no_main]

#[path = "../shared/capture_json.rs"]
mod capture_json;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    capture_json::run(data);
});
