import Foundation
import SVBRDF

/// Normal, diffuse, specular and roughness maps of a flat sample from photos of it inside a printed
/// board, one at a time.
///
/// Calls run one after the other on a queue of the scanner's own, those that wait for the fit included;
/// `addPhoto` and `settle` suspend without holding it. The fit goes on by itself between calls, and ends
/// with the last reference.
public actor MaterialScanner {
    private let session: Session
    private let executor = QueueExecutor()

    /// State of the fit whenever it has moved on: for one reader.
    public nonisolated let progressUpdates: AsyncStream<Progress>
    /// Whenever there are newer maps: for one reader.
    public nonisolated let mapUpdates: AsyncStream<Void>

    public nonisolated var unownedExecutor: UnownedSerialExecutor {
        executor.asUnownedSerialExecutor()
    }

    /// Begins a scan.
    public init(_ options: ScanOptions = ScanOptions()) throws {
        try self.init(options) { svbrdf_session_create($0, $1) }
    }

    /// Goes on with a scan that `save` has written. Of the options count threads and memory limit; the
    /// rest is in the file.
    public init(restoring file: URL, _ options: ScanOptions = ScanOptions()) throws {
        try self.init(options) { svbrdf_session_load_state_from($0, file.path, $1) }
    }

    private init(
        _ options: ScanOptions,
        _ make: (UnsafePointer<svbrdf_session_options>, UnsafeMutablePointer<OpaquePointer?>) -> svbrdf_status
    ) throws {
        let progress = AsyncStream.makeStream(of: Progress.self, bufferingPolicy: .bufferingNewest(1))
        let maps = AsyncStream.makeStream(of: Void.self, bufferingPolicy: .bufferingNewest(1))
        (progressUpdates, mapUpdates) = (progress.stream, maps.stream)
        let listener = Listener(progress.continuation, maps.continuation)
        session = try Session(options, listener, make)
    }

    /// Judges a photo, or an image of the preview of any size, without taking it in.
    public func probe(_ photo: Photo, _ info: PhotoInfo = PhotoInfo()) throws -> Probe {
        try photo.with(info) { image, info in
            var probe = try filled(svbrdf_probe(), svbrdf_probe_init)
            try check(svbrdf_session_probe(session.handle, image, info, &probe))
            return Probe(probe)
        }
    }

    /// Judges an image of the preview and returns the next action: hold, move there, shoot now, or enough. Call it
    /// with every image and its time in the info. After `.shoot` it asks to hold until
    /// the photo has been added.
    public func guide(_ preview: Photo, _ info: PhotoInfo) throws -> Guidance {
        try preview.with(info) { image, info in
            var probe = try filled(svbrdf_probe(), svbrdf_probe_init)
            var guidance = try filled(svbrdf_guidance(), svbrdf_guidance_init)
            try check(svbrdf_session_guide(session.handle, image, info, &probe, &guidance))
            return Guidance(guidance, Probe(probe))
        }
    }

    /// Begins guidance anew. Also tells that the photo asked for was not taken, or was rejected.
    public func beginGuide() throws {
        try check(svbrdf_session_guide_begin(session.handle, nil))
    }

    /// Takes a photo in; its planes are copied before the task is suspended. When it returns, maps that
    /// know of the photo can be taken. With three photos on their way it throws `.busy`.
    public func addPhoto(_ photo: Photo, _ info: PhotoInfo = PhotoInfo()) async throws -> Outcome {
        let session = session
        return try await withCheckedThrowingContinuation { continuation in
            let answer = Unmanaged.passRetained(Answer(continuation))
            do {
                try photo.with(info) { image, info in
                    let called: svbrdf_photo_callback = { user, _, status, report in
                        guard let user else { return }
                        let answer = Unmanaged<Answer>.fromOpaque(user).takeRetainedValue()
                        answer.resume(status, report?.pointee)
                    }
                    let user = answer.toOpaque()
                    try check(
                        svbrdf_session_add_photo_async(session.handle, image, info, called, user)
                    )
                }
            } catch {
                // Then no answer comes.
                answer.takeRetainedValue().fail(error)
            }
        }
    }

    /// Adds a photo from a file, with its metadata. A file that is damaged, or of an unsupported format, throws
    /// `.invalidArgument` with its name.
    public func addPhoto(_ file: PhotoFile) throws -> (outcome: Outcome, info: FileInfo) {
        try file.add(to: session)
    }

    /// Takes an accepted photo back: the scan is as if it had never come. Later ones move up by one.
    public func removePhoto(_ index: Int) throws {
        try check(svbrdf_session_remove_photo(session.handle, UInt32(clamping: index)))
    }

    /// How the maps explain a photo: its residual, and whether it contradicts the others.
    public func photoFit(of index: Int) throws -> (residual: Float, weight: Float, outlier: Bool) {
        var fit = try filled(svbrdf_photo_fit(), svbrdf_photo_fit_init)
        try check(svbrdf_session_photo_fit(session.handle, UInt32(clamping: index), &fit))
        return (fit.residual, fit.weight, fit.outlier == 1)
    }

    /// Hints about the accepted photos from all present knowledge. Hints given when a photo was added may no longer
    /// hold, and others may. Meaningful once the fit has settled.
    public func hints() throws -> [PhotoHint] {
        var all: [PhotoHint] = []
        let add: svbrdf_hint_callback = { to, index, code, text in
            guard let to, let code, let text else { return }
            let hint = PhotoHint(index: Int(index), code: String(cString: code), text: String(cString: text))
            to.assumingMemoryBound(to: [PhotoHint].self).pointee.append(hint)
        }
        try check(withUnsafeMutablePointer(to: &all) { svbrdf_session_hints(session.handle, add, $0) })
        return all
    }

    /// The maps as they are now, at 1 / 2^level of the size; nil before the first photo.
    public func snapshot(reducedBy level: Int = 0) throws -> MaterialMaps? {
        let maps = try taken { svbrdf_session_snapshot_maps(session.handle, $0) }
        return level == 0 ? maps : try maps?.reduced(by: level)
    }

    /// The maps with how far they may be off; nil before the first photo. Ask once the fit has settled.
    public func snapshotWithUncertainty() throws -> MaterialMaps? {
        try taken { svbrdf_session_snapshot_with_uncertainty(session.handle, $0) }
    }

    private func taken(
        _ take: (UnsafeMutablePointer<OpaquePointer?>) -> svbrdf_status
    ) throws -> MaterialMaps? {
        var maps: OpaquePointer?
        let status = take(&maps)
        if status == SVBRDF_NO_MAPS { return nil }
        try check(status)
        return try MaterialMaps(maps!)
    }

    /// Writes PNG, OpenEXR and a preview into a folder; throws `.noMaps` before the first photo.
    public func export(to folder: URL) throws {
        guard let maps = try snapshot() else {
            throw ScanError(SVBRDF_NO_MAPS, "no photo has been accepted yet, so there are no maps")
        }
        try maps.export(to: folder)
    }

    /// From where the next photo tells most; nil before the first one.
    public func nextView() throws -> NextView? {
        var view = try filled(svbrdf_next_view(), svbrdf_next_view_init)
        try check(svbrdf_session_next_view(session.handle, &view))
        return view.known == 1 ? NextView(view) : nil
    }

    /// Announces that so many photos are still to come: `Progress.fraction` is then that of the work on all of
    /// them together, and never falls before they have come. Each photo added takes one of them away, whether the photo
    /// is accepted or rejected. If fewer or more come after all, say so by another call. Without it, in a live
    /// capture, the fraction is that of each photo.
    public func announce(_ photos: Int) throws {
        try check(svbrdf_session_announce(session.handle, UInt32(clamping: photos)))
    }

    public func progress() throws -> Progress {
        var progress = try filled(svbrdf_progress(), svbrdf_progress_init)
        try check(svbrdf_session_progress(session.handle, &progress))
        return Progress(progress)
    }

    /// Suspends until the fit has settled on all photos so far; ends early when its task is cancelled.
    public func settle() async throws {
        while true {
            let status = svbrdf_session_wait(session.handle, 0)
            if status != SVBRDF_TIMEOUT { return try check(status) }
            try await Task.sleep(for: .milliseconds(50))
        }
    }

    /// Saves the scan into a file, from which `init(restoring:)` goes on in another process.
    public func save(to file: URL) throws {
        try check(svbrdf_session_save_state_to(session.handle, file.path))
    }

    /// Limits the work on each photo; nil and 0: any amount.
    public func setBudget(seconds: Float? = nil, steps: Int = 0, stopWhenInvisible: Bool = false) throws {
        var budget = try filled(svbrdf_budget(), svbrdf_budget_init)
        if let seconds { budget.seconds = seconds }
        budget.max_steps = UInt32(clamping: steps)
        budget.stop_when_invisible = stopWhenInvisible ? 1 : 0
        try check(svbrdf_session_set_budget(session.handle, &budget))
    }

    /// Holds the fit; photos are still taken in.
    public func pause() throws {
        try check(svbrdf_session_pause(session.handle))
    }

    /// Goes on after `pause`.
    public func resume() throws {
        try check(svbrdf_session_resume(session.handle))
    }

    /// Ends the fit; photos are refused from now on, maps stay available. Waits for nothing, not even for
    /// calls on their way.
    public nonisolated func cancel() throws {
        try check(svbrdf_session_cancel(session.handle))
    }
}
