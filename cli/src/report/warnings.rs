//! Possible faults of a capture or its maps, in words.

use std::path::Path;

use serde_json::{Value, json};
use svbrdf::svbrdf::MIN_ROUGHNESS;

use super::outline;
use super::subject::Subject;

/// Fewer photographs leave much to the network's experience.
const FEW_PHOTOGRAPHS: usize = 3;
/// All views nearer to the top than this show a highlight in one place only, degrees.
const NARROW_DEG: f64 = 12.0;
/// Room light as a share of the flash's from which it is worth a word.
const AMBIENT: f64 = 0.05;
/// Reprojection error from which board or camera are in doubt, px.
const REPROJECTION_PX: f64 = 1.0;
/// Standard deviation of an estimated focal length that is worth a word, relative.
const FOCAL_SIGMA: f64 = 0.01;
/// Rise of the error on photographs held out that is no noise, relative.
const WORSE: f64 = 1.05;
/// Files that are named at most.
const SHOWN: usize = 6;
/// Share of texels at the end of a map's range that is worth a word.
const AT_LIMIT: f32 = 0.05;

/// All that applies, the gravest first: each a title and a sentence.
pub fn warnings(subject: &Subject) -> Vec<Value> {
    let rows: Vec<&Value> = subject.report["frames"].as_array().into_iter().flatten().collect();
    let found = [
        interrupted(subject),
        rejected(&rows),
        left_out(subject),
        remarks(subject),
        few(&rows),
        views(subject, &rows),
        hints(&rows, "not_linear", "Tone-mapped photographs"),
        hints(&rows, "nothing_new", "Repeated views"),
        geometry(subject, &rows),
        ambient(subject),
        held_out(subject),
        limits(subject),
    ];
    let found = found.into_iter().flatten();
    found.map(|(title, text)| json!({ "title": title, "text": text })).collect()
}

type Warning = Option<(String, String)>;

fn interrupted(subject: &Subject) -> Warning {
    (subject.report["interrupted"] == true).then(|| {
        let text = "The fit was interrupted. These are the maps of that moment. Run the command again to \
                    complete them.";
        ("Interrupted".into(), text.into())
    })
}

fn is_fitted(row: &Value) -> bool {
    row["status"] == "accepted" && row["held_out"] != true
}

/// "photo 3", "photos 1, 4 and 5".
fn photos(rows: &[&Value]) -> String {
    let numbers: Vec<String> =
        rows.iter().map(|r| (r["index"].as_u64().unwrap_or(0) + 1).to_string()).collect();
    match numbers.as_slice() {
        [one] => format!("photo {one}"),
        [first @ .., last] => format!("photos {} and {last}", first.join(", ")),
        [] => String::new(),
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |c| c.to_uppercase().chain(letters).collect())
}

fn rejected(rows: &[&Value]) -> Warning {
    let out: Vec<&Value> = rows.iter().filter(|r| r["status"] == "rejected").copied().collect();
    let first = out.first()?;
    let reason = first["hint"].as_str().unwrap_or_default();
    let rest = if out.len() > 1 { " The others are explained below." } else { "" };
    let which = photos(&out);
    let verb = if out.len() == 1 { "was" } else { "were" };
    let number = first["index"].as_u64().unwrap_or(0) + 1;
    let title = format!("{} of {} photographs rejected", out.len(), rows.len());
    Some((
        title,
        format!("{} {verb} left out. Photo {number}: {reason}.{rest}", capitalised(&which)),
    ))
}

fn left_out(subject: &Subject) -> Warning {
    let out = subject.report["photographs"]["left_out"].as_array()?;
    let text = |v: &Value, key: &str| v[key].as_str().unwrap_or_default().to_owned();
    let each: Vec<String> = out
        .iter()
        .take(SHOWN)
        .map(|photo| {
            let image = text(photo, "image");
            let name = Path::new(&image).file_name().unwrap_or_default().to_string_lossy();
            format!("{name}: {}.", text(photo, "reason"))
        })
        .collect();
    let rest = if out.len() > SHOWN { " More are in report.json." } else { "" };
    let title = format!("Left out: {}", out.len());
    (!out.is_empty()).then(|| (title, format!("{}{rest}", each.join(" "))))
}

fn remarks(subject: &Subject) -> Warning {
    let remarks = subject.report["photographs"]["remarks"].as_array()?;
    let each: Vec<String> = remarks
        .iter()
        .take(SHOWN)
        .map(|remark| format!("{}.", remark.as_str().unwrap_or_default()))
        .collect();
    (!each.is_empty()).then(|| ("What the files say".into(), each.join(" ")))
}

