// A camera for scans by AVFoundation, to be taken into an app: torch on; exposure, focus and white balance
// locked; the library's guide asks for photos as the hand moves. The frames of the video are the photos:
// at 3 megapixels they are enough for 1024 texels, and no frame is merged from several, as still photos are.
import AVFoundation
import Foundation
import SVBRDFScanner

/// The view of a scan; called from a task of the controller.
public protocol CaptureScreen: AnyObject, Sendable {
    func show(_ guidance: Guidance) async
    func show(_ outcome: Outcome) async
    func show(_ error: any Error) async
}

public enum CaptureError: Error {
    /// No back camera with a torch.
    case noCamera
    /// The app may not use the camera: NSCameraUsageDescription, Settings.
    case notAllowed
}

/// Owns the camera. Its state belongs to its queue.
public final class CaptureController: NSObject, @unchecked Sendable {
    /// For the preview: `AVCaptureVideoPreviewLayer(session:)`.
    public let session = AVCaptureSession()
    private let scanner: MaterialScanner
    private weak var screen: (any CaptureScreen)?
    private let queue = DispatchQueue(label: "svbrdf.camera")
    private var device: AVCaptureDevice?
    private var isLocked = false
    private var isBusy = false
    private var isEnough = false

    public init(_ scanner: MaterialScanner, _ screen: any CaptureScreen) {
        (self.scanner, self.screen) = (scanner, screen)
    }

    /// Asks for the camera and starts it: the preview shows, nothing is scanned before `lock()`.
    public func start() async throws {
        guard await AVCaptureDevice.requestAccess(for: .video) else { throw CaptureError.notAllowed }
        try await onQueue { [self] in
            if device == nil {
                try configure()
            }
            // Takes a while, which is why it is not done by the main thread.
            session.startRunning()
            try light()
        }
    }

    /// Stops the camera; the scan stays. The torch goes out with it.
    public func stop() {
        queue.async { [self] in
            session.stopRunning()
            isLocked = false
        }
    }

    /// Locks exposure, focus and white balance once they have settled, and begins to scan. Hold the phone above
    /// the board meanwhile.
    public func lock() async throws {
        for _ in 0..<30 where try await onQueue({ [self] in !isSettled }) {
            try await Task.sleep(nanoseconds: 100_000_000)
        }
        try await onQueue { [self] in
            guard let device else { throw CaptureError.noCamera }
            try device.lockForConfiguration()
            defer { device.unlockForConfiguration() }
            // Highlights need room above the target of automatic exposure.
            let range = device.activeFormat
            let half = CMTimeMultiplyByFloat64(device.exposureDuration, multiplier: 0.5)
            let shortest = range.minExposureDuration
            let duration = CMTimeCompare(half, shortest) < 0 ? shortest : half
            device.setExposureModeCustom(duration: duration, iso: device.iso, completionHandler: nil)
            device.focusMode = .locked
            device.whiteBalanceMode = .locked
            (isLocked, isEnough) = (true, false)
        }
    }

    private func configure() throws {
        // One lens: the phone must not change it on the way. The flash's offset is that of this one.
        guard
            let device = AVCaptureDevice.default(.builtInWideAngleCamera, for: .video, position: .back),
            device.hasTorch
        else { throw CaptureError.noCamera }
        session.beginConfiguration()
        defer { session.commitConfiguration() }
        session.sessionPreset = .inputPriority
        session.addInput(try AVCaptureDeviceInput(device: device))
        let frames = AVCaptureVideoDataOutput()
        frames.alwaysDiscardsLateVideoFrames = true
        frames.videoSettings = [
            kCVPixelBufferPixelFormatTypeKey as String: kCVPixelFormatType_420YpCbCr8BiPlanarFullRange,
        ]
        frames.setSampleBufferDelegate(self, queue: queue)
        session.addOutput(frames)
        // Stabilisation moves the picture against the lens.
        frames.connection(with: .video)?.preferredVideoStabilizationMode = .off
        try device.lockForConfiguration()
        defer { device.unlockForConfiguration() }
        if let format = format(of: device) {
            device.activeFormat = format
        }
        device.automaticallyAdjustsVideoHDREnabled = false
        if device.activeFormat.isVideoHDRSupported {
            device.isVideoHDREnabled = false
        }
        self.device = device
    }

    /// Four by three, nearest to three megapixels.
    private func format(of device: AVCaptureDevice) -> AVCaptureDevice.Format? {
        func cost(_ format: AVCaptureDevice.Format) -> Int {
            let size = CMVideoFormatDescriptionGetDimensions(format.formatDescription)
            let (width, height) = (Int(size.width), Int(size.height))
            return abs(width - 2016) + 4 * abs(height - 3 * width / 4)
        }
        let full = kCVPixelFormatType_420YpCbCr8BiPlanarFullRange
        let read = device.formats.filter {
            CMFormatDescriptionGetMediaSubType($0.formatDescription) == full
        }
        return read.min { cost($0) < cost($1) }
    }

    /// A torch of full strength heats the phone until it dims by itself.
    private func light() throws {
        guard let device else { return }
        try device.lockForConfiguration()
        defer { device.unlockForConfiguration() }
        try device.setTorchModeOn(level: 0.5)
    }

    private var isSettled: Bool {
        guard let device else { return false }
        return !device.isAdjustingExposure && !device.isAdjustingFocus && !device.isAdjustingWhiteBalance
    }

    private func onQueue<Value: Sendable>(_ body: @escaping @Sendable () throws -> Value) async throws -> Value {
        try await withCheckedThrowingContinuation { continuation in
            queue.async { continuation.resume(with: Result(catching: body)) }
        }
    }

    /// Guides with a frame, which becomes the photo when the guide asks to shoot.
    private func look(_ photo: Photo, _ info: PhotoInfo) async {
        do {
            let guidance = try await scanner.guide(photo, info)
            await screen?.show(guidance)
            if guidance.action == .shoot {
                let outcome = try await scanner.addPhoto(photo, info)
                if case .rejected = outcome {
                    try await scanner.beginGuide()
                }
                await screen?.show(outcome)
            }
            let enough = guidance.action == .enough
            queue.async { [self] in (isBusy, isEnough) = (false, enough) }
        } catch {
            await screen?.show(error)
            queue.async { [self] in isBusy = false }
        }
    }
}

extension CaptureController: AVCaptureVideoDataOutputSampleBufferDelegate {
    public func captureOutput(
        _: AVCaptureOutput, didOutput sample: CMSampleBuffer, from _: AVCaptureConnection
    ) {
        // Frames that come while one is looked at are dropped.
        guard isLocked, !isBusy, !isEnough, let buffer = CMSampleBufferGetImageBuffer(sample) else { return }
        let seconds = CMTimeGetSeconds(CMSampleBufferGetPresentationTimeStamp(sample))
        let info = PhotoInfo(flash: .torch, timestamp: Int64(seconds * 1e9))
        do {
            // It holds the camera's buffer until it is through.
            let photo = try Photo(buffer)
            isBusy = true
            Task { await look(photo, info) }
        } catch {
            let screen = screen
            Task { await screen?.show(error) }
        }
    }
}
