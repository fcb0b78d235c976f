#if canImport(Darwin)
import Darwin
import SVBRDF

/// Gives the library's threads the priorities of what they do: the fit works on while the user looks at
/// something else; taking photos in and calling back is waited for. Once, before the first scanner.
public func setQualityOfService() {
    svbrdf_set_thread_hook({ _, thread in
        let background = thread == svbrdf_thread(SVBRDF_THREAD_WORK) || thread == svbrdf_thread(SVBRDF_THREAD_FIT)
        pthread_set_qos_class_self_np(background ? QOS_CLASS_UTILITY : QOS_CLASS_USER_INITIATED, 0)
    }, nil)
}
#endif
