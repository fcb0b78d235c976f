//! Printed rectangles.

/// A filled rectangle on the page: left, top, width, height in mm from the top left; gray 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect(pub f64, pub f64, pub f64, pub f64, pub f64);

/// Rectangles on paper; later ones cover earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Page {
    /// Width and height, mm.
    pub size_mm: [f64; 2],
    pub rects: Vec<Rect>,
}
