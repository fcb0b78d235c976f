package org.svbrdf.example

import android.graphics.ImageFormat
import android.hardware.camera2.CameraCharacteristics
import android.hardware.camera2.CameraMetadata
import android.hardware.camera2.CaptureResult
import android.util.Rational
import org.svbrdf.scanner.Bayer
import org.svbrdf.scanner.BayerPattern
import org.svbrdf.scanner.Photo
import org.svbrdf.scanner.PixelFormat
import org.svbrdf.scanner.Plane
import org.svbrdf.scanner.Transfer

private fun FlashCamera.Look.planes() =
    image.planes.map { Plane(it.buffer, it.rowStride, it.pixelStride) }

/** Whether the camera has made colours of the sensor's values. */
val FlashCamera.Look.isYuv get() = image.format != ImageFormat.RAW_SENSOR

/** The picture where it lies, in the camera's memory: valid until the image is closed. */
fun FlashCamera.Look.photo(): Photo {
    // A tone curve that cannot be turned off is close to sRGB's; the library estimates the difference.
    val transfer = if (isLinear) Transfer.LINEAR else Transfer.SRGB
    return Photo(PixelFormat.YUV420, image.width, image.height, planes(), transfer)
}

/** The photo where it lies, the same. */
fun FlashCamera.Shot.photo(): Photo {
    if (isYuv) {
        return (this as FlashCamera.Look).photo()
    }
    return Photo(
        PixelFormat.BAYER16, image.width, image.height, planes(), Transfer.LINEAR, bayer = bayer(),
    )
}

private fun FlashCamera.Shot.bayer(): Bayer {
    val characteristics = camera.choice.characteristics
    val pattern = when (characteristics[CameraCharacteristics.SENSOR_INFO_COLOR_FILTER_ARRANGEMENT]) {
        CameraMetadata.SENSOR_INFO_COLOR_FILTER_ARRANGEMENT_GRBG -> BayerPattern.GRBG
        CameraMetadata.SENSOR_INFO_COLOR_FILTER_ARRANGEMENT_GBRG -> BayerPattern.GBRG
        CameraMetadata.SENSOR_INFO_COLOR_FILTER_ARRANGEMENT_BGGR -> BayerPattern.BGGR
        else -> BayerPattern.RGGB
    }
    val black = characteristics[CameraCharacteristics.SENSOR_BLACK_LEVEL_PATTERN]
    val levels = FloatArray(4) { (black?.getOffsetForIndex(it % 2, it / 2) ?: 0).toFloat() }
    val white = characteristics[CameraCharacteristics.SENSOR_INFO_WHITE_LEVEL] ?: 1023
    val gains = result[CaptureResult.COLOR_CORRECTION_GAINS]
    val balance = when (gains) {
        null -> floatArrayOf(1f, 1f, 1f)
        else -> floatArrayOf(gains.red, 0.5f * (gains.greenEven + gains.greenOdd), gains.blue)
    }
    val transform = result[CaptureResult.COLOR_CORRECTION_TRANSFORM]
    val matrix = FloatArray(9) { if (it % 4 == 0) 1f else 0f }
    if (transform != null) {
        // Android's matrix leads to linear sRGB, which has Rec. 709's colours.
        val elements = arrayOfNulls<Rational>(9)
        transform.copyElements(elements, 0)
        elements.forEachIndexed { i, element -> matrix[i] = element!!.toFloat() }
    }
    return Bayer(pattern, levels, white.toFloat(), balance, matrix)
}
