//! Uncertainty of maps.

use std::sync::Arc;

use engine::uncertainty::MapDeviations;

use crate::handles::svbrdf_session;
use crate::live::act;
use crate::maps::{
    self, SVBRDF_MAP_DIFFUSE, SVBRDF_MAP_NORMAL, SVBRDF_MAP_NORMAL_DIRECTX, SVBRDF_MAP_ROUGHNESS,
    SVBRDF_MAP_SPECULAR, svbrdf_map, svbrdf_map_view, svbrdf_maps,
};
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, versioned};

/// Standard deviation of each map as a whole: root mean square of the expected errors of its texels.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_uncertainty {
    /// Size of this struct.
    pub size: usize,
    /// Of each slope of the normal: tangent of a tilt.
    pub normal: f32,
    /// Of each colour of the diffuse albedo, linear.
    pub diffuse: f32,
    /// Of each colour of the specular albedo, linear.
    pub specular: f32,
    /// Of roughness.
    pub roughness: f32,
}

impl Default for svbrdf_uncertainty {
    fn default() -> Self {
        let size = size_of::<Self>();
        Self { size, normal: 0.0, diffuse: 0.0, specular: 0.0, roughness: 0.0 }
    }
}
versioned!(svbrdf_uncertainty, size_of::<svbrdf_uncertainty>());

/// Fills an uncertainty with zeros: pass sizeof(svbrdf_uncertainty).
///
/// # Safety
/// `uncertainty` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_uncertainty_init(
    uncertainty: *mut svbrdf_uncertainty,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(uncertainty, size) })
}

/// The current maps with the standard deviation of each at every texel; svbrdf_maps_export() writes
/// both. Computed when asked for; meaningful once the fit has settled. Waits for a step of the fit.
/// SVBRDF_NO_MAPS before the first photo. Free with svbrdf_maps_destroy().
///
/// # Safety
/// `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_snapshot_with_uncertainty(
    session: *const svbrdf_session,
    out: *mut *mut svbrdf_maps,
) -> svbrdf_status {
    act(session, |live| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        let known = live.session.snapshot_with_uncertainty()?;
        let maps = maps::hand_out_with_uncertainty(
            Arc::clone(&known.maps),
            live.sample_mm,
            known.uncertainty,
        );
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(maps) };
        Ok(())
    })
}

/// One number for each map; only for maps of svbrdf_session_snapshot_with_uncertainty().
///
/// # Safety
/// `uncertainty` is NULL or initialised by svbrdf_uncertainty_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_uncertainty(
    maps: *const svbrdf_maps,
    uncertainty: *mut svbrdf_uncertainty,
) -> svbrdf_status {
    entry(|| {
        let maps = maps::get(maps)?;
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("uncertainty", uncertainty) }?;
        let MapDeviations { normal, diffuse, specular, roughness } = maps.uncertainty()?.of_maps();
        let value =
            svbrdf_uncertainty { normal, diffuse, specular, roughness, ..Default::default() };
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(uncertainty, size, value) };
        Ok(())
    })
}

/// Standard deviation of a map at every texel, one float each: of each slope of the normal, of each
/// colour of an albedo (linear), of roughness. Two errors of three are within it. Only for maps of
/// svbrdf_session_snapshot_with_uncertainty(). The memory belongs to the library and ends with the maps.
///
/// # Safety
/// `view` is NULL or was initialised by svbrdf_map_view_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_deviations(
    maps: *const svbrdf_maps,
    map: svbrdf_map,
    view: *mut svbrdf_map_view,
) -> svbrdf_status {
    entry(|| {
        let maps = maps::get(maps)?;
        let uncertainty = maps.uncertainty()?;
        let plane = match map {
            SVBRDF_MAP_NORMAL | SVBRDF_MAP_NORMAL_DIRECTX => uncertainty.normal(),
            SVBRDF_MAP_DIFFUSE => uncertainty.diffuse(),
            SVBRDF_MAP_SPECULAR => uncertainty.specular(),
            SVBRDF_MAP_ROUGHNESS => uncertainty.roughness(),
            _ => {
                let message = format!("map: {map} given, deviations are known of 1 to 5 only");
                return Err(Fault::argument(message));
            }
        };
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("view", view) }?;
        let value = svbrdf_map_view {
            data: plane.as_ptr().cast(),
            bytes: size_of_val(plane),
            row_stride: size_of_val(plane) / uncertainty.height(),
            width: uncertainty.width() as u32,
            height: uncertainty.height() as u32,
            channels: 1,
            ..Default::default()
        };
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(view, size, value) };
        Ok(())
    })
}
