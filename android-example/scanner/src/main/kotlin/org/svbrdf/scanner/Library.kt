package org.svbrdf.scanner

/** Settings of the native library in the whole process. */
object Library {
    /** Called at the start of a thread, on it. */
    fun interface ThreadHook {
        fun onStart(role: ThreadRole)
    }

    /** Called with a line, on the thread it happens on. */
    fun interface LogListener {
        fun onLog(level: LogLevel, line: String)
    }

    /**
     * Has every thread that the library starts from now on call [hook] first, e.g. to set its
     * priority with `Process.setThreadPriority`; null ends that. Set it before the first scanner:
     * threads that run already are not called on.
     */
    @JvmStatic
    fun setThreadHook(hook: ThreadHook?) {
        Native.threadHook = hook
        Native.setThreadHook(hook != null)
    }

    /**
     * Has [listener] called with the lines of all scanners, in addition to their listeners', and with
     * faults inside the library that belong to none; null ends that.
     */
    @JvmStatic
    fun setLogListener(listener: LogListener?) {
        Native.logListener = listener
        Native.setLog(listener != null)
    }
}
