// The binding on the desktop JVM: the same classes and native code that run on a phone.
// java -Xcheck:jni org.svbrdf.scanner.ScannerTestKt PHOTOS HEADER OUT

package org.svbrdf.scanner

import java.io.File
import java.io.IOException
import java.lang.ref.WeakReference
import java.nio.ByteBuffer
import java.nio.ByteOrder
import java.util.concurrent.ConcurrentLinkedQueue
import java.util.concurrent.CountDownLatch
import java.util.concurrent.TimeUnit
import java.util.concurrent.atomic.AtomicInteger
import java.util.concurrent.atomic.AtomicReference
import javax.imageio.ImageIO
import kotlin.concurrent.thread
import kotlinx.coroutines.flow.first
import kotlinx.coroutines.runBlocking

lateinit var capture: File
lateinit var header: File
lateinit var out: File

fun verify(condition: Boolean, what: () -> String) {
    if (!condition) {
        throw AssertionError(what())
    }
}

inline fun <reified T : Throwable> throws(text: String, body: () -> Unit): T {
    try {
        body()
    } catch (thrown: Throwable) {
        verify(thrown is T) { "${T::class.java} expected, $thrown came" }
        verify(thrown.message.orEmpty().contains(text)) { "'$text' is not in: ${thrown.message}" }
        return thrown as T
    }
    throw AssertionError("${T::class.java} expected, nothing came")
}

/** A photo of the capture, as a PPM file: the JDK's decoder of JPEG trips -Xcheck:jni itself. */
fun photo(index: Int, direct: Boolean = true): Photo {
    val file = File(capture, "%02d.ppm".format(index)).readBytes()
    val start = "P6 2016 1512 255\n"
    verify(String(file, 0, start.length, Charsets.US_ASCII) == start) { "not the photo expected" }
    val bytes = file.size - start.length
    val pixels = if (direct) ByteBuffer.allocateDirect(bytes) else ByteBuffer.allocate(bytes)
    pixels.put(file, start.length, bytes)
    pixels.rewind()
    return Photo.packed(PixelFormat.RGB8, pixels, 2016, 1512)
}

val board = Board(19, 14, 10.0, 3, 2, 16, 12)
val camera = Camera(
    2016, 1512, 1493.9383274679394, 1492.8832900664995, 1014.8386867404545, 755.2944690154574,
    0.0421587926023828, -0.042918096580716374,
)
val options = ScanOptions(
    88f, 88f, board, camera, listOf(4.9223925516757925, 7.8090039183605695, 0.0), threads = 2,
)

/** Small, without a board. */
val small = ScanOptions(threads = 1, refine = false, rectified = RectifiedLight())
fun gray(size: Int = 64): Photo {
    val pixels = ByteBuffer.allocateDirect(3 * size * size)
    while (pixels.hasRemaining()) {
        pixels.put(110)
    }
    pixels.rewind()
    return Photo.packed(PixelFormat.RGB8, pixels, size, size)
}
val above = floatArrayOf(0f, 10f, 150f)

