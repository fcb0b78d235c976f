//! NumPy arrays of 32-bit floats, file format versions 1 to 3.

use std::path::Path;

use svbrdf::{Error, Result};

/// Largest file read, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Numbers in row-major order.
#[derive(Debug, PartialEq)]
pub struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// Reads an array of little-endian 32-bit floats in row-major order.
///
/// # Errors
/// [`Error::Io`]; [`Error::Field`] with the faulty part of the header.
pub fn read(path: &Path) -> Result<Array> {
    let size = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if size > MAX_BYTES {
        return Err(fault(path, "(file)", &format!("{size} bytes"), "at most 1 GiB"));
    }
    parse(path, &std::fs::read(path).map_err(|e| Error::io(path, e))?)
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Array> {
    let magic = || fault(path, "(file)", "something else", "an array in NumPy's format");
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(magic)?;
    let (header, data) = match rest {
        [1, _, a, b, rest @ ..] => rest.split_at_checked(usize::from(u16::from_le_bytes([*a, *b]))),
        [2 | 3, _, a, b, c, d, rest @ ..] => {
            rest.split_at_checked(u32::from_le_bytes([*a, *b, *c, *d]) as usize)
        }
        _ => return Err(fault(path, "version", "another", "1, 2 or 3")),
    }
    .ok_or_else(|| fault(path, "(file)", "an end within the header", "a whole header"))?;
    let header = String::from_utf8_lossy(header);
    let descr = entry(&header, "descr").unwrap_or_default();
    if descr != "'<f4'" {
        return Err(fault(path, "descr", descr, "'<f4'"));
    }
    let order = entry(&header, "fortran_order").unwrap_or_default();
    if order != "False" {
        return Err(fault(path, "fortran_order", order, "False"));
    }
    let text = entry(&header, "shape").unwrap_or_default();
    let shape =
        shape(text).ok_or_else(|| fault(path, "shape", text, "a tuple of whole numbers"))?;
    let bytes = shape.iter().try_fold(4usize, |n, &m| n.checked_mul(m));
    if bytes != Some(data.len()) {
        let expected = format!("those of an array of shape {text}");
        return Err(fault(path, "(data)", &format!("{} bytes", data.len()), &expected));
    }
    let (quads, _) = data.as_chunks::<4>();
    let values = quads.iter().map(|&quad| f32::from_le_bytes(quad)).collect();
    Ok(Array { shape, values })
}

/// Value of a key in the header, a Python dictionary of a string, a boolean and a tuple.
fn entry<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let quoted = format!("'{key}':");
    let value = header[header.find(&quoted)? + quoted.len()..].trim_start();
    let end = if value.starts_with('(') { value.find(')')? + 1 } else { value.find([',', '}'])? };
    Some(value[..end].trim_end())
}

fn shape(tuple: &str) -> Option<Vec<usize>> {
    let inside = tuple.strip_prefix('(')?.strip_suffix(')')?;
    let numbers = inside.split(',').map(str::trim).filter(|part| !part.is_empty());
    numbers.map(|part| part.parse().ok()).collect()
}

fn fault(path: &Path, field: &str, found: &str, expected: &str) -> Error {
    Error::Field {
        path: path.to_owned(),
        field: field.to_owned(),
        message: if found.is_empty() { "missing".into() } else { format!("found {found}") },
        expected: expected.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file by the format's specification: magic, version, length, dictionary, padding, newline.
    fn file(version: u8, header: &str, values: &[f32]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend([version, 0]);
        let length = header.len() as u32 + 1;
        bytes.extend(&length.to_le_bytes()[..if version == 1 { 2 } else { 4 }]);
        bytes.extend(header.as_bytes());
        bytes.push(b'\n');
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    }

    const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }   ";

    #[test]
    fn arrays_are_read() {
        let values = [1.0, -2.5, 3e-7, f32::INFINITY, 0.0, 6.0];
        for version in 1..=3 {
            let array = parse(Path::new("a.npy"), &file(version, HEADER, &values)).unwrap();
            assert_eq!(array, Array { shape: vec![2, 3], values: values.to_vec() });
        }
    }

    #[test]
    fn one_dimension_has_a_comma() {
        assert_eq!(shape("(5,)"), Some(vec![5]));
        assert_eq!(shape("()"), Some(vec![]));
        assert_eq!(shape("(5, x)"), None);
    }

    #[test]
    fn faults_name_file_and_field() {
        let values = [0.0; 6];
        let good = file(1, HEADER, &values);
        let changed = |from: &str, to: &str| file(1, &HEADER.replace(from, to), &values);
        for (bytes, field) in [
            (b"P5 1 1".to_vec(), "(file)"),
            (good[..40].to_vec(), "(file)"),
            (file(9, HEADER, &values), "version"),
            (changed("<f4", "<f8"), "descr"),
            (changed("False", "True"), "fortran_order"),
            (changed("shape", "form"), "shape"),
            (changed("(2, 3)", "(2, -3)"), "shape"),
            (changed("(2, 3)", "(2, 4)"), "(data)"),
            (changed("(2, 3)", "(9223372036854775807, 9223372036854775807)"), "(data)"),
        ] {
            let message = parse(Path::new("a.npy"), &bytes).unwrap_err().to_string();
            assert!(message.starts_with(&format!("a.npy: field `{field}`")), "{message}");
        }
    }
}
