//! Maps at one moment, handed out as planes or files.

use std::ffi::{CStr, c_char, c_void};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use engine::Svbrdf;
use engine::export::{MapsOptions, write_maps, write_preview};
use engine::svbrdf::gltf::{self, Shown};
use engine::svbrdf::lobe;
use engine::uncertainty::Uncertainty;

use crate::handles::Handles;
use crate::status::{Fault, SVBRDF_NO_LOBE, entry, svbrdf_status};
use crate::texels::{Coding, FORMATS, Layout, Picture, interleave, svbrdf_map_format};
use crate::values::unknown;
use crate::versioned::{self, defaults, versioned};

/// Maps as they were when svbrdf_session_snapshot_maps() was called. They do not need the session.
pub struct svbrdf_maps {
    _opaque: (),
}

/// One of the maps. Row 0 is the sample's +Y edge, column 0 its -X edge.
pub type svbrdf_map = u32;
/// Unit normal, X right, Y up (OpenGL, glTF), Z out of the surface; 8 bits: (n + 1) / 2.
pub const SVBRDF_MAP_NORMAL: svbrdf_map = 1;
/// Diffuse albedo, linear Rec. 709; 8 bits: with the sRGB curve, as glTF's base colour.
pub const SVBRDF_MAP_DIFFUSE: svbrdf_map = 2;
/// Specular albedo F0, linear Rec. 709; 8 bits: with the sRGB curve.
pub const SVBRDF_MAP_SPECULAR: svbrdf_map = 3;
/// Roughness, GGX alpha = roughness²; 8 bits: R 255 (occlusion), G roughness, B 0 (metalness),
/// linear: glTF's occlusion-roughness-metalness. Where the material is anisotropic: of the smaller alpha.
pub const SVBRDF_MAP_ROUGHNESS: svbrdf_map = 4;
/// As SVBRDF_MAP_NORMAL with Y down (DirectX, Unreal).
pub const SVBRDF_MAP_NORMAL_DIRECTX: svbrdf_map = 5;
/// Anisotropy as glTF's KHR_materials_anisotropy states it. Three values: cosine and sine of the direction
/// of the larger alpha, counter-clockwise from X, and strength. Alpha along the direction is
/// mix(alpha, 1, strength²), alpha across it that of SVBRDF_MAP_ROUGHNESS; opposite directions mean the
/// same. 8 bits: (cosine + 1) / 2, (sine + 1) / 2, strength, linear. SVBRDF_NO_LOBE where the material is
/// isotropic.
pub const SVBRDF_MAP_ANISOTROPY: svbrdf_map = 6;
/// A coat above everything else, as glTF's KHR_materials_clearcoat states it: a dielectric with F0 .04.
/// Three values: weight, roughness, 0, linear. SVBRDF_NO_LOBE where the material has none.
pub const SVBRDF_MAP_COAT: svbrdf_map = 7;
/// Colour of sheen between the coat and everything else, as glTF's KHR_materials_sheen states it: linear Rec. 709;
/// 8 bits: with the sRGB curve. SVBRDF_NO_LOBE where the material has none.
pub const SVBRDF_MAP_SHEEN: svbrdf_map = 8;
/// Roughness of the sheen: one value, which formats of three channels repeat, linear. SVBRDF_NO_LOBE as for
/// SVBRDF_MAP_SHEEN.
pub const SVBRDF_MAP_SHEEN_ROUGHNESS: svbrdf_map = 9;

/// Optional lobes of a material: an OR of SVBRDF_LOBE_ values. Some may be added.
pub type svbrdf_lobes = u32;
/// The specular lobe is anisotropic: there is SVBRDF_MAP_ANISOTROPY.
pub const SVBRDF_LOBE_ANISOTROPY: svbrdf_lobes = 1;
/// There is a coat: SVBRDF_MAP_COAT.
pub const SVBRDF_LOBE_COAT: svbrdf_lobes = 2;
/// There is sheen: SVBRDF_MAP_SHEEN and SVBRDF_MAP_SHEEN_ROUGHNESS.
pub const SVBRDF_LOBE_SHEEN: svbrdf_lobes = 4;

