/*
 * svbrdf: normal, diffuse, specular and roughness maps of a flat material from a few flash
 * photographs. C99, C++11 and later. Made by cbindgen from ffi/: do not edit.
 *
 * Units: millimetres, pixels, linear RGB (Rec. 709). Board frame: origin at the sample's centre,
 * X right, Y up, Z out of the surface. Camera frame: x right, y down, z forward. Row 0 of a map is
 * the sample's +Y edge, column 0 its -X edge.
 *
 * Calls return an svbrdf_status: 0 done, negative a fault, positive neither. Results are written
 * only as documented; a call that fails changes nothing. svbrdf_last_error_message() says what was
 * wrong.
 *
 * Structs: declare one, fill it with its _init() function, set fields. Their first field is their
 * size, so that programs work with newer libraries, and with older ones as long as they set no
 * field that those do not know.
 *
 * Handles are numbers in a pointer's clothes. A destroyed, NULL or foreign handle is answered with
 * SVBRDF_INVALID_HANDLE; none is ever given out twice.
 *
 * Threads: every function may be called from any thread at any time, several at once, on the same
 * handles; structs and memory handed to a call must not be changed by others during it, and a view
 * of maps ends with them. Progress and maps callbacks come on one thread per session, one at a
 * time, those of photos that were pushed without waiting on another, never on a thread of the
 * caller's; log lines also come on threads that are inside a call. Callbacks may call every
 * function, svbrdf_session_destroy() included, except that they should not wait for the fit: no
 * progress arrives meanwhile, no photo is taken in. No lock is held while one runs. Do not hold a
 * lock that a callback takes while calling svbrdf_session_destroy(), and let no C++ exception out
 * of one. svbrdf_set_thread_hook() tells of every thread that the library starts.
 *
 * Time: limits and timeouts are counted by a monotonic clock; setting the system's does nothing.
 *
 * Ownership: svbrdf_session_destroy(), svbrdf_maps_destroy(), svbrdf_models_destroy(),
 * svbrdf_capture_destroy(), svbrdf_buffer_destroy() and svbrdf_package_destroy() free what the calls
 * that hand such a handle out made; there is nothing else to free.
 */

#ifndef SVBRDF_H
#define SVBRDF_H

#include <stddef.h>
#include <stdint.h>

/**
 * Most bytes of a text, with the NUL at its end.
 */
#define SVBRDF_TEXT 64

/**
 * Major version of this header. Libraries of another one do not fit.
 */
#define SVBRDF_VERSION_MAJOR 0

/**
 * Minor version of this header. Libraries of a newer one fit.
 */
#define SVBRDF_VERSION_MINOR 1

/**
 * Patch version of this header.
 */
#define SVBRDF_VERSION_PATCH 0

/**
 * svbrdf_features(): the models are inside the library.
 */
#define SVBRDF_FEATURE_EMBEDDED_MODELS 1

/**
 * svbrdf_features(): YUV buffers are taken.
 */
#define SVBRDF_FEATURE_YUV 2

/**
 * svbrdf_features(): raw sensor buffers are taken.
 */
#define SVBRDF_FEATURE_RAW 4

/**
 * svbrdf_features(): encoded files are read: svbrdf_session_push_encoded().
 */
#define SVBRDF_FEATURE_FILES 8

/**
 * Bytes of svbrdf_frame_report.advice.
 */
#define SVBRDF_ADVICE_BYTES 256

/**
 * Bytes made by the library.
 */
typedef struct svbrdf_buffer svbrdf_buffer;

/**
 * A folder with capture.json and photos (PNG, JPEG, TIFF, OpenEXR).
 */
typedef struct svbrdf_capture svbrdf_capture;

/**
 * Maps as they were when svbrdf_session_snapshot_maps() was called; independent of the session.
 */
typedef struct svbrdf_maps svbrdf_maps;

/**
 * Networks that any number of sessions may share. Destroying them while sessions use them is
 * fine.
 */
typedef struct svbrdf_models svbrdf_models;

/**
 * Exported files in memory; independent of the maps.
 */
typedef struct svbrdf_package svbrdf_package;

/**
 * A capture in progress: push photos, take maps at any time.
 */
typedef struct svbrdf_session svbrdf_session;

/**
 * What a call answers: 0 done, negative a fault, positive neither. Values may be added.
 */
typedef int32_t svbrdf_status;

/**
 * How long the fit works on each photo. A fit at its limit settles on the maps that it has; every
 * photo begins with the full budget again, and pauses do not count. Default: no limits.
 */
typedef struct svbrdf_budget {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Seconds of work on each photo, the step in progress apart; negative: any number.
     */
    float seconds;
    /**
     * Steps of the optimisers on each photo; 0: any number.
     */
    uint32_t max_steps;
    /**
     * 1: also end where what is left to change is less than half a step of 8-bit maps.
     */
    uint32_t stop_when_invisible;
    /**
     * 0.
     */
    uint32_t reserved;
} svbrdf_budget;

/**
 * What the photos show.
 */
typedef uint32_t svbrdf_scene;

/**
 * How maps are found.
 */
typedef uint32_t svbrdf_method;

/**
 * Light of rectified photos.
 */
typedef uint32_t svbrdf_falloff;

/**
 * Kind of board.
 */
typedef uint32_t svbrdf_board_kind;

/**
 * The printed board round the sample.
 */
typedef struct svbrdf_board {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * One of SVBRDF_BOARD_.
     */
    svbrdf_board_kind kind;
    /**
     * Rows of squares, the hole's included; rows + cols is odd.
     */
    uint32_t rows;
    /**
     * Columns of squares, the hole's included.
     */
    uint32_t cols;
    /**
     * First row of the hole, counted from the printed top.
     */
    uint32_t hole_row_start;
    /**
     * First column of the hole, counted from the left.
     */
    uint32_t hole_col_start;
    /**
     * Row after the hole's last.
     */
    uint32_t hole_row_end;
    /**
     * Column after the hole's last.
     */
    uint32_t hole_col_end;
    /**
     * 1 when the printed top-left square is white, 0 when it is black.
     */
    uint32_t top_left_white;
    /**
     * Side of a square, mm.
     */
    double square_mm;
    /**
     * Diffuse albedo of white squares.
     */
    double white_albedo;
    /**
     * Diffuse albedo of black squares.
     */
    double black_albedo;
    /**
     * For ChArUco: side of a marker, mm.
     */
    double marker_mm;
    /**
     * For ChArUco: OpenCV's dictionary name, e.g. "DICT_4X4_250"; needed during the call only.
     */
    const char *dictionary;
    /**
     * Whether black, gray and white patches are printed below the ring as `svbrdf board` does, 0
     * or 1: they tell whether photos are linear. Default: 1; set 0 for boards from elsewhere.
     */
    uint32_t patches;
    /**
     * 0.
     */
    uint32_t reserved;
} svbrdf_board;

/**
 * Intrinsics of a camera. Pixel (0, 0) is the centre of the top-left pixel.
 */
typedef struct svbrdf_camera {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Width of the photos, px, after turning them by svbrdf_image.rotation.
     */
    uint32_t width;
    /**
     * Height of the photos, px, after turning them.
     */
    uint32_t height;
    /**
     * Focal length along x, px.
     */
    double fx;
    /**
     * Focal length along y, px.
     */
    double fy;
    /**
     * Principal point, px.
     */
    double cx;
    /**
     * Principal point, px.
     */
    double cy;
    /**
     * OpenCV's k1, k2, p1, p2, k3.
     */
    double distortion[5];
} svbrdf_camera;

/**
 * What a session is doing.
 */
typedef uint32_t svbrdf_state;

/**
 * What a fit is doing. Values may be added; their order is not that in which they run.
 */
typedef uint32_t svbrdf_phase;

/**
 * State of a fit.
 */
typedef struct svbrdf_progress {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * One of SVBRDF_STATE_.
     */
    svbrdf_state state;
    /**
     * Photos accepted so far.
     */
    uint32_t frames;
    /**
     * 1 when the fit has finished on all photos so far.
     */
    uint32_t settled;
    /**
     * Share of the work on the photos so far that is done, 0 to 1.
     */
    float fraction;
    /**
     * Mean error (log-L1 of renderings) before the fit of the latest photo.
     */
    float loss_before;
    /**
     * Mean error now.
     */
    float loss;
    /**
     * Estimated seconds left; negative when not known.
     */
    float seconds_left;
    /**
     * 0.
     */
    uint32_t reserved;
    /**
     * Sets of maps published so far: when it has grown there are newer maps.
     */
    uint64_t maps_revision;
    /**
     * What the fit is doing: one of SVBRDF_PHASE_, see svbrdf_phase_name().
     */
    svbrdf_phase phase;
    /**
     * 0.
     */
    uint32_t reserved_too;
} svbrdf_progress;

/**
 * Called with the state of the fit whenever it has changed; changes that come faster than the
 * callback returns are left out. See "Threads" at the top.
 */
typedef void (*svbrdf_progress_callback)(void *user_data,
                                         struct svbrdf_session *session,
                                         const struct svbrdf_progress *progress);

/**
 * Called when newer maps can be taken with svbrdf_session_snapshot_maps(), at once for the first
 * photo, then a few times a second during a fit. See "Threads" at the top.
 */
typedef void (*svbrdf_maps_callback)(void *user_data, struct svbrdf_session *session);

/**
 * How much a log line matters.
 */
typedef uint32_t svbrdf_log_level;

/**
 * Called with a line of text (UTF-8, without a line end, valid during the call) on the thread it
 * happens on: one inside a call, or one of the session's callback threads.
 */
typedef void (*svbrdf_log_callback)(void *user_data, svbrdf_log_level level, const char *message);

/**
 * Options of a session. What they point to is needed during the call only, except user_data.
 */
