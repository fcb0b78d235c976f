//! Command line of svbrdf. Exit status: 0 done, 2 the input is at fault, 130 interrupted, 1 anything
//! else.

mod board;
mod board_text;
mod calibrate;
mod compare;
mod export;
mod failure;
mod fit;
mod interrupt;
mod pictures;
mod place;
mod progress;
mod render;
mod report;
mod simulate;
mod terminal;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "svbrdf", version, about = "Material maps from a few flash photographs")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Fit(fit::Arguments),
    Render(render::Arguments),
    Export(export::Arguments),
    Board(board::Arguments),
    Calibrate(calibrate::Arguments),
    Simulate(simulate::Arguments),
    Compare(compare::Arguments),
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Board(arguments) => board::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            terminal::say(&failure);
            ExitCode::from(failure.status())
        }
    }
}
