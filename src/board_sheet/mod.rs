//! The board on paper at true scale: squares, markers, patches, a ruler and the board's name as
//! PDF, SVG or PNG.

mod layout;
mod lettering;
mod page;
mod writers;

use self::page::Page;
use crate::calibration::Target;
use crate::{Error, Result};

/// Paper to print on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paper {
    /// 210 x 297 mm.
    A4,
    /// 215.9 x 279.4 mm.
    Letter,
}

impl Paper {
    /// Width and height, mm.
    pub fn size_mm(self) -> [f64; 2] {
        match self {
            Self::A4 => [210.0, 297.0],
            Self::Letter => [215.9, 279.4],
        }
    }
}

/// Format of a sheet's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SheetFormat {
    /// PDF of one page that disables scaling in viewers.
    Pdf,
    /// SVG in mm.
    Svg,
    /// PNG, 8-bit gray, 600 px per inch (stated in its pHYs chunk).
    Png,
}

/// A board laid out on paper, for printing at 100 %.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSheet {
    page: Page,
}

impl BoardSheet {
    /// Lays out a board.
    ///
    /// # Errors
    /// [`Error::Argument`] if the board's description has a fault, a white square has no marker in
    /// its dictionary, or the board is too large for the paper.
    pub fn new(target: &Target, paper: Paper) -> Result<Self> {
        let fault = |message: String| Error::argument("board", message);
        if let Some((field, expected)) = target.print_fault() {
            return Err(fault(format!("{field}: {expected} expected")));
        }
        let page = layout::layout(target, paper.size_mm())
            .map_err(|expected| fault(format!("too large for the paper; expected {expected}")))?;
        Ok(Self { page })
    }

    /// Encodes the sheet.
    ///
    /// # Errors
    /// [`Error::Internal`] if a picture cannot be encoded.
    pub fn encode(&self, format: SheetFormat) -> Result<Vec<u8>> {
        match format {
            SheetFormat::Pdf => Ok(writers::pdf(&self.page).into_bytes()),
            SheetFormat::Svg => Ok(writers::svg(&self.page).into_bytes()),
            SheetFormat::Png => writers::png(&self.page),
        }
    }
}

#[cfg(test)]
mod tests;
