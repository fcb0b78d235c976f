package org.svbrdf.scanner

import java.lang.ref.PhantomReference
import java.lang.ref.ReferenceQueue
import java.util.Collections
import java.util.concurrent.atomic.AtomicLong

/**
 * A native handle: freed once, by [close], or after its owner was collected without (as
 * `java.lang.ref.Cleaner` does, which Android has from API 33 on). [free] must not refer to the
 * owner.
 */
internal class Handle(owner: Any, value: Long, private val free: (Long) -> Unit) :
    PhantomReference<Any>(owner, forgotten) {

    private val value = AtomicLong(value)

    init {
        all.add(this)
    }

    /** The handle; 0 after [close], which the library answers with "closed". */
    val now: Long get() = value.get()

    fun close() {
        all.remove(this)
        val handle = value.getAndSet(0)
        if (handle != 0L) {
            free(handle)
        }
    }

    companion object {
        private val forgotten = ReferenceQueue<Any>()
        private val all: MutableSet<Handle> = Collections.synchronizedSet(HashSet())

        /** How many handles are open. */
        val open: Int get() = all.size

        init {
            val reaper = Thread({
                while (true) {
                    (forgotten.remove() as Handle).close()
                }
            }, "svbrdf-reaper")
            reaper.isDaemon = true
            reaper.start()
        }
    }
}