typedef struct svbrdf_session_options {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * One of SVBRDF_SCENE_. Default: a board.
     */
    svbrdf_scene scene;
    /**
     * Texels along each side of the maps: 256, 512, 1024 or 2048. Default: 256.
     */
    uint32_t resolution;
    /**
     * Width and height of the sample, mm. Default: 100 x 100.
     */
    float sample_mm[2];
    /**
     * One of SVBRDF_METHOD_. Default: deep.
     */
    svbrdf_method method;
    /**
     * Whether the per-texel refinement runs, 0 or 1. Default: 1.
     */
    uint32_t refine;
    /**
     * Threads of the fit, at most 64; 0: one per core, at most 4.
     */
    uint32_t threads;
    /**
     * For rectified photos: one of SVBRDF_FALLOFF_. Default: auto.
     */
    svbrdf_falloff falloff;
    /**
     * For rectified photos: strength of the light per channel, see SVBRDF_FALLOFF_.
     */
    float light_power[3];
    /**
     * 0.
     */
    uint32_t reserved;
    /**
     * The board; NULL: the default one.
     */
    const struct svbrdf_board *board;
    /**
     * The camera of all photos; NULL: estimated from the photos so far.
     */
    const struct svbrdf_camera *camera;
    /**
     * Position of the flash in the camera frame (x right, y down, z forward), three numbers, mm;
     * NULL: at the camera's centre until the photos tell.
     */
    const double *flash_offset_mm;
    /**
     * Models; NULL: those inside the library.
     */
    const struct svbrdf_models *models;
    /**
     * Called on the session's callback thread, or NULL.
     */
    svbrdf_progress_callback on_progress;
    /**
     * Called on the session's callback thread, or NULL.
     */
    svbrdf_maps_callback on_maps;
    /**
     * Called with log lines, or NULL.
     */
    svbrdf_log_callback on_log;
    /**
     * Handed to the callbacks.
     */
    void *user_data;
    /**
     * Most memory the session may need by its own estimate, bytes, the models (about 30 MB, shared
     * by all sessions) not counted, copies of photos that svbrdf_session_push_frame_async() holds
     * counted; 0: any amount. What would need more is answered with SVBRDF_MEMORY_LIMIT.
     */
    uint64_t memory_limit_bytes;
    /**
     * For a board: height of the sample's surface above the printed side, -5 to 20 mm; NaN:
     * estimated from the photos. Default: NaN.
     */
    double elevation_mm;
} svbrdf_session_options;

/**
 * Why a photo was not used. Values may be added.
 */
typedef uint32_t svbrdf_rejection;

/**
 * Things to tell about an accepted photo: bits. Some may be added: svbrdf_frame_report.advice has
 * words for all.
 */
typedef uint32_t svbrdf_hints;

/**
 * What became of a photo.
 */
typedef struct svbrdf_frame_report {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * 1 when the photo takes part in the fit, 0 when it was rejected.
     */
    uint32_t accepted;
    /**
     * Why it was rejected: one of SVBRDF_REJECTION_.
     */
    svbrdf_rejection rejection;
    /**
     * Number of photos accepted before this one.
     */
    uint32_t index;
    /**
     * 1 when the pose below is known: an accepted photo of a board.
     */
    uint32_t has_pose;
    /**
     * Rotation from the board to the camera, row by row.
     */
    double rotation[9];
    /**
     * Board origin in the camera frame, mm.
     */
    double translation_mm[3];
    /**
     * Reprojection error of the board's corners, px.
     */
    double reprojection_rms_px;
    /**
     * Seconds from the call to maps being available.
     */
    double maps_seconds;
    /**
     * The timestamp that was given with the photo.
     */
    int64_t timestamp_ns;
    /**
     * Things to tell about an accepted photo: bits of SVBRDF_HINT_.
     */
    svbrdf_hints hints;
    /**
     * For SVBRDF_HINT_NOTHING_NEW: number of that photo among the accepted ones, from 0.
     */
    uint32_t same_view_as;
    /**
     * For SVBRDF_HINT_NOT_LINEAR: value of the black squares or the gray patch over that of white.
     */
    float over_white;
    /**
     * What was measured of a rejected photo. Too few corners: how many were found; pose uncertain:
     * reprojection error, px; blurred: width of edges (one sigma), px; too dark: level of white,
     * 1 is full scale; clipped: share of pixels; too grazing: degrees off the top; sample outside:
     * share of the sample seen; 0 for other reasons.
     */
    float measured;
    /**
     * What it would have had to reach (corners) or to stay below (degrees); otherwise 0.
     */
    float limit;
    /**
     * For a blurred photo: direction of the blur, degrees clockwise from the photo's x axis, 0 to
     * 180; negative: soft all round, as out of focus.
     */
    float blur_direction_deg;
    /**
     * What to tell the user, in English, UTF-8: why a photo was rejected, or the hints of an
     * accepted one; empty where there is nothing to tell.
     */
    char advice[SVBRDF_ADVICE_BYTES];
} svbrdf_frame_report;

/**
 * Standard deviations of the maps as a whole: root mean squares over the texels of what their errors
 * are expected to be.
 */
typedef struct svbrdf_confidence {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Of each slope of the normal: tangent of a tilt.
     */
    float normal;
    /**
     * Of each colour of the diffuse albedo, linear.
     */
    float diffuse;
    /**
     * Of each colour of the specular albedo, linear.
     */
    float specular;
    /**
     * Of roughness.
     */
    float roughness;
} svbrdf_confidence;

/**
 * One of the maps. Row 0 is the sample's +Y edge, column 0 its -X edge.
 */
typedef uint32_t svbrdf_map;

/**
 * A map in memory of the library.
 */
typedef struct svbrdf_map_view {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * First texel, row by row; valid until svbrdf_maps_destroy(). Aligned for floats.
     */
    const void *data;
    /**
     * Bytes of all rows.
     */
    size_t bytes;
    /**
     * Bytes from a row to the next.
     */
    size_t row_stride;
    /**
     * Texels in a row.
     */
    uint32_t width;
    /**
     * Rows.
     */
    uint32_t height;
    /**
     * Channels of a texel: 1, 3 or 4.
     */
    uint32_t channels;
    /**
     * 0.
     */
    uint32_t reserved;
} svbrdf_map_view;

/**
 * Transfer curve of stored values.
 */
typedef uint32_t svbrdf_transfer;

/**
 * What lit a photo.
 */
typedef uint32_t svbrdf_flash;

/**
 * How a file is read.
 */
typedef struct svbrdf_encoded_options {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Relative exposure: value = radiance * exposure. 0, the default: that of the metadata
     * (exposure time * ISO / F-number²), or 1.
     */
    float exposure;
    /**
     * Transfer curve: one of SVBRDF_TRANSFER_. 0, the default: what the file says (ICC profile,
     * PNG's cICP and gAMA), sRGB where it is silent, linear for floats and raw values.
     */
    svbrdf_transfer transfer;
    /**
     * How far the upright picture is turned clockwise: 0, 90, 180 or 270 degrees. The session's
     * camera describes the turned picture.
     */
    uint32_t rotation;
    /**
     * One of SVBRDF_FLASH_. Default: unknown.
     */
    svbrdf_flash flash;
    /**
     * Handed back in the report and named in the log, e.g. to tell which photo it was.
     */
    int64_t timestamp_ns;
    /**
     * Largest picture, pixels; 0, the default: 100 million.
     */
    uint64_t max_pixels;
    /**
     * Most memory that decoding may take beside the file itself, bytes; more is
     * SVBRDF_MEMORY_LIMIT before anything is allocated. 0, the default: 6 GiB.
     */
    uint64_t max_bytes;
} svbrdf_encoded_options;

/**
 * What is to be said about a file: an OR of SVBRDF_REMARK_ values.
 */
typedef uint32_t svbrdf_remarks;

/**
 * What a photo's file says of how it was taken.
 */
typedef struct svbrdf_file_info {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Width as the sensor has it, px; 0: not known.
     */
    uint32_t width;
    /**
     * Height as the sensor has it, px; 0: not known.
     */
    uint32_t height;
    /**
     * How far the stored picture is turned clockwise to stand upright, degrees. Reading a file does
     * that; lens and flash keep their place in the camera, however it is held: options.rotation
     * turns photos back to how most of them were held.
     */
    uint32_t upright_deg;
    /**
     * 1: the values are linear (floats, raw values).
     */
    uint32_t is_linear;
    /**
     * Exposure time * ISO / F-number², relative; 0: not known.
     */
    float exposure;
    /**
     * Focal length of the lens, mm; 0: not known.
     */
    float focal_mm;
    /**
     * Focal length on film of 36 x 24 mm that shows as much, mm; 0: not known.
     */
    float focal_35mm;
    /**
     * How many times a digital zoom enlarged the picture; 1: not, or not known.
     */
    float digital_zoom;
    /**
     * What is to be said: an OR of SVBRDF_REMARK_ values. Those about colours are known when the
     * photo is pushed only.
     */
    svbrdf_remarks remarks;
    /**
     * Who made the camera; empty: not known. Photos that differ in maker, model, lens, focal
     * lengths, zoom or size need sessions, or cameras, of their own.
     */
    char make[SVBRDF_TEXT];
    /**
     * Which camera it is.
     */
    char model[SVBRDF_TEXT];
    /**
     * Which lens it is.
     */
    char lens[SVBRDF_TEXT];
    /**
     * When the shutter opened: digits whose order, as text, is that of time.
     */
    char taken[SVBRDF_TEXT];
} svbrdf_file_info;

/**
 * How textures are stored.
 */
typedef uint32_t svbrdf_texture_format;

/**
 * How maps are exported.
 */
