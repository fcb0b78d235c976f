//! `report.json`

use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use svbrdf::Svbrdf;
use svbrdf::session::{PhaseReport, Session};

use super::held_out::Errors;
use super::photographs::Fit;
use crate::failure::{Failure, Result};

/// Name of the file.
pub const FILE_NAME: &str = "report.json";

/// The report of a fit.
pub struct Document {
    pub value: Value,
}

impl Document {
    pub fn new(
        session: &Session,
        fit: &Fit,
        held_out: Option<&Errors>,
        method: &str,
        maps: &Svbrdf,
        begun: Instant,
    ) -> Self {
        let camera = session.camera();
        let flash = camera.map(|_| json!({ "offset_mm": session.flash_offset_mm().to_array() }));
        let next_view = session.next_view().map(|v| {
            json!({ "direction": v.direction, "tilt_deg": v.tilt_deg, "azimuth_deg": v.azimuth_deg })
        });
        let camera_sigma = session.camera_sigma().map(
            |s| json!({ "fx": s[0], "fy": s[1], "cx": s[2], "cy": s[3], "distortion": s[4..] }),
        );
        let paper = session.paper().map(|p| {
            json!({ "aspect": p.paper.aspect, "bow_mm": p.paper.bow_mm,
                    "aspect_sigma": p.sigma[0], "bow_sigma_mm": p.sigma[1..] })
        });
        let elevation = session.elevation().map(|e| json!({ "mm": e.mm, "sigma_mm": e.sigma_mm }));
        let tone = session.tone_curve();
        let tone = (!tone.is_identity()).then(|| json!({ "log_slopes": tone.log_slopes }));
        let value = json!({
            "frames": fit.rows,
            "interrupted": fit.interrupted(),
            "held_out": held_out.map(Errors::json),
            "camera": camera,
            "camera_uncertainty": camera_sigma,
            "paper": paper,
            "elevation": elevation,
            "flash": flash,
            "light": light(session, camera.is_none(), fit.fitted()),
            "next_view": next_view,
            "ambient_fraction": session.ambient_fraction(),
            "tone_curve": tone,
            "resolution": maps.width(),
            "brdf": brdf(maps),
            "method": method,
            "phases": phases(session),
            "seconds_total": begun.elapsed().as_secs_f64(),
            "peak_memory_mib": peak_memory_mib(),
        });
        Self { value }
    }

    /// The file that says all this of the files beside it, and that these are they.
    pub fn seal(mut self, files: &[(String, Vec<u8>)]) -> Result<(String, Vec<u8>)> {
        let list = files.iter().map(|(name, bytes)| (name.clone(), fingerprint(bytes)));
        self.value["files"] = Value::Object(list.collect());
        let text =
            serde_json::to_string_pretty(&self.value).map_err(|e| Failure::Other(e.to_string()))?;
        Ok((FILE_NAME.into(), format!("{text}\n").into_bytes()))
    }
}

/// Name of the reflectance that maps are parameters of: every texel's lobe, and the optional ones that some
/// texels have.
fn brdf(maps: &Svbrdf) -> String {
    let lobes = [
        ("anisotropy", maps.anisotropy().is_some()),
        ("coat", maps.coat().is_some()),
        ("sheen", maps.sheen().is_some()),
    ];
    let lobes = lobes.into_iter().filter(|(_, is_there)| *is_there);
    lobes.fold("ggx-schlick".to_owned(), |name, (lobe, _)| format!("{name} +{lobe}"))
}

/// Whether the files beside a report are those that it names.
pub fn is_intact(report: &Value, dir: &Path) -> bool {
    let is_same = |(name, known): (&String, &Value)| {
        let path = dir.join(name);
        std::fs::metadata(&path).is_ok_and(|found| known["bytes"] == found.len())
            && std::fs::read(path).is_ok_and(|bytes| *known == fingerprint(&bytes))
    };
    report["files"].as_object().is_some_and(|files| files.iter().all(is_same))
}

/// The fingerprint of a file.
fn fingerprint(bytes: &[u8]) -> Value {
    let hash: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    json!({ "bytes": bytes.len(), "sha256": hash })
}

/// The corrections of the lights of rectified photographs.
fn light(session: &Session, rectified: bool, photographs: usize) -> Option<Value> {
    let correction = session.light_correction();
    let gain = |i: usize| correction.log_gains.get(i).copied().unwrap_or(0.0).exp();
    rectified.then(|| {
        json!({
            "offset_mm": correction.offset_mm,
            "gain": (0..photographs).map(gain).collect::<Vec<f64>>(),
            "exposure_exponent": correction.exponent,
        })
    })
}

/// The report of each phase of the fit for the latest photograph.
fn phases(session: &Session) -> Vec<Value> {
    let number = |value: f64| value.is_finite().then_some(value);
    let phase = |report: &PhaseReport| {
        json!({ "name": report.name, "steps": report.steps, "cost": report.cost.map(number),
                "milliseconds": report.milliseconds, "result": report.result })
    };
    session.phase_reports().unwrap_or_default().iter().map(phase).collect()
}

/// Largest resident memory so far, if the system reports it.
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

#[cfg(test)]
mod tests {
    use svbrdf::svbrdf::{LOBES, lobe};

    use super::*;

    #[test]
    fn the_brdf_names_the_lobes_that_are_there() {
        let mut maps = Svbrdf::new(2, 2);
        assert_eq!(brdf(&maps), "ggx-schlick");
        let mut planes = vec![0.0; LOBES * 4];
        maps.set_lobes(planes.clone()).unwrap();
        assert_eq!(brdf(&maps), "ggx-schlick");
        planes[4 * lobe::COAT + 1] = 0.5;
        maps.set_lobes(planes.clone()).unwrap();
        assert_eq!(brdf(&maps), "ggx-schlick +coat");
        planes[4 * lobe::ANISOTROPY_Y] = -0.5;
        maps.set_lobes(planes.clone()).unwrap();
        assert_eq!(brdf(&maps), "ggx-schlick +anisotropy +coat");
        planes[4 * lobe::SHEEN + 2] = 0.1;
        maps.set_lobes(planes).unwrap();
        assert_eq!(brdf(&maps), "ggx-schlick +anisotropy +coat +sheen");
    }
}
