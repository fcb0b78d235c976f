package org.svbrdf.example

import android.Manifest
import android.app.Activity
import android.content.ClipData
import android.content.Context
import android.content.Intent
import android.content.pm.PackageManager
import android.content.res.Configuration
import android.hardware.camera2.CameraAccessException
import android.hardware.camera2.CameraManager
import android.net.Uri
import android.os.Bundle
import android.os.SystemClock
import android.view.SurfaceHolder
import android.view.SurfaceView
import android.widget.Button
import android.widget.CheckBox
import android.widget.SeekBar
import android.widget.TextView
import java.io.File
import java.util.zip.ZipEntry
import java.util.zip.ZipOutputStream
import kotlin.math.roundToInt
import org.svbrdf.scanner.Action
import org.svbrdf.scanner.Camera
import org.svbrdf.scanner.Guidance
import org.svbrdf.scanner.Hint
import org.svbrdf.scanner.MaterialMaps
import org.svbrdf.scanner.Progress
import org.svbrdf.scanner.Outcome
import org.svbrdf.scanner.Rejection

/** Scans one material: meter, lock, photos from several sides as the library's guide says, share. */
class ScanActivity : Activity(), SurfaceHolder.Callback, FlashCamera.Listener, ScanModel.Screen,
    SeekBar.OnSeekBarChangeListener {

    private lateinit var finder: FinderLayout
    private lateinit var overlay: BoardOverlay
    private lateinit var relit: RelitView
    private lateinit var feedback: TextView
    private lateinit var fit: TextView
    private lateinit var lock: Button
    private lateinit var photo: Button
    private lateinit var share: Button
    private lateinit var exposure: SeekBar
    private lateinit var focus: SeekBar
    private lateinit var automatic: CheckBox

    /** The scan, which outlives this activity when the phone makes it anew. */
    private lateinit var model: ScanModel

    private var camera: FlashCamera? = null
    private var surface: SurfaceHolder? = null
    private var started = false

    /** Read on the camera's thread. */
    @Volatile private var locked = false
    @Volatile private var shoots = true

    /** Until when the words on a photo stay, by the uptime clock, ms. */
    private var wordsUntil = 0L

    @Suppress("DEPRECATION") // See onRetainNonConfigurationInstance().
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
        exposure = findViewById(R.id.exposure) as SeekBar
        focus = findViewById(R.id.focus) as SeekBar
        automatic = findViewById(R.id.automatic) as CheckBox
        overlay.board = ScanModel.BOARD
        lock.setOnClickListener { toggleLock() }
        photo.setOnClickListener { takePhoto() }
        share.setOnClickListener { export() }
        (findViewById(R.id.fresh) as Button).setOnClickListener { startAnew() }
        automatic.setOnCheckedChangeListener { _, on -> shoots = on }
        exposure.setOnSeekBarChangeListener(this)
        focus.setOnSeekBarChangeListener(this)
        (findViewById(R.id.preview) as SurfaceView).holder.addCallback(this)
        model = lastNonConfigurationInstance as ScanModel? ?: ScanModel(this)
        if (checkSelfPermission(Manifest.permission.CAMERA) != PackageManager.PERMISSION_GRANTED) {
            requestPermissions(arrayOf(Manifest.permission.CAMERA), 0)
        }
    }

    // As androidx keeps its ViewModels; deprecated in old SDKs alone.
    @Suppress("OVERRIDE_DEPRECATION")
    override fun onRetainNonConfigurationInstance(): Any = model

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
        model.show(this)
        model.resume()
        openCamera()
    }

    override fun onPause() {
        started = false
        closeCamera()
        model.show(null)
        model.suspendAndSave()
        super.onPause()
    }

    override fun onDestroy() {
        if (!isChangingConfigurations) {
            model.close()
        }
        relit.material = null
        super.onDestroy()
    }

    private fun startAnew() = model.startAnew {
        relit.material = null
        share.isEnabled = false
        fit.text = ""
        overlay.clear()
        feedback.setText(if (locked) R.string.locked else R.string.meter)
        if (locked) {
            camera?.let { model.begin(it.choice) }
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
            val manager = getSystemService(Context.CAMERA_SERVICE) as CameraManager
            CameraChoice.of(manager, RAW)?.let { FlashCamera(manager, it, this) }
        } catch (gone: CameraAccessException) {
            feedback.setText(R.string.camera_lost)
            return
        }
        if (opened == null) {
            feedback.setText(R.string.no_camera)
            return
        }
        camera = opened
        setLocked(false)
        feedback.setText(if (opened.choice.isManual) R.string.meter else R.string.meter_automatic)
        // The preview has the sensor's shape, upright.
        val size = opened.choice.previewSize
        finder.shape = opened.choice.uprightShape(this)
        val holder = (findViewById(R.id.preview) as SurfaceView).holder
        holder.setFixedSize(size.width, size.height)
        start()
    }

    /** Large screens turn the app whatever the manifest says. */
    override fun onConfigurationChanged(now: Configuration) {
        super.onConfigurationChanged(now)
        camera?.let { finder.shape = it.choice.uprightShape(this) }
        overlay.clear()
    }

    /** Once there are a camera and a surface of its size. */
    private fun start() {
        val camera = camera ?: return
        val holder = surface ?: return
        val (frame, size) = holder.surfaceFrame to camera.choice.previewSize
        if (frame.width() != size.width || frame.height() != size.height) {
            return // surfaceChanged() follows.
        }
        try {
            camera.open(holder.surface)
        } catch (gone: CameraAccessException) {
            onLost()
        } catch (gone: IllegalArgumentException) {
            // The list of cameras has changed since.
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
        lock.isEnabled = true
        lock.setText(if (now) R.string.unlock else R.string.lock)
        photo.isEnabled = now
        exposure.isEnabled = now
        focus.isEnabled = now && camera?.choice?.isManual == true
        exposure.progress = exposure.max / 2
        focus.progress = focus.max / 2
        overlay.clear()
    }

    private fun toggleLock() {
        val camera = camera ?: return
        if (locked) {
            camera.unlock()
            setLocked(false)
            feedback.setText(R.string.meter)
        } else {
            lock.isEnabled = false
            feedback.setText(R.string.metering)
            camera.lock()
        }
    }

    /** On the camera's thread. */
    override fun onLocked() = runOnUiThread {
        setLocked(true)
        feedback.setText(R.string.locked)
        camera?.let { model.begin(it.choice) }
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
        camera?.shoot()
    }

    /** On the camera's thread. */
    override fun onShot(shot: FlashCamera.Shot) {
        model.add(shot)
    }

    /** On the camera's thread. */
    override fun onShotFailed() {
        model.missed()
        runOnUiThread { announce(getString(R.string.failed, "camera"), false) }
    }

    /** On the camera's thread. */
    override fun onLook(look: FlashCamera.Look) {
        if (!locked) {
            look.close()
            return
        }
        model.look(look) {
            // Otherwise the guide waits for the button.
            if (shoots) look.camera.shoot()
        }
    }

    override fun onGuidance(guidance: Guidance, width: Int, height: Int) {
        val turn = camera?.choice?.turn(this) ?: return
        if (!locked) {
            return
        }
        overlay.guide(guidance, width, height, turn)
        if (SystemClock.uptimeMillis() >= wordsUntil) {
            feedback.text = words(guidance)
        }
    }

    private fun words(guidance: Guidance): String = when (guidance.action) {
        Action.ADJUST -> guidance.probe.reason?.let { words(it, false) } ?: guidance.message
        Action.HOLD -> getString(R.string.hold)
        Action.SHOOT -> getString(if (shoots) R.string.taking else R.string.now)
        Action.ENOUGH -> getString(R.string.enough)
        Action.MOVE -> guidance.target?.let { there(it) } ?: guidance.message
        Action.OTHER -> guidance.message
    }

    private fun there(target: Guidance.Target): String {
        val side = resources.getStringArray(R.array.sides)[(target.azimuthDeg / 45).roundToInt() % 8]
        return when (target.tiltDeg) {
            0f -> getString(R.string.next_top)
            else -> getString(R.string.next_side, target.tiltDeg.roundToInt(), side)
        }
    }

    override fun onOutcome(outcome: Outcome, camera: Camera?) {
        when (outcome) {
            is Outcome.Accepted -> {
                val degrees = Math.toDegrees(outcome.pose?.angle ?: 0.0).toInt()
                val more = words(outcome).joinToString(" ")
                announce(getString(R.string.accepted, outcome.index + 1, degrees, more), true)
            }
            is Outcome.Rejected -> {
                val moved = outcome.blurDirectionDeg != null
                announce(getString(R.string.rejected, words(outcome.reason, moved) ?: outcome.advice), false)
            }
        }
    }

    /** Advice about an accepted photo. */
    private fun words(accepted: Outcome.Accepted): List<String> = accepted.hints.map { hint ->
        when (hint) {
            Hint.NOTHING_NEW ->
                getString(R.string.hint_nothing_new, (accepted.sameViewAs ?: 0) + 1)
            Hint.NOT_LINEAR -> getString(R.string.hint_not_linear)
            Hint.OTHER -> accepted.advice
        }
    }

    /** Words for the reasons that a user can do something about; null for the rest. */
    private fun words(reason: Rejection, moved: Boolean): String? = when (reason) {
        Rejection.BOARD_NOT_FOUND, Rejection.TOO_FEW_CORNERS -> getString(R.string.advice_board)
        Rejection.POSE_UNCERTAIN -> getString(R.string.advice_pose)
        Rejection.BLURRED -> getString(if (moved) R.string.advice_moved else R.string.advice_blurred)
        Rejection.TOO_DARK -> getString(R.string.advice_dark)
        Rejection.CLIPPED -> getString(R.string.advice_clipped)
        Rejection.TOO_GRAZING -> getString(R.string.advice_grazing)
        Rejection.SAMPLE_OUTSIDE -> getString(R.string.advice_outside)
        Rejection.LIGHT_NOT_VISIBLE -> getString(R.string.advice_light)
        else -> null
    }

    private fun announce(words: String, good: Boolean) {
        feedback.text = words
        wordsUntil = SystemClock.uptimeMillis() + WORDS_MS
        overlay.good = good
        photo.isEnabled = locked
    }

    // The scan.

    override fun onProgress(progress: Progress) {
        fit.text = when {
            progress.settled -> getString(R.string.fit_done)
            else -> getString(R.string.fit, (100 * progress.fraction).roundToInt())
        }
    }

    override fun onMaps(maps: MaterialMaps) {
        relit.material = maps
        share.isEnabled = true
    }

    override fun onFault(fault: Exception) = announce(getString(R.string.failed, fault.message), false)

    // Sharing.

    private fun export() {
        feedback.setText(R.string.sharing)
        share.isEnabled = false
        model.withMaps { maps, photos ->
            val files = try {
                maps?.let { write(it) }
            } finally {
                runOnUiThread { share.isEnabled = true }
            }
            runOnUiThread {
                if (files == null) feedback.setText(R.string.no_maps) else send(files, photos)
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
            for (file in folder.listFiles().orEmpty().sorted() + listOf(model.record).filter { it.isFile }) {
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
        /** Raw values are the most faithful, and slow: a dozen megapixels. */
        const val RAW = false

        /** How long the words on a photo stay, ms. */
        const val WORDS_MS = 2500L

        /** Photos that make good maps. */
        const val ENOUGH = 5
    }
}
