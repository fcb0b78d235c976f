//! Selects photographs of one camera, sorts them and compares their exposures.

use std::cmp::Reverse;
use std::path::PathBuf;

use super::metadata::Metadata;
use super::order;
use super::renditions::{self, LeftOut};

/// Relative tolerance for focal lengths of the same lens.
const SAME_FOCAL: f64 = 0.02;

/// Identity of a camera: maker and model, lens, focal length, digital zoom and picture size.
/// Photographs with the same key share intrinsics.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraKey {
    make: Option<String>,
    model: Option<String>,
    lens: Option<String>,
    focal_mm: Option<f64>,
    focal_35mm: Option<f64>,
    digital_zoom: Option<f64>,
    size: Option<[u32; 2]>,
}

/// A selected photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// The path as given.
    pub path: PathBuf,
    /// Exposure relative to that of the first photograph that states it.
    pub exposure: f32,
    /// Clockwise rotation of the upright picture that aligns it with the others, degrees.
    pub turn_deg: u32,
    /// Whether its values are linear, as floats and raw values are.
    pub is_linear: bool,
}

/// Photographs of one camera, in the order of capture.
#[derive(Debug, Default)]
pub struct Choice {
    /// The camera; `None` before the first photograph.
    pub camera: Option<CameraKey>,
    /// Exposure of the first photograph that states it.
    reference: Option<f64>,
    /// Rotation that makes most photographs upright.
    upright_deg: Option<u32>,
    /// Whether a flash fired according to the metadata.
    flashed: bool,
    /// Photographs of the camera.
    pub chosen: Vec<Chosen>,
    /// The others.
    pub left_out: Vec<LeftOut>,
    /// Missing metadata, and doubts about photographs.
    pub remarks: Vec<String>,
}

impl CameraKey {
    /// The key of a photograph.
    pub fn of(known: &Metadata) -> Self {
        Self {
            make: known.make.clone(),
            model: known.model.clone(),
            lens: known.lens.clone(),
            focal_mm: known.focal_mm,
            focal_35mm: known.focal_35mm,
            digital_zoom: known.digital_zoom,
            size: known.size,
        }
    }

    /// Difference of another photograph's camera from this one, the camera of most photographs, and a
    /// remedy, as the end of a sentence. Unknown values never differ.
    pub fn difference(&self, other: &Self) -> Option<String> {
        // "Google" and "google" are the same maker.
        let differs = |a: &Option<String>, b: &Option<String>| {
            a.as_ref().zip(b.as_ref()).is_some_and(|(a, b)| !a.eq_ignore_ascii_case(b))
        };
        if differs(&self.make, &other.make) || differs(&self.model, &other.model) {
            let (its, mine) = (other.name(), self.name());
            return Some(format!("taken with {its}, most with {mine}; use one camera"));
        }
        let focal = self.focal_mm.zip(other.focal_mm);
        if differs(&self.lens, &other.lens)
            || focal.is_some_and(|(a, b)| (a - b).abs() > SAME_FOCAL * a.max(b))
        {
            let (its, mine) = (other.lens(), self.lens());
            return Some(format!("another lens: {its}, most {mine}; keep to one lens"));
        }
        if let Some(difference) = self.other_crop(other) {
            return Some(difference);
        }
        let (mine, its) = self.size.zip(other.size)?;
        let size = |[w, h]: [u32; 2]| format!("{w} x {h} px");
        let remedy = if mine == [its[1], its[0]] {
            "its pixels were turned by 90 degrees without a tag: turn them back, or use the file as the camera wrote it"
        } else {
            "set the camera to one size; if only the size differs, scale the photo to that of the others"
        };
        (mine != its).then(|| format!("{}, most {}; {remedy}", size(its), size(mine)))
    }

