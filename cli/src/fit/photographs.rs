//! The photographs of a capture through a session, one after the other.

use std::collections::{HashMap, VecDeque};
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use svbrdf::Error;
use svbrdf::capture::PhotoFile;
use svbrdf::files::Remark;
use svbrdf::photo::Photo;
use svbrdf::session::{AcceptedPhoto, BoardPose, Hint, Observed, Outcome, Session};

use super::held_out::{Errors, HeldOut, Stage};
use crate::failure::{Failure, Result};
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use crate::report::Recorder;

/// Reason of a photograph whose file was overwritten.
const REPLACED: &str = "replaced";

/// Options of the way through the photographs.
pub struct Options {
    /// Whether the fit begins after all photographs have been added.
    pub at_once: bool,
    /// Number of the last ones that are predicted instead of fitted.
    pub hold_out: usize,
    /// Whether more photographs may come.
    pub endless: bool,
    /// Whether pictures are kept for the page.
    pub report: bool,
}

/// A fit in progress.
pub struct Fit<'a> {
    options: Options,
    session: &'a Session,
    interrupt: &'a Interrupt,
    /// The photographs, in the order of their rows.
    pub photos: Vec<PhotoFile>,
    /// The first that is not gone through yet.
    next: usize,
    /// Photographs accepted and not fitted yet: the last ones stay so.
    waiting: VecDeque<usize>,
    /// Rows of the report by photograph.
    pub rows: Vec<Value>,
    /// Maps after each photograph, where photographs are held out.
    pub stages: Vec<Stage>,
    pub progress: Progress,
    pub recorder: Recorder,
    /// Photographs of the fit when its maps were kept last.
    recorded: usize,
    cut: bool,
    /// Remarks about photographs besides the session's hints.
    remarks: HashMap<usize, Vec<Remark>>,
}

impl<'a> Fit<'a> {
    pub fn new(
        options: Options,
        photos: Vec<PhotoFile>,
        session: &'a Session,
        interrupt: &'a Interrupt,
        progress: Progress,
    ) -> Self {
        Self {
            session,
            interrupt,
            next: 0,
            waiting: VecDeque::new(),
            rows: Vec::new(),
            stages: Vec::new(),
            progress,
            recorder: Recorder::new(photos.len(), options.report),
            recorded: 0,
            cut: false,
            remarks: HashMap::new(),
            photos,
            options,
        }
    }

    /// Takes all photographs in that have not been, unless interrupted.
    pub fn run(&mut self) -> Result<()> {
        let begun = Instant::now();
        if self.options.at_once {
            self.session.pause();
        }
        while self.next < self.photos.len() {
            if self.interrupt.is_set() {
                self.cut = true;
                break;
            }
            self.announce();
            let index = self.next;
            self.next += 1;
            let next = if self.options.hold_out == 0 { Some(index) } else { self.hold(index)? };
            if let Some(next) = next {
                self.add(next)?;
            }
        }
        self.announce();
        if self.options.at_once && self.fitted() > 0 && !self.cut {
            self.session.resume();
            self.settle("all photos")?;
            self.rows.iter_mut().for_each(|row| add_losses(row, self.session));
            let (loss, seconds) = (self.session.progress().loss, begun.elapsed().as_secs_f64());
            self.progress.say(&format!("fit: loss {loss:.4}, {seconds:.1} s in all"));
        }
        self.record()?;
        self.progress.done();
        Ok(())
    }

    /// Tells the session how many photographs it will still get, if all can be used.
    fn announce(&self) {
        let left = self.photos.len() - self.next + self.waiting.len();
        self.session.announce(left.saturating_sub(self.options.hold_out));
    }

    /// Whether the fit was ended before its time.
    pub fn interrupted(&self) -> bool {
        self.cut
    }

    /// Number of photographs in the fit.
    pub fn fitted(&self) -> usize {
        self.session.progress().photos
    }

    /// One line about every photograph.
    pub fn lines(&self) -> Vec<String> {
        self.rows.iter().map(|row| self.line(row)).collect()
    }

