package org.svbrdf.example

import android.app.Activity
import android.graphics.ImageFormat
import android.hardware.camera2.CameraCharacteristics
import android.hardware.camera2.CameraManager
import android.hardware.camera2.CameraMetadata
import android.hardware.camera2.CaptureRequest
import android.hardware.camera2.CaptureResult
import android.hardware.camera2.TotalCaptureResult
import android.util.Size
import android.view.SurfaceHolder
import kotlin.math.abs
import kotlin.math.hypot
import kotlin.math.max
import org.svbrdf.scanner.Camera

/** A camera of the phone, with the sizes of its pictures. */
class CameraChoice private constructor(
    val id: String,
    val characteristics: CameraCharacteristics,
    /**
     * Whether exposure, focus and tone curve can be fixed. Otherwise automatic values are locked, and the library
     * undoes the tone curve by the board's grays.
     */
    val isManual: Boolean,
    raw: Boolean,
) {
    val format =
        if (raw && isManual && has(characteristics, RAW)) ImageFormat.RAW_SENSOR else ImageFormat.YUV_420_888

    /** Size of the photos. */
    val size: Size

    /** Size of the pictures that guidance looks at; those of the photos where one stream is for both. */
    val lookSize: Size

    /** Size of the preview: the same shape. */
    val previewSize: Size

    /**
     * Strength of the lamp that every picture is taken with: the maker's usual one, but none of the topmost quarter, where
     * lamps are likely to grow hot and to be dimmed. Null: the phone gives no choice to an open camera (before Android 15).
     */
    val torchLevel: Int? = named<Int>(characteristics, "android.flash.torchStrengthMaxLevel")?.takeIf { it > 1 }?.let {
        val usual = named<Int>(characteristics, "android.flash.torchStrengthDefaultLevel") ?: it
        usual.coerceIn(1, max(1, 3 * it / 4))
    }

    init {
        val sizes = characteristics[CameraCharacteristics.SCALER_STREAM_CONFIGURATION_MAP]!!
        val yuv = sizes.getOutputSizes(ImageFormat.YUV_420_888)
        size = when {
            format == ImageFormat.RAW_SENSOR -> sizes.getOutputSizes(format).maxBy { it.width }
            // Three megapixels of four by three: enough for 1024 texels, quick to calibrate.
            isManual -> yuv.nearest(2016, 0.75)
            // Every camera supports this size beside a preview.
            else -> yuv.filter { it.width <= 1920 && it.height <= 1080 }.nearest(1440, 0.75)
        }
        // 640 x 480 goes with any size of photos on cameras with manual settings.
        lookSize = if (isManual) yuv.toList().nearest(640, 0.75) else size
        previewSize = sizes.getOutputSizes(SurfaceHolder::class.java)
            .filter { it.width <= 1440 }.nearest(1280, size.height.toDouble() / size.width)
    }

    /** Clockwise turn from the sensor's picture to how the screen shows it. */
    @Suppress("DEPRECATION") // Its replacement came with API 30.
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
     * Intrinsics and distortion of the photos where the maker states both and they are plausible, else null: the
     * library estimates them from the photos.
     */
    fun intrinsics(): Camera? {
        val stated = characteristics[CameraCharacteristics.LENS_INTRINSIC_CALIBRATION]
        val array = characteristics[CameraCharacteristics.SENSOR_INFO_PRE_CORRECTION_ACTIVE_ARRAY_SIZE]
        // Android: k1, k2, k3, p1, p2.
        val lens = named<FloatArray>(characteristics, "android.lens.distortion")
        val expected = focalMm()?.let { focal -> sensorMm()?.let { focal / it.first } }
        if (stated == null || stated.size < 4 || array == null || lens == null || lens.size < 5) {
            return null
        }
        if (expected == null || stated[0] / array.width() !in 0.7f * expected..1.4f * expected) {
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
            lens[0].toDouble(), lens[1].toDouble(), lens[3].toDouble(), lens[4].toDouble(),
            lens[2].toDouble(),
        )
    }

    /** Focal length as for 35 mm film, mm, to begin an estimate with; 0: not known. */
    fun focal35Mm(): Float {
        val (width, height) = sensorMm() ?: return 0f
        return (focalMm() ?: return 0f) * FILM_DIAGONAL_MM / hypot(width, height)
    }

    private fun focalMm() =
        characteristics[CameraCharacteristics.LENS_INFO_AVAILABLE_FOCAL_LENGTHS]?.firstOrNull()

    private fun sensorMm() = characteristics[CameraCharacteristics.SENSOR_INFO_PHYSICAL_SIZE]
        ?.let { it.width to it.height }?.takeIf { it.first > 0f && it.second > 0f }

    /** A key that this phone's Android knows, though the one that the app was compiled for may not. */
    @Suppress("UNCHECKED_CAST")
    fun <T> requestKey(name: String): CaptureRequest.Key<T>? = characteristics
        .availableCaptureRequestKeys.firstOrNull { it.name == name } as CaptureRequest.Key<T>?

    companion object {
        private const val RAW = CameraMetadata.REQUEST_AVAILABLE_CAPABILITIES_RAW
        private const val SENSOR = CameraMetadata.REQUEST_AVAILABLE_CAPABILITIES_MANUAL_SENSOR
        private const val PROCESSING =
            CameraMetadata.REQUEST_AVAILABLE_CAPABILITIES_MANUAL_POST_PROCESSING
        private const val FILM_DIAGONAL_MM = 43.27f

        /** The first camera that can measure, or else the first one with a lamp; null: there is none. */
        fun of(manager: CameraManager, raw: Boolean): CameraChoice? {
            val lit = manager.cameraIdList.map { it to manager.getCameraCharacteristics(it) }.filter {
                it.second[CameraCharacteristics.LENS_FACING] == CameraMetadata.LENS_FACING_BACK &&
                    it.second[CameraCharacteristics.FLASH_INFO_AVAILABLE] == true
            }
            val (id, found) = lit.firstOrNull { measures(it.second) } ?: lit.firstOrNull() ?: return null
            return CameraChoice(id, found, measures(found), raw)
        }

        private fun Array<Size>.nearest(width: Int, shape: Double) = toList().nearest(width, shape)

        private fun List<Size>.nearest(width: Int, shape: Double) =
            minBy { abs(it.width - width) + 4 * abs(it.height - shape * it.width) }

        private fun has(camera: CameraCharacteristics, capability: Int): Boolean =
            camera[CameraCharacteristics.REQUEST_AVAILABLE_CAPABILITIES]?.contains(capability) == true

        private fun measures(camera: CameraCharacteristics): Boolean {
            val curves = camera[CameraCharacteristics.TONEMAP_AVAILABLE_TONE_MAP_MODES]
            return has(camera, SENSOR) && has(camera, PROCESSING) &&
                curves?.contains(CameraMetadata.TONEMAP_MODE_CONTRAST_CURVE) == true
        }

        @Suppress("UNCHECKED_CAST")
        private fun <T> named(camera: CameraCharacteristics, name: String): T? =
            camera.keys.firstOrNull { it.name == name }?.let { camera.get(it) as T? }
    }
}

