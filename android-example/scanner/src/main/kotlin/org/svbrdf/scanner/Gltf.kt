package org.svbrdf.scanner

import java.io.ByteArrayOutputStream
import java.io.OutputStream
import java.nio.ByteBuffer
import java.nio.ByteOrder
import java.util.zip.CRC32
import java.util.zip.Deflater

/**
 * Maps as a binary glTF 2.0 file: a flat rectangle of the sample's size with the maps as its
 * material. F0 goes into `KHR_materials_specular`; `KHR_materials_ior` 0 makes it absolute.
 */
object Gltf {
    @JvmStatic
    fun write(maps: MaterialMaps, out: OutputStream) {
        val normals = png(maps.width, maps.height, maps.rgba8(MapKind.NORMAL))
        val diffuse = png(maps.width, maps.height, maps.rgba8(MapKind.DIFFUSE))
        val specular = png(maps.width, maps.height, maps.rgba8(MapKind.SPECULAR))
        val roughness = png(maps.width, maps.height, maps.rgba8(MapKind.ROUGHNESS))
        val (w, h) = listOf(maps.widthMm / 2000f, maps.heightMm / 2000f)
        val geometry = little(4 * 48 + 12)
        // Metres, in the plane of x and y, facing +z. Row 0 of the maps is at +y.
        for (x in listOf(-w, -w, w, w).zip(listOf(h, -h, -h, h))) {
            geometry.putFloat(x.first).putFloat(x.second).putFloat(0f)
        }
        repeat(4) { geometry.putFloat(0f).putFloat(0f).putFloat(1f) }
        repeat(4) { geometry.putFloat(1f).putFloat(0f).putFloat(0f).putFloat(1f) }
        for (t in listOf(0f, 0f, 0f, 1f, 1f, 1f, 1f, 0f)) {
            geometry.putFloat(t)
        }
        for (i in listOf(0, 1, 2, 0, 2, 3)) {
            geometry.putShort(i.toShort())
        }
        val parts = listOf(
            48, 48, 64, 32, 12, // positions, normals, tangents, texture coordinates, indices
            diffuse.size, normals.size, specular.size, roughness.size,
        )
        val data = ByteArrayOutputStream()
        data.write(geometry.array())
        val views = StringBuilder()
        var offset = 0
        for ((i, size) in parts.withIndex()) {
            if (i >= GEOMETRY_VIEWS) {
                pad(data, 0)
                offset = data.size()
                data.write(listOf(diffuse, normals, specular, roughness)[i - GEOMETRY_VIEWS])
            }
            views.append(if (i == 0) "" else ",")
            views.append("""{"buffer":0,"byteOffset":$offset,"byteLength":$size}""")
            offset += size
        }
        pad(data, 0)
        val json = ByteArrayOutputStream()
        json.write(json(views.toString(), data.size(), w, h).toByteArray())
        pad(json, ' '.code)
        val header = little(20)
        header.putInt(0x46546C67).putInt(2).putInt(28 + json.size() + data.size())
        header.putInt(json.size()).putInt(0x4E4F534A)
        out.write(header.array())
        json.writeTo(out)
        out.write(little(8).putInt(data.size()).putInt(0x004E4942).array())
        data.writeTo(out)
    }

    private const val GEOMETRY_VIEWS = 5

    /** Kotlin prints floats so that they are read back the same: least and greatest must be. */
    private fun json(views: String, bytes: Int, x: Float, y: Float): String =
        """{"asset":{"version":"2.0","generator":"svbrdf"},
"extensionsUsed":["KHR_materials_specular","KHR_materials_ior"],
"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"TANGENT":2,"TEXCOORD_0":3},
"indices":4,"material":0}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0},
"metallicRoughnessTexture":{"index":3},"metallicFactor":0},"normalTexture":{"index":1},
"extensions":{"KHR_materials_specular":{"specularColorTexture":{"index":2}},
"KHR_materials_ior":{"ior":0}}}],
"textures":[{"source":0,"sampler":0},{"source":1,"sampler":0},{"source":2,"sampler":0},
{"source":3,"sampler":0}],"samplers":[{"wrapS":33071,"wrapT":33071}],
"images":[{"bufferView":5,"mimeType":"image/png"},{"bufferView":6,"mimeType":"image/png"},
{"bufferView":7,"mimeType":"image/png"},{"bufferView":8,"mimeType":"image/png"}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3",
"min":[-$x,-$y,0],"max":[$x,$y,0]},
{"bufferView":1,"componentType":5126,"count":4,"type":"VEC3"},
{"bufferView":2,"componentType":5126,"count":4,"type":"VEC4"},
{"bufferView":3,"componentType":5126,"count":4,"type":"VEC2"},
{"bufferView":4,"componentType":5123,"count":6,"type":"SCALAR"}],
"bufferViews":[$views],"buffers":[{"byteLength":$bytes}]}"""

    private fun little(bytes: Int) = ByteBuffer.allocate(bytes).order(ByteOrder.LITTLE_ENDIAN)

    private fun pad(out: ByteArrayOutputStream, with: Int) {
        while (out.size() % 4 != 0) {
            out.write(with)
        }
    }

    /** An 8-bit RGB file of RGBA pixels. */
    private fun png(width: Int, height: Int, rgba: ByteBuffer): ByteArray {
        val rows = ByteArray(height * (1 + 3 * width))
        var to = 0
        for (y in 0 until height) {
            to += 1 // No filter.
            for (x in 0 until width) {
                for (c in 0..2) {
                    rows[to++] = rgba[4 * (y * width + x) + c]
                }
            }
        }
        val deflater = Deflater(6)
        deflater.setInput(rows)
        deflater.finish()
        val packed = ByteArrayOutputStream()
        val block = ByteArray(65536)
        while (!deflater.finished()) {
            packed.write(block, 0, deflater.deflate(block))
        }
        deflater.end()
        val out = ByteArrayOutputStream()
        out.write(byteArrayOf(0x89.toByte(), 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A))
        val header = ByteBuffer.allocate(13).putInt(width).putInt(height)
        chunk(out, "IHDR", header.put(byteArrayOf(8, 2, 0, 0, 0)).array())
        chunk(out, "IDAT", packed.toByteArray())
        chunk(out, "IEND", ByteArray(0))
        return out.toByteArray()
    }

    private fun chunk(out: ByteArrayOutputStream, name: String, data: ByteArray) {
        val crc = CRC32()
        crc.update(name.toByteArray())
        crc.update(data)
        out.write(ByteBuffer.allocate(4).putInt(data.size).array())
        out.write(name.toByteArray())
        out.write(data)
        out.write(ByteBuffer.allocate(4).putInt(crc.value.toInt()).array())
    }
}
