//! Options from the command line, by dotted path, or from a file with a subset of them.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use svbrdf::{Error, Result};

/// Changes to default options.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Overrides {
    /// JSON file with the options to change, nested as they are; others keep their defaults
    #[arg(long = "options", global = true, value_name = "FILE")]
    file: Option<PathBuf>,
    /// Option to change, by its path: noise.huber=0.03; may be repeated, goes before --options
    #[arg(long = "set", global = true, value_name = "PATH=VALUE", value_parser = assignment)]
    set: Vec<(String, Value)>,
}

/// Splits `path=value`; the value is JSON, or else a string.
fn assignment(text: &str) -> std::result::Result<(String, Value), String> {
    let (path, value) = text.split_once('=').ok_or("PATH=VALUE expected")?;
    if path.is_empty() {
        return Err("a path before the `=` expected".to_owned());
    }
    let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
    Ok((path.to_owned(), value))
}

/// Source of a change in messages.
const COMMAND_LINE: &str = "--set";

impl Overrides {
    /// `defaults` with the changes of the file, then those of the command line.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Field`] with the path of an unknown option or an invalid value.
    pub fn apply<T: Serialize + DeserializeOwned>(&self, defaults: &T) -> Result<T> {
        let mut options = serde_json::to_value(defaults)
            .map_err(|e| Error::Internal(format!("options are not JSON: {e}")))?;
        if let Some(file) = &self.file {
            let bytes = std::fs::read(file).map_err(|e| Error::io(file, e))?;
            let changes: Value = serde_json::from_slice(&bytes).map_err(|e| {
                fault(file, "(file)", format!("found what is not JSON: {e}"), "JSON")
            })?;
            if !changes.is_object() {
                return Err(fault(file, "(file)", format!("found {changes}"), "an object"));
            }
            for (path, value) in leaves(&options, &changes) {
                set::<T>(&mut options, file, &path, value)?;
            }
        }
        for (path, value) in &self.set {
            set::<T>(&mut options, Path::new(COMMAND_LINE), path, value.clone())?;
        }
        serde_json::from_value(options)
            .map_err(|e| Error::Internal(format!("options cannot be read back: {e}")))
    }
}

/// Paths and values of `changes` at the depth of the objects of `options`.
fn leaves(options: &Value, changes: &Value) -> Vec<(String, Value)> {
    let (Value::Object(known), Value::Object(changed)) = (options, changes) else {
        return vec![(String::new(), changes.clone())];
    };
    let below = |(key, change): (&String, &Value)| {
        let option = known.get(key).unwrap_or(&Value::Null);
        let key = key.clone();
        leaves(option, change).into_iter().map(move |(path, value)| {
            let separator = if path.is_empty() { "" } else { "." };
            (format!("{key}{separator}{path}"), value)
        })
    };
    changed.iter().flat_map(below).collect()
}

/// Changes one option and checks that `T` accepts it.
fn set<T: DeserializeOwned>(
    options: &mut Value,
    source: &Path,
    path: &str,
    value: Value,
) -> Result<()> {
    let mut place = &mut *options;
    for key in path.split('.') {
        let known = match &*place {
            Value::Object(fields) => fields.keys().cloned().collect::<Vec<_>>().join(", "),
            Value::Array(items) => format!("an index below {}", items.len()),
            _ => "nothing below a value".to_owned(),
        };
        let next = match place {
            Value::Object(fields) => fields.get_mut(key),
            Value::Array(items) => key.parse().ok().and_then(|i: usize| items.get_mut(i)),
            _ => None,
        };
        place = next.ok_or_else(|| {
            fault(source, path, format!("`{key}` is no option"), &format!("one of {known}"))
        })?;
    }
    let before = std::mem::replace(place, value);
    let fits = serde_json::from_value::<T>(options.clone());
    let found = options.pointer(&format!("/{}", path.replace('.', "/"))).cloned();
    fits.map(|_| ()).map_err(|e| {
        let found = found.unwrap_or_default();
        let expected = format!("a value like {before}");
        fault(source, path, format!("found {found}: {e}"), &expected)
    })
}

fn fault(source: &Path, field: &str, message: String, expected: &str) -> Error {
    Error::Field {
        path: source.to_owned(),
        field: field.to_owned(),
        message,
        expected: expected.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    struct Options {
        refinement: Refinement,
        limit: Option<f64>,
    }

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    struct Refinement {
        steps: usize,
        widths: [f64; 2],
        name: String,
    }

    fn defaults() -> Options {
        let refinement = Refinement { steps: 20, widths: [0.1, 0.2], name: "wide".into() };
        Options { refinement, limit: None }
    }

    fn overrides(set: &[&str], file: Option<PathBuf>) -> Overrides {
        Overrides { file, set: set.iter().map(|text| assignment(text).unwrap()).collect() }
    }

    fn message(set: &[&str]) -> String {
        overrides(set, None).apply(&defaults()).unwrap_err().to_string()
    }

    #[test]
    fn nothing_said_changes_nothing() {
        assert_eq!(Overrides::default().apply(&defaults()).unwrap(), defaults());
    }

    #[test]
    fn options_are_set_by_path() {
        let set =
            ["refinement.steps=6", "refinement.widths.1=0.5", "refinement.name=narrow", "limit=3"];
        let options = overrides(&set, None).apply(&defaults()).unwrap();
        let refinement = Refinement { steps: 6, widths: [0.1, 0.5], name: "narrow".into() };
        assert_eq!(options, Options { refinement, limit: Some(3.0) });
    }

    /// The command line overrides the file.
    #[test]
    fn command_line_goes_before_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("options.json");
        let text = r#"{"refinement": {"steps": 7, "widths": [1, 2]}, "limit": 0.5}"#;
        std::fs::write(&file, text).unwrap();
        let options = overrides(&["limit=2"], Some(file)).apply(&defaults()).unwrap();
        let refinement = Refinement { steps: 7, widths: [1.0, 2.0], ..defaults().refinement };
        assert_eq!(options, Options { refinement, limit: Some(2.0) });
    }

    #[test]
    fn faults_name_the_path() {
        for (set, says) in [
            (
                "refinment.steps=6",
                "field `refinment.steps`: `refinment` is no option; expected one of limit, refinement",
            ),
            ("refinement.step=6", "expected one of name, steps, widths"),
            ("refinement.steps=6.5", "field `refinement.steps`: found 6.5"),
            ("refinement.steps=-1", "expected a value like 20"),
            ("refinement=3", "field `refinement`: found 3"),
            ("refinement.widths.2=1", "an index below 2"),
            ("refinement.steps.x=1", "nothing below a value"),
        ] {
            let message = message(&[set]);
            assert!(message.starts_with("--set: ") && message.contains(says), "{message}");
        }
        assert!(assignment("steps").is_err() && assignment("=1").is_err());
    }

    #[test]
    fn faults_of_a_file_name_it() {
        let dir = tempfile::tempdir().unwrap();
        for (text, says) in [
            ("{", "options.json: field `(file)`: found what is not JSON"),
            ("[1]", "expected an object"),
            (r#"{"refinement": {"stepps": 1}}"#, "options.json: field `refinement.stepps`"),
            (r#"{"refinement": {"widths": [1]}}"#, "field `refinement.widths`: found [1]"),
        ] {
            let file = dir.path().join("options.json");
            std::fs::write(&file, text).unwrap();
            let error = overrides(&[], Some(file)).apply(&defaults()).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