typedef struct svbrdf_export_options {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Formats, separated by commas: glb, usdz, materialx, unreal, unity-hdrp, unity-urp, blender.
     * Needed during the call only. NULL, the default: glb.
     */
    const char *formats;
    /**
     * Whether GLB, MaterialX and Blender get base colour and metalness instead of a specular
     * colour, 0 or 1. Default: 0.
     */
    uint32_t metallic;
    /**
     * Whether the maps are made seamless first, 0 or 1. Default: 0.
     */
    uint32_t tile;
    /**
     * One of SVBRDF_TEXTURE_. Default: SVBRDF_TEXTURE_PNG8.
     */
    svbrdf_texture_format texture;
    /**
     * Longer side of the textures at most, texels; 0, the default: no limit.
     */
    uint32_t max_size;
    /**
     * Photos that the maps were estimated from, for material.json; 0, the default: not said.
     */
    uint32_t photos;
    /**
     * 0.
     */
    uint32_t reserved;
} svbrdf_export_options;

/**
 * How the maps of the moment explain an accepted photo.
 */
typedef struct svbrdf_frame_fit {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Median over its texels of the absolute difference of the logarithms of rendered and measured
     * radiance: a relative error.
     */
    float residual;
    /**
     * Mean weight of its texels, 0 to 1: the cosine to the camera, 0 for texels not seen.
     */
    float weight;
    /**
     * 1 when it contradicts the others: its residual stands out. 0 for fewer than four photos.
     */
    uint32_t outlier;
    /**
     * 0.
     */
    uint32_t reserved;
    /**
     * Share of the sample, 0 to 1, where it contradicts the others: sun, a shadow, a hand or glare on
     * a part of it. 0: nowhere.
     */
    float part_share;
    /**
     * Middle of that part: of the sample's width from the left, of its height from the top.
     */
    float part_centre[2];
    /**
     * How many times as bright it is as the maps have it; below 1: darker.
     */
    float part_ratio;
} svbrdf_frame_fit;

/**
 * When guidance asks for what. Set the fields that are to differ after svbrdf_guide_options_init().
 */
typedef struct svbrdf_guide_options {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Gain from which on a photo is worth taking, as a share of the best view's, 0 to 1. High: fewer
     * photos; low: less walking.
     */
    float worth;
    /**
     * The camera is steady where the sample moves less than this across the picture, in widths of the
     * sample a second.
     */
    float steady;
    /**
     * For so long, seconds.
     */
    float steady_seconds;
    /**
     * It is enough where the best view would take away less of the expected squared error, 0 to 1.
     */
    float enough;
    /**
     * But not before so many photos.
     */
    uint32_t least;
    /**
     * And in any case with so many.
     */
    uint32_t most;
    /**
     * Steepest view of the first photo, degrees off the top.
     */
    float first_tilt_deg;
    /**
     * A photo that has not been pushed so long after SVBRDF_ACTION_SHOOT is not going to be, seconds.
     */
    float shot_seconds;
} svbrdf_guide_options;

/**
 * What the user is to do: one of SVBRDF_ACTION_.
 */
typedef uint32_t svbrdf_action;

/**
 * What to do now, see svbrdf_session_guide().
 */
typedef struct svbrdf_guidance {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * One of SVBRDF_ACTION_.
     */
    svbrdf_action action;
    /**
     * Accepted photos so far.
     */
    uint32_t photos;
    /**
     * 1 when what follows up to degrees is known.
     */
    uint32_t has_target;
    /**
     * The target's angle off the top, degrees.
     */
    float target_tilt_deg;
    /**
     * The target's side: degrees counter-clockwise from the board's +X, 0 to 360.
     */
    float target_azimuth_deg;
    /**
     * From the camera to the target, camera frame, mm: x right, y down, z forward. An arrow along x and
     * y in the picture shows the way.
     */
    float offset_mm[3];
    /**
     * Angle between the view and the target, seen from the sample, degrees.
     */
    float degrees;
    /**
     * Share of the expected squared error of renderings that a photo from here would take away, 0 to 1;
     * negative when not known.
     */
    float gain;
    /**
     * The same of the view that tells most.
     */
    float best_gain;
    /**
     * For the user, in English, UTF-8.
     */
    char message[SVBRDF_ADVICE_BYTES];
} svbrdf_guidance;

/**
 * Layout of a picture in memory. 16-bit numbers and floats are in the machine's byte order.
 */
typedef uint32_t svbrdf_pixel_format;

/**
 * How luma and chroma were made. Numbers are of 8 bits: of 10 bits, they are four times that.
 */
typedef uint32_t svbrdf_yuv_matrix;

/**
 * A plane of a picture. Its layout never changes.
 */
typedef struct svbrdf_plane {
    /**
     * First pixel. No alignment is asked for.
     */
    const void *data;
    /**
     * Readable bytes from there on. The last row may end with its last pixel.
     */
    size_t bytes;
    /**
     * Bytes from a row to the next.
     */
    size_t row_stride;
    /**
     * Bytes from a pixel to the next; 0: no gap.
     */
    size_t pixel_stride;
} svbrdf_plane;

/**
 * Colours of the top-left 2 x 2 sensor pixels, row by row.
 */
typedef uint32_t svbrdf_bayer_pattern;

/**
 * Primaries of RGB, all with D65 as white. What is not Rec. 709 is converted in linear light to
 * floats (four times the memory of 8 bits); what would be negative gets 0.
 */
typedef uint32_t svbrdf_primaries;

/**
 * A picture in memory; nothing of it is kept after the call it is given to. Unused fields are
 * ignored.
 */
typedef struct svbrdf_image {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Layout: one of SVBRDF_PIXEL_.
     */
    svbrdf_pixel_format format;
    /**
     * Pixels in a row, as stored.
     */
    uint32_t width;
    /**
     * Rows, as stored.
     */
    uint32_t height;
    /**
     * Curve of 8- and 16-bit RGB and of YUV: one of SVBRDF_TRANSFER_. Default: sRGB.
     */
    svbrdf_transfer transfer;
    /**
     * How far the picture is turned clockwise before use: 0, 90, 180 or 270 degrees. The
     * session's camera describes the turned picture. Boards need no turning.
     */
    uint32_t rotation;
    /**
     * For YUV and P010: one of SVBRDF_YUV_. Default: BT.601, all values.
     */
    svbrdf_yuv_matrix yuv_matrix;
    /**
     * The planes: three for YUV and P010, otherwise the first.
     */
    struct svbrdf_plane planes[3];
    /**
     * For floats: the level at which a channel is clipped. Default: infinite, never.
     */
    float saturation;
    /**
     * For Bayer: one of SVBRDF_BAYER_. Default: RGGB.
     */
    svbrdf_bayer_pattern bayer_pattern;
    /**
     * For Bayer: value of darkness at the four places of the pattern, row by row.
     */
    float black_level[4];
    /**
     * For Bayer: value of full scale; at and above it a sample is clipped. Default: 65535.
     */
    float white_level;
    /**
     * For Bayer: gains of R, G and B that make neutral gray neutral. Default: 1.
     */
    float white_balance[3];
    /**
     * For Bayer: matrix from white-balanced sensor colours to linear Rec. 709, row by row.
     * Default: identity.
     */
    float color_matrix[9];
    /**
     * Of all but Bayer: one of SVBRDF_PRIMARIES_. Default: Rec. 709.
     */
    svbrdf_primaries primaries;
} svbrdf_image;

/**
 * What is known about a photo.
 */
typedef struct svbrdf_frame_info {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Relative exposure: value = radiance * exposure. With a torch, exposure time times
     * sensitivity over that of the first photo. Default: 1.
     */
    float exposure;
    /**
     * One of SVBRDF_FLASH_. Default: unknown.
     */
    svbrdf_flash flash;
    /**
     * Handed back in the report and named in the log, e.g. to tell which photo it was.
     */
    int64_t timestamp_ns;
    /**
     * The same view without flash, or NULL: it is subtracted in linear light. Same size as the
     * photo; the camera must not have moved. Nothing of it is kept.
     */
    const struct svbrdf_image *ambient;
    /**
     * Relative exposure of that; 0: as the photo's.
     */
    float ambient_exposure;
    /**
     * Focal length as for 35 mm film (EXIF's FocalLengthIn35mmFilm), mm; 0: not known. With a
     * camera that is estimated it is where the search begins.
     */
    float focal_35mm;
} svbrdf_frame_info;

/**
 * What a photo that is only looked at would be good for, see svbrdf_session_probe(). Lengths in
 * px are those of the picture as it came, turned as svbrdf_image.rotation says.
 */
