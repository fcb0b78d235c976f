//! Phases of a fit.

use std::ffi::c_char;

use engine::session::Phase;

/// Phase of a fit. Values may be added; phases do not run in this order.
pub type svbrdf_phase = u32;
/// Nothing, or not begun.
pub const SVBRDF_PHASE_NONE: svbrdf_phase = 0;
/// Something that this version of the header does not know.
pub const SVBRDF_PHASE_OTHER: svbrdf_phase = 1;
/// Looks for maps that explain all photographs.
pub const SVBRDF_PHASE_FIT: svbrdf_phase = 2;
/// Brings back the detail of every texel.
pub const SVBRDF_PHASE_REFINE: svbrdf_phase = 3;

/// The number of a phase.
pub(crate) fn phase_code(phase: Option<Phase>) -> svbrdf_phase {
    match phase {
        None => SVBRDF_PHASE_NONE,
        Some(Phase::Fit) => SVBRDF_PHASE_FIT,
        Some(Phase::Refine) => SVBRDF_PHASE_REFINE,
    }
}

/// The name of a phase in lower case, e.g. "refine"; "unknown" for other numbers. Static,
/// never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_phase_name(phase: svbrdf_phase) -> *const c_char {
    match phase {
        SVBRDF_PHASE_NONE => c"none",
        SVBRDF_PHASE_OTHER => c"other",
        SVBRDF_PHASE_FIT => c"fit",
        SVBRDF_PHASE_REFINE => c"refine",
        _ => c"unknown",
    }
    .as_ptr()
}