fn few(rows: &[&Value]) -> Warning {
    let fitted = rows.iter().filter(|r| is_fitted(r)).count();
    (fitted < FEW_PHOTOGRAPHS).then(|| {
        let photographs = if fitted == 1 { "One photograph" } else { "Two photographs" };
        let text = format!(
            "{photographs} cannot distinguish gloss from colour, or relief from shading, everywhere. \
             Much is what the network expects of such materials. Take at least three, better eight."
        );
        ("Few photographs".into(), text)
    })
}

fn views(subject: &Subject, rows: &[&Value]) -> Warning {
    let fitted: Vec<&&Value> = rows.iter().filter(|r| is_fitted(r)).collect();
    let tilt = |r: &&&Value| outline::view(subject, r)?["off_top_deg"].as_f64();
    let steepest = fitted.iter().filter_map(tilt).fold(0.0, f64::max);
    (fitted.len() >= FEW_PHOTOGRAPHS && steepest < NARROW_DEG).then(|| {
        let text = format!(
            "All photographs were taken within {steepest:.0}° of the vertical, so the highlight swept \
             over little of the sample. Walk round it, 10° to 45° off the vertical."
        );
        ("Similar views".into(), text)
    })
}

fn hints(rows: &[&Value], code: &str, title: &str) -> Warning {
    let hint = |row: &Value| {
        let hints = row["hints"].as_array()?;
        let hint = hints.iter().find(|h| h["code"] == code)?;
        hint["hint"].as_str().map(str::to_owned)
    };
    let told: Vec<&Value> = rows.iter().filter(|r| hint(r).is_some()).copied().collect();
    // The last one knows most of the capture.
    let said = hint(told.last()?)?;
    Some((title.into(), format!("{}: {said}.", capitalised(&photos(&told)))))
}

fn geometry(subject: &Subject, rows: &[&Value]) -> Warning {
    let off: Vec<&Value> = rows
        .iter()
        .filter(|r| r["reprojection_rms_px"].as_f64().is_some_and(|v| v > REPROJECTION_PX))
        .copied()
        .collect();
    if !off.is_empty() {
        let text = format!(
            "In {}, the board's corners lie more than {REPROJECTION_PX} px from where the camera \
             should see them. Is the board flat? Is the calibration of the camera right?",
            photos(&off)
        );
        return Some(("The board does not fit".into(), text));
    }
    let sigma = subject.report["camera_uncertainty"]["fx"].as_f64()?;
    let focal = subject.report["camera"]["fx"].as_f64()?;
    (sigma > FOCAL_SIGMA * focal).then(|| {
        let text = format!(
            "The focal length is known only to {:.1} %. Take more photographs from the side, or use \
             `svbrdf calibrate`.",
            100.0 * sigma / focal
        );
        ("Uncertain camera".into(), text)
    })
}

fn ambient(subject: &Subject) -> Warning {
    let share = subject.report["ambient_fraction"].as_f64()?;
    (share > AMBIENT).then(|| {
        let text = format!(
            "The room light was {:.0} % of the flash. It is accounted for, but a darker room gives \
             better maps of smooth materials.",
            100.0 * share
        );
        ("Bright room".into(), text)
    })
}

fn held_out(subject: &Subject) -> Warning {
    let after = subject.report["held_out"]["after"].as_array()?;
    let error = |v: &Value| v["error"].as_f64();
    let last = error(after.last()?)?;
    let best = after.iter().filter_map(|a| Some((error(a)?, a["fitted"].as_u64()?)));
    let best = best.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (last > WORSE * best.0).then(|| {
        let text = format!(
            "The photographs held out are predicted best after photograph {} (error {:.4}) and worse \
             at the end ({last:.4}). Did exposure, focus or light change between photographs?",
            best.1, best.0
        );
        ("More photographs made it worse".into(), text)
    })
}

fn limits(subject: &Subject) -> Warning {
    let roughness = subject.maps.roughness();
    let low = roughness.iter().filter(|v| **v <= 1.01 * MIN_ROUGHNESS).count();
    let share = low as f32 / roughness.len() as f32;
    (share > AT_LIMIT).then(|| {
        let text = format!(
            "{:.0} % of the sample has the smallest possible roughness, like a mirror. A point light \
             cannot measure its gloss.",
            100.0 * share
        );
        ("Mirror-like".into(), text)
    })
}
