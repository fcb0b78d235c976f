package org.svbrdf.scanner

import java.io.File
import kotlin.coroutines.resume
import kotlin.coroutines.resumeWithException
import kotlinx.coroutines.Dispatchers
import kotlinx.coroutines.ensureActive
import kotlinx.coroutines.suspendCancellableCoroutine
import kotlinx.coroutines.withContext

/**
 * [MaterialScanner.addPhoto] without a thread that waits: the caller's is busy only while the planes are
 * copied.
 */
suspend fun MaterialScanner.addPhotoSuspending(photo: Photo, info: PhotoInfo = PhotoInfo()): Outcome =
    suspendCancellableCoroutine { waiting ->
        addPhotoAsync(photo, info) { outcome, fault ->
            if (outcome != null) waiting.resume(outcome) else waiting.resumeWithException(fault!!)
        }
    }

/**
 * [MaterialScanner.await] on a thread for waiting. A cancelled coroutine ends it within a tenth of a
 * second; the fit goes on.
 */
suspend fun MaterialScanner.awaitSuspending(limitMillis: Long = -1): Boolean =
    withContext(Dispatchers.IO) {
        val begun = System.nanoTime()
        var settled: Boolean
        do {
            ensureActive()
            val left = when {
                limitMillis < 0 -> Long.MAX_VALUE
                else -> limitMillis - (System.nanoTime() - begun) / 1_000_000
            }
            settled = await(left.coerceIn(0, SLICE_MILLIS))
        } while (!settled && left > SLICE_MILLIS)
        settled
    }

/** [MaterialScanner.export] on a thread for files. */
suspend fun MaterialScanner.exportSuspending(folder: File) =
    withContext(Dispatchers.IO) { export(folder) }

/** [MaterialScanner.save] on a thread for files. */
suspend fun MaterialScanner.saveSuspending(file: File) = withContext(Dispatchers.IO) { save(file) }

/** How long a wait cannot be cancelled. */
private const val SLICE_MILLIS = 100L
