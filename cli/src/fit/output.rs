//! The files that a fit writes.

use std::time::Instant;

use serde_json::{Value, json};
use svbrdf::Svbrdf;
use svbrdf::capture;
use svbrdf::export::{
    CLASS_FILE, ExportOptions, LOBE_FILES, MapsOptions, encode_classes, encode_maps,
    encode_preview, export, replace_files,
};
use svbrdf::session::Session;
use svbrdf::uncertainty::Uncertainty;

use super::arguments::Arguments;
use super::document::{self, Document};
use super::held_out::Errors;
use super::input::Input;
use super::photographs::Fit;
use crate::failure::Result;
use crate::report::{self, Subject};
use crate::terminal;

/// Maps and the files beside them, except the report.
const FILES: [&str; 6] =
    ["normal.png", "diffuse.png", "specular.png", "roughness.png", "maps.exr", PREVIEW];
const PREVIEW: &str = "preview.png";
const PAGE: &str = "report.html";

/// Writes maps, preview and report.
pub struct Output<'a> {
    pub arguments: &'a Arguments,
    pub session: &'a Session,
    pub begun: Instant,
}

impl Output<'_> {
    /// Writes everything as it is now, report.json last; at least one photograph is in the fit. Whenever
    /// the process is killed, no report lies beside maps of another fit.
    pub fn write(&self, input: &Input, fit: &mut Fit) -> Result<()> {
        let (arguments, session) = (self.arguments, self.session);
        let (out, sample_mm) = (&arguments.out, input.capture.sample_mm);
        let maps = session.snapshot()?;
        // A fit that was interrupted is not asked any more.
        let known = session.snapshot_with_uncertainty().ok().filter(|known| known.maps == maps);
        let uncertainty = known.map(|known| known.uncertainty);
        let options = MapsOptions { sample_mm: Some(sample_mm), uncertainty: uncertainty.as_ref() };
        let mut files = encode_maps(&maps, &options)?;
        let classes = session.classes().unwrap_or_default();
        if !classes.is_empty() {
            let image = encode_classes(maps.width(), maps.height(), &classes)?;
            files.push((CLASS_FILE.into(), image));
        }
        files.extend(self.exports(&maps, sample_mm, fit.fitted())?);
        files.push((PREVIEW.into(), encode_preview(&maps, sample_mm)?));
        if let Some(photographs) = &input.photographs {
            let description = photographs.encode(out, |path| !fit.is_unreadable(path))?;
            files.push((capture::FILE_NAME.into(), description));
        }
        let held_out = fit.held_out()?;
        let errors = Errors::measure(&fit.stages, held_out)?;
        fit.finish_rows(&errors);
        let held_out = (arguments.hold_out > 0).then_some(&errors);
        let mut document =
            Document::new(session, fit, held_out, &arguments.method, &maps, self.begun);
        document.value["confidence"] = json!(uncertainty.as_ref().map(Uncertainty::of_maps));
        if let Some(photographs) = &input.photographs {
            document.value["photographs"] = photographs.json();
        }
        document.value["warnings"] = json!(input.capture.warnings);
        if !arguments.no_report {
            let subject = Subject {
                report: &document.value,
                capture: &input.capture,
                photos: &fit.photos,
                camera: session.camera(),
                maps: &maps,
                predictions: errors.indices.iter().copied().zip(&errors.predictions).collect(),
                name: input.name.clone(),
            };
            let page = report::page(&subject, &fit.recorder)?;
            files.push((PAGE.into(), page.into_bytes()));
        }
        files.push(document.seal(&files)?);
        // Files of an earlier fit would lie beside the maps of this one.
        let earlier = [LOBE_FILES.as_slice(), &[CLASS_FILE, PAGE]].concat();
        replace_files(out, &files, &earlier)?;
        let written = json!({ "out": out.to_string_lossy(), "photographs": fit.fitted() });
        fit.progress.event("maps", written);
        Ok(())
    }

    /// The files of `--export`.
    fn exports(
        &self,
        maps: &Svbrdf,
        sample_mm: [f32; 2],
        photographs: usize,
    ) -> Result<Vec<(String, Vec<u8>)>> {
        if self.arguments.export.is_empty() {
            return Ok(Vec::new());
        }
        let options = ExportOptions {
            formats: self.arguments.export.clone(),
            sample_mm,
            photographs: u32::try_from(photographs).ok(),
            ..ExportOptions::default()
        };
        let package = export(maps, &options)?;
        package.remarks.iter().for_each(terminal::say);
        Ok(package.files)
    }
}

/// Whether a fit as asked for has been here before, came to its end, and has left all its files as they
/// are now.
pub fn is_complete(arguments: &Arguments) -> bool {
    let out = &arguments.out;
    let report = std::fs::read(out.join(document::FILE_NAME)).unwrap_or_default();
    let report: Value = serde_json::from_slice(&report).unwrap_or_default();
    let page = (!arguments.no_report).then_some(PAGE);
    FILES.into_iter().chain(page).all(|name| report["files"][name].is_object())
        && document::is_intact(&report, out)
        && report["interrupted"] == false
        && report["resolution"].as_u64() == arguments.resolution.parse().ok()
        && report["method"] == arguments.method.as_str()
}
