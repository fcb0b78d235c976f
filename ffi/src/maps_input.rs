//! Maps of values that a caller has.

use std::sync::Arc;

use engine::Svbrdf;
use engine::svbrdf::{CHANNELS, MAX_SLOPE, gltf};

use crate::maps::{self, svbrdf_maps};
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Longest side of maps that are taken, texels: that of maps that are read.
const MAX_SIDE: u32 = 4096;

/// Values of maps, each as svbrdf_maps_view() gives it with SVBRDF_MAP_FORMAT_F32: row by row without
/// gaps. Needed during the call only.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_maps_input {
    /// Size of this struct.
    pub size: usize,
    /// Texels in a row, 1 to 4096.
    pub width: u32,
    /// Rows, 1 to 4096.
    pub height: u32,
    /// Width and height of the sample, mm. Default: 100 x 100.
    pub sample_mm: [f32; 2],
    /// SVBRDF_MAP_NORMAL: three floats a texel, Z above 0. Slopes are limited to 3 (71.6 degrees).
    pub normal: *const f32,
    /// SVBRDF_MAP_DIFFUSE: three floats a texel, 0 to 1.
    pub diffuse: *const f32,
    /// SVBRDF_MAP_SPECULAR: three floats a texel, 0 to 1.
    pub specular: *const f32,
    /// SVBRDF_MAP_ROUGHNESS: one float a texel, 0 to 1.
    pub roughness: *const f32,
    /// SVBRDF_MAP_ANISOTROPY: three floats a texel, strength 0 to 1. Ratios of alpha are limited to 20.
    /// NULL, the default: isotropic.
    pub anisotropy: *const f32,
    /// SVBRDF_MAP_COAT: three floats a texel, 0 to 1; the third is not used. NULL, the default: none.
    pub coat: *const f32,
    /// SVBRDF_MAP_SHEEN: three floats a texel, 0 to 1. NULL, the default: none.
    pub sheen: *const f32,
    /// SVBRDF_MAP_SHEEN_ROUGHNESS: one float a texel, 0 to 1. NULL if and only if `sheen` is.
    pub sheen_roughness: *const f32,
}

defaults!(svbrdf_maps_input { sample_mm: [100.0; 2] });
versioned!(svbrdf_maps_input, size_of::<svbrdf_maps_input>());

/// Fills values with defaults: pass sizeof(svbrdf_maps_input).
///
/// # Safety
/// `input` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_input_init(
    input: *mut svbrdf_maps_input,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(input, size) })
}

/// Copies a caller's texels of `CHANNELS` floats from `low` to `high`.
///
/// # Safety
/// `data` is NULL or has `count` readable texels.
unsafe fn texels<const CHANNELS: usize>(
    name: &str,
    data: *const f32,
    count: usize,
    [low, high]: [f32; 2],
) -> Result<Vec<[f32; CHANNELS]>, Fault> {
    let fault = |what: String| {
        Fault::argument(format!("svbrdf_maps_input.{name}: {what} given, {low} to {high} expected"))
    };
    if data.is_null() {
        return Err(fault("NULL".into()));
    }
    let mut values = vec![[0.0; CHANNELS]; count];
    let bytes = size_of_val(values.as_slice());
    // SAFETY: both have so many bytes, whatever the caller's alignment.
    unsafe {
        data.cast::<u8>().copy_to_nonoverlapping(values.as_mut_ptr().cast(), bytes);
    }
    // Unit vectors may be rounded.
    let slack = if low < 0.0 { 1e-3 } else { 0.0 };
    let allowed = low - slack..=high + slack;
    match values.as_flattened().iter().find(|v| !allowed.contains(*v)) {
        Some(value) => Err(fault(value.to_string())),
        None => Ok(values),
    }
}

