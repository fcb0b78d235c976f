package org.svbrdf.scanner

import java.io.File
import java.nio.ByteBuffer

/** A material of one kind everywhere. */
private fun material(side: Int, anisotropy: FloatArray?, coat: FloatArray?, sheen: FloatArray? = null): MapValues {
    fun everywhere(texel: FloatArray) = FloatArray(side * side * texel.size) { texel[it % texel.size] }
    return MapValues(
        side, side, 40f, 30f,
        normal = everywhere(floatArrayOf(0f, 0f, 1f)),
        diffuse = everywhere(floatArrayOf(0.2f, 0.3f, 0.4f)),
        specular = everywhere(floatArrayOf(0.8f, 0.7f, 0.6f)),
        roughness = everywhere(floatArrayOf(0.25f)),
        anisotropy = anisotropy?.let(::everywhere),
        coat = coat?.let(::everywhere),
        sheen = sheen?.let(::everywhere),
        sheenRoughness = sheen?.let { everywhere(floatArrayOf(0.6f)) },
    )
}

/** Lit from beside, so that no highlight is clipped. */
private fun picture(maps: MaterialMaps): ByteBuffer = ByteBuffer.allocateDirect(4 * maps.width * maps.height)
    .also { maps.render(Lighting(lightMm = floatArrayOf(150f, 0f, 300f)), it) }

/** Maps of values in memory, with and without anisotropy, a coat and sheen. */
fun optionalLobes() {
    val turned = floatArrayOf(0.6f, 0.8f, 0.5f)
    val lacquer = floatArrayOf(0.75f, 0.1f, 0f)
    MaterialMaps.of(material(8, null, null)).use { plain ->
        verify(plain.lobes.isEmpty() && plain.width == 8 && plain.heightMm == 30f) { "${plain.lobes}" }
        val none = throws<ScannerException>("coat") { plain.floats(MapKind.COAT) }
        verify(none.fault == Fault.NO_LOBE) { "${none.fault}" }
        throws<ScannerException>("anisotropy") { plain.rgba8(MapKind.ANISOTROPY) }
        verify(plain.floats(MapKind.ROUGHNESS)[9] == 0.25f) { "roughness" }
        MaterialMaps.of(material(8, turned, lacquer)).use { maps ->
            verify(maps.lobes == setOf(Lobe.ANISOTROPY, Lobe.COAT)) { "${maps.lobes}" }
            val found = maps.floats(MapKind.ANISOTROPY)
            for (i in 0 until 3 * 64) {
                verify(Math.abs(found[i] - turned[i % 3]) < 1e-4f) { "${found[i]} at $i" }
            }
            verify(Math.abs(maps.floats(MapKind.ROUGHNESS)[9] - 0.25f) < 1e-5f) { "the smaller alpha" }
            verify(maps.floats(MapKind.COAT)[3] == 0.75f) { "weight" }
            verify(maps.texels(MapKind.COAT, MapFormat.RGB8)[1] == 26.toByte()) { "roughness of the coat" }
            verify(picture(maps) != picture(plain)) { "lobes are rendered" }
            maps.reduced(1).use { verify(it.lobes == maps.lobes) { "${it.lobes}" } }
            maps.export(File(out, "lobes"))
            verify(maps.glb().size > 1000) { "glTF" }
        }
    }
    MaterialMaps.of(material(2, null, null, floatArrayOf(0.5f, 0.25f, 0f))).use { maps ->
        verify(maps.lobes == setOf(Lobe.SHEEN)) { "${maps.lobes}" }
        verify(maps.floats(MapKind.SHEEN)[4] == 0.25f) { "colour of the sheen" }
        verify(maps.floats(MapKind.SHEEN_ROUGHNESS)[3] == 0.6f) { "roughness of the sheen" }
        verify(maps.texels(MapKind.SHEEN, MapFormat.RGB8)[0] == 188.toByte()) { "sRGB" }
    }
    MaterialMaps.of(material(2, turned, null)).use { verify(it.lobes == setOf(Lobe.ANISOTROPY)) { "${it.lobes}" } }
    throws<IllegalArgumentException>("anisotropy") {
        MaterialMaps.of(material(2, floatArrayOf(1f, 0f, 2f), null))
    }
    throws<IllegalArgumentException>("texels") {
        MaterialMaps.of(MapValues(2, 2, 9f, 9f, FloatArray(12), FloatArray(12), FloatArray(12), FloatArray(3)))
    }
    throws<IllegalArgumentException>("width") {
        val none = FloatArray(0)
        MaterialMaps.of(MapValues(0, 2, 9f, 9f, none, none, none, none))
    }
}
