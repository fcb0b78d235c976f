//! A capture folder: `capture.json` and its photographs.

mod document;
mod lengths;
mod unknown;

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::Value;

use crate::calibration::{Hole, Target, TargetKind, TopLeft};
#[cfg(feature = "files")]
use crate::files::{self, Remark};
use crate::geometry::Camera;
use crate::observation::Falloff;
use crate::photo::{Encoding, Photo, Rotation};
use crate::rectification::elevation;
use crate::scene::{RectifiedFalloff, Scene};
use crate::{Error, Result};
use document::{Node, parse_json, read_json};
pub use lengths::LEAST_SQUARE_MM;

/// Version of the format read: the value of `format`.
pub const FORMAT: &str = "svbrdf-capture/1";
/// Name of the description inside a capture folder.
pub const FILE_NAME: &str = "capture.json";

/// Smallest length accepted, mm; smaller ones vanish in single precision.
const MIN_LENGTH_MM: f64 = 1e-6;
/// Largest length accepted, mm.
const MAX_LENGTH_MM: f64 = 1e6;

/// Contents of a capture folder; photographs are read one at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// Scene of the photographs.
    pub scene: Scene,
    /// The photographs in the order of the file, at least one.
    pub photos: Vec<PhotoFile>,
    /// Warnings about unknown fields, which are ignored, and about unusual lengths; one sentence each.
    pub warnings: Vec<String>,
}

/// One photograph of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoFile {
    /// The image file; it exists.
    pub path: PathBuf,
    /// Transfer curve of its values. `None` (`srgb` in `capture.json`): with feature `files` the
    /// colours that the file states, sRGB where it states none.
    pub encoding: Option<Encoding>,
    /// Relative exposure: value = radiance * exposure.
    pub exposure: f32,
    /// Camera and light of an already rectified photograph.
    pub rectified: Option<RectifiedView>,
    /// Clockwise rotation of the upright picture that aligns the camera's sides with those of the
    /// other photographs.
    pub turn: Rotation,
    /// Photograph of the same view without flash, to be subtracted: file and relative exposure.
    pub ambient: Option<(PathBuf, f32)>,
}

/// Camera and light of an already rectified photograph, board frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectifiedView {
    /// Camera centre, mm.
    pub camera_mm: [f32; 3],
    /// Light position, mm.
    pub light_mm: [f32; 3],
}

impl PhotoFile {
    /// Reads the photograph. With feature `files`, DNG is supported.
    ///
    /// # Errors
    /// As `files::read`, or as [`Photo::read`] without that feature; also if the photograph without
    /// flash has another size.
    pub fn read(&self) -> Result<Photo> {
        #[cfg(feature = "files")]
        return Ok(self.read_with_remarks()?.0);
        #[cfg(not(feature = "files"))]
        self.less_ambient(|path, exposure| {
            Photo::read(path, self.encoding.unwrap_or(Encoding::Srgb), exposure)
        })
    }

    /// As [`PhotoFile::read`], with remarks about the file.
    ///
    /// # Errors
    /// As [`PhotoFile::read`].
    #[cfg(feature = "files")]
    pub fn read_with_remarks(&self) -> Result<(Photo, Vec<Remark>)> {
        let mut remarks = None;
        let photo = self.less_ambient(|path, exposure| {
            let (encoding, exposure) = (self.encoding, Some(exposure));
            let decoded =
                files::read(path, &files::Options { encoding, exposure, ..Default::default() })?;
            // Remarks about the first photograph, not about the one without flash.
            remarks.get_or_insert(decoded.remarks);
            Ok(decoded.photo)
        })?;
        Ok((photo, remarks.unwrap_or_default()))
    }

    /// Subtracts the photograph without flash, then rotates.
    fn less_ambient(&self, mut read: impl FnMut(&Path, f32) -> Result<Photo>) -> Result<Photo> {
        let photo = read(&self.path, self.exposure)?;
        let Some((path, exposure)) = &self.ambient else { return Ok(photo.turned(self.turn)) };
        let less = photo
            .without_ambient(&read(path, *exposure)?)
            .map_err(|fault| Error::Image { path: path.clone(), message: fault.to_string() })?;
        Ok(less.turned(self.turn))
    }
}

