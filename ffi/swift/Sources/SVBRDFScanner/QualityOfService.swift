#if canImport(Darwin)
import Darwin
import SVBRDF

/// Sets the priorities of the library's threads: the fit works in the background; the user waits for photos to be
/// added and for callbacks. Call it once, before the first scanner.
public func setQualityOfService() {
    svbrdf_set_thread_hook({ _, thread in
        let background = thread == svbrdf_thread(SVBRDF_THREAD_WORK) || thread == svbrdf_thread(SVBRDF_THREAD_FIT)
        pthread_set_qos_class_self_np(background ? QOS_CLASS_UTILITY : QOS_CLASS_USER_INITIATED, 0)
    }, nil)
}
#endif
