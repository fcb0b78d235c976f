//! Checks of constants.

use crate::status::Fault;

/// Error for an unknown constant.
pub(crate) fn unknown(field: &str, value: u32) -> Fault {
    Fault::argument(format!("{field}: {value} is not a known value"))
}

/// A field that is 0 or 1.
pub(crate) fn truth(field: &str, value: u32) -> Result<bool, Fault> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(unknown(field, other)),
    }
}
