// What the example uses of Apple's AVFoundation and Core Media, as their documentation declares it, so that a
// compiler elsewhere can look at the code that does. Nothing here works.
@_exported import CoreVideo
import Foundation

public struct CMTime: Sendable {}
public final class CMSampleBuffer {}
public final class CMFormatDescription: @unchecked Sendable {}
public struct CMVideoDimensions: Sendable {
    public var width: Int32 = 0
    public var height: Int32 = 0
}

public func CMTimeMultiplyByFloat64(_ time: CMTime, multiplier: Double) -> CMTime { time }
public func CMTimeCompare(_: CMTime, _: CMTime) -> Int32 { 0 }
public func CMTimeGetSeconds(_: CMTime) -> Double { 0 }
public func CMSampleBufferGetImageBuffer(_: CMSampleBuffer) -> CVPixelBuffer? { nil }
public func CMSampleBufferGetPresentationTimeStamp(_: CMSampleBuffer) -> CMTime { CMTime() }
public func CMVideoFormatDescriptionGetDimensions(_: CMFormatDescription) -> CMVideoDimensions {
    CMVideoDimensions()
}
public func CMFormatDescriptionGetMediaSubType(_: CMFormatDescription) -> OSType { 0 }

public struct AVMediaType: Sendable {
    public static let video = Self()
}

open class AVCaptureDevice: NSObject {
    public struct DeviceType: Sendable {
        public static let builtInWideAngleCamera = Self()
    }
    public enum Position: Int, Sendable { case unspecified, back, front }
    public enum FocusMode: Int, Sendable { case locked, autoFocus, continuousAutoFocus }
    public enum WhiteBalanceMode: Int, Sendable { case locked, autoWhiteBalance }
    open class Format: NSObject {
        public var formatDescription: CMFormatDescription { CMFormatDescription() }
        public var minExposureDuration: CMTime { CMTime() }
        public var isVideoHDRSupported: Bool { false }
    }

    public class func `default`(_: DeviceType, for: AVMediaType?, position: Position) -> AVCaptureDevice? { nil }
    public class func requestAccess(for: AVMediaType) async -> Bool { false }
    public var hasTorch: Bool { false }
    public var formats: [Format] { [] }
    public var activeFormat = Format()
    public var exposureDuration: CMTime { CMTime() }
    public var iso: Float { 0 }
    public var focusMode = FocusMode.locked
    public var whiteBalanceMode = WhiteBalanceMode.locked
    public var automaticallyAdjustsVideoHDREnabled = true
    public var isVideoHDREnabled = true
    public var isAdjustingExposure: Bool { false }
    public var isAdjustingFocus: Bool { false }
    public var isAdjustingWhiteBalance: Bool { false }
    public func lockForConfiguration() throws {}
    public func unlockForConfiguration() {}
    public func setTorchModeOn(level: Float) throws {}
    public func setExposureModeCustom(
        duration: CMTime, iso: Float, completionHandler: (@Sendable (CMTime) -> Void)?
    ) {}
}

open class AVCaptureInput: NSObject {}
open class AVCaptureDeviceInput: AVCaptureInput {
    public init(device: AVCaptureDevice) throws {}
}

public enum AVCaptureVideoStabilizationMode: Int, Sendable { case off, standard }
open class AVCaptureConnection: NSObject {
    public var preferredVideoStabilizationMode = AVCaptureVideoStabilizationMode.off
}

open class AVCaptureOutput: NSObject {
    public func connection(with: AVMediaType) -> AVCaptureConnection? { nil }
}

public protocol AVCaptureVideoDataOutputSampleBufferDelegate: AnyObject {
    func captureOutput(_: AVCaptureOutput, didOutput: CMSampleBuffer, from: AVCaptureConnection)
}

open class AVCaptureVideoDataOutput: AVCaptureOutput {
    public var alwaysDiscardsLateVideoFrames = true
    public var videoSettings: [String: Any]! = [:]
    public func setSampleBufferDelegate(
        _: (any AVCaptureVideoDataOutputSampleBufferDelegate)?, queue: DispatchQueue?
    ) {}
}

open class AVCaptureSession: NSObject {
    public struct Preset: Sendable {
        public static let inputPriority = Self()
    }
    public var sessionPreset = Preset()
    public func beginConfiguration() {}
    public func commitConfiguration() {}
    public func addInput(_: AVCaptureInput) {}
    public func addOutput(_: AVCaptureOutput) {}
    public func startRunning() {}
    public func stopRunning() {}
}
