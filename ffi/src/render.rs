//! Maps under a light.

use std::f32::consts::PI;
use std::ffi::c_void;

use engine::observation::{Falloff, View};
use engine::render::render;

use crate::maps::{self, svbrdf_maps};
use crate::options::{SVBRDF_FALLOFF_INVERSE_SQUARE, SVBRDF_FALLOFF_NONE, svbrdf_falloff};
use crate::status::{Fault, entry, svbrdf_status};
use crate::texels::{Coding, Layout, Picture, interleave, svbrdf_map_format};
use crate::values::unknown;
use crate::versioned::{self, defaults, versioned};

/// Camera and light of a rendering. Positions: mm from the sample's centre, X right, Y up, Z towards
/// the camera.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_render_options {
    /// Size of this struct.
    pub size: usize,
    /// Position of the camera; its Z is positive. Default: 300 mm above the centre.
    pub camera_mm: [f32; 3],
    /// Position of the light; its Z is positive. Default: as the camera's.
    pub light_mm: [f32; 3],
    /// Strength of the light per channel, see SVBRDF_FALLOFF_. Default: pi.
    pub light_power: [f32; 3],
    /// Radiance of uniform surroundings per channel, in the same units. Default: 0.
    pub ambient: [f32; 3],
    /// SVBRDF_FALLOFF_NONE, the default, or SVBRDF_FALLOFF_INVERSE_SQUARE.
    pub falloff: svbrdf_falloff,
    /// 0.
    pub reserved: u32,
}

defaults!(svbrdf_render_options {
    camera_mm: [0.0, 0.0, 300.0],
    light_mm: [0.0, 0.0, 300.0],
    light_power: [PI; 3],
    falloff: SVBRDF_FALLOFF_NONE,
});
versioned!(svbrdf_render_options, size_of::<svbrdf_render_options>());

/// Fills options with defaults: pass sizeof(svbrdf_render_options).
///
/// # Safety
/// `options` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_render_options_init(
    options: *mut svbrdf_render_options,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(options, size) })
}

impl svbrdf_render_options {
    fn view(&self, sample_mm: [f32; 2]) -> Result<View, Fault> {
        for (name, position) in [("camera_mm", self.camera_mm), ("light_mm", self.light_mm)] {
            if !position.iter().all(|v| v.is_finite()) || position[2] <= 0.0 {
                return Err(Fault::argument(format!(
                    "svbrdf_render_options.{name}: three numbers, the third positive, are expected"
                )));
            }
        }
        for (name, light) in [("light_power", self.light_power), ("ambient", self.ambient)] {
            if !light.iter().all(|v| v.is_finite() && *v >= 0.0) {
                return Err(Fault::argument(format!(
                    "svbrdf_render_options.{name}: three numbers of at least 0 are expected"
                )));
            }
        }
        let falloff = match self.falloff {
            SVBRDF_FALLOFF_NONE => Falloff::None { power: self.light_power },
            SVBRDF_FALLOFF_INVERSE_SQUARE => Falloff::InverseSquare { power_mm2: self.light_power },
            other => return Err(unknown("svbrdf_render_options.falloff", other)),
        };
        let (camera_mm, light_mm, ambient) = (self.camera_mm, self.light_mm, self.ambient);
        Ok(View { sample_mm, camera_mm, light_mm, falloff, ambient, ..View::default() })
    }
}

/// Three planes of radiances.
struct Rendering {
    width: usize,
    height: usize,
    rgb: Vec<f32>,
}

impl Picture for Rendering {
    fn width(&self) -> usize {
        self.width
    }

    fn height(&self) -> usize {
        self.height
    }

    fn single(&self) -> Option<usize> {
        None
    }

    fn coding(&self) -> Coding {
        Coding::Srgb
    }

    fn row(&self, y: usize, out: &mut [[f32; 4]]) {
        let row = |c: usize| &self.rgb[(c * self.height + y) * self.width..][..self.width];
        interleave([row(0), row(1), row(2)], out);
    }
}

/// Renders maps as the fit does: the radiance of each texel towards the camera, at the texel's place,
/// by Cook-Torrance with GGX. Bytes are sRGB and clipped; floats are linear, and 1 is a white matt
/// texel that faces a light of power pi. All formats except SVBRDF_MAP_FORMAT_R8; rows as in
/// svbrdf_maps_copy(). `options` NULL: the defaults. Takes a millisecond or two at 256 x 256: reduce
/// large maps to show them under a moving light.
///
/// # Safety
/// `options` is NULL or initialised by svbrdf_render_options_init(); `data` is NULL or has `bytes`
/// writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_maps_render(
    maps: *const svbrdf_maps,
    options: *const svbrdf_render_options,
    format: svbrdf_map_format,
    data: *mut c_void,
    bytes: usize,
    row_stride: usize,
) -> svbrdf_status {
    entry(|| {
        let (maps, sample_mm) = maps::shared(maps)?;
        // SAFETY: the caller vouches for the struct.
        let options = unsafe { versioned::read_or_default(options) }?;
        let view = options.view(sample_mm)?;
        let mut picture = Rendering { width: maps.width(), height: maps.height(), rgb: Vec::new() };
        let layout = Layout::new(format, &picture)?;
        picture.rgb.resize(3 * maps.texels(), 0.0);
        render(&maps, &view, &mut picture.rgb);
        // SAFETY: the caller vouches for the bytes.
        unsafe { layout.copy(&picture, data, bytes, row_stride) }
    })
}
