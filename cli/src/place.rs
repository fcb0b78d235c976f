//! Where commands write.

use std::path::Path;

use crate::failure::{Failure, Result};

/// Refuses a file where a folder is to be written.
pub fn folder(option: &str, path: &Path) -> Result<()> {
    if path.exists() && !path.is_dir() {
        return Err(Failure::Input(format!(
            "{option} {}: a file; expected a folder, which is made if it is missing",
            path.display()
        )));
    }
    Ok(())
}

/// Refuses a folder where a file is to be written.
pub fn file(option: &str, path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Failure::Input(format!(
            "{option} {}: a folder; expected the name of a file",
            path.display()
        )));
    }
    Ok(())
}