    /// Difference in digital zoom with the same lens; the size does not reveal it.
    fn other_crop(&self, other: &Self) -> Option<String> {
        let differ = |a: f64, b: f64| (a - b).abs() > SAME_FOCAL * a.max(b);
        let [mine, its] = [self, other].map(|c| c.digital_zoom.unwrap_or(1.0));
        let zoomed = |zoom: f64| match zoom {
            1.0 => "none".to_owned(),
            zoom => format!("{zoom:.2} times"),
        };
        if differ(mine, its) {
            let (its, mine) = (zoomed(its), zoomed(mine));
            return Some(format!("digital zoom: {its}, most {mine}; keep the zoom"));
        }
        let (mine, its) = self.focal_35mm.zip(other.focal_35mm)?;
        differ(mine, its).then(|| {
            format!(
                "another field of view: {its:.0} mm on film of 36 x 24 mm, most {mine:.0} mm; keep the zoom"
            )
        })
    }

    /// Whether this key states everything that another one states.
    fn states_what(&self, other: &Self) -> bool {
        let stated = |c: &Self| {
            [
                c.make.is_some(),
                c.model.is_some(),
                c.lens.is_some(),
                c.focal_mm.is_some(),
                c.focal_35mm.is_some(),
                c.digital_zoom.is_some(),
                c.size.is_some(),
            ]
        };
        stated(self).iter().zip(stated(other)).all(|(here, there)| *here || !there)
    }

    fn name(&self) -> String {
        match (&self.make, &self.model) {
            (Some(make), Some(model)) if !begins_with(model, make) => format!("{make} {model}"),
            (_, Some(name)) | (Some(name), None) => name.clone(),
            (None, None) => "another camera".into(),
        }
    }

    fn lens(&self) -> String {
        let focal = self.focal_mm.map(|mm| format!("{mm:.2} mm"));
        match (self.lens.clone(), focal) {
            (Some(lens), Some(focal)) => format!("{lens}, {focal}"),
            (Some(known), None) | (None, Some(known)) => known,
            (None, None) => "unknown".into(),
        }
    }
}

impl Choice {
    /// Appends photographs in the order of capture, then by name (9 before 10); those without a time come
    /// last. The first call determines the camera: the one with most photographs, or the first of several.
    pub fn add(&mut self, photographs: Vec<(Metadata, PathBuf)>) {
        let (mut photographs, copies) = renditions::once(photographs);
        self.left_out.extend(copies);
        order::sort(&mut photographs);
        if self.camera.is_none() {
            self.camera = most_frequent(&photographs);
        }
        let Some(camera) = self.camera.clone() else { return };
        let (mut fitting, mut silent, mut dark) = (Vec::new(), Vec::new(), Vec::new());
        for (known, path) in photographs {
            match camera.difference(&CameraKey::of(&known)) {
                Some(reason) => self.left_out.push(LeftOut { path, reason }),
                None => fitting.push((known, path)),
            }
        }
        let states = |(known, _): &(Metadata, PathBuf)| known.exposure;
        self.reference = self.reference.or_else(|| fitting.iter().find_map(states));
        self.upright_deg = self.upright_deg.or_else(|| most_upright(&fitting));
        for (known, path) in fitting {
            let relative = known.exposure.zip(self.reference).map(|(own, first)| own / first);
            if relative.is_none() {
                silent.push(path.clone());
            }
            match known.flash_fired {
                Some(false) => dark.push(path.clone()),
                Some(true) => self.flashed = true,
                None => (),
            }
            // Flash and lens are fixed to the camera in any orientation, and the orientation sensor
            // of a phone that looks down on a table is unreliable.
            let turn = known.upright_deg.zip(self.upright_deg);
            self.chosen.push(Chosen {
                path,
                exposure: relative.unwrap_or(1.0) as f32,
                turn_deg: turn.map_or(0, |(own, most)| (360 + most - own) % 360),
                is_linear: known.is_linear,
            });
        }
        self.remark(&silent, &dark);
    }