typedef struct svbrdf_probe {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * 1 when a photo like it would be accepted.
     */
    uint32_t acceptable;
    /**
     * Why not: one of SVBRDF_REJECTION_.
     */
    svbrdf_rejection rejection;
    /**
     * Things to tell about it, whether it would be accepted or not: bits of SVBRDF_HINT_.
     */
    svbrdf_hints hints;
    /**
     * As in svbrdf_frame_report.
     */
    uint32_t same_view_as;
    /**
     * Corners of the board that were found.
     */
    uint32_t corners_found;
    /**
     * Corners that lie inside the picture; 0 where the board was not found.
     */
    uint32_t corners_in_view;
    /**
     * Corners that the board has.
     */
    uint32_t corners_expected;
    /**
     * 1 when what follows up to azimuth_deg is known, also of a photo that would be rejected.
     */
    uint32_t has_pose;
    /**
     * Rotation from the board to the camera, row by row.
     */
    double rotation[9];
    /**
     * Board origin in the camera frame, mm.
     */
    double translation_mm[3];
    /**
     * Reprojection error of the board's corners, px.
     */
    double reprojection_rms_px;
    /**
     * From the sample's centre to the camera, mm.
     */
    float distance_mm;
    /**
     * Angle off the top, degrees.
     */
    float tilt_deg;
    /**
     * Side of the camera: degrees counter-clockwise from the board's +X, 0 to 360.
     */
    float azimuth_deg;
    /**
     * Angle to the view of svbrdf_session_next_view(), degrees; negative when there is none.
     */
    float off_next_deg;
    /**
     * Share of the sample inside the picture, 0 to 1; negative when not known.
     */
    float sample_seen;
    /**
     * Share of what is seen of the sample that is saturated in all channels, 0 to 1; negative when
     * not known.
     */
    float sample_clipped;
    /**
     * The sample's corners, x and y, px, clockwise from the maps' upper left; also outside of the
     * picture. Not numbers where they are not known.
     */
    float sample_px[8];
    /**
     * Mean scale of the sample in the picture, px/mm; 0 when not known. A texel of the maps wants
     * one pixel.
     */
    float px_per_mm;
    /**
     * Width of the board's edges (one sigma), px; negative when not known. Large pictures are
     * reduced first: widths below one pixel of the reduced one cannot be told apart.
     */
    float blur_px;
    /**
     * Direction of the blur, degrees clockwise from the picture's x axis, 0 to 180; negative: soft
     * all round, or not known.
     */
    float blur_direction_deg;
    /**
     * Median level of the white squares, 1 is full scale, linear; negative when not known.
     */
    float white_level;
    /**
     * Share of the white squares that are clipped, 0 to 1; negative when not known.
     */
    float white_clipped;
    /**
     * For SVBRDF_HINT_NOT_LINEAR: value of the black squares or the gray patch over that of white.
     */
    float over_white;
    /**
     * As in svbrdf_frame_report.
     */
    float measured;
    /**
     * As in svbrdf_frame_report.
     */
    float limit;
    /**
     * The timestamp that was given with the photo.
     */
    int64_t timestamp_ns;
    /**
     * What to tell the user, in English, UTF-8: why it would be rejected, or the hints; empty where
     * there is nothing to tell.
     */
    char advice[SVBRDF_ADVICE_BYTES];
    /**
     * Set by the caller: where the corners found go, x and y of each, px; NULL: nowhere.
     */
    float *corners_px;
    /**
     * Set by the caller: corners that there is room for.
     */
    uint32_t corners_capacity;
    /**
     * 0.
     */
    uint32_t reserved;
} svbrdf_probe;

/**
 * How a map's texels are laid out. Numbers of more than a byte are in the machine's byte order.
 */
typedef uint32_t svbrdf_map_format;

/**
 * The printed sheet and the sample on it, as used: as planned and in the board's plane unless two
 * photos and more contradict that clearly.
 */
typedef struct svbrdf_paper {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * 1 when the rest means something: a session of a board.
     */
    uint32_t known;
    /**
     * 0.
     */
    uint32_t reserved;
    /**
     * Scale of the print along Y relative to that along X, which is as planned.
     */
    double aspect;
    /**
     * Its standard deviation.
     */
    double aspect_sigma;
    /**
     * How far the board's left and right edges rise above its middle, and its upper and lower
     * edges, mm.
     */
    double bow_mm[2];
    /**
     * Their standard deviations, mm.
     */
    double bow_sigma_mm[2];
    /**
     * Height of the sample's surface above the board's plane, mm.
     */
    double elevation_mm;
    /**
     * Its standard deviation, mm; 0 where the height was given.
     */
    double elevation_sigma_mm;
} svbrdf_paper;

/**
 * What a thread of the library does. Values may be added.
 */
typedef uint32_t svbrdf_thread;

/**
 * Called at the start of a thread, on it, before anything else.
 */
typedef void (*svbrdf_thread_hook)(void *user_data, svbrdf_thread thread);

/**
 * Camera and light of a rendering. Positions: mm from the sample's centre, X right, Y up, Z towards
 * the camera.
 */
typedef struct svbrdf_render_options {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * Position of the camera; its Z is positive. Default: 300 mm above the centre.
     */
    float camera_mm[3];
    /**
     * Position of the light; its Z is positive. Default: as the camera's.
     */
    float light_mm[3];
    /**
     * Strength of the light per channel, see SVBRDF_FALLOFF_. Default: pi.
     */
    float light_power[3];
    /**
     * Radiance of a uniform surround per channel, in the same units. Default: 0.
     */
    float ambient[3];
    /**
     * SVBRDF_FALLOFF_NONE, the default, or SVBRDF_FALLOFF_INVERSE_SQUARE.
     */
    svbrdf_falloff falloff;
    /**
     * 0.
     */
    uint32_t reserved;
} svbrdf_render_options;

/**
 * Where the next photo tells most: from where highlights reach slopes of the sample that they have
 * not swept.
 */
typedef struct svbrdf_next_view {
    /**
     * Size of this struct.
     */
    size_t size;
    /**
     * 1 when the rest is known: a session of a board with a photo.
     */
    uint32_t known;
    /**
     * Angle off the top, degrees.
     */
    float tilt_deg;
    /**
     * Side to go to: degrees counter-clockwise from the board's +X, seen from the top.
     */
    float azimuth_deg;
    /**
     * Unit vector from the sample towards the camera, board frame.
     */
    float direction[3];
} svbrdf_next_view;

/**
 * Called with what became of a photo of svbrdf_session_push_frame_async(): the status and the report
 * that svbrdf_session_push_frame() would have given; where it is neither SVBRDF_OK nor
 * SVBRDF_REJECTED, the report has the timestamp only. The report is valid during the call, and so is
 * what svbrdf_last_error_message() says there until the next call of the library. See "Threads" at
 * the top.
 */
typedef void (*svbrdf_pushed_callback)(void *user_data,
                                       struct svbrdf_session *session,
                                       svbrdf_status status,
                                       const struct svbrdf_frame_report *report);

/**
 * Paper that a board is printed on.
 */
typedef uint32_t svbrdf_page;

/**
 * Format of a printed board.
 */
typedef uint32_t svbrdf_sheet_format;

/**
 * What it says of its colours cannot be used; it was taken as sRGB.
 */
#define SVBRDF_REMARK_PROFILE_UNUSABLE 1

/**
 * It has a gain map (Ultra HDR), which is left out.
 */
#define SVBRDF_REMARK_GAIN_MAP 2

/**
 * Its orientation tag mirrors it.
 */
#define SVBRDF_REMARK_MIRRORED 4

/**
 * It does not say how it was exposed.
 */
#define SVBRDF_REMARK_NO_EXPOSURE 8

/**
 * It says that the flash did not fire (a torch counts as none).
 */
#define SVBRDF_REMARK_NO_FLASH 16

/**
 * PNG, 8 bits a channel.
 */
#define SVBRDF_TEXTURE_PNG8 1

/**
 * PNG, 16 bits a channel.
 */
#define SVBRDF_TEXTURE_PNG16 2

/**
 * JPEG; textures of four channels are PNG of 8 bits.
 */
#define SVBRDF_TEXTURE_JPEG 3

/**
 * Put right what svbrdf_probe.rejection names: a photo would not be used.
 */
#define SVBRDF_ACTION_ADJUST 1

/**
 * Keep the camera where it is: until it is steady, or a photo has been taken in.
 */
#define SVBRDF_ACTION_HOLD 2

/**
 * Go to the target.
 */
#define SVBRDF_ACTION_MOVE 3

/**
 * Nothing: take the photo now, and push it.
 */
#define SVBRDF_ACTION_SHOOT 4

/**
 * Nothing more: a further photo would tell little.
 */
#define SVBRDF_ACTION_ENOUGH 5

/**
 * 3 bytes a pixel.
 */
#define SVBRDF_PIXEL_RGB8 1

/**
 * 4 bytes a pixel, the fourth ignored.
 */
#define SVBRDF_PIXEL_RGBA8 2

/**
 * 3 16-bit numbers a pixel.
 */
#define SVBRDF_PIXEL_RGB16 3

/**
 * 4 16-bit numbers a pixel, the fourth ignored.
 */
#define SVBRDF_PIXEL_RGBA16 4

/**
 * 4 half floats a pixel, linear, the fourth ignored.
 */
#define SVBRDF_PIXEL_RGBA_F16 5

/**
 * 3 floats a pixel, linear.
 */
#define SVBRDF_PIXEL_RGB_F32 6

/**
 * 4 floats a pixel, linear, the fourth ignored.
 */
#define SVBRDF_PIXEL_RGBA_F32 7

/**
 * Three planes: luma, then U (Cb) and V (Cr) at half the size, rounded up. Strides tell NV12,
 * NV21 and I420 apart, as in Android's YUV_420_888.
 */
#define SVBRDF_PIXEL_YUV420 8

/**
 * One plane of 16-bit sensor values behind a Bayer mosaic, as Android's RAW_SENSOR.
 */
#define SVBRDF_PIXEL_BAYER16 9

/**
 * 4 bytes a pixel, blue first, the fourth ignored: iOS's kCVPixelFormatType_32BGRA.
 */
#define SVBRDF_PIXEL_BGRA8 10

/**
 * As SVBRDF_PIXEL_YUV420 in 16-bit words, of which the upper 10 bits count: Android's YCBCR_P010,
 * iOS's 420YpCbCr10BiPlanar. U and V of one plane: the second begins 2 bytes later.
 */
#define SVBRDF_PIXEL_P010 11

/**
 * Proportional to light: the best there is. Floats and raw values are this always.
 */
#define SVBRDF_TRANSFER_LINEAR 1

/**
 * IEC 61966-2-1. A camera's own tone curve is *not* this: switch it off, or have it estimated
 * from the board.
 */
#define SVBRDF_TRANSFER_SRGB 2

/**
 * Pure power law of 2.2.
 */
#define SVBRDF_TRANSFER_GAMMA22 3

