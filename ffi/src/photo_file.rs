//! Photos as files: encoded, with their metadata.

use std::ffi::{c_char, c_void};
use std::slice;

use engine::Rejection;

use crate::handles::svbrdf_session;
use crate::image::svbrdf_transfer;
use crate::live::act;
use crate::options::{SVBRDF_FLASH_OFF, svbrdf_flash};
use crate::reports::svbrdf_photo_report;
use crate::session::tell;
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Remarks about a file: an OR of SVBRDF_REMARK_ values. Some may be added.
pub type svbrdf_remarks = u32;
/// Its colour profile cannot be used; sRGB was assumed.
pub const SVBRDF_REMARK_PROFILE_UNUSABLE: svbrdf_remarks = 1;
/// It has a gain map (Ultra HDR), which is ignored.
pub const SVBRDF_REMARK_GAIN_MAP: svbrdf_remarks = 2;
/// Its orientation tag mirrors it.
pub const SVBRDF_REMARK_MIRRORED: svbrdf_remarks = 4;
/// It does not say how it was exposed.
pub const SVBRDF_REMARK_NO_EXPOSURE: svbrdf_remarks = 8;
/// It says that the flash did not fire (a torch does not count as a flash).
pub const SVBRDF_REMARK_NO_FLASH: svbrdf_remarks = 16;
/// Its end marker is missing, and nothing else.
pub const SVBRDF_REMARK_END_MISSING: svbrdf_remarks = 32;
/// It is gray, and so will the maps be.
pub const SVBRDF_REMARK_GRAY: svbrdf_remarks = 64;

/// Bytes of the texts in svbrdf_file_info, with the NUL at the end.
pub const SVBRDF_FILE_TEXT_BYTES: usize = 64;

/// Options of reading a file.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_file_options {
    /// Size of this struct.
    pub size: usize,
    /// Relative exposure: value = radiance * exposure. 0, the default: that of the metadata
    /// (exposure time * ISO / F-number²), or 1.
    pub exposure: f32,
    /// Transfer curve: one of SVBRDF_TRANSFER_. 0, the default: that of the file (ICC profile,
    /// PNG's cICP and gAMA), sRGB if it states none, linear for floats and raw values.
    pub transfer: svbrdf_transfer,
    /// Clockwise rotation of the upright image: 0, 90, 180 or 270 degrees. The session's camera
    /// describes the rotated image.
    pub rotation: u32,
    /// One of SVBRDF_FLASH_. Default: unknown.
    pub flash: svbrdf_flash,
    /// Returned in the report and named in the log, to identify the photo.
    pub timestamp_ns: i64,
    /// Largest image, pixels; 0, the default: 100 million.
    pub max_pixels: u64,
    /// Largest memory of decoding, without the file itself, bytes. If more were needed, the call returns
    /// SVBRDF_MEMORY_LIMIT before anything is allocated. 0, the default: 6 GiB.
    pub max_bytes: u64,
}

defaults!(svbrdf_file_options {});
versioned!(svbrdf_file_options, size_of::<svbrdf_file_options>());

/// Fills options with defaults: pass sizeof(svbrdf_file_options).
///
/// # Safety
/// `options` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_file_options_init(
    options: *mut svbrdf_file_options,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(options, size) })
}