impl svbrdf_maps_input {
    /// # Safety
    /// Each map is NULL or has as many texels as width and height say.
    unsafe fn maps(&self) -> Result<Svbrdf, Fault> {
        for (name, side) in [("width", self.width), ("height", self.height)] {
            if !(1..=MAX_SIDE).contains(&side) {
                let message =
                    format!("svbrdf_maps_input.{name}: {side} given, 1 to {MAX_SIDE} expected");
                return Err(Fault::argument(message));
            }
        }
        if !self.sample_mm.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
            let given = self.sample_mm;
            let message = format!(
                "svbrdf_maps_input.sample_mm: {given:?} given, two positive lengths expected"
            );
            return Err(Fault::argument(message));
        }
        let (width, height) = (self.width as usize, self.height as usize);
        let n = width * height;
        let (unit, signed) = ([0.0, 1.0], [-1.0, 1.0]);
        // SAFETY: the caller vouches for the texels, here and below.
        let normal = unsafe { texels::<3>("normal", self.normal, n, signed) }?;
        if normal.iter().any(|n| n[2] <= 0.0) {
            let message = "svbrdf_maps_input.normal: normals with Z above 0 are expected";
            return Err(Fault::argument(message));
        }
        // SAFETY: as above.
        let (diffuse, specular, roughness) = unsafe {
            (
                texels::<3>("diffuse", self.diffuse, n, unit)?,
                texels::<3>("specular", self.specular, n, unit)?,
                texels::<1>("roughness", self.roughness, n, unit)?,
            )
        };
        // SAFETY: as above.
        let (anisotropy, coat, sheen) =
            unsafe { (self.anisotropy(n)?, self.coat(n)?, self.sheen(n)?) };
        let mut planes = Vec::with_capacity(CHANNELS * n);
        for axis in 0..2 {
            let slopes = normal.iter().map(|n| (n[axis] / n[2]).clamp(-MAX_SLOPE, MAX_SLOPE));
            planes.extend(slopes);
        }
        for colours in [&diffuse, &specular] {
            for c in 0..3 {
                planes.extend(colours.iter().map(|rgb| rgb[c]));
            }
        }
        planes.extend(roughness.as_flattened());
        let mut maps = Svbrdf::from_planes(width, height, planes)?;
        let coat = coat.map(|texels| texels.into_iter().map(|[weight, r, _]| [weight, r]));
        let (anisotropy, sheen) = (anisotropy.map(Vec::into_iter), sheen.map(Vec::into_iter));
        gltf::add_lobes(&mut maps, anisotropy, coat, sheen)?;
        Ok(maps)
    }

    /// # Safety
    /// As [`Self::maps`].
    unsafe fn anisotropy(&self, n: usize) -> Result<Option<Vec<[f32; 3]>>, Fault> {
        if self.anisotropy.is_null() {
            return Ok(None);
        }
        // SAFETY: as the caller vouches.
        let given = unsafe { texels::<3>("anisotropy", self.anisotropy, n, [-1.0, 1.0]) }?;
        if given.iter().any(|[_, _, strength]| !(0.0..=1.0).contains(strength)) {
            let message = "svbrdf_maps_input.anisotropy: strengths of 0 to 1 are expected";
            return Err(Fault::argument(message));
        }
        Ok(Some(given))
    }

    /// # Safety
    /// As [`Self::maps`].
    unsafe fn coat(&self, n: usize) -> Result<Option<Vec<[f32; 3]>>, Fault> {
        if self.coat.is_null() {
            return Ok(None);
        }
        // SAFETY: as the caller vouches.
        unsafe { texels("coat", self.coat, n, [0.0, 1.0]) }.map(Some)
    }

    /// # Safety
    /// As [`Self::maps`].
    unsafe fn sheen(&self, n: usize) -> Result<Option<Vec<[f32; 4]>>, Fault> {
        if self.sheen.is_null() && self.sheen_roughness.is_null() {
            return Ok(None);
        }
        // SAFETY: as the caller vouches.
        let (colour, roughness) = unsafe {
            (
                texels::<3>("sheen", self.sheen, n, [0.0, 1.0])?,
                texels::<1>("sheen_roughness", self.sheen_roughness, n, [0.0, 1.0])?,
            )
        };
        let texels = colour.into_iter().zip(roughness);
        Ok(Some(texels.map(|([r, g, b], [roughness])| [r, g, b, roughness]).collect()))
    }
}

/// Maps of values in memory, to be rendered, reduced or exported. Free with svbrdf_maps_destroy().
///
/// # Safety
/// `input` was initialised by svbrdf_maps_input_init(), and its maps are NULL or as large as it says;
/// `out` is NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_from_memory(
    input: *const svbrdf_maps_input,
    out: *mut *mut svbrdf_maps,
) -> svbrdf_status {
    entry(|| {
        if out.is_null() {
            return Err(Fault::argument("out: NULL given"));
        }
        // SAFETY: the caller vouches for the struct.
        let input = unsafe { versioned::read(input) }?;
        // SAFETY: the caller vouches for the maps.
        let maps = Arc::new(unsafe { input.maps() }?);
        // SAFETY: not NULL, and the caller vouches for the rest.
        unsafe { out.write(maps::hand_out(maps, input.sample_mm)) };
        Ok(())
    })
}
