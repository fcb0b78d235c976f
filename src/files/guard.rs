//! Guard around immature decoders.

use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs a decoder and turns its panics into errors: a damaged file must not end the program.
pub fn guarded<T, E: Display>(
    format: &str,
    body: impl FnOnce() -> Result<T, E>,
) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(done) => done.map_err(|fault| format!("{format}: {fault}")),
        Err(_) => Err(format!("{format}: damaged in a way that the decoder does not know")),
    }
}
