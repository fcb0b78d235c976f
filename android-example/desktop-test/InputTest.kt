// Inputs of a scanner: every kind of bad input, and pictures in memory of every kind.

package org.svbrdf.scanner

import java.io.File
import java.io.IOException
import java.nio.ByteBuffer
import java.nio.ByteOrder

fun badInput() {
    throws<IllegalArgumentException>("resolution") { MaterialScanner(options.copy(resolution = 300)) }
    throws<IllegalArgumentException>("threads") { MaterialScanner(options.copy(threads = -1)) }
    throws<IllegalArgumentException>("sample") { MaterialScanner(options.copy(widthMm = Float.NaN)) }
    throws<IllegalArgumentException>("three numbers") {
        MaterialScanner(options.copy(flashOffsetMm = listOf(1.0)))
    }
    throws<IllegalArgumentException>("") { MaterialScanner(options.copy(board = board.copy(rows = -3))) }
    throws<IllegalArgumentException>("") {
        MaterialScanner(options.copy(board = board.copy(dictionary = "Ärger\u0000\uD83D\uDE00")))
    }
    throws<IllegalArgumentException>("") {
        MaterialScanner(options.copy(board = board.copy(dictionary = "\uD83D\uDE00", markerMm = 5.0)))
    }
    throws<IllegalArgumentException>("") { MaterialScanner(options.copy(camera = Camera(0, -1, 1.0, 1.0))) }
    throws<IOException>("") { ScannerModels.fromFolder(File("/no/such/\uD83D\uDE00")) }
    val one = ByteArray(1)
    val damaged = throws<ScannerException>("") { ScannerModels.fromBytes(one, one, one, one) }
    verify(damaged.fault == Fault.BAD_MODEL) { "${damaged.fault}" }

    val scanner = MaterialScanner(small)
    val full = ByteBuffer.allocateDirect(3 * 64 * 64)
    fun rgb(width: Int, height: Int, buffer: ByteBuffer, stride: Int = 3 * 64, rotation: Int = 0) =
        Photo(
            PixelFormat.RGB8, width, height, listOf(Plane(buffer, stride)), rotation = rotation,
        )
    fun push(photo: Photo, info: PhotoInfo = PhotoInfo()) =
        scanner.addRectifiedPhoto(photo, above, above, info)
    throws<IllegalArgumentException>("") { push(rgb(64, 65, full)) }
    throws<IllegalArgumentException>("") { push(rgb(0, 64, full)) }
    throws<IllegalArgumentException>("") { push(rgb(-1, 64, full)) }
    throws<IllegalArgumentException>("") { push(rgb(Int.MAX_VALUE, Int.MAX_VALUE, full)) }
    throws<IllegalArgumentException>("negative") { push(rgb(64, 64, full, -1)) }
    throws<IllegalArgumentException>("") { push(rgb(64, 64, full, 64)) }
    throws<IllegalArgumentException>("rotation") { push(rgb(64, 64, full, rotation = 45)) }
    throws<IllegalArgumentException>("") { push(rgb(64, 64, ByteBuffer.allocateDirect(0))) }
    throws<IllegalArgumentException>("") { push(gray(), PhotoInfo(exposure = Float.NaN)) }
    throws<IllegalArgumentException>("planes") {
        push(Photo(PixelFormat.YUV420, 64, 64, emptyList()))
    }
    throws<IllegalArgumentException>("planes[1]") {
        push(Photo(PixelFormat.YUV420, 64, 64, listOf(Plane(full, 64))))
    }
    throws<IllegalArgumentException>("bayer") {
        push(Photo(PixelFormat.BAYER16, 64, 64, listOf(Plane(full, 128))))
    }
    throws<IllegalArgumentException>("four numbers") {
        val bayer = Bayer(BayerPattern.RGGB, floatArrayOf(1f), 1023f)
        push(Photo(PixelFormat.BAYER16, 64, 64, listOf(Plane(full, 128)), bayer = bayer))
    }
    throws<IllegalArgumentException>("") {
        scanner.addRectifiedPhoto(gray(), floatArrayOf(0f, 0f), above)
    }
    throws<IllegalArgumentException>("") {
        scanner.addRectifiedPhoto(gray(), floatArrayOf(0f, Float.NaN, 1f), above)
    }
    throws<IllegalArgumentException>("") { scanner.addPhoto(gray()) }
    verify(scanner.snapshot() == null && scanner.progress.photos == 0) { "something was lost" }
    // Position and limit count; a heap buffer works as well.
    val padded = ByteBuffer.allocate(7 + 3 * 64 * 64 + 5)
    padded.position(7)
    padded.limit(7 + 3 * 64 * 64)
    verify(push(rgb(64, 64, padded)) is Outcome.Rejected || scanner.progress.photos == 1) { "heap" }
    verify(padded.position() == 7) { "position moved" }
    verify(push(gray()) is Outcome.Accepted) { "still works" }
    val maps = scanner.snapshot()!!
    throws<IllegalArgumentException>("direct") { maps.rgba8(MapKind.NORMAL, ByteBuffer.allocate(9)) }
    throws<IllegalArgumentException>("") { maps.rgba8(MapKind.NORMAL, ByteBuffer.allocateDirect(9)) }
    throws<IllegalArgumentException>("") { maps.rgba8(MapKind.NORMAL, maps.rgba8(MapKind.NORMAL).asReadOnlyBuffer()) }
    throws<IOException>("") { maps.export(File("/proc/no/such")) }
    val unicode = File(out, "Ä\uD83D\uDE00")
    maps.export(unicode)
    verify(File(unicode, "normal.png").isFile) { "Unicode in paths" }
    throws<IllegalArgumentException>("") { maps.export(File(out, "a\u0000b")) }
    maps.close()
    maps.close()
    throws<IllegalStateException>("closed") { maps.floats(MapKind.NORMAL) }
    scanner.close()
    scanner.close()
    throws<IllegalStateException>("closed") { scanner.addPhoto(gray()) }
    throws<IllegalStateException>("closed") { scanner.progress }
    throws<IllegalStateException>("closed") { scanner.await() }
    throws<IllegalStateException>("closed") { scanner.pause() }
}

