package org.svbrdf.example

import android.annotation.SuppressLint
import android.app.Activity
import android.content.Context
import android.graphics.ImageFormat
import android.hardware.camera2.CameraAccessException
import android.hardware.camera2.CameraCaptureSession
import android.hardware.camera2.CameraCharacteristics
import android.hardware.camera2.CameraDevice
import android.hardware.camera2.CameraManager
import android.hardware.camera2.CameraMetadata
import android.hardware.camera2.CaptureFailure
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
import android.util.Size
import android.view.Surface
import android.view.SurfaceHolder
import java.util.concurrent.atomic.AtomicInteger
import kotlin.math.abs
import kotlin.math.max
import kotlin.math.min
import kotlin.math.pow
import kotlin.math.roundToInt
import kotlin.math.roundToLong
import org.svbrdf.scanner.Camera

/**
 * A camera for measuring: lamp always on, linear tone curve, exposure, sensitivity, focus and white
 * balance fixed once [lock]ed. Its listener is called on the camera's own thread.
 */
class FlashCamera(context: Context, raw: Boolean, private val listener: Listener) {
    interface Listener {
        /** A photo and what the camera says about it; the receiver closes it. */
        fun onShot(shot: Shot)

        fun onLost()
    }

    /** A photo with its settings. The camera's memory is kept until it is closed. */
    class Shot(val image: Image, val result: TotalCaptureResult, val camera: FlashCamera) :
        AutoCloseable {
        override fun close() {
            image.close()
            camera.giveBack()
        }
    }

    /** What every photo is taken with. */
    private class Settings(
        val exposureNs: Long,
        val sensitivity: Int,
        val focus: Float,
        val gains: RggbChannelVector,
        val transform: ColorSpaceTransform,
    )

    private val manager = context.getSystemService(Context.CAMERA_SERVICE) as CameraManager
    private val id: String
    val characteristics: CameraCharacteristics

    /** Size of the photos. */
    val size: Size

    /** Size of the preview: the same shape. */
    val previewSize: Size
    private val format: Int

    private val thread = HandlerThread("camera").apply { start() }
    private val handler = Handler(thread.looper)
    private val reader: ImageReader
    private var device: CameraDevice? = null
    private var session: CameraCaptureSession? = null
    private var preview: Surface? = null
    private var closed = false

    // Written by one thread each, read by others.
    @Volatile private var latest: TotalCaptureResult? = null
    @Volatile private var locked: Settings? = null
    @Volatile private var stops = 0f
    @Volatile private var focusShift = 0f

    // Of the camera's thread.
    private val images = HashMap<Long, Image>()
    private val results = HashMap<Long, TotalCaptureResult>()

    /** Photos not closed yet, and one for the open camera. */
    private val lent = AtomicInteger(1)

    /** Photos lie in the reader's memory: it goes last. */
    private fun giveBack() {
        if (lent.decrementAndGet() == 0) {
            reader.close()
        }
    }

    init {
        val candidates = manager.cameraIdList.map { it to manager.getCameraCharacteristics(it) }
        val (chosen, found) = candidates.firstOrNull { measures(it.second) }
            ?: throw NoSuchElementException("no camera with a lamp and manual exposure")
        id = chosen
        characteristics = found
        format = if (raw && has(found, RAW)) ImageFormat.RAW_SENSOR else ImageFormat.YUV_420_888
        val sizes = found[CameraCharacteristics.SCALER_STREAM_CONFIGURATION_MAP]!!
        size = when (format) {
            ImageFormat.RAW_SENSOR -> sizes.getOutputSizes(format).maxBy { it.width }
            // Three megapixels of four by three: enough for 1024 texels, quick to calibrate.
            else -> sizes.getOutputSizes(format).minBy {
                abs(it.width - 2016) + 4 * abs(it.height - 0.75 * it.width)
            }
        }
        previewSize = sizes.getOutputSizes(SurfaceHolder::class.java)
            .filter { it.width <= 1440 }
            .minBy { abs(it.width - 1280) + 4 * abs(it.height - shape() * it.width) }
        reader = ImageReader.newInstance(size.width, size.height, format, 3)
        reader.setOnImageAvailableListener({ source ->
            source.acquireNextImage()?.let { image ->
                images[image.timestamp] = image
                pair(image.timestamp)
            }
        }, handler)
    }

    private fun shape() = size.height.toDouble() / size.width

    /** Clockwise turn from the sensor's picture to how the screen shows it. */
    fun turn(activity: Activity): Int {
        val upright = characteristics[CameraCharacteristics.SENSOR_ORIENTATION] ?: 90
        // The screen turns against the phone. Rotations count its quarters.
        return (upright - 90 * activity.windowManager.defaultDisplay.rotation).mod(360)
    }

