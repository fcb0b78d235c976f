import Foundation
import SVBRDF

/// Values of callbacks. Slow readers see the latest, never a queue.
final class Listener: Sendable {
    let progress: AsyncStream<Progress>.Continuation
    let maps: AsyncStream<Void>.Continuation

    init(_ progress: AsyncStream<Progress>.Continuation, _ maps: AsyncStream<Void>.Continuation) {
        (self.progress, self.maps) = (progress, maps)
    }
}

/// A session of C. It is sendable because its functions may be called from any thread at any time.
final class Session: @unchecked Sendable {
    let handle: OpaquePointer
    private let listener: Unmanaged<Listener>

    init(
        _ options: ScanOptions, _ listener: Listener,
        _ make: (UnsafePointer<svbrdf_session_options>, UnsafeMutablePointer<OpaquePointer?>) -> svbrdf_status
    ) throws {
        let retained = Unmanaged.passRetained(listener)
        var session: OpaquePointer?
        do {
            try options.with { options in
                options.user_data = retained.toOpaque()
                options.on_progress = { user, _, progress in
                    guard let user, let progress else { return }
                    let listener = Unmanaged<Listener>.fromOpaque(user).takeUnretainedValue()
                    listener.progress.yield(Progress(progress.pointee))
                }
                options.on_maps = { user, _ in
                    guard let user else { return }
                    Unmanaged<Listener>.fromOpaque(user).takeUnretainedValue().maps.yield()
                }
                try check(make(&options, &session))
            }
        } catch {
            retained.release()
            throw error
        }
        (self.handle, self.listener) = (session!, retained)
    }

    deinit {
        // No callback comes after this.
        svbrdf_session_destroy(handle)
        let listener = listener.takeRetainedValue()
        listener.progress.finish()
        listener.maps.finish()
    }
}

/// Waits for the outcome of a photo.
final class Answer: Sendable {
    private let continuation: CheckedContinuation<Outcome, any Error>

    init(_ continuation: CheckedContinuation<Outcome, any Error>) {
        self.continuation = continuation
    }

    func resume(_ status: svbrdf_status, _ report: svbrdf_photo_report?) {
        switch (status, report) {
        case (SVBRDF_OK, let report?), (SVBRDF_REJECTED, let report?):
            continuation.resume(returning: Outcome(report))
        default:
            continuation.resume(throwing: ScanError(status))
        }
    }

    func fail(_ error: any Error) {
        continuation.resume(throwing: error)
    }
}

/// Where an actor's calls run that may wait for a step of the fit: not on the threads of all tasks.
final class QueueExecutor: SerialExecutor {
    private let queue = DispatchQueue(label: "org.svbrdf.scanner")

    func enqueue(_ job: consuming ExecutorJob) {
        let job = UnownedJob(job)
        let executor = asUnownedSerialExecutor()
        queue.async { job.runSynchronously(on: executor) }
    }

    func asUnownedSerialExecutor() -> UnownedSerialExecutor {
        UnownedSerialExecutor(ordinary: self)
    }
}
