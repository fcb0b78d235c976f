//! Picture files of folders.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use svbrdf::files::{HEAD_BYTES, Kind, LeftOut, by_name};

use super::description::can_name;
use crate::failure::{Failure, Result};

/// Endings of the names of pictures.
const PICTURES: [&str; 33] = [
    "jpg", "jpeg", "jpe", "mpo", "png", "tif", "tiff", "exr", "dng", "heic", "heif", "hif", "avif",
    "jxl", "webp", "gif", "bmp", "psd", "jp2", "cr2", "cr3", "crw", "nef", "nrw", "arw", "sr2",
    "srw", "orf", "rw2", "raf", "pef", "3fr", "iiq",
];
/// Endings that files have while they are on their way, and of small pictures that cameras put
/// beside the large ones.
const PASSED_OVER: [&str; 8] =
    ["part", "partial", "tmp", "temp", "crdownload", "download", "thm", "bak"];

/// The contents of a folder, by name.
#[derive(Default)]
pub struct Folder {
    /// Pictures that can be read, or are called such.
    pub pictures: Vec<PathBuf>,
    /// Pictures that cannot, and why.
    pub foreign: Vec<LeftOut>,
    /// Folders inside, which are not looked into.
    pub folders: Vec<PathBuf>,
}

/// Looks for pictures in a folder, not in those inside it; hidden files are passed over.
pub fn look_into(folder: &Path) -> Result<Folder> {
    let fault = |e: std::io::Error| Failure::Input(format!("{}: {e}", folder.display()));
    let mut found = Folder::default();
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        let hidden = path.file_name().is_none_or(|name| name.as_encoded_bytes().starts_with(b"."));
        if hidden || has_ending(&path, &PASSED_OVER) {
            continue;
        }
        if !path.exists() && has_ending(&path, &PICTURES) {
            found
                .foreign
                .push(LeftOut { path, reason: "a link to a file that is not there".into() });
            continue;
        }
        if path.is_dir() {
            found.folders.push(path);
            continue;
        }
        if !path.is_file() {
            continue;
        }
        let is_called_picture = path.extension().is_none() || has_ending(&path, &PICTURES);
        match kind(&path) {
            Some(kind) if !kind.is_read() => found.foreign.push(foreign(path, kind)),
            Some(_) if is_called_picture => found.pictures.push(path),
            Some(kind) => {
                let kind = kind.name();
                let reason = format!("{kind} by its content, but not by its name: rename it");
                found.foreign.push(LeftOut { path, reason });
            }
            // Its fault is reported when it is read.
            None if has_ending(&path, &PICTURES) => found.pictures.push(path),
            None => (),
        }
    }
    found.pictures.sort_by(|a, b| by_name(a, b));
    found.folders.sort_by(|a, b| by_name(a, b));
    found.foreign.sort_by(|a, b| by_name(&a.path, &b.path));
    Ok(found)
}

impl Folder {
    /// Moves files and folders that a capture described in folder `out` cannot use to the foreign ones, each with
    /// its reason.
    pub fn sorted_out(self, out: &Path) -> Self {
        let whole = |path: &Path| path.canonicalize().ok();
        let Self { pictures, mut foreign, folders } = self;
        let (pictures, nameless): (Vec<_>, Vec<_>) =
            pictures.into_iter().partition(|path| can_name(path, out));
        let left_out = |path, reason: &str| LeftOut { path, reason: reason.into() };
        foreign.extend(
            nameless
                .into_iter()
                .map(|path| left_out(path, "its name is not valid Unicode: rename it")),
        );
        let others = folders.into_iter().filter(|f| whole(f).is_none_or(|f| Some(f) != whole(out)));
        foreign.extend(others.map(|path| {
            left_out(
                path,
                "a folder, which is not looked into: name it if its photographs belong to these",
            )
        }));
        Self { pictures, foreign, folders: Vec::new() }
    }
}

/// All pictures that files and folders name, each once, for a capture that is described in folder `out`.
pub fn find(inputs: &[PathBuf], out: &Path) -> Result<Folder> {
    let mut all = Folder::default();
    for input in inputs {
        if input.is_dir() {
            let inside = look_into(input)?;
            all.pictures.extend(inside.pictures);
            all.foreign.extend(inside.foreign);
            all.folders.extend(inside.folders);
            continue;
        }
        if !input.exists() {
            return Err(Failure::Input(format!(
                "{}: no such file or folder; expected photographs, or a folder with photographs or capture.json",
                input.display()
            )));
        }
        match kind(input) {
            Some(kind) if !kind.is_read() => all.foreign.push(foreign(input.clone(), kind)),
            _ => all.pictures.push(input.clone()),
        }
    }
    let mut seen = BTreeSet::new();
    all.pictures.retain(|path| seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())));
    if all.pictures.is_empty() {
        return Err(none(inputs, &all));
    }
    let all = all.sorted_out(out);
    if all.pictures.is_empty() {
        return Err(none(inputs, &all));
    }
    Ok(all)
}

fn none(inputs: &[PathBuf], Folder { foreign, folders, .. }: &Folder) -> Failure {
    let place = inputs.first().map_or(Path::new("."), |p| p.as_path()).display();
    let mut text = format!("{place}: neither capture.json nor photographs that can be read");
    for LeftOut { path, reason } in foreign.iter().take(MOST_NAMED) {
        text += &format!("\n{}: {reason}", path.display());
    }
    if foreign.len() > MOST_NAMED {
        text += &format!("\nand {} more", foreign.len() - MOST_NAMED);
    }
    let filled = folders.iter().find(|f| look_into(f).is_ok_and(|f| !f.pictures.is_empty()));
    if let Some(folder) = filled {
        text += &format!(
            "\n{}: has photographs; folders inside are not looked into, name it",
            folder.display()
        );
    }
    Failure::Input(format!("{text}\nexpected {} files", Kind::all_read()))
}

