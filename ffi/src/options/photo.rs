//! Metadata of a photo.

use std::mem::offset_of;

use engine::photo::Photo;

use crate::image::svbrdf_image;
use crate::status::{Fault, entry, svbrdf_status};
use crate::values::unknown;
use crate::versioned::{self, defaults, versioned};

/// Light of a photo.
pub type svbrdf_flash = u32;
/// Not stated: judged from the photo.
pub const SVBRDF_FLASH_UNKNOWN: svbrdf_flash = 0;
/// No flash: the photo is rejected.
pub const SVBRDF_FLASH_OFF: svbrdf_flash = 1;
/// A flash fired.
pub const SVBRDF_FLASH_FIRED: svbrdf_flash = 2;
/// The lamp was on all the time, as a torch.
pub const SVBRDF_FLASH_TORCH: svbrdf_flash = 3;

/// Metadata of a photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_photo_info {
    /// Size of this struct.
    pub size: usize,
    /// Relative exposure: value = radiance * exposure. With a torch, exposure time times
    /// sensitivity over that of the first photo. Default: 1.
    pub exposure: f32,
    /// One of SVBRDF_FLASH_. Default: unknown.
    pub flash: svbrdf_flash,
    /// Returned in the report and named in the log, to identify the photo.
    pub timestamp_ns: i64,
    /// The same view without flash, subtracted in linear light; or NULL. It has the size of the photo,
    /// and the camera must not have moved. Nothing of it is kept.
    pub ambient: *const svbrdf_image,
    /// Relative exposure of that image; 0: that of the photo.
    pub ambient_exposure: f32,
    /// Focal length as for 35 mm film (EXIF's FocalLengthIn35mmFilm), mm; 0: not known. With a
    /// camera that is estimated it is where the search begins.
    pub focal_35mm: f32,
}

defaults!(svbrdf_photo_info { exposure: 1.0 });
versioned!(svbrdf_photo_info, offset_of!(svbrdf_photo_info, ambient));

/// Fills photo metadata with defaults: pass sizeof(svbrdf_photo_info).
///
/// # Safety
/// `info` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_photo_info_init(
    info: *mut svbrdf_photo_info,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(info, size) })
}

impl svbrdf_photo_info {
    /// A caller's metadata, defaults for NULL.
    ///
    /// # Safety
    /// NULL or as the header requires.
    pub(crate) unsafe fn from_caller(info: *const Self) -> Result<Self, Fault> {
        // SAFETY: as the caller vouches.
        let info = unsafe { versioned::read_or_default(info) }?;
        if info.flash > SVBRDF_FLASH_TORCH {
            return Err(unknown("svbrdf_photo_info.flash", info.flash));
        }
        if !(info.focal_35mm.is_finite() && info.focal_35mm >= 0.0) {
            return Err(Fault::argument("focal_35mm: a length in mm, or 0, is expected"));
        }
        Ok(info)
    }

    /// The photo of a call.
    ///
    /// # Safety
    /// `ambient` is NULL or as the header requires; as [`svbrdf_image::photo`].
    pub(crate) unsafe fn photo(&self, image: &svbrdf_image) -> Result<Photo, Fault> {
        // SAFETY: the caller vouches for the planes.
        let photo = unsafe { image.photo(self.exposure) }?;
        let focal = (self.focal_35mm > 0.0).then_some(self.focal_35mm);
        let photo = photo.with_focal_35mm(focal);
        if self.ambient.is_null() {
            return Ok(photo);
        }
        let exposure = match self.ambient_exposure {
            0.0 => self.exposure,
            other => other,
        };
        // SAFETY: not NULL, and the caller vouches for the rest.
        let ambient = unsafe { versioned::read(self.ambient).and_then(|i| i.photo(exposure)) };
        let ambient = ambient.map_err(|fault| fault.about("ambient"))?;
        Ok(photo.without_ambient(&ambient)?)
    }
}