fun captureToMaps() {
    val progressed = AtomicInteger()
    val mapped = AtomicInteger()
    val lines = ConcurrentLinkedQueue<String>()
    val threads = ConcurrentLinkedQueue<Thread>()
    val listener = object : MaterialScanner.Listener {
        override fun onProgress(scanner: MaterialScanner, progress: Progress) {
            threads.add(Thread.currentThread())
            verify(progress.fraction in 0f..1f && progress == progress.copy()) { "$progress" }
            verify(scanner.progress.photos >= progress.photos) { "$progress" }
            progressed.incrementAndGet()
        }

        override fun onMaps(scanner: MaterialScanner) {
            scanner.snapshot()!!.use { verify(it.width == 256) { "${it.width}" } }
            mapped.incrementAndGet()
        }

        override fun onLog(level: LogLevel, line: String) {
            lines.add("$level $line")
        }
    }
    MaterialScanner(options, listener).use { scanner ->
        verify(scanner.snapshot() == null) { "maps before the first photo" }
        verify(scanner.snapshotConfidence() == null) { "confidence before the first photo" }
        throws<IllegalStateException>("no photo") { scanner.export(out) }
        verify(scanner.nextView == null && scanner.camera!!.camera == camera) { "before photos" }
        for (i in 0..1) {
            val info = PhotoInfo(1f, Flash.TORCH, 1000L + i)
            val probe = scanner.probe(photo(i), info)
            verify(probe.acceptable && probe.advice.isEmpty() && probe.hints.isEmpty()) { probe.advice }
            verify(probe.corners.size > 60 && probe.corners.all { it[0] in 0f..2016f }) { "corners" }
            verify(probe.timestampNs == 1000L + i && probe.whiteLevel!! > 0.05f) { "light" }
            verify((probe.view!!.offNextDeg == null) == (i == 0)) { "next" }
            verify(probe.view.samplePx.size == 4 && probe.view.sampleSeen == 1f) { "sample" }
            val pushed = scanner.push(photo(i, direct = i == 0), info)
            verify(pushed is Pushed.Accepted && pushed.index == i) { "$pushed" }
            verify(pushed.timestampNs == 1000L + i) { "$pushed" }
            verify((pushed as Pushed.Accepted).reprojectionRmsPx < 0.5) { "$pushed" }
            verify(pushed.hints.isEmpty() && pushed.advice.isEmpty()) { "$pushed" }
            // The sample's centre is where the pose says, and all corners are in the picture.
            val pose = pushed.pose!!
            verify(pose.angle < 1.0 && pose.cameraMm[2] > 50.0) { "${pose.angle}" }
            for ((x, y) in listOf(0.0 to 0.0, 44.0 to 44.0, -44.0 to 44.0, 44.0 to -44.0)) {
                val (u, v) = pose.project(camera, x, y)!!
                verify(u in 0.0..2015.0 && v in 0.0..1511.0) { "$u $v" }
            }
        }
        val next = scanner.nextView!!
        verify(next.tiltDeg in 0f..60f && next.azimuthDeg in 0f..360f) { "$next" }
        val up = Math.cos(Math.toRadians(next.tiltDeg.toDouble()))
        verify(Math.abs(next.direction[2] - up) < 1e-5) { "$next" }
        verify(scanner.camera!!.sigma == null) { "a given camera" }
        verify(scanner.paper!!.aspect == 1.0 && scanner.paper!!.elevationMm == 0.0) { "flat" }
        verify(scanner.pose(1).translationMm[2] > 50.0) { "pose" }
        throws<IllegalArgumentException>("index") { scanner.pose(2) }
        // All of its light was there without the flash: no board is left.
        val dark = scanner.push(photo(0), PhotoInfo(ambient = photo(0))) as Pushed.Rejected
        verify(dark.reason == Rejection.BOARD_NOT_FOUND && dark.measured == 0f) { "$dark" }
        verify(dark.blurDirectionDeg == null && dark.limit == 0f) { "$dark" }
        throws<IllegalArgumentException>("ambient") {
            scanner.push(photo(0), PhotoInfo(ambient = gray()))
        }
        // Flat gray: no board; the scanner goes on.
        val pixels = ByteBuffer.allocateDirect(3 * 2016 * 1512)
        while (pixels.hasRemaining()) {
            pixels.put(128.toByte())
        }
        pixels.rewind()
        val blank = Photo.packed(PixelFormat.RGB8, pixels, 2016, 1512)
        val refused = scanner.push(blank) as Pushed.Rejected
        verify(refused.reason == Rejection.BOARD_NOT_FOUND) { "$refused" }
        verify(refused.advice.contains("checkerboard")) { refused.advice }
        val wrong = scanner.push(gray()) as Pushed.Rejected
        verify(wrong.reason == Rejection.WRONG_SIZE && wrong.advice.contains("2016x1512")) { "$wrong" }
        verify(scanner.await()) { "no end without a limit" }
        val progress = scanner.progress
        verify(progress.settled && progress.photos == 2 && progress.state == ScanState.READY) {
            "$progress"
        }
        verify(Math.abs(scanner.light.flashOffsetMm[0] - 4.92) < 0.5) { "light" }
        scanner.snapshotConfidence()!!.use { maps ->
            val rough = maps.deviations(MapKind.ROUGHNESS)
            val mean = Math.sqrt(rough.sumOf { it.toDouble() * it } / rough.size)
            verify(Math.abs(mean - maps.confidence.roughness) < 1e-4) { "$mean ${maps.confidence}" }
            verify(maps.confidence.normal > 0f && maps.confidence.diffuse > 0f) { "confidence" }
        }
        scanner.snapshot()!!.use { maps ->
            throws<IllegalArgumentException>("confidence") { maps.confidence }
            verify(maps.widthMm == 88f && maps.heightMm == 88f && maps.height == 256) { "size" }
            val normal = maps.floats(MapKind.NORMAL)
            verify(normal.remaining() == 3 * 256 * 256) { "${normal.remaining()}" }
            val length = (0..2).sumOf { normal[it].toDouble() * normal[it] }
            verify(Math.abs(length - 1) < 1e-5) { "$length" }
            verify(maps.floats(MapKind.ROUGHNESS).remaining() == 256 * 256) { "roughness" }
            val packed = maps.rgba8(MapKind.ROUGHNESS)
            verify(packed[0] == 255.toByte() && packed[3] == 255.toByte()) { "occlusion, alpha" }
            maps.export(out)
            File(out, "material.glb").writeBytes(maps.glb())
            verify(maps.usdz().size > 1000) { "USDZ" }
            maps.export(File(out, "export"), listOf("glb", "unreal"), tile = true)
            verify(File(out, "export/unreal/orm.png").isFile) { "Unreal" }
            throws<IllegalArgumentException>("obj") { maps.export(out, listOf("obj")) }
            val relight = Relight(maps)
            val argb = IntArray(256 * 256)
            relight.render(floatArrayOf(0f, 0f, 250f), floatArrayOf(60f, 40f, 200f), argb, 0.8f)
            val raw = ByteBuffer.allocate(4 * argb.size).order(ByteOrder.LITTLE_ENDIAN)
            raw.asIntBuffer().put(argb)
            File(out, "relit.argb").writeBytes(raw.array())
            Relight(maps, 4).render(above, above, IntArray(64 * 64))
        }
        scanner.pause()
        scanner.resume()
        scanner.cancel()
        val ended = throws<ScannerException>("") { scanner.push(photo(2)) }
        verify(ended.fault == Fault.CANCELLED) { "${ended.fault}" }
        verify(scanner.progress.state == ScanState.CANCELLED) { "${scanner.progress}" }
        verify(scanner.snapshot() != null) { "maps stay" }
    }
    verify(progressed.get() > 0 && mapped.get() > 0) { "$progressed $mapped callbacks" }
    verify(threads.toSet().size == 1 && threads.all { it.isDaemon }) { "${threads.toSet()}" }
    verify(lines.any { it.startsWith("WARNING") }) { "$lines" }
    for (file in listOf("normal", "diffuse", "specular", "roughness", "preview")) {
        verify(ImageIO.read(File(out, "$file.png")) != null) { file }
    }
}