    /// Removes photographs that will be added again.
    pub fn take_back(&mut self, paths: &[PathBuf]) {
        self.chosen.retain(|chosen| !paths.contains(&chosen.path));
    }

    fn remark(&mut self, silent: &[PathBuf], dark: &[PathBuf]) {
        if !silent.is_empty() {
            let taken = match self.reference {
                None => "all are taken as exposed alike",
                Some(_) => "taken as exposed like the first",
            };
            let text = format!("{}: no exposure in the metadata; {taken}", names(silent));
            self.remarks.push(text);
        }
        if !dark.is_empty() {
            // A torch is not a flash that fires.
            let so = match self.flashed {
                false => "right if the torch was on",
                true => "in others it did: use the same light for all photos",
            };
            let text = format!("{}: the flash did not fire, say the metadata; {so}", names(dark));
            self.remarks.push(text);
        }
    }
}

fn begins_with(text: &str, start: &str) -> bool {
    text.get(..start.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(start))
}

/// The camera that agrees with most photographs. Photographs with further metadata do not count for
/// it, or one without metadata would agree with all.
fn most_frequent(photographs: &[(Metadata, PathBuf)]) -> Option<CameraKey> {
    let cameras: Vec<CameraKey> =
        photographs.iter().map(|(known, _)| CameraKey::of(known)).collect();
    let like = |camera: &CameraKey| {
        let alike = |c: &&CameraKey| camera.difference(c).is_none() && camera.states_what(c);
        cameras.iter().filter(alike).count()
    };
    cameras.iter().min_by_key(|camera| Reverse(like(camera))).cloned()
}

/// The most frequent rotation; the first of equally frequent ones.
fn most_upright(photographs: &[(Metadata, PathBuf)]) -> Option<u32> {
    let stated = || photographs.iter().filter_map(|(known, _)| known.upright_deg);
    stated().min_by_key(|degrees| Reverse(stated().filter(|other| other == degrees).count()))
}

