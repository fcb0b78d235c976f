package org.svbrdf.example

import android.content.Context
import android.hardware.camera2.CaptureResult
import android.os.Handler
import android.os.Looper
import android.util.Log
import java.io.File
import java.util.concurrent.Executors
import java.util.concurrent.RejectedExecutionException
import java.util.concurrent.atomic.AtomicBoolean
import org.svbrdf.scanner.Action
import org.svbrdf.scanner.Board
import org.svbrdf.scanner.Camera
import org.svbrdf.scanner.Flash
import org.svbrdf.scanner.Guidance
import org.svbrdf.scanner.LogLevel
import org.svbrdf.scanner.MaterialMaps
import org.svbrdf.scanner.MaterialScanner
import org.svbrdf.scanner.PhotoInfo
import org.svbrdf.scanner.Progress
import org.svbrdf.scanner.Outcome
import org.svbrdf.scanner.ScanOptions

/**
 * A scan, apart from the screen that shows it: photos outlive the activity's recreation. It works as
 * androidx's ViewModel does; `ScanActivity` hands it on.
 */
class ScanModel(context: Context) : MaterialScanner.Listener {
    /** The screen of a scan; called on the main thread. */
    interface Screen {
        /** A photo was taken in, or not. */
        fun onOutcome(outcome: Outcome, camera: Camera?)

        /** The guidance for the latest picture of the preview. */
        fun onGuidance(guidance: Guidance, width: Int, height: Int)

        fun onProgress(progress: Progress)

        /** Newer maps; the screen closes them. */
        fun onMaps(maps: MaterialMaps)

        fun onFault(fault: Exception)
    }

    private val files = context.applicationContext.filesDir
    private val values = context.applicationContext.getSharedPreferences("scan", Context.MODE_PRIVATE)
    private val main = Handler(Looper.getMainLooper())

    /** Photos and files, one after the other. */
    private val work = Executors.newSingleThreadExecutor()

    /** Pictures of the preview: the latest, while the last one is looked at the others are dropped. */
    private val eye = Executors.newSingleThreadExecutor()
    private val looking = AtomicBoolean()

    /** Of the main thread. */
    private var screen: Screen? = null

    @Volatile private var scanner: MaterialScanner? = null

    // Of `work`.
    private var firstExposure = 0.0

    /** Exposure and strength of the lamp of each photo in the scan, a line each; shared with the maps. */
    val record get() = File(files, "photos.csv")

    init {
        later { restore() }
    }

    /** The screen that shows the scan from now on; the maps there are come at once. */
    fun show(on: Screen?) {
        screen = on
        later { scanner?.let { onMaps(it) } }
    }

    private fun tell(what: Screen.() -> Unit) {
        main.post { screen?.what() }
    }

    /** Faults go to the screen; work that comes after [close] is dropped. */
    fun later(body: () -> Unit) = try {
        work.execute {
            try {
                body()
            } catch (fault: Exception) {
                Log.e(TAG, "scan", fault)
                tell { onFault(fault) }
            }
        }
    } catch (ended: RejectedExecutionException) {
        Log.i(TAG, "closed", ended)
    }

    fun resume() = later { scanner?.resume() }

    /** The fit goes on when the user is back; the phone may end the app meanwhile. */
    fun suspendAndSave() = later {
        val scan = scanner ?: return@later
        scan.pause()
        scan.save(saved)
        // Exposures of later photos are relative to the first one's.
        values.edit().putLong(EXPOSURE, firstExposure.toRawBits()).apply()
    }

    private val saved get() = File(files, "scan")

    private fun restore() {
        if (!saved.isFile) {
            return
        }
        try {
            scanner = MaterialScanner.restore(saved, this)
            firstExposure = Double.fromBits(values.getLong(EXPOSURE, 0))
        } catch (fault: Exception) {
            // Of another version, or damaged: a new scan then.
            Log.w(TAG, "restore", fault)
            saved.delete()
            record.delete()
        }
    }

    fun startAnew(then: () -> Unit) = later {
        scanner?.close()
        scanner = null
        firstExposure = 0.0
        saved.delete()
        record.delete()
        main.post(then)
    }

    /** For good: the activity does not come back. */
    fun close() {
        screen = null
        later { scanner?.close() }
        work.shutdown()
        eye.shutdown()
    }

    /** A scan for photos of a camera, if there is none yet. */
    fun begin(choice: CameraChoice) = later {
        if (scanner == null) {
            val options = ScanOptions(SAMPLE_WIDTH_MM, SAMPLE_HEIGHT_MM, BOARD, choice.intrinsics())
            scanner = MaterialScanner(options, this)
        }
    }

