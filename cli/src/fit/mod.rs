//! `svbrdf fit`

mod arguments;
mod document;
mod held_out;
mod input;
mod output;
mod photographs;
mod verbose;
mod watch;

use std::time::Instant;

use serde_json::json;
use svbrdf::capture::Capture;
use svbrdf::export::LOBE_FILES;
use svbrdf::session::{Budget, Method, Session, Settings};

pub use self::arguments::Arguments;
use self::input::Input;
use self::output::Output;
use self::photographs::{Fit, Options};
use crate::failure::{Failure, Result};
use crate::interrupt::Interrupt;
use crate::place;
use crate::progress::Progress;

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    verbose::listen(arguments.verbose);
    let result = fit(arguments);
    let progress = Progress::new(arguments.quiet, arguments.log);
    let out = arguments.out.to_string_lossy();
    match &result {
        Ok(()) => progress.event("done", json!({ "status": 0, "out": out })),
        Err(failure) => progress.event(
            "failed",
            json!({ "status": failure.status(), "out": out, "message": failure.to_string() }),
        ),
    }
    result
}

fn fit(arguments: &Arguments) -> Result<()> {
    let begun = Instant::now();
    let mut progress = Progress::new(arguments.quiet, arguments.log);
    if arguments.verbose > 0 {
        progress = progress.without_bars();
    }
    place::folder("--out", &arguments.out)?;
    if arguments.skip_existing && output::is_complete(arguments) {
        progress.say(&format!("{} is complete: nothing to do", arguments.out.display()));
        progress.event("skipped", json!({ "out": arguments.out.to_string_lossy() }));
        return Ok(());
    }
    let interrupt = Interrupt::listen()?;
    let mut input = Input::open(arguments, &interrupt, &mut progress)?;
    input.tell(&mut progress);
    let session = session(arguments, &input.capture)?;
    let options = Options {
        at_once: arguments.at_once,
        hold_out: arguments.hold_out as usize,
        endless: arguments.watch,
        report: !arguments.no_report,
    };
    let mut photos = input.capture.photos.clone();
    photos.truncate(arguments.frames.map_or(photos.len(), |n| n as usize));
    let mut fit = Fit::new(options, photos, &session, &interrupt, progress);
    let output = Output { arguments, session: &session, begun };
    fit.run()?;
    if arguments.watch {
        watch::run(&mut input, &mut fit, &output, &interrupt)?;
    }
    check_fitted(arguments, &input, &fit, &interrupt)?;
    output.write(&input, &mut fit)?;
    let out = arguments.out.display();
    let first = if arguments.no_report { "preview.png" } else { "report.html" };
    let lobes = LOBE_FILES.iter().filter(|name| arguments.out.join(name).is_file());
    let lobes: String = lobes.map(|name| format!(", {name}")).collect();
    fit.progress.say(&format!(
        "Look at {out}/{first}; the maps are {out}/normal.png, diffuse.png, specular.png, roughness.png{lobes} (floats: maps.exr)."
    ));
    if interrupt.is_set() {
        let (fitted, all) = (fit.fitted(), fit.photos.len());
        return Err(Failure::Interrupted(format!(
            "{out} holds maps and report of what was there: {fitted} of {all} photos in the fit"
        )));
    }
    Ok(())
}

fn session(arguments: &Arguments, capture: &Capture) -> Result<Session> {
    let settings = Settings {
        sample_mm: capture.sample_mm,
        resolution: arguments.resolution.parse().expect("one of four numbers"),
        method: if arguments.method == "classic" { Method::Classic } else { Method::Deep },
        refine: !arguments.no_refine,
        threads: arguments.threads as usize,
        ..Settings::default()
    };
    let session = Session::new(capture.scene.clone(), settings)?;
    session.set_budget(Budget { steps: arguments.steps, ..Budget::default() })?;
    Ok(session)
}

/// Checks that the fit has a photograph.
fn check_fitted(
    arguments: &Arguments,
    input: &Input,
    fit: &Fit,
    interrupt: &Interrupt,
) -> Result<()> {
    if fit.fitted() > 0 {
        return Ok(());
    }
    if fit.interrupted() || interrupt.is_set() {
        return Err(Failure::Interrupted("no photo was in the fit yet; nothing is written".into()));
    }
    let waiting = fit.waiting();
    if waiting > 0 {
        return Err(Failure::Input(format!(
            "--hold-out {}: {waiting} photos can be used; expected at least one more than are held out",
            arguments.hold_out
        )));
    }
    let board = match (&input.photographs, &arguments.board) {
        (Some(_), None) => "; `ring` is looked for, --board names another board",
        _ => "",
    };
    Err(Failure::Input(format!(
        "{}: every photo was rejected; expected at least one that can be used{board}\n{}",
        input.origin,
        fit.lines().join("\n")
    )))
}
