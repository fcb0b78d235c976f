//! A photo of the caller's in memory of the library, to be looked at later.

use std::ptr;

use engine::frame::Photo;

use crate::image::{SVBRDF_PIXEL_P010, SVBRDF_PIXEL_YUV420, bytes, svbrdf_image};
use crate::options::svbrdf_frame_info;
use crate::status::Fault;
use crate::versioned;

/// A picture whose planes point to its own memory.
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
        let count = match image.format {
            SVBRDF_PIXEL_YUV420 | SVBRDF_PIXEL_P010 => 3,
            _ => 1,
        };
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

/// A photo and what is known about it.
pub(crate) struct OwnedFrame {
    info: svbrdf_frame_info,
    image: OwnedImage,
    ambient: Option<OwnedImage>,
}

// SAFETY: every pointer that is followed is to memory of the frame's own.
unsafe impl Send for OwnedFrame {}

impl OwnedFrame {
    /// Copies what a caller hands over. What is wrong with it otherwise is said by
    /// [`OwnedFrame::photo`].
    ///
    /// # Safety
    /// As [`svbrdf_frame_info::photo`].
    pub(crate) unsafe fn copy(
        image: &svbrdf_image,
        info: &svbrdf_frame_info,
    ) -> Result<Self, Fault> {
        // SAFETY: as the caller vouches.
        let (image, ambient) = unsafe {
            let image = OwnedImage::copy(image)?;
            let ambient = if info.ambient.is_null() {
                None
            } else {
                let ambient = versioned::read(info.ambient).and_then(|i| OwnedImage::copy(&i));
                Some(ambient.map_err(|fault| fault.about("ambient"))?)
            };
            (image, ambient)
        };
        Ok(Self { info: *info, image, ambient })
    }

    /// The photo.
    pub(crate) fn photo(&self) -> Result<Photo, Fault> {
        let ambient = self.ambient.as_ref().map_or(ptr::null(), |a| &raw const a.image);
        let info = svbrdf_frame_info { ambient, ..self.info };
        // SAFETY: all planes are the frame's own.
        unsafe { info.photo(&self.image.image) }
    }
}
