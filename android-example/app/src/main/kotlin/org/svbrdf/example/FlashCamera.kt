package org.svbrdf.example

import android.annotation.SuppressLint
import android.graphics.ImageFormat
import android.hardware.camera2.CameraAccessException
import android.hardware.camera2.CameraCaptureSession
import android.hardware.camera2.CameraCharacteristics
import android.hardware.camera2.CameraDevice
import android.hardware.camera2.CameraManager
import android.hardware.camera2.CameraMetadata
import android.hardware.camera2.CaptureRequest
import android.hardware.camera2.CaptureResult
import android.hardware.camera2.TotalCaptureResult
import android.hardware.camera2.params.ColorSpaceTransform
import android.hardware.camera2.params.RggbChannelVector
import android.hardware.camera2.params.TonemapCurve
import android.media.Image
import android.media.ImageReader
import android.os.Handler
import android.os.HandlerThread
import android.os.SystemClock
import android.view.Surface
import java.util.concurrent.CountDownLatch
import java.util.concurrent.TimeUnit
import java.util.concurrent.atomic.AtomicInteger
import kotlin.math.max
import kotlin.math.min
import kotlin.math.pow
import kotlin.math.roundToLong

/**
 * A camera for measuring: lamp always on; exposure, sensitivity, focus and white balance fixed once [lock]ed, with a
 * linear tone curve where the phone allows it. Its listener is called on the camera's own thread.
 */