/**
 * Hybrid log-gamma of ITU-R BT.2100, scene linear (its inverse OETF): 1 at the largest signal.
 */
#define SVBRDF_TRANSFER_HLG 4

/**
 * Perceptual quantiser of ITU-R BT.2100: 1 at 203 cd/m2, 49.26 at the largest signal.
 */
#define SVBRDF_TRANSFER_PQ 5

/**
 * ITU-R BT.709: sRGB.
 */
#define SVBRDF_PRIMARIES_REC709 1

/**
 * Display P3, as phones take photos.
 */
#define SVBRDF_PRIMARIES_DISPLAY_P3 2

/**
 * ITU-R BT.2020 and BT.2100.
 */
#define SVBRDF_PRIMARIES_REC2020 3

/**
 * BT.601, all 256 values: JPEG and Android.
 */
#define SVBRDF_YUV_BT601_FULL 1

/**
 * BT.601, luma 16 to 235.
 */
#define SVBRDF_YUV_BT601_LIMITED 2

/**
 * BT.709, all 256 values.
 */
#define SVBRDF_YUV_BT709_FULL 3

/**
 * BT.709, luma 16 to 235.
 */
#define SVBRDF_YUV_BT709_LIMITED 4

/**
 * BT.2020 with non-constant luminance, all values.
 */
#define SVBRDF_YUV_BT2020_FULL 5

/**
 * BT.2020 with non-constant luminance, luma 16 to 235.
 */
#define SVBRDF_YUV_BT2020_LIMITED 6

/**
 * Red, green; green, blue.
 */
#define SVBRDF_BAYER_RGGB 1

/**
 * Green, red; blue, green.
 */
#define SVBRDF_BAYER_GRBG 2

/**
 * Green, blue; red, green.
 */
#define SVBRDF_BAYER_GBRG 3

/**
 * Blue, green; green, red.
 */
#define SVBRDF_BAYER_BGGR 4

/**
 * A fault.
 */
#define SVBRDF_LOG_ERROR 1

/**
 * A photo was rejected, or there is a hint about it.
 */
#define SVBRDF_LOG_WARNING 2

/**
 * What happens.
 */
#define SVBRDF_LOG_INFO 3

/**
 * Unit normal, X right, Y up (OpenGL, glTF), Z out of the surface; 8 bits: (n + 1) / 2.
 */
#define SVBRDF_MAP_NORMAL 1

/**
 * Diffuse albedo, linear Rec. 709; 8 bits: with the sRGB curve, as glTF's base colour.
 */
#define SVBRDF_MAP_DIFFUSE 2

/**
 * Specular albedo F0, linear Rec. 709; 8 bits: with the sRGB curve.
 */
#define SVBRDF_MAP_SPECULAR 3

/**
 * Roughness, GGX alpha = roughness²; 8 bits: R 255 (occlusion), G roughness, B 0 (metalness),
 * linear: glTF's occlusion-roughness-metalness.
 */
#define SVBRDF_MAP_ROUGHNESS 4

/**
 * As SVBRDF_MAP_NORMAL with Y down (DirectX, Unreal).
 */
#define SVBRDF_MAP_NORMAL_DIRECTX 5

/**
 * A checkerboard with a rectangular hole for the sample.
 */
#define SVBRDF_BOARD_CHECKERBOARD_RING 1

/**
 * The same with an ArUco marker in every printed white square.
 */
#define SVBRDF_BOARD_CHARUCO_RING 2

/**
 * The sample inside a printed board: svbrdf_session_push_frame().
 */
#define SVBRDF_SCENE_BOARD 1

/**
 * The sample's top view, camera and light given: svbrdf_session_push_rectified().
 */
#define SVBRDF_SCENE_RECTIFIED 2

/**
 * Networks, then per-texel refinement.
 */
#define SVBRDF_METHOD_DEEP 1

/**
 * Inverse rendering on the maps themselves: a baseline.
 */
#define SVBRDF_METHOD_CLASSIC 2

/**
 * Inverse square; a white surface facing the light at the first camera's distance comes out at 1.
 */
#define SVBRDF_FALLOFF_AUTO 1

/**
 * Inverse square with light_power in mm² (irradiance at 1 mm).
 */
#define SVBRDF_FALLOFF_INVERSE_SQUARE 2

/**
 * The same irradiance light_power at every texel; pi: a white texel facing it comes out at 1.
 */
#define SVBRDF_FALLOFF_NONE 3

/**
 * Not said: the photo is looked at.
 */
#define SVBRDF_FLASH_UNKNOWN 0

/**
 * No flash: the photo is rejected.
 */
#define SVBRDF_FLASH_OFF 1

/**
 * A flash fired.
 */
#define SVBRDF_FLASH_FIRED 2

/**
 * The lamp was on all the time.
 */
#define SVBRDF_FLASH_TORCH 3

/**
 * Nothing, or it has not begun.
 */
#define SVBRDF_PHASE_NONE 0

/**
 * Something that this version of the header does not know.
 */
#define SVBRDF_PHASE_OTHER 1

/**
 * Fits the latent code.
 */
#define SVBRDF_PHASE_LATENT 2

/**
 * Chooses how far texels may differ from each other; finds few materials where there are few.
 */
#define SVBRDF_PHASE_WIDTHS 3

/**
 * Pools the gloss of texels that look alike.
 */
#define SVBRDF_PHASE_POOL_GLOSS 4

/**
 * Corrects ambient light, or what a room mirrors.
 */
#define SVBRDF_PHASE_HELD_LIGHTS 5

/**
 * Corrects lights as well.
 */
#define SVBRDF_PHASE_TURNING_LIGHTS 6

/**
 * Refines the maps texel by texel.
 */
#define SVBRDF_PHASE_MAPS 7

/**
 * Regresses slopes.
 */
#define SVBRDF_PHASE_SLOPES 8

/**
 * Infers material classes.
 */
#define SVBRDF_PHASE_CLASSES 9

/**
 * Pools what is left of gloss.
 */
#define SVBRDF_PHASE_POOL_RESIDUALS 10

/**
 * Asks the learned prior.
 */
#define SVBRDF_PHASE_NETWORK 11

/**
 * SVBRDF_METHOD_CLASSIC: inverse rendering on the maps themselves.
 */
#define SVBRDF_PHASE_BASELINE 12

/**
 * It was used.
 */
#define SVBRDF_REJECTION_NONE 0

/**
 * For a reason that this version of the header does not know.
 */
#define SVBRDF_REJECTION_OTHER 1

/**
 * Its size is not the camera's.
 */
#define SVBRDF_REJECTION_WRONG_SIZE 2

/**
 * Nothing like the board was found.
 */
#define SVBRDF_REJECTION_BOARD_NOT_FOUND 3

/**
 * Too little of the board is seen.
 */
#define SVBRDF_REJECTION_TOO_FEW_CORNERS 4

/**
 * The corners do not fit the board seen by the camera.
 */
#define SVBRDF_REJECTION_POSE_UNCERTAIN 5

/**
 * It is blurred.
 */
#define SVBRDF_REJECTION_BLURRED 6

/**
 * It is too dark.
 */
#define SVBRDF_REJECTION_TOO_DARK 7

/**
 * Too much of it is over-exposed.
 */
#define SVBRDF_REJECTION_CLIPPED 8

/**
 * The camera looks too flat across the sample.
 */
#define SVBRDF_REJECTION_TOO_GRAZING 9

/**
 * Too little of the sample is inside.
 */
#define SVBRDF_REJECTION_SAMPLE_OUTSIDE 10

/**
 * The flash does not light the board, or is said to be off.
 */
#define SVBRDF_REJECTION_LIGHT_NOT_VISIBLE 11

/**
 * It holds values that are not numbers.
 */
#define SVBRDF_REJECTION_NOT_FINITE 12

/**
 * Several places on the board fit what is seen.
 */
#define SVBRDF_REJECTION_PLACEMENT_AMBIGUOUS 13

/**
 * What is printed is not the board described; the advice says in what it differs.
 */
#define SVBRDF_REJECTION_BOARD_DIFFERS 14

/**
 * It was taken with another lens or zoom.
 */
#define SVBRDF_REJECTION_OTHER_CAMERA 15

/**
 * The board's squares are too small.
 */
#define SVBRDF_REJECTION_SQUARES_TOO_SMALL 16

/**
 * Something that this version of the header does not know.
 */
#define SVBRDF_HINT_OTHER 1

/**
 * An earlier photo has nearly the same view.
 */
#define SVBRDF_HINT_NOTHING_NEW 2

/**
 * The board's black or gray does not come out as linear values do: a tone curve is on, or
 * svbrdf_image.transfer is wrong. The advice says whether the curve was estimated and undone, so that
 * the photo is as good as another, or could not be.
 */
#define SVBRDF_HINT_NOT_LINEAR 4

/**
 * Nothing: no photo yet, or the fit has settled on all photos so far.
 */
#define SVBRDF_STATE_READY 1

/**
 * Fitting.
 */
#define SVBRDF_STATE_FITTING 2

/**
 * Held by svbrdf_session_pause() with work left.
 */
#define SVBRDF_STATE_PAUSED 3

/**
 * Ended by svbrdf_session_cancel().
 */
#define SVBRDF_STATE_CANCELLED 4

/**
 * Ended by a fault inside the library.
 */
#define SVBRDF_STATE_FAILED 5

/**
 * 210 x 297 mm.
 */
#define SVBRDF_PAGE_A4 1

/**
 * 215.9 x 279.4 mm.
 */
#define SVBRDF_PAGE_LETTER 2

/**
 * PDF of one page.
 */
#define SVBRDF_SHEET_PDF 1

/**
 * SVG, in mm.
 */
#define SVBRDF_SHEET_SVG 2

/**
 * PNG, 8-bit gray, 600 pixels per inch.
 */
