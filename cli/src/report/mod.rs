//! `report.html`: one page with a material, the course of its fit, and possible faults.
//!
//! The page contains everything that it shows and loads nothing. Its texts come from `report.json`, its pictures from
//! the [`Recorder`] and the maps.

mod figures;
mod outline;
mod page;
mod pictures;
mod shader;
mod subject;
mod warnings;

use serde_json::{Value, json};
use svbrdf::Svbrdf;
use svbrdf::comparison::Prediction;
use svbrdf::export::relit;
use svbrdf::photo::Photo;

use self::pictures::{MapPictures, Snapshot, Thumbnail};
pub use self::subject::Subject;
use crate::failure::Result;

/// Largest numbers of texels along each side in the page; larger maps are averaged. Maps that compress badly use the
/// next one.
const TEXELS: [usize; 3] = [512, 384, 256];
/// Size of a page, bytes; earlier maps are left out where it would be larger.
const MAX_BYTES: usize = 2_900_000;
/// Longer side of the pictures that stand in for the viewer, px.
const RELIT: usize = 320;
/// Predicted photographs that are shown.
const MAX_PREDICTIONS: usize = 6;
/// Differences of predictions are shown enlarged.
const DIFFERENCE_GAIN: f32 = 4.0;

/// Records a fit in progress for the page.
pub struct Recorder {
    enabled: bool,
    /// Longer side of copies of photographs, px.
    longest: u32,
    thumbnails: Vec<Option<Thumbnail>>,
    snapshots: Vec<Snapshot>,
}

impl Recorder {
    /// For so many photographs, or some more; keeps nothing unless `enabled`.
    pub fn new(photographs: usize, enabled: bool) -> Self {
        // About half a megabyte for all of them together.
        let longest = (360.0 * (16.0 / photographs.max(1) as f64).sqrt()).clamp(48.0, 360.0) as u32;
        let thumbnails = vec![None; photographs];
        Self { enabled, longest, thumbnails, snapshots: Vec::new() }
    }

    /// Keeps a small copy of a photograph.
    pub fn photograph(&mut self, index: usize, photo: &Photo) -> Result<()> {
        if self.thumbnails.len() <= index {
            self.thumbnails.resize(index + 1, None);
        }
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

/// Writes the page.
pub fn page(subject: &Subject, recorder: &Recorder) -> Result<String> {
    let mut data = json!({
        "name": subject.name,
        "version": env!("CARGO_PKG_VERSION"),
        "interrupted": subject.report["interrupted"],
        "sample_mm": subject.capture.sample_mm,
        "texels": [subject.maps.width(), subject.maps.height()],
        "presets": presets(subject)?,
        "photographs": photographs(subject, recorder),
        "held_out": subject.report["held_out"]["after"],
        "predictions": predictions(&subject.predictions)?,
        "next_view": subject.report["next_view"],
        "warnings": warnings::warnings(subject),
        "figures": figures::figures(subject),
        "summary": figures::summary(subject),
    });
    let rest = page::fill(&data, &[])?.len();
    let mut bytes = usize::MAX;
    for texels in TEXELS {
        let maps = MapPictures::new(&pictures::at_most(subject.maps, texels))?;
        bytes = rest + maps.bytes();
        data["maps"] = json!(maps);
        if bytes <= MAX_BYTES {
            break;
        }
    }
    // The latest maps are there in full.
    let earlier = recorder.snapshots.len().saturating_sub(1);
    page::fill(&data, &thinned(&recorder.snapshots[..earlier], MAX_BYTES.saturating_sub(bytes)))
}

/// Snapshots, as many as so many bytes hold, spread evenly.
fn thinned(snapshots: &[Snapshot], bytes: usize) -> Vec<&Snapshot> {
    let mut kept: Vec<&Snapshot> = snapshots.iter().collect();
    while kept.iter().map(|s| s.bytes()).sum::<usize>() > bytes {
        kept = if kept.len() > 1 { kept.into_iter().step_by(2).collect() } else { Vec::new() };
    }
    kept
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

/// Rows of `report.json` with the page's additions.
fn photographs(subject: &Subject, recorder: &Recorder) -> Vec<Value> {
    let rows = subject.report["frames"].as_array().into_iter().flatten();
    rows.map(|row| {
        let index = row["index"].as_u64().unwrap_or(0) as usize;
        let thumbnail = recorder.thumbnails.get(index).and_then(Option::as_ref);
        let name = subject.photos[index].path.file_name().unwrap_or_default().to_string_lossy();
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
            let side = (p.photograph.len() / 3).isqrt();
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
                "delta_e": p.delta_e,
                "brightness": p.brightness,
                "picture": pictures::jpeg(3 * side, side, &rgb)?,
            }))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use svbrdf::capture::{Capture, PhotoFile};
    use svbrdf::random::Random;
    use svbrdf::session::{RectifiedFalloff, Scene};

    /// Maps that compress as badly as any, and a photograph with a little of it.
    fn noise(texels: usize) -> (Svbrdf, Photo) {
        let mut random = Random::new(2);
        let mut value = || random.uniform() as f32;
        let mut maps = Svbrdf::new(texels, texels);
        maps.planes_mut().iter_mut().for_each(|v| *v = value());
        maps.normal_slopes_mut()[0].iter_mut().for_each(|v| *v = 2.0 * *v - 1.0);
        let rgb = (0..3 * 200 * 150).map(|_| 0.4 + 0.02 * value()).collect();
        (maps, Photo::from_linear(200, 150, rgb, 1.0, 9.0).unwrap())
    }

    #[test]
    fn no_page_is_larger_than_3_mb() {
        for (texels, photographs) in [(256, 8), (512, 8), (512, 60)] {
            let (maps, photo) = noise(texels);
            let mut recorder = Recorder::new(photographs, true);
            for index in 0..photographs {
                recorder.photograph(index, &photo).unwrap();
                recorder.snapshot(index + 1, &maps).unwrap();
            }
            let falloff = RectifiedFalloff::InverseSquareAuto;
            let file = PhotoFile {
                path: "frames/00.png".into(),
                encoding: Some(svbrdf::photo::Encoding::Linear),
                exposure: 1.0,
                rectified: None,
                turn: svbrdf::photo::Rotation::None,
                ambient: None,
            };
            let capture = Capture {
                sample_mm: [80.0, 80.0],
                scene: Scene::Rectified { falloff },
                photos: vec![file; photographs],
                warnings: Vec::new(),
            };
            let rows: Vec<Value> =
                (0..photographs).map(|i| json!({ "index": i, "status": "accepted" })).collect();
            let subject = Subject {
                report: &json!({ "frames": rows, "interrupted": false }),
                capture: &capture,
                photos: &capture.photos,
                camera: None,
                maps: &maps,
                predictions: Vec::new(),
                name: "noise".into(),
            };
            let page = page(&subject, &recorder).unwrap();
            assert!(page.len() <= 3_000_000, "{texels} texels: {} bytes", page.len());
            assert!(page.len() > 1_000_000, "what fits is there: {} bytes", page.len());
            let pictures = page.matches("data:image/jpeg").count();
            assert!(pictures >= photographs + 6, "all photographs, four lightings, two maps");
        }
    }
}
