package org.svbrdf.scanner

import kotlin.math.acos

/** The outcome of a photo. */
sealed class Outcome {
    /** The timestamp given with the photo. */
    abstract val timestampNs: Long

    /** The photo takes part in the fit. */
    data class Accepted(
        /** Photos accepted before this one. */
        val index: Int,
        /** Where the board is; null for photos from the top. */
        val pose: Pose?,
        /** Seconds from the call to maps being available. */
        val mapsSeconds: Double,
        override val timestampNs: Long,
        /** Remarks for the user. */
        val hints: Set<Hint> = emptySet(),
        /** The hints as English sentences; empty without any. */
        val advice: String = "",
        /** For [Hint.NOTHING_NEW]: index of the photo with nearly the same view. */
        val sameViewAs: Int? = null,
        /** For [Hint.NOT_LINEAR]: value of the board's black or gray over that of its white. */
        val overWhite: Float? = null,
    ) : Outcome()

    /** The photo cannot be used; nothing has changed. */
    data class Rejected(
        val reason: Rejection,
        /** Reason and remedy: an English sentence with the photo's own figures. */
        val advice: String,
        override val timestampNs: Long,
        /** The quantity of [measured] and [limit], with its unit. */
        val measure: Measure = Measure.NONE,
        /** The measured value. */
        val measured: Float = 0f,
        /** The value needed or allowed; 0: there is no single one. */
        val limit: Float = 0f,
        /**
         * For [Rejection.BLURRED]: direction of the blur, degrees clockwise from the photo's x axis;
         * null: soft all round, as out of focus.
         */
        val blurDirectionDeg: Float? = null,
    ) : Outcome()

    internal companion object {
        const val SIZE = 25

        fun of(report: DoubleArray, advice: String, timestampNs: Long): Outcome {
            if (report[0] != 1.0) {
                val direction = report[23].toFloat().takeIf { it >= 0f }
                return Rejected(
                    Rejection.of(report[1].toInt()), advice, timestampNs,
                    Measure.of(report[24].toInt()), report[21].toFloat(), report[22].toFloat(),
                    direction,
                )
            }
            val pose = when (report[3]) {
                1.0 -> Pose(report.copyOfRange(4, 13), report.copyOfRange(13, 16), report[16])
                else -> null
            }
            val hints = Hint.of(report[18].toInt())
            return Accepted(
                report[2].toInt(), pose, report[17], timestampNs, hints, advice,
                report[19].toInt().takeIf { Hint.NOTHING_NEW in hints },
                report[20].toFloat().takeIf { Hint.NOT_LINEAR in hints },
            )
        }
    }
}

/** The most informative next view. */
data class NextView(
    /** Angle off the top, degrees. */
    val tiltDeg: Float,
    /** Side to go to: degrees counter-clockwise from the board's right, seen from the top. */
    val azimuthDeg: Float,
    /** Unit vector from the sample towards the camera, board frame. */
    val direction: List<Float>,
) {
    internal companion object {
        const val SIZE = 6

        fun of(v: DoubleArray): NextView? {
            if (v[0] != 1.0) {
                return null
            }
            return NextView(v[1].toFloat(), v[2].toFloat(), List(3) { v[3 + it].toFloat() })
        }
    }
}

/** The camera as used, given or estimated. */
class UsedCamera internal constructor(
    val camera: Camera,
    /** Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3; null: it was given. */
    val sigma: DoubleArray?,
) {
    internal companion object {
        const val SIZE = 20

        fun of(v: DoubleArray): UsedCamera? {
            val sigma = v.copyOfRange(11, 20).takeIf { values -> values.any { it != 0.0 } }
            return if (v[0] == 0.0) null else UsedCamera(Camera.of(v), sigma)
        }
    }
}