/// "a.jpg", "a.jpg and 3 others".
fn names(paths: &[PathBuf]) -> String {
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match paths {
        [] => String::new(),
        [one] => name(one),
        [first, other] => format!("{} and {}", name(first), name(other)),
        [first, rest @ ..] => format!("{} and {} others", name(first), rest.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shot(name: &str, model: Option<&str>, taken: &str, exposure: f64) -> (Metadata, PathBuf) {
        let known = Metadata {
            model: model.map(str::to_owned),
            size: Some([40, 30]),
            exposure: Some(exposure),
            taken: (!taken.is_empty()).then(|| taken.to_owned()),
            ..Metadata::default()
        };
        (known, name.into())
    }

    fn chosen(shots: Vec<(Metadata, PathBuf)>) -> Choice {
        let mut choice = Choice::default();
        choice.add(shots);
        choice
    }

    #[test]
    fn time_then_name_order_photographs() {
        let choice = chosen(vec![
            shot("x", None, "", 1.0),
            shot("d", None, "2024:01:01 10:00:00.5", 1.0),
            shot("b", None, "2024:01:01 10:00:01.", 1.0),
            shot("c", None, "2024:01:01 10:00:00.25", 1.0),
            shot("a", None, "2024:01:01 10:00:00.5", 1.0),
        ]);
        let order: Vec<&str> = choice.chosen.iter().map(|c| c.path.to_str().unwrap()).collect();
        assert_eq!(order, ["c", "a", "d", "b", "x"]);
    }

    #[test]
    fn most_photographs_decide_about_the_camera() {
        let choice = chosen(vec![
            shot("0", Some("A"), "", 1.0),
            shot("1", Some("B"), "", 2.0),
            shot("2", None, "", 4.0),
            shot("3", Some("B"), "", 1.0),
        ]);
        let kept: Vec<(&str, f32)> =
            choice.chosen.iter().map(|c| (c.path.to_str().unwrap(), c.exposure)).collect();
        // Relative to the first selected photograph.
        assert_eq!(kept, [("1", 1.0), ("2", 2.0), ("3", 0.5)]);
        assert_eq!(choice.left_out[0].reason, "taken with A, most with B; use one camera");
        assert_eq!(choice.left_out.len(), 1);
    }

    #[test]
    fn makers_are_the_same_in_any_case() {
        let with = |make: &str| Metadata {
            make: Some(make.into()),
            model: Some("Google Pixel".into()),
            ..Metadata::default()
        };
        let known = CameraKey::of(&with("Google"));
        assert_eq!(known.difference(&CameraKey::of(&with("google"))), None);
        let said = known.difference(&CameraKey::of(&with("Other"))).unwrap();
        assert_eq!(said, "taken with Other Google Pixel, most with Google Pixel; use one camera");
        assert_eq!(CameraKey::of(&with("google")).name(), "Google Pixel");
    }

    #[test]
    fn a_torch_is_not_a_flash_that_fires() {
        let with = |name: &str, fired| {
            let (known, path) = shot(name, None, "", 1.0);
            (Metadata { flash_fired: fired, ..known }, path)
        };
        let said = chosen(vec![with("a", Some(false)), with("b", Some(false)), with("c", None)]);
        assert_eq!(
            said.remarks,
            ["a and b: the flash did not fire, say the metadata; right if the torch was on"]
        );
        let said = chosen(vec![with("a", Some(false)), with("b", Some(true))]).remarks;
        assert!(
            said[0].starts_with("a: ") && said[0].ends_with("use the same light for all photos")
        );
        assert!(chosen(vec![with("a", None), with("b", Some(true))]).remarks.is_empty());
    }

    #[test]
    fn digital_zooms_are_distinguished() {
        let with = |zoom, focal_35mm| Metadata {
            focal_mm: Some(6.76),
            focal_35mm,
            digital_zoom: zoom,
            size: Some([40, 30]),
            ..Metadata::default()
        };
        let difference =
            |a: Metadata, b: Metadata| CameraKey::of(&a).difference(&CameraKey::of(&b));
        let plain = || with(Some(1.0), Some(27.0));
        assert_eq!(difference(plain(), with(None, None)), None);
        assert_eq!(difference(plain(), with(None, Some(27.0))), None);
        let said = difference(plain(), with(Some(1.3), Some(35.0))).unwrap();
        assert_eq!(said, "digital zoom: 1.30 times, most none; keep the zoom");
        // Some phones state only the field of view.
        let said = difference(with(None, Some(26.0)), with(None, Some(52.0))).unwrap();
        assert!(
            said.starts_with("another field of view: 52 mm on film of 36 x 24 mm, most 26 mm;")
        );
        assert!(difference(with(Some(2.0), None), with(None, None)).is_some());
        let mut shots = vec![(with(Some(1.3), Some(35.0)), "zoomed".into())];
        shots.extend(["a", "b"].map(|name| (plain(), name.into())));
        let choice = chosen(shots);
        assert_eq!(choice.chosen.len(), 2);
        assert!(choice.left_out[0].reason.starts_with("digital zoom"));
    }

    #[test]
    fn lenses_and_sizes_are_distinguished() {
        let with = |focal, size| Metadata {
            focal_mm: Some(focal),
            size: Some(size),
            ..Metadata::default()
        };
        let camera = CameraKey::of(&with(6.86, [40, 30]));
        let difference = |focal, size| camera.difference(&CameraKey::of(&with(focal, size)));
        assert_eq!(difference(6.9, [40, 30]), None);
        assert!(difference(2.22, [40, 30]).unwrap().contains("another lens: 2.22 mm"));
        let said = difference(6.86, [80, 60]).unwrap();
        assert!(said.contains("80 x 60 px, most 40 x 30 px; set the camera to one size"), "{said}");
        let said = difference(6.86, [30, 40]).unwrap();
        assert!(said.contains("turned by 90 degrees") && said.contains("turn them back"), "{said}");
    }
}
