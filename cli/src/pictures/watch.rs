//! A folder into which photographs arrive.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::files::{Folder, look_into};
use crate::failure::Result;

/// Size and time of a file.
type Stamp = (u64, Option<SystemTime>);

/// State of a file at the last look.
#[derive(Clone, Copy, PartialEq)]
enum State {
    /// Looked like this at the last look.
    Seen(Stamp),
    /// Was handed out.
    Taken(Stamp),
    /// Was handed out and is of no use as it is.
    Refused(Stamp),
}

/// Hands out each picture of a folder once its size stays.
pub struct Watch {
    folder: PathBuf,
    files: HashMap<PathBuf, State>,
    folders: HashSet<PathBuf>,
}

impl Watch {
    /// Looks into a folder from now on.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), files: HashMap::new(), folders: HashSet::new() }
    }

    /// Pictures that look as they did at the last look, and were not handed out as they are before; and
    /// folders that are new.
    pub fn arrived(&mut self) -> Result<Folder> {
        let mut found = look_into(&self.folder)?;
        found.pictures.retain(|path| self.stays(path));
        found.foreign.retain(|left_out| self.stays(&left_out.path));
        found.folders.retain(|folder| self.folders.insert(folder.clone()));
        Ok(found)
    }

    /// Whether a file is to be handed out now.
    fn stays(&mut self, path: &Path) -> bool {
        // A file may be gone again.
        let Some(stamp) = stamp(path).filter(|(size, _)| *size > 0) else { return false };
        let state = match self.files.get(path) {
            Some(State::Taken(before) | State::Refused(before)) if *before == stamp => {
                return false;
            }
            Some(State::Seen(before)) if *before == stamp => State::Taken(stamp),
            _ => State::Seen(stamp),
        };
        self.files.insert(path.to_owned(), state);
        state == State::Taken(stamp)
    }

    /// Hands a picture out again when it has changed: it was cut short.
    pub fn refuse(&mut self, path: &Path) {
        if let Some(State::Taken(stamp)) = self.files.get(path).copied() {
            self.files.insert(path.to_owned(), State::Refused(stamp));
        }
    }
}

fn stamp(path: &Path) -> Option<Stamp> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.len(), metadata.modified().ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_handed_out_once_it_stays_as_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let mut watch = Watch::new(dir.path());
        let path = dir.path().join("ärger mit leerzeichen.JPG");
        let write = |bytes: &[u8]| std::fs::write(&path, bytes).unwrap();
        write(b"");
        std::fs::write(dir.path().join("notes.txt"), b"no picture").unwrap();
        let mut arrived = || watch.arrived().unwrap().pictures;
        assert!(arrived().is_empty() && arrived().is_empty());
        write(b"half");
        assert!(arrived().is_empty());
        write(b"half and more");
        assert!(arrived().is_empty());
        assert_eq!(arrived(), std::slice::from_ref(&path));
        assert!(arrived().is_empty());
        // It was cut short after all, and is offered once more when it has grown.
        watch.refuse(&path);
        let mut arrived = || watch.arrived().unwrap().pictures;
        assert!(arrived().is_empty());
        write(b"half and more, and the rest");
        assert!(arrived().is_empty());
        assert_eq!(arrived(), std::slice::from_ref(&path));
        assert!(arrived().is_empty());
        // Another one has its name now.
        write(b"another picture");
        assert!(arrived().is_empty());
        assert_eq!(arrived(), [path]);
        assert!(arrived().is_empty());
    }

    #[test]
    fn a_folder_is_named_once() {
        let dir = tempfile::tempdir().unwrap();
        let mut watch = Watch::new(dir.path());
        let mut folders = || watch.arrived().unwrap().folders.len();
        assert_eq!(folders(), 0);
        std::fs::create_dir(dir.path().join("100APPLE")).unwrap();
        assert_eq!([folders(), folders()], [1, 0]);
    }

    #[test]
    fn a_picture_that_cannot_be_read_is_named_once() {
        let dir = tempfile::tempdir().unwrap();
        let mut watch = Watch::new(dir.path());
        std::fs::write(dir.path().join("a.jpg"), b"\0\0\0\x1Cftypavif\0\0\0\0avifmif1").unwrap();
        let mut foreign = || watch.arrived().unwrap().foreign.len();
        assert_eq!([foreign(), foreign(), foreign()], [0, 1, 0]);
    }
}
