//! Means over orders and photographs, as Markdown and JSON.

use std::collections::BTreeMap;

use serde_json::json;

use super::orders::Part;
use super::score::{HIGHLIGHT_DEGREES, Score, Squares};
use crate::artifacts::Artifacts;
use crate::statistics::mean;
use crate::streaming::Variant;

/// Error of one predicted photograph.
pub struct Record {
    pub capture: String,
    pub variant: Variant,
    pub part: Part,
    /// Photographs fitted.
    pub fitted: usize,
    /// Index of the order.
    pub order: usize,
    /// Name of the predicted photograph.
    pub photograph: String,
    pub score: Score,
    /// Of the maps used for the prediction.
    pub artifacts: Artifacts,
}

impl Part {
    /// For a table.
    fn label(self, fitted: usize) -> String {
        match self {
            Self::FirstAlone => "1 → others".to_owned(),
            Self::Orders => fitted.to_string(),
        }
    }

    /// For a file name.
    pub fn short(self) -> &'static str {
        match self {
            Self::FirstAlone => "first",
            Self::Orders => "n",
        }
    }
}

type Row<'a> = ((Part, usize), Vec<&'a Record>);

fn rows(records: &[Record]) -> Vec<Row<'_>> {
    let mut rows: BTreeMap<(Part, usize), Vec<&Record>> = BTreeMap::new();
    for record in records {
        rows.entry((record.part, record.fitted)).or_default().push(record);
    }
    rows.into_iter().collect()
}

/// Mean error and artifacts per row of a capture's table: `N=1 → others`, `N=2`.
pub fn means(records: &[Record]) -> Vec<(String, f64, Artifacts)> {
    let row = |((part, fitted), records): Row<'_>| {
        let error = mean(records.iter().map(|r| r.score.rms()));
        let artifacts = Artifacts::mean(records.iter().map(|r| r.artifacts));
        (format!("N={}", part.label(fitted)), error, artifacts)
    };
    rows(records).into_iter().map(row).collect()
}

/// Prints the table of one capture.
pub fn print(records: &[Record]) {
    let Some(first) = records.first() else { return };
    let mut orders: Vec<usize> = records.iter().map(|r| r.order).collect();
    orders.dedup();
    println!("\n{}, {}, {} courses\n", first.capture, first.variant.name(), orders.len());
    let near = format!("below {HIGHLIGHT_DEGREES}°");
    println!(
        "| N | error | {near} | elsewhere | squared error {near} | area {near} | tilt | of parts | baked log F0 | baked roughness |"
    );
    println!("|{}", "---|".repeat(10));
    for ((part, fitted), records) in rows(records) {
        let total = |part: fn(&Score) -> Squares| {
            records.iter().fold(Squares::default(), |sum, r| sum.plus(part(&r.score)))
        };
        let artifacts = Artifacts::mean(records.iter().map(|r| r.artifacts));
        let [tilt, of_parts, f0, roughness] = artifacts.numbers();
        let (near, far) = (total(|s| s.highlight), total(|s| s.elsewhere));
        let all = near.plus(far);
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        println!(
            "| {} | {:.4} | {:.4} | {:.4} | {} | {} | {tilt:.2}° | {of_parts:.2}° | {f0:.3} | {roughness:.3} |",
            part.label(fitted),
            mean(records.iter().map(|r| r.score.rms())),
            near.rms(),
            far.rms(),
            percent(near.sum / all.sum.max(f64::MIN_POSITIVE)),
            percent(near.count as f64 / all.count.max(1) as f64),
        );
    }
}

/// Prints the errors of all captures and their mean.
pub fn print_summary(records: &[Record]) {
    let columns: Vec<(Part, usize)> = rows(records).into_iter().map(|(key, _)| key).collect();
    let mut captures: Vec<&str> = records.iter().map(|r| r.capture.as_str()).collect();
    captures.dedup();
    let label = |(part, fitted): &(Part, usize)| part.label(*fitted);
    println!("\n| | {} |", columns.iter().map(label).collect::<Vec<_>>().join(" | "));
    println!("|---{}|", "|---".repeat(columns.len()));
    let mut found: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    for capture in captures {
        print!("| {capture} |");
        for (column, found) in columns.iter().zip(&mut found) {
            let of_capture = records
                .iter()
                .filter(|r| r.capture == capture && (r.part, r.fitted) == *column)
                .map(|r| r.score.rms());
            if of_capture.clone().next().is_none() {
                print!(" |");
            } else {
                let error = mean(of_capture);
                print!(" {error:.4} |");
                found.push(error);
            }
        }
        println!();
    }
    let means: Vec<String> =
        found.iter().map(|errors| format!("{:.4}", mean(errors.iter().copied()))).collect();
    println!("| mean | {} |", means.join(" | "));
}

/// Every record.
pub fn json(records: &[Record]) -> String {
    let rows: Vec<_> = records
        .iter()
        .map(|r| {
            json!({
                "capture": r.capture,
                "method": r.variant.name(),
                "protocol": match r.part { Part::FirstAlone => "first-alone", Part::Orders => "orders" },
                "fitted": r.fitted,
                "order": r.order,
                "photograph": r.photograph,
                "error": r.score.rms(),
                "brightness_factor": r.score.factor,
                "error_in_highlight": r.score.highlight.rms(),
                "error_elsewhere": r.score.elsewhere.rms(),
                "highlight_area": r.score.highlight.count as f64
                    / r.score.highlight.plus(r.score.elsewhere).count.max(1) as f64,
                "artifacts": r.artifacts,
            })
        })
        .collect();
    format!("{:#}\n", json!({ "format": "svbrdf-heldout/1", "photographs": rows }))
}
