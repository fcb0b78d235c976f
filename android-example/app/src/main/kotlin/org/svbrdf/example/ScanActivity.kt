package org.svbrdf.example

import android.Manifest
import android.app.Activity
import android.content.ClipData
import android.content.Intent
import android.content.pm.PackageManager
import android.content.res.Configuration
import android.hardware.camera2.CameraAccessException
import android.hardware.camera2.CaptureResult
import android.net.Uri
import android.os.Bundle
import android.util.Log
import android.view.SurfaceHolder
import android.view.SurfaceView
import android.widget.Button
import android.widget.SeekBar
import android.widget.TextView
import java.io.File
import java.util.concurrent.Executors
import java.util.concurrent.RejectedExecutionException
import java.util.zip.ZipEntry
import java.util.zip.ZipOutputStream
import kotlin.math.roundToInt
import org.svbrdf.scanner.Board
import org.svbrdf.scanner.Flash
import org.svbrdf.scanner.Hint
import org.svbrdf.scanner.LogLevel
import org.svbrdf.scanner.MaterialMaps
import org.svbrdf.scanner.MaterialScanner
import org.svbrdf.scanner.PhotoInfo
import org.svbrdf.scanner.Progress
import org.svbrdf.scanner.Pushed
import org.svbrdf.scanner.Rejection
import org.svbrdf.scanner.ScanOptions

