//! One photograph: read, matched with the others, added to the session.

use svbrdf::files::{Choice, Decoded, Limits, Metadata, Options, decode};
use svbrdf::photo::{Encoding, Rotation};
use svbrdf::session::{AcceptedPhoto, Outcome, Session};
use svbrdf::{Error, Result};

use serde_json::{Value, json};

use crate::pictures;

/// Most memory for decoding a picture, bytes: one of 48 megapixels takes a third of it.
const DECODING_BYTES: u64 = 1 << 30;

/// Adds a photograph to a session: a row of the report; `small` becomes a small picture of it.
///
/// # Errors
/// When the session has failed.
pub fn push(
    session: &Session,
    choice: Option<&mut Choice>,
    name: &str,
    bytes: &[u8],
    small: &mut Vec<u8>,
) -> Result<Value> {
    small.clear();
    let mut notes = Vec::new();
    let options = match choice.map(|choice| chosen(choice, name, bytes, &mut notes)) {
        Some(Err(reason)) => return Ok(rejected("other_camera", &reason)),
        Some(Ok(options)) => options,
        None => Options { exposure: Some(1.0), ..Options::default() },
    };
    let limits = Limits { memory_bytes: DECODING_BYTES, ..Limits::default() };
    let Decoded { photo, remarks, .. } = match decode(bytes, &Options { limits, ..options }) {
        Ok(decoded) => decoded,
        Err(fault) => return Ok(rejected("unreadable", &message(&fault))),
    };
    let (small_size, rgba) = pictures::small(&photo).unzip();
    *small = rgba.unwrap_or_default();
    let mut row = match session.add_photo(&photo) {
        Ok(Outcome::Accepted(accepted)) => self::accepted(&accepted),
        Ok(Outcome::Rejected(why)) => rejected(why.code(), &why.to_string()),
        Err(fault @ Error::MemoryLimit { .. }) => rejected("memory", &message(&fault)),
        Err(fault) => return Err(fault),
    };
    if let Some(hints) = row["hints"].as_array_mut() {
        hints.extend(remarks.iter().map(|r| json!({ "code": r.code(), "hint": r.to_string() })));
        hints.extend(notes.iter().map(|note| json!({ "code": "metadata", "hint": note })));
    }
    row["size"] = json!([photo.width(), photo.height()]);
    row["small"] = json!(small_size);
    Ok(row)
}

/// How a photograph is to be read to go with the earlier ones; why it does not.
fn chosen(
    choice: &mut Choice,
    name: &str,
    bytes: &[u8],
    notes: &mut Vec<String>,
) -> std::result::Result<Options, String> {
    let before = choice.chosen.len();
    choice.add(vec![(Metadata::of(bytes), name.into())]);
    notes.append(&mut choice.remarks);
    let Some(chosen) = choice.chosen.get(before) else {
        return Err(choice.left_out.last().map_or_else(String::new, |left| left.reason.clone()));
    };
    Ok(Options {
        encoding: chosen.is_linear.then_some(Encoding::Linear),
        exposure: Some(chosen.exposure),
        turn: Rotation::from_degrees(chosen.turn_deg).unwrap_or_default(),
        ..Options::default()
    })
}

/// A fault without the name of a file, which pages show beside it.
fn message(fault: &Error) -> String {
    match fault {
        Error::Image { message, .. } => message.clone(),
        other => other.to_string(),
    }
}

fn rejected(reason: &str, hint: &str) -> Value {
    json!({ "status": "rejected", "reason": reason, "hint": hint, "hints": [] })
}

fn accepted(accepted: &AcceptedPhoto) -> Value {
    let hints = accepted.hints.iter().map(|h| json!({ "code": h.code(), "hint": h.to_string() }));
    json!({
        "status": "accepted",
        "first_maps_seconds": accepted.maps_seconds,
        "reprojection_rms_px": accepted.pose.map(|board| board.reprojection_rms_px),
        "hints": hints.collect::<Vec<_>>(),
    })
}
