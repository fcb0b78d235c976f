//! Options of a session.

use std::ffi::c_void;

use engine::calibration::Target;
use engine::geometry::Camera;
use engine::observation::Falloff;
use engine::session::{Driver, Method, RectifiedFalloff, RestoreOptions, Scene, Settings};
use glam::DVec3;

use super::board::{svbrdf_board, svbrdf_camera};
use super::callbacks::{svbrdf_maps_callback, svbrdf_progress_callback};
use crate::capture::svbrdf_capture;
use crate::log::svbrdf_log_callback;
use crate::models::svbrdf_models;
use crate::status::{Fault, entry, svbrdf_status};
use crate::values::{truth, unknown};
use crate::versioned::{self, versioned};

/// Content of the photos.
pub type svbrdf_scene = u32;
/// The sample inside a printed board: svbrdf_session_add_photo().
pub const SVBRDF_SCENE_BOARD: svbrdf_scene = 1;
/// The sample's top view, camera and light given: svbrdf_session_add_rectified_photo().
pub const SVBRDF_SCENE_RECTIFIED: svbrdf_scene = 2;

/// Method of the fit.
pub type svbrdf_method = u32;
/// Networks, then per-texel refinement.
pub const SVBRDF_METHOD_DEEP: svbrdf_method = 1;
/// Inverse rendering directly on the maps: a baseline.
pub const SVBRDF_METHOD_CLASSIC: svbrdf_method = 2;

/// Light of rectified photos.
pub type svbrdf_falloff = u32;
/// Inverse square; a white surface facing the light at the first camera's distance comes out at 1.
pub const SVBRDF_FALLOFF_AUTO: svbrdf_falloff = 1;
/// Inverse square with light_power in mm² (irradiance at 1 mm).
pub const SVBRDF_FALLOFF_INVERSE_SQUARE: svbrdf_falloff = 2;
/// The same irradiance light_power at every texel; pi: a white texel facing it comes out at 1.
pub const SVBRDF_FALLOFF_NONE: svbrdf_falloff = 3;

/// Options of a session. Memory behind their pointers is needed only during the call, except user_data.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_session_options {
    /// Size of this struct.
    pub size: usize,
    /// One of SVBRDF_SCENE_. Default: a board.
    pub scene: svbrdf_scene,
    /// Texels along each side of the maps: 256, 512, 1024 or 2048. Default: 256.
    pub resolution: u32,
    /// Width and height of the sample, mm. Default: 100 x 100.
    pub sample_mm: [f32; 2],
    /// One of SVBRDF_METHOD_. Default: deep.
    pub method: svbrdf_method,
    /// 1: the per-texel refinement runs. Default: 1.
    pub refine: u32,
    /// Threads of the fit, at most 64; 0: one per core, at most 4.
    pub threads: u32,
    /// For rectified photos: one of SVBRDF_FALLOFF_. Default: auto.
    pub falloff: svbrdf_falloff,
    /// For rectified photos: strength of the light per channel, see SVBRDF_FALLOFF_.
    pub light_power: [f32; 3],
    /// 0.
    pub reserved: u32,
    /// The board; NULL: the default one.
    pub board: *const svbrdf_board,
    /// The camera of all photos; NULL: estimated from the photos so far.
    pub camera: *const svbrdf_camera,
    /// Position of the flash in the camera frame (x right, y down, z forward), three numbers, mm; NULL:
    /// at the camera's centre until the photos determine it.
    pub flash_offset_mm: *const f64,
    /// Models; NULL: those inside the library.
    pub models: *const svbrdf_models,
    /// A capture whose scene, sample, board, camera, flash and falloff take the place of those
    /// above; NULL: none. The session does not need it after the call.
    pub capture: *const svbrdf_capture,
    /// Called on the session's callback thread, or NULL.
    pub on_progress: svbrdf_progress_callback,
    /// Called on the session's callback thread, or NULL.
    pub on_maps: svbrdf_maps_callback,
    /// Called with log lines, or NULL.
    pub on_log: svbrdf_log_callback,
    /// Passed to the callbacks.
    pub user_data: *mut c_void,
    /// Limit of the session's memory by its own estimate, bytes; 0: no limit. Includes copies of photos
    /// that svbrdf_session_add_photo_async() holds, but not the models (about 30 MB, shared by all
    /// sessions). Calls that would need more return SVBRDF_MEMORY_LIMIT.
    pub memory_limit_bytes: u64,
    /// For a board: height of the sample's surface above the printed side, -5 to 20 mm. Default: NaN,
    /// estimated from the photos.
    pub elevation_mm: f64,
}

