//! Options of a session and of a photo.

use std::ffi::{CStr, c_char, c_void};
use std::mem::offset_of;

use engine::calibration::{Hole, Target, TargetKind, TopLeft};
use engine::frame::Photo;
use engine::geometry::Camera;
use engine::observation::Falloff;
use engine::session::{Method, RectifiedFalloff, RestoreOptions, Scene, Settings};
use glam::DVec3;

use crate::image::svbrdf_image;
use crate::models::svbrdf_models;
use crate::reports::svbrdf_progress;
use crate::session::svbrdf_session;
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, versioned};

/// Kind of board.
pub type svbrdf_board_kind = u32;
/// A checkerboard with a rectangular hole for the sample.
pub const SVBRDF_BOARD_CHECKERBOARD_RING: svbrdf_board_kind = 1;
/// The same with an ArUco marker in every printed white square.
pub const SVBRDF_BOARD_CHARUCO_RING: svbrdf_board_kind = 2;

/// The printed board round the sample.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_board {
    /// Size of this struct.
    pub size: usize,
    /// One of SVBRDF_BOARD_.
    pub kind: svbrdf_board_kind,
    /// Rows of squares, the hole's included; rows + cols is odd.
    pub rows: u32,
    /// Columns of squares, the hole's included.
    pub cols: u32,
    /// First row of the hole, counted from the printed top.
    pub hole_row_start: u32,
    /// First column of the hole, counted from the left.
    pub hole_col_start: u32,
    /// Row after the hole's last.
    pub hole_row_end: u32,
    /// Column after the hole's last.
    pub hole_col_end: u32,
    /// 1 when the printed top-left square is white, 0 when it is black.
    pub top_left_white: u32,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Diffuse albedo of white squares.
    pub white_albedo: f64,
    /// Diffuse albedo of black squares.
    pub black_albedo: f64,
    /// For ChArUco: side of a marker, mm.
    pub marker_mm: f64,
    /// For ChArUco: OpenCV's dictionary name, e.g. "DICT_4X4_250"; needed during the call only.
    pub dictionary: *const c_char,
    /// Whether black, gray and white patches are printed below the ring as `svbrdf board` does, 0
    /// or 1: they tell whether photos are linear. Default: 1; set 0 for boards from elsewhere.
    pub patches: u32,
    /// 0.
    pub reserved: u32,
}

impl Default for svbrdf_board {
    fn default() -> Self {
        let target = Target::default();
        Self {
            size: size_of::<Self>(),
            kind: SVBRDF_BOARD_CHECKERBOARD_RING,
            rows: target.rows,
            cols: target.cols,
            hole_row_start: target.hole.row_start,
            hole_col_start: target.hole.col_start,
            hole_row_end: target.hole.row_end,
            hole_col_end: target.hole.col_end,
            top_left_white: (target.top_left == TopLeft::White).into(),
            square_mm: target.square_mm,
            white_albedo: target.white_albedo,
            black_albedo: target.black_albedo,
            marker_mm: 0.0,
            dictionary: std::ptr::null(),
            patches: target.patches.into(),
            reserved: 0,
        }
    }
}
versioned!(svbrdf_board, offset_of!(svbrdf_board, patches));

/// Fills a board with the default one (A4, 17 x 16 squares of 11.5 mm): pass
/// sizeof(svbrdf_board).
///
/// # Safety
/// `board` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_board_init(board: *mut svbrdf_board, size: usize) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(board, size) })
}

