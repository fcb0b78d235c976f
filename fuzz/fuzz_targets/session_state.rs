#![no_main]

#[path = "../shared/session_state.rs"]
mod session_state;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    session_state::run(data);
});