/** Photos that are looked at, pushed and taken back. */
fun lookedAt() {
    MaterialScanner(options).use { scanner ->
        scanner.pause()
        for (i in 0..1) {
            verify(scanner.push(photo(i)) is Pushed.Accepted) { "$i" }
        }
        val again = scanner.probe(photo(0), PhotoInfo(flash = Flash.OFF))
        verify(again.hints == setOf(Hint.NOTHING_NEW) && again.sameViewAs == 0) { again.advice }
        verify(again.whiteLevel == null && again.view!!.offNextDeg!! > 1f) { "without flash" }
        val nothing = scanner.probe(gray())
        verify(nothing.reason == Rejection.BOARD_NOT_FOUND && nothing.view == null) { nothing.advice }
        verify(nothing.corners.isEmpty() && nothing.blurPx == null) { "nothing found" }
        verify(scanner.push(photo(0)) is Pushed.Accepted && scanner.progress.photos == 3) { "push" }
        throws<IllegalArgumentException>("index") { scanner.remove(3) }
        throws<IllegalArgumentException>("index") { scanner.remove(-1) }
        scanner.remove(2)
        verify(scanner.progress.photos == 2) { "${scanner.progress}" }
        val fit = scanner.photoFit(1)
        verify(fit.weight > 0.3f && fit.residual > 0f && !fit.outlier) { "$fit" }
        throws<IllegalArgumentException>("index") { scanner.photoFit(2) }
    }
}

