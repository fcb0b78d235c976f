//! Checks that the networks of a folder are supported.

use std::path::Path;

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::{Error, Result};

/// Description of a folder's networks.
const FILE_NAME: &str = "manifest.json";
/// Value of `format`.
const FORMAT: &str = "svbrdf-models/1";
/// Options of each network's architecture that do not affect its use.
const KNOWN: [(&str, &[&str]); 1] = [("photo", &["widths", "spread", "rounds", "deep"])];

#[derive(Deserialize)]
struct Manifest {
    format: String,
    /// Options of each network.
    #[serde(default)]
    networks: Map<String, Value>,
}

/// Checks the description of a folder's networks. A folder without description is accepted.
///
/// # Errors
/// [`Error::Field`] if it describes unknown networks.
pub(super) fn check(folder: &Path) -> Result<()> {
    let path = folder.join(FILE_NAME);
    if !path.exists() {
        return Ok(());
    }
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
    let fault = |field: &str, message: String, expected: String| Error::Field {
        path: path.clone(),
        field: field.to_owned(),
        message,
        expected,
    };
    let manifest: Manifest = serde_json::from_slice(&bytes)
        .map_err(|e| fault("(file)", e.to_string(), "a description of networks".to_owned()))?;
    if manifest.format != FORMAT {
        return Err(fault("format", format!("found {}", manifest.format), FORMAT.to_owned()));
    }
    for (network, options) in &manifest.networks {
        let Some((_, known)) = KNOWN.iter().find(|(name, _)| name == network) else {
            let names = KNOWN.map(|(name, _)| name).join(", ");
            return Err(fault(&format!("networks.{network}"), "an unknown network".into(), names));
        };
        let options = options.as_object();
        let unknown = options.and_then(|o| o.keys().find(|key| !known.contains(&key.as_str())));
        if let Some(option) = unknown {
            let field = format!("networks.{network}.{option}");
            return Err(fault(&field, "an unknown option".to_owned(), known.join(", ")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: &str) -> Result<()> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FILE_NAME), text).unwrap();
        check(folder.path())
    }

    #[test]
    fn unknown_networks_are_refused_by_name() {
        let known = r#"{"format":"svbrdf-models/1","networks":{"photo":{"rounds":3,"deep":true}}}"#;
        assert!(checked(known).is_ok());
        assert!(checked(r#"{"format":"svbrdf-models/1"}"#).is_ok());
        for (wrong, named) in [
            (known.replace("deep", "wide"), "networks.photo.wide"),
            (known.replace("photo", "video"), "networks.video"),
            (known.replace("models/1", "models/2"), "format"),
            ("[]".to_owned(), "(file)"),
        ] {
            let message = checked(&wrong).unwrap_err().to_string();
            assert!(message.contains(named) && message.contains(FILE_NAME), "{message}");
        }
        assert!(check(tempfile::tempdir().unwrap().path()).is_ok());
    }
}
