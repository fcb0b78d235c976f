//! The input of a fit: a capture with its description, or photographs without one.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};
use svbrdf::calibration::Target;
use svbrdf::capture::{Capture, FILE_NAME, PhotoFile, read_camera};
use svbrdf::export::check_writable;
use svbrdf::files::{Choice, Chosen, LeftOut, Metadata};
use svbrdf::photo::{Encoding, Rotation};

use super::arguments::Arguments;
use crate::board;
use crate::failure::{Failure, Result};
use crate::interrupt::Interrupt;
use crate::pictures::{self, Setup, Watch};
use crate::progress::Progress;

/// More photographs than this take long and add little.
const MOST: usize = 100;
/// Time between two looks into a folder.
pub const LOOK: Duration = Duration::from_millis(400);

/// A capture, and where it came from.
pub struct Input {
    pub capture: Capture,
    /// Name for the report.
    pub name: String,
    /// The subject of messages about the capture as a whole.
    pub origin: String,
    /// Set where there was no description.
    pub photographs: Option<Photographs>,
}

/// Photographs that came without a description.
pub struct Photographs {
    pub choice: Choice,
    setup: Setup,
    /// Set where more are to come.
    pub watch: Option<Watch>,
}

impl Input {
    /// Opens the capture or photographs that the command line names.
    pub fn open(
        arguments: &Arguments,
        interrupt: &Interrupt,
        progress: &mut Progress,
    ) -> Result<Self> {
        match described(&arguments.capture) {
            Some(folder) => Self::described(arguments, &folder),
            None => Self::photographs(arguments, interrupt, progress),
        }
    }

    /// Prints the remarks that precede the fit.
    pub fn tell(&self, progress: &mut Progress) {
        for warning in &self.capture.warnings {
            progress.say(&format!("warning: {warning}"));
            progress.event("warning", json!({ "text": warning }));
        }
        let Some(Photographs { choice, setup, .. }) = &self.photographs else { return };
        let [width, height] = setup.sample_mm;
        let count = choice.chosen.len();
        let photos = if count == 1 { "1 photo".into() } else { format!("{count} photos") };
        progress.say(&format!(
            "{photos} of one camera; sample {width} x {height} mm (--sample-mm states another)"
        ));
        tell(&choice.left_out, &choice.remarks, progress);
    }

    fn described(arguments: &Arguments, folder: &Path) -> Result<Self> {
        let file = folder.join(FILE_NAME);
        for (option, given, field) in [
            ("--sample-mm", arguments.sample_mm.is_some(), "sample"),
            ("--board", arguments.board.is_some(), "board"),
        ] {
            if given {
                let file = file.display();
                return Err(Failure::Input(format!(
                    "{option}: {file} states this in field `{field}`; expected {option} for photographs without {FILE_NAME} only"
                )));
            }
        }
        if arguments.watch {
            return Err(Failure::Input(format!(
                "--watch: {} exists; expected a folder into which photographs arrive",
                file.display()
            )));
        }
        let camera = camera(arguments)?;
        let capture = Capture::load_with_camera(folder, camera).map_err(Failure::input)?;
        check_writable(&arguments.out)?;
        let (name, origin) = (name(folder), format!("{}: field `frames`", file.display()));
        Ok(Self { capture, name, origin, photographs: None })
    }

    fn photographs(
        arguments: &Arguments,
        interrupt: &Interrupt,
        progress: &mut Progress,
    ) -> Result<Self> {
        let inputs = &arguments.capture;
        let target = board::target(arguments.board.as_deref().unwrap_or("ring"))?;
        let setup = Setup {
            sample_mm: sample_mm(arguments.sample_mm, &target)?,
            board: board::description(&target),
            camera: camera(arguments)?,
        };
        for folder in inputs.iter().filter(|path| path.is_dir()) {
            refuse_out(folder, &arguments.out)?;
        }
        let (choice, watch) = if arguments.watch {
            progress.say("waiting for photographs; Ctrl-C ends");
            let (choice, watch) = await_first(inputs, &arguments.out, interrupt, progress)?;
            (choice, Some(watch))
        } else {
            let found = pictures::find(inputs, &arguments.out)?;
            if found.pictures.len() > MOST && arguments.frames.is_none() {
                return Err(too_many(found.pictures.len()));
            }
            let mut choice = choose(found.pictures);
            choice.left_out.extend(found.foreign);
            // The description is to repeat the run.
            choice.chosen.truncate(arguments.frames.map_or(MOST, |n| n as usize));
            (choice, None)
        };
        check_writable(&arguments.out)?;
        let first = &inputs[0];
        let folder = if first.is_dir() { Some(first.as_path()) } else { first.parent() };
        let name = name(folder.unwrap_or(Path::new("")));
        let photographs = Photographs { choice, setup, watch };
        let capture = photographs.capture(&arguments.out)?;
        let origin = first.display().to_string();
        Ok(Self { capture, name, origin, photographs: Some(photographs) })
    }
}