/** What is told about photos that are accepted. */
fun hints() {
    MaterialScanner(options).use { scanner ->
        scanner.pause()
        scanner.push(photo(0))
        val again = scanner.push(photo(0)) as Pushed.Accepted
        verify(again.hints == setOf(Hint.NOTHING_NEW) && again.sameViewAs == 0) { "$again" }
        verify(again.advice.startsWith("photo 1 has") && again.overWhite == null) { "$again" }
    }
    // No camera given; encoded values said to be linear.
    MaterialScanner(options.copy(camera = null)).use { scanner ->
        scanner.pause()
        verify(scanner.camera == null) { "no photo has told" }
        val encoded = photo(0)
        val linear = Photo(PixelFormat.RGB8, 2016, 1512, encoded.planes, Transfer.LINEAR)
        val odd = scanner.push(linear, PhotoInfo(focal35mm = 26.6f)) as Pushed.Accepted
        verify(odd.hints == setOf(Hint.NOT_LINEAR) && odd.overWhite!! > 0.2f) { "$odd" }
        val found = scanner.camera!!
        verify(Math.abs(found.camera.fx / camera.fx - 1) < 0.1) { "${found.camera}" }
        val sigma = found.sigma!!
        verify(sigma[0] > 0.0) { "${sigma[0]}" }
        throws<IllegalArgumentException>("focal") {
            scanner.push(linear, PhotoInfo(focal35mm = Float.NaN))
        }
    }
}

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
        scanner.pushRectified(photo, above, above, info)
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
        scanner.pushRectified(gray(), floatArrayOf(0f, 0f), above)
    }
    throws<IllegalArgumentException>("") {
        scanner.pushRectified(gray(), floatArrayOf(0f, Float.NaN, 1f), above)
    }
    throws<IllegalArgumentException>("") { scanner.push(gray()) }
    verify(scanner.snapshot() == null && scanner.progress.photos == 0) { "something was lost" }
    // Position and limit count; a heap buffer works as well.
    val padded = ByteBuffer.allocate(7 + 3 * 64 * 64 + 5)
    padded.position(7)
    padded.limit(7 + 3 * 64 * 64)
    verify(push(rgb(64, 64, padded)) is Pushed.Rejected || scanner.progress.photos == 1) { "heap" }
    verify(padded.position() == 7) { "position moved" }
    verify(push(gray()) is Pushed.Accepted) { "still works" }
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
    throws<IllegalStateException>("closed") { scanner.push(gray()) }
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
            val pushed = scanner.pushRectified(photo, above, above)
            verify(pushed is Pushed.Accepted && pushed.pose == null) { "$pushed" }
            verify(scanner.nextView == null && scanner.camera == null) { "photos from the top" }
        }
    }
}

