//! The report of a scan, in the fields of the command line's `report.json`; `deviations` are its `confidence`.

use std::time::Duration;

use serde_json::{Value, json};
use svbrdf::session::{Hint, Session};

/// The report: `rows` of the photographs with what is known of them now.
pub fn document(session: &Session, rows: &[Value], time: Duration) -> Value {
    let mut rows = rows.to_vec();
    let fits = session.photo_fits().unwrap_or_default();
    let hints = session.hints().unwrap_or_default();
    let accepted = rows.iter_mut().filter(|row| row["status"] == "accepted");
    for (((row, known), fit), hints) in accepted.zip(session.poses()).zip(&fits).zip(&hints) {
        let pose = known.pose;
        row["rotation"] = json!(pose.rotation.transpose().to_cols_array_2d());
        row["translation_mm"] = json!(pose.translation.to_array());
        row["reprojection_rms_px"] = json!(known.reprojection_rms_px);
        row["residual"] = json!(fit.residual);
        row["contradicts"] = json!(hints.iter().any(|h| matches!(h, Hint::Contradicts { .. })));
        // Those of earlier states are withdrawn; what the file tells stays.
        let of_file =
            |hint: &Value| !hint["code"].as_str().is_some_and(|code| Hint::CODES.contains(&code));
        if let Some(said) = row["hints"].as_array_mut() {
            said.retain(of_file);
            let now = hints.iter().map(|h| json!({ "code": h.code(), "hint": h.to_string() }));
            said.splice(0..0, now);
        }
    }
    for row in rows.iter_mut().filter_map(Value::as_object_mut) {
        row.remove("small");
    }
    let camera = session.camera();
    let next_view = session.next_view().map(|v| {
        json!({ "direction": v.direction, "tilt_deg": v.tilt_deg, "azimuth_deg": v.azimuth_deg })
    });
    json!({
        "frames": rows,
        "camera": camera,
        "elevation": session.elevation().map(|e| json!({ "mm": e.mm, "sigma_mm": e.sigma_mm })),
        "flash": camera.map(|_| json!({ "offset_mm": session.flash_offset_mm().to_array() })),
        "next_view": next_view,
        "ambient_fraction": session.ambient_fraction(),
        "deviations": session.snapshot_with_uncertainty().ok().map(|a| a.uncertainty.of_maps()),
        "resolution": session.settings().resolution,
        "method": "deep",
        "seconds_total": time.as_secs_f64(),
    })
}