    /// Reads a photograph. A damaged file is the inner error, which rejects the photograph; a wrong statement in the
    /// capture is the outer one, which ends the fit.
    fn read(&mut self, index: usize) -> Result<std::result::Result<Photo, String>> {
        match self.photos[index].read_with_remarks() {
            Ok((photo, remarks)) => {
                self.remarks.insert(index, remarks);
                self.recorder.photograph(index, &photo)?;
                Ok(Ok(photo))
            }
            Err(fault @ Error::Image { .. }) => Ok(Err(fault.to_string())),
            Err(fault) => Err(Failure::input(fault)),
        }
    }

    /// Looks whether a photograph can be used: the one before the latest that are held out, if any,
    /// is then to be fitted.
    fn hold(&mut self, index: usize) -> Result<Option<usize>> {
        let begun = Instant::now();
        match self.observe(index)? {
            Ok(_) => self.waiting.push_back(index),
            Err((code, hint)) => self.tell(rejected(index, &code, hint, begun)),
        }
        let over = self.waiting.len() > self.options.hold_out;
        Ok(if over { self.waiting.pop_front() } else { None })
    }

    /// A photograph as the session sees it, without adding it; or the code and sentence of its rejection.
    fn observe(&mut self, index: usize) -> Result<std::result::Result<Observed, (String, String)>> {
        let photo = match self.read(index)? {
            Ok(photo) => photo,
            Err(fault) => return Ok(Err(("unreadable".into(), fault))),
        };
        let observed = match self.photos[index].rectified {
            Some(view) => self.session.observe_rectified(&photo, view.camera_mm, view.light_mm)?,
            None => self.session.observe(&photo)?,
        };
        Ok(observed.into_result().map_err(|r| (r.code().to_owned(), r.to_string())))
    }

    /// Adds a photograph and fits.
    fn add(&mut self, index: usize) -> Result<()> {
        let begun = Instant::now();
        let mut row = self.push(index)?;
        if row["status"] == "accepted" && !self.options.at_once {
            self.settle(&self.place(index))?;
            add_losses(&mut row, self.session);
            row["seconds"] = json!(begun.elapsed().as_secs_f64());
            self.record()?;
        }
        self.tell(row);
        Ok(())
    }

    /// Pushes a photograph; the row of the report.
    fn push(&mut self, index: usize) -> Result<Value> {
        let begun = Instant::now();
        let photo = match self.read(index)? {
            Ok(photo) => photo,
            Err(fault) => return Ok(rejected(index, "unreadable", fault, begun)),
        };
        let outcome = match self.photos[index].rectified {
            Some(view) => {
                self.session.add_rectified_photo(&photo, view.camera_mm, view.light_mm)?
            }
            None => self.session.add_photo(&photo)?,
        };
        let accepted = match outcome {
            Outcome::Accepted(accepted) => accepted,
            Outcome::Rejected(why) => {
                return Ok(rejected(index, why.code(), why.to_string(), begun));
            }
        };
        let AcceptedPhoto { pose, maps_seconds, hints, .. } = accepted;
        let mut row = json!({
            "index": index,
            "status": "accepted",
            "seconds": begun.elapsed().as_secs_f64(),
            "first_maps_seconds": maps_seconds,
            "hints": self.hints(index, &hints),
        });
        set_pose(&mut row, pose.as_ref());
        Ok(row)
    }

    /// Waits for the fit, or until interrupted: the fit is then held.
    fn settle(&mut self, what: &str) -> Result<()> {
        while !self.session.wait_timeout(Duration::from_millis(40))? {
            if self.interrupt.is_set() {
                self.session.pause();
                self.cut = true;
                break;
            }
            let progress = self.session.progress();
            let left = progress.seconds_left.map_or(String::new(), |s| format!(", {s:.0} s left"));
            let message = format!("{what}, loss {:.4}{left}", progress.loss);
            self.progress.show(progress.fraction, message);
        }
        Ok(())
    }

    /// Keeps the maps of the moment, once for every number of photographs.
    fn record(&mut self) -> Result<()> {
        let photographs = self.fitted();
        if photographs > self.recorded {
            let maps = self.session.snapshot()?;
            self.recorder.snapshot(photographs, &maps)?;
            if self.options.hold_out > 0 {
                self.stages.push(Stage::new(photographs, &maps, self.session.light_correction()));
            }
            self.recorded = photographs;
        }
        Ok(())
    }

    fn hints(&self, index: usize, hints: &[Hint]) -> Vec<Value> {
        let own = self.remarks.get(&index).into_iter().flatten();
        let own = own.map(|remark| json!({ "code": remark.code(), "hint": remark.to_string() }));
        let hints = hints.iter().map(|h| json!({ "code": h.code(), "hint": h.to_string() }));
        hints.chain(own).collect()
    }

