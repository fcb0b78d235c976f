package org.svbrdf.scanner

import java.nio.ByteBuffer

/**
 * A photo as a file in memory (JPEG, PNG, TIFF, OpenEXR or DNG): [content] from its position to its
 * limit. Direct buffers are read in place, others copied first. The position stays.
 */
class PhotoFile @JvmOverloads constructor(
    val content: ByteBuffer,
    /** Relative exposure; 0: that of the metadata. */
    val exposure: Float = 0f,
    /** Curve of the values; null: that of the file. */
    val transfer: Transfer? = null,
    /** How far the upright image is turned clockwise; the camera describes the turned image. */
    val rotation: Int = 0,
    val flash: Flash = Flash.UNKNOWN,
    /** Returned with the outcome of the photo. */
    val timestampNs: Long = 0,
    /** Largest image, pixels; 0: 100 million. */
    val maxPixels: Long = 0,
    /** Most memory that decoding may take, bytes; 0: 6 GiB. */
    val maxBytes: Long = 0,
) {
    constructor(content: ByteArray) : this(ByteBuffer.wrap(content))

    /** The metadata of the file, without reading its pixels. */
    fun lookAt(): FileInfo {
        val file = Photo.direct(content)
        val (values, names) = FileInfo.empty()
        Native.fileLookAt(
            file, file.position().toLong(), file.remaining().toLong(), values, names,
        )
        return FileInfo.of(values, names)
    }

    internal fun addTo(scanner: MaterialScanner, handle: Long): PhotoFileOutcome {
        val file = Photo.direct(content)
        val (values, names) = FileInfo.empty()
        val report = DoubleArray(Outcome.SIZE)
        val advice = Native.sessionAddPhotoFile(
            scanner, handle, file, file.position().toLong(), file.remaining().toLong(), exposure,
            transfer?.code ?: 0, rotation, flash.code, timestampNs, maxPixels, maxBytes, values,
            names, report,
        )
        val outcome = Outcome.of(report, String(advice, Charsets.UTF_8), timestampNs)
        return PhotoFileOutcome(outcome, FileInfo.of(values, names))
    }
}

/** The outcome of a photo, and the metadata of its file. */
data class PhotoFileOutcome(val outcome: Outcome, val info: FileInfo)

/** Remarks about a photo's file. */
enum class FileRemark(internal val bit: Int) {
    /** Its colour metadata cannot be used; it was read as sRGB. */
    PROFILE_UNUSABLE(1),
    /** It has a gain map (Ultra HDR), which is left out. */
    GAIN_MAP(2),
    /** Its orientation tag mirrors it. */
    MIRRORED(4),
    /** It does not say how it was exposed. */
    NO_EXPOSURE(8),
    /** It says that the flash did not fire. */
    NO_FLASH(16),
    /** Its end marker is missing, and nothing else. */
    END_MISSING(32),
    /** It is gray, and so will the maps be. */
    GRAY(64),
}

/**
 * Metadata of a photo's file. Photos that differ in maker, model, lens, focal
 * lengths, zoom or size need scanners of their own.
 */
data class FileInfo(
    /** As the sensor has it, px; 0: not known. */
    val width: Int,
    val height: Int,
    /** How far the stored image is turned clockwise to stand upright, degrees. */
    val uprightDeg: Int,
    /** Floats or raw values. */
    val isLinear: Boolean,
    /** Exposure time * ISO / F-number², relative; 0: not known. */
    val exposure: Float,
    /** Focal length of the lens, mm; 0: not known. */
    val focalMm: Float,
    /** The same on film of 36 x 24 mm. */
    val focal35mm: Float,
    /** 1: none, or not known. */
    val digitalZoom: Float,
    val remarks: Set<FileRemark>,
    /** Empty: not known, as with all texts. */
    val make: String,
    val model: String,
    val lens: String,
    /** Digits whose order, as text, is that of time. */
    val taken: String,
) {
    internal companion object {
        private const val SIZE = 9
        private const val NAMES = 4

        fun empty() = Pair(DoubleArray(SIZE), arrayOfNulls<ByteArray>(NAMES))

        fun of(v: DoubleArray, names: Array<ByteArray?>): FileInfo {
            val text = { i: Int -> String(names[i] ?: ByteArray(0), Charsets.UTF_8) }
            val remarks = FileRemark.values().filter { v[8].toInt() and it.bit != 0 }.toSet()
            return FileInfo(
                v[0].toInt(), v[1].toInt(), v[2].toInt(), v[3] == 1.0, v[4].toFloat(),
                v[5].toFloat(), v[6].toFloat(), v[7].toFloat(), remarks, text(0), text(1), text(2),
                text(3),
            )
        }
    }
}
