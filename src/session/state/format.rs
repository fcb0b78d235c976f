//! The file format of saved sessions: a header, and a content in [postcard](https://postcard.jamesmunns.com) format.
//!
//! The header is `SVBRDFST`, version (`u16`), length of the content (`u64`), CRC-32 of the content, and CRC-32 of these
//! 22 bytes, all little-endian.

use serde::{Deserialize, Serialize};

use crate::{Error, Result, StateFault};

/// First bytes of a saved session.
const MAGIC: &[u8; 8] = b"SVBRDFST";
/// The version of the format, incremented with every change of the values that [`write()`] stores. Versions written by
/// a release stay readable by all later ones; newer versions are refused.
const VERSION: u16 = 1;
const HEADER: usize = 26;

/// The error of a damaged file.
pub(super) fn damaged(what: impl Into<String>) -> Error {
    Error::State(StateFault::Damaged(what.into()))
}

/// The error of an argument as damage: the argument comes from the file.
pub(super) fn as_damage(fault: Error) -> Error {
    match fault {
        Error::Argument { argument, message } => damaged(format!("{argument}: {message}")),
        other => other,
    }
}

/// Header and content of a value.
pub(super) fn write(value: &impl Serialize) -> Result<Vec<u8>> {
    let fault = |fault| Error::Internal(format!("the session cannot be written: {fault}"));
    let mut bytes = postcard::to_extend(value, vec![0; HEADER]).map_err(fault)?;
    seal(&mut bytes, VERSION);
    Ok(bytes)
}

/// Writes the header before a content.
pub(super) fn seal(bytes: &mut [u8], version: u16) {
    let (header, content) = bytes.split_at_mut(HEADER);
    header[..8].copy_from_slice(MAGIC);
    header[8..10].copy_from_slice(&version.to_le_bytes());
    header[10..18].copy_from_slice(&(content.len() as u64).to_le_bytes());
    header[18..22].copy_from_slice(&crc32fast::hash(content).to_le_bytes());
    let sum = crc32fast::hash(&header[..22]);
    header[22..].copy_from_slice(&sum.to_le_bytes());
}

/// The content, after checks of header and checksums.
pub(super) fn content(bytes: &[u8]) -> Result<&[u8]> {
    let Some((header, content)) = bytes.split_at_checked(HEADER) else {
        let begun = !bytes.is_empty() && MAGIC.starts_with(&bytes[..bytes.len().min(8)]);
        return Err(Error::State(if begun { StateFault::Truncated } else { StateFault::Foreign }));
    };
    if !header.starts_with(MAGIC) {
        return Err(Error::State(StateFault::Foreign));
    }
    let number = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
    if crc32fast::hash(&header[..22]) != number(22) {
        return Err(damaged("the checksum of the header does not match"));
    }
    let version = u16::from_le_bytes([header[8], header[9]]);
    match version {
        VERSION => {}
        0 => return Err(damaged("there is no format version 0")),
        found => return Err(Error::State(StateFault::Newer { found, known: VERSION })),
    }
    let length = u64::from_le_bytes(std::array::from_fn(|i| header[10 + i]));
    if (content.len() as u64) < length {
        return Err(Error::State(StateFault::Truncated));
    }
    if content.len() as u64 > length {
        return Err(damaged("there are bytes after its end"));
    }
    if crc32fast::hash(content) != number(18) {
        return Err(damaged("the checksum does not match"));
    }
    Ok(content)
}

/// Reads a value, which must take up the whole content.
pub(super) fn read<'a, T: Deserialize<'a>>(content: &'a [u8]) -> Result<T> {
    match postcard::take_from_bytes(content) {
        Ok((value, [])) => Ok(value),
        Ok(_) => Err(damaged("there is more than a session")),
        Err(fault) => Err(damaged(fault.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_bit_and_every_missing_byte_is_noticed() {
        let bytes = write(&(7_u32, "some text")).unwrap();
        assert!(content(&bytes).is_ok());
        for bit in 0..8 * bytes.len() {
            let mut bad = bytes.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(matches!(content(&bad), Err(Error::State(_))), "bit {bit}");
        }
        for end in 0..bytes.len() {
            let fault = content(&bytes[..end]).unwrap_err();
            let expected = if end == 0 { StateFault::Foreign } else { StateFault::Truncated };
            assert!(matches!(fault, Error::State(f) if f == expected), "{end} bytes");
        }
        assert!(content(&[&bytes[..], b"x"].concat()).is_err());
    }

    #[test]
    fn newer_versions_are_named() {
        let mut bytes = write(&(7_u32, "some text")).unwrap();
        seal(&mut bytes, VERSION + 1);
        let expected = StateFault::Newer { found: VERSION + 1, known: VERSION };
        assert!(matches!(content(&bytes), Err(Error::State(f)) if f == expected));
    }
}