#define SVBRDF_SHEET_PNG 3

/**
 * Done.
 */
#define SVBRDF_OK 0

/**
 * The photo cannot be used; nothing changed. The report has the reason, and
 * svbrdf_last_error_message() a sentence for the user.
 */
#define SVBRDF_REJECTED 1

/**
 * The time given has passed first.
 */
#define SVBRDF_TIMEOUT 2

/**
 * No photo has been accepted yet, so there are no maps.
 */
#define SVBRDF_NO_MAPS 3

/**
 * As many photos as are taken already wait to be taken in: try again when one is through.
 */
#define SVBRDF_BUSY 4

/**
 * An argument is NULL, not a number, out of range, or too small a buffer.
 */
#define SVBRDF_INVALID_ARGUMENT -1

/**
 * The handle was destroyed, is NULL, or is of another kind.
 */
#define SVBRDF_INVALID_HANDLE -2

/**
 * The session was cancelled.
 */
#define SVBRDF_CANCELLED -3

/**
 * A file cannot be read or written.
 */
#define SVBRDF_IO -4

/**
 * The models are damaged or do not fit this version.
 */
#define SVBRDF_BAD_MODEL -5

/**
 * The struct asks for something this version does not know, or this build lacks.
 */
#define SVBRDF_UNSUPPORTED -6

/**
 * The bytes are not a saved session, or a damaged or truncated one.
 */
#define SVBRDF_BAD_STATE -8

/**
 * It would need more memory than svbrdf_session_options.memory_limit_bytes; nothing changed.
 */
#define SVBRDF_MEMORY_LIMIT -9

/**
 * A fault inside the library. A session in which it happened answers this from then on; its
 * maps, its progress and svbrdf_session_destroy() stay available.
 */
#define SVBRDF_FAILED -7

/**
 * Floats: three a texel, one for roughness.
 */
#define SVBRDF_MAP_FORMAT_F32 1

/**
 * Three bytes a texel.
 */
#define SVBRDF_MAP_FORMAT_RGB8 2

/**
 * Four bytes a texel, the fourth 255.
 */
#define SVBRDF_MAP_FORMAT_RGBA8 3

/**
 * One byte a texel, for roughness.
 */
#define SVBRDF_MAP_FORMAT_R8 4

/**
 * Four half floats a texel, the fourth 1. Roughness: 1 (occlusion), roughness, 0 (metalness).
 * Beyond 65504, the largest half float, values are that.
 */
#define SVBRDF_MAP_FORMAT_RGBA16F 5

/**
 * Four floats a texel, the fourth 1. Roughness as in SVBRDF_MAP_FORMAT_RGBA16F.
 */
#define SVBRDF_MAP_FORMAT_RGBA32F 6

/**
 * Shares the work of fits and of calls; what runs on all cores.
 */
#define SVBRDF_THREAD_WORK 1

/**
 * Steers the fit of a session.
 */
#define SVBRDF_THREAD_FIT 2

/**
 * Calls on_progress and on_maps of a session.
 */
#define SVBRDF_THREAD_CALLBACK 3

/**
 * Takes in what svbrdf_session_push_frame_async() was given, and calls back.
 */
#define SVBRDF_THREAD_PUSH 4

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Fills a budget with defaults: pass sizeof(svbrdf_budget).
 */
svbrdf_status svbrdf_budget_init(struct svbrdf_budget *budget, size_t size);

/**
 * Limits the work on each photo from now on; NULL: no limits. A fit that an earlier budget has
 * ended goes on if this one allows it.
 */
svbrdf_status svbrdf_session_set_budget(struct svbrdf_session *session,
                                        const struct svbrdf_budget *budget);

/**
 * Address and number of a buffer's bytes, valid until svbrdf_buffer_destroy().
 */
svbrdf_status svbrdf_buffer_view(const struct svbrdf_buffer *buffer,
                                 const void **data,
                                 size_t *bytes);

/**
 * Frees a buffer; NULL is fine.
 */
svbrdf_status svbrdf_buffer_destroy(struct svbrdf_buffer *buffer);

/**
 * Reads capture.json of a folder (UTF-8) and checks every field; photos are read when pushed.
 * SVBRDF_INVALID_ARGUMENT names the field at fault. Free with svbrdf_capture_destroy().
 */
svbrdf_status svbrdf_capture_open(const char *path, struct svbrdf_capture **out);

/**
 * How many photos a capture has.
 */
svbrdf_status svbrdf_capture_frames(const struct svbrdf_capture *capture, uint32_t *count);

/**
 * Starts a session as svbrdf_session_create() with scene, sample, board, camera, flash and
 * falloff of a capture instead of those of the options.
 */
svbrdf_status svbrdf_session_create_for_capture(const struct svbrdf_session_options *options,
                                                const struct svbrdf_capture *capture,
                                                struct svbrdf_session **session);

/**
 * Reads a capture's photo and takes it in, as svbrdf_session_push_frame() or
 * svbrdf_session_push_rectified(); the report's timestamp is the index. `report` may be NULL.
 */
svbrdf_status svbrdf_session_push_capture(struct svbrdf_session *session,
                                          const struct svbrdf_capture *capture,
                                          uint32_t index,
                                          struct svbrdf_frame_report *report);

/**
 * Frees a capture; NULL is fine. Sessions do not need it.
 */
svbrdf_status svbrdf_capture_destroy(struct svbrdf_capture *capture);

/**
 * Fills a confidence with zeros: pass sizeof(svbrdf_confidence).
 */
svbrdf_status svbrdf_confidence_init(struct svbrdf_confidence *confidence, size_t size);

/**
 * The maps of the moment with the standard deviation of each at every texel, to be freed with
 * svbrdf_maps_destroy(); svbrdf_maps_export() writes both. Computed when asked for; meaningful once
 * the fit has settled. Waits for a step of the fit. SVBRDF_NO_MAPS before the first photo.
 */
svbrdf_status svbrdf_session_snapshot_confidence(const struct svbrdf_session *session,
                                                 struct svbrdf_maps **out);

/**
 * One number for each map; for maps of svbrdf_session_snapshot_confidence() only.
 */
svbrdf_status svbrdf_maps_confidence(const struct svbrdf_maps *maps,
                                     struct svbrdf_confidence *confidence);

/**
 * Standard deviation of a map at every texel, one float each: of each slope of the normal, of each
 * colour of an albedo (linear), of roughness. Errors of two texels of three are within it. For maps
 * of svbrdf_session_snapshot_confidence() only; memory of the library, freed with the maps.
 */
svbrdf_status svbrdf_maps_deviations(const struct svbrdf_maps *maps,
                                     svbrdf_map map,
                                     struct svbrdf_map_view *view);

/**
 * Fills options with defaults: pass sizeof(svbrdf_encoded_options).
 */
svbrdf_status svbrdf_encoded_options_init(struct svbrdf_encoded_options *options, size_t size);

/**
 * Fills a result with defaults: pass sizeof(svbrdf_file_info).
 */
svbrdf_status svbrdf_file_info_init(struct svbrdf_file_info *info, size_t size);

/**
 * Takes in a photo of a board that is a file in memory: JPEG, PNG, TIFF, OpenEXR or DNG, by its
 * content, as svbrdf_session_push_frame() otherwise. A file that is damaged or of another format
 * is SVBRDF_INVALID_ARGUMENT, and the message names it; nothing has changed. `options`, `info` and
 * `report` may be NULL. SVBRDF_UNSUPPORTED where svbrdf_features() lacks SVBRDF_FEATURE_FILES.
 */
svbrdf_status svbrdf_session_push_encoded(struct svbrdf_session *session,
                                          const void *bytes,
                                          size_t length,
                                          const struct svbrdf_encoded_options *options,
                                          struct svbrdf_file_info *info,
                                          struct svbrdf_frame_report *report);

/**
 * What a photo's file says of how it was taken, without reading its pixels: to sort photos by
 * camera and time before they are pushed. What it does not say keeps its default.
 */
svbrdf_status svbrdf_file_look_at(const void *bytes, size_t length, struct svbrdf_file_info *info);

/**
 * Fills options with defaults: pass sizeof(svbrdf_export_options).
 */
svbrdf_status svbrdf_export_options_init(struct svbrdf_export_options *options, size_t size);

/**
 * Exports maps into a folder (UTF-8), which is made if missing: material.glb, material.usdz, a
 * folder for every other format, and material.json, height.png and height.exr. All files are
 * written or none.
 */
svbrdf_status svbrdf_maps_export_formats(const struct svbrdf_maps *maps,
                                         const struct svbrdf_export_options *options,
                                         const char *path);

/**
 * As svbrdf_maps_export_formats(), into memory. Free with svbrdf_package_destroy().
 */
svbrdf_status svbrdf_maps_export_package(const struct svbrdf_maps *maps,
                                         const struct svbrdf_export_options *options,
                                         struct svbrdf_package **out);

/**
 * Number of files of a package.
 */
svbrdf_status svbrdf_package_count(const struct svbrdf_package *package, uint32_t *count);

/**
 * Name (UTF-8, relative, "/" between folders) and bytes of a file of a package, from index 0 on;
 * valid until svbrdf_package_destroy(). Results may be NULL.
 */
svbrdf_status svbrdf_package_file(const struct svbrdf_package *package,
                                  uint32_t index,
                                  const char **name,
                                  const void **data,
                                  size_t *bytes);

/**
 * Frees a package; NULL is fine.
 */
svbrdf_status svbrdf_package_destroy(struct svbrdf_package *package);

/**
 * Fills a fit with zeros: pass sizeof(svbrdf_frame_fit).
 */
svbrdf_status svbrdf_frame_fit_init(struct svbrdf_frame_fit *fit, size_t size);