    fn tell(&mut self, row: Value) {
        let line = self.line(&row);
        self.progress.say(&line);
        let mut event = row.clone();
        event["image"] = json!(self.path(&row).to_string_lossy());
        self.progress.event("photo", event);
        self.rows.push(row);
    }

    /// Looks at the photographs that were held out once more, with all that is known in the end.
    pub fn held_out(&mut self) -> Result<Vec<HeldOut>> {
        let mut held_out = Vec::new();
        for index in std::mem::take(&mut self.waiting) {
            let begun = Instant::now();
            match self.observe(index)? {
                Ok(observed) => {
                    let mut row = json!({
                        "index": index,
                        "status": "accepted",
                        "held_out": true,
                        "seconds": begun.elapsed().as_secs_f64(),
                        "hints": self.hints(index, &observed.hints),
                    });
                    set_pose(&mut row, observed.pose.as_ref());
                    self.rows.push(row);
                    held_out.push(HeldOut { index, observed });
                }
                Err((code, hint)) => self.tell(rejected(index, &code, hint, begun)),
            }
        }
        Ok(held_out)
    }

    /// Number of photographs that wait to be held out.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Brings rows into the order of the capture, with the poses as known in the end: later
    /// photographs better those of earlier ones where the camera is estimated.
    pub fn finish_rows(&mut self, errors: &Errors) {
        let (_, latest) = errors.after.last().map_or((0, &[][..]), |(n, each)| (*n, each));
        for (index, error) in errors.indices.iter().zip(latest) {
            let row = self.rows.iter_mut().find(|row| row["index"] == json!(index));
            let Some(row) = row else { continue };
            row["held_out_error"] = json!(error);
            let row = row.clone();
            let line = self.line(&row);
            self.progress.say(&line);
        }
        for (row, known) in fitted(&mut self.rows).zip(self.session.poses()) {
            set_pose(row, Some(&known));
        }
        self.add_residuals();
        self.rows.sort_by_key(|row| row["index"].as_u64());
    }

    /// Adds the residual of each photograph, and replaces its earlier hints by the present ones.
    fn add_residuals(&mut self) {
        let fits = self.session.photo_fits().unwrap_or_default();
        for (row, fit) in fitted(&mut self.rows).zip(&fits) {
            row["residual"] = json!(fit.residual);
            row["weight"] = json!(fit.weight);
            row["contradicting_part"] = json!(
                fit.part.map(|p| json!({ "share": p.share, "centre": p.centre, "ratio": p.ratio }))
            );
        }
        let Ok(hints) = self.session.hints() else { return };
        let mut told: Vec<(String, Vec<usize>)> = Vec::new();
        for (row, hints) in fitted(&mut self.rows).zip(&hints) {
            row["contradicts"] =
                json!(hints.iter().any(|hint| matches!(hint, Hint::Contradicts { .. })));
            let Some(said) = row["hints"].as_array_mut() else { continue };
            let before: Vec<Value> = std::mem::take(said);
            let new = hints.iter().map(|h| json!({ "code": h.code(), "hint": h.to_string() }));
            said.extend(new.clone());
            // Hints that the session does not repeat: about the file.
            let is_of_files =
                |hint: &&Value| !Hint::CODES.contains(&hint["code"].as_str().unwrap_or_default());
            said.extend(before.iter().filter(is_of_files).cloned());
            let index = row["index"].as_u64().unwrap_or(0) as usize;
            for hint in new.filter(|hint| before.iter().all(|old| old["code"] != hint["code"])) {
                let text = hint["hint"].as_str().unwrap_or_default().to_owned();
                match told.iter_mut().find(|(other, _)| *other == text) {
                    Some((_, photos)) => photos.push(index),
                    None => told.push((text, vec![index])),
                }
            }
        }
        for (text, photos) in told {
            let paths: Vec<String> =
                photos.iter().map(|i| self.photos[*i].path.display().to_string()).collect();
            let which = match paths.as_slice() {
                [one] => one.clone(),
                [first, rest @ ..] => format!("{first} and {} more", rest.len()),
                [] => continue,
            };
            self.progress.say(&format!("note: {which}: {text}"));
            self.progress
                .event("note", json!({ "text": text, "images": paths, "image": paths[0] }));
        }
    }

