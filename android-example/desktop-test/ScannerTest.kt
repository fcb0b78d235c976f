// The binding on the desktop JVM: the same classes and native code that run on a phone.
// java -Xcheck:jni org.svbrdf.scanner.ScannerTestKt PHOTOS HEADER OUT

package org.svbrdf.scanner

import java.io.File
import java.io.IOException
import java.nio.ByteBuffer
import java.nio.ByteOrder
import java.util.concurrent.ConcurrentLinkedQueue
import java.util.concurrent.CountDownLatch
import java.util.concurrent.TimeUnit
import java.util.concurrent.atomic.AtomicInteger
import javax.imageio.ImageIO

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
        verify(scanner.snapshotWithUncertainty() == null) { "uncertainty before the first photo" }
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
            if (i == 0) {
                scanner.beginGuide(GuideOptions(steadySeconds = 0.1f))
                verify(scanner.guide(photo(i), info).action == Action.HOLD) { "not steady yet" }
                val guided = scanner.guide(photo(i), PhotoInfo(1f, Flash.TORCH, 150_000_000L))
                verify(guided.action == Action.SHOOT && guided.photos == 0) { guided.message }
                verify(guided.target!!.tiltDeg == 0f && guided.gain == null) { guided.message }
                verify(guided.probe.corners.size == probe.corners.size) { "probe" }
                scanner.beginGuide(GuideOptions(most = 0))
                verify(scanner.guide(photo(i), info).action == Action.ENOUGH) { "options" }
                scanner.beginGuide()
            }
            val outcome = scanner.addPhoto(photo(i, direct = i == 0), info)
            verify(outcome is Outcome.Accepted && outcome.index == i) { "$outcome" }
            verify(outcome.timestampNs == 1000L + i) { "$outcome" }
            verify((outcome as Outcome.Accepted).pose!!.reprojectionRmsPx < 0.5) { "$outcome" }
            verify(outcome.hints.isEmpty() && outcome.advice.isEmpty()) { "$outcome" }
            // The sample's centre is where the pose says, and all corners are in the picture.
            val pose = outcome.pose!!
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
        val dark = scanner.addPhoto(photo(0), PhotoInfo(ambient = photo(0))) as Outcome.Rejected
        verify(dark.reason == Rejection.BOARD_NOT_FOUND && dark.measured == 0f) { "$dark" }
        verify(dark.blurDirectionDeg == null && dark.limit == 0f) { "$dark" }
        throws<IllegalArgumentException>("ambient") {
            scanner.addPhoto(photo(0), PhotoInfo(ambient = gray()))
        }
        // Flat gray: no board; the scanner goes on.
        val pixels = ByteBuffer.allocateDirect(3 * 2016 * 1512)
        while (pixels.hasRemaining()) {
            pixels.put(128.toByte())
        }
        pixels.rewind()
        val blank = Photo.packed(PixelFormat.RGB8, pixels, 2016, 1512)
        val refused = scanner.addPhoto(blank) as Outcome.Rejected
        verify(refused.reason == Rejection.BOARD_NOT_FOUND) { "$refused" }
        verify(refused.advice.contains("checkerboard")) { refused.advice }
        val wrong = scanner.addPhoto(gray()) as Outcome.Rejected
        verify(wrong.reason == Rejection.WRONG_SIZE && wrong.advice.contains("2016x1512")) { "$wrong" }
        verify(scanner.await()) { "no end without a limit" }
        eventually("no callback") { progressed.get() > 0 && mapped.get() > 0 }
        val progress = scanner.progress
        verify(progress.settled && progress.photos == 2 && progress.state == ScanState.READY) {
            "$progress"
        }
        verify(Math.abs(scanner.light.flashOffsetMm[0] - 4.92) < 0.5) { "light" }
        scanner.snapshotWithUncertainty()!!.use { maps ->
            val rough = maps.deviations(MapKind.ROUGHNESS)
            val mean = Math.sqrt(rough.sumOf { it.toDouble() * it } / rough.size)
            verify(Math.abs(mean - maps.uncertainty.roughness) < 1e-4) { "$mean ${maps.uncertainty}" }
            verify(maps.uncertainty.normal > 0f && maps.uncertainty.diffuse > 0f) { "uncertainty" }
        }
        scanner.snapshot()!!.use { maps ->
            throws<IllegalArgumentException>("uncertainty") { maps.uncertainty }
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
            val lighting = Lighting(
                floatArrayOf(60f, 40f, 200f), floatArrayOf(0f, 0f, 250f),
                FloatArray(3) { 0.8f * Math.PI.toFloat() },
            )
            val relit = ByteBuffer.allocateDirect(4 * 256 * 256)
            maps.render(lighting, relit)
            val raw = ByteArray(relit.capacity()).also { relit.get(it) }
            File(out, "relit.rgba").writeBytes(raw)
        }
        scanner.pause()
        scanner.resume()
        scanner.cancel()
        val ended = throws<ScannerException>("") { scanner.addPhoto(photo(2)) }
        verify(ended.fault == Fault.CANCELLED) { "${ended.fault}" }
        verify(scanner.progress.state == ScanState.CANCELLED) { "${scanner.progress}" }
        verify(scanner.snapshot() != null) { "maps stay" }
    }
    verify(threads.toSet().size == 1 && threads.all { it.isDaemon }) { "${threads.toSet()}" }
    verify(lines.any { it.startsWith("WARNING") }) { "$lines" }
    for (file in listOf("normal", "diffuse", "specular", "roughness", "preview")) {
        verify(ImageIO.read(File(out, "$file.png")) != null) { file }
    }
}

