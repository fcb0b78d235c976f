// Lifecycle of scanners: their ends, their callbacks, and no remains.

package org.svbrdf.scanner

import java.io.File
import java.lang.ref.WeakReference
import java.util.concurrent.ConcurrentLinkedQueue
import java.util.concurrent.CountDownLatch
import java.util.concurrent.LinkedBlockingQueue
import java.util.concurrent.TimeUnit
import java.util.concurrent.atomic.AtomicInteger
import java.util.concurrent.atomic.AtomicReference
import kotlin.concurrent.thread
import kotlinx.coroutines.flow.first
import kotlinx.coroutines.runBlocking
import kotlinx.coroutines.withTimeoutOrNull

/** Longest wait for other threads, on a busy machine. */
const val PATIENCE_NS = 600_000_000_000

/** Waits until it is so. */
fun eventually(what: String, condition: () -> Boolean) {
    val deadline = System.nanoTime() + PATIENCE_NS
    while (!condition()) {
        verify(System.nanoTime() < deadline) { what }
        Thread.sleep(1)
    }
}

fun callbacksThatMisbehave() {
    // Exceptions go to the thread's handler; closing inside a callback is fine.
    val uncaught = ConcurrentLinkedQueue<Throwable>()
    val before = Thread.getDefaultUncaughtExceptionHandler()
    Thread.setDefaultUncaughtExceptionHandler { _, thrown -> uncaught.add(thrown) }
    val closed = CountDownLatch(1)
    val late = AtomicInteger()
    val caller = AtomicReference<Thread>()
    val listener = object : MaterialScanner.Listener {
        override fun onMaps(scanner: MaterialScanner) {
            throw IllegalStateException("mine")
        }

        override fun onProgress(scanner: MaterialScanner, progress: Progress) {
            caller.set(Thread.currentThread())
            if (closed.count == 0L) {
                late.incrementAndGet()
            }
            scanner.close()
            closed.countDown()
        }
    }
    val scanner = MaterialScanner(small, listener)
    // The callbacks may close it before the call has returned.
    val outcome = runCatching { scanner.addRectifiedPhoto(gray(), above, above) }
    verify(outcome.getOrNull() is Outcome.Accepted) { "$outcome" }
    verify(closed.await(PATIENCE_NS, TimeUnit.NANOSECONDS)) { "no callback" }
    // After its end nothing can call.
    caller.get().join()
    Thread.setDefaultUncaughtExceptionHandler(before)
    verify(uncaught.any() && uncaught.all { it.message == "mine" }) { "$uncaught" }
    verify(late.get() == 0) { "$late" }
    uncaught.clear()
    throws<IllegalStateException>("closed") { scanner.progress }
    // Closed by others while a callback runs: failures there are no faults.
    val inside = CountDownLatch(1)
    val slow = object : MaterialScanner.Listener {
        override fun onMaps(scanner: MaterialScanner) {
            inside.countDown()
            while (true) {
                scanner.snapshot()?.close()
            }
        }
    }
    Thread.setDefaultUncaughtExceptionHandler { _, thrown -> uncaught.add(thrown) }
    MaterialScanner(small, slow).use { other ->
        other.addRectifiedPhoto(gray(), above, above)
        verify(inside.await(PATIENCE_NS, TimeUnit.NANOSECONDS)) { "no callback" }
    }
    Thread.setDefaultUncaughtExceptionHandler(before)
    verify(uncaught.isEmpty()) { "closing was reported as a fault: $uncaught" }
}

