package org.svbrdf.scanner

/**
 * Values of maps, row by row, as [MaterialMaps.floats] gives them: three a texel, one for [roughness] and
 * [sheenRoughness]. Without [anisotropy], [coat] or [sheen] the material does not have that lobe; [sheen] and
 * [sheenRoughness] come together.
 */
class MapValues @JvmOverloads constructor(
    val width: Int,
    val height: Int,
    /** Width of the sample, mm. */
    val widthMm: Float,
    /** Height of the sample, mm. */
    val heightMm: Float,
    val normal: FloatArray,
    val diffuse: FloatArray,
    val specular: FloatArray,
    val roughness: FloatArray,
    val anisotropy: FloatArray? = null,
    val coat: FloatArray? = null,
    val sheen: FloatArray? = null,
    val sheenRoughness: FloatArray? = null,
) {
    internal fun all(): Array<FloatArray?> =
        arrayOf(normal, diffuse, specular, roughness, anisotropy, coat, sheen, sheenRoughness)
}