impl Capture {
    /// Reads `capture.json` of folder `dir`, checks every field, and checks that the picture files exist.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, [`Error::Field`] with the field, the value found
    /// and the values expected.
    pub fn load(dir: impl AsRef<Path>) -> Result<Self> {
        Self::load_with_camera(dir, None)
    }

    /// As [`Capture::load`], with a camera that replaces the file's.
    ///
    /// # Errors
    /// As [`Capture::load`].
    pub fn load_with_camera(dir: impl AsRef<Path>, camera: Option<Camera>) -> Result<Self> {
        let dir = dir.as_ref();
        let file = dir.join(FILE_NAME);
        let value = read_json(&file)?;
        Self::read(dir, &file, &value, camera)
    }

    /// As [`Capture::load`], from the content of a `capture.json` whose pictures are in folder `dir`.
    ///
    /// # Errors
    /// As [`Capture::load`].
    pub fn parse(dir: impl AsRef<Path>, json: &[u8]) -> Result<Self> {
        let dir = dir.as_ref();
        let file = dir.join(FILE_NAME);
        Self::read(dir, &file, &parse_json(&file, json)?, None)
    }

    fn read(dir: &Path, file: &Path, value: &Value, camera: Option<Camera>) -> Result<Self> {
        let root = Node::root(file, value);
        let (scene, sample_mm) = scene(&root, camera)?;
        let rectified = matches!(scene, Scene::Rectified { .. });
        let list = root.get("frames");
        let photos = list
            .list()?
            .iter()
            .map(|node| photo_file(dir, node, rectified))
            .collect::<Result<Vec<_>>>()?;
        if photos.is_empty() {
            return Err(list.fault("at least one photograph"));
        }
        let mut warnings = unknown::warnings(file, value);
        if let Scene::Board { target, .. } = &scene {
            warnings.extend(lengths::warning(file, target, sample_mm));
        }
        Ok(Self { sample_mm, scene, photos, warnings })
    }
}

/// Scene and size of the sample, mm, of a `capture.json` whose photographs do not come from files:
/// `frames` is ignored.
///
/// # Errors
/// [`Error::Field`] as [`Capture::load`].
pub fn parse_scene(json: &[u8]) -> Result<(Scene, [f32; 2])> {
    let file = Path::new(FILE_NAME);
    scene(&Node::root(file, &parse_json(file, json)?), None)
}

fn scene(root: &Node, camera: Option<Camera>) -> Result<(Scene, [f32; 2])> {
    root.object()?;
    root.get("format").choice(&[(FORMAT, ())])?;
    let sample = root.get("sample");
    let sample_mm = [length(&sample.get("width_mm"))?, length(&sample.get("height_mm"))?];
    let rectified = match root.get("rectified").optional() {
        None => false,
        Some(node) => node.boolean()?,
    };
    let scene = if rectified { rectified_scene(root)? } else { board_scene(root, camera)? };
    if let Scene::Board { target, .. } = &scene {
        fits_hole(&sample, target)?;
    }
    Ok((scene, sample_mm.map(|v| v as f32)))
}

/// Reads a camera file: the object `camera` of `capture.json`. Unknown fields are ignored.
///
/// # Errors
/// As [`Capture::load`].
pub fn read_camera(path: impl AsRef<Path>) -> Result<Camera> {
    let path = path.as_ref();
    let value = read_json(path)?;
    camera(&Node::root(path, &value))
}

/// Checks that the sample is not larger than the board's hole, if any.
fn fits_hole(sample: &Node, target: &Target) -> Result<()> {
    let sides = ["width_mm", "height_mm"].into_iter().zip(target.hole_mm());
    for (name, hole) in sides.filter(|(_, hole)| *hole > 0.0) {
        let side = sample.get(name);
        let expected = format!("at most {hole} mm: the board's hole is no larger");
        // Tolerance for lengths in inches.
        if side.number(&expected)? > hole + 0.1 {
            return Err(side.fault(expected));
        }
    }
    Ok(())
}