/// A map in memory of the library.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_map_view {
    /// Size of this struct.
    pub size: usize,
    /// First texel, row by row; valid until svbrdf_maps_destroy(). Aligned for floats.
    pub data: *const c_void,
    /// Bytes of all rows.
    pub bytes: usize,
    /// Bytes from a row to the next.
    pub row_stride: usize,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Channels of a texel: 1, 3 or 4.
    pub channels: u32,
    /// 0.
    pub reserved: u32,
}

defaults!(svbrdf_map_view {});
versioned!(svbrdf_map_view, size_of::<svbrdf_map_view>());

/// Fills a view with defaults: pass sizeof(svbrdf_map_view).
///
/// # Safety
/// `view` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_map_view_init(
    view: *mut svbrdf_map_view,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(view, size) })
}

/// A map in one format.
struct Plane {
    /// Words, so that floats are aligned.
    words: Vec<u32>,
    bytes: usize,
}

const MAP_COUNT: usize = 9;

pub(crate) struct Maps {
    maps: Arc<Svbrdf>,
    sample_mm: [f32; 2],
    uncertainty: Option<Uncertainty>,
    /// Deviations of lobes with several channels, from SVBRDF_MAP_ANISOTROPY on, made when first asked for.
    lobe_deviations: [OnceLock<Vec<f32>>; 3],
    /// Found when first asked for.
    shown: OnceLock<Shown>,
    /// Made when first asked for.
    views: [[OnceLock<Plane>; FORMATS]; MAP_COUNT],
}

static MAPS: Handles<Maps> = Handles::new("maps");

/// A handle for maps.
pub(crate) fn hand_out(maps: Arc<Svbrdf>, sample_mm: [f32; 2]) -> *mut svbrdf_maps {
    insert(maps, sample_mm, None)
}

/// Hands out maps with their standard deviations.
pub(crate) fn hand_out_with_uncertainty(
    maps: Arc<Svbrdf>,
    sample_mm: [f32; 2],
    uncertainty: Uncertainty,
) -> *mut svbrdf_maps {
    insert(maps, sample_mm, Some(uncertainty))
}

fn insert(
    maps: Arc<Svbrdf>,
    sample_mm: [f32; 2],
    uncertainty: Option<Uncertainty>,
) -> *mut svbrdf_maps {
    let handle = Handles::<Maps>::reserve();
    let (lobe_deviations, shown, views) = Default::default();
    let maps = Maps { maps, sample_mm, uncertainty, lobe_deviations, shown, views };
    MAPS.insert(handle, Arc::new(maps));
    std::ptr::without_provenance_mut(handle)
}

/// The value behind a handle.
pub(crate) fn get(maps: *const svbrdf_maps) -> Result<Arc<Maps>, Fault> {
    MAPS.get(maps.addr())
}

/// The maps behind a handle and the size of their sample, mm.
pub(crate) fn shared(maps: *const svbrdf_maps) -> Result<(Arc<Svbrdf>, [f32; 2]), Fault> {
    let maps = MAPS.get(maps.addr())?;
    Ok((Arc::clone(&maps.maps), maps.sample_mm))
}

/// A caller's folder name.
///
/// # Safety
/// NULL or a C string, unchanged while the result is used.
pub(crate) unsafe fn folder<'a>(path: *const c_char) -> Result<&'a Path, Fault> {
    if path.is_null() {
        return Err(Fault::argument("path: NULL given"));
    }
    // SAFETY: not NULL, and the caller vouches for the rest.
    let text = unsafe { CStr::from_ptr(path) };
    match text.to_str() {
        Ok("") => Err(Fault::argument("path: empty")),
        Ok(text) => Ok(Path::new(text)),
        Err(_) => Err(Fault::argument("path: not UTF-8")),
    }
}