    /** Height over width of the preview as the screen shows it. */
    fun uprightShape(activity: Activity): Float {
        val (width, height) = previewSize.width.toFloat() to previewSize.height.toFloat()
        return if (turn(activity) % 180 != 0) width / height else height / width
    }

    /**
     * Intrinsics of the photos where the maker states them, else null: the library estimates them
     * from the photos.
     */
    fun intrinsics(): Camera? {
        val stated = characteristics[CameraCharacteristics.LENS_INTRINSIC_CALIBRATION]
        val array = characteristics[CameraCharacteristics.SENSOR_INFO_PRE_CORRECTION_ACTIVE_ARRAY_SIZE]
        if (stated == null || array == null || stated.size < 4 || stated[0] <= 0f) {
            return null
        }
        // Photos show the largest centred part of the array that has their shape.
        val scale = max(
            size.width.toDouble() / array.width(), size.height.toDouble() / array.height(),
        )
        val left = 0.5 * (array.width() - size.width / scale)
        val top = 0.5 * (array.height() - size.height / scale)
        // Android counts from the corner of the first pixel, the library from its centre.
        return Camera(
            size.width, size.height, stated[0] * scale, stated[1] * scale,
            (stated[2] - left) * scale - 0.5, (stated[3] - top) * scale - 0.5,
        )
    }

    /** Opens the camera; the permission has been granted. */
    @SuppressLint("MissingPermission")
    fun open(surface: Surface) {
        if (preview != null) {
            return
        }
        preview = surface
        manager.openCamera(id, object : CameraDevice.StateCallback() {
            override fun onOpened(camera: CameraDevice) {
                if (closed) {
                    camera.close()
                    return
                }
                device = camera
                configure(camera, surface)
            }

            override fun onDisconnected(camera: CameraDevice) = lost(camera)

            override fun onError(camera: CameraDevice, error: Int) = lost(camera)
        }, handler)
    }

    private fun lost(camera: CameraDevice) {
        session = null
        device = null
        camera.close()
        if (!closed) {
            listener.onLost()
        }
    }

    @Suppress("DEPRECATION") // What replaces it came with API 28.
    private fun configure(camera: CameraDevice, surface: Surface) {
        val targets = listOf(surface, reader.surface)
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
        fill(request)
        session.setRepeatingRequest(request.build(), object : CameraCaptureSession.CaptureCallback() {
            override fun onCaptureCompleted(
                from: CameraCaptureSession,
                request: CaptureRequest,
                result: TotalCaptureResult,
            ) {
                latest = result
            }
        }, handler)
    }

