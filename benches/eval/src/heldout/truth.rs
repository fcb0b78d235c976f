//! Radiance of held-out photographs from a capture's `truth/`.

use std::path::{Path, PathBuf};

use serde_json::Value;
use svbrdf::capture::Capture;
use svbrdf::observation::{Falloff, View};
use svbrdf::{Error, Result};

use super::npy;
use super::score::HeldOut;

/// Held-out photographs of `truth/truth.json`, with the indices of their frames. `None` if the file
/// is missing or names none.
///
/// The file gives `light_power` (mm²: `L = BRDF NoL light_power / d²`) and for each frame
/// `exposure` (value of a radiance of 1), `camera_mm`, `light_mm` and, if held out, `heldout.file`:
/// linear radiance seen from above, `[side, side, 3]`, relative to the capture.
pub fn held_out(folder: &Path, capture: &Capture) -> Result<Option<Vec<(usize, HeldOut)>>> {
    let path = folder.join("truth/truth.json");
    if !path.is_file() {
        return Ok(None);
    }
    let text = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
    let truth: Value = serde_json::from_slice(&text)
        .map_err(|e| fault(&path, "(file)", format!("found what is not JSON: {e}"), "JSON"))?;
    let empty = Vec::new();
    let frames = truth["frames"].as_array().unwrap_or(&empty);
    let mut held_out = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        if frame["heldout"].is_null() {
            continue;
        }
        let field = |name: &str| format!("frames[{i}].{name}");
        let relative = frame["heldout"]["file"].as_str().ok_or_else(|| {
            fault(&path, &field("heldout.file"), "no text".into(), "the name of a .npy file")
        })?;
        let power = number(&path, "light_power", &truth["light_power"])? as f32;
        let view = View {
            sample_mm: capture.sample_mm,
            camera_mm: position(&path, &field("camera_mm"), &frame["camera_mm"])?,
            light_mm: position(&path, &field("light_mm"), &frame["light_mm"])?,
            falloff: Falloff::InverseSquare { power_mm2: [power; 3] },
            ..View::default()
        };
        let exposure = number(&path, &field("exposure"), &frame["exposure"])? as f32;
        held_out.push((i, photograph(&folder.join(relative), view, exposure)?));
    }
    Ok((!held_out.is_empty()).then_some(held_out))
}

fn photograph(path: &Path, view: View, exposure: f32) -> Result<HeldOut> {
    let array = npy::read(path)?;
    let [rows, columns, 3] = array.shape[..] else {
        let found = format!("{:?}", array.shape);
        return Err(fault(path, "shape", found, "[side, side, 3]"));
    };
    if rows != columns || rows == 0 {
        return Err(fault(path, "shape", format!("{:?}", array.shape), "[side, side, 3]"));
    }
    let n = rows * columns;
    let observed = (0..3 * n).map(|i| exposure * array.values[3 * (i % n) + i / n]).collect();
    Ok(HeldOut { view, exposure, observed, side: rows, seen: None })
}

fn fault(path: &Path, field: &str, found: String, expected: &str) -> Error {
    Error::Field {
        path: PathBuf::from(path),
        field: field.to_owned(),
        message: format!("found {found}"),
        expected: expected.to_owned(),
    }
}

fn number(path: &Path, field: &str, value: &Value) -> Result<f64> {
    let positive = value.as_f64().filter(|v| v.is_finite() && *v > 0.0);
    positive.ok_or_else(|| fault(path, field, value.to_string(), "a positive number"))
}

fn position(path: &Path, field: &str, value: &Value) -> Result<[f32; 3]> {
    let numbers: Option<Vec<f32>> = value
        .as_array()
        .map(|list| list.iter().filter_map(Value::as_f64).map(|v| v as f32).collect());
    numbers
        .and_then(|v| <[f32; 3]>::try_from(v).ok())
        .filter(|v| v[2] > 0.0 && v.iter().all(|v| v.is_finite()))
        .ok_or_else(|| fault(path, field, value.to_string(), "three numbers in mm with z > 0"))
}