/**
 * How the maps of the moment explain an accepted photo; meaningful once the fit has settled.
 * `index` counts the accepted photos from 0. Waits for a step of the fit.
 */
svbrdf_status svbrdf_session_frame_fit(const struct svbrdf_session *session,
                                       uint32_t index,
                                       struct svbrdf_frame_fit *fit);

/**
 * Fills options with defaults: pass sizeof(svbrdf_guide_options).
 */
svbrdf_status svbrdf_guide_options_init(struct svbrdf_guide_options *options, size_t size);

/**
 * Fills guidance with defaults: pass sizeof(svbrdf_guidance).
 */
svbrdf_status svbrdf_guidance_init(struct svbrdf_guidance *guidance, size_t size);

/**
 * Begins guidance anew, with other options: NULL for the defaults. Guidance with defaults needs no
 * beginning. Also tells that the photo asked for was not taken, or was rejected.
 */
svbrdf_status svbrdf_session_guide_begin(struct svbrdf_session *session,
                                         const struct svbrdf_guide_options *options);

/**
 * Judges a picture of the camera's preview as svbrdf_session_probe() does and tells what to do: hold, move
 * there, shoot now, or enough, by the board's place, blur, exposure, the camera's motion since the pictures
 * before, and what the fit expects of a photo from here. Call it with every picture, a few a second or
 * thirty; `info.timestamp_ns` says when it was taken, by a clock that does not jump.
 *
 * After SVBRDF_ACTION_SHOOT it answers SVBRDF_ACTION_HOLD until the photo has been pushed or
 * svbrdf_guide_options.shot_seconds have passed. Runs on the calling thread alone; waits neither for the fit
 * nor for a push. `probe` may be NULL.
 */
svbrdf_status svbrdf_session_guide(struct svbrdf_session *session,
                                   const struct svbrdf_image *image,
                                   const struct svbrdf_frame_info *info,
                                   struct svbrdf_probe *probe,
                                   struct svbrdf_guidance *guidance);

/**
 * Fills a picture description with defaults: pass sizeof(svbrdf_image).
 */
svbrdf_status svbrdf_image_init(struct svbrdf_image *image, size_t size);

/**
 * Version of the library, e.g. "0.1.0". Static, never NULL.
 */
const char *svbrdf_version(void);

/**
 * Version of the library as a number: major * 65536 + minor * 256 + patch.
 */
uint32_t svbrdf_version_number(void);

/**
 * What this build has: an OR of SVBRDF_FEATURE_ values.
 */
uint64_t svbrdf_features(void);

/**
 * Fills a view with defaults: pass sizeof(svbrdf_map_view).
 */
svbrdf_status svbrdf_map_view_init(struct svbrdf_map_view *view, size_t size);

/**
 * Width, height (texels) and size of the sample (mm) of maps. Results may be NULL.
 */
svbrdf_status svbrdf_maps_size(const struct svbrdf_maps *maps,
                               uint32_t *width,
                               uint32_t *height,
                               float *sample_mm);

/**
 * A map in memory that the library owns: made when first asked for, freed with the maps.
 */
svbrdf_status svbrdf_maps_view(const struct svbrdf_maps *maps,
                               svbrdf_map map,
                               svbrdf_map_format format,
                               struct svbrdf_map_view *view);

/**
 * Copies a map into the caller's memory, rows of `row_stride` bytes (0: no gap). The last row may
 * end with its last texel. No alignment is asked for.
 */
svbrdf_status svbrdf_maps_copy(const struct svbrdf_maps *maps,
                               svbrdf_map map,
                               svbrdf_map_format format,
                               void *data,
                               size_t bytes,
                               size_t row_stride);

/**
 * Writes normal.png, diffuse.png, specular.png, roughness.png (16 bits), maps.exr and preview.png
 * into a folder (UTF-8), which is made if missing; with maps of svbrdf_session_snapshot_confidence()
 * maps.exr has the standard deviations, too. No file is ever half-written under its name.
 */
svbrdf_status svbrdf_maps_export(const struct svbrdf_maps *maps,
                                 const char *path);

/**
 * Frees maps and every view of them; NULL is fine.
 */
svbrdf_status svbrdf_maps_destroy(struct svbrdf_maps *maps);

/**
 * Reads models from the contents of decoder.bin, encoder.onnx, photo.onnx and completion.onnx. The
 * bytes are not needed after the call. Free with svbrdf_models_destroy().
 */
svbrdf_status svbrdf_models_from_memory(const void *decoder,
                                        size_t decoder_bytes,
                                        const void *encoder,
                                        size_t encoder_bytes,
                                        const void *photo,
                                        size_t photo_bytes,
                                        const void *completion,
                                        size_t completion_bytes,
                                        struct svbrdf_models **out);

/**
 * Reads models from decoder.bin, encoder.onnx, photo.onnx and completion.onnx of a folder (UTF-8).
 * Free with svbrdf_models_destroy().
 */
svbrdf_status svbrdf_models_from_folder(const char *path, struct svbrdf_models **out);

/**
 * Frees models; NULL is fine.
 */
svbrdf_status svbrdf_models_destroy(struct svbrdf_models *models);

/**
 * Fills a board with the default one (A4, 17 x 16 squares of 11.5 mm): pass
 * sizeof(svbrdf_board).
 */
svbrdf_status svbrdf_board_init(struct svbrdf_board *board, size_t size);

/**
 * Fills a camera with zeros: pass sizeof(svbrdf_camera).
 */
svbrdf_status svbrdf_camera_init(struct svbrdf_camera *camera, size_t size);

/**
 * Fills options with defaults: pass sizeof(svbrdf_session_options).
 */
svbrdf_status svbrdf_session_options_init(struct svbrdf_session_options *options, size_t size);

/**
 * Fills photo metadata with defaults: pass sizeof(svbrdf_frame_info).
 */
svbrdf_status svbrdf_frame_info_init(struct svbrdf_frame_info *info, size_t size);

/**
 * Fills a paper with that of a plan: pass sizeof(svbrdf_paper).
 */
svbrdf_status svbrdf_paper_init(struct svbrdf_paper *paper, size_t size);

/**
 * The name of a phase in lower case, e.g. "held_lights"; "unknown" for other numbers. Static,
 * never NULL.
 */
const char *svbrdf_phase_name(svbrdf_phase phase);

/**
 * Fills a probe with defaults: pass sizeof(svbrdf_probe).
 */
svbrdf_status svbrdf_probe_init(struct svbrdf_probe *probe, size_t size);

/**
 * Judges a photo of a board, or a picture of the camera's preview, without taking it in: nothing
 * of the session changes. Answers SVBRDF_OK also for a photo that would be rejected: the probe says
 * so. `info` may be NULL; with SVBRDF_FLASH_OFF the light says nothing about the photo to come and
 * is not judged.
 *
 * A picture of another size than the camera's is taken for a preview: scaled to its width or height and
 * cut at the other sides; where that does not fit, and before a camera is known, the camera is
 * estimated from the picture. Runs on the calling thread alone; waits neither for the fit nor for
 * a push.
 */
svbrdf_status svbrdf_session_probe(const struct svbrdf_session *session,
                                   const struct svbrdf_image *image,
                                   const struct svbrdf_frame_info *info,
                                   struct svbrdf_probe *probe);

/**
 * Has every thread that the library starts from now on call `hook` first, e.g. to set its priority
 * or quality of service; NULL ends that. Set it before the first session: sessions start most of
 * their threads in svbrdf_session_create(), and threads that run already are not called on. What
 * runs outside of sessions (exports, renderings, reduced maps) is shared among threads that the
 * first hook starts, or else the first such call. The hook should not call the library.
 */
svbrdf_status svbrdf_set_thread_hook(svbrdf_thread_hook hook, void *user_data);

/**
 * Has `callback` called with the log lines of all sessions, in addition to their on_log, and with
 * faults inside the library that belong to none; NULL ends that. Lines come on many threads,
 * several at a time; those on their way when it is changed still go to the callback before.
 */
svbrdf_status svbrdf_set_log_callback(svbrdf_log_callback callback, void *user_data);

/**
 * The maps at 1 / 2^level of their size (1: half, 2: a quarter; 0: as they are), without
 * confidence: means of squares of texels, of slopes for the normals, which stay unit vectors.
 * SVBRDF_INVALID_ARGUMENT when they cannot be halved so often. Free with svbrdf_maps_destroy().
 */
svbrdf_status svbrdf_maps_reduced(const struct svbrdf_maps *maps,
                                  uint32_t level,
                                  struct svbrdf_maps **out);

/**
 * As svbrdf_session_snapshot_maps(), reduced as by svbrdf_maps_reduced(): for showing maps during a
 * session. Those of full size are not kept.
 */
svbrdf_status svbrdf_session_snapshot_reduced(const struct svbrdf_session *session,
                                              uint32_t level,
                                              struct svbrdf_maps **out);

/**
 * Fills options with defaults: pass sizeof(svbrdf_render_options).
 */
svbrdf_status svbrdf_render_options_init(struct svbrdf_render_options *options, size_t size);

/**
 * Renders maps as the fit does: radiance of each texel towards the camera, at the texel's place, by
 * Cook-Torrance with GGX. Bytes are sRGB, clipped; floats linear, 1 a white matt texel that faces a
 * light of power pi; all formats but SVBRDF_MAP_FORMAT_R8. Rows of `row_stride` bytes as in
 * svbrdf_maps_copy(). `options` NULL: the defaults. A millisecond or two at 256 x 256: reduce large
 * maps to show them under a light that moves.
 */
svbrdf_status svbrdf_maps_render(const struct svbrdf_maps *maps,
                                 const struct svbrdf_render_options *options,
                                 svbrdf_map_format format,
                                 void *data,
                                 size_t bytes,
                                 size_t row_stride);

