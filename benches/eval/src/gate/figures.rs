//! Figures of a build and their comparison with another build's.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};
use svbrdf::{Error, Result};

use crate::artifacts::Artifacts;
use crate::statistics::mean;

/// Value of `format`.
const FORMAT: &str = "svbrdf-gate/1";
/// Largest ratio of a group's geometric mean to the baseline's.
const ERROR_LIMIT: f64 = 1.01;
/// The same for time and for artifacts.
const TIME_LIMIT: f64 = 1.05;
const ARTIFACT_LIMIT: f64 = 1.05;
/// Growth of an artifact's mean that always passes: degrees, degrees, log F0, roughness.
const ARTIFACT_GROWTH: [f64; 4] = [0.05, 0.1, 0.003, 0.001];

/// Errors by group and case, times by group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    format: String,
    /// Threads of the fit.
    pub threads: usize,
    pub errors: BTreeMap<String, BTreeMap<String, f64>>,
    /// By group and case, where the maps show one sample.
    #[serde(default)]
    pub artifacts: BTreeMap<String, BTreeMap<String, Artifacts>>,
    /// Processor time per photograph, seconds.
    pub seconds: BTreeMap<String, f64>,
}

/// Result of a comparison.
pub struct Verdict {
    /// Markdown.
    pub table: String,
    /// Errors and artifacts that grew too much, and missing cases.
    pub worse: Vec<String>,
    /// Times that grew too much.
    pub slower: Vec<String>,
}

impl Figures {
    /// No figures.
    pub fn new(threads: usize) -> Self {
        Self {
            format: FORMAT.to_owned(),
            threads,
            errors: BTreeMap::new(),
            artifacts: BTreeMap::new(),
            seconds: BTreeMap::new(),
        }
    }

    /// Adds an error.
    pub fn add(&mut self, group: &str, case: String, error: f64) {
        self.errors.entry(group.to_owned()).or_default().insert(case, error);
    }

    /// Adds an error and the artifacts of the same maps.
    pub fn add_maps(&mut self, group: &str, case: String, error: f64, artifacts: Artifacts) {
        self.artifacts.entry(group.to_owned()).or_default().insert(case.clone(), artifacts);
        self.add(group, case, error);
    }