    private fun fill(request: CaptureRequest.Builder) {
        request[CaptureRequest.FLASH_MODE] = CameraMetadata.FLASH_MODE_TORCH
        val settings = locked
        if (settings == null) {
            request[CaptureRequest.CONTROL_AE_MODE] = CameraMetadata.CONTROL_AE_MODE_ON
            request[CaptureRequest.CONTROL_AF_MODE] =
                CameraMetadata.CONTROL_AF_MODE_CONTINUOUS_PICTURE
            request[CaptureRequest.CONTROL_AWB_MODE] = CameraMetadata.CONTROL_AWB_MODE_AUTO
            return
        }
        request[CaptureRequest.CONTROL_AE_MODE] = CameraMetadata.CONTROL_AE_MODE_OFF
        request[CaptureRequest.CONTROL_AF_MODE] = CameraMetadata.CONTROL_AF_MODE_OFF
        request[CaptureRequest.CONTROL_AWB_MODE] = CameraMetadata.CONTROL_AWB_MODE_OFF
        val times = characteristics[CameraCharacteristics.SENSOR_INFO_EXPOSURE_TIME_RANGE]!!
        // Short enough for the hand.
        val longest = min(times.upper, 33_000_000L)
        val exposure = (settings.exposureNs * 2f.pow(stops).toDouble()).roundToLong()
        request[CaptureRequest.SENSOR_EXPOSURE_TIME] =
            exposure.coerceIn(times.lower, max(times.lower, longest))
        request[CaptureRequest.SENSOR_SENSITIVITY] = settings.sensitivity
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

    /** Fixes exposure, focus and white balance as they are now; false while still measuring. */
    fun lock(): Boolean {
        val result = latest ?: return false
        val exposed = result[CaptureResult.CONTROL_AE_STATE]
        if (exposed == CameraMetadata.CONTROL_AE_STATE_SEARCHING) {
            return false
        }
        locked = Settings(
            result[CaptureResult.SENSOR_EXPOSURE_TIME] ?: return false,
            result[CaptureResult.SENSOR_SENSITIVITY] ?: return false,
            result[CaptureResult.LENS_FOCUS_DISTANCE] ?: 0f,
            result[CaptureResult.COLOR_CORRECTION_GAINS] ?: return false,
            result[CaptureResult.COLOR_CORRECTION_TRANSFORM] ?: return false,
        )
        // Highlights need room above what automatic exposure aims at.
        stops = -1f
        focusShift = 0f
        handler.post { repeat() }
        return true
    }

    /** Back to automatic exposure. */
    fun unlock() {
        locked = null
        handler.post { repeat() }
    }

    /** Exposure in stops and focus in dioptres relative to what was locked. */
    fun adjust(stops: Float, focusShift: Float) {
        this.stops = stops - 1f
        this.focusShift = focusShift
        handler.post { repeat() }
    }

    /** Takes a photo; it comes to [Listener.onShot]. */
    fun shoot(failed: () -> Unit) = handler.post {
        quietly(failed) {
            val session = session ?: throw CameraAccessException(CameraAccessException.CAMERA_DISCONNECTED)
            val request = session.device.createCaptureRequest(CameraDevice.TEMPLATE_STILL_CAPTURE)
            request.addTarget(reader.surface)
            fill(request)
            session.capture(request.build(), object : CameraCaptureSession.CaptureCallback() {
                override fun onCaptureCompleted(
                    from: CameraCaptureSession,
                    request: CaptureRequest,
                    result: TotalCaptureResult,
                ) {
                    val time = result[CaptureResult.SENSOR_TIMESTAMP]!!
                    results[time] = result
                    pair(time)
                }

                override fun onCaptureFailed(
                    from: CameraCaptureSession,
                    request: CaptureRequest,
                    failure: CaptureFailure,
                ) = failed()
            }, handler)
        }
    }

    /** An image and its result come in any order. */
    private fun pair(time: Long) {
        val image = images[time] ?: return
        val result = results.remove(time) ?: return
        images.remove(time)
        if (closed) {
            image.close()
        } else {
            lent.incrementAndGet()
            listener.onShot(Shot(image, result, this))
        }
    }

    /** The camera may vanish between any two lines; [Listener.onLost] or `otherwise` says so. */
    private fun quietly(otherwise: () -> Unit = {}, body: () -> Unit) {
        try {
            body()
        } catch (gone: CameraAccessException) {
            otherwise()
        } catch (gone: IllegalStateException) {
            otherwise()
        }
    }

    /** Ends the camera; photos handed out stay valid until closed. */
    fun close() {
        handler.post {
            closed = true
            session?.close()
            device?.close()
            images.values.forEach { it.close() }
            images.clear()
            giveBack()
        }
        thread.quitSafely()
    }

    private companion object {
        const val RAW = CameraMetadata.REQUEST_AVAILABLE_CAPABILITIES_RAW
        const val SENSOR = CameraMetadata.REQUEST_AVAILABLE_CAPABILITIES_MANUAL_SENSOR
        const val PROCESSING = CameraMetadata.REQUEST_AVAILABLE_CAPABILITIES_MANUAL_POST_PROCESSING
        val LINEAR = floatArrayOf(0f, 0f, 1f, 1f)

        fun has(camera: CameraCharacteristics, capability: Int): Boolean =
            camera[CameraCharacteristics.REQUEST_AVAILABLE_CAPABILITIES]
                ?.contains(capability) == true

        /** Whether a camera can measure. */
        fun measures(camera: CameraCharacteristics): Boolean {
            val curves = camera[CameraCharacteristics.TONEMAP_AVAILABLE_TONE_MAP_MODES]
            return camera[CameraCharacteristics.LENS_FACING] ==
                CameraMetadata.LENS_FACING_BACK &&
                camera[CameraCharacteristics.FLASH_INFO_AVAILABLE] == true &&
                has(camera, SENSOR) && has(camera, PROCESSING) &&
                curves?.contains(CameraMetadata.TONEMAP_MODE_CONTRAST_CURVE) == true
        }
    }
}

/** A photo's exposure: time times sensitivity. */
fun TotalCaptureResult.exposure(): Double {
    val time = get(CaptureResult.SENSOR_EXPOSURE_TIME) ?: 1L
    return time.toDouble() * (get(CaptureResult.SENSOR_SENSITIVITY) ?: 100)
}

/** A share in percent, for people. */
fun percent(share: Float): Int = (100 * share).roundToInt()
