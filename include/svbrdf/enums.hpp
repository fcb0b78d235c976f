// Part of svbrdf.hpp: the constants of svbrdf.h as enumerations; svbrdf.h describes each.
#ifndef SVBRDF_ENUMS_HPP
#define SVBRDF_ENUMS_HPP

#include <type_traits>

#include "../svbrdf.h"

namespace svbrdf {

/// The number that a field of a C struct wants: `options.scene = to_c(Scene::rectified)`. The way
/// back is `Scene{options.scene}`.
template <typename Enum>
constexpr std::underlying_type_t<Enum> to_c(Enum value) noexcept {
    static_assert(std::is_enum_v<Enum>);
    return static_cast<std::underlying_type_t<Enum>>(value);
}

/// Status of a call. Values may be added.
enum class StatusCode : svbrdf_status {
    ok = SVBRDF_OK,
    rejected = SVBRDF_REJECTED,
    timeout = SVBRDF_TIMEOUT,
    no_maps = SVBRDF_NO_MAPS,
    busy = SVBRDF_BUSY,
    no_lobe = SVBRDF_NO_LOBE,
    invalid_argument = SVBRDF_INVALID_ARGUMENT,
    invalid_handle = SVBRDF_INVALID_HANDLE,
    cancelled = SVBRDF_CANCELLED,
    io = SVBRDF_IO,
    bad_model = SVBRDF_BAD_MODEL,
    unsupported = SVBRDF_UNSUPPORTED,
    failed = SVBRDF_FAILED,
    bad_state = SVBRDF_BAD_STATE,
    memory_limit = SVBRDF_MEMORY_LIMIT,
};

/// Scene of the photos.
enum class Scene : svbrdf_scene {
    board = SVBRDF_SCENE_BOARD,
    rectified = SVBRDF_SCENE_RECTIFIED,
};

/// How the maps are found.
enum class Method : svbrdf_method {
    deep = SVBRDF_METHOD_DEEP,
    classic = SVBRDF_METHOD_CLASSIC,
};

/// How the light of rectified photos falls off.
enum class Falloff : svbrdf_falloff {
    automatic = SVBRDF_FALLOFF_AUTO,
    inverse_square = SVBRDF_FALLOFF_INVERSE_SQUARE,
    none = SVBRDF_FALLOFF_NONE,
};

/// Kinds of board.
enum class BoardKind : svbrdf_board_kind {
    checkerboard_ring = SVBRDF_BOARD_CHECKERBOARD_RING,
    charuco_ring = SVBRDF_BOARD_CHARUCO_RING,
};

/// Layouts of an image in memory.
enum class PixelFormat : svbrdf_pixel_format {
    rgb8 = SVBRDF_PIXEL_RGB8,
    rgba8 = SVBRDF_PIXEL_RGBA8,
    rgb16 = SVBRDF_PIXEL_RGB16,
    rgba16 = SVBRDF_PIXEL_RGBA16,
    rgba_f16 = SVBRDF_PIXEL_RGBA_F16,
    rgb_f32 = SVBRDF_PIXEL_RGB_F32,
    rgba_f32 = SVBRDF_PIXEL_RGBA_F32,
    yuv420 = SVBRDF_PIXEL_YUV420,
    bayer16 = SVBRDF_PIXEL_BAYER16,
    bgra8 = SVBRDF_PIXEL_BGRA8,
    p010 = SVBRDF_PIXEL_P010,
};

/// Transfer curves of stored values.
enum class Transfer : svbrdf_transfer {
    linear = SVBRDF_TRANSFER_LINEAR,
    srgb = SVBRDF_TRANSFER_SRGB,
    gamma22 = SVBRDF_TRANSFER_GAMMA22,
    hlg = SVBRDF_TRANSFER_HLG,
    pq = SVBRDF_TRANSFER_PQ,
};

/// Primaries of RGB.
enum class Primaries : svbrdf_primaries {
    rec709 = SVBRDF_PRIMARIES_REC709,
    display_p3 = SVBRDF_PRIMARIES_DISPLAY_P3,
    rec2020 = SVBRDF_PRIMARIES_REC2020,
};

/// How luma and chroma were made.
enum class YuvMatrix : svbrdf_yuv_matrix {
    bt601_full = SVBRDF_YUV_BT601_FULL,
    bt601_limited = SVBRDF_YUV_BT601_LIMITED,
    bt709_full = SVBRDF_YUV_BT709_FULL,
    bt709_limited = SVBRDF_YUV_BT709_LIMITED,
    bt2020_full = SVBRDF_YUV_BT2020_FULL,
    bt2020_limited = SVBRDF_YUV_BT2020_LIMITED,
};

/// Colours of the top-left 2 x 2 sensor pixels, row by row.
enum class BayerPattern : svbrdf_bayer_pattern {
    rggb = SVBRDF_BAYER_RGGB,
    grbg = SVBRDF_BAYER_GRBG,
    gbrg = SVBRDF_BAYER_GBRG,
    bggr = SVBRDF_BAYER_BGGR,
};

/// The light of a photo.
enum class Flash : svbrdf_flash {
    unknown = SVBRDF_FLASH_UNKNOWN,
    off = SVBRDF_FLASH_OFF,
    fired = SVBRDF_FLASH_FIRED,
    torch = SVBRDF_FLASH_TORCH,
};

/// Why a photo was not used. Values may be added.
enum class Rejection : svbrdf_rejection {
    none = SVBRDF_REJECTION_NONE,
    other = SVBRDF_REJECTION_OTHER,
    wrong_size = SVBRDF_REJECTION_WRONG_SIZE,
    board_not_found = SVBRDF_REJECTION_BOARD_NOT_FOUND,
    too_few_corners = SVBRDF_REJECTION_TOO_FEW_CORNERS,
    pose_uncertain = SVBRDF_REJECTION_POSE_UNCERTAIN,
    blurred = SVBRDF_REJECTION_BLURRED,
    too_dark = SVBRDF_REJECTION_TOO_DARK,
    clipped = SVBRDF_REJECTION_CLIPPED,
    too_grazing = SVBRDF_REJECTION_TOO_GRAZING,
    sample_outside = SVBRDF_REJECTION_SAMPLE_OUTSIDE,
    light_not_visible = SVBRDF_REJECTION_LIGHT_NOT_VISIBLE,
    not_finite = SVBRDF_REJECTION_NOT_FINITE,
    placement_ambiguous = SVBRDF_REJECTION_PLACEMENT_AMBIGUOUS,
    board_differs = SVBRDF_REJECTION_BOARD_DIFFERS,
    other_camera = SVBRDF_REJECTION_OTHER_CAMERA,
    squares_too_small = SVBRDF_REJECTION_SQUARES_TOO_SMALL,
    flickers = SVBRDF_REJECTION_FLICKERS,
    edited = SVBRDF_REJECTION_EDITED,
};

/// Hints about an accepted photo: bits. Some may be added.
enum class Hint : svbrdf_hints {
    other = SVBRDF_HINT_OTHER,
    nothing_new = SVBRDF_HINT_NOTHING_NEW,
    not_linear = SVBRDF_HINT_NOT_LINEAR,
};

/// Remarks about a photo's file: bits. Some may be added.
enum class Remark : svbrdf_remarks {
    profile_unusable = SVBRDF_REMARK_PROFILE_UNUSABLE,
    gain_map = SVBRDF_REMARK_GAIN_MAP,
    mirrored = SVBRDF_REMARK_MIRRORED,
    no_exposure = SVBRDF_REMARK_NO_EXPOSURE,
    no_flash = SVBRDF_REMARK_NO_FLASH,
    end_missing = SVBRDF_REMARK_END_MISSING,
    gray = SVBRDF_REMARK_GRAY,
};

/// The user's next action.
enum class Action : svbrdf_action {
    adjust = SVBRDF_ACTION_ADJUST,
    hold = SVBRDF_ACTION_HOLD,
    move = SVBRDF_ACTION_MOVE,
    shoot = SVBRDF_ACTION_SHOOT,
    enough = SVBRDF_ACTION_ENOUGH,
};

/// State of a session.
enum class State : svbrdf_state {
    ready = SVBRDF_STATE_READY,
    fitting = SVBRDF_STATE_FITTING,
    paused = SVBRDF_STATE_PAUSED,
    cancelled = SVBRDF_STATE_CANCELLED,
    failed = SVBRDF_STATE_FAILED,
};

/// Phase of a fit. Values may be added.
enum class Phase : svbrdf_phase {
    none = SVBRDF_PHASE_NONE,
    other = SVBRDF_PHASE_OTHER,
    fit = SVBRDF_PHASE_FIT,
    refine = SVBRDF_PHASE_REFINE,
};

/// How much a log line matters.
enum class LogLevel : svbrdf_log_level {
    error = SVBRDF_LOG_ERROR,
    warning = SVBRDF_LOG_WARNING,
    info = SVBRDF_LOG_INFO,
    debug = SVBRDF_LOG_DEBUG,
};

/// One of the maps.
enum class Map : svbrdf_map {
    normal = SVBRDF_MAP_NORMAL,
    diffuse = SVBRDF_MAP_DIFFUSE,
    specular = SVBRDF_MAP_SPECULAR,
    roughness = SVBRDF_MAP_ROUGHNESS,
    normal_directx = SVBRDF_MAP_NORMAL_DIRECTX,
    anisotropy = SVBRDF_MAP_ANISOTROPY,
    coat = SVBRDF_MAP_COAT,
    sheen = SVBRDF_MAP_SHEEN,
    sheen_roughness = SVBRDF_MAP_SHEEN_ROUGHNESS,
};

/// Optional lobes of a material: bits. Some may be added.
enum class Lobe : svbrdf_lobes {
    anisotropy = SVBRDF_LOBE_ANISOTROPY,
    coat = SVBRDF_LOBE_COAT,
    sheen = SVBRDF_LOBE_SHEEN,
};

/// How the texels of a map are laid out.
enum class MapFormat : svbrdf_map_format {
    f32 = SVBRDF_MAP_FORMAT_F32,
    rgb8 = SVBRDF_MAP_FORMAT_RGB8,
    rgba8 = SVBRDF_MAP_FORMAT_RGBA8,
    r8 = SVBRDF_MAP_FORMAT_R8,
    rgba16f = SVBRDF_MAP_FORMAT_RGBA16F,
    rgba32f = SVBRDF_MAP_FORMAT_RGBA32F,
};

/// How exported textures are stored.
enum class TextureFormat : svbrdf_texture_format {
    png8 = SVBRDF_TEXTURE_PNG8,
    png16 = SVBRDF_TEXTURE_PNG16,
    jpeg = SVBRDF_TEXTURE_JPEG,
};

/// Paper that a board is printed on.
enum class Page : svbrdf_page {
    a4 = SVBRDF_PAGE_A4,
    letter = SVBRDF_PAGE_LETTER,
};

/// File formats of a printed board.
enum class SheetFormat : svbrdf_sheet_format {
    pdf = SVBRDF_SHEET_PDF,
    svg = SVBRDF_SHEET_SVG,
    png = SVBRDF_SHEET_PNG,
};

/// The quantity of a rejection's value, and its unit. Values may be added.
enum class Measure : svbrdf_measure {
    none = SVBRDF_MEASURE_NONE,
    corners = SVBRDF_MEASURE_CORNERS,
    reprojection_px = SVBRDF_MEASURE_REPROJECTION_PX,
    blur_px = SVBRDF_MEASURE_BLUR_PX,
    white_level = SVBRDF_MEASURE_WHITE_LEVEL,
    clipped_share = SVBRDF_MEASURE_CLIPPED_SHARE,
    tilt_deg = SVBRDF_MEASURE_TILT_DEG,
    sample_share = SVBRDF_MEASURE_SAMPLE_SHARE,
    focal_ratio = SVBRDF_MEASURE_FOCAL_RATIO,
    square_px = SVBRDF_MEASURE_SQUARE_PX,
    stripes = SVBRDF_MEASURE_STRIPES,
    over_white = SVBRDF_MEASURE_OVER_WHITE,
};

/// Role of a thread of the library. Values may be added.
enum class Thread : svbrdf_thread {
    work = SVBRDF_THREAD_WORK,
    fit = SVBRDF_THREAD_FIT,
    callback = SVBRDF_THREAD_CALLBACK,
    photos = SVBRDF_THREAD_PHOTOS,
};

}  // namespace svbrdf

#endif