/** Scans one material: meter, lock, photos from several sides, share. */
class ScanActivity : Activity(), SurfaceHolder.Callback, FlashCamera.Listener,
    MaterialScanner.Listener, SeekBar.OnSeekBarChangeListener {

    private lateinit var finder: FinderLayout
    private lateinit var overlay: BoardOverlay
    private lateinit var relit: RelitView
    private lateinit var feedback: TextView
    private lateinit var fit: TextView
    private lateinit var lock: Button
    private lateinit var photo: Button
    private lateinit var share: Button
    private lateinit var fresh: Button
    private lateinit var exposure: SeekBar
    private lateinit var focus: SeekBar

    private var camera: FlashCamera? = null
    private var surface: SurfaceHolder? = null
    private var started = false
    private var locked = false

    /** Photos and files, one after the other, off the main thread. */
    private val work = Executors.newSingleThreadExecutor()

    // Of `work`.
    private var scanner: MaterialScanner? = null
    private var firstExposure = 0.0

    override fun onCreate(state: Bundle?) {
        super.onCreate(state)
        setContentView(R.layout.scan)
        finder = findViewById(R.id.finder) as FinderLayout
        overlay = findViewById(R.id.overlay) as BoardOverlay
        relit = findViewById(R.id.relit) as RelitView
        feedback = findViewById(R.id.feedback) as TextView
        fit = findViewById(R.id.fit) as TextView
        lock = findViewById(R.id.lock) as Button
        photo = findViewById(R.id.photo) as Button
        share = findViewById(R.id.share) as Button
        fresh = findViewById(R.id.fresh) as Button
        exposure = findViewById(R.id.exposure) as SeekBar
        focus = findViewById(R.id.focus) as SeekBar
        overlay.board = BOARD
        lock.setOnClickListener { toggleLock() }
        photo.setOnClickListener { takePhoto() }
        share.setOnClickListener { export() }
        fresh.setOnClickListener { startAnew() }
        exposure.setOnSeekBarChangeListener(this)
        focus.setOnSeekBarChangeListener(this)
        focus.progress = 50
        (findViewById(R.id.preview) as SurfaceView).holder.addCallback(this)
        later { restore() }
        if (checkSelfPermission(Manifest.permission.CAMERA) != PackageManager.PERMISSION_GRANTED) {
            requestPermissions(arrayOf(Manifest.permission.CAMERA), 0)
        }
    }

    override fun onRequestPermissionsResult(code: Int, names: Array<String>, granted: IntArray) {
        if (granted.firstOrNull() == PackageManager.PERMISSION_GRANTED) {
            openCamera()
        } else {
            feedback.setText(R.string.need_camera)
        }
    }

    override fun onResume() {
        super.onResume()
        started = true
        later { scanner?.resume() }
        openCamera()
    }

    override fun onPause() {
        started = false
        closeCamera()
        // The fit goes on when the user is back.
        later { scanner?.pause() }
        super.onPause()
    }

    override fun onStop() {
        // The phone may end the app from here on.
        later { save() }
        super.onStop()
    }

    override fun onDestroy() {
        later { scanner?.close() }
        work.shutdown()
        super.onDestroy()
    }

    // The scan, on `work`.

    private val saved get() = File(filesDir, "scan")

    /** Faults here have nobody to tell: the next photo meets them again. */
    private fun later(body: () -> Unit) = work.execute {
        try {
            body()
        } catch (fault: Exception) {
            Log.e(TAG, "scan", fault)
        }
    }

    private fun save() {
        val scan = scanner ?: return
        scan.save(saved)
        // Exposures of later photos are relative to the first one's.
        val values = getPreferences(MODE_PRIVATE).edit()
        values.putLong(EXPOSURE, firstExposure.toRawBits()).apply()
    }

    private fun restore() {
        if (!saved.isFile) {
            return
        }
        try {
            scanner = MaterialScanner.restore(saved, this)
            firstExposure = Double.fromBits(getPreferences(MODE_PRIVATE).getLong(EXPOSURE, 0))
        } catch (fault: Exception) {
            // Of another version, or damaged: a new scan then.
            Log.w(TAG, "restore", fault)
            saved.delete()
        }
    }

    private fun startAnew() {
        later {
            scanner?.close()
            scanner = null
            firstExposure = 0.0
            saved.delete()
            runOnUiThread {
                relit.material = null
                share.isEnabled = false
                fit.text = ""
                overlay.show(null, null, 0)
                overlay.good = null
                feedback.setText(if (locked) R.string.locked else R.string.meter)
            }
        }
    }

    // The camera.

    private fun openCamera() {
        val allowed =
            checkSelfPermission(Manifest.permission.CAMERA) == PackageManager.PERMISSION_GRANTED
        if (!started || !allowed || camera != null) {
            return
        }
        val opened = try {
            FlashCamera(this, RAW, this)
        } catch (none: NoSuchElementException) {
            feedback.setText(R.string.no_camera)
            return
        } catch (gone: CameraAccessException) {
            feedback.setText(R.string.camera_lost)
            return
        }
        camera = opened
        setLocked(false)
        feedback.setText(R.string.meter)
        // The preview has the sensor's shape, upright.
        val size = opened.previewSize
        finder.shape = opened.uprightShape(this)
        val holder = (findViewById(R.id.preview) as SurfaceView).holder
        holder.setFixedSize(size.width, size.height)
        start()
    }

    /** Large screens turn the app whatever the manifest says. */
    override fun onConfigurationChanged(now: Configuration) {
        super.onConfigurationChanged(now)
        camera?.let { finder.shape = it.uprightShape(this) }
        overlay.show(null, null, 0)
    }

    /** Once there are a camera and a surface of its size. */
    private fun start() {
        val camera = camera ?: return
        val holder = surface ?: return
        val frame = holder.surfaceFrame
        if (frame.width() != camera.previewSize.width || frame.height() != camera.previewSize.height) {
            return // surfaceChanged() follows.
        }
        try {
            camera.open(holder.surface)
        } catch (gone: CameraAccessException) {
            onLost()
        }
    }

    private fun closeCamera() {
        camera?.close()
        camera = null
    }

    override fun surfaceCreated(holder: SurfaceHolder) {}

    override fun surfaceChanged(holder: SurfaceHolder, format: Int, width: Int, height: Int) {
        surface = holder
        if (camera == null) openCamera() else start()
    }

    override fun surfaceDestroyed(holder: SurfaceHolder) {
        surface = null
        closeCamera()
    }

    override fun onLost() = runOnUiThread {
        closeCamera()
        setLocked(false)
        feedback.setText(R.string.camera_lost)
    }

    private fun setLocked(now: Boolean) {
        locked = now
        lock.setText(if (now) R.string.unlock else R.string.lock)
        photo.isEnabled = now
        exposure.isEnabled = now
        focus.isEnabled = now
        exposure.progress = exposure.max / 2
        focus.progress = focus.max / 2
    }

    private fun toggleLock() {
        val camera = camera ?: return
        if (locked) {
            camera.unlock()
            setLocked(false)
            feedback.setText(R.string.meter)
        } else if (camera.lock()) {
            setLocked(true)
            feedback.setText(R.string.locked)
        } else {
            feedback.setText(R.string.metering)
        }
    }

    override fun onProgressChanged(bar: SeekBar, value: Int, byUser: Boolean) {
        if (byUser && locked) {
            // Two stops and two dioptres either way.
            val stops = 2f * (2f * exposure.progress / exposure.max - 1f)
            val dioptres = 2f * (2f * focus.progress / focus.max - 1f)
            camera?.adjust(stops, dioptres)
        }
    }

    override fun onStartTrackingTouch(bar: SeekBar) {}

    override fun onStopTrackingTouch(bar: SeekBar) {}

    // Photos.

    private fun takePhoto() {
        photo.isEnabled = false
        feedback.setText(R.string.taking)
        camera?.shoot { runOnUiThread { told(getString(R.string.failed, "camera"), false) } }
    }

    /** On the camera's thread. */
    override fun onShot(shot: FlashCamera.Shot) {
        try {
            work.execute {
                val (words, good) = try {
                    shot.use { push(it) }
                } catch (fault: Exception) {
                    Log.e(TAG, "push", fault)
                    getString(R.string.failed, fault.message) to false
                }
                runOnUiThread { told(words, good) }
            }
        } catch (ended: RejectedExecutionException) {
            shot.close()
        }
    }

    private fun push(shot: FlashCamera.Shot): Pair<String, Boolean> {
        val intrinsics = shot.camera.intrinsics()
        val session = scanner ?: MaterialScanner(
            ScanOptions(SAMPLE_WIDTH_MM, SAMPLE_HEIGHT_MM, BOARD, intrinsics), this,
        ).also { scanner = it }
        val exposure = shot.result.exposure()
        if (firstExposure == 0.0) {
            firstExposure = exposure
        }
        val lamp = when (shot.result[CaptureResult.FLASH_STATE]) {
            CaptureResult.FLASH_STATE_FIRED -> Flash.TORCH
            else -> Flash.UNKNOWN
        }
        val info = PhotoInfo((exposure / firstExposure).toFloat(), lamp, shot.image.timestamp)
        return when (val pushed = session.push(shot.photo(), info)) {
            is Pushed.Accepted -> {
                runOnUiThread { overlay.show(pushed.pose, intrinsics, shot.camera.turn(this)) }
                val degrees = Math.toDegrees(pushed.pose?.angle ?: 0.0).toInt()
                val more = (words(pushed) + next(session)).joinToString(" ")
                getString(R.string.accepted, pushed.index + 1, degrees, more) to true
            }
            is Pushed.Rejected -> {
                runOnUiThread { overlay.show(null, null, 0) }
                if (session.progress.photos == 0) {
                    firstExposure = 0.0
                }
                getString(R.string.rejected, words(pushed)) to false
            }
        }
    }

    /** From where the next photo tells most. */
    private fun next(session: MaterialScanner): List<String> {
        val view = session.nextView ?: return emptyList()
        val side = resources.getStringArray(R.array.sides)[(view.azimuthDeg / 45).roundToInt() % 8]
        val there = when (view.tiltDeg) {
            0f -> getString(R.string.next_top)
            else -> getString(R.string.next_side, view.tiltDeg.roundToInt(), side)
        }
        val enough = if (session.progress.photos < ENOUGH) "" else getString(R.string.enough)
        return listOf(enough, there).filter { it.isNotEmpty() }
    }

    /** What an accepted photo could do better. */
    private fun words(accepted: Pushed.Accepted): List<String> = accepted.hints.map { hint ->
        when (hint) {
            Hint.NOTHING_NEW ->
                getString(R.string.hint_nothing_new, (accepted.sameViewAs ?: 0) + 1)
            Hint.NOT_LINEAR -> getString(R.string.hint_not_linear)
            Hint.OTHER -> accepted.advice
        }
    }

    /** Words for the reasons that a user can do something about; the library's own for the rest. */
    private fun words(rejected: Pushed.Rejected): String = when (rejected.reason) {
        Rejection.BOARD_NOT_FOUND, Rejection.TOO_FEW_CORNERS -> getString(R.string.advice_board)
        Rejection.POSE_UNCERTAIN -> getString(R.string.advice_pose)
        Rejection.BLURRED -> getString(
            if (rejected.blurDirectionDeg == null) R.string.advice_blurred else R.string.advice_moved,
        )
        Rejection.TOO_DARK -> getString(R.string.advice_dark)
        Rejection.CLIPPED -> getString(R.string.advice_clipped)
        Rejection.TOO_GRAZING -> getString(R.string.advice_grazing)
        Rejection.SAMPLE_OUTSIDE -> getString(R.string.advice_outside)
        Rejection.LIGHT_NOT_VISIBLE -> getString(R.string.advice_light)
        else -> rejected.advice
    }

    private fun told(words: String, good: Boolean) {
        feedback.text = words
        overlay.good = good
        photo.isEnabled = locked
    }

    // The scanner, on its own thread.

    override fun onProgress(scanner: MaterialScanner, progress: Progress) {
        runOnUiThread {
            fit.text = when {
                progress.settled -> getString(R.string.fit_done)
                else -> getString(R.string.fit, percent(progress.fraction))
            }
        }
    }

    override fun onMaps(scanner: MaterialScanner) {
        val shown = scanner.snapshotReduced(PREVIEW_LEVEL) ?: return
        runOnUiThread {
            relit.material = shown
            share.isEnabled = true
        }
    }

    override fun onLog(level: LogLevel, line: String) {
        Log.println(
            when (level) {
                LogLevel.ERROR -> Log.ERROR
                LogLevel.WARNING -> Log.WARN
                LogLevel.INFO -> Log.INFO
            },
            TAG, line,
        )
    }

    // Sharing.

    private fun export() {
        feedback.setText(R.string.sharing)
        share.isEnabled = false
        work.execute {
            try {
                val files = scanner?.snapshot()?.use { write(it) }
                val photos = scanner?.progress?.photos ?: 0
                runOnUiThread {
                    if (files == null) feedback.setText(R.string.no_maps) else send(files, photos)
                }
            } catch (fault: Exception) {
                Log.e(TAG, "export", fault)
                runOnUiThread { feedback.text = getString(R.string.failed, fault.message) }
            } finally {
                runOnUiThread { share.isEnabled = true }
            }
        }
    }

    /** A glTF file, and the maps as files in an archive. */
    private fun write(maps: MaterialMaps): List<File> {
        val target = ShareProvider.folder(this)
        val gltf = File(target, "material.glb")
        gltf.writeBytes(maps.glb())
        val folder = File(cacheDir, "maps")
        maps.export(folder)
        val archive = File(target, "material.zip")
        ZipOutputStream(archive.outputStream().buffered()).use { zip ->
            for (file in folder.listFiles().orEmpty().sorted()) {
                zip.putNextEntry(ZipEntry(file.name))
                file.inputStream().use { it.copyTo(zip) }
                zip.closeEntry()
            }
        }
        return listOf(gltf, archive)
    }

    private fun send(files: List<File>, photos: Int) {
        val uris = ArrayList<Uri>(files.map { ShareProvider.uri(it) })
        val intent = Intent(Intent.ACTION_SEND_MULTIPLE)
            .setType("*/*")
            .putParcelableArrayListExtra(Intent.EXTRA_STREAM, uris)
            .addFlags(Intent.FLAG_GRANT_READ_URI_PERMISSION)
        // Without it, apps that ask late are not let in.
        val clip = ClipData.newRawUri("", uris[0])
        uris.drop(1).forEach { clip.addItem(ClipData.Item(it)) }
        intent.clipData = clip
        startActivity(Intent.createChooser(intent, getString(R.string.share)))
        feedback.setText(if (photos < ENOUGH) R.string.next_round else R.string.enough)
    }

    private companion object {
        const val TAG = "svbrdf"
        const val EXPOSURE = "exposure"

        /** The sample inside the board that `svbrdf board` prints. */
        val BOARD = Board.DEFAULT
        const val SAMPLE_WIDTH_MM = 100f
        const val SAMPLE_HEIGHT_MM = 100f

        /** Raw values are the most faithful, and slow: a dozen megapixels. */
        const val RAW = false

        /** How often the maps are halved to be shown: 256 texels follow a finger. */
        const val PREVIEW_LEVEL = 0

        /** Photos that make good maps. */
        const val ENOUGH = 5
    }
}
