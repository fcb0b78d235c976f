//! What a fit is doing.

use std::ffi::c_char;

use engine::session::Phase;

/// What a fit is doing. Values may be added; phases do not run in this order.
pub type svbrdf_phase = u32;
/// Nothing, or not begun.
pub const SVBRDF_PHASE_NONE: svbrdf_phase = 0;
/// Something that this version of the header does not know.
pub const SVBRDF_PHASE_OTHER: svbrdf_phase = 1;
/// Fits the latent code.
pub const SVBRDF_PHASE_LATENT: svbrdf_phase = 2;
/// Decides how far texels may differ from each other, and whether there are only few materials.
pub const SVBRDF_PHASE_WIDTHS: svbrdf_phase = 3;
/// Pools the gloss of texels that look alike.
pub const SVBRDF_PHASE_POOL_GLOSS: svbrdf_phase = 4;
/// Corrects ambient light, or reflections of the room.
pub const SVBRDF_PHASE_HELD_LIGHTS: svbrdf_phase = 5;
/// Corrects the lights as well.
pub const SVBRDF_PHASE_TURNING_LIGHTS: svbrdf_phase = 6;
/// Refines the maps texel by texel.
pub const SVBRDF_PHASE_MAPS: svbrdf_phase = 7;
/// Regresses slopes.
pub const SVBRDF_PHASE_SLOPES: svbrdf_phase = 8;
/// Infers material classes.
pub const SVBRDF_PHASE_CLASSES: svbrdf_phase = 9;
/// Applies the learned prior.
pub const SVBRDF_PHASE_NETWORK: svbrdf_phase = 11;
/// SVBRDF_METHOD_CLASSIC: inverse rendering on the maps themselves.
pub const SVBRDF_PHASE_BASELINE: svbrdf_phase = 12;

/// The number of a phase.
pub(crate) fn phase_code(phase: Option<Phase>) -> svbrdf_phase {
    match phase {
        None => SVBRDF_PHASE_NONE,
        Some(Phase::Latent) => SVBRDF_PHASE_LATENT,
        Some(Phase::Widths) => SVBRDF_PHASE_WIDTHS,
        Some(Phase::PoolGloss) => SVBRDF_PHASE_POOL_GLOSS,
        Some(Phase::HeldLights) => SVBRDF_PHASE_HELD_LIGHTS,
        Some(Phase::TurningLights) => SVBRDF_PHASE_TURNING_LIGHTS,
        Some(Phase::Maps) => SVBRDF_PHASE_MAPS,
        Some(Phase::Slopes) => SVBRDF_PHASE_SLOPES,
        Some(Phase::Classes) => SVBRDF_PHASE_CLASSES,
        Some(Phase::Network) => SVBRDF_PHASE_NETWORK,
        Some(Phase::Baseline) => SVBRDF_PHASE_BASELINE,
    }
}

/// The name of a phase in lower case, e.g. "held_lights"; "unknown" for other numbers. Static,
/// never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_phase_name(phase: svbrdf_phase) -> *const c_char {
    match phase {
        SVBRDF_PHASE_NONE => c"none",
        SVBRDF_PHASE_OTHER => c"other",
        SVBRDF_PHASE_LATENT => c"latent",
        SVBRDF_PHASE_WIDTHS => c"widths",
        SVBRDF_PHASE_POOL_GLOSS => c"pool_gloss",
        SVBRDF_PHASE_HELD_LIGHTS => c"held_lights",
        SVBRDF_PHASE_TURNING_LIGHTS => c"turning_lights",
        SVBRDF_PHASE_MAPS => c"maps",
        SVBRDF_PHASE_SLOPES => c"slopes",
        SVBRDF_PHASE_CLASSES => c"classes",
        SVBRDF_PHASE_NETWORK => c"network",
        SVBRDF_PHASE_BASELINE => c"baseline",
        _ => c"unknown",
    }
    .as_ptr()
}
