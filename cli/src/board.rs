//! `svbrdf board`: the target at true scale.

use std::path::PathBuf;

use serde_json::{Value, json};
use svbrdf::Error;
use svbrdf::board_sheet::{BoardSheet, Paper, SheetFormat};
use svbrdf::calibration::{Target, TargetKind, TopLeft};
use svbrdf::capture::LEAST_SQUARE_MM;
use svbrdf::export::write_atomic;

use crate::board_text::targets;
use crate::failure::{Failure, Result};
use crate::place;
use crate::terminal;

/// Write the board to print at 100 %
#[derive(clap::Args)]
#[command(after_help = "Boards:
  ring[:ROWSxCOLS:SQUARE_MM[:R0,C0,R1,C1]]    ring of squares round a hole, squares; the
                                              missing block half open (default: ring three wide)
  charuco-ring:ROWSxCOLS:SQUARE_MM[:R0,C0,R1,C1[:MARKER_MM[:DICTIONARY]]]

Prints what capture.json says under `board`.

Examples:
  svbrdf board --out board.pdf
  svbrdf board --out board.pdf --paper letter --board charuco-ring:17x16:11.5")]
pub struct Arguments {
    /// File to write: .svg, .png (600 dpi) or .pdf
    #[arg(long)]
    out: PathBuf,
    /// Paper
    #[arg(long, default_value = "a4", value_parser = ["a4", "letter"])]
    paper: String,
    /// Layout of the board, see below
    #[arg(long, default_value = "ring")]
    board: String,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let target = target(&arguments.board)?;
    place::file("--out", &arguments.out)?;
    let paper = if arguments.paper == "letter" { Paper::Letter } else { Paper::A4 };
    let sheet = BoardSheet::new(&target, paper).map_err(|error| match error {
        Error::Argument { message, .. } => fault(&arguments.board, &message),
        other => other.into(),
    })?;
    let extension = arguments.out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let format = match extension.to_ascii_lowercase().as_str() {
        "svg" => SheetFormat::Svg,
        "pdf" => SheetFormat::Pdf,
        "png" => SheetFormat::Png,
        _ => {
            let out = arguments.out.display();
            let message = format!("--out {out}: a name ending in .svg, .png or .pdf expected");
            return Err(Failure::Input(message));
        }
    };
    let bytes = sheet.encode(format)?;
    write_atomic(&arguments.out, &bytes)?;
    terminal::print(&format!("{}\n", json!({ "board": description(&target) })))
}

fn fault(board: &str, message: &str) -> Failure {
    Failure::Input(format!("--board {board}: {message}"))
}

/// The board to print: top left black, patches below.
pub fn target(text: &str) -> Result<Target> {
    let target = targets(text)?.swap_remove(0);
    if target.hole.row_start == target.hole.row_end {
        return Err(fault(text, "it has no hole for the sample; expected ring or charuco-ring"));
    }
    if target.square_mm < LEAST_SQUARE_MM {
        let mm = target.square_mm;
        return Err(fault(text, &format!("squares of {mm} mm: lengths are in mm, not in metres")));
    }
    if let Some((field, expected)) = target.print_fault() {
        return Err(fault(text, &format!("{field}: {expected} expected")));
    }
    Ok(Target { top_left: TopLeft::Black, patches: true, ..target })
}

/// The `board` object of `capture.json`.
pub fn description(target: &Target) -> Value {
    let hole = &target.hole;
    let mut board = json!({
        "kind": "checkerboard-ring",
        "rows": target.rows,
        "cols": target.cols,
        "square_mm": target.square_mm,
        "hole_squares": [hole.row_start, hole.col_start, hole.row_end, hole.col_end],
        "white_albedo": target.white_albedo,
        "black_albedo": target.black_albedo,
        "top_left": "black",
        "patches": true,
    });
    if let TargetKind::CharucoRing { dictionary, marker_mm } = &target.kind {
        board["kind"] = "charuco-ring".into();
        board["dictionary"] = dictionary.as_str().into();
        board["marker_mm"] = (*marker_mm).into();
    }
    board
}
