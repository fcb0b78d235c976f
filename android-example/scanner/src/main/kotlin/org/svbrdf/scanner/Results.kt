package org.svbrdf.scanner

import kotlin.math.acos

/** What became of a photo. */
sealed class Pushed {
    /** The timestamp given with the photo. */
    abstract val timestampNs: Long

    /** The photo takes part in the fit. */
    data class Accepted(
        /** Photos accepted before this one. */
        val index: Int,
        /** Where the board is; null for photos from the top. */
        val pose: Pose?,
        /** Error of the board's corners, px. */
        val reprojectionRmsPx: Double,
        /** Seconds from the call to maps being available. */
        val mapsSeconds: Double,
        override val timestampNs: Long,
    ) : Pushed()

    /** The photo cannot be used; nothing has changed. */
    data class Rejected(
        val reason: Rejection,
        /** Why, and what helps: an English sentence with the photo's own figures. */
        val advice: String,
        override val timestampNs: Long,
    ) : Pushed()

    internal companion object {
        const val SIZE = 18

        fun of(report: DoubleArray, advice: ByteArray?, timestampNs: Long): Pushed {
            if (advice != null) {
                val reason = Rejection.of(report[1].toInt())
                return Rejected(reason, String(advice, Charsets.UTF_8), timestampNs)
            }
            val pose = when (report[3]) {
                1.0 -> Pose(report.copyOfRange(4, 13), report.copyOfRange(13, 16))
                else -> null
            }
            return Accepted(report[2].toInt(), pose, report[16], report[17], timestampNs)
        }
    }
}

/** From board (mm, X right, Y up, Z out) to camera (x right, y down, z forward). */
class Pose internal constructor(
    /** Row by row. */
    val rotation: DoubleArray,
    /** Board origin in the camera frame, mm. */
    val translationMm: DoubleArray,
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
    /** Share of the work on the photos so far that is done, 0 to 1. */
    val fraction: Float,
    /** Mean error before the fit of the latest photo. */
    val lossBefore: Float,
    /** Mean error now. */
    val loss: Float,
    /** Estimated seconds left; null when not known. */
    val secondsLeft: Float?,
    /** Grows with every newer set of maps. */
    val mapsRevision: Long,
) {
    internal companion object {
        const val SIZE = 8

        fun of(v: DoubleArray) = Progress(
            ScanState.of(v[0].toInt()), v[1].toInt(), v[2] != 0.0, v[3].toFloat(), v[4].toFloat(),
            v[5].toFloat(), if (v[6] < 0.0) null else v[6].toFloat(), v[7].toLong(),
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