/// Metadata in the file of a photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_file_info {
    /// Size of this struct.
    pub size: usize,
    /// Width as the sensor has it, px; 0: not known.
    pub width: u32,
    /// Height as the sensor has it, px; 0: not known.
    pub height: u32,
    /// Clockwise rotation that makes the stored image upright, degrees; reading a file applies it. Lens
    /// and flash keep their places in the camera, however it is held: options.rotation turns photos
    /// back to how most of them were held.
    pub upright_deg: u32,
    /// 1: the values are linear (floats, raw values).
    pub is_linear: u32,
    /// Exposure time * ISO / F-number², relative; 0: not known.
    pub exposure: f32,
    /// Focal length of the lens, mm; 0: not known.
    pub focal_mm: f32,
    /// Focal length on film of 36 x 24 mm that shows as much, mm; 0: not known.
    pub focal_35mm: f32,
    /// Factor of the digital zoom; 1: none, or not known.
    pub digital_zoom: f32,
    /// Remarks: an OR of SVBRDF_REMARK_ values. Those about colours and the end of the file are known
    /// only when the photo is added.
    pub remarks: svbrdf_remarks,
    /// Maker of the camera; empty: not known. Photos that differ in maker, model, lens, focal lengths,
    /// zoom or size need sessions, or cameras, of their own.
    pub make: [c_char; SVBRDF_FILE_TEXT_BYTES],
    /// Model of the camera.
    pub model: [c_char; SVBRDF_FILE_TEXT_BYTES],
    /// Lens.
    pub lens: [c_char; SVBRDF_FILE_TEXT_BYTES],
    /// Time of the photo: text that sorts by time.
    pub taken: [c_char; SVBRDF_FILE_TEXT_BYTES],
}

defaults!(svbrdf_file_info { digital_zoom: 1.0 });
versioned!(svbrdf_file_info, size_of::<svbrdf_file_info>());

/// Fills a result with defaults: pass sizeof(svbrdf_file_info).
///
/// # Safety
/// `info` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_file_info_init(
    info: *mut svbrdf_file_info,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(info, size) })
}

/// As svbrdf_session_add_photo(), for a photo that is a file in memory: JPEG, PNG, TIFF, OpenEXR, HEIC or
/// DNG, recognised by its content. SVBRDF_INVALID_ARGUMENT if the file is damaged or of another format,
/// which the message names. `options`, `info` and
/// `report` may be NULL. SVBRDF_UNSUPPORTED if svbrdf_features() lacks SVBRDF_FEATURE_FILES.
///
/// # Safety
/// `bytes` is NULL or has `length` readable bytes; each other pointer is NULL or initialised by its
/// _init() function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_add_photo_file(
    session: *mut svbrdf_session,
    bytes: *const c_void,
    length: usize,
    options: *const svbrdf_file_options,
    info: *mut svbrdf_file_info,
    report: *mut svbrdf_photo_report,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for every pointer.
        let (options, info_size, report_size) = unsafe {
            (
                versioned::read_or_default(options)?,
                versioned::result_size(info)?,
                versioned::result_size(report)?,
            )
        };
        // SAFETY: as above.
        let bytes = unsafe { content(bytes, length) }?;
        let (photo, known) = read::decode(bytes, &options)?;
        let outcome = match options.flash {
            SVBRDF_FLASH_OFF => live.session.reject(Rejection::LightNotVisible),
            _ => live.session.add_photo(&photo)?,
        };
        drop(photo);
        if let Some(size) = info_size {
            // SAFETY: `size` bytes are there.
            unsafe { versioned::write(info, size, known) };
        }
        // SAFETY: as above.
        unsafe { tell(live, &outcome, options.timestamp_ns, report, report_size) }
    })
}

/// Reads the metadata in the file of a photo without its pixels: to sort photos by
/// camera and time before they are added. Unknown fields keep their defaults.
///
/// # Safety
/// `bytes` is NULL or has `length` readable bytes; `info` is NULL or initialised by its _init()
/// function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_file_look_at(
    bytes: *const c_void,
    length: usize,
    info: *mut svbrdf_file_info,
) -> svbrdf_status {
    entry(|| {
        // SAFETY: the caller vouches for both.
        let size = unsafe { versioned::result_size(info) }?;
        let size = size.ok_or_else(|| Fault::argument("info: NULL given"))?;
        // SAFETY: as above.
        let known = read::look_at(unsafe { content(bytes, length) }?)?;
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(info, size, known) };
        Ok(())
    })
}

/// # Safety
/// NULL or `length` readable bytes.
unsafe fn content<'a>(bytes: *const c_void, length: usize) -> Result<&'a [u8], Fault> {
    if bytes.is_null() || length == 0 {
        return Err(Fault::argument("bytes: NULL or nothing given, a file's content is expected"));
    }
    if length > isize::MAX.cast_unsigned() {
        return Err(Fault::argument(format!("length: {length} given, more than there can be")));
    }
    // SAFETY: not NULL, and the caller vouches for the bytes.
    Ok(unsafe { slice::from_raw_parts(bytes.cast(), length) })
}

