//! The board on paper.

use engine::board_sheet::{BoardSheet, Paper, SheetFormat};
use engine::calibration::Target;

use crate::buffer::{self, svbrdf_buffer};
use crate::options::svbrdf_board;
use crate::status::{Fault, entry, svbrdf_status};
use crate::values::unknown;
use crate::versioned;

/// Paper that a board is printed on.
pub type svbrdf_page = u32;
/// 210 x 297 mm.
pub const SVBRDF_PAGE_A4: svbrdf_page = 1;
/// 215.9 x 279.4 mm.
pub const SVBRDF_PAGE_LETTER: svbrdf_page = 2;

/// Format of a printed board.
pub type svbrdf_sheet_format = u32;
/// PDF of one page.
pub const SVBRDF_SHEET_PDF: svbrdf_sheet_format = 1;
/// SVG, in mm.
pub const SVBRDF_SHEET_SVG: svbrdf_sheet_format = 2;
/// PNG, 8-bit gray, 600 pixels per inch.
pub const SVBRDF_SHEET_PNG: svbrdf_sheet_format = 3;

/// The board as a page to print at 100 %, with a ruler and its name, in memory: the file that
/// `svbrdf board` writes. `board` NULL: the default one. SVBRDF_INVALID_ARGUMENT if the board is not
/// valid or too large for the page. Free with svbrdf_buffer_destroy().
///
/// # Safety
/// `board` is NULL or initialised by svbrdf_board_init(), its dictionary NULL or a C string; `out` is
/// NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_board_print(
    board: *const svbrdf_board,
    page: svbrdf_page,
    format: svbrdf_sheet_format,
    out: *mut *mut svbrdf_buffer,
) -> svbrdf_status {
    entry(|| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        let target = if board.is_null() {
            Target::default()
        } else {
            // SAFETY: not NULL, and the caller vouches for the rest.
            unsafe { versioned::read(board)?.target() }?
        };
        let paper = match page {
            SVBRDF_PAGE_A4 => Paper::A4,
            SVBRDF_PAGE_LETTER => Paper::Letter,
            other => return Err(unknown("page", other)),
        };
        let format = match format {
            SVBRDF_SHEET_PDF => SheetFormat::Pdf,
            SVBRDF_SHEET_SVG => SheetFormat::Svg,
            SVBRDF_SHEET_PNG => SheetFormat::Png,
            other => return Err(unknown("format", other)),
        };
        let file = buffer::hand_out(BoardSheet::new(&target, paper)?.encode(format)?);
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(file) };
        Ok(())
    })
}
