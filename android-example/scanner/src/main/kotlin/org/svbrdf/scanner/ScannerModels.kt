package org.svbrdf.scanner

import java.io.File
import java.nio.ByteBuffer

/**
 * Networks that any number of scanners may share, for native libraries built without them. May be
 * closed while scanners use them.
 */
class ScannerModels private constructor(models: Long) : AutoCloseable {
    private val handle = Handle(this, models, Native::modelsDestroy)

    internal fun open(): Long = handle.now.also { check(it != 0L) { "models: closed" } }

    override fun close() = handle.close()

    companion object {
        /** From the contents of the files of the folder `models`, e.g. of assets. */
        @JvmStatic
        fun fromBytes(
            decoder: ByteArray,
            encoder: ByteArray,
            photo: ByteArray,
            completion: ByteArray,
        ): ScannerModels =
            ScannerModels(
                Native.modelsFromMemory(
                    direct(decoder), direct(encoder), direct(photo), direct(completion),
                ),
            )

        /** From decoder.bin, encoder.onnx, photo.onnx and completion.onnx of a folder. */
        @JvmStatic
        fun fromFolder(folder: File): ScannerModels =
            ScannerModels(Native.modelsFromFolder(Native.text(folder.path)))

        private fun direct(bytes: ByteArray): ByteBuffer =
            ByteBuffer.allocateDirect(bytes.size).also { it.put(bytes) }
    }
}