impl svbrdf_board {
    /// # Safety
    /// `dictionary` is NULL or a C string.
    unsafe fn target(&self) -> Result<Target, Fault> {
        let kind = match self.kind {
            SVBRDF_BOARD_CHECKERBOARD_RING => TargetKind::CheckerboardRing,
            SVBRDF_BOARD_CHARUCO_RING => {
                if self.dictionary.is_null() {
                    return Err(Fault::argument("svbrdf_board.dictionary: NULL given"));
                }
                // SAFETY: not NULL, and the caller vouches for the rest.
                let name = unsafe { CStr::from_ptr(self.dictionary) };
                let dictionary = name.to_str().unwrap_or_default().to_owned();
                if !dictionary.starts_with("DICT_") {
                    return Err(Fault::argument(
                        "svbrdf_board.dictionary: a name such as DICT_4X4_250 is expected",
                    ));
                }
                TargetKind::CharucoRing { dictionary, marker_mm: self.marker_mm }
            }
            other => return Err(unknown("svbrdf_board.kind", other)),
        };
        let white = truth("svbrdf_board.top_left_white", self.top_left_white)?;
        Ok(Target {
            kind,
            rows: self.rows,
            cols: self.cols,
            square_mm: self.square_mm,
            hole: Hole {
                row_start: self.hole_row_start,
                col_start: self.hole_col_start,
                row_end: self.hole_row_end,
                col_end: self.hole_col_end,
            },
            white_albedo: self.white_albedo,
            black_albedo: self.black_albedo,
            top_left: if white { TopLeft::White } else { TopLeft::Black },
            patches: truth("svbrdf_board.patches", self.patches)?,
        })
    }
}

/// Intrinsics of a camera. Pixel (0, 0) is the centre of the top-left pixel.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_camera {
    /// Size of this struct.
    pub size: usize,
    /// Width of the photos, px, after turning them by svbrdf_image.rotation.
    pub width: u32,
    /// Height of the photos, px, after turning them.
    pub height: u32,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// OpenCV's k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

impl Default for svbrdf_camera {
    fn default() -> Self {
        Self {
            size: size_of::<Self>(),
            width: 0,
            height: 0,
            fx: 0.0,
            fy: 0.0,
            cx: 0.0,
            cy: 0.0,
            distortion: [0.0; 5],
        }
    }
}
versioned!(svbrdf_camera, size_of::<svbrdf_camera>());

impl svbrdf_camera {
    pub(crate) fn new(camera: Camera) -> Self {
        let Camera { width, height, fx, fy, cx, cy, distortion } = camera;
        Self { size: size_of::<Self>(), width, height, fx, fy, cx, cy, distortion }
    }
}

/// Fills a camera with zeros: pass sizeof(svbrdf_camera).
///
/// # Safety
/// `camera` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_camera_init(
    camera: *mut svbrdf_camera,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(camera, size) })
}

/// What the photos show.
pub type svbrdf_scene = u32;
/// The sample inside a printed board: svbrdf_session_push_frame().
pub const SVBRDF_SCENE_BOARD: svbrdf_scene = 1;
/// The sample's top view, camera and light given: svbrdf_session_push_rectified().
pub const SVBRDF_SCENE_RECTIFIED: svbrdf_scene = 2;

/// How maps are found.
pub type svbrdf_method = u32;
/// Networks, then per-texel refinement.
pub const SVBRDF_METHOD_DEEP: svbrdf_method = 1;
/// Inverse rendering on the maps themselves: a baseline.
pub const SVBRDF_METHOD_CLASSIC: svbrdf_method = 2;

/// Light of rectified photos.
pub type svbrdf_falloff = u32;
/// Inverse square; a white surface facing the light at the first camera's distance comes out at 1.
pub const SVBRDF_FALLOFF_AUTO: svbrdf_falloff = 1;
/// Inverse square with light_power in mm² (irradiance at 1 mm).
pub const SVBRDF_FALLOFF_INVERSE_SQUARE: svbrdf_falloff = 2;
/// The same irradiance light_power at every texel; pi: a white texel facing it comes out at 1.
pub const SVBRDF_FALLOFF_NONE: svbrdf_falloff = 3;

/// How much a log line matters.
pub type svbrdf_log_level = u32;
/// A fault.
pub const SVBRDF_LOG_ERROR: svbrdf_log_level = 1;
/// A photo was rejected, or there is a hint about it.
pub const SVBRDF_LOG_WARNING: svbrdf_log_level = 2;
/// What happens.
pub const SVBRDF_LOG_INFO: svbrdf_log_level = 3;

