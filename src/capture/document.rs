//! A JSON document with error messages that name file, field, value found and values expected.

use std::path::Path;

use serde_json::Value;

use crate::{Error, Result};

/// Largest description, bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Reads a JSON file.
pub fn read_json(path: &Path) -> Result<Value> {
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > MAX_BYTES {
        return Err(Error::Field {
            path: path.to_owned(),
            field: "(file)".into(),
            message: format!("found {size} bytes"),
            expected: format!("a description of at most {MAX_BYTES} bytes"),
        });
    }
    parse_json(path, &std::fs::read(path).map_err(|e| Error::io(path, e))?)
}

/// Parses JSON; `path` names the source in errors.
pub fn parse_json(path: &Path, bytes: &[u8]) -> Result<Value> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    serde_json::from_slice(text).map_err(|fault| {
        let before = text_before(text, fault.line(), fault.column());
        Error::Field {
            path: path.to_owned(),
            field: last_key(&before).unwrap_or("(file)").to_owned(),
            message: format!("found invalid JSON: {fault}"),
            expected: "valid JSON whose numbers are finite (no NaN, no Infinity)".into(),
        }
    })
}

/// The text up to a position counted from 1.
fn text_before(text: &[u8], line: usize, column: usize) -> String {
    let start: usize =
        text.split_inclusive(|&b| b == b'\n').take(line.saturating_sub(1)).map(<[u8]>::len).sum();
    let end = (start + column).min(text.len());
    String::from_utf8_lossy(&text[..end]).into_owned()
}

/// The last key of an object in a piece of JSON.
fn last_key(text: &str) -> Option<&str> {
    let mut end = text.len();
    while let Some(colon) = text[..end].rfind(':') {
        if let Some(quoted) = text[..colon].trim_end().strip_suffix('"')
            && let Some(open) = quoted.rfind('"')
        {
            return Some(&quoted[open + 1..]);
        }
        end = colon;
    }
    None
}

/// A position in a document, with its value if present.
pub struct Node<'a> {
    file: &'a Path,
    path: String,
    value: Option<&'a Value>,
}

impl<'a> Node<'a> {
    /// The whole document.
    pub fn root(file: &'a Path, value: &'a Value) -> Self {
        Self { file, path: String::new(), value: Some(value) }
    }

    /// A field of an object, present or not.
    pub fn get(&self, key: &str) -> Self {
        let path =
            if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        Self { file: self.file, path, value: self.value.and_then(|v| v.get(key)) }
    }

    /// The node, unless it is missing or null.
    pub fn optional(self) -> Option<Self> {
        self.value.is_some_and(|v| !v.is_null()).then_some(self)
    }

    /// The file of the document.
    pub fn file(&self) -> &Path {
        self.file
    }

    /// Path of the node in dotted notation.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The value.
    pub fn value(&self) -> Option<&'a Value> {
        self.value
    }

    /// A fault of this node: the value found and the values expected.
    pub fn fault(&self, expected: impl Into<String>) -> Error {
        let message = match self.value {
            None => "missing".into(),
            Some(Value::Object(_)) => "found an object".into(),
            Some(value) => {
                let mut text = value.to_string();
                if text.len() > 80 {
                    let cut = (0..=77).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0);
                    text.truncate(cut);
                    text.push_str("...");
                }
                format!("found {text}")
            }
        };
        let field = if self.path.is_empty() { "(file)" } else { &self.path };
        Error::Field {
            path: self.file.to_owned(),
            field: field.to_owned(),
            message,
            expected: expected.into(),
        }
    }

    /// Checks that the value is an object.
    pub fn object(&self) -> Result<()> {
        match self.value {
            Some(Value::Object(_)) => Ok(()),
            _ => Err(self.fault("an object")),
        }
    }

    /// The elements of a list.
    pub fn list(&self) -> Result<Vec<Self>> {
        match self.value {
            Some(Value::Array(items)) => Ok(items
                .iter()
                .enumerate()
                .map(|(i, value)| Self {
                    file: self.file,
                    path: format!("{}[{i}]", self.path),
                    value: Some(value),
                })
                .collect()),
            _ => Err(self.fault("a list")),
        }
    }

    /// A text.
    pub fn text(&self, expected: &str) -> Result<&'a str> {
        self.value.and_then(Value::as_str).ok_or_else(|| self.fault(expected))
    }

    /// `true` or `false`.
    pub fn boolean(&self) -> Result<bool> {
        self.value.and_then(Value::as_bool).ok_or_else(|| self.fault("true or false"))
    }

    /// A finite number.
    pub fn number(&self, expected: &str) -> Result<f64> {
        let number = self.value.and_then(Value::as_f64).filter(|v| v.is_finite());
        number.ok_or_else(|| self.fault(expected))
    }

    /// `N` finite numbers.
    pub fn numbers<const N: usize>(&self, expected: &str) -> Result<[f64; N]> {
        let Some(Value::Array(items)) = self.value else { return Err(self.fault(expected)) };
        let numbers: Option<Vec<f64>> =
            items.iter().map(|v| v.as_f64().filter(|v| v.is_finite())).collect();
        numbers.and_then(|v| v.try_into().ok()).ok_or_else(|| self.fault(expected))
    }

    /// An integer; `17.0` is one.
    pub fn count(&self, expected: &str) -> Result<u32> {
        let number = self.number(expected)?;
        whole(number).ok_or_else(|| self.fault(expected))
    }

    /// `N` integers.
    pub fn counts<const N: usize>(&self, expected: &str) -> Result<[u32; N]> {
        let whole: Option<Vec<u32>> = self.numbers::<N>(expected)?.into_iter().map(whole).collect();
        whole.and_then(|v| v.try_into().ok()).ok_or_else(|| self.fault(expected))
    }

    /// One of several texts.
    pub fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T> {
        let text = self.value.and_then(Value::as_str);
        choices.iter().find(|(name, _)| Some(*name) == text).map(|(_, v)| *v).ok_or_else(|| {
            let names: Vec<String> = choices.iter().map(|(n, _)| format!("\"{n}\"")).collect();
            self.fault(names.join(" or "))
        })
    }
}

fn whole(number: f64) -> Option<u32> {
    ((0.0..=f64::from(u32::MAX)).contains(&number) && number.fract() == 0.0)
        .then_some(number as u32)
}