fun models() {
    val folder = File(header.parentFile.parentFile, "models")
    val bytes = listOf("decoder.bin", "encoder.onnx", "photo.onnx", "completion.onnx")
        .map { File(folder, it).readBytes() }
    for (models in listOf(
        ScannerModels.fromFolder(folder), ScannerModels.fromBytes(bytes[0], bytes[1], bytes[2], bytes[3]),
    )) {
        MaterialScanner(small.copy(models = models)).use { scanner ->
            models.close()
            verify(scanner.pushRectified(gray(), above, above) is Pushed.Accepted) { "own models" }
        }
        throws<IllegalStateException>("closed") { MaterialScanner(small.copy(models = models)) }
    }
}

fun savedAndRestored() {
    val file = File(out, "\uD83D\uDE00.scan")
    val before = MaterialScanner(small).use { scanner ->
        scanner.setBudget(Budget(seconds = 30f, maxSteps = 3, stopWhenInvisible = true))
        throws<IllegalArgumentException>("") { scanner.setBudget(Budget(seconds = Float.NaN)) }
        scanner.pushRectified(gray(), above, above)
        scanner.await()
        throws<IOException>("") { scanner.save(File("/proc/no/such")) }
        scanner.save(file)
        scanner.snapshot()!!.use { it.floats(MapKind.DIFFUSE) }
    }
    val called = CountDownLatch(2)
    val listener = object : MaterialScanner.Listener {
        override fun onMaps(scanner: MaterialScanner) {
            // Usable even when it comes at once.
            scanner.snapshot()!!.close()
            called.countDown()
        }
    }
    MaterialScanner.restore(file, listener).use { scanner ->
        verify(scanner.progress.photos == 1) { "${scanner.progress}" }
        val after = scanner.snapshot()!!.use { it.floats(MapKind.DIFFUSE) }
        verify(before == after) { "other maps" }
        verify(scanner.pushRectified(gray(), above, above) is Pushed.Accepted) { "goes on" }
        scanner.await()
        verify(scanner.progress.photos == 2) { "${scanner.progress}" }
        called.await(5, TimeUnit.SECONDS)
        verify(called.count < 2) { "no maps told" }
    }
    throws<IOException>("") { MaterialScanner.restore(File(out, "missing")) }
    file.writeBytes(file.readBytes().copyOf(1000))
    val damaged = throws<ScannerException>("") { MaterialScanner.restore(file) }
    verify(damaged.fault == Fault.BAD_STATE) { "${damaged.fault}" }
    val limited = small.copy(memoryLimitBytes = 1)
    val large = throws<ScannerException>("") {
        MaterialScanner(limited).use { it.pushRectified(gray(), above, above) }
    }
    verify(large.fault == Fault.MEMORY_LIMIT) { "${large.fault}" }
}

fun callbacksThatMisbehave() {
    // Exceptions go to the thread's handler; closing inside a callback is fine.
    val uncaught = ConcurrentLinkedQueue<Throwable>()
    val before = Thread.getDefaultUncaughtExceptionHandler()
    Thread.setDefaultUncaughtExceptionHandler { _, thrown -> uncaught.add(thrown) }
    val closed = CountDownLatch(1)
    val late = AtomicInteger()
    val listener = object : MaterialScanner.Listener {
        override fun onMaps(scanner: MaterialScanner) {
            throw IllegalStateException("mine")
        }

        override fun onProgress(scanner: MaterialScanner, progress: Progress) {
            if (closed.count == 0L) {
                late.incrementAndGet()
            }
            scanner.close()
            closed.countDown()
        }
    }
    val scanner = MaterialScanner(small, listener)
    // The callbacks may close it before the call has returned.
    val pushed = runCatching { scanner.pushRectified(gray(), above, above) }
    verify(pushed.getOrNull() is Pushed.Accepted) { "$pushed" }
    verify(closed.await(60, TimeUnit.SECONDS)) { "no callback" }
    Thread.sleep(50)
    Thread.setDefaultUncaughtExceptionHandler(before)
    verify(uncaught.any() && uncaught.all { it.message == "mine" }) { "$uncaught" }
    verify(late.get() == 0) { "$late" }
    uncaught.clear()
    throws<IllegalStateException>("closed") { scanner.progress }
    // Closed by others while a callback runs: what fails there then is nobody's fault.
    val inside = CountDownLatch(1)
    val slow = object : MaterialScanner.Listener {
        override fun onMaps(scanner: MaterialScanner) {
            inside.countDown()
            while (true) {
                scanner.snapshot()?.close()
            }
        }
    }
    Thread.setDefaultUncaughtExceptionHandler { _, thrown -> uncaught.add(thrown) }
    MaterialScanner(small, slow).use { other ->
        other.pushRectified(gray(), above, above)
        verify(inside.await(60, TimeUnit.SECONDS)) { "no callback" }
    }
    Thread.setDefaultUncaughtExceptionHandler(before)
    verify(uncaught.isEmpty()) { "closing was told as a fault: $uncaught" }
}