/**
 * Fills a report with defaults: pass sizeof(svbrdf_frame_report).
 */
svbrdf_status svbrdf_frame_report_init(struct svbrdf_frame_report *report, size_t size);

/**
 * Fills a view with zeros: pass sizeof(svbrdf_next_view).
 */
svbrdf_status svbrdf_next_view_init(struct svbrdf_next_view *view, size_t size);

/**
 * Fills a progress with defaults: pass sizeof(svbrdf_progress).
 */
svbrdf_status svbrdf_progress_init(struct svbrdf_progress *progress, size_t size);

/**
 * The session as bytes, from which svbrdf_session_load_state() goes on as if nothing had happened,
 * in another process or on another machine, also with a library of a newer minor version: board,
 * camera, settings, budget, all photos as far as they are needed, maps, and the fit. The session
 * is not changed and goes on. Waits for a photo being pushed and for one step of the fit. A
 * cancelled session cannot be saved: pause it instead. Free with svbrdf_buffer_destroy().
 */
svbrdf_status svbrdf_session_save_state(const struct svbrdf_session *session,
                                        struct svbrdf_buffer **out);

/**
 * As svbrdf_session_save_state(), into a file (UTF-8) whose folder exists. What stood there is
 * replaced once everything is written, and stays when that fails.
 */
svbrdf_status svbrdf_session_save_state_to(const struct svbrdf_session *session, const char *path);

/**
 * Goes on with a saved session. Of the options count threads (0: as saved), models, callbacks,
 * user_data and memory_limit_bytes; everything else is in the state. The bytes are not needed
 * after the call. SVBRDF_BAD_STATE when they are not what was written, SVBRDF_UNSUPPORTED when a
 * newer major version wrote them; `*session` is then left as it was.
 */
svbrdf_status svbrdf_session_load_state(const struct svbrdf_session_options *options,
                                        const void *data,
                                        size_t bytes,
                                        struct svbrdf_session **session);

/**
 * As svbrdf_session_load_state() from a file (UTF-8).
 */
svbrdf_status svbrdf_session_load_state_from(const struct svbrdf_session_options *options,
                                             const char *path,
                                             struct svbrdf_session **session);

/**
 * Starts a session. On success `*session` is a handle to free with svbrdf_session_destroy();
 * otherwise it is left as it was.
 */
svbrdf_status svbrdf_session_create(const struct svbrdf_session_options *options,
                                    struct svbrdf_session **session);

/**
 * Takes a photo of a board in: copied, calibrated, rectified. When it returns SVBRDF_OK, maps that
 * know of the photo are available; the fit goes on in the background. SVBRDF_REJECTED when the
 * photo cannot be used: nothing changed. `info` and `report` may be NULL. Calls from several
 * threads are served one after the other.
 */
svbrdf_status svbrdf_session_push_frame(struct svbrdf_session *session,
                                        const struct svbrdf_image *image,
                                        const struct svbrdf_frame_info *info,
                                        struct svbrdf_frame_report *report);

/**
 * As svbrdf_session_push_frame() for a photo that shows the sample's rectangle from the top, at
 * any size. Positions of camera and light: three numbers each, mm, board frame (origin at the
 * sample's centre, X right, Y up, Z towards the camera).
 */
svbrdf_status svbrdf_session_push_rectified(struct svbrdf_session *session,
                                            const struct svbrdf_image *image,
                                            const struct svbrdf_frame_info *info,
                                            const float *camera_mm,
                                            const float *light_mm,
                                            struct svbrdf_frame_report *report);

/**
 * Takes an accepted photo back: the session is as if it had never come, calibration included. `index`
 * counts the accepted photos from 0; later ones move up by one. The fit begins anew, and when this
 * returns, the maps do not know of the photo any more; without any photo left there are none.
 * Another index, or a photo without which others would have been rejected:
 * SVBRDF_INVALID_ARGUMENT, and nothing has changed. Waits for a push and for a step of the fit.
 */
svbrdf_status svbrdf_session_remove_frame(struct svbrdf_session *session,
                                          uint32_t index);

/**
 * As svbrdf_session_push_frame(), on a thread of the session: returns once the planes are copied as
 * they are, so that their memory is the caller's again. Photos are taken in one after the other in
 * the order of the calls. When this returns SVBRDF_OK, `callback` comes exactly once, whatever
 * happens meanwhile: with SVBRDF_CANCELLED when the session is cancelled or destroyed first, with
 * SVBRDF_INVALID_ARGUMENT when the planes are not what the image says of them. Otherwise it does
 * not come. SVBRDF_BUSY when three photos are on their way already. Their copies count as memory of the
 * session: SVBRDF_MEMORY_LIMIT when with one more, and with what the largest needs to be taken in,
 * svbrdf_session_options.memory_limit_bytes would be exceeded; nothing is copied then.
 */
svbrdf_status svbrdf_session_push_frame_async(struct svbrdf_session *session,
                                              const struct svbrdf_image *image,
                                              const struct svbrdf_frame_info *info,
                                              svbrdf_pushed_callback callback,
                                              void *user_data);

/**
 * Blocks until the fit has settled on all photos so far, for at most `timeout_ms` milliseconds
 * (negative: no limit; 0: only looks). SVBRDF_TIMEOUT when it has not settled by then.
 */
svbrdf_status svbrdf_session_wait(struct svbrdf_session *session, int64_t timeout_ms);

/**
 * State of the fit; answered at once, also by a failed or cancelled session.
 */
svbrdf_status svbrdf_session_progress(const struct svbrdf_session *session,
                                      struct svbrdf_progress *progress);

/**
 * The light as found so far: position of the flash in the camera frame, three numbers, mm, and
 * ambient light as a share of the flash's at the sample's centre. Waits for a push in progress.
 * Results may be NULL.
 */
svbrdf_status svbrdf_session_light(const struct svbrdf_session *session,
                                   double *flash_offset_mm,
                                   float *ambient_fraction);

/**
 * Where the next photo tells most: of views 10 to 50 degrees off the top that which lowers the expected
 * error of renderings most. Waits for a push in progress and a step of the fit.
 */
svbrdf_status svbrdf_session_next_view(const struct svbrdf_session *session,
                                       struct svbrdf_next_view *view);

/**
 * The camera as used: given, or estimated from the photos so far; all zeros before the first photo
 * tells and for rectified photos. `sigma`, which may be NULL: standard deviations of fx, fy, cx, cy
 * (px), k1, k2, p1, p2, k3 of an estimated camera, otherwise zeros. Waits for a push in progress.
 */
svbrdf_status svbrdf_session_camera(const struct svbrdf_session *session,
                                    struct svbrdf_camera *camera,
                                    double *sigma);

/**
 * The printed sheet and the sample's height above it, as used. Waits for a push in progress.
 */
svbrdf_status svbrdf_session_paper(const struct svbrdf_session *session,
                                   struct svbrdf_paper *paper);

/**
 * Pose of an accepted photo of a board as known now: with a camera that is estimated, later photos
 * better those of earlier ones. `index` counts the accepted photos from 0. Results as in
 * svbrdf_frame_report; each may be NULL. Waits for a push in progress.
 */
svbrdf_status svbrdf_session_pose(const struct svbrdf_session *session,
                                  uint32_t index,
                                  double *rotation,
                                  double *translation_mm,
                                  double *reprojection_rms_px);

/**
 * The maps as they are now; SVBRDF_NO_MAPS before the first accepted photo. Answered at once, also
 * by a failed or cancelled session. Free with svbrdf_maps_destroy().
 */
svbrdf_status svbrdf_session_snapshot_maps(const struct svbrdf_session *session,
                                           struct svbrdf_maps **out);

/**
 * Writes the maps as they are now into a folder, as svbrdf_maps_export().
 */
svbrdf_status svbrdf_session_export(const struct svbrdf_session *session, const char *path);

/**
 * Holds the fit after the step in progress; photos are still taken in.
 */
svbrdf_status svbrdf_session_pause(struct svbrdf_session *session);

/**
 * Goes on after svbrdf_session_pause().
 */
svbrdf_status svbrdf_session_resume(struct svbrdf_session *session);

/**
 * Ends the fit after the step in progress. Photos are refused from then on; maps stay available.
 * Calls that wait return SVBRDF_CANCELLED.
 */
svbrdf_status svbrdf_session_cancel(struct svbrdf_session *session);

/**
 * Ends a session at any time, from any thread, also from its callbacks and while other threads
 * are inside its calls: those return SVBRDF_CANCELLED or their result. Blocks for the step in
 * progress at most, and for callbacks on other threads, those of photos on their way included. When
 * it has returned, no callback of the session is running or will come, but the one it was called
 * from, and those of photos on their way where that was one of them. The handle
 * is never valid again; further calls with it answer SVBRDF_INVALID_HANDLE. NULL is fine.
 */
svbrdf_status svbrdf_session_destroy(struct svbrdf_session *session);

/**
 * The board as a page to be printed at 100 %, with a ruler and its name: the file that `svbrdf board`
 * writes, in memory. `board` NULL: the default one. A board that has faults or is too large for the
 * page: SVBRDF_INVALID_ARGUMENT. Free with svbrdf_buffer_destroy().
 */
svbrdf_status svbrdf_board_print(const struct svbrdf_board *board,
                                 svbrdf_page page,
                                 svbrdf_sheet_format format,
                                 struct svbrdf_buffer **out);

/**
 * What was wrong with this thread's latest call, in English; empty when it was done. UTF-8, valid
 * until the thread's next call of the library or its end. Never NULL.
 */
const char *svbrdf_last_error_message(void);

/**
 * The name of a status in lower case, e.g. "invalid_argument"; "unknown" for other numbers.
 * Static, never NULL.
 */
const char *svbrdf_status_name(svbrdf_status status);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* SVBRDF_H */
