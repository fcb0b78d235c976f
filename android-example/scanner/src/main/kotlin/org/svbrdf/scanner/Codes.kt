package org.svbrdf.scanner

// The numbers of svbrdf.h.

/** Optional features of a build of the native library. */
enum class Feature(internal val code: Long) {
    /** The networks are inside. */
    EMBEDDED_MODELS(1),
    YUV(2),
    RAW(4),
}

/** How an image lies in memory; 16-bit numbers and floats in the machine's byte order. */
enum class PixelFormat(internal val code: Int) {
    RGB8(1),
    RGBA8(2),
    RGB16(3),
    RGBA16(4),

    /** Half floats, linear. */
    RGBA_F16(5),

    /** Linear. */
    RGB_F32(6),

    /** Linear. */
    RGBA_F32(7),

    /** Three planes, as Android's `YUV_420_888`. */
    YUV420(8),

    /** Sensor values behind a Bayer mosaic, as Android's `RAW_SENSOR`. */
    BAYER16(9),

    /** Blue first. */
    BGRA8(10),

    /** As [YUV420] with 10 bits in the upper ones of 16-bit words: Android's `YCBCR_P010`. */
    P010(11),
}

/** Transfer curve of stored values. A camera's own tone curve is none of these: switch it off. */
enum class Transfer(internal val code: Int) {
    LINEAR(1), SRGB(2), GAMMA22(3),

    /** ITU-R BT.2100, scene linear: 1 at the largest signal. */
    HLG(4),

    /** ITU-R BT.2100: 1 at 203 cd/m². */
    PQ(5),
}

/** Primaries of RGB; all but [REC709] are converted to that in linear light. */
enum class Primaries(internal val code: Int) { REC709(1), DISPLAY_P3(2), REC2020(3) }

/** How luma and chroma were made; Android's cameras: [BT601_FULL]. */
enum class YuvMatrix(internal val code: Int) {
    BT601_FULL(1), BT601_LIMITED(2), BT709_FULL(3), BT709_LIMITED(4),
    BT2020_FULL(5), BT2020_LIMITED(6),
}

/** Colours of the top-left 2 x 2 sensor pixels, row by row. */
enum class BayerPattern(internal val code: Int) { RGGB(1), GRBG(2), GBRG(3), BGGR(4) }

/** One of the maps. Row 0 is the sample's +Y edge, column 0 its -X edge. */
enum class MapKind(internal val code: Int, internal val channels: Int) {
    /** Unit normal, X right, Y up, Z out of the surface; 8 bits: (n + 1) / 2. */
    NORMAL(1, 3),

    /** Diffuse albedo, linear Rec. 709; 8 bits: sRGB, as glTF's base colour. */
    DIFFUSE(2, 3),

    /** Specular albedo F0, linear Rec. 709; 8 bits: sRGB. */
    SPECULAR(3, 3),

    /**
     * Roughness, GGX alpha = roughness²; 8 bits: glTF's occlusion, roughness, metalness. Where the
     * material is anisotropic: of the smaller alpha.
     */
    ROUGHNESS(4, 1),

    /** [NORMAL] with Y down (DirectX, Unreal). */
    NORMAL_DIRECTX(5, 3),

    /**
     * Of materials with [Lobe.ANISOTROPY] only, as glTF's KHR_materials_anisotropy: cosine and sine of
     * the direction of the larger alpha, counter-clockwise from X, and strength; that alpha is
     * mix(alpha, 1, strength²). 8 bits: (cosine + 1) / 2, (sine + 1) / 2, strength.
     */
    ANISOTROPY(6, 3),

    /** Of materials with [Lobe.COAT] only: weight, roughness, 0, as glTF's KHR_materials_clearcoat. */
    COAT(7, 3),

    /** Of materials with [Lobe.SHEEN] only: colour, as glTF's KHR_materials_sheen, linear Rec. 709; 8 bits: sRGB. */
    SHEEN(8, 3),

    /** Of materials with [Lobe.SHEEN] only: roughness of the sheen. */
    SHEEN_ROUGHNESS(9, 1),
}

/** Optional lobes of a material. */
enum class Lobe(internal val code: Int) {
    /** The highlight is longer in one direction: [MapKind.ANISOTROPY]. */
    ANISOTROPY(1),

    /** A clear coat: [MapKind.COAT]. */
    COAT(2),

    /** Sheen of cloth: [MapKind.SHEEN] and [MapKind.SHEEN_ROUGHNESS]. */
    SHEEN(4),
}

/** How texels lie in memory; numbers of more than a byte in the machine's byte order. */
enum class MapFormat(internal val code: Int) {
    /** Floats: three a texel, one for roughness. */
    F32(1),
    RGB8(2),

    /** The fourth is 255. */
    RGBA8(3),

    /** For roughness only. */
    R8(4),

    /** Half floats; the fourth is 1. Roughness: 1, roughness, 0. */
    RGBA16F(5),

    /** As [RGBA16F], floats. */
    RGBA32F(6);

    /** Bytes of a texel. */
    internal fun bytes(channels: Int): Int = when (this) {
        F32 -> 4 * channels
        RGB8 -> 3
        RGBA8 -> 4
        R8 -> 1
        RGBA16F -> 8
        RGBA32F -> 16
    }
}

/** Paper that a board is printed on. */
enum class Page(internal val code: Int) { A4(1), LETTER(2) }

/** Format of a printed board. */
enum class SheetFormat(internal val code: Int) { PDF(1), SVG(2), PNG(3) }

/** The quantity of a rejection's value, and its unit. */
enum class Measure(internal val code: Int) {
    /** Something that a newer library measures. */
    OTHER(-1),

