//! `report.html`: one page that shows a material, how it came about, and what may be wrong with it.
//!
//! The page holds everything that it shows and loads nothing. What it says is taken from
//! `report.json`; pictures come from the [`Recorder`] and the maps.

mod figures;
mod outline;
mod page;
mod pictures;
mod shader;
mod warnings;

use serde_json::{Value, json};
use svbrdf::Svbrdf;
use svbrdf::capture::{Capture, Frame};
use svbrdf::comparison::Prediction;
use svbrdf::export::relit;
use svbrdf::frame::Photo;
use svbrdf::geometry::Camera;

use self::pictures::{MapPictures, Snapshot, Thumbnail};
use crate::failure::Result;

/// Texels along each side that the page holds; larger maps are averaged.
const TEXELS: usize = 512;
/// Size of a page, bytes; earlier maps are left out where it would be larger.
const MAX_BYTES: usize = 2_900_000;
/// Longer side of the pictures that stand in for the viewer, px.
const RELIT: usize = 320;
/// Predicted photographs that are shown.
const MAX_PREDICTIONS: usize = 6;
/// Differences of predictions are shown enlarged.
const DIFFERENCE_GAIN: f32 = 4.0;

/// Keeps what the page shows of a fit in progress.
pub struct Recorder {
    enabled: bool,
    /// Longer side of copies of photographs, px.
    longest: u32,
    thumbnails: Vec<Option<Thumbnail>>,
    snapshots: Vec<Snapshot>,
}

impl Recorder {
    /// For so many photographs; keeps nothing unless `enabled`.
    pub fn new(photographs: usize, enabled: bool) -> Self {
        // About half a megabyte for all of them together.
        let longest = (360.0 * (16.0 / photographs.max(1) as f64).sqrt()).clamp(96.0, 360.0) as u32;
        let thumbnails = vec![None; photographs];
        Self { enabled, longest, thumbnails, snapshots: Vec::new() }
    }

    /// Keeps a small copy of a photograph.
    pub fn photograph(&mut self, index: usize, photo: &Photo) -> Result<()> {
        if self.enabled && self.thumbnails[index].is_none() {
            self.thumbnails[index] = Some(Thumbnail::new(photo, self.longest)?);
        }
        Ok(())
    }

    /// Keeps small maps as they are after so many photographs.
    pub fn snapshot(&mut self, photographs: usize, maps: &Svbrdf) -> Result<()> {
        if self.enabled {
            self.snapshots.push(Snapshot::new(photographs, maps)?);
        }
        Ok(())
    }
}

/// What the page is about.
pub struct Subject<'a> {
    /// The contents of `report.json`.
    pub report: &'a Value,
    pub capture: &'a Capture,
    /// The photographs used, in the order of the capture.
    pub frames: &'a [Frame],
    /// As used.
    pub camera: Option<Camera>,
    /// The latest maps.
    pub maps: &'a Svbrdf,
    /// Photographs that were held out: number in the capture and prediction.
    pub predictions: Vec<(usize, &'a Prediction)>,
    /// Name of the capture.
    pub name: String,
}

/// Writes the page.
pub fn page(subject: &Subject, recorder: &Recorder) -> Result<String> {
    let maps = pictures::at_most(subject.maps, TEXELS);
    let data = json!({
        "name": subject.name,
        "version": env!("CARGO_PKG_VERSION"),
        "interrupted": subject.report["interrupted"],
        "sample_mm": subject.capture.sample_mm,
        "texels": [subject.maps.width(), subject.maps.height()],
        "maps": MapPictures::new(&maps)?,
        "presets": presets(subject)?,
        "photographs": photographs(subject, recorder),
        "held_out": subject.report["held_out"]["after"],
        "predictions": predictions(&subject.predictions)?,
        "next_view": subject.report["next_view"],
        "warnings": warnings::warnings(subject),
        "figures": figures::figures(subject),
        "summary": figures::summary(subject),
    });
    // The latest maps are there in full.
    let earlier = recorder.snapshots.len().saturating_sub(1);
    let mut snapshots: Vec<&Snapshot> = recorder.snapshots[..earlier].iter().collect();
    let rest = page::fill(&data, &[])?.len();
    let size = |s: &[&Snapshot]| s.iter().map(|s| s.picture.len() + 100).sum::<usize>();
    while rest + size(&snapshots) > MAX_BYTES && !snapshots.is_empty() {
        snapshots = snapshots.into_iter().step_by(2).collect();
        if rest + size(&snapshots) > MAX_BYTES && snapshots.len() == 1 {
            snapshots.clear();
        }
    }
    page::fill(&data, &snapshots)
}

/// Lights to choose from, with the pictures that stand in for the viewer.
fn presets(subject: &Subject) -> Result<Vec<Value>> {
    let sample_mm = subject.capture.sample_mm;
    let relit = relit(subject.maps, sample_mm, RELIT);
    relit
        .iter()
        .map(|lit| {
            Ok(json!({
                "label": lit.label,
                "camera_mm": lit.view.camera_mm,
                "light_mm": lit.view.light_mm,
                "exposure": lit.exposure,
                "picture": pictures::jpeg(lit.width, lit.height, &lit.rgb)?,
            }))
        })
        .collect()
}

/// Rows of `report.json` with what the page adds to them.
fn photographs(subject: &Subject, recorder: &Recorder) -> Vec<Value> {
    let rows = subject.report["frames"].as_array().into_iter().flatten();
    rows.map(|row| {
        let index = row["index"].as_u64().unwrap_or(0) as usize;
        let thumbnail = recorder.thumbnails.get(index).and_then(Option::as_ref);
        let name = subject.frames[index].path.file_name().unwrap_or_default().to_string_lossy();
        let mut shown = row.clone();
        shown["name"] = json!(name);
        shown["thumbnail"] = json!(thumbnail);
        shown["view"] = json!(outline::view(subject, row));
        shown["outlines"] = json!(outline::outlines(subject, row));
        shown
    })
    .collect()
}

/// Photograph, prediction and enlarged difference side by side.
fn predictions(predictions: &[(usize, &Prediction)]) -> Result<Vec<Value>> {
    predictions
        .iter()
        .take(MAX_PREDICTIONS)
        .map(|(index, p)| {
            let side = crate::fit::PREDICTED_TEXELS;
            let n = side * side;
            let mut rgb = Vec::with_capacity(9 * n);
            for i in (0..side).flat_map(|y| (0..3 * side).map(move |x| (y, x))) {
                let (y, x) = i;
                let texel = y * side + x % side;
                for c in 0..3 {
                    let (measured, predicted) =
                        (p.photograph[c * n + texel], p.predicted[c * n + texel]);
                    let value = match x / side {
                        0 => measured,
                        1 => predicted,
                        _ => 0.5 + 0.5 * DIFFERENCE_GAIN * (predicted - measured),
                    };
                    rgb.push((255.0 * value.clamp(0.0, 1.0)).round() as u8);
                }
            }
            Ok(json!({
                "index": index,
                "error": p.error,
                "brightness": p.brightness,
                "picture": pictures::jpeg(3 * side, side, &rgb)?,
            }))
        })
        .collect()
}
