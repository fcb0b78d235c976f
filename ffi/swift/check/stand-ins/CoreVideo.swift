// What the package uses of Apple's Core Video, as its documentation declares it, so that a compiler
// elsewhere can look at the code that does. Nothing here works.

public typealias CFString = String
public typealias OSType = UInt32
public typealias CVReturn = Int32
public final class CVBuffer: @unchecked Sendable {}
public typealias CVPixelBuffer = CVBuffer
public enum CVAttachmentMode: UInt32 { case shouldPropagate = 1 }

public struct CVPixelBufferLockFlags: OptionSet, Sendable {
    public let rawValue: UInt64
    public init(rawValue: UInt64) { self.rawValue = rawValue }
    public static let readOnly = Self(rawValue: 1)
}

public let kCVReturnSuccess: CVReturn = 0
public let kCVPixelBufferPixelFormatTypeKey: CFString = ""
public let kCVPixelFormatType_32BGRA: OSType = 0x4247_5241
public let kCVPixelFormatType_64RGBAHalf: OSType = 0x5247_6841
public let kCVPixelFormatType_420YpCbCr8BiPlanarFullRange: OSType = 0x3432_3066
public let kCVPixelFormatType_420YpCbCr8BiPlanarVideoRange: OSType = 0x3432_3076
public let kCVPixelFormatType_420YpCbCr10BiPlanarFullRange: OSType = 0x7866_3230
public let kCVPixelFormatType_420YpCbCr10BiPlanarVideoRange: OSType = 0x7834_3230
public let kCVImageBufferColorPrimariesKey: CFString = ""
public let kCVImageBufferColorPrimaries_P3_D65: CFString = ""
public let kCVImageBufferColorPrimaries_ITU_R_2020: CFString = ""
public let kCVImageBufferTransferFunctionKey: CFString = ""
public let kCVImageBufferTransferFunction_Linear: CFString = ""
public let kCVImageBufferTransferFunction_ITU_R_2100_HLG: CFString = ""
public let kCVImageBufferTransferFunction_SMPTE_ST_2084_PQ: CFString = ""
public let kCVImageBufferYCbCrMatrixKey: CFString = ""
public let kCVImageBufferYCbCrMatrix_ITU_R_709_2: CFString = ""
public let kCVImageBufferYCbCrMatrix_ITU_R_2020: CFString = ""

public func CVPixelBufferGetPixelFormatType(_: CVPixelBuffer) -> OSType { 0 }
public func CVPixelBufferLockBaseAddress(_: CVPixelBuffer, _: CVPixelBufferLockFlags) -> CVReturn { 0 }
@discardableResult
public func CVPixelBufferUnlockBaseAddress(_: CVPixelBuffer, _: CVPixelBufferLockFlags) -> CVReturn { 0 }
public func CVPixelBufferGetWidth(_: CVPixelBuffer) -> Int { 0 }
public func CVPixelBufferGetHeight(_: CVPixelBuffer) -> Int { 0 }
public func CVPixelBufferGetBytesPerRow(_: CVPixelBuffer) -> Int { 0 }
public func CVPixelBufferGetBaseAddress(_: CVPixelBuffer) -> UnsafeMutableRawPointer? { nil }
public func CVPixelBufferGetBaseAddressOfPlane(_: CVPixelBuffer, _: Int) -> UnsafeMutableRawPointer? { nil }
public func CVPixelBufferGetBytesPerRowOfPlane(_: CVPixelBuffer, _: Int) -> Int { 0 }
public func CVPixelBufferGetHeightOfPlane(_: CVPixelBuffer, _: Int) -> Int { 0 }
public func CVPixelBufferGetDataSize(_: CVPixelBuffer) -> Int { 0 }
public func CVBufferCopyAttachment(
    _: CVBuffer, _: CFString, _: UnsafeMutablePointer<CVAttachmentMode>?
) -> AnyObject? { nil }