impl Photographs {
    /// The capture as its description, once written, would be read.
    fn capture(&self, out: &Path) -> Result<Capture> {
        let chosen = &self.choice.chosen;
        let json = pictures::describe(&self.setup, chosen, out)?.to_string();
        let mut capture = Capture::parse(out, json.as_bytes()).map_err(Failure::input)?;
        for (file, chosen) in capture.photos.iter_mut().zip(chosen) {
            file.path.clone_from(&chosen.path);
        }
        Ok(capture)
    }

    /// The description of those photographs that `keep` holds for, for a file in folder `out`.
    pub fn encode(&self, out: &Path, keep: impl Fn(&Path) -> bool) -> Result<Vec<u8>> {
        let chosen = self.choice.chosen.iter().filter(|chosen| keep(&chosen.path));
        let chosen: Vec<Chosen> = chosen.cloned().collect();
        let description = pictures::describe(&self.setup, &chosen, out)?;
        let text = serde_json::to_string_pretty(&description)
            .map_err(|e| Failure::Other(e.to_string()))?;
        Ok(format!("{text}\n").into_bytes())
    }

    /// For `report.json`.
    pub fn json(&self) -> Value {
        let left_out: Vec<Value> = self
            .choice
            .left_out
            .iter()
            .map(|l| json!({ "image": l.path.to_string_lossy(), "reason": l.reason }))
            .collect();
        json!({ "left_out": left_out, "remarks": self.choice.remarks })
    }
}

/// Names the photographs that are left out, and prints remarks about the others.
pub fn tell(left_out: &[LeftOut], remarks: &[String], progress: &mut Progress) {
    for LeftOut { path, reason } in left_out {
        progress.say(&format!("left out: {}: {reason}", path.display()));
        let event = json!({ "image": path.to_string_lossy(), "reason": reason });
        progress.event("left_out", event);
    }
    for remark in remarks {
        progress.say(&format!("note: {remark}"));
        progress.event("note", json!({ "text": remark }));
    }
}

/// Waits for the first photographs of a folder.
fn await_first(
    inputs: &[PathBuf],
    out: &Path,
    interrupt: &Interrupt,
    progress: &mut Progress,
) -> Result<(Choice, Watch)> {
    let [folder] = inputs else {
        return Err(Failure::Input("--watch: several names; expected one folder".into()));
    };
    let mut watch = Watch::new(folder);
    loop {
        let arrived = watch.arrived()?.sorted_out(out);
        tell(&arrived.foreign, &[], progress);
        if !arrived.pictures.is_empty() {
            return Ok((choose(arrived.pictures), watch));
        }
        if interrupt.is_set() {
            return Err(Failure::Interrupted("no photo had arrived; nothing is written".into()));
        }
        std::thread::sleep(LOOK);
    }
}

/// Photographs of one camera, in order.
fn choose(paths: Vec<PathBuf>) -> Choice {
    let mut choice = Choice::default();
    choice.add(paths.into_iter().map(|path| (Metadata::read(&path), path)).collect());
    choice
}

/// The photograph as a session takes it.
pub fn photo_file(chosen: &Chosen) -> PhotoFile {
    PhotoFile {
        path: chosen.path.clone(),
        encoding: chosen.is_linear.then_some(Encoding::Linear),
        exposure: chosen.exposure,
        rectified: None,
        turn: Rotation::from_degrees(chosen.turn_deg).unwrap_or_default(),
        ambient: None,
    }
}

/// The folder of a capture's description, if a single input is one or holds one.
fn described(inputs: &[PathBuf]) -> Option<PathBuf> {
    let [input] = inputs else { return None };
    if input.join(FILE_NAME).is_file() {
        return Some(input.clone());
    }
    let is_description = input.file_name().is_some_and(|name| name == FILE_NAME);
    let parent = input.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
    parent.filter(|_| is_description).map(Path::to_owned)
}

fn camera(arguments: &Arguments) -> Result<Option<svbrdf::geometry::Camera>> {
    arguments.camera.as_ref().map(read_camera).transpose().map_err(Failure::input)
}

/// The sample's size: as stated, else a square that the hole holds.
fn sample_mm(stated: Option<[f32; 2]>, target: &Target) -> Result<[f32; 2]> {
    let Some([w, h]) = stated else { return Ok(target.usual_sample_mm()) };
    let [width, height] = target.hole_mm();
    if f64::from(w) > width || f64::from(h) > height {
        return Err(Failure::Input(format!(
            "--sample-mm {w}x{h}: larger than the board's hole; expected at most {width}x{height} (for another board: --board)"
        )));
    }
    Ok([w, h])
}

/// Maps among photographs would pass for photographs.
fn refuse_out(folder: &Path, out: &Path) -> Result<()> {
    let same = folder.canonicalize().ok().zip(out.canonicalize().ok()).is_some_and(|(a, b)| a == b);
    if same {
        return Err(Failure::Input(format!(
            "--out {}: the photographs lie there; expected another folder for the maps",
            out.display()
        )));
    }
    Ok(())
}

fn too_many(count: usize) -> Failure {
    Failure::Input(format!(
        "{count} photographs; expected at most {MOST}: eight to twenty from all sides make good maps. \
         Name those of one sample, or use the first N of them with --frames N"
    ))
}

/// Name of a capture: that of its folder.
fn name(folder: &Path) -> String {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    whole.file_name().map_or_else(|| "capture".into(), |n| n.to_string_lossy().into_owned())
}