fn board_scene(root: &Node, given: Option<Camera>) -> Result<Scene> {
    let board = root.get("board");
    let target = target(&board)?;
    lengths::check(&board, &target)?;
    let camera = match (given, root.get("camera").optional()) {
        (Some(camera), _) => Some(camera),
        (None, Some(node)) => Some(camera(&node)?),
        (None, None) => None,
    };
    let flash_offset_mm = match root.get("flash").optional() {
        None => None,
        Some(node) => Some(DVec3::from_array(position(&node.get("offset_mm"))?)),
    };
    let elevation_mm = match root.get("sample").get("elevation_mm").optional() {
        None => None,
        Some(node) => {
            let [low, high] = elevation::RANGE_MM;
            let expected = "a height above the board in mm, -5 to 20";
            let mm = node.number(expected)?;
            if !(low..=high).contains(&mm) {
                return Err(node.fault(expected));
            }
            Some(mm)
        }
    };
    Ok(Scene::Board { target, camera, flash_offset_mm, elevation_mm })
}

fn rectified_scene(root: &Node) -> Result<Scene> {
    let inverse_square =
        root.get("falloff").choice(&[("none", false), ("inverse-square", true)])?;
    let falloff = match root.get("light_power").optional() {
        _ if !inverse_square => {
            RectifiedFalloff::Given(Falloff::None { power: [std::f32::consts::PI; 3] })
        }
        None => RectifiedFalloff::InverseSquareAuto,
        Some(node) => {
            let expected = "a positive number in mm², or three";
            let power = match node.value() {
                Some(Value::Array(_)) => node.numbers::<3>(expected)?,
                _ => [node.number(expected)?; 3],
            };
            let power_mm2 = power.map(|v| v as f32);
            if !power_mm2.iter().all(|v| v.is_finite() && *v > 0.0) {
                return Err(node.fault(expected));
            }
            RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2 })
        }
    };
    Ok(Scene::Rectified { falloff })
}

fn target(board: &Node) -> Result<Target> {
    board.object()?;
    let charuco =
        board.get("kind").choice(&[("checkerboard-ring", false), ("charuco-ring", true)])?;
    let kind = if charuco {
        let name = board.get("dictionary");
        let expected = "OpenCV's name of a dictionary, such as \"DICT_4X4_250\"";
        let dictionary = name.text(expected)?;
        if !dictionary.starts_with("DICT_") {
            return Err(name.fault(expected));
        }
        let marker_mm = length(&board.get("marker_mm"))?;
        TargetKind::CharucoRing { dictionary: dictionary.to_owned(), marker_mm }
    } else {
        TargetKind::CheckerboardRing
    };
    let hole = board.get("hole_squares");
    let [row_start, col_start, row_end, col_end] =
        hole.counts::<4>("four whole numbers: first row, first column, end row, end column")?;
    let albedo = |name, default| match board.get(name).optional() {
        None => Ok(default),
        Some(node) => node.number("an albedo from 0 to 1"),
    };
    let defaults = Target::default();
    let target = Target {
        kind,
        rows: board.get("rows").count("3 to 200 rows of squares")?,
        cols: board.get("cols").count("3 to 200 columns of squares")?,
        square_mm: length(&board.get("square_mm"))?,
        hole: Hole { row_start, col_start, row_end, col_end },
        white_albedo: albedo("white_albedo", defaults.white_albedo)?,
        black_albedo: albedo("black_albedo", defaults.black_albedo)?,
        top_left: board
            .get("top_left")
            .choice(&[("black", TopLeft::Black), ("white", TopLeft::White)])?,
        patches: match board.get("patches").optional() {
            None => false,
            Some(node) => node.boolean()?,
        },
    };
    match target.fault() {
        None => Ok(target),
        Some((field, expected)) => Err(board.get(field).fault(expected)),
    }
}

