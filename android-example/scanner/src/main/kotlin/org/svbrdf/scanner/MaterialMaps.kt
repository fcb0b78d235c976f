package org.svbrdf.scanner

import java.io.File
import java.nio.ByteBuffer
import java.nio.ByteOrder
import java.nio.FloatBuffer

/** Maps at one moment, independent of the scanner they came from. */
class MaterialMaps internal constructor(maps: Long) : AutoCloseable {
    private val handle = Handle(this, maps, Native::mapsDestroy)
    private val size: DoubleArray = DoubleArray(4).also { Native.mapsSize(this, maps, it) }

    /** Texels in a row. */
    val width: Int get() = size[0].toInt()

    /** Rows. */
    val height: Int get() = size[1].toInt()

    /** Width of the sample, mm. */
    val widthMm: Float get() = size[2].toFloat()

    /** Height of the sample, mm. */
    val heightMm: Float get() = size[3].toFloat()

    /** Optional lobes of the material; the map of another one is [Fault.NO_LOBE]. */
    val lobes: Set<Lobe>
        get() = Native.mapsLobes(this, handle.now).let { bits -> Lobe.entries.filter { bits and it.code != 0 }.toSet() }

    /** Linear values, row by row: three a texel, one for roughness. A copy. */
    fun floats(map: MapKind): FloatBuffer =
        texels(map, MapFormat.F32).order(ByteOrder.nativeOrder()).asFloatBuffer()

    /** Four bytes a texel, ready for `glTexImage2D` or a `Bitmap`. A copy. */
    fun rgba8(map: MapKind): ByteBuffer = texels(map, MapFormat.RGBA8)

    /** The same into a direct buffer of the caller's, from its start. */
    fun rgba8(map: MapKind, into: ByteBuffer) = texels(map, MapFormat.RGBA8, into)

    /** A map in any format, row by row. A copy. */
    fun texels(map: MapKind, format: MapFormat): ByteBuffer =
        ByteBuffer.allocateDirect(format.bytes(map.channels) * width * height)
            .also { texels(map, format, it) }

    /** The same into a direct buffer of the caller's, from its start. */
    fun texels(map: MapKind, format: MapFormat, into: ByteBuffer) {
        Native.mapsCopy(this, handle.now, map.code, format.code, direct(into), into.capacity().toLong())
    }

    /**
     * The maps at 1 / 2^[level] of their size, without uncertainty: means of squares of texels. Close
     * them as well.
     */
    fun reduced(level: Int): MaterialMaps = MaterialMaps(Native.mapsReduced(this, handle.now, level))

    /**
     * Renders the maps into a direct buffer, from its start: each texel as the camera sees it, at its
     * place. [MapFormat.RGBA8] is sRGB, as `Bitmap.copyPixelsFromBuffer` takes it; floats are linear.
     * Some milliseconds at 256 x 256: [reduced] maps follow a finger.
     */
    @JvmOverloads
    fun render(lighting: Lighting, into: ByteBuffer, format: MapFormat = MapFormat.RGBA8) =
        Native.mapsRender(
            this, handle.now, lighting.numbers(), lighting.falloff.code, format.code, direct(into),
            into.capacity().toLong(),
        )

    /**
     * Standard deviation of the expected errors of each map as a whole. For maps of
     * [MaterialScanner.snapshotWithUncertainty] only.
     */
    val uncertainty: Uncertainty
        get() {
            val v = DoubleArray(4).also { Native.mapsUncertainty(this, handle.now, it) }
            return Uncertainty(v[0].toFloat(), v[1].toFloat(), v[2].toFloat(), v[3].toFloat())
        }

    /**
     * The same at every texel, row by row: two errors of three are within it. A copy. One value a texel; of
     * [MapKind.COAT] (weight, roughness, 0), [MapKind.SHEEN] (red, green, blue) and [MapKind.ANISOTROPY] three: of
     * ln(larger alpha / smaller alpha) times the cosine and times the sine of twice the direction's angle, 0.
     */
    fun deviations(map: MapKind): FloatArray {
        val several = map == MapKind.ANISOTROPY || map == MapKind.COAT || map == MapKind.SHEEN
        val values = FloatArray(width * height * if (several) 3 else 1)
        return values.also { Native.mapsDeviations(this, handle.now, map.code, it) }
    }

    private fun direct(into: ByteBuffer): ByteBuffer {
        require(into.isDirect && !into.isReadOnly) { "into: a direct, writable buffer expected" }
        return into
    }

    /**
     * Writes normal.png, diffuse.png, specular.png, roughness.png (16 bits), maps.exr and
     * preview.png into a folder, which is made if missing.
     */
    fun export(folder: File) = Native.mapsExport(this, handle.now, Native.text(folder.path))

    /**
     * Exports the maps for other programs into a folder, all files or none. Formats: glb, usdz,
     * materialx, unreal, unity-hdrp, unity-urp, blender. [tile]: made seamless first; [metallic]:
     * base colour and metalness instead of a specular colour.
     */
    @JvmOverloads
    fun export(folder: File, formats: List<String>, tile: Boolean = false, metallic: Boolean = false) =
        Native.mapsExportFormats(
            this, handle.now, Native.text(folder.path), Native.text(formats.joinToString(",")), tile, metallic,
        )

    /** The maps as a binary glTF file, in memory. */
    fun glb(): ByteArray = file("glb", "material.glb")

    /** The maps as a USDZ file, in memory. */
    fun usdz(): ByteArray = file("usdz", "material.usdz")

    private fun file(format: String, name: String): ByteArray =
        Native.mapsFile(this, handle.now, Native.text(format), Native.text(name))

    /** Frees the maps; copies stay. */
    override fun close() = handle.close()

    companion object {
        /** Maps of values in memory, to be rendered, reduced or exported. */
        @JvmStatic
        fun of(values: MapValues): MaterialMaps = MaterialMaps(
            Native.mapsFromMemory(values.width, values.height, values.widthMm, values.heightMm, values.all()),
        )
    }
}
