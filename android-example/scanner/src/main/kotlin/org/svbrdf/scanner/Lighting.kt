package org.svbrdf.scanner

/**
 * Camera and light of a rendering: positions in mm from the sample's centre, X right, Y up, Z towards
 * the camera. Three numbers each.
 */
class Lighting @JvmOverloads constructor(
    val lightMm: FloatArray = floatArrayOf(0f, 0f, 300f),
    val cameraMm: FloatArray = floatArrayOf(0f, 0f, 300f),
    /** Strength of the light per channel; pi: a white matt texel that faces it comes out at 1. */
    val power: FloatArray = FloatArray(3) { Math.PI.toFloat() },
    /** Radiance of a uniform surround per channel. */
    val ambient: FloatArray = FloatArray(3),
    /** [Falloff.NONE] or [Falloff.INVERSE_SQUARE]. */
    val falloff: Falloff = Falloff.NONE,
) {
    internal fun numbers(): FloatArray {
        val parts = listOf(cameraMm, lightMm, power, ambient)
        require(parts.all { it.size == 3 }) { "Lighting: three numbers each expected" }
        return FloatArray(12) { parts[it / 3][it % 3] }
    }
}
