package org.svbrdf.scanner

import java.io.File

/** Scene of the photos, and settings of the maps. Lengths in millimetres. */
data class ScanOptions @JvmOverloads constructor(
    /** Width of the sample, mm. */
    val widthMm: Float = 100f,
    /** Height of the sample, mm. */
    val heightMm: Float = 100f,
    /** The board; null: the one that `svbrdf board` prints. */
    val board: Board? = null,
    /** The camera of all photos; null: estimated from the photos so far. */
    val camera: Camera? = null,
    /** Position of the lamp in the camera frame (x right, y down, z forward), mm; null: not known. */
    val flashOffsetMm: List<Double>? = null,
    /** Texels along each side of the maps: 256, 512, 1024 or 2048. */
    val resolution: Int = 256,
    /** How maps are found. */
    val method: Method = Method.DEEP,
    /** Whether the per-texel refinement runs. */
    val refine: Boolean = true,
    /** Threads of the fit; 0: one per core, at most 4. */
    val threads: Int = 0,
    /** Networks; null: those inside the library. */
    val models: ScannerModels? = null,
    /** Light of photos from the top; null: photos show a board. */
    val rectified: RectifiedLight? = null,
    /** Most memory a scanner may take, networks apart; 0: any amount. */
    val memoryLimitBytes: Long = 0,
    /** Height of the sample's surface above the printed side, -5 to 20 mm; null: estimated. */
    val elevationMm: Double? = null,
) {
    /** A new session, or the one saved in a file. */
    internal fun create(owner: Any, id: Long, state: File?): Long {
        val light = rectified?.power ?: listOf(0f, 0f, 0f)
        require(light.size == 3) { "RectifiedLight.power: three numbers expected" }
        val offset = flashOffsetMm?.toDoubleArray()
        require(offset == null || offset.size == 3) { "flashOffsetMm: three numbers expected" }
        val networks = models?.open() ?: 0
        val ints = intArrayOf(
            if (rectified == null) SCENE_BOARD else SCENE_RECTIFIED, resolution, method.code,
            if (refine) 1 else 0, threads, (rectified?.falloff ?: Falloff.AUTO).code,
        )
        val reals = floatArrayOf(widthMm, heightMm, light[0], light[1], light[2])
        return Native.sessionCreate(
            ints, reals, board?.numbers(), board?.dictionary?.let(Native::text),
            camera?.numbers(), offset, elevationMm ?: Double.NaN, memoryLimitBytes,
            state?.let { Native.text(it.path) }, models ?: owner, networks, id,
        )
    }

    internal companion object {
        const val SCENE_BOARD = 1
        const val SCENE_RECTIFIED = 2
    }
}

/** A printed board: squares round a rectangular hole. `rows + cols` is odd. */
data class Board @JvmOverloads constructor(
    val rows: Int,
    val cols: Int,
    val squareMm: Double,
    /** First row of the hole, from the printed top. */
    val holeRowStart: Int,
    /** First column of the hole, from the left. */
    val holeColStart: Int,
    /** Row after the hole's last. */
    val holeRowEnd: Int,
    /** Column after the hole's last. */
    val holeColEnd: Int,
    val topLeftWhite: Boolean = false,
    val whiteAlbedo: Double = 0.8,
    val blackAlbedo: Double = 0.05,
    /** With a marker in every printed white square: OpenCV's name, e.g. "DICT_4X4_250". */
    val dictionary: String? = null,
    /** Side of a marker, mm. */
    val markerMm: Double = 0.0,
    /** Whether gray patches are printed below the ring as `svbrdf board` does. */
    val patches: Boolean = false,
) {
    internal fun numbers() = doubleArrayOf(
        if (dictionary == null) 1.0 else 2.0, rows.toDouble(), cols.toDouble(),
        holeRowStart.toDouble(), holeColStart.toDouble(), holeRowEnd.toDouble(),
        holeColEnd.toDouble(), if (topLeftWhite) 1.0 else 0.0, squareMm, whiteAlbedo, blackAlbedo,
        markerMm, if (patches) 1.0 else 0.0,
    )

    /**
     * The board as a file to be printed at 100 %, as `svbrdf board` prints it. A PNG has 600 pixels per
     * inch.
     */
    @JvmOverloads
    fun print(format: SheetFormat = SheetFormat.PDF, page: Page = Page.A4): ByteArray =
        Native.boardPrint(numbers(), dictionary?.let(Native::text), page.code, format.code)

    companion object {
        /** The board that `svbrdf board` prints on A4; its hole is 115 x 126.5 mm. */
        @JvmField val DEFAULT = Board(17, 16, 11.5, 3, 3, 14, 13, patches = true)
    }
}

/** Intrinsics, px; pixel (0, 0) is the centre of the top-left pixel; OpenCV's distortion. */
data class Camera @JvmOverloads constructor(
    val width: Int,
    val height: Int,
    val fx: Double,
    val fy: Double,
    val cx: Double = 0.5 * (width - 1),
    val cy: Double = 0.5 * (height - 1),
    val k1: Double = 0.0,
    val k2: Double = 0.0,
    val p1: Double = 0.0,
    val p2: Double = 0.0,
    val k3: Double = 0.0,
) {
    internal fun numbers() = doubleArrayOf(
        width.toDouble(), height.toDouble(), fx, fy, cx, cy, k1, k2, p1, p2, k3,
    )

    internal companion object {
        fun of(v: DoubleArray) = Camera(
            v[0].toInt(), v[1].toInt(), v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10],
        )
    }
}

/** Light of photos from the top. [power]: three numbers, see `SVBRDF_FALLOFF_` in svbrdf.h. */
data class RectifiedLight @JvmOverloads constructor(
    val falloff: Falloff = Falloff.AUTO,
    val power: List<Float>? = null,
)

/** Limits of the work on each photo. */
data class Budget @JvmOverloads constructor(
    /** Seconds; null: any number. */
    val seconds: Float? = null,
    /** Steps of the optimisers; 0: any number. */
    val maxSteps: Int = 0,
    /** Whether to end once further changes are invisible in 8-bit maps. */
    val stopWhenInvisible: Boolean = false,
)