    /// Takes a photograph back whose file is another one now, and says whether the new one may take its
    /// place.
    pub fn make_way(&mut self, path: &Path) -> bool {
        let mut fitted = self.rows.iter().enumerate().filter(|(_, row)| is_fitted(row));
        let known = fitted.clone().position(|(_, row)| self.path(row) == path);
        let Some((place, (index, _))) = known.and_then(|n| Some((n, fitted.nth(n)?))) else {
            return true;
        };
        let path = path.display();
        if let Err(why) = self.session.remove_photo(place) {
            self.progress
                .say(&format!("note: {path}: overwritten, but the first photo stays: {why}"));
            return false;
        }
        let row = &mut self.rows[index];
        row["status"] = json!("rejected");
        row["reason"] = json!(REPLACED);
        row["hint"] = json!("the file was overwritten; what it holds now is taken instead");
        self.recorded = self.recorded.min(self.session.progress().photos);
        self.progress.say(&format!("note: {path}: overwritten, read again"));
        true
    }

    /// How many photographs were taken back because their files were overwritten.
    pub fn replaced(&self) -> usize {
        self.rows.iter().filter(|row| row["reason"] == REPLACED).count()
    }

    /// The file of a row.
    pub fn path(&self, row: &Value) -> &Path {
        &self.photos[row["index"].as_u64().unwrap_or(0) as usize].path
    }

    /// Whether the latest attempt to read a file failed.
    pub fn is_unreadable(&self, path: &Path) -> bool {
        let row = self.rows.iter().rev().find(|row| self.path(row) == path);
        row.is_some_and(|row| row["reason"] == "unreadable")
    }

    /// Which photograph of how many.
    fn place(&self, index: usize) -> String {
        let number = index + 1;
        if self.options.endless {
            format!("photo {number}")
        } else {
            format!("photo {number}/{}", self.photos.len())
        }
    }

    /// One line about a photograph.
    fn line(&self, row: &Value) -> String {
        let index = row["index"].as_u64().unwrap_or(0) as usize;
        let place = format!("{} {}", self.place(index), self.path(row).display());
        let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
        if row["status"] != "accepted" {
            let text = |key: &str| row[key].as_str().unwrap_or_default();
            return format!("{place}: rejected ({}): {}", text("reason"), text("hint"));
        }
        let hints = row["hints"].as_array().into_iter().flatten();
        let hints: String =
            hints.filter_map(|h| Some(format!("; {}", h["hint"].as_str()?))).collect();
        if let Some(error) = row["held_out_error"].as_f64() {
            return format!("{place}: held out, predicted with an error of {error:.4}{hints}");
        }
        let losses = match (row["loss_before"].as_f64(), row["loss_after"].as_f64()) {
            (Some(before), Some(after)) => format!("loss {before:.4} -> {after:.4}, "),
            _ => String::new(),
        };
        format!("{place}: accepted, {losses}{:.1} s{hints}", number("seconds"))
    }
}

fn is_fitted(row: &Value) -> bool {
    row["status"] == "accepted" && row["held_out"] != true
}

/// Rows of the photographs in the fit, in their order.
fn fitted(rows: &mut [Value]) -> impl Iterator<Item = &mut Value> {
    rows.iter_mut().filter(|row| is_fitted(row))
}

fn rejected(index: usize, reason: &str, hint: String, begun: Instant) -> Value {
    json!({ "index": index, "status": "rejected", "reason": reason, "hint": hint,
            "seconds": begun.elapsed().as_secs_f64() })
}

fn set_pose(row: &mut Value, known: Option<&BoardPose>) {
    let rotation = known.map(|k| k.pose.rotation.transpose().to_cols_array_2d());
    row["rotation"] = json!(rotation);
    row["translation_mm"] = json!(known.map(|k| k.pose.translation.to_array()));
    row["reprojection_rms_px"] = json!(known.map(|k| k.reprojection_rms_px));
}

/// Adds the losses of the fit of an accepted photograph and those before.
fn add_losses(row: &mut Value, session: &Session) {
    if row["status"] == "accepted" {
        let progress = session.progress();
        row["loss_before"] = json!(progress.loss_before);
        row["loss_after"] = json!(progress.loss);
    }
}
