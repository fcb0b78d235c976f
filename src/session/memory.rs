//! How much memory a session needs, estimated before it is taken.

use super::Settings;
use crate::latent_fit::FitOptions;
use crate::svbrdf::CHANNELS;
use crate::{Error, Result};

/// Bytes of a texel of a rectified photograph.
const OBSERVATION: u64 = 16;
/// Bytes of a texel of maps.
const MAPS: u64 = 4 * CHANNELS as u64;
/// Sets of maps at full resolution that are alive at the same time: start, published, those of the
/// fit, and what the refinement works with.
const MAP_SETS: u64 = 7;
/// Bytes of a texel that is fitted: the decoder's activations and gradients, code, detail, maps.
const FITTED: u64 = 2600;
/// Threads, tables, and what the first networks need for a moment.
const BASE: u64 = 64 << 20;

/// Estimate for so many photographs; `kept` bytes of photographs as they were taken lie beside.
pub(super) fn needed(settings: &Settings, photographs: usize, kept: u64) -> u64 {
    let area = |side: usize| (side * side) as u64;
    let side = settings.resolution;
    let full = area(side);
    let mut fitted = 0;
    let mut level = side;
    while level >= 256 {
        if level <= FitOptions::default().finest_texels.max(256) {
            fitted += area(level);
        }
        level /= 2;
    }
    // Held by the session and, while later photographs better earlier ones, once more.
    let each = OBSERVATION * (2 * full + 2 * fitted);
    BASE + MAP_SETS * MAPS * full + FITTED * fitted + photographs as u64 * each + kept
}

/// Refuses what would need more than is allowed.
pub(super) fn check(settings: &Settings, photographs: usize, kept: u64) -> Result<()> {
    let Some(limit) = settings.memory_limit_bytes else { return Ok(()) };
    let needed = needed(settings, photographs, kept);
    if needed <= limit { Ok(()) } else { Err(Error::MemoryLimit { needed, limit }) }
}
