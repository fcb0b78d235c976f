//! Maps as files for other programs, in memory or on disk.

use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::Arc;

use engine::export::{ExportOptions, Format, Package, TextureFormat, export};

use crate::handles::Handles;
use crate::log;
use crate::maps::{self, folder, svbrdf_maps};
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Exported files in memory; independent of the maps.
pub struct svbrdf_package {
    _opaque: (),
}

/// File format of textures.
pub type svbrdf_texture_format = u32;
/// PNG, 8 bits a channel.
pub const SVBRDF_TEXTURE_PNG8: svbrdf_texture_format = 1;
/// PNG, 16 bits a channel.
pub const SVBRDF_TEXTURE_PNG16: svbrdf_texture_format = 2;
/// JPEG; textures of four channels are PNG of 8 bits.
pub const SVBRDF_TEXTURE_JPEG: svbrdf_texture_format = 3;

/// Options of an export.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_export_options {
    /// Size of this struct.
    pub size: usize,
    /// Formats, separated by commas: glb, usdz, materialx, unreal, unity-hdrp, unity-urp, blender.
    /// Needed during the call only. NULL, the default: glb.
    pub formats: *const c_char,
    /// 1: GLB, MaterialX and Blender get base colour and metalness instead of a specular colour.
    /// Default: 0.
    pub metallic: u32,
    /// 1: the maps are made seamless first. Default: 0.
    pub tile: u32,
    /// One of SVBRDF_TEXTURE_. Default: SVBRDF_TEXTURE_PNG8.
    pub texture: svbrdf_texture_format,
    /// Largest side of the textures, texels. Default: 0, no limit.
    pub max_size: u32,
    /// Number of photos behind the maps, for material.json. Default: 0, not stated.
    pub photos: u32,
    /// 0.
    pub reserved: u32,
}

defaults!(svbrdf_export_options { texture: SVBRDF_TEXTURE_PNG8 });
versioned!(svbrdf_export_options, size_of::<svbrdf_export_options>());

/// Fills options with defaults: pass sizeof(svbrdf_export_options).
///
/// # Safety
/// `options` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_export_options_init(
    options: *mut svbrdf_export_options,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(options, size) })
}

/// Names and bytes; names end with 0 for C.
struct Files(Vec<(CString, Vec<u8>)>);

static PACKAGES: Handles<Files> = Handles::new("package");

/// A field that is 0 or 1.
fn flag(name: &str, value: u32) -> Result<bool, Fault> {
    match value {
        0 | 1 => Ok(value == 1),
        _ => Err(Fault::argument(format!("{name}: {value} given, 0 or 1 expected"))),
    }
}

/// Formats of a list of names.
///
/// # Safety
/// NULL or a C string.
unsafe fn formats(names: *const c_char) -> Result<Vec<Format>, Fault> {
    if names.is_null() {
        return Ok(vec![Format::Glb]);
    }
    // SAFETY: not NULL, and the caller vouches for the rest.
    let names = unsafe { CStr::from_ptr(names) }.to_string_lossy();
    let known = || Format::ALL.map(Format::name).join(", ");
    let format = |name: &str| {
        Format::from_name(name.trim()).ok_or_else(|| {
            let known = known();
            Fault::argument(format!(
                "svbrdf_export_options.formats: {name:?} given, some of {known} expected"
            ))
        })
    };
    names.split(',').map(format).collect()
}

/// Makes the files of a call.
///
/// # Safety
/// `options` is NULL or initialised, its strings are NULL or C strings.
unsafe fn package(
    maps: *const svbrdf_maps,
    options: *const svbrdf_export_options,
) -> Result<Package, Fault> {
    let (maps, sample_mm) = maps::shared(maps)?;
    // SAFETY: the caller vouches for the struct.
    let given = unsafe { versioned::read(options) }?;
    let texture = match given.texture {
        SVBRDF_TEXTURE_PNG8 => TextureFormat::Png8,
        SVBRDF_TEXTURE_PNG16 => TextureFormat::Png16,
        SVBRDF_TEXTURE_JPEG => TextureFormat::Jpeg,
        other => {
            let message = format!("svbrdf_export_options.texture: {other} is not a known value");
            return Err(Fault::argument(message));
        }
    };
    let options = ExportOptions {
        // SAFETY: the caller vouches for the string.
        formats: unsafe { formats(given.formats) }?,
        sample_mm,
        metallic: flag("svbrdf_export_options.metallic", given.metallic)?,
        tile: flag("svbrdf_export_options.tile", given.tile)?,
        texture,
        max_size: (given.max_size > 0).then_some(given.max_size as usize),
        photographs: (given.photos > 0).then_some(given.photos),
    };
    let package = export(&maps, &options)?;
    for remark in &package.remarks {
        log::write(log::SVBRDF_LOG_WARNING, || remark.clone());
    }
    Ok(package)
}

