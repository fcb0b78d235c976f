//! Fit of the maps to each photo.

use std::mem::offset_of;

use engine::session::PhotoFit;

use crate::handles::svbrdf_session;
use crate::live::act;
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Fit of the current maps to an accepted photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_photo_fit {
    /// Size of this struct.
    pub size: usize,
    /// Median over its texels of the absolute difference of the logarithms of rendered and measured
    /// radiance: a relative error.
    pub residual: f32,
    /// Mean weight of its texels, 0 to 1: the cosine to the camera, 0 for texels not seen, and for
    /// those that contradict the other photos.
    pub weight: f32,
    /// 1 when the photo contradicts the others: its residual stands out (from four photos on), or its board shows
    /// another light or most of it differs (from three on, with a board).
    pub outlier: u32,
    /// 0.
    pub reserved: u32,
    /// Share of the sample, 0 to 1, where it contradicts the others and is left out of the fit: a hand,
    /// sun, a shadow or glare on a part of it. 0: nowhere.
    pub part_share: f32,
    /// Middle of that part: of the sample's width from the left, of its height from the top.
    pub part_centre: [f32; 2],
    /// Its brightness relative to the prediction from the other photos; below 1: darker.
    pub part_ratio: f32,
}

defaults!(svbrdf_photo_fit {});
versioned!(svbrdf_photo_fit, offset_of!(svbrdf_photo_fit, part_share));

impl svbrdf_photo_fit {
    fn new(fit: &PhotoFit) -> Self {
        let PhotoFit { residual, weight, outlier, part } = *fit;
        Self {
            residual,
            weight,
            outlier: outlier.into(),
            part_share: part.map_or(0.0, |p| p.share),
            part_centre: part.map_or([0.0; 2], |p| p.centre),
            part_ratio: part.map_or(0.0, |p| p.ratio),
            ..Self::default()
        }
    }
}

/// Fills a fit with zeros: pass sizeof(svbrdf_photo_fit).
///
/// # Safety
/// `fit` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_photo_fit_init(
    fit: *mut svbrdf_photo_fit,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(fit, size) })
}

/// The fit of the current maps to an accepted photo; meaningful once the fit has settled.
/// `index` counts the accepted photos from 0. Waits for a step of the fit.
///
/// # Safety
/// `fit` is NULL or initialised by svbrdf_photo_fit_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_photo_fit(
    session: *const svbrdf_session,
    index: u32,
    fit: *mut svbrdf_photo_fit,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("fit", fit) }?;
        let fits = live.session.photo_fits()?;
        let found = fits.get(index as usize).ok_or_else(|| {
            Fault::argument(format!("index: {index} given, but there are {} photos", fits.len()))
        })?;
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(fit, size, svbrdf_photo_fit::new(found)) };
        Ok(())
    })
}