/// Writes the maps themselves and a preview, as svbrdf_maps_export() without options.
pub(crate) fn export(maps: &Maps, dir: &Path) -> Result<(), Fault> {
    let uncertainty = maps.uncertainty.as_ref();
    let options = MapsOptions { sample_mm: Some(maps.sample_mm), uncertainty };
    write_maps(dir, &maps.maps, &options)?;
    Ok(write_preview(dir.join("preview.png"), &maps.maps, maps.sample_mm)?)
}

/// One of the maps as an image.
struct MapPicture<'a> {
    maps: &'a Svbrdf,
    map: svbrdf_map,
    /// See [`Shown::anisotropy`].
    mean_angle: f32,
}

impl<'a> MapPicture<'a> {
    fn new(maps: &'a Maps, map: svbrdf_map) -> Result<Self, Fault> {
        let missing = |lobe| Fault::new(SVBRDF_NO_LOBE, format!("map: the material has no {lobe}"));
        match map {
            SVBRDF_MAP_NORMAL..=SVBRDF_MAP_NORMAL_DIRECTX => {}
            SVBRDF_MAP_ANISOTROPY => {}
            SVBRDF_MAP_COAT if maps.shown().coat => {}
            SVBRDF_MAP_COAT => return Err(missing("coat")),
            SVBRDF_MAP_SHEEN | SVBRDF_MAP_SHEEN_ROUGHNESS if maps.shown().sheen => {}
            SVBRDF_MAP_SHEEN | SVBRDF_MAP_SHEEN_ROUGHNESS => return Err(missing("sheen")),
            _ => return Err(unknown("map", map)),
        }
        let mean_angle = match map {
            SVBRDF_MAP_ANISOTROPY => {
                maps.shown().anisotropy.ok_or_else(|| missing("anisotropy"))?
            }
            _ => 0.0,
        };
        Ok(Self { maps: &maps.maps, map, mean_angle })
    }

    fn plane(&self, layout: &Layout) -> Plane {
        let bytes = layout.row_bytes(self) * self.maps.height();
        let mut words = vec![0_u32; bytes.div_ceil(size_of::<u32>())];
        // SAFETY: `words` has that many bytes.
        unsafe { layout.copy(self, words.as_mut_ptr().cast(), bytes, 0) }.expect("rows that fit");
        Plane { words, bytes }
    }
}

impl Picture for MapPicture<'_> {
    fn width(&self) -> usize {
        self.maps.width()
    }

    fn height(&self) -> usize {
        self.maps.height()
    }

    /// Roughness stands where glTF's occlusion-roughness-metalness has it.
    fn single(&self) -> Option<usize> {
        [SVBRDF_MAP_ROUGHNESS, SVBRDF_MAP_SHEEN_ROUGHNESS].contains(&self.map).then_some(1)
    }

    fn coding(&self) -> Coding {
        match self.map {
            SVBRDF_MAP_NORMAL | SVBRDF_MAP_NORMAL_DIRECTX => Coding::Signed,
            SVBRDF_MAP_ROUGHNESS | SVBRDF_MAP_COAT | SVBRDF_MAP_SHEEN_ROUGHNESS => Coding::Linear,
            SVBRDF_MAP_ANISOTROPY => Coding::Direction,
            _ => Coding::Srgb,
        }
    }

    fn row(&self, y: usize, out: &mut [[f32; 4]]) {
        let (maps, width) = (self.maps, self.maps.width());
        match self.map {
            SVBRDF_MAP_NORMAL | SVBRDF_MAP_NORMAL_DIRECTX => {
                let up = if self.map == SVBRDF_MAP_NORMAL { 1.0 } else { -1.0 };
                for (x, out) in out.iter_mut().enumerate() {
                    let [r, g, b] = maps.normal(x, y);
                    *out = [r, up * g, b, 1.0];
                }
            }
            SVBRDF_MAP_ROUGHNESS if maps.lobes().is_empty() => {
                for (out, roughness) in out.iter_mut().zip(&maps.roughness()[y * width..]) {
                    *out = [1.0, *roughness, 0.0, 1.0];
                }
            }
            SVBRDF_MAP_ROUGHNESS => {
                for (out, texel) in out.iter_mut().zip(y * width..) {
                    *out = [1.0, gltf::roughness(maps, texel), 0.0, 1.0];
                }
            }
            SVBRDF_MAP_ANISOTROPY => {
                for (out, texel) in out.iter_mut().zip(y * width..) {
                    let [cos, sin, strength] = gltf::anisotropy(maps, self.mean_angle, texel);
                    *out = [cos, sin, strength, 1.0];
                }
            }
            SVBRDF_MAP_COAT => {
                for (out, texel) in out.iter_mut().zip(y * width..) {
                    let [weight, roughness] = gltf::coat(maps, texel);
                    *out = [weight, roughness, 0.0, 1.0];
                }
            }
            SVBRDF_MAP_SHEEN | SVBRDF_MAP_SHEEN_ROUGHNESS => {
                for (out, texel) in out.iter_mut().zip(y * width..) {
                    let [r, g, b, roughness] = gltf::sheen(maps, texel);
                    let colour = self.map == SVBRDF_MAP_SHEEN;
                    *out = if colour {
                        [r, g, b, 1.0]
                    } else {
                        [roughness, roughness, roughness, 1.0]
                    };
                }
            }
            SVBRDF_MAP_DIFFUSE => {
                interleave(maps.diffuse().map(|plane| &plane[y * width..][..width]), out)
            }
            _ => interleave(maps.specular().map(|plane| &plane[y * width..][..width]), out),
        }
    }
}

