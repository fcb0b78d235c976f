//! `svbrdf` in web pages.
//!
//! A [`Scan`] takes encoded photographs and is driven by its caller, [`Scan::go_on`] after
//! [`Scan::go_on`], as a worker does between two messages. Answers with several parts are JSON.

extern crate svbrdf as engine;

mod outline;
mod photograph;
mod pictures;
mod report;
#[path = "../../../cli/src/report/shader.rs"]
mod shader;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};
use svbrdf::board_sheet::{BoardSheet, Paper, SheetFormat};
use svbrdf::calibration::Target;
use svbrdf::capture::parse_scene;
use svbrdf::export::{ExportOptions, Format, MapsOptions, encode_maps, export};
use svbrdf::files::Choice;
use svbrdf::networks::Networks;
use svbrdf::session::{Driver, Scene, Session, Settings};
use wasm_bindgen::prelude::*;
use web_time::Instant;

/// Most memory of a session, bytes: WebAssembly addresses 4 GiB, and photographs are decoded beside.
const SESSION_BYTES: u64 = 5 << 29;

/// The networks, from the contents of their files.
#[wasm_bindgen]
pub struct Models(Arc<Networks>);

#[wasm_bindgen]
impl Models {
    /// Reads the networks.
    ///
    /// # Errors
    /// When one is damaged.
    #[wasm_bindgen(constructor)]
    pub fn new(
        decoder: &[u8],
        encoder: &[u8],
        photo: &[u8],
        completion: &[u8],
    ) -> Result<Models, JsError> {
        Ok(Self(Arc::new(Networks::from_bytes(decoder, encoder, photo, completion)?)))
    }

    /// Makes the networks ready for maps of `resolution` texels a side, ahead of a photograph.
    ///
    /// # Errors
    /// When the resolution does not suit them.
    pub fn prepare(&self, resolution: usize) -> Result<(), JsError> {
        Ok(self.0.prepare(resolution, resolution)?)
    }
}

/// A scan in progress.
#[wasm_bindgen]
pub struct Scan {
    session: Session,
    target: Target,
    /// Which photographs belong together; `None` where a description says so.
    choice: Option<Choice>,
    /// Rows of the report, one a photograph.
    rows: Vec<Value>,
    /// The latest photograph in small.
    small: Vec<u8>,
    begun: Instant,
}

#[wasm_bindgen]
impl Scan {
    /// Starts a scan with maps of `resolution` texels a side: 256, 512, 1024 or 2048. Of the printed
    /// default board, or as `description`, the contents of a `capture.json`, says.
    ///
    /// # Errors
    /// When the resolution is none of these, or the description has a fault or is not one of a board.
    #[wasm_bindgen(constructor)]
    pub fn new(
        models: &Models,
        resolution: usize,
        description: Option<String>,
    ) -> Result<Scan, JsError> {
        let choice = description.is_none().then(Choice::default);
        let (scene, sample_mm) = match description {
            Some(json) => parse_scene(json.as_bytes())?,
            None => default_scene(),
        };
        let Scene::Board { target, .. } = &scene else {
            return Err(JsError::new("a scan of a printed board is expected"));
        };
        let target = target.clone();
        let settings = Settings {
            sample_mm,
            resolution,
            threads: 1,
            memory_limit_bytes: Some(SESSION_BYTES),
            driver: Driver::Caller,
            ..Settings::default()
        };
        let session = Session::with_networks(scene, settings, models.0.clone())?;
        Ok(Self {
            session,
            target,
            choice,
            rows: Vec::new(),
            small: Vec::new(),
            begun: Instant::now(),
        })
    }