/** Strength of the lamp, from 1 on. */
const val TORCH_LEVEL = "android.flash.strengthLevel"

/** Strength of the lamp in a photo; null where the phone does not tell it (before Android 15). */
fun TotalCaptureResult.torchLevel(): Int? = keys.firstOrNull { it.name == TORCH_LEVEL }?.let { get(it) as Int? }

fun TotalCaptureResult.isLampOn() = get(CaptureResult.FLASH_STATE) == CaptureResult.FLASH_STATE_FIRED

/** Sensitivity that is added behind the sensor, percent. Raw values do not have it. */
const val BOOST = "android.control.postRawSensitivityBoost"

/**
 * A photo's exposure: time times sensitivity; null where the camera does not tell. `raw`: of values from before the
 * camera's own amplification.
 */
fun TotalCaptureResult.exposure(raw: Boolean): Double? {
    val time = get(CaptureResult.SENSOR_EXPOSURE_TIME) ?: return null
    val sensitivity = get(CaptureResult.SENSOR_SENSITIVITY) ?: return null
    return time.toDouble() * sensitivity * if (raw) 1.0 else boost() / 100.0
}

/** Percent; 100 where the phone knows no other. */
fun TotalCaptureResult.boost(): Int =
    keys.firstOrNull { it.name == BOOST }?.let { get(it) as Int? } ?: 100
