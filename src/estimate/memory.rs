//! How much memory an estimate needs: an upper bound, so that no phase has to be counted by itself.

use super::options::ScheduleOptions;
use crate::svbrdf::CHANNELS;

/// Bytes of a texel while maps are refined: seven sets of maps, and colours.
const REFINED: u64 = 7 * 4 * CHANNELS as u64 + 12;
/// Bytes of a texel that phases work with: the buffers of the networks.
const WORKING: u64 = 2048;
/// Bytes of a texel of a photograph: three half floats that hold its weight as well, and smaller versions.
const OBSERVATION: u64 = 9;

/// Bytes that an estimate of so many texels along each side needs, its photographs included and the networks
/// not.
pub(crate) fn bytes_needed(side: usize, photographs: usize) -> u64 {
    let texels = |side: usize| (side * side) as u64;
    let working = texels(side.min(ScheduleOptions::default().texels));
    (REFINED + photographs as u64 * OBSERVATION) * texels(side) + WORKING * working
}