    /// Adds an encoded photograph: its row of the report, with what is said of it. One that cannot
    /// be used is rejected and changes nothing. The maps know of it when this returns.
    ///
    /// # Errors
    /// When the scan has failed.
    pub fn push(&mut self, name: &str, bytes: &[u8]) -> Result<String, JsError> {
        let index = self.rows.len();
        let begun = Instant::now();
        let mut row =
            photograph::push(&self.session, self.choice.as_mut(), name, bytes, &mut self.small)?;
        row["index"] = json!(index);
        row["image"] = json!(name);
        row["seconds"] = json!(begun.elapsed().as_secs_f64());
        self.rows.push(row.clone());
        Ok(row.to_string())
    }

    /// The latest photograph, 8-bit RGBA of the width and height that its row has as `small`; empty
    /// where it could not be read.
    pub fn small(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.small)
    }

    /// Goes on with the fit for so many milliseconds, and for the step in progress: whether there
    /// is more to do.
    ///
    /// # Errors
    /// When the scan has failed.
    pub fn go_on(&self, milliseconds: f64) -> Result<bool, JsError> {
        let time = Duration::try_from_secs_f64(1e-3 * milliseconds).unwrap_or_default();
        let begun = Instant::now();
        while self.session.step()? {
            if begun.elapsed() >= time {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Announces that so many photographs are still to come: the share done is that of the work on all of them
    /// together, and never falls before they have come.
    pub fn announce(&self, photographs: usize) {
        self.session.announce(photographs);
    }

    /// State of the fit: photographs, share done, loss, seconds left, whether it has settled, and
    /// how often the maps have changed.
    pub fn progress(&self) -> String {
        let p = self.session.progress();
        json!({
            "photographs": p.photos,
            "fraction": p.fraction,
            "loss": p.loss,
            "loss_before": p.loss_before,
            "seconds_left": p.seconds_left,
            "settled": p.settled,
            "maps": self.session.revision().maps,
        })
        .to_string()
    }

    /// Width and height of the sample, mm.
    pub fn sample_mm(&self) -> Vec<f32> {
        self.session.settings().sample_mm.to_vec()
    }

    /// Texels along each side of the maps as they are now.
    ///
    /// # Errors
    /// Before the first photograph was accepted.
    pub fn map_size(&self) -> Result<Vec<u32>, JsError> {
        let maps = self.session.snapshot()?;
        Ok(vec![maps.width() as u32, maps.height() as u32])
    }

    /// Which maps of optional lobes the material has: of `anisotropy`, `coat`, `sheen` and `sheen_roughness`,
    /// one a line.
    ///
    /// # Errors
    /// Before the first photograph was accepted.
    pub fn lobes(&self) -> Result<String, JsError> {
        let maps = self.session.snapshot()?;
        Ok(pictures::lobe_names(&maps).join("\n"))
    }

    /// A map as 8-bit RGBA for the screen: `normal`, `diffuse`, `specular`, `roughness`, or one of
    /// [`Scan::lobes`] in glTF's encoding.
    ///
    /// # Errors
    /// Before the first photograph was accepted, and for another name.
    pub fn picture(&self, name: &str) -> Result<Vec<u8>, JsError> {
        let maps = self.session.snapshot()?;
        pictures::rgba(&maps, name)
            .ok_or_else(|| JsError::new(&format!("there is no map `{name}`")))
    }

    /// A texture of the viewer, four numbers a texel: `shape` (two slopes of the normal, roughness as the
    /// geometric mean of both alphas has it), `diffuse` or `specular` (linear), or, where there are any,
    /// `lobes` (anisotropy and coat, the first planes of `svbrdf::svbrdf::lobe`) and `sheen` (the others).
    ///
    /// # Errors
    /// As [`Scan::picture`].
    pub fn texture(&self, name: &str) -> Result<Vec<f32>, JsError> {
        let maps = self.session.snapshot()?;
        pictures::texture(&maps, name)
            .ok_or_else(|| JsError::new(&format!("there is no texture `{name}`")))
    }

    /// Outlines of board and sample in each accepted photograph as known now, in parts of its width
    /// and height, and where it was taken from.
    pub fn places(&self) -> String {
        let poses = self.session.poses();
        let Some(camera) = self.session.camera() else { return "[]".into() };
        let elevation = self.session.elevation().map_or(0.0, |e| e.mm);
        let sample_mm = self.session.settings().sample_mm;
        let places = poses
            .iter()
            .map(|known| outline::place(&self.target, sample_mm, &camera, &known.pose, elevation));
        json!(places.collect::<Vec<_>>()).to_string()
    }

    /// The deviations that are to be expected of each map.
    ///
    /// # Errors
    /// Before the first photograph was accepted, and when the scan has failed.
    pub fn deviations(&self) -> Result<String, JsError> {
        Ok(json!(self.session.snapshot_with_uncertainty()?.uncertainty.of_maps()).to_string())
    }

    /// Everything that is known of the scan, as `report.json` of the command line has it.
    ///
    /// # Errors
    /// When the scan has failed.
    pub fn report(&self) -> Result<String, JsError> {
        let text = report::document(&self.session, &self.rows, self.begun.elapsed());
        Ok(serde_json::to_string_pretty(&text)?)
    }

    /// A file of the maps: `material.glb`, `material.usdz`, `normal.png`, `diffuse.png`,
    /// `specular.png`, `roughness.png` or `maps.exr`; where there are such lobes, `anisotropy.png`, `coat.png`,
    /// `sheen.png` or `sheen_roughness.png`.
    ///
    /// # Errors
    /// Before the first photograph was accepted, and for another name.
    pub fn file(&self, name: &str) -> Result<Vec<u8>, JsError> {
        let maps = self.session.snapshot()?;
        let sample_mm = self.session.settings().sample_mm;
        let format = [Format::Glb, Format::Usdz]
            .into_iter()
            .find(|format| name == format!("material.{}", format.name()));
        let files = match format {
            Some(format) => {
                let photographs = u32::try_from(self.session.progress().photos).ok();
                let formats = vec![format];
                export(
                    &maps,
                    &ExportOptions { formats, sample_mm, photographs, ..Default::default() },
                )?
                .files
            }
            None => {
                let known = self.session.snapshot_with_uncertainty()?;
                let uncertainty = Some(&known.uncertainty);
                encode_maps(&known.maps, &MapsOptions { sample_mm: Some(sample_mm), uncertainty })?
            }
        };
        let file = files.into_iter().find(|(found, _)| found == name);
        file.map(|(_, bytes)| bytes)
            .ok_or_else(|| JsError::new(&format!("there is no file `{name}`")))
    }
}

/// The board of scans without a description, as a PDF to be printed at 100 %.
///
/// # Errors
/// For another paper than `a4` and `letter`.
#[wasm_bindgen]
pub fn board(paper: &str) -> Result<Vec<u8>, JsError> {
    let paper = match paper {
        "a4" => Paper::A4,
        "letter" => Paper::Letter,
        other => return Err(JsError::new(&format!("there is no paper `{other}`"))),
    };
    Ok(BoardSheet::new(&Target::default(), paper)?.encode(SheetFormat::Pdf)?)
}

/// The fragment shader of the viewer.
#[wasm_bindgen]
pub fn fragment_shader() -> String {
    shader::fragment()
}

/// Where a panic says what happened: WebAssembly ends without a word.
static LAST_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Runs when the library is loaded.
#[wasm_bindgen(start)]
pub fn start() {
    std::panic::set_hook(Box::new(|panic| {
        *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = Some(panic.to_string());
    }));
}

/// Message of the panic that stopped the library; `None` without one.
#[wasm_bindgen]
pub fn last_panic() -> Option<String> {
    LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Version of the library.
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").to_owned()
}

fn default_scene() -> (Scene, [f32; 2]) {
    let target = Target::default();
    let sample_mm = target.usual_sample_mm();
    let scene = Scene::board(target).into();
    (scene, sample_mm)
}