/** The printed sheet and the sample on it: as planned unless the photos contradict that clearly. */
data class Paper(
    /** Scale of the print along Y relative to that along X, and its standard deviation. */
    val aspect: Double,
    val aspectSigma: Double,
    /** Rise of the left and right edges, and of the upper and lower ones, mm. */
    val bowMm: List<Double>,
    val bowSigmaMm: List<Double>,
    /** Height of the sample's surface above the board, mm, and its standard deviation. */
    val elevationMm: Double,
    val elevationSigmaMm: Double,
) {
    internal companion object {
        const val SIZE = 9

        fun of(v: DoubleArray): Paper? {
            if (v[0] != 1.0) {
                return null
            }
            return Paper(v[1], v[2], listOf(v[3], v[4]), listOf(v[5], v[6]), v[7], v[8])
        }
    }
}

/** From board (mm, X right, Y up, Z out) to camera (x right, y down, z forward). */
class Pose internal constructor(
    /** Row by row. */
    val rotation: DoubleArray,
    /** Board origin in the camera frame, mm. */
    val translationMm: DoubleArray,
    /** Reprojection error of the board's corners, px. */
    val reprojectionRmsPx: Double,
) {
    /** The camera's position in the board frame, mm. */
    val cameraMm: DoubleArray
        get() = DoubleArray(3) { column ->
            -(0..2).sumOf { rotation[3 * it + column] * translationMm[it] }
        }

    /** Angle between the view of the sample's centre and its normal, radians. */
    val angle: Double
        get() {
            val (x, y, z) = cameraMm
            return acos(z / Math.sqrt(x * x + y * y + z * z))
        }

    /** Where a point of the board (mm) is in the photo, px; null behind the camera. */
    fun project(camera: Camera, xMm: Double, yMm: Double, zMm: Double = 0.0): DoubleArray? {
        val p = DoubleArray(3) {
            rotation[3 * it] * xMm + rotation[3 * it + 1] * yMm + rotation[3 * it + 2] * zMm +
                translationMm[it]
        }
        if (p[2] <= 0.0) {
            return null
        }
        val x = p[0] / p[2]
        val y = p[1] / p[2]
        val r2 = x * x + y * y
        val radial = 1 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3))
        val u = x * radial + 2 * camera.p1 * x * y + camera.p2 * (r2 + 2 * x * x)
        val v = y * radial + camera.p1 * (r2 + 2 * y * y) + 2 * camera.p2 * x * y
        return doubleArrayOf(camera.fx * u + camera.cx, camera.fy * v + camera.cy)
    }
}

/** State of a fit. */
data class Progress(
    val state: ScanState,
    /** Photos accepted so far. */
    val photos: Int,
    /** Whether the fit has finished on all photos so far. */
    val settled: Boolean,
    /** Fraction of the work that is done, 0 to 1: on the photos of [MaterialScanner.announce], else on the latest. */
    val fraction: Float,
    /** Mean error before the fit of the latest photo. */
    val lossBefore: Float,
    /** Mean error now. */
    val loss: Float,
    /** Estimated seconds left; null when not known. */
    val secondsLeft: Float?,
    /** Grows with every newer set of maps. */
    val mapsRevision: Long,
    /** The phase of the fit. */
    val phase: Phase = Phase.NONE,
) {
    internal companion object {
        const val SIZE = 9

        fun of(v: DoubleArray) = Progress(
            ScanState.of(v[0].toInt()), v[1].toInt(), v[2] != 0.0, v[3].toFloat(), v[4].toFloat(),
            v[5].toFloat(), if (v[6] < 0.0) null else v[6].toFloat(), v[7].toLong(),
            Phase.of(v[8].toInt()),
        )
    }
}

/** The light as found so far. */
class Light internal constructor(
    /** Position of the lamp in the camera frame, mm. */
    val flashOffsetMm: DoubleArray,
    /** Ambient light as a share of the flash's at the sample's centre. */
    val ambientFraction: Float,
)

/** How far maps may be off: standard deviations. */
data class Uncertainty(
    /** Of each slope of the normal: tangent of a tilt. */
    val normal: Float,
    /** Of each colour of the diffuse albedo, linear. */
    val diffuse: Float,
    /** Of each colour of the specular albedo, linear. */
    val specular: Float,
    /** Of roughness. */
    val roughness: Float,
)
