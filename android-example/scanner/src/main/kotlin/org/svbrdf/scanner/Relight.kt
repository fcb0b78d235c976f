package org.svbrdf.scanner

import kotlin.math.exp
import kotlin.math.max
import kotlin.math.min
import kotlin.math.pow
import kotlin.math.sqrt

/**
 * Maps under a light of one's choice, seen from the top: a preview small enough for the processor,
 * with the library's own reflectance model (Cook-Torrance, GGX). Not thread-safe.
 */
class Relight(maps: MaterialMaps, step: Int = 1) {
    /** Texels in a row of the picture. */
    val width: Int = maps.width / step

    /** Rows of the picture. */
    val height: Int = maps.height / step

    private val widthMm = maps.widthMm
    private val heightMm = maps.heightMm
    private val texels = FloatArray(TEXEL * width * height)

    init {
        require(step >= 1 && width > 0 && height > 0) { "step: $step is out of range" }
        val normal = maps.floats(MapKind.NORMAL)
        val diffuse = maps.floats(MapKind.DIFFUSE)
        val specular = maps.floats(MapKind.SPECULAR)
        val roughness = maps.floats(MapKind.ROUGHNESS)
        for (y in 0 until height) {
            for (x in 0 until width) {
                val from = y * step * maps.width + x * step
                val to = TEXEL * (y * width + x)
                for (c in 0..2) {
                    texels[to + c] = normal[3 * from + c]
                    texels[to + 3 + c] = diffuse[3 * from + c]
                    texels[to + 6 + c] = specular[3 * from + c]
                }
                texels[to + 9] = roughness[from]
            }
        }
    }

    /**
     * Fills `argb` (width x height, as `Bitmap.setPixels` takes it; sRGB) for a camera and a light
     * at these places, mm from the sample's centre. A white matt texel that faces the light comes
     * out at `brightness`, however far the light is.
     */
    fun render(cameraMm: FloatArray, lightMm: FloatArray, argb: IntArray, brightness: Float = 1f) {
        require(argb.size >= width * height) { "argb: ${width * height} pixels needed" }
        require(cameraMm.size == 3 && lightMm.size == 3) { "positions: three numbers expected" }
        for (y in 0 until height) {
            val yMm = heightMm * (0.5f - (y + 0.5f) / height)
            for (x in 0 until width) {
                val xMm = widthMm * ((x + 0.5f) / width - 0.5f)
                argb[y * width + x] = texel(
                    TEXEL * (y * width + x), brightness * PI,
                    lightMm[0] - xMm, lightMm[1] - yMm, lightMm[2],
                    cameraMm[0] - xMm, cameraMm[1] - yMm, cameraMm[2],
                )
            }
        }
    }

    /** l: to the light, v: to the camera, of any length. */
    private fun texel(
        i: Int, power: Float,
        lx: Float, ly: Float, lz: Float,
        vx: Float, vy: Float, vz: Float,
    ): Int {
        val nx = texels[i]
        val ny = texels[i + 1]
        val nz = texels[i + 2]
        val l = 1f / sqrt(lx * lx + ly * ly + lz * lz)
        val v = 1f / sqrt(vx * vx + vy * vy + vz * vz)
        val hx = lx * l + vx * v
        val hy = ly * l + vy * v
        val hz = lz * l + vz * v
        val h = 1f / sqrt(hx * hx + hy * hy + hz * hz)
        val nl = max((nx * lx + ny * ly + nz * lz) * l, MIN_COSINE)
        val nv = max((nx * vx + ny * vy + nz * vz) * v, MIN_COSINE)
        val nh = max((nx * hx + ny * hy + nz * hz) * h, MIN_COSINE)
        val vh = max((vx * hx + vy * hy + vz * hz) * v * h, MIN_COSINE)
        val roughness = texels[i + 9]
        val alpha = roughness * roughness
        val alpha2 = alpha * alpha
        val k = 0.5f * alpha
        val den = nh * nh * (alpha2 - 1f) + 1f
        val s = alpha2 / (4f * PI * den * den * (nl * (1f - k) + k) * (nv * (1f - k) + k))
        // Schlick's (1 - vh)^5 as the library has it: not quite zero head on, which shows where
        // specular albedo is as good as zero.
        val fresnel = exp((-5.55473f * vh - 6.98316f) * vh * LN2)
        var color = 0xff
        for (c in 0..2) {
            val f0 = texels[i + 6 + c]
            val f = texels[i + 3 + c] / PI + s * (f0 + (1f - f0) * fresnel)
            color = color shl 8 or srgb(power * f * nl)
        }
        return color
    }

    private companion object {
        const val TEXEL = 10
        const val PI = Math.PI.toFloat()
        const val MIN_COSINE = 1e-3f
        const val LN2 = 0.6931472f

        /** Finer than 8-bit sRGB is anywhere. */
        const val STEPS = 4096
        val CURVE = ByteArray(STEPS + 1) {
            val x = it / STEPS.toFloat()
            val y = if (x <= 0.0031308f) 12.92f * x else 1.055f * x.pow(1 / 2.4f) - 0.055f
            (255f * y + 0.5f).toInt().toByte()
        }

        fun srgb(x: Float): Int {
            val i = (min(max(x, 0f), 1f) * STEPS + 0.5f).toInt()
            return CURVE[i].toInt() and 0xff
        }
    }
}
