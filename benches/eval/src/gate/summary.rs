//! Figures per group by number of photographs.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::figures::Figures;
use crate::artifacts::Artifacts;
use crate::statistics::{geometric_mean, median};

/// Largest acceptable artifacts of a flat sample.
const LIMITS: [f64; 4] = [1.0, 3.0, 0.06, 0.02];

/// Prefix of a case and its number of photographs; cases end with ` N=3` or ` N=1 → others`.
fn photographs(case: &str) -> Option<(&str, usize)> {
    let (name, number) = case.rsplit_once(" N=")?;
    let digits = number.split(' ').next()?;
    Some((name, digits.parse().ok()?))
}

/// A table: geometric means of errors and of their ratios to the baseline; median rise from the
/// previous number of photographs; means of the artifacts with the baseline's in parentheses; cases
/// beyond an artifact's limit.
pub fn table(figures: &Figures, baseline: Option<&Figures>) -> String {
    let heads = Artifacts::NAMES.join(" | ");
    let mut table = format!(
        "| group | N | cases | error | baseline | ratio | rise | {heads} | beyond limits |\n"
    );
    let _ = writeln!(table, "|{}", "---|".repeat(12));
    for (group, errors) in &figures.errors {
        let before = baseline.and_then(|b| b.errors.get(group));
        let mut numbers: BTreeMap<usize, Vec<(&str, &String, f64)>> = BTreeMap::new();
        for (case, &error) in errors {
            if let Some((name, n)) = photographs(case) {
                numbers.entry(n).or_default().push((name, case, error));
            }
        }
        let mut fewer: Option<&Vec<(&str, &String, f64)>> = None;
        for (n, cases) in &numbers {
            let old = |case: &String| before.and_then(|before| before.get(case)).copied();
            let error = geometric_mean(cases.iter().map(|(_, _, error)| *error));
            let baseline_error = geometric_mean(cases.iter().filter_map(|(_, case, _)| old(case)));
            let ratio =
                geometric_mean(cases.iter().filter_map(|(_, case, e)| Some(e / old(case)?)));
            let rise = median(cases.iter().filter_map(|(name, _, error)| {
                let (_, _, fewer) = fewer?.iter().find(|(other, _, _)| other == name)?;
                Some(error / fewer - 1.0)
            }));
            // writing to a string cannot fail
            let _ = writeln!(
                table,
                "| {group} | {n} | {} | {} | {} | {} | {} | {} |",
                cases.len(),
                shown(error, |v| format!("{v:.4}")),
                shown(baseline_error, |v| format!("{v:.4}")),
                shown(ratio, |v| format!("{v:.3}")),
                shown(rise, |v| format!("{:+.1} %", 100.0 * v)),
                artifacts(group, cases.iter().map(|(_, case, _)| *case), figures, baseline),
            );
            fewer = Some(cases);
        }
    }
    table
}

/// Cells of the artifacts of some cases.
fn artifacts<'a>(
    group: &str,
    cases: impl Iterator<Item = &'a String>,
    figures: &Figures,
    baseline: Option<&Figures>,
) -> String {
    let of = |figures: &Figures, case: &String| {
        figures.artifacts.get(group).and_then(|cases| cases.get(case)).copied()
    };
    let pairs: Vec<(Artifacts, Option<Artifacts>)> = cases
        .filter_map(|case| Some((of(figures, case)?, baseline.and_then(|b| of(b, case)))))
        .collect();
    if pairs.is_empty() {
        return " | | | | ".to_owned();
    }
    let now = Artifacts::mean(pairs.iter().map(|(now, _)| *now)).numbers();
    let known = pairs.iter().all(|(_, old)| old.is_some());
    let old = Artifacts::mean(pairs.iter().filter_map(|(_, old)| *old)).numbers();
    let cell = |i: usize| {
        let digits = if i < 2 { 2 } else { 3 };
        let old = if known { format!(" ({:.digits$})", old[i]) } else { String::new() };
        format!("{:.digits$}{old}", now[i])
    };
    let beyond = pairs
        .iter()
        .filter(|(now, _)| now.numbers().iter().zip(LIMITS).any(|(v, limit)| *v > limit))
        .count();
    format!("{} | {} | {} | {} | {beyond}", cell(0), cell(1), cell(2), cell(3))
}

fn shown(value: Option<f64>, text: impl Fn(f64) -> String) -> String {
    value.map_or_else(String::new, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(factor: f64) -> Figures {
        let mut figures = Figures::new(2);
        for (name, errors) in [("a", [0.04, 0.05]), ("b", [0.01, 0.008]), ("c", [0.02, 0.021])] {
            for (n, error) in [(3, errors[0]), (5, errors[1])] {
                let tilt = factor * if name == "a" { 2.0 } else { 0.5 };
                let artifacts = Artifacts { tilt, ..Artifacts::default() };
                figures.add_maps("faults", format!("{name} N={n}"), factor * error, artifacts);
            }
        }
        figures.add("photos", "one N=1".to_owned(), 0.1);
        figures
    }

    /// Errors of three cases, each a tenth below the baseline's; the median of rises of 25, -20 and
    /// 5 %; one of three tilts by more than a degree.
    #[test]
    fn rows_are_those_of_numbers_of_photographs() {
        let table = table(&figures(0.9), Some(&figures(1.0)));
        let row = table.lines().find(|line| line.starts_with("| faults | 5")).unwrap();
        // (.05 .008 .021)^(1/3) = .02033
        assert_eq!(
            row,
            "| faults | 5 | 3 | 0.0183 | 0.0203 | 0.900 | +5.0 % | 0.90 (1.00) | 0.00 (0.00) | \
             0.000 (0.000) | 0.000 (0.000) | 1 |"
        );
        assert!(table.contains("| faults | 3 | 3 | 0.0180 | 0.0200 | 0.900 |  | 0.90"), "{table}");
        assert!(table.contains("| photos | 1 | 1 | 0.1000 | 0.1000 | 1.000 |  |  | "), "{table}");
    }

    #[test]
    fn cases_tell_their_number() {
        assert_eq!(photographs("mg N=2 x N=1 → others"), Some(("mg N=2 x", 1)));
        assert_eq!(photographs("tile N=12"), Some(("tile", 12)));
        assert_eq!(photographs("tile"), None);
    }
}
