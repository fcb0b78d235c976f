//! Errors of held-out photographs without one part of the estimator after the other.

use std::path::PathBuf;

use serde_json::{Value, json};
use svbrdf::estimate::EstimateOptions;
use svbrdf::{Error, Result};

use crate::heldout::{self, Kept, Protocol, Record, SIDE};
use crate::statistics::{geometric_mean, mean};
use crate::streaming::{Setup, Variant, capture_folders};

/// Arguments of `svbrdf-eval ablations`.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub struct Arguments {
    /// Captures, or folders of captures
    #[arg(required = true)]
    captures: Vec<PathBuf>,
    /// Numbers of photographs to fit
    #[arg(long, value_delimiter = ',', default_value = "1,3,5,7")]
    fit: Vec<usize>,
    /// Orders of the photographs of rectified captures, at most
    #[arg(long, default_value_t = 4)]
    orders: usize,
}

const HELP: &str = "Photographs are held out as by `svbrdf-eval heldout`. The first row has the mean \
error over the captures, the others have the geometric mean over the captures of the error \
without a part relative to that with it: more than 1 where the part helps. A part is left out by \
an option of the estimator, `--set 'schedule.without=[\"relief\"]'`.";

/// Parts by name, and the options that leave them out: path and value.
fn ablations() -> [(&'static str, Vec<(&'static str, Value)>); 7] {
    let without = |parts: Value| vec![("/schedule/without", parts)];
    // The code keeps the first maps: its only step has no length.
    let latent = ["/latent/first_steps", "/latent/steps", "/latent/learning_rate"]
        .map(|path| (path, json!(0)));
    [
        ("latent", latent.to_vec()),
        ("relief", without(json!(["relief"]))),
        ("choice", without(json!(["choice"]))),
        ("lobes", without(json!(["lobes"]))),
        ("choice and joint", without(json!(["choice", "joint"]))),
        ("texels", without(json!(["texels"]))),
        ("all but latent", without(json!(["relief", "choice", "joint", "texels"]))),
    ]
}

/// Options with the values at some paths replaced.
fn changed(options: &EstimateOptions, changes: &[(&str, Value)]) -> Result<EstimateOptions> {
    let fault = |e: serde_json::Error| Error::Internal(format!("options of an ablation: {e}"));
    let mut all = serde_json::to_value(options).map_err(fault)?;
    for (path, value) in changes {
        if let Some(place) = all.pointer_mut(path) {
            *place = value.clone();
        }
    }
    serde_json::from_value(all).map_err(fault)
}

/// Errors by capture and number of photographs; `None` where a capture has too few.
type Errors = Vec<Vec<Option<f64>>>;

/// Runs the command.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let Arguments { captures, fit, orders } = arguments;
    let folders = capture_folders(captures)?;
    let protocol = Protocol { fit: fit.clone(), orders: *orders, gain: true };
    let errors = |options: EstimateOptions| -> Result<Errors> {
        let setup = Setup { options, resolution: SIDE, ..setup.clone() };
        let of = |folder| {
            let kept = Kept::default();
            let records = heldout::evaluate(folder, &protocol, Variant::Deep, &setup, kept)?;
            Ok(fit.iter().map(|fitted| error(&records, *fitted)).collect())
        };
        folders.iter().map(|folder| of(folder)).collect()
    };
    let all = errors(setup.options.clone())?;
    let numbers: Vec<String> = fit.iter().map(usize::to_string).collect();
    println!("| left out | {} |\n|---{}|", numbers.join(" | "), "|---".repeat(fit.len()));
    let column = |column: usize| all.iter().filter_map(move |errors| errors[column]);
    print_row("nothing: error", (0..fit.len()).map(|c| format!("{:.4}", mean(column(c)))));
    for (name, changes) in ablations() {
        let without = errors(changed(&setup.options, &changes)?)?;
        let ratio = |column: usize| {
            let pairs = without.iter().zip(&all);
            let ratios = pairs.filter_map(|(without, all)| Some(without[column]? / all[column]?));
            geometric_mean(ratios).map_or("-".to_owned(), |ratio| format!("{ratio:.3}"))
        };
        print_row(name, (0..fit.len()).map(ratio));
    }
    Ok(())
}

/// Mean error of the held-out photographs of a capture.
fn error(records: &[Record], fitted: usize) -> Option<f64> {
    let mut of = records.iter().filter(|record| record.fitted == fitted).peekable();
    of.peek()?;
    Some(mean(of.map(|record| record.score.rms())))
}

fn print_row(name: &str, cells: impl Iterator<Item = String>) {
    println!("| {name} | {} |", cells.collect::<Vec<_>>().join(" | "));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every ablation changes the options, and each in its own way.
    #[test]
    fn ablations_are_different_options() {
        let all = EstimateOptions::default();
        let mut seen = vec![all.clone()];
        for (name, changes) in ablations() {
            let options = changed(&all, &changes).unwrap();
            assert!(!seen.contains(&options), "{name}");
            seen.push(options);
        }
        assert!(changed(&all, &[("/schedule/without", json!(["typo"]))]).is_err());
    }
}