impl Maps {
    /// Optional lobes that the material has.
    fn shown(&self) -> Shown {
        *self.shown.get_or_init(|| Shown::of(&self.maps))
    }

    /// The standard deviations, if the maps have them.
    pub(crate) fn uncertainty(&self) -> Result<&Uncertainty, Fault> {
        self.uncertainty.as_ref().ok_or_else(|| {
            Fault::argument(
                "maps: without uncertainty; see svbrdf_session_snapshot_with_uncertainty()",
            )
        })
    }

    /// Standard deviations of a map at every texel, and their number of channels.
    pub(crate) fn deviations(&self, map: svbrdf_map) -> Result<(&[f32], u32), Fault> {
        let uncertainty = self.uncertainty()?;
        // Unknown maps and absent lobes.
        MapPicture::new(self, map)?;
        let of = |lobe: usize| {
            let unknown = || Fault::new(SVBRDF_NO_LOBE, "map: the deviations are not known");
            uncertainty.lobe(lobe).ok_or_else(unknown)
        };
        let interleaved = |map: svbrdf_map, planes: [Option<&[f32]>; 3]| {
            let value = |texel| planes.map(|plane| plane.map_or(0.0, |plane| plane[texel]));
            let slot = &self.lobe_deviations[(map - SVBRDF_MAP_ANISOTROPY) as usize];
            slot.get_or_init(|| (0..self.maps.texels()).flat_map(value).collect())
        };
        let several = match map {
            SVBRDF_MAP_NORMAL | SVBRDF_MAP_NORMAL_DIRECTX => return Ok((uncertainty.normal(), 1)),
            SVBRDF_MAP_DIFFUSE => return Ok((uncertainty.diffuse(), 1)),
            SVBRDF_MAP_SPECULAR => return Ok((uncertainty.specular(), 1)),
            SVBRDF_MAP_ROUGHNESS => return Ok((uncertainty.roughness(), 1)),
            SVBRDF_MAP_SHEEN_ROUGHNESS => return Ok((of(lobe::SHEEN_ROUGHNESS)?, 1)),
            SVBRDF_MAP_ANISOTROPY => {
                [Some(of(lobe::ANISOTROPY_X)?), Some(of(lobe::ANISOTROPY_Y)?), None]
            }
            SVBRDF_MAP_COAT => [Some(of(lobe::COAT)?), Some(of(lobe::COAT_ROUGHNESS)?), None],
            _ => [Some(of(lobe::SHEEN)?), Some(of(lobe::SHEEN + 1)?), Some(of(lobe::SHEEN + 2)?)],
        };
        Ok((interleaved(map, several), 3))
    }
}