fun layouts() {
    // Chroma interleaved as Android's cameras give it (NV21), and raw values.
    val size = 128
    val luma = ByteBuffer.allocateDirect(size * size)
    val chroma = ByteBuffer.allocateDirect(size * size / 2)
    for (i in 0 until size * size) luma.put(i, 110)
    for (i in 0 until size * size / 2) chroma.put(i, 128.toByte())
    val v = chroma.duplicate()
    val u = chroma.duplicate().apply { position(1) }
    val yuv = Photo(
        PixelFormat.YUV420, size, size, listOf(Plane(luma, size), Plane(u, size, 2), Plane(v, size, 2)),
        Transfer.LINEAR, rotation = 90,
    )
    val raw = ByteBuffer.allocateDirect(2 * size * size).order(ByteOrder.nativeOrder())
    for (i in 0 until size * size) raw.putShort(2 * i, 500)
    val bayer = Bayer(BayerPattern.BGGR, FloatArray(4) { 64f }, 1023f, floatArrayOf(1.5f, 1f, 2f))
    val sensor = Photo(PixelFormat.BAYER16, size, size, listOf(Plane(raw, 2 * size)), bayer = bayer)
    for (photo in listOf(yuv, sensor)) {
        MaterialScanner(small).use { scanner ->
            val outcome = scanner.addRectifiedPhoto(photo, above, above)
            verify(outcome is Outcome.Accepted && outcome.pose == null) { "$outcome" }
            verify(scanner.nextView == null && scanner.camera == null) { "photos from the top" }
        }
    }
}

/** Blue first, 10 bits, other curves and primaries: the same gray. */
fun formatsOfVideo() {
    val size = 128
    fun buffer(bytes: Int) = ByteBuffer.allocateDirect(bytes).order(ByteOrder.nativeOrder())
    val bgra = buffer(4 * size * size)
    for (i in 0 until bgra.capacity()) bgra.put(i, 110)
    val luma = buffer(2 * size * size)
    for (i in 0 until size * size) luma.putShort(2 * i, (440 shl 6).toShort())
    val chroma = buffer(size * size)
    for (i in 0 until size * size / 2) chroma.putShort(2 * i, (512 shl 6).toShort())
    val cr = chroma.duplicate().apply { position(2) }
    val p010 = listOf(Plane(luma, 2 * size), Plane(chroma, 2 * size, 4), Plane(cr, 2 * size, 4))
    val diffuse = listOf(
        Photo(
            PixelFormat.BGRA8, size, size, listOf(Plane(bgra, 4 * size)),
            primaries = Primaries.DISPLAY_P3,
        ),
        Photo(
            PixelFormat.P010, size, size, p010, Transfer.HLG, yuvMatrix = YuvMatrix.BT2020_FULL,
            primaries = Primaries.REC2020,
        ),
        Photo(
            PixelFormat.P010, size, size, p010, Transfer.PQ, yuvMatrix = YuvMatrix.BT2020_LIMITED,
            primaries = Primaries.REC2020,
        ),
    ).map { photo ->
        MaterialScanner(small).use { scanner ->
            scanner.pause()
            val outcome = scanner.addRectifiedPhoto(photo, above, above)
            verify(outcome is Outcome.Accepted) { "$outcome" }
            scanner.snapshot()!!.use { maps ->
                val found = maps.floats(MapKind.DIFFUSE)
                // No primaries make a gray anything but gray.
                verify(Math.abs(found[0] - found[1]) < 0.05f) { "${found[0]} ${found[1]}" }
                found[1]
            }
        }
    }
    // 43 % of the signal are 0.157 linear of sRGB, and less of HLG.
    verify(diffuse[1] < diffuse[0]) { "$diffuse" }
}
