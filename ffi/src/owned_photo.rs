//! A photo of the caller's in memory of the library, to be looked at later.

use std::ptr;

use engine::photo::Photo;
use engine::session::{Held, Session};

use crate::image::{FLOATS, SVBRDF_PIXEL_P010, SVBRDF_PIXEL_YUV420, bytes, svbrdf_image};
use crate::options::svbrdf_photo_info;
use crate::status::Fault;
use crate::versioned;

/// Number of planes of an image.
fn planes(image: &svbrdf_image) -> usize {
    match image.format {
        SVBRDF_PIXEL_YUV420 | SVBRDF_PIXEL_P010 => 3,
        _ => 1,
    }
}

/// Bytes of a copy, of the photo made of it, and its pixels.
struct Needs {
    copy: u64,
    photo: u64,
    pixels: u64,
}

impl Needs {
    fn of(image: &svbrdf_image) -> Self {
        let copy = image.planes[..planes(image)].iter().fold(0_u64, |sum, plane| {
            let bytes = if plane.data.is_null() { 0 } else { plane.bytes as u64 };
            sum.saturating_add(bytes)
        });
        let pixels = u64::from(image.width).saturating_mul(u64::from(image.height));
        let photo = pixels.saturating_mul(image.photo_bytes());
        Self { copy, photo, pixels }
    }
}

/// An image whose planes point to its own memory.
struct OwnedImage {
    image: svbrdf_image,
    _memory: Vec<Vec<u8>>,
}

impl OwnedImage {
    /// Copies the planes that the format needs, as they are.
    ///
    /// # Safety
    /// They are NULL or have as many readable bytes as said.
    unsafe fn copy(image: &svbrdf_image) -> Result<Self, Fault> {
        let mut image = *image;
        let count = planes(&image);
        let mut memory = Vec::with_capacity(count);
        for (i, plane) in image.planes.iter_mut().enumerate() {
            if i < count {
                let name = ["planes[0].data", "planes[1].data", "planes[2].data"][i];
                // SAFETY: as the caller vouches.
                let copy = unsafe { bytes(name, plane.data, plane.bytes) }?.to_vec();
                plane.data = copy.as_ptr().cast();
                memory.push(copy);
            } else {
                plane.data = ptr::null();
            }
        }
        Ok(Self { image, _memory: memory })
    }
}

/// A photo and its metadata, counted as memory of its session.
pub(crate) struct OwnedPhoto {
    info: svbrdf_photo_info,
    image: OwnedImage,
    ambient: Option<OwnedImage>,
    _held: Held,
}

// SAFETY: every pointer that is followed is to memory of the photo's own.
unsafe impl Send for OwnedPhoto {}

impl OwnedPhoto {
    /// Copies a caller's image, if the session's memory limit allows it. [`OwnedPhoto::photo`] reports all other
    /// faults.
    ///
    /// # Safety
    /// As [`svbrdf_photo_info::photo`].
    pub(crate) unsafe fn copy(
        session: &Session,
        image: &svbrdf_image,
        info: &svbrdf_photo_info,
    ) -> Result<Self, Fault> {
        let about = |fault: Fault| fault.about("ambient");
        let ambient = if info.ambient.is_null() {
            None
        } else {
            // SAFETY: not NULL, and the caller vouches for the rest.
            Some(unsafe { versioned::read(info.ambient) }.map_err(about)?)
        };
        let mut needs = Needs::of(image);
        if let Some(ambient) = &ambient {
            let other = Needs::of(ambient);
            needs.copy = needs.copy.saturating_add(other.copy);
            // Both are there while their difference, in floats, is made.
            let difference = needs.pixels.saturating_mul(FLOATS);
            needs.photo = needs.photo.saturating_add(other.photo).saturating_add(difference);
        }
        let held = session.hold(needs.copy, needs.photo, needs.pixels)?;
        // SAFETY: as the caller vouches.
        let (image, ambient) = unsafe {
            let image = OwnedImage::copy(image)?;
            (image, ambient.map(|a| OwnedImage::copy(&a).map_err(about)).transpose()?)
        };
        Ok(Self { info: *info, image, ambient, _held: held })
    }

    /// The photo.
    pub(crate) fn photo(&self) -> Result<Photo, Fault> {
        let ambient = self.ambient.as_ref().map_or(ptr::null(), |a| &raw const a.image);
        let info = svbrdf_photo_info { ambient, ..self.info };
        // SAFETY: all planes are the photo's own.
        unsafe { info.photo(&self.image.image) }
    }
}
