//! Unknown fields of a description, mostly misspelt ones.

use std::path::Path;

use serde_json::Value;

/// Known fields by object.
const KNOWN: [(&str, &[&str]); 6] = [
    (
        "",
        &[
            "format",
            "sample",
            "board",
            "camera",
            "flash",
            "frames",
            "rectified",
            "falloff",
            "light_power",
        ],
    ),
    ("sample", &["width_mm", "height_mm", "elevation_mm"]),
    (
        "board",
        &[
            "kind",
            "rows",
            "cols",
            "square_mm",
            "hole_squares",
            "white_albedo",
            "black_albedo",
            "top_left",
            "dictionary",
            "marker_mm",
            "patches",
        ],
    ),
    // With the additional fields of `svbrdf calibrate`.
    (
        "camera",
        &[
            "width",
            "height",
            "fx",
            "fy",
            "cx",
            "cy",
            "distortion",
            "rms_px",
            "images",
            "sigma",
            "paper",
        ],
    ),
    ("flash", &["offset_mm"]),
    (
        "frames",
        &[
            "image",
            "encoding",
            "exposure",
            "ambient",
            "ambient_exposure",
            "camera_mm",
            "light_mm",
            "turn",
        ],
    ),
];
/// Prefixes of names for comments.
const REMARKS: [&str; 5] = ["_", "$", "comment", "note", "name"];
/// Most fields reported.
const MOST: usize = 10;
/// Largest number of wrong letters in a misspelt name.
const MISSPELT: usize = 2;

/// A warning for each unknown field of a description.
pub(super) fn warnings(file: &Path, root: &Value) -> Vec<String> {
    let mut found = Vec::new();
    for (object, known) in KNOWN {
        match (object, root.get(object)) {
            ("", _) => look(root, "", known, &mut found),
            (_, Some(Value::Array(items))) => {
                for (i, item) in items.iter().enumerate() {
                    look(item, &format!("{object}[{i}]."), known, &mut found);
                }
            }
            (_, Some(value)) => look(value, &format!("{object}."), known, &mut found),
            (_, None) => (),
        }
    }
    let more = found.len().saturating_sub(MOST);
    found.truncate(MOST);
    let mut said: Vec<String> = found
        .into_iter()
        .map(|(path, guess)| {
            let guess = guess.map_or(String::new(), |name| format!(" (is `{name}` meant?)"));
            format!("{}: field `{path}` is not known{guess}; it is ignored", file.display())
        })
        .collect();
    if more > 0 {
        said.push(format!("{}: {more} more fields are not known", file.display()));
    }
    said
}

/// Unknown fields of an object with their paths and likely meanings.
fn look(
    value: &Value,
    path: &str,
    known: &[&'static str],
    found: &mut Vec<(String, Option<&'static str>)>,
) {
    let Value::Object(fields) = value else { return };
    for name in fields.keys() {
        let lower = name.to_ascii_lowercase();
        if known.contains(&name.as_str()) || REMARKS.iter().any(|r| lower.starts_with(r)) {
            continue;
        }
        let near = known.iter().map(|k| (distance(&lower, k), *k)).min();
        let guess = near.filter(|(d, k)| *d <= MISSPELT && *d < k.len()).map(|(_, k)| k);
        found.push((format!("{path}{name}"), guess));
    }
}

/// Edit distance of two words.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().take(64).enumerate() {
        let mut corner = i;
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let changed = corner + usize::from(letter != *other);
            corner = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn misspelt_fields_are_reported_with_suggestions() {
        let value = json!({
            "format": "svbrdf-capture/1", "comment": "mine", "Board": {},
            "sample": { "width_mm": 1, "heigth_mm": 1 },
            "frames": [{ "image": "a" }, { "image": "b", "exposre": 2.0, "weather": "fine" }],
        });
        let said = warnings(Path::new("x/capture.json"), &value);
        assert_eq!(
            said,
            [
                "x/capture.json: field `Board` is not known (is `board` meant?); it is ignored",
                "x/capture.json: field `sample.heigth_mm` is not known (is `height_mm` meant?); it is ignored",
                "x/capture.json: field `frames[1].exposre` is not known (is `exposure` meant?); it is ignored",
                "x/capture.json: field `frames[1].weather` is not known; it is ignored",
            ]
        );
        assert_eq!(distance("exposre", "exposure"), 1);
        assert_eq!(distance("", "abc"), 3);
        let many = json!({ "frames": (0..20).map(|_| json!({ "x": 1 })).collect::<Vec<_>>() });
        assert_eq!(warnings(Path::new("c"), &many).len(), MOST + 1);
    }
}
