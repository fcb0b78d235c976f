package org.svbrdf.scanner

import java.nio.ByteBuffer
import java.nio.ByteOrder

/**
 * A plane of an image: the contents of [buffer] from its position to its limit. Direct buffers, such as
 * those of Android's `Image`, are read in place, others copied first. The position stays.
 */
class Plane @JvmOverloads constructor(
    val buffer: ByteBuffer,
    /** Bytes from a row to the next. */
    val rowStride: Int,
    /** Bytes from a pixel to the next; 0: no gap. */
    val pixelStride: Int = 0,
)

/** Description of raw sensor values. */
class Bayer @JvmOverloads constructor(
    val pattern: BayerPattern,
    /** Value of darkness at the four places of the pattern, row by row. */
    val blackLevel: FloatArray,
    /** Value of full scale. */
    val whiteLevel: Float,
    /** Gains of R, G and B that make neutral gray neutral. */
    val whiteBalance: FloatArray = floatArrayOf(1f, 1f, 1f),
    /** From white-balanced sensor colours to linear Rec. 709, row by row. */
    val colorMatrix: FloatArray = floatArrayOf(1f, 0f, 0f, 0f, 1f, 0f, 0f, 0f, 1f),
)

/** An image in memory. The contents of [planes] must not change during the call it is given to. */
class Photo @JvmOverloads constructor(
    val format: PixelFormat,
    val width: Int,
    val height: Int,
    /** Three for [PixelFormat.YUV420] and [PixelFormat.P010], otherwise one. */
    val planes: List<Plane>,
    /** Curve of 8- and 16-bit RGB and of YUV. */
    val transfer: Transfer = Transfer.SRGB,
    /** How far it is turned clockwise before use; the camera describes the turned image. */
    val rotation: Int = 0,
    val yuvMatrix: YuvMatrix = YuvMatrix.BT601_FULL,
    /** For floats: the level at which a channel is clipped. */
    val saturation: Float = Float.POSITIVE_INFINITY,
    /** For [PixelFormat.BAYER16]. */
    val bayer: Bayer? = null,
    /** Of all formats but [PixelFormat.BAYER16]. */
    val primaries: Primaries = Primaries.REC709,
) {
    internal fun addTo(
        scanner: MaterialScanner,
        handle: Long,
        info: PhotoInfo,
        cameraMm: FloatArray?,
        lightMm: FloatArray?,
    ): Outcome {
        val photo = numbers()
        val dark = info.ambient?.numbers()
        val report = DoubleArray(Outcome.SIZE)
        val advice = Native.sessionAddPhoto(
            scanner, handle, photo.ints, photo.buffers, photo.layout, photo.levels, info.exposure,
            info.flash.code, info.timestampNs, cameraMm, lightMm, dark?.ints, dark?.buffers,
            dark?.layout, dark?.levels, info.ambientExposure, info.focal35mm, report,
        )
        return Outcome.of(report, String(advice, Charsets.UTF_8), info.timestampNs)
    }

    internal fun addToAsync(
        scanner: MaterialScanner,
        handle: Long,
        info: PhotoInfo,
        done: MaterialScanner.OutcomeCallback,
    ) {
        val photo = numbers()
        val dark = info.ambient?.numbers()
        Native.await(info.timestampNs, done) { id ->
            Native.sessionAddPhotoAsync(
                scanner, handle, photo.ints, photo.buffers, photo.layout, photo.levels,
                info.exposure, info.flash.code, info.timestampNs, dark?.ints, dark?.buffers,
                dark?.layout, dark?.levels, info.ambientExposure, info.focal35mm, id,
            )
        }
    }

    internal fun probe(scanner: MaterialScanner, handle: Long, info: PhotoInfo): Probe {
        val photo = numbers()
        val corners = FloatArray(2 * Probe.CORNERS)
        val values = DoubleArray(Probe.SIZE)
        val advice = Native.sessionProbe(
            scanner, handle, photo.ints, photo.buffers, photo.layout, photo.levels, info.exposure,
            info.flash.code, info.focal35mm, corners, values,
        )
        return Probe.of(values, corners, String(advice, Charsets.UTF_8), info.timestampNs)
    }

    internal fun guide(scanner: MaterialScanner, handle: Long, info: PhotoInfo): Guidance {
        val photo = numbers()
        val corners = FloatArray(2 * Probe.CORNERS)
        val values = DoubleArray(Probe.SIZE + Guidance.SIZE)
        val (advice, message) = Native.sessionGuide(
            scanner, handle, photo.ints, photo.buffers, photo.layout, photo.levels, info.exposure,
            info.flash.code, info.focal35mm, info.timestampNs, corners, values,
        ).map { String(it, Charsets.UTF_8) }
        val probe = Probe.of(values, corners, advice, info.timestampNs)
        return Guidance.of(values, Probe.SIZE, message, probe)
    }

    /** The fields as the library takes them. */
    private class Numbers(
        val ints: IntArray,
        val buffers: Array<ByteBuffer>,
        val layout: LongArray,
        val levels: FloatArray,
    )

    private fun numbers(): Numbers {
        require(planes.size in 1..3) { "Photo.planes: one or three planes expected" }
        val ints = intArrayOf(
            format.code, width, height, transfer.code, rotation, yuvMatrix.code,
            (bayer?.pattern ?: BayerPattern.RGGB).code, primaries.code,
        )
        val buffers = Array(planes.size) { direct(planes[it].buffer) }
        val layout = LongArray(4 * planes.size)
        for ((i, plane) in planes.withIndex()) {
            require(plane.rowStride >= 0 && plane.pixelStride >= 0) { "Plane: a negative stride" }
            layout[4 * i] = buffers[i].position().toLong()
            layout[4 * i + 1] = buffers[i].remaining().toLong()
            layout[4 * i + 2] = plane.rowStride.toLong()
            layout[4 * i + 3] = plane.pixelStride.toLong()
        }
        return Numbers(ints, buffers, layout, levels())
    }

    private fun levels(): FloatArray {
        if (bayer == null) {
            require(format != PixelFormat.BAYER16) { "Photo.bayer: missing" }
        }
        val b = bayer ?: NO_BAYER
        require(b.blackLevel.size == 4) { "Bayer.blackLevel: four numbers expected" }
        require(b.whiteBalance.size == 3) { "Bayer.whiteBalance: three numbers expected" }
        require(b.colorMatrix.size == 9) { "Bayer.colorMatrix: nine numbers expected" }
        return floatArrayOf(saturation) + b.blackLevel + b.whiteLevel + b.whiteBalance +
            b.colorMatrix
    }

    companion object {
        private val NO_BAYER = Bayer(BayerPattern.RGGB, FloatArray(4), 65535f)

        /** Interleaved pixels without gaps. */
        @JvmStatic
        @JvmOverloads
        fun packed(
            format: PixelFormat,
            pixels: ByteBuffer,
            width: Int,
            height: Int,
            transfer: Transfer = Transfer.SRGB,
        ): Photo {
            val bytes = when (format) {
                PixelFormat.RGB8 -> 3
                PixelFormat.RGBA8, PixelFormat.BGRA8 -> 4
                PixelFormat.RGB16 -> 6
                PixelFormat.RGBA16, PixelFormat.RGBA_F16 -> 8
                PixelFormat.RGB_F32 -> 12
                PixelFormat.RGBA_F32 -> 16
                else -> throw IllegalArgumentException("format: $format is not interleaved RGB")
            }
            // A row too long for an Int is too long for any buffer.
            val stride = minOf(bytes * width.toLong(), Int.MAX_VALUE.toLong()).toInt()
            return Photo(format, width, height, listOf(Plane(pixels, stride)), transfer)
        }

        internal fun direct(buffer: ByteBuffer): ByteBuffer {
            if (buffer.isDirect) {
                return buffer
            }
            val copy = ByteBuffer.allocateDirect(buffer.remaining()).order(ByteOrder.nativeOrder())
            copy.put(buffer.duplicate())
            copy.rewind()
            return copy
        }
    }
}

/** Metadata of a photo. */
data class PhotoInfo @JvmOverloads constructor(
    /** Exposure time times sensitivity over that of the first photo (with a torch). */
    val exposure: Float = 1f,
    val flash: Flash = Flash.UNKNOWN,
    /** Handed back with the result. */
    val timestampNs: Long = 0,
    /**
     * The same view without flash, which is subtracted in linear light: same size, camera unmoved.
     */
    val ambient: Photo? = null,
    /** Its exposure on the scale of [exposure]; 0: the photo's. */
    val ambientExposure: Float = 0f,
    /** Focal length as for 35 mm film, mm, for a camera that is estimated; 0: not known. */
    val focal35mm: Float = 0f,
)