    /// Reads the output of [`Figures::to_json`].
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Field`] for other data.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        let fault = |field: &str, message: String| Error::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            message,
            expected: format!("figures of `svbrdf-eval gate --write`, format {FORMAT}"),
        };
        let figures: Self =
            serde_json::from_slice(&bytes).map_err(|e| fault("(file)", e.to_string()))?;
        if figures.format != FORMAT {
            return Err(fault("format", format!("found {}", figures.format)));
        }
        Ok(figures)
    }

    /// Format of [`Figures::read`].
    pub fn to_json(&self) -> String {
        let json = serde_json::to_string_pretty(self).expect("maps with text keys are JSON");
        format!("{json}\n")
    }

    /// Compares the measured groups with the figures of an earlier build, if given.
    pub fn compare(&self, baseline: Option<&Self>, groups: &[String]) -> Verdict {
        let mut verdict = Verdict { table: String::new(), worse: Vec::new(), slower: Vec::new() };
        let table = &mut verdict.table;
        table.push_str("| group | case | now | baseline | ratio |\n|---|---|---|---|---|\n");
        for (group, cases) in &self.errors {
            let before = baseline.and_then(|b| b.errors.get(group));
            let mut logs = Vec::new();
            for (case, &now) in cases {
                let old = before.and_then(|cases| cases.get(case)).copied();
                row(table, group, case, now, old);
                logs.push((now.ln(), old.map(f64::ln)));
            }
            let now = mean(logs.iter().map(|(now, _)| *now)).exp();
            let old = baseline.map(|_| mean(logs.iter().filter_map(|(_, old)| *old)).exp());
            row(table, group, "**geometric mean**", now, old);
            let ratio = mean(logs.iter().filter_map(|(now, old)| Some(now - (*old)?))).exp();
            if ratio > ERROR_LIMIT {
                verdict.worse.push(format!("{group}: errors {ratio:.3} times the baseline's"));
            }
        }
        for (group, &now) in &self.seconds {
            let old = baseline.and_then(|b| b.seconds.get(group)).copied();
            row(table, group, "processor seconds per photograph", now, old);
            if let Some(ratio) = old.map(|old| now / old).filter(|ratio| *ratio > TIME_LIMIT) {
                verdict.slower.push(format!("{group}: time {ratio:.3} times the baseline's"));
            }
        }
        if let Some(baseline) = baseline {
            verdict.worse.extend(self.gone(baseline, groups));
            verdict.worse.extend(self.more_artifacts(baseline));
            if baseline.threads != self.threads {
                let (now, old) = (self.threads, baseline.threads);
                verdict.slower.push(format!("{now} threads cannot be compared with {old}"));
            }
        }
        verdict
    }

    /// Groups whose mean artifacts grew.
    fn more_artifacts(&self, baseline: &Self) -> Vec<String> {
        let mut more = Vec::new();
        for (group, cases) in &self.artifacts {
            let Some(before) = baseline.artifacts.get(group) else { continue };
            let both = || cases.iter().filter_map(|(case, now)| Some((*now, *before.get(case)?)));
            let now = Artifacts::mean(both().map(|(now, _)| now)).numbers();
            let old = Artifacts::mean(both().map(|(_, old)| old)).numbers();
            for (i, name) in Artifacts::NAMES.iter().enumerate() {
                if now[i] > (ARTIFACT_LIMIT * old[i]).max(old[i] + ARTIFACT_GROWTH[i]) {
                    more.push(format!("{group}: {name} {:.3}, {:.3} before", now[i], old[i]));
                }
            }
        }
        more
    }

    /// Cases of the baseline that are missing here or not finite.
    fn gone(&self, baseline: &Self, groups: &[String]) -> Vec<String> {
        let mut gone = Vec::new();
        for (group, cases) in baseline.errors.iter().filter(|(g, _)| asked(g, groups)) {
            for case in cases.keys() {
                match self.errors.get(group).and_then(|cases| cases.get(case)) {
                    Some(error) if error.is_finite() => {}
                    Some(error) => gone.push(format!("{group}, {case}: {error}")),
                    None => gone.push(format!("{group}, {case}: not reached")),
                }
            }
        }
        gone
    }
}

/// Whether a group, or its main group (`fresh` of `fresh, boards`), is selected.
fn asked(group: &str, groups: &[String]) -> bool {
    groups.iter().any(|asked| group.split(',').next() == Some(asked))
}

fn row(table: &mut String, group: &str, case: &str, now: f64, old: Option<f64>) {
    let old = old.map_or_else(|| " | ".to_owned(), |old| format!("{old:.4} | {:.3}", now / old));
    // writing to a string cannot fail
    let _ = writeln!(table, "| {group} | {case} | {now:.4} | {old} |");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(errors: &[(&str, &str, f64)], seconds: f64) -> Figures {
        let mut figures = Figures::new(2);
        for (group, case, error) in errors {
            figures.add(group, (*case).to_owned(), *error);
        }
        figures.seconds.insert("captures".to_owned(), seconds);
        figures
    }

    fn groups() -> Vec<String> {
        vec!["captures".to_owned(), "real".to_owned()]
    }

    fn baseline() -> Figures {
        figures(&[("captures", "a", 0.02), ("captures", "b", 0.2), ("real", "c", 0.05)], 1.0)
    }

    #[test]
    fn figures_are_read_as_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("gate.json");
        std::fs::write(&path, baseline().to_json()).unwrap();
        assert_eq!(Figures::read(&path).unwrap(), baseline());
        std::fs::write(&path, baseline().to_json().replace("gate/1", "gate/7")).unwrap();
        let message = Figures::read(&path).unwrap_err().to_string();
        assert!(message.contains("field `format`: found svbrdf-gate/7"), "{message}");
    }

    /// The geometric mean weighs all cases equally: +4 % and -4 % of errors ten times apart cancel.
    #[test]
    fn a_group_is_worse_by_its_geometric_mean() {
        for (a, b, fails) in [(1.04, 0.965, false), (1.02, 1.009, true), (0.5, 1.9, false)] {
            let now = figures(
                &[("captures", "a", 0.02 * a), ("captures", "b", 0.2 * b), ("real", "c", 0.05)],
                1.04,
            );
            let verdict = now.compare(Some(&baseline()), &groups());
            assert_eq!(!verdict.worse.is_empty(), fails, "{:?}", verdict.worse);
            assert!(verdict.slower.is_empty());
        }
    }

    /// Tilt and highlights fail if their mean grew beyond the limits.
    #[test]
    fn more_artifacts_fail() {
        let with = |tilt: f64, baked_f0: f64| {
            let mut figures = baseline();
            for case in ["a", "b"] {
                let artifacts = Artifacts { tilt, baked_f0, ..Artifacts::default() };
                figures.add_maps("captures", case.to_owned(), 0.1, artifacts);
            }
            figures
        };
        let old = with(2.0, 0.01);
        let worse = |now: Figures| now.compare(Some(&old), &groups()).worse;
        assert!(worse(with(2.09, 0.0125)).is_empty());
        assert_eq!(worse(with(2.2, 0.01)), ["captures: tilt 2.200, 2.000 before"]);
        assert_eq!(worse(with(1.0, 0.02)), ["captures: baked log F0 0.020, 0.010 before"]);
    }

    #[test]
    fn parts_of_a_group_belong_to_it() {
        assert!(asked("fresh, boards", &["real".to_owned(), "fresh".to_owned()]));
        assert!(asked("real", &groups()) && !asked("fresh, boards", &groups()));
    }

    #[test]
    fn more_time_fails() {
        let mut now = baseline();
        now.seconds.insert("captures".to_owned(), 1.06);
        let verdict = now.compare(Some(&baseline()), &groups());
        assert!(verdict.worse.is_empty() && verdict.slower.len() == 1, "{:?}", verdict.slower);
    }

    /// Newly rejected photographs and NaN errors fail.
    #[test]
    fn lost_cases_fail() {
        let now = figures(&[("captures", "a", 0.01), ("captures", "b", f64::NAN)], 1.0);
        let verdict = now.compare(Some(&baseline()), &groups());
        assert_eq!(verdict.worse, ["captures, b: NaN", "real, c: not reached"]);
        // an unselected group may be absent
        let now = figures(&[("captures", "a", 0.01), ("captures", "b", 0.1)], 1.0);
        assert!(now.compare(Some(&baseline()), &groups()[..1]).worse.is_empty());
    }
}