/** Photos that are looked at, outcome and taken back. */
fun lookedAt() {
    MaterialScanner(options).use { scanner ->
        scanner.pause()
        for (i in 0..1) {
            verify(scanner.addPhoto(photo(i)) is Outcome.Accepted) { "$i" }
        }
        val again = scanner.probe(photo(0), PhotoInfo(flash = Flash.OFF))
        verify(again.hints == setOf(Hint.NOTHING_NEW) && again.sameViewAs == 0) { again.advice }
        verify(again.whiteLevel == null && again.view!!.offNextDeg!! > 1f) { "without flash" }
        val nothing = scanner.probe(gray())
        verify(nothing.reason == Rejection.BOARD_NOT_FOUND && nothing.view == null) { nothing.advice }
        verify(nothing.corners.isEmpty() && nothing.blurPx == null) { "nothing found" }
        verify(scanner.addPhoto(photo(0)) is Outcome.Accepted && scanner.progress.photos == 3) { "push" }
        throws<IllegalArgumentException>("index") { scanner.removePhoto(3) }
        throws<IllegalArgumentException>("index") { scanner.removePhoto(-1) }
        scanner.removePhoto(2)
        verify(scanner.progress.photos == 2) { "${scanner.progress}" }
        val fit = scanner.photoFit(1)
        verify(fit.weight > 0.3f && fit.residual > 0f && !fit.outlier) { "$fit" }
        throws<IllegalArgumentException>("index") { scanner.photoFit(2) }
    }
}

/** Hints of accepted photos. */
fun hints() {
    MaterialScanner(options).use { scanner ->
        scanner.pause()
        scanner.addPhoto(photo(0))
        val again = scanner.addPhoto(photo(0)) as Outcome.Accepted
        verify(again.hints == setOf(Hint.NOTHING_NEW) && again.sameViewAs == 0) { "$again" }
        verify(again.advice.startsWith("photo 1 has") && again.overWhite == null) { "$again" }
        val hint = scanner.hints().single { it.code == "nothing_new" }
        verify(hint.index == 1 && hint.text.startsWith("photo 1 has nearly")) { "$hint" }
    }
    MaterialScanner(options.copy(elevationMm = 2.5)).use { scanner ->
        scanner.pause()
        scanner.addPhoto(photo(0))
        verify(scanner.paper!!.elevationMm == 2.5) { "${scanner.paper}" }
    }
    throws<IllegalArgumentException>("elevation") { MaterialScanner(options.copy(elevationMm = 21.0)) }
    // No camera given; encoded values said to be linear.
    MaterialScanner(options.copy(camera = null)).use { scanner ->
        scanner.pause()
        verify(scanner.camera == null) { "a camera before the first photo" }
        val encoded = photo(0)
        val linear = Photo(PixelFormat.RGB8, 2016, 1512, encoded.planes, Transfer.LINEAR)
        val odd = scanner.addPhoto(linear, PhotoInfo(focal35mm = 26.6f)) as Outcome.Accepted
        verify(odd.hints == setOf(Hint.NOT_LINEAR) && odd.overWhite!! > 0.2f) { "$odd" }
        val found = scanner.camera!!
        verify(Math.abs(found.camera.fx / camera.fx - 1) < 0.1) { "${found.camera}" }
        val sigma = found.sigma!!
        verify(sigma[0] > 0.0) { "${sigma[0]}" }
        throws<IllegalArgumentException>("focal") {
            scanner.addPhoto(linear, PhotoInfo(focal35mm = Float.NaN))
        }
    }
}

