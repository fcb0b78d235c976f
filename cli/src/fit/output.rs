//! What a fit writes.

use std::time::Instant;

use serde_json::{Value, json};
use svbrdf::Svbrdf;
use svbrdf::confidence::{Confidence, MapDeviations};
use svbrdf::export::{
    ExportOptions, export, write_assessed_maps, write_atomic, write_preview, write_sized_maps,
};
use svbrdf::session::Session;

use super::arguments::Arguments;
use super::document::{Document, FILE_NAME};
use super::held_out::Errors;
use super::input::Input;
use super::photographs::Fit;
use crate::failure::Result;
use crate::report::{self, Subject};

/// Maps and what lies beside them.
const FILES: [&str; 7] = [
    "normal.png",
    "diffuse.png",
    "specular.png",
    "roughness.png",
    "maps.exr",
    "preview.png",
    FILE_NAME,
];
const PAGE: &str = "report.html";

/// Writes maps, preview and report.
pub struct Output<'a> {
    pub arguments: &'a Arguments,
    pub session: &'a Session,
    pub begun: Instant,
}

impl Output<'_> {
    /// Writes everything as it is now; at least one photograph is in the fit.
    pub fn write(&self, input: &Input, fit: &mut Fit) -> Result<()> {
        let (arguments, session) = (self.arguments, self.session);
        let (out, sample_mm) = (&arguments.out, input.capture.sample_mm);
        let maps = session.snapshot()?;
        // A fit that was interrupted is not asked any more.
        let assessed = session.assess().ok().filter(|assessed| assessed.maps == maps);
        let confidence = assessed.map(|assessed| assessed.confidence);
        match &confidence {
            Some(confidence) => write_assessed_maps(out, &maps, confidence, sample_mm)?,
            None => write_sized_maps(out, &maps, sample_mm)?,
        }
        self.write_exports(&maps, sample_mm, fit.fitted())?;
        write_preview(out.join("preview.png"), &maps, sample_mm)?;
        if let Some(photographs) = &input.photographs {
            photographs.write(out, |path| !fit.is_unreadable(path))?;
        }
        let held_out = fit.held_out()?;
        let errors = Errors::measure(&fit.stages, held_out)?;
        fit.finish_rows(&errors);
        let held_out = (arguments.hold_out > 0).then_some(&errors);
        let mut document =
            Document::new(session, fit, held_out, &arguments.method, maps.width(), self.begun);
        document.value["confidence"] = json!(confidence.as_ref().map(deviations));
        if let Some(photographs) = &input.photographs {
            document.value["photographs"] = photographs.json();
        }
        document.value["warnings"] = json!(input.capture.warnings);
        document.write(out)?;
        if !arguments.no_report {
            let subject = Subject {
                report: &document.value,
                capture: &input.capture,
                frames: &fit.frames,
                camera: session.camera(),
                maps: &maps,
                predictions: errors.indices.iter().copied().zip(&errors.predictions).collect(),
                name: input.name.clone(),
            };
            let page = report::page(&subject, &fit.recorder)?;
            write_atomic(out.join(PAGE), page.as_bytes())?;
        }
        let written = json!({ "out": out.to_string_lossy(), "photographs": fit.fitted() });
        fit.progress.event("maps", written);
        Ok(())
    }

    /// Writes the formats of `--export` beside the maps.
    fn write_exports(&self, maps: &Svbrdf, sample_mm: [f32; 2], photographs: usize) -> Result<()> {
        if self.arguments.export.is_empty() {
            return Ok(());
        }
        let options = ExportOptions {
            formats: self.arguments.export.clone(),
            sample_mm,
            photographs: u32::try_from(photographs).ok(),
            ..ExportOptions::default()
        };
        Ok(export(maps, &options)?.write(&self.arguments.out)?)
    }
}

/// Standard deviation of each map.
fn deviations(confidence: &Confidence) -> Value {
    let MapDeviations { normal, diffuse, specular, roughness } = confidence.of_maps();
    json!({ "normal": normal, "diffuse": diffuse, "specular": specular, "roughness": roughness })
}

/// Whether a fit as asked for has been here before, and came to its end.
pub fn is_complete(arguments: &Arguments) -> bool {
    let out = &arguments.out;
    let page = (!arguments.no_report).then_some(PAGE);
    if !FILES.into_iter().chain(page).all(|name| out.join(name).is_file()) {
        return false;
    }
    let report = std::fs::read(out.join(FILE_NAME)).unwrap_or_default();
    let report: Value = serde_json::from_slice(&report).unwrap_or_default();
    report["interrupted"] == false
        && report["resolution"].as_u64() == arguments.resolution.parse().ok()
        && report["method"] == arguments.method.as_str()
}