#[cfg(feature = "files")]
mod read {
    use engine::files::{self, Limits, Metadata, Options, Remark};
    use engine::photo::{Photo, Rotation};

    use super::*;
    use crate::image::encoding;
    use crate::options::SVBRDF_FLASH_TORCH;
    use crate::reports::text;
    use crate::values::unknown;

    pub fn decode(
        bytes: &[u8],
        options: &svbrdf_file_options,
    ) -> Result<(Photo, svbrdf_file_info), Fault> {
        if options.flash > SVBRDF_FLASH_TORCH {
            return Err(unknown("svbrdf_file_options.flash", options.flash));
        }
        let encoding = match options.transfer {
            0 => None,
            stated => Some(encoding("svbrdf_file_options.transfer", stated)?),
        };
        let turn = Rotation::from_degrees(options.rotation)
            .ok_or_else(|| unknown("svbrdf_file_options.rotation", options.rotation))?;
        let or = |stated: u64, default| if stated == 0 { default } else { stated };
        let all = Limits::default();
        let options = Options {
            encoding,
            exposure: (options.exposure != 0.0).then_some(options.exposure),
            turn,
            limits: Limits {
                pixels: or(options.max_pixels, all.pixels),
                memory_bytes: or(options.max_bytes, all.memory_bytes),
                ..all
            },
        };
        let decoded = files::decode(bytes, &options)?;
        let mut known = described(&decoded.metadata);
        for remark in &decoded.remarks {
            known.remarks |= match remark {
                Remark::ProfileUnusable(_) => SVBRDF_REMARK_PROFILE_UNUSABLE,
                Remark::GainMap => SVBRDF_REMARK_GAIN_MAP,
                Remark::Mirrored => SVBRDF_REMARK_MIRRORED,
                Remark::EndMissing => SVBRDF_REMARK_END_MISSING,
                Remark::Gray => SVBRDF_REMARK_GRAY,
                _ => 0,
            };
        }
        Ok((decoded.photo, known))
    }

    pub fn look_at(bytes: &[u8]) -> Result<svbrdf_file_info, Fault> {
        Ok(described(&Metadata::of(bytes)))
    }

    fn described(known: &Metadata) -> svbrdf_file_info {
        let [width, height] = known.size.unwrap_or_default();
        let number = |value: Option<f64>| value.unwrap_or(0.0) as f32;
        let mark = |is: bool, remark| if is { remark } else { 0 };
        let name = |name: &Option<String>| text(&name.as_deref().unwrap_or("").replace('\0', " "));
        svbrdf_file_info {
            width,
            height,
            upright_deg: known.upright_deg.unwrap_or(0),
            is_linear: known.is_linear.into(),
            exposure: number(known.exposure),
            focal_mm: number(known.focal_mm),
            focal_35mm: number(known.focal_35mm),
            digital_zoom: known.digital_zoom.unwrap_or(1.0) as f32,
            remarks: mark(known.exposure.is_none(), SVBRDF_REMARK_NO_EXPOSURE)
                | mark(known.flash_fired == Some(false), SVBRDF_REMARK_NO_FLASH)
                | mark(known.mirrored, SVBRDF_REMARK_MIRRORED),
            make: name(&known.make),
            model: name(&known.model),
            lens: name(&known.lens),
            taken: name(&known.taken),
            ..svbrdf_file_info::default()
        }
    }
}

#[cfg(not(feature = "files"))]
mod read {
    use engine::photo::Photo;

    use super::*;
    use crate::status::SVBRDF_UNSUPPORTED;

    fn missing() -> Fault {
        Fault::new(SVBRDF_UNSUPPORTED, "this build reads no files: its feature `files` is off")
    }

    pub fn decode(_: &[u8], _: &svbrdf_file_options) -> Result<(Photo, svbrdf_file_info), Fault> {
        Err(missing())
    }

    pub fn look_at(_: &[u8]) -> Result<svbrdf_file_info, Fault> {
        Err(missing())
    }
}
