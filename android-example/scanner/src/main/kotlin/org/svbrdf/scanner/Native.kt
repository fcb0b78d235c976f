package org.svbrdf.scanner

import java.io.IOException
import java.lang.ref.WeakReference
import java.nio.ByteBuffer
import java.util.concurrent.ConcurrentHashMap
import java.util.concurrent.atomic.AtomicLong

/**
 * The functions of the C files in `cpp`, and those that they call. `owner` is the object that owns the
 * handle: it is not collected during the call. Text is UTF-8; text for the library ends with a NUL.
 */
internal object Native {
    init {
        System.loadLibrary("svbrdf_jni")
    }

    @JvmStatic external fun version(): ByteArray
    @JvmStatic external fun features(): Long
    @JvmStatic external fun setLog(on: Boolean)
    @JvmStatic external fun setThreadHook(on: Boolean)
    @JvmStatic external fun boardPrint(
        board: DoubleArray, dictionary: ByteArray?, page: Int, format: Int,
    ): ByteArray

    @JvmStatic external fun sessionCreate(
        ints: IntArray, reals: FloatArray, board: DoubleArray?, dictionary: ByteArray?,
        camera: DoubleArray?, flashOffset: DoubleArray?, elevation: Double, memoryLimit: Long,
        state: ByteArray?, owner: Any, models: Long, id: Long,
    ): Long
    @JvmStatic external fun sessionDestroy(handle: Long)
    @JvmStatic external fun sessionAddPhoto(
        owner: Any, handle: Long, ints: IntArray, planes: Array<ByteBuffer>, layout: LongArray,
        levels: FloatArray, exposure: Float, flash: Int, timestamp: Long, cameraMm: FloatArray?,
        lightMm: FloatArray?, darkInts: IntArray?, darkPlanes: Array<ByteBuffer>?,
        darkLayout: LongArray?, darkLevels: FloatArray?, darkExposure: Float, focal35mm: Float,
        report: DoubleArray,
    ): ByteArray
    @JvmStatic external fun sessionAddPhotoFile(
        owner: Any, handle: Long, file: ByteBuffer, position: Long, bytes: Long, exposure: Float,
        transfer: Int, rotation: Int, flash: Int, timestamp: Long, maxPixels: Long, maxBytes: Long,
        info: DoubleArray, names: Array<ByteArray?>, report: DoubleArray,
    ): ByteArray
    @JvmStatic external fun fileLookAt(
        file: ByteBuffer, position: Long, bytes: Long, info: DoubleArray, names: Array<ByteArray?>,
    )
    @JvmStatic external fun sessionAddPhotoAsync(
        owner: Any, handle: Long, ints: IntArray, planes: Array<ByteBuffer>, layout: LongArray,
        levels: FloatArray, exposure: Float, flash: Int, timestamp: Long, darkInts: IntArray?,
        darkPlanes: Array<ByteBuffer>?, darkLayout: LongArray?, darkLevels: FloatArray?,
        darkExposure: Float, focal35mm: Float, id: Long,
    )
    @JvmStatic external fun sessionProbe(
        owner: Any, handle: Long, ints: IntArray, planes: Array<ByteBuffer>, layout: LongArray,
        levels: FloatArray, exposure: Float, flash: Int, focal35mm: Float, corners: FloatArray,
        out: DoubleArray,
    ): ByteArray
    /** The probe's advice and the guidance's message. */
    @JvmStatic external fun sessionGuide(
        owner: Any, handle: Long, ints: IntArray, planes: Array<ByteBuffer>, layout: LongArray,
        levels: FloatArray, exposure: Float, flash: Int, focal35mm: Float, timestamp: Long,
        corners: FloatArray, out: DoubleArray,
    ): Array<ByteArray>
    @JvmStatic external fun sessionGuideBegin(owner: Any, handle: Long, options: FloatArray?)
    @JvmStatic external fun sessionRemovePhoto(owner: Any, handle: Long, index: Int)
    @JvmStatic external fun sessionPhotoFit(owner: Any, handle: Long, index: Int, out: DoubleArray)
    /** Number of the photo, code and sentence of each hint, each with a NUL at its end. */
    @JvmStatic external fun sessionHints(owner: Any, handle: Long): ByteArray
    @JvmStatic external fun sessionWait(owner: Any, handle: Long, limitMillis: Long): Boolean
    @JvmStatic external fun sessionAnnounce(owner: Any, handle: Long, photos: Int)
    @JvmStatic external fun sessionProgress(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun sessionLight(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun sessionNextView(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun sessionCamera(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun sessionPaper(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun sessionPose(owner: Any, handle: Long, index: Int, out: DoubleArray)
    @JvmStatic external fun sessionSnapshot(owner: Any, handle: Long): Long
    @JvmStatic external fun sessionSnapshotReduced(owner: Any, handle: Long, level: Int): Long
    @JvmStatic external fun sessionSnapshotWithUncertainty(owner: Any, handle: Long): Long
    @JvmStatic external fun sessionPause(owner: Any, handle: Long)
    @JvmStatic external fun sessionResume(owner: Any, handle: Long)
    @JvmStatic external fun sessionCancel(owner: Any, handle: Long)
    @JvmStatic external fun sessionSetBudget(
        owner: Any, handle: Long, seconds: Float, maxSteps: Int, stopWhenInvisible: Boolean,
    )
    @JvmStatic external fun sessionSave(owner: Any, handle: Long, path: ByteArray)

    @JvmStatic external fun mapsSize(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun mapsLobes(owner: Any, handle: Long): Int
    @JvmStatic external fun mapsFromMemory(
        width: Int, height: Int, widthMm: Float, heightMm: Float, maps: Array<FloatArray?>,
    ): Long
    @JvmStatic external fun mapsCopy(
        owner: Any, handle: Long, map: Int, format: Int, out: ByteBuffer, bytes: Long,
    )
    @JvmStatic external fun mapsReduced(owner: Any, handle: Long, level: Int): Long
    @JvmStatic external fun mapsRender(
        owner: Any, handle: Long, lighting: FloatArray, falloff: Int, format: Int, out: ByteBuffer,
        bytes: Long,
    )
    @JvmStatic external fun mapsUncertainty(owner: Any, handle: Long, out: DoubleArray)
    @JvmStatic external fun mapsDeviations(owner: Any, handle: Long, map: Int, out: FloatArray)
    @JvmStatic external fun mapsExport(owner: Any, handle: Long, path: ByteArray)
    @JvmStatic external fun mapsExportFormats(
        owner: Any, handle: Long, path: ByteArray, formats: ByteArray, tile: Boolean, metallic: Boolean,
    )
    @JvmStatic external fun mapsFile(
        owner: Any, handle: Long, format: ByteArray, name: ByteArray,
    ): ByteArray
    @JvmStatic external fun mapsDestroy(handle: Long)

    @JvmStatic external fun modelsFromMemory(
        decoder: ByteBuffer, encoder: ByteBuffer, photo: ByteBuffer, completion: ByteBuffer,
    ): Long
    @JvmStatic external fun modelsFromFolder(path: ByteArray): Long
    @JvmStatic external fun modelsDestroy(handle: Long)

    /** Text for the library. */
    fun text(text: String): ByteArray = (text + '\u0000').toByteArray(Charsets.UTF_8)

    /** The exception for a status. */
    @JvmStatic
    fun failure(status: Int, message: ByteArray): Throwable {
        val text = String(message, Charsets.UTF_8)
        return when (status) {
            INVALID_ARGUMENT -> IllegalArgumentException(text)
            INVALID_HANDLE -> IllegalStateException("closed")
            IO -> IOException(text)
            else -> ScannerException(Fault.of(status), text)
        }
    }

    const val OK = 0
    const val REJECTED = 1
    const val INVALID_ARGUMENT = -1
    const val INVALID_HANDLE = -2
    const val IO = -4

    // Callbacks name their session by a number: one that comes late finds nobody.
    private val scanners = ConcurrentHashMap<Long, WeakReference<MaterialScanner>>()
    private val ids = AtomicLong()

    fun register(scanner: MaterialScanner): Long {
        val id = ids.incrementAndGet()
        scanners[id] = WeakReference(scanner)
        return id
    }

    fun unregister(id: Long) {
        scanners.remove(id)
    }

    /** How many sessions with a listener are open. */
    val registered: Int get() = scanners.size

    private inline fun call(id: Long, body: (MaterialScanner, MaterialScanner.Listener) -> Unit) {
        val scanner = scanners[id]?.get() ?: return
        val listener = scanner.listener ?: return
        guarded({ scanner.closed }) { body(scanner, listener) }
    }

    /** Runs code of the app; `excused`: whether its exceptions are ignored. */
    private inline fun guarded(excused: () -> Boolean, body: () -> Unit) {
        try {
            body()
        } catch (thrown: Throwable) {
            if (excused()) {
                return // Closed by another thread, under the listener's feet.
            }
            // As for any thread: the platform's handler decides. Nothing runs through C.
            val thread = Thread.currentThread()
            thread.uncaughtExceptionHandler.uncaughtException(thread, thrown)
        }
    }

    @JvmStatic
    fun onProgress(id: Long, values: DoubleArray) = call(id) { scanner, listener ->
        if (scanner.created()) {
            listener.onProgress(scanner, Progress.of(values))
        }
    }

    @JvmStatic
    fun onMaps(id: Long) = call(id) { scanner, listener ->
        if (scanner.created()) {
            listener.onMaps(scanner)
        }
    }

    @JvmStatic
    fun onLog(id: Long, level: Int, line: ByteArray) = call(id) { _, listener ->
        listener.onLog(LogLevel.of(level), String(line, Charsets.UTF_8))
    }

    @Volatile var threadHook: Library.ThreadHook? = null
    @Volatile var logListener: Library.LogListener? = null

    @JvmStatic
    fun onThreadStart(role: Int) = guarded({ false }) {
        threadHook?.onStart(ThreadRole.of(role))
    }

    @JvmStatic
    fun onLibraryLog(level: Int, line: ByteArray) = guarded({ false }) {
        logListener?.onLog(LogLevel.of(level), String(line, Charsets.UTF_8))
    }

    /** Photos on their way by the number that their callbacks name. */
    private val pending = ConcurrentHashMap<Long, Pair<Long, MaterialScanner.OutcomeCallback>>()

    /** Calls `done` with the outcome of the photo that `add` gives to the library. */
    fun await(timestampNs: Long, done: MaterialScanner.OutcomeCallback, add: (Long) -> Unit) {
        val id = ids.incrementAndGet()
        pending[id] = timestampNs to done
        try {
            add(id)
        } catch (thrown: Throwable) {
            pending.remove(id)
            throw thrown
        }
    }

    @JvmStatic
    fun onOutcome(id: Long, status: Int, report: DoubleArray, words: ByteArray) {
        val (timestampNs, done) = pending.remove(id) ?: return
        guarded({ false }) {
            if (status == OK || status == REJECTED) {
                done.onOutcome(Outcome.of(report, String(words, Charsets.UTF_8), timestampNs), null)
            } else {
                done.onOutcome(null, failure(status, words))
            }
        }
    }
}