    /** Nothing was measured. */
    NONE(0),

    /** Corners found; the limit is the number needed. */
    CORNERS(1),

    /** Reprojection error of the corners, px. */
    REPROJECTION_PX(2),

    /** Width of edges (one sigma), px. */
    BLUR_PX(3),

    /** Level of the white squares, 1 is full scale. */
    WHITE_LEVEL(4),

    /** Share of pixels that are clipped, 0 to 1. */
    CLIPPED_SHARE(5),

    /** Angle of the camera off the vertical, degrees; the limit is the largest that is allowed. */
    TILT_DEG(6),

    /** Share of the sample that is seen, 0 to 1. */
    SAMPLE_SHARE(7),

    /** Focal length over that of the scanner's camera. */
    FOCAL_RATIO(8),

    /** Side of the board's squares, px; the limit is the side needed. */
    SQUARE_PX(9),

    /** Relative amplitude of the stripes. */
    STRIPES(10),

    /** Value of the black squares over that of white; the limit is the ratio as printed. */
    OVER_WHITE(11);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: OTHER
    }
}

/** Role of a thread of the library. */
enum class ThreadRole(internal val code: Int) {
    /** Something that a newer library does. */
    OTHER(0),

    /** Shares the work of fits and of calls. */
    WORK(1),

    /** Steers the fit of a scanner. */
    FIT(2),

    /** Calls [MaterialScanner.Listener.onProgress] and [MaterialScanner.Listener.onMaps]. */
    CALLBACK(3),

    /** Adds photos of [MaterialScanner.addPhotoAsync], and reports their outcomes. */
    PHOTOS(4);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: OTHER
    }
}

/** How maps are found. */
enum class Method(internal val code: Int) {
    /** Networks, then per-texel refinement. */
    DEEP(1),

    /** Inverse rendering on the maps themselves. */
    CLASSIC(2),
}

/** Light of photos from the top: how it falls off. */
enum class Falloff(internal val code: Int) { AUTO(1), INVERSE_SQUARE(2), NONE(3) }

/** The light of a photo. */
enum class Flash(internal val code: Int) { UNKNOWN(0), OFF(1), FIRED(2), TORCH(3) }

/** How much a log line matters. */
enum class LogLevel(internal val code: Int) {
    ERROR(1), WARNING(2), INFO(3), DEBUG(4);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: INFO
    }
}

/** State of a scanner. */
enum class ScanState(internal val code: Int) {
    /** Nothing: no photo yet, or the fit has settled on all photos so far. */
    READY(1), FITTING(2), PAUSED(3), CANCELLED(4),

    /** A fault inside the library; [MaterialScanner.snapshot] still works. */
    FAILED(5);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: FITTING
    }
}

/** Phase of a fit. */
enum class Phase(internal val code: Int) {
    NONE(0),

    /** Something that a newer library may do. */
    OTHER(1),

    /** Looks for maps that explain all photographs. */
    FIT(2),

    /** Brings back the detail of every texel. */
    REFINE(3);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: OTHER
    }
}

/** Why a photo was not used. */
enum class Rejection(internal val code: Int) {
    /** A reason that a newer library may give. */
    OTHER(1),
    WRONG_SIZE(2),
    BOARD_NOT_FOUND(3),
    TOO_FEW_CORNERS(4),
    POSE_UNCERTAIN(5),
    BLURRED(6),
    TOO_DARK(7),
    CLIPPED(8),
    TOO_GRAZING(9),
    SAMPLE_OUTSIDE(10),
    LIGHT_NOT_VISIBLE(11),
    NOT_FINITE(12),
    PLACEMENT_AMBIGUOUS(13),
    BOARD_DIFFERS(14),
    OTHER_CAMERA(15),
    SQUARES_TOO_SMALL(16),
    FLICKERS(17),
    EDITED(18);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: OTHER
    }
}

/** Something to tell about a photo that was accepted; [Outcome.Accepted.advice] has the words. */
enum class Hint(internal val code: Int) {
    /** Something that a newer library may tell. */
    OTHER(1),

    /** An earlier photo has nearly the same view: [Outcome.Accepted.sameViewAs]. */
    NOTHING_NEW(2),

    /** The board's grays are not those of a linear photo: a tone curve is on. */
    NOT_LINEAR(4);

    internal companion object {
        fun of(bits: Int): Set<Hint> {
            val known = entries.filter { bits and it.code != 0 }.toSet()
            return if (bits and 7.inv() != 0) known + OTHER else known
        }
    }
}

/** Kind of a [ScannerException]. */
enum class Fault(internal val code: Int) {
    /** Three photos of [MaterialScanner.addPhotoAsync] are on their way: try again when one is through. */
    BUSY(4),

    /** The material does not show this [Lobe], so that there is no such map. */
    NO_LOBE(5),

    /** The scanner was cancelled or closed meanwhile. */
    CANCELLED(-3),

    /** The models are damaged or do not fit this version. */
    BAD_MODEL(-5),

    /** Something that this build of the library lacks. */
    UNSUPPORTED(-6),

    /** A fault inside the library; the scanner answers this from now on. */
    FAILED(-7),

    /** The bytes to be restored are damaged. */
    BAD_STATE(-8),

    /** It would need more than [ScanOptions.memoryLimitBytes]; nothing changed. */
    MEMORY_LIMIT(-9);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: FAILED
    }
}

/** A fault that is neither an argument's nor a file's. */
class ScannerException internal constructor(val fault: Fault, message: String) :
    RuntimeException(message)
