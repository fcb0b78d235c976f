package org.svbrdf.scanner

/** The user's next action. */
enum class Action(internal val code: Int) {
    /** Something that a newer library may ask for: show [Guidance.message]. */
    OTHER(0),

    /** Correct the fault that [Probe.reason] names: a photo would be rejected. */
    ADJUST(1),

    /** Keep the camera where it is: until it is steady, or a photo has been taken in. */
    HOLD(2),

    /** Go to [Guidance.target]. */
    MOVE(3),

    /** Nothing: take the photo now, and add it. */
    SHOOT(4),

    /** Nothing more: a further photo would tell little. */
    ENOUGH(5);

    internal companion object {
        fun of(code: Int) = entries.firstOrNull { it.code == code } ?: OTHER
    }
}

/** The next action, see [MaterialScanner.guide]. */
class Guidance internal constructor(
    val action: Action,
    /** For the user, in English. */
    val message: String,
    /** The image that was judged. */
    val probe: Probe,
    /** Accepted photos so far. */
    val photos: Int,
    /** Where to go; null where the camera's place or the target is not known. */
    val target: Target?,
    /**
     * Share of the expected squared error of renderings that a photo from here would take away, 0 to 1;
     * null where it is not known.
     */
    val gain: Float?,
    /** The same of the most informative view. */
    val bestGain: Float?,
) {
    /** A place to take a photo from, as seen from where the camera is. */
    class Target internal constructor(
        /** Angle off the top, degrees. */
        val tiltDeg: Float,
        /** Side: degrees counter-clockwise from the board's right. */
        val azimuthDeg: Float,
        /**
         * From the camera to there, camera frame, mm: x right, y down, z forward. An arrow along x and y in
         * the image shows the way.
         */
        val offsetMm: FloatArray,
        /** Angle between the view and the target, seen from the sample, degrees. */
        val degrees: Float,
    )

    internal companion object {
        const val SIZE = 11

        fun of(v: DoubleArray, at: Int, message: String, probe: Probe): Guidance {
            fun number(i: Int) = v[at + i].toFloat()
            val target = if (number(2) != 1f) null else Target(
                number(3), number(4), floatArrayOf(number(5), number(6), number(7)), number(8),
            )
            return Guidance(
                Action.of(number(0).toInt()), message, probe, number(1).toInt(), target,
                number(9).takeIf { it >= 0f }, number(10).takeIf { it >= 0f },
            )
        }
    }
}

/** Limits of the guidance, see [MaterialScanner.beginGuide]. */
data class GuideOptions(
    /**
     * Gain from which on a photo is worth taking, as a share of the best view's, 0 to 1. High: fewer photos;
     * low: less walking.
     */
    val worth: Float = 0.8f,
    /** The camera is steady where the sample moves less across the image, in its widths a second. */
    val steady: Float = 0.1f,
    /** For so long, seconds. */
    val steadySeconds: Float = 0.15f,
    /** It is enough where the best view would take away less of the expected squared error, 0 to 1. */
    val enough: Float = 0.05f,
    /** But not before so many photos. */
    val least: Int = 4,
    /** And in any case with so many. */
    val most: Int = 20,
    /** Steepest view of the first photo, degrees off the top. */
    val firstTiltDeg: Float = 20f,
    /** A photo that has not been added so long after [Action.SHOOT] is not going to be, seconds. */
    val shotSeconds: Float = 3f,
)
