//! Uncertainty of maps.

use std::sync::Arc;

use engine::uncertainty::MapDeviations;

use crate::handles::svbrdf_session;
use crate::live::act;
use crate::maps::{self, svbrdf_map, svbrdf_map_view, svbrdf_maps};
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Standard deviation of each map as a whole: root mean square of the expected errors of its texels.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_uncertainty {
    /// Size of this struct.
    pub size: usize,
    /// Standard deviation of each slope of the normal: tangent of a tilt.
    pub normal: f32,
    /// Standard deviation of each colour of the diffuse albedo, linear.
    pub diffuse: f32,
    /// Standard deviation of each colour of the specular albedo, linear.
    pub specular: f32,
    /// Standard deviation of roughness.
    pub roughness: f32,
}

defaults!(svbrdf_uncertainty {});
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
        let MapDeviations { normal, diffuse, specular, roughness, .. } =
            maps.uncertainty()?.of_maps();
        let value =
            svbrdf_uncertainty { normal, diffuse, specular, roughness, ..Default::default() };
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(uncertainty, size, value) };
        Ok(())
    })
}

/// Standard deviation of a map at every texel, one float each: of each slope of the normal, of each
/// colour of an albedo (linear), of roughness, of the sheen's roughness. Other lobes have three floats each:
/// SVBRDF_MAP_COAT those of weight, roughness, 0; SVBRDF_MAP_SHEEN those of red, green, blue;
/// SVBRDF_MAP_ANISOTROPY those of ln(larger alpha / smaller alpha) times the cosine and times the sine of twice the
/// direction's angle, 0. Two errors of three are within it. SVBRDF_NO_LOBE where the material does not have
/// the lobe. Only for maps of svbrdf_session_snapshot_with_uncertainty(). The memory belongs to the library and
/// ends with the maps.
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
        let (plane, channels) = maps.deviations(map)?;
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("view", view) }?;
        let value = svbrdf_map_view {
            data: plane.as_ptr().cast(),
            bytes: size_of_val(plane),
            row_stride: size_of_val(plane) / uncertainty.height(),
            width: uncertainty.width() as u32,
            height: uncertainty.height() as u32,
            channels,
            ..Default::default()
        };
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(view, size, value) };
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use engine::Svbrdf;
    use engine::svbrdf::LOBES;
    use engine::uncertainty::Uncertainty;

    use super::*;
    use crate::maps::{
        SVBRDF_MAP_ANISOTROPY, SVBRDF_MAP_COAT, SVBRDF_MAP_SHEEN, SVBRDF_MAP_SHEEN_ROUGHNESS,
        svbrdf_maps_destroy,
    };
    use crate::status::{SVBRDF_NO_LOBE, SVBRDF_OK};

    /// Maps of 2 x 1 texels with a coat and sheen. The deviations of lobe `i` are `i` and `i + 0.5`.
    fn coated() -> *mut svbrdf_maps {
        let mut maps = Svbrdf::new(2, 1);
        let lobes = [[0.0; 4].as_slice(), &[0.5; 2 * LOBES - 4]].concat();
        maps.set_lobes(lobes).unwrap();
        let planes = vec![0.1; 8].into_iter().chain((0..2 * LOBES).map(|i| 0.5 * i as f32));
        let uncertainty = Uncertainty::from_planes(2, 1, planes.collect()).unwrap();
        maps::hand_out_with_uncertainty(Arc::new(maps), [1.0; 2], uncertainty)
    }

    #[test]
    fn lobes_have_the_channels_of_their_maps() {
        let maps = coated();
        let expected: [(svbrdf_map, &[f32]); 3] = [
            (SVBRDF_MAP_COAT, &[2.0, 3.0, 0.0, 2.5, 3.5, 0.0]),
            (SVBRDF_MAP_SHEEN, &[4.0, 5.0, 6.0, 4.5, 5.5, 6.5]),
            (SVBRDF_MAP_SHEEN_ROUGHNESS, &[7.0, 7.5]),
        ];
        for (map, expected) in expected {
            let mut view = svbrdf_map_view::default();
            // SAFETY: the view is initialised.
            assert_eq!(unsafe { svbrdf_maps_deviations(maps, map, &raw mut view) }, SVBRDF_OK);
            assert_eq!(view.bytes, size_of_val(expected));
            assert_eq!((view.width, view.channels as usize), (2, expected.len() / 2));
            // SAFETY: the view has that many floats.
            let found: &[f32] =
                unsafe { std::slice::from_raw_parts(view.data.cast(), expected.len()) };
            assert_eq!(expected, found);
        }
        let mut view = svbrdf_map_view::default();
        // SAFETY: the view is initialised.
        let status = unsafe { svbrdf_maps_deviations(maps, SVBRDF_MAP_ANISOTROPY, &raw mut view) };
        assert_eq!(status, SVBRDF_NO_LOBE);
        assert_eq!(svbrdf_maps_destroy(maps), SVBRDF_OK);
    }
}