fun closingWhileOthersCall() {
    repeat(10) {
        val scanner = MaterialScanner(small, ScannerFlows())
        val surprise = AtomicReference<Throwable>()
        val workers = List(4) { worker ->
            thread {
                try {
                    while (true) {
                        when (worker) {
                            0 -> scanner.pushRectified(gray(), above, above)
                            1 -> scanner.snapshot()?.use { it.rgba8(MapKind.NORMAL) }
                            2 -> scanner.await(1)
                            else -> scanner.progress
                        }
                    }
                } catch (expected: IllegalStateException) {
                    // Closed.
                } catch (thrown: Throwable) {
                    if ((thrown as? ScannerException)?.fault != Fault.CANCELLED) {
                        surprise.set(thrown)
                    }
                }
            }
        }
        Thread.sleep(30)
        scanner.close()
        workers.forEach { it.join() }
        surprise.get()?.let { throw it }
    }
}

fun flows(): Unit = runBlocking {
    val flows = ScannerFlows()
    MaterialScanner(small, flows).use { scanner ->
        // For boards; this scanner takes photos from the top.
        val refused = runCatching { scanner.pushSuspending(gray()) }
        verify(refused.exceptionOrNull() is IllegalArgumentException) { "$refused" }
        verify(scanner.pushRectified(gray(), above, above) is Pushed.Accepted) { "pushed" }
        flows.maps.first().use { verify(it.width == 256) { "${it.width}" } }
        flows.progress.first { it != null && it.settled }
    }
}

fun forgotten() {
    // Scanners and maps that nobody closed are freed after their owners.
    val weak = List(5) {
        val scanner = MaterialScanner(small, ScannerFlows())
        scanner.pushRectified(gray(), above, above)
        scanner.snapshot()
        WeakReference(scanner)
    }
    val deadline = System.nanoTime() + 30_000_000_000
    while (Handle.open > 0 && System.nanoTime() < deadline) {
        System.gc()
        Thread.sleep(20)
    }
    verify(weak.all { it.get() == null } && Handle.open == 0) { "${Handle.open} handles left" }
}

fun residentKiB(): Long =
    File("/proc/self/status").readLines().first { it.startsWith("VmRSS") }
        .filter { it.isDigit() }.toLong()

