package org.svbrdf.scanner

/** The verdict on a photo that is not added; px are those of the image given. */
class Probe internal constructor(
    /** Why a photo like it would be rejected; null: it would be accepted. */
    val reason: Rejection?,
    /** Why, or the hints, as English sentences; empty where there is nothing to tell. */
    val advice: String,
    /** Remarks, whether it would be accepted or not. */
    val hints: Set<Hint>,
    /** For [Hint.NOTHING_NEW]: index of the photo with nearly the same view. */
    val sameViewAs: Int?,
    /** Corners of the board that were found: x, y, px. */
    val corners: List<FloatArray>,
    /** Corners inside the image; 0 where the board was not found. */
    val cornersInView: Int,
    /** Corners that the board has. */
    val cornersExpected: Int,
    /** Where the camera is, also for a photo that would be rejected; null where it is not known. */
    val view: View?,
    /** Width of the board's edges (one sigma), px; null where it is not known. */
    val blurPx: Float?,
    /** Direction of the blur, degrees clockwise from the x axis; null: all round, or not known. */
    val blurDirectionDeg: Float?,
    /** Median level of the white squares, 1 is full scale, linear; null where it is not known. */
    val whiteLevel: Float?,
    /** Share of the white squares that are clipped; null where it is not known. */
    val whiteClipped: Float?,
    /** As in [Outcome.Rejected]. */
    val measure: Measure,
    /** As in [Outcome.Rejected]. */
    val measured: Float,
    /** As in [Outcome.Rejected]. */
    val limit: Float,
    /** The timestamp given with the photo. */
    val timestampNs: Long,
) {
    /** Whether a photo like it would be accepted. */
    val acceptable: Boolean get() = reason == null

    /** Where a camera looks at the sample from, and how much of it is seen. */
    class View internal constructor(
        val pose: Pose,
        /** From the sample's centre to the camera, mm. */
        val distanceMm: Float,
        /** Angle off the top, degrees. */
        val tiltDeg: Float,
        /** Side of the camera: degrees counter-clockwise from the board's right. */
        val azimuthDeg: Float,
        /** Angle to [MaterialScanner.nextView], degrees; null when there is none. */
        val offNextDeg: Float?,
        /** Share of the sample inside the image, 0 to 1. */
        val sampleSeen: Float,
        /** Share of that which is saturated in all channels, 0 to 1. */
        val sampleClipped: Float,
        /** The sample's corners: x, y, px, clockwise from the maps' upper left; empty: unknown. */
        val samplePx: List<FloatArray>,
        /** Mean scale of the sample, px/mm: a texel of the maps wants one pixel. */
        val pxPerMm: Float,
    )

    internal companion object {
        const val SIZE = 44
        const val CORNERS = 1024

        private fun known(value: Double): Float? = value.toFloat().takeIf { it >= 0f }

        private fun pairs(count: Int, at: (Int) -> Float) =
            List(count) { floatArrayOf(at(2 * it), at(2 * it + 1)) }

        fun of(v: DoubleArray, corners: FloatArray, advice: String, timestampNs: Long): Probe {
            val view = if (v[7] != 1.0) null else View(
                Pose(v.copyOfRange(8, 17), v.copyOfRange(17, 20), v[20]), v[21].toFloat(),
                v[22].toFloat(), v[23].toFloat(), known(v[24]), v[25].toFloat(), v[26].toFloat(),
                if (v[27].isNaN()) emptyList() else pairs(4) { v[27 + it].toFloat() },
                v[35].toFloat(),
            )
            val hints = Hint.of(v[2].toInt())
            return Probe(
                if (v[0] == 1.0) null else Rejection.of(v[1].toInt()), advice, hints,
                v[3].toInt().takeIf { Hint.NOTHING_NEW in hints },
                pairs(minOf(v[4].toInt(), CORNERS)) { corners[it] }, v[5].toInt(), v[6].toInt(),
                view, known(v[36]), known(v[37]), known(v[38]), known(v[39]),
                Measure.of(v[43].toInt()), v[41].toFloat(), v[42].toFloat(), timestampNs,
            )
        }
    }
}

/** How maps explain an accepted photo. */
data class PhotoFit(
    /** Median absolute log residual of its texels: a relative error. */
    val residual: Float,
    /** Mean weight of its texels, 0 to 1. */
    val weight: Float,
    /** Whether it contradicts the others; of fewer than three photos none does. */
    val outlier: Boolean,
)

/** Something to tell about an accepted photo. */
data class PhotoHint(
    /** Number of the photo among the accepted ones, from 0. */
    val index: Int,
    /** Stable name for programs, such as `two_groups`. */
    val code: String,
    /** An English sentence: the observation with its figure, and the remedy. */
    val text: String,
)
