//! Files of one shot: a raw file beside the camera's JPEG, or a renamed copy.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::metadata::Metadata;

/// An excluded photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// The path as given.
    pub path: PathBuf,
    /// The reason, as the end of a sentence.
    pub reason: String,
}

type Photograph = (Metadata, PathBuf);

/// Keeps one file per shot and returns the others separately. Prefers the kind of file (linear or
/// not) that most shots have, and linear files otherwise.
pub(super) fn once(photographs: Vec<Photograph>) -> (Vec<Photograph>, Vec<LeftOut>) {
    let mut shots: Vec<Vec<usize>> = Vec::new();
    for (i, photograph) in photographs.iter().enumerate() {
        let same = |shot: &Vec<usize>| is_same_shot(&photographs[shot[0]], photograph);
        match shots.iter_mut().find(|shot| same(shot)) {
            Some(shot) => shot.push(i),
            None => shots.push(vec![i]),
        }
    }
    let is_linear = |i: &usize| photographs[*i].0.is_linear;
    let have = |linear: bool| {
        shots.iter().filter(|shot| shot.iter().any(|i| is_linear(i) == linear)).count()
    };
    let linear = have(true) >= have(false);
    let mut instead: BTreeMap<usize, usize> = BTreeMap::new();
    for shot in &shots {
        let kept = *shot.iter().find(|i| is_linear(i) == linear).unwrap_or(&shot[0]);
        instead.extend(shot.iter().filter(|i| **i != kept).map(|i| (*i, kept)));
    }
    let (mut used, mut left_out) = (Vec::new(), Vec::new());
    for (i, (known, path)) in photographs.iter().enumerate() {
        match instead.get(&i) {
            None => used.push((known.clone(), path.clone())),
            Some(kept) => {
                let name = photographs[*kept].1.file_name().unwrap_or_default().to_string_lossy();
                let reason =
                    format!("the same shot is also there as {name}, which is used instead");
                left_out.push(LeftOut { path: path.clone(), reason });
            }
        }
    }
    (used, left_out)
}

/// Whether two files show one shot: equal times, and similar names or different kinds.
fn is_same_shot((a, a_path): &Photograph, (b, b_path): &Photograph) -> bool {
    let alike = stem(a_path) == stem(b_path);
    let other_kind = a.is_linear != b.is_linear;
    let other_device = a.model.is_some() && b.model.is_some() && a.model != b.model;
    match (&a.taken, &b.taken) {
        _ if other_device => false,
        (Some(a), Some(b)) => a == b && (alike || other_kind),
        // Without times only names remain, and web pages and messengers give many photographs the same name.
        _ => alike && other_kind,
    }
}

/// File name without extension and without a copy suffix.
fn stem(path: &Path) -> String {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let name = name.trim_end();
    let numbered = name.strip_suffix(')').and_then(|rest| rest.rsplit_once('('));
    let numbered = numbered.filter(|(_, number)| number.bytes().all(|b| b.is_ascii_digit()));
    let name = numbered.map_or(name, |(stem, _)| stem.trim_end());
    let copied = ["-edited", "_edited", " copy", "-copy", "_copy"];
    copied.iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(name: &str, taken: Option<&str>, is_linear: bool) -> Photograph {
        let known = Metadata { taken: taken.map(str::to_owned), is_linear, ..Metadata::default() };
        (known, name.into())
    }

    fn used(files: &[Photograph]) -> Vec<String> {
        let (used, left_out) = once(files.to_vec());
        assert_eq!(used.len() + left_out.len(), files.len());
        used.into_iter().map(|(_, path)| path.display().to_string()).collect()
    }

    #[test]
    fn each_shot_is_used_once() {
        let (one, two) = (Some("2026:01:01 10:00:00"), Some("2026:01:01 10:00:07"));
        let pairs = [
            file("IMG_1.dng", one, true),
            file("IMG_1.jpg", one, false),
            file("IMG_2.JPG", two, false),
            file("IMG_2.DNG", two, true),
        ];
        assert_eq!(used(&pairs), ["IMG_1.dng", "IMG_2.DNG"]);
        let reason = once(pairs.to_vec()).1[0].reason.clone();
        assert!(reason.contains("same shot") && reason.contains("IMG_1.dng"), "{reason}");
        // Recognised by their times alone.
        let renamed = [file("a.dng", one, true), file("b.jpg", one, false)];
        assert_eq!(used(&renamed), ["a.dng"]);
        // Most shots have no raw file.
        let mixed =
            [file("1.jpg", one, false), file("1.dng", one, true), file("2.jpg", two, false)];
        assert_eq!(used(&mixed), ["1.jpg", "2.jpg"]);
        let copies = [file("x.jpg", one, false), file("x (1).jpg", one, false)];
        assert_eq!(used(&copies), ["x.jpg"]);
    }

    #[test]
    fn other_shots_are_left_alone() {
        let (one, two) = (Some("2026:01:01 10:00:00"), Some("2026:01:01 10:00:07"));
        // Equal names from web pages or messengers; two shots a few seconds apart.
        for (a, b) in [((None, "x.jpg"), (None, "x (1).jpg")), ((one, "x.jpg"), (two, "x (1).jpg"))]
        {
            assert_eq!(used(&[file(a.1, a.0, false), file(b.1, b.0, false)]).len(), 2);
        }
        assert_eq!(used(&[file("1.jpg", one, false), file("2.jpg", one, false)]).len(), 2);
    }
}