fn camera(node: &Node) -> Result<Camera> {
    node.object()?;
    let number = |name| node.get(name).number("a finite number of pixels");
    let size = |name| node.get(name).count("a whole number of pixels");
    let distortion = match node.get("distortion").optional() {
        None => [0.0; 5],
        Some(list) => list.numbers("five finite numbers: k1, k2, p1, p2, k3")?,
    };
    let camera = Camera {
        width: size("width")?,
        height: size("height")?,
        fx: number("fx")?,
        fy: number("fy")?,
        cx: number("cx")?,
        cy: number("cy")?,
        distortion,
    };
    match camera.fault() {
        None => Ok(camera),
        Some((field, expected)) => Err(node.get(field).fault(expected)),
    }
}

fn photo_file(dir: &Path, node: &Node, rectified: bool) -> Result<PhotoFile> {
    node.object()?;
    let path = picture(dir, &node.get("image"))?;
    let encoding = node.get("encoding").choice(&Encoding::ALL.map(|e| (e.name(), e)))?;
    let encoding = Some(encoding).filter(|stated| *stated != Encoding::Srgb);
    let exposure = exposure(node.get("exposure"), 1.0)?;
    let ambient = match node.get("ambient").optional() {
        None => None,
        Some(file) => {
            Some((picture(dir, &file)?, self::exposure(node.get("ambient_exposure"), exposure)?))
        }
    };
    let rectified = if rectified {
        let above = |name| {
            let node = node.get(name);
            let p = position(&node)?;
            if p[2] > 0.0 {
                Ok(p.map(|v| v as f32))
            } else {
                Err(node.fault("a position above the sample: z > 0"))
            }
        };
        Some(RectifiedView { camera_mm: above("camera_mm")?, light_mm: above("light_mm")? })
    } else {
        None
    };
    let turn = turn(node.get("turn"))?;
    Ok(PhotoFile { path, encoding, exposure, rectified, turn, ambient })
}

/// Path of an existing image file.
fn picture(dir: &Path, node: &Node) -> Result<PathBuf> {
    let expected = "the path of an image file, relative to the capture's folder";
    let name = node.text(expected)?;
    let path = dir.join(name);
    if name.is_empty() || !path.is_file() {
        return Err(Error::Field {
            path: node.file().to_owned(),
            field: node.path().to_owned(),
            message: format!("there is no file {}", path.display()),
            expected: expected.into(),
        });
    }
    Ok(path)
}

fn turn(node: Node) -> Result<Rotation> {
    let Some(node) = node.optional() else { return Ok(Rotation::None) };
    let expected = "0, 90, 180 or 270 degrees clockwise";
    Rotation::from_degrees(node.count(expected)?).ok_or_else(|| node.fault(expected))
}

fn exposure(node: Node, default: f32) -> Result<f32> {
    let Some(node) = node.optional() else { return Ok(default) };
    let expected = "a positive number";
    let exposure = node.number(expected)? as f32;
    if exposure.is_finite() && exposure >= f32::MIN_POSITIVE {
        Ok(exposure)
    } else {
        Err(node.fault(expected))
    }
}

fn length(node: &Node) -> Result<f64> {
    let expected = "a positive length in mm, at least a nanometre and at most a kilometre";
    let value = node.number(expected)?;
    if (MIN_LENGTH_MM..=MAX_LENGTH_MM).contains(&value) {
        Ok(value)
    } else {
        Err(node.fault(expected))
    }
}

fn position(node: &Node) -> Result<[f64; 3]> {
    let expected = "three finite numbers in mm, each within a kilometre";
    let value = node.numbers::<3>(expected)?;
    let within = value.iter().all(|v| v.abs() <= MAX_LENGTH_MM);
    if within { Ok(value) } else { Err(node.fault(expected)) }
}

#[cfg(test)]
mod tests;
