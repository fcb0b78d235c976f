//! Maps of fewer texels.

use std::sync::Arc;

use crate::maps::{self, svbrdf_maps};
use crate::status::{Fault, entry, svbrdf_status};

/// The maps at 1 / 2^level of their size (1: half, 2: a quarter; 0: as they are), without
/// uncertainty: means of squares of texels, of slopes for the normals, which stay unit vectors.
/// SVBRDF_INVALID_ARGUMENT when they cannot be halved so often. Free with svbrdf_maps_destroy().
///
/// # Safety
/// `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_reduced(
    maps: *const svbrdf_maps,
    level: u32,
    out: *mut *mut svbrdf_maps,
) -> svbrdf_status {
    entry(|| {
        let (maps, sample_mm) = maps::shared(maps)?;
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        let small = if level == 0 { maps } else { Arc::new(maps.reduced(level)?) };
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(maps::hand_out(small, sample_mm)) };
        Ok(())
    })
}