/// Width and height (texels), and width and height of the sample (two floats, mm). Results may be NULL.
///
/// # Safety
/// Each pointer is NULL or writable, `sample_mm` with two floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_size(
    maps: *const svbrdf_maps,
    width: *mut u32,
    height: *mut u32,
    sample_mm: *mut f32,
) -> svbrdf_status {
    entry(|| {
        let maps = MAPS.get(maps.addr())?;
        // SAFETY: the caller vouches for pointers that are not NULL.
        unsafe {
            if !width.is_null() {
                width.write(maps.maps.width() as u32);
            }
            if !height.is_null() {
                height.write(maps.maps.height() as u32);
            }
            if !sample_mm.is_null() {
                sample_mm.cast::<[f32; 2]>().write(maps.sample_mm);
            }
        }
        Ok(())
    })
}

/// Which optional lobes the material shows, and so which further maps there are: an OR of SVBRDF_LOBE_
/// values, 0 for most materials.
///
/// # Safety
/// `lobes` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_lobes(
    maps: *const svbrdf_maps,
    lobes: *mut svbrdf_lobes,
) -> svbrdf_status {
    entry(|| {
        let Shown { anisotropy, coat, sheen } = MAPS.get(maps.addr())?.shown();
        if lobes.is_null() {
            return Err(Fault::argument("lobes: NULL given"));
        }
        let bit = |shown: bool, value: svbrdf_lobes| if shown { value } else { 0 };
        let found = bit(anisotropy.is_some(), SVBRDF_LOBE_ANISOTROPY)
            | bit(coat, SVBRDF_LOBE_COAT)
            | bit(sheen, SVBRDF_LOBE_SHEEN);
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { lobes.write_unaligned(found) };
        Ok(())
    })
}

/// A map in memory of the library: made when first asked for, freed with the maps.
///
/// # Safety
/// `view` is NULL or was initialised by svbrdf_map_view_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_view(
    maps: *const svbrdf_maps,
    map: svbrdf_map,
    format: svbrdf_map_format,
    view: *mut svbrdf_map_view,
) -> svbrdf_status {
    entry(|| {
        let maps = MAPS.get(maps.addr())?;
        let picture = MapPicture::new(&maps, map)?;
        let layout = Layout::new(format, &picture)?;
        // SAFETY: the caller vouches for the struct.
        let size = unsafe { versioned::needed_size("view", view) }?;
        let slot = &maps.views[map as usize - 1][format as usize - 1];
        let plane = slot.get_or_init(|| picture.plane(&layout));
        let value = svbrdf_map_view {
            data: plane.words.as_ptr().cast(),
            bytes: plane.bytes,
            row_stride: layout.row_bytes(&picture),
            width: maps.maps.width() as u32,
            height: maps.maps.height() as u32,
            channels: layout.channels() as u32,
            ..Default::default()
        };
        // SAFETY: `size` bytes are there.
        unsafe { versioned::write(view, size, value) };
        Ok(())
    })
}

/// Copies a map into the caller's memory, in rows of `row_stride` bytes (0: no gap). The last row may
/// end with its last texel. Any alignment.
///
/// # Safety
/// `data` is NULL or has `bytes` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_copy(
    maps: *const svbrdf_maps,
    map: svbrdf_map,
    format: svbrdf_map_format,
    data: *mut c_void,
    bytes: usize,
    row_stride: usize,
) -> svbrdf_status {
    entry(|| {
        let maps = MAPS.get(maps.addr())?;
        let picture = MapPicture::new(&maps, map)?;
        // SAFETY: the caller vouches for the bytes.
        unsafe { Layout::new(format, &picture)?.copy(&picture, data, bytes, row_stride) }
    })
}

/// Frees maps and every view of them; NULL is fine.
#[unsafe(no_mangle)]
pub extern "C" fn svbrdf_maps_destroy(maps: *mut svbrdf_maps) -> svbrdf_status {
    entry(|| {
        if !maps.is_null() {
            MAPS.remove(maps.addr())?;
        }
        Ok(())
    })
}
