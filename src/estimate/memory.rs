//! Upper bound of the memory that an estimate needs.

use super::options::ScheduleOptions;
use crate::svbrdf::CHANNELS;

/// Bytes per texel in the last steps: seven sets of maps, and colours.
const REFINED: u64 = 7 * 4 * CHANNELS as u64 + 12;
/// Bytes per texel of the phases before: buffers of the networks.
const WORKING: u64 = 2048;
/// Bytes per texel of a photograph: three half floats, which include the weight, and its smaller versions.
const OBSERVATION: u64 = 9;

/// Bytes for an estimate with `side` texels along each side, with its photographs but without the networks.
pub(crate) fn bytes_needed(side: usize, photographs: usize) -> u64 {
    let texels = |side: usize| (side * side) as u64;
    let working = texels(side.min(ScheduleOptions::default().texels));
    (REFINED + photographs as u64 * OBSERVATION) * texels(side) + WORKING * working
}