impl Default for svbrdf_session_options {
    fn default() -> Self {
        let settings = Settings::default();
        Self {
            scene: SVBRDF_SCENE_BOARD,
            resolution: settings.resolution as u32,
            sample_mm: settings.sample_mm,
            method: SVBRDF_METHOD_DEEP,
            refine: settings.refine.into(),
            threads: settings.threads as u32,
            falloff: SVBRDF_FALLOFF_AUTO,
            elevation_mm: f64::NAN,
            ..versioned::zeroed()
        }
    }
}
versioned!(svbrdf_session_options, size_of::<svbrdf_session_options>());

/// Fills options with defaults: pass sizeof(svbrdf_session_options).
///
/// # Safety
/// `options` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_options_init(
    options: *mut svbrdf_session_options,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(options, size) })
}

/// Most threads a session may ask for.
const MAX_THREADS: u32 = 64;

impl svbrdf_session_options {
    fn threads(&self) -> Result<usize, Fault> {
        if self.threads > MAX_THREADS {
            let message = format!("threads: {} given, at most {MAX_THREADS}", self.threads);
            return Err(Fault::argument(message));
        }
        Ok(self.threads as usize)
    }

    fn memory_limit(&self) -> Option<u64> {
        (self.memory_limit_bytes > 0).then_some(self.memory_limit_bytes)
    }

    /// The options that apply to a restored session.
    pub(crate) fn for_restoring(&self) -> Result<RestoreOptions, Fault> {
        let threads = self.threads()?;
        let threads = (threads > 0).then_some(threads);
        Ok(RestoreOptions {
            threads,
            memory_limit_bytes: self.memory_limit(),
            ..Default::default()
        })
    }

    pub(crate) fn settings(&self) -> Result<Settings, Fault> {
        Ok(Settings {
            sample_mm: self.sample_mm,
            resolution: self.resolution as usize,
            method: match self.method {
                SVBRDF_METHOD_DEEP => Method::Deep,
                SVBRDF_METHOD_CLASSIC => Method::Classic,
                other => return Err(unknown("method", other)),
            },
            refine: truth("refine", self.refine)?,
            threads: self.threads()?,
            memory_limit_bytes: self.memory_limit(),
            driver: Driver::Thread,
        })
    }

    /// # Safety
    /// `board`, `camera` and `flash_offset_mm` are NULL or as the header requires.
    pub(crate) unsafe fn scene(&self) -> Result<Scene, Fault> {
        match self.scene {
            SVBRDF_SCENE_BOARD => {
                // SAFETY: the caller vouches for each pointer that is not NULL.
                let (target, camera, flash) = unsafe {
                    let target = match self.board.is_null() {
                        true => Target::default(),
                        false => versioned::read(self.board)?.target()?,
                    };
                    let flash = self.flash_offset_mm.cast::<[f64; 3]>();
                    let flash = (!flash.is_null()).then(|| flash.read_unaligned());
                    let camera = match self.camera.is_null() {
                        true => None,
                        false => Some(versioned::read(self.camera)?),
                    };
                    (target, camera, flash)
                };
                let camera = camera.map(|camera| Camera {
                    width: camera.width,
                    height: camera.height,
                    fx: camera.fx,
                    fy: camera.fy,
                    cx: camera.cx,
                    cy: camera.cy,
                    distortion: camera.distortion,
                });
                let flash_offset_mm = flash.map(DVec3::from_array);
                let elevation_mm = Some(self.elevation_mm).filter(|mm| !mm.is_nan());
                Ok(Scene::Board { target, camera, flash_offset_mm, elevation_mm })
            }
            SVBRDF_SCENE_RECTIFIED => Ok(Scene::Rectified { falloff: self.falloff()? }),
            other => Err(unknown("scene", other)),
        }
    }

    fn falloff(&self) -> Result<RectifiedFalloff, Fault> {
        let power = self.light_power;
        if self.falloff != SVBRDF_FALLOFF_AUTO && !power.iter().all(|v| v.is_finite() && *v > 0.0) {
            return Err(Fault::argument("light_power: three positive numbers are expected"));
        }
        match self.falloff {
            SVBRDF_FALLOFF_AUTO => Ok(RectifiedFalloff::InverseSquareAuto),
            SVBRDF_FALLOFF_INVERSE_SQUARE => {
                Ok(RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2: power }))
            }
            SVBRDF_FALLOFF_NONE => Ok(RectifiedFalloff::Given(Falloff::None { power })),
            other => Err(unknown("falloff", other)),
        }
    }
}