/** Maps in every format, smaller, under a light; boards. */
fun outputs() {
    val board = Board.DEFAULT
    verify(String(board.print(), 0, 5, Charsets.US_ASCII) == "%PDF-") { "PDF" }
    val svg = String(board.print(SheetFormat.SVG, Page.LETTER), Charsets.UTF_8)
    verify(svg.contains("width=\"215.9mm\"")) { svg.take(200) }
    val markers = board.copy(dictionary = "DICT_4X4_250", markerMm = 8.0)
    verify(ImageIO.read(markers.print(SheetFormat.PNG).inputStream()).width == 4961) { "PNG" }
    throws<IllegalArgumentException>("too large") { board.copy(squareMm = 14.0).print() }
    throws<IllegalArgumentException>("marker") { markers.copy(dictionary = "DICT_4X4_50").print() }

    MaterialScanner(small).use { scanner ->
        verify(scanner.snapshotReduced(1) == null) { "maps before the first photo" }
        scanner.pause()
        scanner.addRectifiedPhoto(gray(), above, above)
        scanner.snapshotReduced(2)!!.use { verify(it.width == 64 && it.widthMm == 100f) { "size" } }
        throws<IllegalArgumentException>("level") { scanner.snapshotReduced(9) }
        val maps = scanner.snapshot()!!
        maps.reduced(8).use { verify(it.width == 1 && it.height == 1) { "one texel" } }
        throws<IllegalArgumentException>("level") { maps.reduced(-1) }
        val rough = maps.floats(MapKind.ROUGHNESS)
        val wide = maps.texels(MapKind.ROUGHNESS, MapFormat.RGBA32F).order(ByteOrder.nativeOrder())
        val half = maps.texels(MapKind.ROUGHNESS, MapFormat.RGBA16F).order(ByteOrder.nativeOrder())
        val byte = maps.texels(MapKind.ROUGHNESS, MapFormat.R8)
        verify(wide.getFloat(4) == rough[0] && half.getShort(6) == 0x3C00.toShort()) { "roughness" }
        verify(byte.capacity() == 256 * 256 && byte[9] == maps.rgba8(MapKind.ROUGHNESS)[37]) { "R8" }
        throws<IllegalArgumentException>("R8") { maps.texels(MapKind.NORMAL, MapFormat.R8) }
        val (up, down) = listOf(MapKind.NORMAL, MapKind.NORMAL_DIRECTX).map { maps.floats(it) }
        verify(up[0] == down[0] && up[1] == -down[1] && up[2] == down[2]) { "DirectX" }
        val into = ByteBuffer.allocateDirect(16 * 256 * 256)
        maps.render(Lighting(ambient = FloatArray(3) { 0.5f }), into, MapFormat.RGBA32F)
        verify(into.order(ByteOrder.nativeOrder()).getFloat(12) == 1f) { "alpha" }
        throws<IllegalArgumentException>("camera_mm") { maps.render(Lighting(cameraMm = FloatArray(3)), into) }
        throws<IllegalArgumentException>("three") { maps.render(Lighting(FloatArray(2)), into) }
        throws<IllegalArgumentException>("direct") { maps.render(Lighting(), ByteBuffer.allocate(1 shl 20)) }
        throws<IllegalArgumentException>("bytes") { maps.render(Lighting(), ByteBuffer.allocateDirect(9)) }
        maps.close()
        throws<IllegalStateException>("closed") { maps.render(Lighting(), into) }
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
            verify(scanner.addRectifiedPhoto(gray(), above, above) is Outcome.Accepted) { "own models" }
        }
        throws<IllegalStateException>("closed") { MaterialScanner(small.copy(models = models)) }
    }
}