    /** Takes a photo in, and closes it. */
    fun add(shot: FlashCamera.Shot) = try {
        work.execute {
            try {
                shot.use { pushNow(it) }
            } catch (fault: Exception) {
                Log.e(TAG, "photo", fault)
                scanner?.beginGuide()
                tell { onFault(fault) }
            }
        }
    } catch (ended: RejectedExecutionException) {
        shot.close()
    }

    private fun pushNow(shot: FlashCamera.Shot) {
        val session = scanner ?: throw IllegalStateException("no scan")
        val choice = shot.camera.choice
        // A camera that reports no exposure has locked it.
        val exposure = shot.result.exposure(raw = !shot.isYuv) ?: 1.0
        if (firstExposure == 0.0) {
            firstExposure = exposure
        }
        val level = shot.result.torchLevel()
        // A lamp whose strength is not known may have been dimmed: the library measures the light of each photo by the board.
        val lamp = if (level != null && shot.result.isLampOn()) Flash.TORCH else Flash.UNKNOWN
        val info = PhotoInfo(
            (exposure / firstExposure).toFloat(), lamp, shot.image.timestamp,
            focal35mm = choice.focal35Mm(),
        )
        val outcome = session.addPhoto(shot.photo(), info)
        if (outcome is Outcome.Accepted) {
            note(outcome.index, exposure, level, shot.result[CaptureResult.FLASH_STATE])
        }
        if (outcome is Outcome.Rejected) {
            session.beginGuide()
            if (session.progress.photos == 0) {
                firstExposure = 0.0
            }
        }
        val camera = choice.intrinsics() ?: session.camera?.camera
        tell { onOutcome(outcome, camera) }
    }

    private fun note(index: Int, exposure: Double, torchLevel: Int?, flashState: Int?) {
        val earlier = if (record.isFile) record.readLines().drop(1).take(index) else emptyList()
        val line = "${index + 1},$exposure,${torchLevel ?: "unknown"},${flashState ?: "unknown"}"
        record.writeText((listOf("photo,exposure,torch_level,flash_state") + earlier + line).joinToString("\n", postfix = "\n"))
        Log.i(TAG, "photo,exposure,torch_level,flash_state: $line")
    }

    /** Tells that the photo asked for was not taken. */
    fun missed() = later { scanner?.beginGuide() }

    /** Judges a picture of the preview, and closes it; `shoot`: takes the photo when it is time. */
    fun look(look: FlashCamera.Look, shoot: () -> Unit) {
        val session = scanner
        if (session == null || !looking.compareAndSet(false, true)) {
            look.close()
            return
        }
        try {
            eye.execute {
                try {
                    look.use { judge(session, it, shoot) }
                } catch (fault: Exception) {
                    // Of one picture of many: the next one may be better.
                    Log.w(TAG, "look", fault)
                } finally {
                    looking.set(false)
                }
            }
        } catch (ended: RejectedExecutionException) {
            looking.set(false)
            look.close()
        }
    }

    private fun judge(session: MaterialScanner, look: FlashCamera.Look, shoot: () -> Unit) {
        val image = look.image
        val info = PhotoInfo(1f, Flash.TORCH, image.timestamp, focal35mm = look.camera.choice.focal35Mm())
        val guidance = session.guide(look.photo(), info)
        val (width, height) = image.width to image.height
        if (guidance.action == Action.SHOOT) {
            shoot()
        }
        tell { onGuidance(guidance, width, height) }
    }

    // The scanner, on its own thread.

    override fun onProgress(scanner: MaterialScanner, progress: Progress) = tell { onProgress(progress) }

    override fun onMaps(scanner: MaterialScanner) {
        val shown = scanner.snapshotReduced(PREVIEW_LEVEL) ?: return
        main.post { screen?.onMaps(shown) ?: shown.close() }
    }

    override fun onLog(level: LogLevel, line: String) {
        Log.println(
            when (level) {
                LogLevel.ERROR -> Log.ERROR
                LogLevel.WARNING -> Log.WARN
                LogLevel.INFO -> Log.INFO
                LogLevel.DEBUG -> Log.DEBUG
            },
            TAG, line,
        )
    }

    /** Hands the maps of the moment over, on `work`: null before the first photo. */
    fun withMaps(body: (MaterialMaps?, Int) -> Unit) = later {
        val maps = scanner?.snapshot()
        val photos = scanner?.progress?.photos ?: 0
        if (maps == null) body(null, 0) else maps.use { body(it, photos) }
    }

    companion object {
        const val TAG = "svbrdf"
        private const val EXPOSURE = "exposure"

        /** The sample inside the board that `svbrdf board` prints. */
        val BOARD = Board.DEFAULT
        const val SAMPLE_WIDTH_MM = 100f
        const val SAMPLE_HEIGHT_MM = 100f

        /** How often the maps are halved to be shown: 256 texels follow a finger. */
        private const val PREVIEW_LEVEL = 0
    }
}