fun closingWhileOthersCall() {
    repeat(10) { round ->
        val scanner = MaterialScanner(small, ScannerFlows())
        val surprise = AtomicReference<Throwable>()
        val inside = List(4) { CountDownLatch(1) }
        val workers = List(4) { worker ->
            thread {
                try {
                    while (true) {
                        if (round % 2 == 0) {
                            inside[worker].countDown()
                        }
                        when (worker) {
                            0 -> scanner.addRectifiedPhoto(gray(), above, above)
                            1 -> scanner.snapshot()?.use { it.rgba8(MapKind.NORMAL) }
                            2 -> scanner.await(1)
                            else -> scanner.progress
                        }
                        inside[worker].countDown()
                    }
                } catch (expected: IllegalStateException) {
                    // Closed.
                } catch (thrown: Throwable) {
                    if ((thrown as? ScannerException)?.fault != Fault.CANCELLED) {
                        surprise.set(thrown)
                    }
                } finally {
                    inside[worker].countDown()
                }
            }
        }
        // In their first calls, or after them.
        inside.forEach { it.await() }
        scanner.close()
        workers.forEach { it.join() }
        surprise.get()?.let { throw it }
    }
}

fun flows(): Unit = runBlocking {
    val flows = ScannerFlows()
    MaterialScanner(small, flows).use { scanner ->
        // For boards; this scanner takes photos from the top.
        val refused = runCatching { scanner.addPhotoSuspending(gray()) }
        verify(refused.exceptionOrNull() is IllegalArgumentException) { "$refused" }
        verify(scanner.addRectifiedPhoto(gray(), above, above) is Outcome.Accepted) { "outcome" }
        flows.maps.first().use { verify(it.width == 256) { "${it.width}" } }
        flows.progress.first { it != null && it.settled }
        verify(scanner.awaitSuspending() && scanner.awaitSuspending(0)) { "settled" }
        scanner.exportSuspending(File(out, "suspending"))
        verify(File(out, "suspending/normal.png").isFile) { "export" }
        val state = File(out, "suspending.state")
        scanner.saveSuspending(state)
        MaterialScanner.restore(state).use { verify(it.progress.photos == 1) { "saved" } }
        // A cancelled coroutine or a timeout ends the wait.
        scanner.pause()
        scanner.addRectifiedPhoto(gray(), above, above)
        verify(!scanner.awaitSuspending(150)) { "a fit that is held" }
        verify(withTimeoutOrNull(200) { scanner.awaitSuspending() } == null) { "a fit that is held" }
    }
}

fun forgotten() {
    // Scanners and maps that nobody closed are freed after their owners.
    val weak = List(5) {
        val scanner = MaterialScanner(small, ScannerFlows())
        scanner.addRectifiedPhoto(gray(), above, above)
        scanner.snapshot()
        WeakReference(scanner)
    }
    val deadline = System.nanoTime() + PATIENCE_NS
    while (Handle.open > 0 && System.nanoTime() < deadline) {
        System.gc()
        Thread.sleep(20)
    }
    verify(weak.all { it.get() == null } && Handle.open == 0) { "${Handle.open} handles left" }
}

fun residentKiB(): Long =
    File("/proc/self/status").readLines().first { it.startsWith("VmRSS") }
        .filter { it.isDigit() }.toLong()

fun twoHundredSessions() {
    val listener = object : MaterialScanner.Listener {}
    // Only every fifth takes the time to add a photo; none waits for a fit.
    fun sessions(count: Int) = repeat(count) { index ->
        MaterialScanner(small, listener).use { scanner ->
            if (index % 5 == 0) {
                scanner.pause()
                scanner.addRectifiedPhoto(gray(), above, above)
                scanner.snapshot()!!.use { it.rgba8(MapKind.DIFFUSE) }
            }
        }
    }
    // Networks are parsed once while a session lives.
    MaterialScanner(small).use {
        sessions(40)
        // One leaked set of maps has 2 MiB, a leaked session more: 40 of them have twice the limit.
        // The Java heap and the allocator's arenas grow as well, but not again and again.
        val leaks = (1..3).all {
            System.gc()
            val before = residentKiB()
            sessions(200)
            System.gc()
            val growth = residentKiB() - before
            println("200 sessions: $growth KiB more, of ${residentKiB()}")
            growth >= 40 * 1024
        }
        verify(!leaks) { "memory grows with every session" }
    }
    verify(Handle.open == 0 && Native.registered == 0) { "${Handle.open} ${Native.registered}" }
}

