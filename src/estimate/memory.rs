//! How much memory an estimate needs.

use super::options::ScheduleOptions;
use crate::networks::CODE_TEXELS;
use crate::svbrdf::CHANNELS;

/// Bytes of a texel of a rectified photograph: three half floats that hold its weight as well.
const OBSERVATION: u64 = 6;
/// Bytes of a texel of maps.
const MAPS: u64 = 4 * CHANNELS as u64;
/// Sets of maps at full resolution that are alive at the same time while the code is fitted (the
/// published, the latest finished, those being interpolated), and during the refinement.
const MAP_SETS_FITTING: u64 = 4;
const MAP_SETS_REFINING: u64 = 7;
/// Bytes of a texel that the latent code is fitted to: the decoder's activations and gradients, code, detail, maps.
const FITTED: u64 = 700;
/// Sets of maps that the code begins with: the first, and their mean.
const MAP_SETS_STARTING: u64 = 2;
/// Bytes of a texel that the completion network sees: covariances, features, what its first layers
/// unfold, and what is freed without being given back.
const COMPLETED: u64 = 1800;
/// Bytes of a texel of the colours that maps are refined by.
const GUIDE: u64 = 12;

/// Bytes that an estimate of so many texels along each side needs, its photographs included and the networks
/// not.
pub(crate) fn bytes_needed(side: usize, photographs: usize) -> u64 {
    let area = |side: usize| (side * side) as u64;
    let full = area(side);
    let most = ScheduleOptions::default().texels;
    let working = (0..).map(|times| side >> times).find(|side| *side <= most).map_or(full, area);
    let strided = if working < full { working } else { 0 };
    // Thinned out, and averaged for the code; halved ones take a third more.
    let each = OBSERVATION * (full + strided + strided / 4 + working / 3);
    let latent = FITTED * working.min(area(CODE_TEXELS)) + MAP_SETS_STARTING * MAPS * working;
    let fitting = COMPLETED * working + MAP_SETS_FITTING * MAPS * full;
    let refining = MAP_SETS_REFINING * MAPS * full + GUIDE * full;
    latent + fitting.max(refining) + photographs as u64 * each
}