fun twoHundredSessions() {
    val listener = object : MaterialScanner.Listener {}
    // Every fifth takes a photo in, which is what costs time; none waits for a fit.
    fun sessions(count: Int) = repeat(count) { index ->
        MaterialScanner(small, listener).use { scanner ->
            if (index % 5 == 0) {
                scanner.pause()
                scanner.pushRectified(gray(), above, above)
                scanner.snapshot()!!.use { it.rgba8(MapKind.DIFFUSE) }
            }
        }
    }
    // Networks are parsed once while a session lives.
    MaterialScanner(small).use {
        sessions(40)
        // One leaked set of maps has 2 MiB, a leaked session more: 40 of them have twice the limit.
        // The Java heap and the allocator's arenas grow as well, but not again and again.
        val leaks = (1..3).all {
            System.gc()
            val before = residentKiB()
            sessions(200)
            System.gc()
            val growth = residentKiB() - before
            println("200 sessions: $growth KiB more, of ${residentKiB()}")
            growth >= 40 * 1024
        }
        verify(!leaks) { "memory grows with every session" }
    }
    verify(Handle.open == 0 && Native.registered == 0) { "${Handle.open} ${Native.registered}" }
}

fun codesOfTheHeader() {
    val defines = Regex("#define SVBRDF_(\\w+) (-?\\d+)").findAll(header.readText())
        .associate { it.groupValues[1] to it.groupValues[2].toLong() }
    val codes = listOf<Pair<String, Map<String, Number>>>(
        "FEATURE_" to Feature.entries.associate { it.name to it.code },
        "PIXEL_" to PixelFormat.entries.associate { it.name to it.code },
        "TRANSFER_" to Transfer.entries.associate { it.name to it.code },
        "YUV_" to YuvMatrix.entries.associate { it.name to it.code },
        "BAYER_" to BayerPattern.entries.associate { it.name to it.code },
        "MAP_" to MapKind.entries.associate { it.name to it.code },
        "METHOD_" to Method.entries.associate { it.name to it.code },
        "FALLOFF_" to Falloff.entries.associate { it.name to it.code },
        "FLASH_" to Flash.entries.associate { it.name to it.code },
        "LOG_" to LogLevel.entries.associate { it.name to it.code },
        "STATE_" to ScanState.entries.associate { it.name to it.code },
        "REJECTION_" to Rejection.entries.associate { it.name to it.code } + ("NONE" to 0),
        "PHASE_" to Phase.entries.associate { it.name to it.code },
        "HINT_" to Hint.entries.associate { it.name to it.code },
        "" to Fault.entries.associate { it.name to it.code } +
            mapOf(
                "INVALID_ARGUMENT" to Native.INVALID_ARGUMENT, "IO" to Native.IO,
                "INVALID_HANDLE" to Native.INVALID_HANDLE,
            ),
    )
    for ((prefix, values) in codes) {
        for ((name, code) in values) {
            val define = defines[prefix + name]
            verify(define == code.toLong()) { "$prefix$name: $code, in the header $define" }
        }
        // Newer libraries may add some: said, not refused.
        val known = values.keys.map { prefix + it }
        val others = defines.keys.filter { prefix != "" && it.startsWith(prefix) } - known
        others.filter { !it.startsWith("MAP_FORMAT") }.forEach { println("not bound: SVBRDF_$it") }
    }
}

fun main(arguments: Array<String>) {
    capture = File(arguments[0])
    header = File(arguments[1])
    out = File(arguments[2]).apply { mkdirs() }
    println("svbrdf ${MaterialScanner.version}, ${Feature.values().filter { MaterialScanner.has(it) }}")
    val tests = listOf<Pair<String, () -> Unit>>(
        "codes of the header" to ::codesOfTheHeader,
        "capture to maps" to ::captureToMaps,
        "looked at" to ::lookedAt,
        "hints" to ::hints,
        "bad input" to ::badInput,
        "layouts" to ::layouts,
        "models" to ::models,
        "saved and restored" to ::savedAndRestored,
        "callbacks that misbehave" to ::callbacksThatMisbehave,
        "closing while others call" to ::closingWhileOthersCall,
        "flows" to ::flows,
        "forgotten" to ::forgotten,
        "two hundred sessions" to ::twoHundredSessions,
    )
    for ((name, test) in tests) {
        val start = System.nanoTime()
        test()
        println("done: $name (%.1f s)".format((System.nanoTime() - start) / 1e9))
    }
}