class FlashCamera(
    private val manager: CameraManager,
    val choice: CameraChoice,
    private val listener: Listener,
) {
    interface Listener {
        /** A photo with the camera's metadata; the receiver closes it. */
        fun onShot(shot: Shot)

        /** The photo that was asked for will not come. */
        fun onShotFailed()

        /** A picture of the preview; the receiver closes it, soon. */
        fun onLook(look: Look)

        /** Exposure, focus and white balance are fixed. */
        fun onLocked()

        fun onLost()
    }

    /** A picture whose memory the camera owns, until it is closed. */
    open class Look(val image: Image, val camera: FlashCamera) : AutoCloseable {
        /** Whether its values are proportional to light. */
        val isLinear = camera.locked?.isLinear == true

        override fun close() {
            image.close()
            camera.giveBack()
        }
    }

    /** A photo with its settings. */
    class Shot(image: Image, val result: TotalCaptureResult, camera: FlashCamera) : Look(image, camera)

    /** Settings of every photo; without numbers, those that the camera had found are held. */
    private class Settings(
        val exposureNs: Long,
        val sensitivity: Int,
        val boost: Int,
        val focus: Float,
        val gains: RggbChannelVector?,
        val transform: ColorSpaceTransform?,
    ) {
        val isLinear get() = gains != null
    }

    private val characteristics get() = choice.characteristics
    private val thread = HandlerThread("camera").apply { start() }
    private val handler = Handler(thread.looper)

    /** Photos; the same as [looks] where one stream is for both. */
    private val photos: ImageReader
    private val looks: ImageReader
    private var device: CameraDevice? = null
    private var session: CameraCaptureSession? = null
    private var preview: Surface? = null
    private var closed = false
    @Volatile private var opening = false
    private val ended = CountDownLatch(1)

    @Volatile private var locked: Settings? = null

    /** Whether the camera keeps the exposure that it found, since its lamp goes out when an app sets one. */
    @Volatile private var exposureHeld = false
    @Volatile private var stops = 0f
    @Volatile private var focusShift = 0f

    // Of the camera's thread.
    private val images = HashMap<Long, Image>()
    private val results = HashMap<Long, TotalCaptureResult>()

    /** Since when a lock is wanted, ms. */
    private var lockSince: Long? = null

    /** Whether the lamp was on before the lock, and pictures since then without it. */
    private var lampSeen = false
    private var dark = 0
    /** Number of the photo that is awaited; null: none. */
    private var awaited: Int? = null
    private var shots = 0

    /** Pictures not closed yet, and one for the open camera. */
    private val lent = AtomicInteger(1)

    /** Pictures lie in the readers' memory: they go last. */
    private fun giveBack() {
        if (lent.decrementAndGet() == 0) {
            photos.close()
            looks.close()
        }
    }

    init {
        val (size, small) = choice.size to choice.lookSize
        looks = ImageReader.newInstance(small.width, small.height, ImageFormat.YUV_420_888, 4)
        looks.setOnImageAvailableListener({ source -> look(source) }, handler)
        photos = if (!choice.isManual) looks else {
            ImageReader.newInstance(size.width, size.height, choice.format, 3).apply {
                setOnImageAvailableListener({ source -> quietly { source.acquireNextImage()?.let(::took) } }, handler)
            }
        }
    }

    /** Opens the camera; the permission has been granted. */
    @SuppressLint("MissingPermission")
    fun open(surface: Surface) {
        if (preview != null) {
            return
        }
        preview = surface
        opening = true
        manager.openCamera(choice.id, object : CameraDevice.StateCallback() {
            override fun onOpened(camera: CameraDevice) {
                opening = false
                if (closed) {
                    camera.close()
                    return
                }
                device = camera
                quietly({ lost(camera) }) { configure(camera, surface) }
            }

            override fun onDisconnected(camera: CameraDevice) = lost(camera)

            override fun onError(camera: CameraDevice, error: Int) = lost(camera)

            override fun onClosed(camera: CameraDevice) = ended.countDown()
        }, handler)
    }

    private fun lost(camera: CameraDevice) {
        opening = false
        session = null
        device = null
        camera.close()
        missed()
        if (!closed) {
            listener.onLost()
        }
    }

    @Suppress("DEPRECATION") // Its replacement came with API 28.
    private fun configure(camera: CameraDevice, surface: Surface) {
        val targets = listOf(surface, looks.surface, photos.surface).distinct()
        camera.createCaptureSession(targets, object : CameraCaptureSession.StateCallback() {
            override fun onConfigured(configured: CameraCaptureSession) {
                if (!closed) {
                    session = configured
                    repeat()
                }
            }

            override fun onConfigureFailed(configured: CameraCaptureSession) = lost(camera)
        }, handler)
    }

    /** Shows the preview, with automatic exposure until locked. */
    private fun repeat() = quietly {
        val session = session ?: return@quietly
        val request = session.device.createCaptureRequest(CameraDevice.TEMPLATE_PREVIEW)
        request.addTarget(preview!!)
        request.addTarget(looks.surface)
        fill(request)
        session.setRepeatingRequest(request.build(), object : CameraCaptureSession.CaptureCallback() {
            override fun onCaptureCompleted(
                from: CameraCaptureSession,
                request: CaptureRequest,
                result: TotalCaptureResult,
            ) = seen(result)
        }, handler)
    }

    private fun seen(result: TotalCaptureResult) {
        tryToLock(result)
        watchLamp(result)
        if (!choice.isManual && awaited != null) {
            result[CaptureResult.SENSOR_TIMESTAMP]?.let { results[it] = result; pair(it) }
        }
    }

    /** On some phones the lamp goes out with exposures that an app sets: then the camera measures, and holds its own. */
    private fun watchLamp(result: TotalCaptureResult) {
        val settings = locked ?: return
        if (!settings.isLinear || exposureHeld || !lampSeen) {
            return
        }
        dark = if (result.isLampOn()) 0 else dark + 1
        if (dark < DARK_PICTURES) return
        exposureHeld = true
        locked = null
        stops = 0f
        lockSince = SystemClock.elapsedRealtime()
        repeat()
    }

    private fun fill(request: CaptureRequest.Builder) {
        request[CaptureRequest.FLASH_MODE] = CameraMetadata.FLASH_MODE_TORCH
        choice.torchLevel?.let { level -> choice.requestKey<Int>(TORCH_LEVEL)?.let { request[it] = level } }
        // They move the picture against the board, or the lens.
        request[CaptureRequest.CONTROL_VIDEO_STABILIZATION_MODE] =
            CameraMetadata.CONTROL_VIDEO_STABILIZATION_MODE_OFF
        request[CaptureRequest.LENS_OPTICAL_STABILIZATION_MODE] =
            CameraMetadata.LENS_OPTICAL_STABILIZATION_MODE_OFF
        // The library corrects distortion itself; the camera does not report its own correction.
        choice.requestKey<Int>("android.distortionCorrection.mode")?.let { request[it] = 0 }
        val settings = locked
        if (settings == null || !settings.isLinear) {
            request[CaptureRequest.CONTROL_AE_MODE] = CameraMetadata.CONTROL_AE_MODE_ON
            request[CaptureRequest.CONTROL_AF_MODE] = CameraMetadata.CONTROL_AF_MODE_CONTINUOUS_PICTURE
            request[CaptureRequest.CONTROL_AWB_MODE] = CameraMetadata.CONTROL_AWB_MODE_AUTO
            request[CaptureRequest.CONTROL_AE_LOCK] = settings != null
            request[CaptureRequest.CONTROL_AWB_LOCK] = settings != null
            request[CaptureRequest.CONTROL_AE_EXPOSURE_COMPENSATION] = compensation()
            return
        }
        setExposure(request, settings)
        request[CaptureRequest.CONTROL_AF_MODE] = CameraMetadata.CONTROL_AF_MODE_OFF
        request[CaptureRequest.CONTROL_AWB_MODE] = CameraMetadata.CONTROL_AWB_MODE_OFF
        val nearest = characteristics[CameraCharacteristics.LENS_INFO_MINIMUM_FOCUS_DISTANCE] ?: 0f
        request[CaptureRequest.LENS_FOCUS_DISTANCE] =
            (settings.focus + focusShift).coerceIn(0f, nearest)
        request[CaptureRequest.COLOR_CORRECTION_MODE] =
            CameraMetadata.COLOR_CORRECTION_MODE_TRANSFORM_MATRIX
        request[CaptureRequest.COLOR_CORRECTION_GAINS] = settings.gains
        request[CaptureRequest.COLOR_CORRECTION_TRANSFORM] = settings.transform
        // Values proportional to light.
        request[CaptureRequest.TONEMAP_MODE] = CameraMetadata.TONEMAP_MODE_CONTRAST_CURVE
        request[CaptureRequest.TONEMAP_CURVE] = TonemapCurve(LINEAR, LINEAR, LINEAR)
        // Nothing that depends on the picture. Shading correction only evens out the lens.
        request[CaptureRequest.NOISE_REDUCTION_MODE] = CameraMetadata.NOISE_REDUCTION_MODE_OFF
        request[CaptureRequest.EDGE_MODE] = CameraMetadata.EDGE_MODE_OFF
        request[CaptureRequest.COLOR_CORRECTION_ABERRATION_MODE] =
            CameraMetadata.COLOR_CORRECTION_ABERRATION_MODE_OFF
        request[CaptureRequest.BLACK_LEVEL_LOCK] = true
    }

    private fun setExposure(request: CaptureRequest.Builder, settings: Settings) {
        if (exposureHeld) {
            request[CaptureRequest.CONTROL_AE_MODE] = CameraMetadata.CONTROL_AE_MODE_ON
            request[CaptureRequest.CONTROL_AE_LOCK] = true
            request[CaptureRequest.CONTROL_AE_EXPOSURE_COMPENSATION] = compensation()
            return
        }
        request[CaptureRequest.CONTROL_AE_MODE] = CameraMetadata.CONTROL_AE_MODE_OFF
        val times = characteristics[CameraCharacteristics.SENSOR_INFO_EXPOSURE_TIME_RANGE]!!
        // Short enough for the hand.
        val longest = min(times.upper, 33_000_000L)
        val exposure = (settings.exposureNs * 2f.pow(stops).toDouble()).roundToLong()
        request[CaptureRequest.SENSOR_EXPOSURE_TIME] =
            exposure.coerceIn(times.lower, max(times.lower, longest))
        request[CaptureRequest.SENSOR_SENSITIVITY] = settings.sensitivity
        choice.requestKey<Int>(BOOST)?.let { request[it] = settings.boost }
    }

    /** Steps of automatic exposure: highlights need room above its target. */
    private fun compensation(): Int {
        val step = characteristics[CameraCharacteristics.CONTROL_AE_COMPENSATION_STEP]?.toDouble() ?: 0.0
        val range = characteristics[CameraCharacteristics.CONTROL_AE_COMPENSATION_RANGE]
        if (choice.isManual && !exposureHeld || step <= 0.0 || range == null) {
            return 0
        }
        return ((if (choice.isManual) stops else stops - 1) / step).roundToLong().toInt().coerceIn(range.lower, range.upper)
    }

    /** Fixes exposure, focus and white balance as soon as all have settled; [Listener.onLocked] follows. */
    fun lock() = handler.post { lockSince = lockSince ?: SystemClock.elapsedRealtime() }

    private fun tryToLock(result: TotalCaptureResult) {
        val since = lockSince ?: return
        // On a surface without structure focus may never settle: the user has a slider.
        val patient = SystemClock.elapsedRealtime() - since < PATIENCE_MS
        if (patient && !isSettled(result)) {
            return
        }
        val found = settings(result) ?: return
        lockSince = null
        locked = found
        stops = if (found.isLinear) -1f else 0f
        focusShift = 0f
        lampSeen = result.isLampOn()
        dark = 0
        if (!found.isLinear) {
            holdFocus()
        }
        repeat()
        listener.onLocked()
    }

    private fun isSettled(result: TotalCaptureResult): Boolean {
        val exposed = result[CaptureResult.CONTROL_AE_STATE]
        val balanced = result[CaptureResult.CONTROL_AWB_STATE]
        val fixed = (characteristics[CameraCharacteristics.LENS_INFO_MINIMUM_FOCUS_DISTANCE] ?: 0f) == 0f
        val focused = fixed || when (result[CaptureResult.CONTROL_AF_STATE]) {
            CameraMetadata.CONTROL_AF_STATE_PASSIVE_FOCUSED,
            CameraMetadata.CONTROL_AF_STATE_FOCUSED_LOCKED -> true
            else -> false
        }
        return focused &&
            (exposed == null || exposed == CameraMetadata.CONTROL_AE_STATE_CONVERGED ||
                exposed == CameraMetadata.CONTROL_AE_STATE_LOCKED ||
                exposed == CameraMetadata.CONTROL_AE_STATE_FLASH_REQUIRED) &&
            (balanced == null || balanced == CameraMetadata.CONTROL_AWB_STATE_CONVERGED ||
                balanced == CameraMetadata.CONTROL_AWB_STATE_LOCKED)
    }

    private fun settings(result: TotalCaptureResult): Settings? {
        if (!choice.isManual) {
            return Settings(0, 0, 100, 0f, null, null)
        }
        return Settings(
            result[CaptureResult.SENSOR_EXPOSURE_TIME] ?: return null,
            result[CaptureResult.SENSOR_SENSITIVITY] ?: return null,
            result.boost(),
            result[CaptureResult.LENS_FOCUS_DISTANCE] ?: 0f,
            result[CaptureResult.COLOR_CORRECTION_GAINS] ?: return null,
            result[CaptureResult.COLOR_CORRECTION_TRANSFORM] ?: return null,
        )
    }

    /** Continuous focus stays where it is from a trigger on, until another ends that. */
    private fun holdFocus(trigger: Int = CameraMetadata.CONTROL_AF_TRIGGER_START) = quietly {
        val session = session ?: return@quietly
        val request = session.device.createCaptureRequest(CameraDevice.TEMPLATE_PREVIEW)
        request.addTarget(preview!!)
        fill(request)
        request[CaptureRequest.CONTROL_AF_TRIGGER] = trigger
        session.capture(request.build(), null, handler)
    }

    /** Back to automatic exposure. */
    fun unlock() = handler.post {
        lockSince = null
        locked = null
        stops = 0f
        if (!choice.isManual) {
            holdFocus(CameraMetadata.CONTROL_AF_TRIGGER_CANCEL)
        }
        repeat()
    }

    /** Exposure in stops and focus in dioptres relative to the locked values. */
    fun adjust(stops: Float, focusShift: Float) {
        this.stops = if (choice.isManual) stops - 1f else stops
        this.focusShift = focusShift
        handler.post { repeat() }
    }

    /** Takes a photo: [Listener.onShot] or [Listener.onShotFailed] follows, in a few seconds at most. */
    fun shoot() = handler.post {
        if (awaited != null) {
            return@post
        }
        val number = ++shots
        awaited = number
        handler.postDelayed({ if (awaited == number) missed() }, SHOT_MS)
        if (choice.isManual) {
            quietly(::missed) { capture(session ?: throw CameraAccessException(CameraAccessException.CAMERA_DISCONNECTED)) }
        }
        // Otherwise the next picture of the preview is the photo.
    }

    private fun capture(session: CameraCaptureSession) {
        val request = session.device.createCaptureRequest(CameraDevice.TEMPLATE_STILL_CAPTURE)
        request.addTarget(photos.surface)
        fill(request)
        session.capture(request.build(), object : CaptureListener() {
            override fun completed(result: TotalCaptureResult) {
                val time = result[CaptureResult.SENSOR_TIMESTAMP] ?: return missed()
                results[time] = result
                pair(time)
            }

            override fun failed() = missed()
        }, handler)
    }

    /** Pictures that come after all find nobody waiting. */
    private fun missed() {
        images.values.forEach { it.close() }
        images.clear()
        results.clear()
        if (awaited != null) {
            awaited = null
            listener.onShotFailed()
        }
    }

    private fun look(source: ImageReader) = quietly {
        val image = source.acquireLatestImage() ?: return@quietly
        if (!choice.isManual && awaited != null) {
            took(image)
        } else if (closed) {
            image.close()
        } else {
            lent.incrementAndGet()
            listener.onLook(Look(image, this))
        }
    }

    private fun took(image: Image) {
        if (awaited == null || images.size >= HELD) {
            image.close()
            return
        }
        images[image.timestamp] = image
        pair(image.timestamp)
    }

    /** An image and its result come in any order. */
    private fun pair(time: Long) {
        val image = images[time] ?: return
        val result = results.remove(time) ?: return
        images.remove(time)
        awaited = null
        lent.incrementAndGet()
        val shot = Shot(image, result, this)
        missed()
        if (closed) shot.close() else listener.onShot(shot)
    }

    /** The camera may vanish, or its surfaces, between any two lines; [Listener.onLost] or `otherwise` says so. */
    private fun quietly(otherwise: () -> Unit = {}, body: () -> Unit) {
        try {
            body()
        } catch (gone: CameraAccessException) {
            otherwise()
        } catch (gone: IllegalStateException) {
            otherwise()
        } catch (abandoned: IllegalArgumentException) {
            otherwise()
        }
    }

    /** Ends the camera, and returns when it has let go of its surfaces; pictures handed out stay valid until closed. */
    fun close() {
        handler.post {
            closed = true
            missed()
            quietly { session?.close() }
            // One that is being opened is closed as soon as it is.
            val open = device
            if (open != null) open.close() else if (!opening) ended.countDown()
            giveBack()
        }
        // The thread has to hear of the end.
        ended.await(CLOSE_MS, TimeUnit.MILLISECONDS)
        thread.quitSafely()
    }

    private companion object {
        val LINEAR = floatArrayOf(0f, 0f, 1f, 1f)

        /** Longest wait for a lock, a photo, the end of the camera. */
        const val PATIENCE_MS = 3000L
        const val SHOT_MS = 3000L
        const val CLOSE_MS = 2000L

        /** Pictures without the lamp after which it counts as out: those on their way when the settings changed do not. */
        const val DARK_PICTURES = 10

        /** Pictures of the preview held while their results are awaited. */
        const val HELD = 2
    }
}