/** Photos that no thread of the app waits for. */
fun pushedWithoutWaiting() {
    val came = LinkedBlockingQueue<Pair<Outcome?, Throwable?>>()
    val scanner = MaterialScanner(options)
    scanner.pause()
    fun push(index: Int, time: Long, info: PhotoInfo = PhotoInfo(timestampNs = time)) =
        scanner.addPhotoAsync(photo(index), info) { outcome, fault -> came.add(outcome to fault) }
    push(0, 7)
    val first = came.take().first as Outcome.Accepted
    verify(first.timestampNs == 7L && first.index == 0 && first.pose != null) { "$first" }
    push(0, 8, PhotoInfo(flash = Flash.OFF, timestampNs = 8))
    val dark = came.take().first as Outcome.Rejected
    verify(dark.reason == Rejection.LIGHT_NOT_VISIBLE && dark.timestampNs == 8L) { "$dark" }
    throws<IllegalArgumentException>("focal") { push(0, 9, PhotoInfo(focal35mm = Float.NaN)) }
    // As many as are taken, until one is refused: nothing moves on while the first one's callback is held up. Each
    // gets its callback when the scanner is closed.
    val refused = CountDownLatch(1)
    scanner.addPhotoAsync(photo(1)) { outcome, fault ->
        refused.await()
        came.add(outcome to fault)
    }
    var sent = 1
    val busy = runCatching { repeat(5) { push(1, it.toLong()); sent++ } }.exceptionOrNull()
    verify((busy as ScannerException).fault == Fault.BUSY && sent in 3..4) { "$busy after $sent" }
    refused.countDown()
    scanner.close()
    verify(came.size == sent) { "${came.size} of $sent" }
    for ((outcome, fault) in came) {
        verify(outcome is Outcome.Accepted || (fault as ScannerException).fault == Fault.CANCELLED) { "$fault" }
    }
    throws<IllegalStateException>("closed") { push(0, 1) }
    verify(came.size == sent) { "callback for a photo that was refused" }

    // Exceptions go to the thread's handler, and nothing is held up.
    val uncaught = LinkedBlockingQueue<Throwable>()
    val before = Thread.getDefaultUncaughtExceptionHandler()
    Thread.setDefaultUncaughtExceptionHandler { _, thrown -> uncaught.add(thrown) }
    MaterialScanner(small).use { other ->
        other.addPhotoAsync(gray()) { outcome, fault ->
            verify(outcome == null && fault is IllegalArgumentException) { "$outcome $fault" }
            throw IllegalStateException("mine")
        }
        verify(uncaught.take().message == "mine") { "another one" }
    }
    Thread.setDefaultUncaughtExceptionHandler(before)
}

/** Threads and log of the library as a whole. */
fun ofTheLibrary() {
    val roles = ConcurrentLinkedQueue<ThreadRole>()
    val lines = ConcurrentLinkedQueue<String>()
    Library.setThreadHook { roles.add(it) }
    Library.setLogListener { level, line -> lines.add("$level $line") }
    fun run() = MaterialScanner(small, ScannerFlows()).use { scanner ->
        scanner.addRectifiedPhoto(gray(), above, above)
        val answered = CountDownLatch(1)
        scanner.addPhotoAsync(gray()) { _, _ -> answered.countDown() }
        answered.await()
    }
    run()
    val expected = ThreadRole.entries - ThreadRole.OTHER
    verify(roles.containsAll(expected)) { "$roles" }
    verify(lines.any { it.startsWith("INFO session") } && lines.any { "accepted" in it }) { "$lines" }
    Library.setThreadHook(null)
    Library.setLogListener(null)
    // Threads that share work may still be starting; the others have ended.
    val own = listOf(ThreadRole.FIT, ThreadRole.CALLBACK, ThreadRole.PHOTOS)
    val logged = lines.size
    run()
    verify(own.all { role -> roles.count { it == role } == 1 }) { "called after the end: $roles" }
    verify(lines.size == logged) { "logged after the end" }
}