/// Most files that a message names.
const MOST_NAMED: usize = 5;

fn foreign(path: PathBuf, kind: Kind) -> LeftOut {
    let reason = format!("{}, which is not read: {}", kind.name(), kind.advice());
    LeftOut { path, reason }
}

/// The format of a file by its content.
fn kind(path: &Path) -> Option<Kind> {
    let mut head = Vec::new();
    File::open(path).ok()?.take(HEAD_BYTES as u64).read_to_end(&mut head).ok()?;
    match Kind::of(&head)? {
        // Only the whole file tells whether it is a maker's raw file.
        Kind::Tiff => Kind::of(&std::fs::read(path).ok()?),
        kind => Some(kind),
    }
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().unwrap_or_default();
    endings.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_to_nowhere_are_named_and_folders_inside_are_hinted_at() {
        let dir = tempfile::tempdir().unwrap();
        let inside = dir.path().join("100APPLE");
        std::fs::create_dir(&inside).unwrap();
        std::fs::create_dir(dir.path().join("empty.jpg")).unwrap();
        std::fs::write(inside.join("Größe 1.JPG"), b"\xFF\xD8\xFF\xE0").unwrap();
        let said = find(&[dir.path().to_owned()], Path::new("out")).err().unwrap().to_string();
        assert!(said.contains("100APPLE: has photographs") && !said.contains("empty"), "{said}");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("gone.jpg", dir.path().join("a.jpg")).unwrap();
            std::os::unix::fs::symlink(inside.join("Größe 1.JPG"), dir.path().join("b.jpg"))
                .unwrap();
            std::fs::write(dir.path().join("c.mpo"), b"\xFF\xD8\xFF\xE1").unwrap();
            let found = find(&[dir.path().to_owned()], &inside).unwrap();
            let names = |path: &PathBuf| path.file_name().unwrap().to_owned();
            assert_eq!(found.pictures.iter().map(names).collect::<Vec<_>>(), ["b.jpg", "c.mpo"]);
            let [link, folder] = &found.foreign[..] else { panic!("{:?}", found.foreign) };
            assert!(link.path.ends_with("a.jpg") && link.reason.contains("not there"));
            assert!(folder.path.ends_with("empty.jpg") && folder.reason.contains("a folder"));
        }
    }

    #[test]
    fn content_decides_and_nothing_is_passed_over_in_silence() {
        let dir = tempfile::tempdir().unwrap();
        let avif = b"\0\0\0\x1Cftypavif\0\0\0\0avifmif1miaf....";
        let jpeg = b"\xFF\xD8\xFF\xE0";
        for (name, bytes) in [
            ("a.jpg", &jpeg[..]),
            ("b.heic", jpeg),
            ("c.JPG", avif),
            ("d.avif", avif),
            ("e", jpeg),
            ("f.jxl", b"\xFF\x0A\0\0"),
            ("g.pic", jpeg),
            ("h.jpg.part", jpeg),
            ("i.txt", b"notes"),
            ("j.png", b"notes"),
            ("k.cr2", b"II*\0\x10\0\0\0CR\x02\0"),
            ("m.mov", b"\0\0\0\x14ftypqt  \0\0\0\0qt  "),
            ("n.ppm", b"P6\n8 8\n255\n"),
            ("o.hdr", b"#?RADIANCE\n"),
            ("p10.jpg", jpeg),
            ("p9.jpg", jpeg),
            (".l.jpg", jpeg),
        ] {
            std::fs::write(dir.path().join(name), bytes).unwrap();
        }
        let found = look_into(dir.path()).unwrap();
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        let pictures: Vec<String> = found.pictures.iter().map(name).collect();
        assert_eq!(pictures, ["a.jpg", "b.heic", "e", "j.png", "p9.jpg", "p10.jpg"]);
        let foreign: Vec<String> = found.foreign.iter().map(|l| name(&l.path)).collect();
        assert_eq!(
            foreign,
            ["c.JPG", "d.avif", "f.jxl", "g.pic", "k.cr2", "m.mov", "n.ppm", "o.hdr"]
        );
        let said = ["an AVIF", "an AVIF", "a JPEG XL", "rename it", "DNG Converter"];
        let said = said.into_iter().chain(["a video", "a PPM", "a Radiance HDR"]);
        for (i, said) in said.enumerate() {
            assert!(found.foreign[i].reason.contains(said), "{}", found.foreign[i].reason);
        }
    }

    #[test]
    fn folders_and_nameless_files_are_named_one_by_one() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        ["maps", "more"].iter().for_each(|name| std::fs::create_dir(at(name)).unwrap());
        std::fs::write(at("a.jpg"), b"\xFF\xD8\xFF\xE0").unwrap();
        let look = || find(&[dir.path().to_owned()], &at("maps")).unwrap();
        let [more] = &look().foreign[..] else { panic!("{:?}", look().foreign) };
        assert!(more.path.ends_with("more") && more.reason.contains("not looked into"));
        #[cfg(target_os = "linux")]
        {
            use std::os::unix::ffi::OsStrExt;
            let nameless = dir.path().join(std::ffi::OsStr::from_bytes(b"b\xFF.jpg"));
            std::fs::write(&nameless, b"\xFF\xD8\xFF\xE0").unwrap();
            let found = look();
            assert_eq!(found.pictures, [at("a.jpg")]);
            assert!(
                found.foreign[0].path == nameless && found.foreign[0].reason.contains("Unicode")
            );
            std::fs::remove_file(at("a.jpg")).unwrap();
            let said = find(&[nameless], &at("maps")).err().unwrap().to_string();
            assert!(said.contains("not valid Unicode"), "{said}");
        }
    }
}