fun savedAndRestored() {
    val file = File(out, "\uD83D\uDE00.scan")
    val before = MaterialScanner(small).use { scanner ->
        scanner.setBudget(Budget(seconds = 30f, maxSteps = 3, stopWhenInvisible = true))
        throws<IllegalArgumentException>("") { scanner.setBudget(Budget(seconds = Float.NaN)) }
        scanner.addRectifiedPhoto(gray(), above, above)
        scanner.await()
        throws<IOException>("") { scanner.save(File("/proc/no/such")) }
        scanner.save(file)
        scanner.snapshot()!!.use { it.floats(MapKind.DIFFUSE) }
    }
    val called = CountDownLatch(1)
    val listener = object : MaterialScanner.Listener {
        override fun onMaps(scanner: MaterialScanner) {
            // Usable even when it comes at once.
            scanner.snapshot()!!.close()
            called.countDown()
        }
    }
    MaterialScanner.restore(file, listener).use { scanner ->
        verify(scanner.progress.photos == 1 && scanner.progress.fraction == 1f) { "${scanner.progress}" }
        // This one and one more are to come.
        scanner.announce(2)
        throws<IllegalArgumentException>("photos") { scanner.announce(-1) }
        val after = scanner.snapshot()!!.use { it.floats(MapKind.DIFFUSE) }
        verify(before == after) { "other maps" }
        verify(scanner.addRectifiedPhoto(gray(), above, above) is Outcome.Accepted) { "goes on" }
        scanner.await()
        verify(scanner.progress.photos == 2 && scanner.progress.fraction == 0.5f) { "${scanner.progress}" }
        scanner.announce(0)
        verify(scanner.progress.fraction == 1f) { "${scanner.progress}" }
        verify(called.await(PATIENCE_NS, TimeUnit.NANOSECONDS)) { "no callback with maps" }
    }
    throws<IOException>("") { MaterialScanner.restore(File(out, "missing")) }
    file.writeBytes(file.readBytes().copyOf(1000))
    val damaged = throws<ScannerException>("") { MaterialScanner.restore(file) }
    verify(damaged.fault == Fault.BAD_STATE) { "${damaged.fault}" }
    val limited = small.copy(memoryLimitBytes = 1)
    val large = throws<ScannerException>("") {
        MaterialScanner(limited).use { it.addRectifiedPhoto(gray(), above, above) }
    }
    verify(large.fault == Fault.MEMORY_LIMIT) { "${large.fault}" }
}

fun codesOfTheHeader() {
    val defines = Regex("#define SVBRDF_(\\w+) (-?\\d+)").findAll(header.readText())
        .associate { it.groupValues[1] to it.groupValues[2].toLong() }
    val codes = listOf<Pair<String, Map<String, Number>>>(
        "FEATURE_" to Feature.entries.associate { it.name to it.code },
        "PIXEL_" to PixelFormat.entries.associate { it.name to it.code },
        "TRANSFER_" to Transfer.entries.associate { it.name to it.code },
        "PRIMARIES_" to Primaries.entries.associate { it.name to it.code },
        "YUV_" to YuvMatrix.entries.associate { it.name to it.code },
        "BAYER_" to BayerPattern.entries.associate { it.name to it.code },
        "MAP_" to MapKind.entries.associate { it.name to it.code },
        "LOBE_" to Lobe.entries.associate { it.name to it.code },
        "MAP_FORMAT_" to MapFormat.entries.associate { it.name to it.code },
        "PAGE_" to Page.entries.associate { it.name to it.code },
        "SHEET_" to SheetFormat.entries.associate { it.name to it.code },
        "THREAD_" to ThreadRole.entries.filter { it != ThreadRole.OTHER }.associate { it.name to it.code },
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
                "INVALID_HANDLE" to Native.INVALID_HANDLE, "OK" to Native.OK,
                "REJECTED" to Native.REJECTED,
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
        "optional lobes" to ::optionalLobes,
        "layouts" to ::layouts,
        "formats of video" to ::formatsOfVideo,
        "outputs" to ::outputs,
        "models" to ::models,
        "saved and restored" to ::savedAndRestored,
        "callbacks that misbehave" to ::callbacksThatMisbehave,
        "closing while others call" to ::closingWhileOthersCall,
        "outcome without waiting" to ::pushedWithoutWaiting,
        "of the library" to ::ofTheLibrary,
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