/// Writes maps into a folder (UTF-8), which is made if missing.
///
/// Without `options`, which may be NULL: normal.png, diffuse.png, specular.png, roughness.png (16
/// bits), maps.exr (floats; with the standard deviations of svbrdf_session_snapshot_with_uncertainty()) and
/// preview.png. No file is ever half-written under its name.
///
/// With options: material.glb, material.usdz, a folder for every other format, and material.json,
/// height.png and height.exr. All files are written or none. Lobes that a format does not have are
/// named in the log of svbrdf_set_log_callback().
///
/// # Safety
/// `options` is NULL or initialised by svbrdf_export_options_init(); `path` is NULL or a C string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_export(
    maps: *const svbrdf_maps,
    options: *const svbrdf_export_options,
    path: *const c_char,
) -> svbrdf_status {
    entry(|| {
        // SAFETY: the caller vouches for the string.
        let path = unsafe { folder(path) }?;
        if options.is_null() {
            return maps::export(&*maps::get(maps)?, path);
        }
        // SAFETY: the caller vouches for the struct.
        Ok(unsafe { package(maps, options) }?.write(path)?)
    })
}

/// As svbrdf_maps_export() with options, into memory. Free with svbrdf_package_destroy().
///
/// # Safety
/// `options` was initialised by svbrdf_export_options_init(); `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_export_package(
    maps: *const svbrdf_maps,
    options: *const svbrdf_export_options,
    out: *mut *mut svbrdf_package,
) -> svbrdf_status {
    entry(|| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        // SAFETY: the caller vouches for the struct.
        let package = unsafe { package(maps, options) }?;
        let name = |name: String| CString::new(name).map_err(|e| Fault::argument(e.to_string()));
        let files = package.files.into_iter().map(|(n, bytes)| Ok((name(n)?, bytes)));
        let files = Files(files.collect::<Result<_, Fault>>()?);
        let handle = Handles::<Files>::reserve();
        PACKAGES.insert(handle, Arc::new(files));
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(std::ptr::without_provenance_mut(handle)) };
        Ok(())
    })
}

/// Number of files of a package.
///
/// # Safety
/// `count` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_package_count(
    package: *const svbrdf_package,
    count: *mut u32,
) -> svbrdf_status {
    entry(|| {
        let package = PACKAGES.get(package.addr())?;
        if count.is_null() {
            return Err(Fault::argument("count: NULL given"));
        }
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { count.write(package.0.len() as u32) };
        Ok(())
    })
}

/// Name (UTF-8, relative, "/" between folders) and bytes of a file of a package; `index` counts from 0.
/// Valid until svbrdf_package_destroy(). Results may be NULL.
///
/// # Safety
/// Each result is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_package_file(
    package: *const svbrdf_package,
    index: u32,
    name: *mut *const c_char,
    data: *mut *const c_void,
    bytes: *mut usize,
) -> svbrdf_status {
    entry(|| {
        let package = PACKAGES.get(package.addr())?;
        let (file, contents) = package.0.get(index as usize).ok_or_else(|| {
            let count = package.0.len();
            Fault::argument(format!("index: {index} given, the package has {count} files"))
        })?;
        // SAFETY: the caller vouches for pointers that are not NULL.
        unsafe {
            if !name.is_null() {
                name.write(file.as_ptr());
            }
            if !data.is_null() {
                data.write(contents.as_ptr().cast());
            }
            if !bytes.is_null() {
                bytes.write(contents.len());
            }
        }
        Ok(())
    })
}

/// Frees a package; NULL is fine.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_package_destroy(package: *mut svbrdf_package) -> svbrdf_status {
    entry(|| {
        if !package.is_null() {
            PACKAGES.remove(package.addr())?;
        }
        Ok(())
    })
}