/// Called with the state of the fit whenever it has changed; changes that come faster than the
/// callback returns are left out. See "Threads" at the top.
pub type svbrdf_progress_callback = Option<
    unsafe extern "C" fn(
        user_data: *mut c_void,
        session: *mut svbrdf_session,
        progress: *const svbrdf_progress,
    ),
>;

/// Called when newer maps can be taken with svbrdf_session_snapshot_maps(), at once for the first
/// photo, then a few times a second during a fit. See "Threads" at the top.
pub type svbrdf_maps_callback =
    Option<unsafe extern "C" fn(user_data: *mut c_void, session: *mut svbrdf_session)>;

/// Called with a line of text (UTF-8, without a line end, valid during the call) on the thread it
/// happens on: one inside a call of the session, or the session's callback thread.
pub type svbrdf_log_callback = Option<
    unsafe extern "C" fn(user_data: *mut c_void, level: svbrdf_log_level, message: *const c_char),
>;

/// Options of a session. What they point to is needed during the call only, except user_data.
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
    /// Whether the per-texel refinement runs, 0 or 1. Default: 1.
    pub refine: u32,
    /// Threads of the fit, at most 64; 0: one per core, at most 4.
    pub threads: u32,
    /// For rectified photos: one of SVBRDF_FALLOFF_. Default: auto.
    pub falloff: svbrdf_falloff,
    /// Seed of everything random. Same photos, seed and threads: same maps.
    pub seed: u64,
    /// For rectified photos: strength of the light per channel, see SVBRDF_FALLOFF_.
    pub light_power: [f32; 3],
    /// 0.
    pub reserved: u32,
    /// The board; NULL: the default one.
    pub board: *const svbrdf_board,
    /// The camera of all photos; NULL: estimated from the photos so far.
    pub camera: *const svbrdf_camera,
    /// Position of the flash in the camera frame (x right, y down, z forward), three numbers, mm;
    /// NULL: at the camera's centre until the photos tell.
    pub flash_offset_mm: *const f64,
    /// Models; NULL: those inside the library.
    pub models: *const svbrdf_models,
    /// Called on the session's callback thread, or NULL.
    pub on_progress: svbrdf_progress_callback,
    /// Called on the session's callback thread, or NULL.
    pub on_maps: svbrdf_maps_callback,
    /// Called with log lines, or NULL.
    pub on_log: svbrdf_log_callback,
    /// Handed to the callbacks.
    pub user_data: *mut c_void,
    /// Most memory the session may need by its own estimate, bytes, the models (about 30 MB, shared
    /// by all sessions) not counted; 0: any amount. What would need more is answered with
    /// SVBRDF_MEMORY_LIMIT.
    pub memory_limit_bytes: u64,
    /// For a board: height of the sample's surface above the printed side, -5 to 20 mm; NaN:
    /// estimated from the photos. Default: NaN.
    pub elevation_mm: f64,
}

impl Default for svbrdf_session_options {
    fn default() -> Self {
        let settings = Settings::default();
        Self {
            size: size_of::<Self>(),
            scene: SVBRDF_SCENE_BOARD,
            resolution: settings.resolution as u32,
            sample_mm: settings.sample_mm,
            method: SVBRDF_METHOD_DEEP,
            refine: settings.refine.into(),
            threads: settings.threads as u32,
            falloff: SVBRDF_FALLOFF_AUTO,
            seed: settings.seed,
            light_power: [0.0; 3],
            reserved: 0,
            board: std::ptr::null(),
            camera: std::ptr::null(),
            flash_offset_mm: std::ptr::null(),
            models: std::ptr::null(),
            on_progress: None,
            on_maps: None,
            on_log: None,
            user_data: std::ptr::null_mut(),
            memory_limit_bytes: 0,
            elevation_mm: f64::NAN,
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

fn unknown(field: &str, value: u32) -> Fault {
    Fault::argument(format!("{field}: {value} is not a known value"))
}

fn truth(field: &str, value: u32) -> Result<bool, Fault> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(unknown(field, other)),
    }
}

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

