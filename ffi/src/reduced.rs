//! Maps of fewer texels.

use std::sync::Arc;

use engine::Svbrdf;

use crate::handles::svbrdf_session;
use crate::live::look;
use crate::maps::{self, svbrdf_maps};
use crate::status::{Fault, entry, svbrdf_status};

/// Hands out maps halved `level` times.
///
/// # Safety
/// `out` is NULL or writable.
unsafe fn hand_out_reduced(
    maps: &Arc<Svbrdf>,
    sample_mm: [f32; 2],
    level: u32,
    out: *mut *mut svbrdf_maps,
) -> Result<(), Fault> {
    if out.is_null() {
        return Err(Fault::argument("out: NULL given"));
    }
    let small = if level == 0 { maps.clone() } else { Arc::new(maps.reduced(level)?) };
    // SAFETY: not NULL, and the caller vouches for the rest.
    unsafe { out.write(maps::hand_out(small, sample_mm)) };
    Ok(())
}

/// The maps at 1 / 2^level of their size (1: half, 2: a quarter; 0: as they are), without
/// confidence: means of squares of texels, of slopes for the normals, which stay unit vectors.
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
        // SAFETY: the caller vouches for the result.
        unsafe { hand_out_reduced(&maps, sample_mm, level, out) }
    })
}

/// As svbrdf_session_snapshot_maps(), reduced as by svbrdf_maps_reduced(): for showing maps during a
/// session. Those of full size are not kept.
///
/// # Safety
/// `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_snapshot_reduced(
    session: *const svbrdf_session,
    level: u32,
    out: *mut *mut svbrdf_maps,
) -> svbrdf_status {
    look(session, |live| {
        // SAFETY: the caller vouches for the result.
        unsafe { hand_out_reduced(&live.session.snapshot()?, live.sample_mm, level, out) }
    })
}