    /// What counts of the options for a session that goes on.
    pub(crate) fn for_restoring(&self) -> Result<RestoreOptions, Fault> {
        let threads = self.threads()?;
        let threads = (threads > 0).then_some(threads);
        Ok(RestoreOptions { threads, memory_limit_bytes: self.memory_limit() })
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
            seed: self.seed,
            memory_limit_bytes: self.memory_limit(),
        })
    }

    /// # Safety
    /// `board`, `camera` and `flash_offset_mm` are NULL or what the header says.
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

/// What lit a photo.
pub type svbrdf_flash = u32;
/// Not said: the photo is looked at.
pub const SVBRDF_FLASH_UNKNOWN: svbrdf_flash = 0;
/// No flash: the photo is rejected.
pub const SVBRDF_FLASH_OFF: svbrdf_flash = 1;
/// A flash fired.
pub const SVBRDF_FLASH_FIRED: svbrdf_flash = 2;
/// The lamp was on all the time.
pub const SVBRDF_FLASH_TORCH: svbrdf_flash = 3;

/// What is known about a photo.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_frame_info {
    /// Size of this struct.
    pub size: usize,
    /// Relative exposure: value = radiance * exposure. With a torch, exposure time times
    /// sensitivity over that of the first photo. Default: 1.
    pub exposure: f32,
    /// One of SVBRDF_FLASH_. Default: unknown.
    pub flash: svbrdf_flash,
    /// Handed back in the report and named in the log, e.g. to tell which photo it was.
    pub timestamp_ns: i64,
    /// The same view without flash, or NULL: it is subtracted in linear light. Same size as the
    /// photo; the camera must not have moved. Nothing of it is kept.
    pub ambient: *const svbrdf_image,
    /// Relative exposure of that; 0: as the photo's.
    pub ambient_exposure: f32,
    /// Focal length as for 35 mm film (EXIF's FocalLengthIn35mmFilm), mm; 0: not known. With a
    /// camera that is estimated it is where the search begins.
    pub focal_35mm: f32,
}

impl Default for svbrdf_frame_info {
    fn default() -> Self {
        Self {
            size: size_of::<Self>(),
            exposure: 1.0,
            flash: SVBRDF_FLASH_UNKNOWN,
            timestamp_ns: 0,
            ambient: std::ptr::null(),
            ambient_exposure: 0.0,
            focal_35mm: 0.0,
        }
    }
}
versioned!(svbrdf_frame_info, offset_of!(svbrdf_frame_info, ambient));

/// Fills photo metadata with defaults: pass sizeof(svbrdf_frame_info).
///
/// # Safety
/// `info` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_frame_info_init(
    info: *mut svbrdf_frame_info,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(info, size) })
}

impl svbrdf_frame_info {
    /// A caller's metadata, defaults for NULL.
    ///
    /// # Safety
    /// NULL or what the header says.
    pub(crate) unsafe fn from_caller(info: *const Self) -> Result<Self, Fault> {
        if info.is_null() {
            return Ok(Self::default());
        }
        // SAFETY: as the caller vouches.
        let info = unsafe { versioned::read(info) }?;
        if info.flash > SVBRDF_FLASH_TORCH {
            return Err(unknown("svbrdf_frame_info.flash", info.flash));
        }
        if !(info.focal_35mm.is_finite() && info.focal_35mm >= 0.0) {
            return Err(Fault::argument("focal_35mm: a length in mm, or 0, is expected"));
        }
        Ok(info)
    }

    /// The photo of a call.
    ///
    /// # Safety
    /// `ambient` is NULL or what the header says; as [`svbrdf_image::photo`].
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
