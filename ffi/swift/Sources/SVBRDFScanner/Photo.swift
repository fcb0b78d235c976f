import SVBRDF

/// Layout of an image in memory.
public struct PixelFormat: RawRepresentable, Hashable, Sendable {
    public let rawValue: UInt32

    public init(rawValue: UInt32) {
        self.rawValue = rawValue
    }

    public static let rgb8 = Self(rawValue: UInt32(SVBRDF_PIXEL_RGB8))
    public static let rgba8 = Self(rawValue: UInt32(SVBRDF_PIXEL_RGBA8))
    public static let bgra8 = Self(rawValue: UInt32(SVBRDF_PIXEL_BGRA8))
    public static let rgb16 = Self(rawValue: UInt32(SVBRDF_PIXEL_RGB16))
    public static let rgba16 = Self(rawValue: UInt32(SVBRDF_PIXEL_RGBA16))
    public static let rgba16Float = Self(rawValue: UInt32(SVBRDF_PIXEL_RGBA_F16))
    public static let rgb32Float = Self(rawValue: UInt32(SVBRDF_PIXEL_RGB_F32))
    public static let rgba32Float = Self(rawValue: UInt32(SVBRDF_PIXEL_RGBA_F32))
    /// Luma, then U and V at half the size.
    public static let yuv420 = Self(rawValue: UInt32(SVBRDF_PIXEL_YUV420))
    /// The same in 16-bit words, of which the upper 10 bits count.
    public static let p010 = Self(rawValue: UInt32(SVBRDF_PIXEL_P010))
}

/// Curve of stored values.
public enum Transfer: Hashable, Sendable {
    case linear, srgb, gamma22, hlg, pq

    var code: svbrdf_transfer {
        switch self {
        case .linear: svbrdf_transfer(SVBRDF_TRANSFER_LINEAR)
        case .srgb: svbrdf_transfer(SVBRDF_TRANSFER_SRGB)
        case .gamma22: svbrdf_transfer(SVBRDF_TRANSFER_GAMMA22)
        case .hlg: svbrdf_transfer(SVBRDF_TRANSFER_HLG)
        case .pq: svbrdf_transfer(SVBRDF_TRANSFER_PQ)
        }
    }
}

/// Primaries of RGB.
public enum Primaries: Hashable, Sendable {
    case rec709, displayP3, rec2020

    var code: svbrdf_primaries {
        switch self {
        case .rec709: svbrdf_primaries(SVBRDF_PRIMARIES_REC709)
        case .displayP3: svbrdf_primaries(SVBRDF_PRIMARIES_DISPLAY_P3)
        case .rec2020: svbrdf_primaries(SVBRDF_PRIMARIES_REC2020)
        }
    }
}

/// How luma and chroma were made.
public struct YUVMatrix: Hashable, Sendable {
    public enum Coefficients: Hashable, Sendable {
        case bt601, bt709, bt2020
    }

    public var coefficients: Coefficients
    /// Whether all values are used; else luma has 16 to 235 of 8 bits.
    public var fullRange: Bool

    public init(_ coefficients: Coefficients, fullRange: Bool) {
        (self.coefficients, self.fullRange) = (coefficients, fullRange)
    }

    var code: svbrdf_yuv_matrix {
        switch (coefficients, fullRange) {
        case (.bt601, true): svbrdf_yuv_matrix(SVBRDF_YUV_BT601_FULL)
        case (.bt601, false): svbrdf_yuv_matrix(SVBRDF_YUV_BT601_LIMITED)
        case (.bt709, true): svbrdf_yuv_matrix(SVBRDF_YUV_BT709_FULL)
        case (.bt709, false): svbrdf_yuv_matrix(SVBRDF_YUV_BT709_LIMITED)
        case (.bt2020, true): svbrdf_yuv_matrix(SVBRDF_YUV_BT2020_FULL)
        case (.bt2020, false): svbrdf_yuv_matrix(SVBRDF_YUV_BT2020_LIMITED)
        }
    }
}

/// Where the pixels of a plane lie.
public struct Plane {
    public var data: UnsafeRawPointer
    /// Readable bytes from there on.
    public var bytes: Int
    public var bytesPerRow: Int
    /// Bytes from a pixel to the next; 0: no gap.
    public var bytesPerPixel: Int

    public init(data: UnsafeRawPointer, bytes: Int, bytesPerRow: Int, bytesPerPixel: Int = 0) {
        (self.data, self.bytes) = (data, bytes)
        (self.bytesPerRow, self.bytesPerPixel) = (bytesPerRow, bytesPerPixel)
    }
}

/// An image in memory. It is sendable because nobody writes to it.
public final class Photo: @unchecked Sendable {
    public let format: PixelFormat
    public let width: Int
    public let height: Int
    public let transfer: Transfer
    public let primaries: Primaries
    public let yuvMatrix: YUVMatrix
    /// How far it is turned clockwise before use, degrees; the camera describes the turned image.
    public let rotation: Int
    /// For floats: the level at which a channel is clipped.
    public let saturation: Float
    private let planes: [Plane]
    private let release: () -> Void

    /// An image where it lies: one plane, or three for YUV. `release` is called when the photo is not
    /// needed any more.
    public init(
        _ format: PixelFormat, width: Int, height: Int, planes: [Plane], transfer: Transfer = .srgb,
        primaries: Primaries = .rec709, yuvMatrix: YUVMatrix = YUVMatrix(.bt601, fullRange: true),
        rotation: Int = 0, saturation: Float = .infinity, release: @escaping () -> Void
    ) {
        (self.format, self.width, self.height) = (format, width, height)
        (self.transfer, self.primaries, self.yuvMatrix) = (transfer, primaries, yuvMatrix)
        (self.rotation, self.saturation) = (rotation, saturation)
        (self.planes, self.release) = (planes, release)
    }

    /// A copy of interleaved pixels without gaps.
    public convenience init(
        _ format: PixelFormat, width: Int, height: Int, pixels: [UInt8], transfer: Transfer = .srgb,
        primaries: Primaries = .rec709
    ) {
        let copy = UnsafeMutableRawBufferPointer.allocate(byteCount: pixels.count, alignment: 16)
        copy.copyBytes(from: pixels)
        let plane = Plane(
            data: UnsafeRawPointer(copy.baseAddress!), bytes: pixels.count,
            bytesPerRow: pixels.count / max(height, 1)
        )
        self.init(
            format, width: width, height: height, planes: [plane], transfer: transfer,
            primaries: primaries, release: { copy.deallocate() }
        )
    }

    deinit {
        release()
    }

    func image() throws -> svbrdf_image {
        var image = try filled(svbrdf_image(), svbrdf_image_init)
        image.format = format.rawValue
        (image.width, image.height) = (UInt32(clamping: width), UInt32(clamping: height))
        (image.transfer, image.primaries) = (transfer.code, primaries.code)
        (image.yuv_matrix, image.rotation) = (yuvMatrix.code, UInt32(clamping: rotation))
        image.saturation = saturation
        let all = planes.map { plane in
            svbrdf_plane(
                data: plane.data, bytes: plane.bytes, row_stride: plane.bytesPerRow,
                pixel_stride: plane.bytesPerPixel
            )
        }
        image.planes.0 = all.first ?? image.planes.0
        if all.count > 2 { (image.planes.1, image.planes.2) = (all[1], all[2]) }
        return image
    }
}

/// The light of a photo.
public enum Flash: Hashable, Sendable {
    case unknown, off, fired, torch

    var code: svbrdf_flash {
        switch self {
        case .unknown: svbrdf_flash(SVBRDF_FLASH_UNKNOWN)
        case .off: svbrdf_flash(SVBRDF_FLASH_OFF)
        case .fired: svbrdf_flash(SVBRDF_FLASH_FIRED)
        case .torch: svbrdf_flash(SVBRDF_FLASH_TORCH)
        }
    }
}

/// Metadata of a photo.
public struct PhotoInfo: Sendable {
    /// Exposure time times sensitivity over that of the first photo (with a torch).
    public var exposure: Float = 1
    public var flash = Flash.unknown
    /// Handed back with the result.
    public var timestamp: Int64 = 0
    /// Focal length as for 35 mm film, mm, for a camera that is estimated; 0: not known.
    public var focal35MM: Float = 0
    /// The same view without flash, which is subtracted in linear light.
    public var ambient: Photo?
    /// Its exposure on the scale of `exposure`; 0: the photo's.
    public var ambientExposure: Float = 0

    public init(flash: Flash = .unknown, exposure: Float = 1, timestamp: Int64 = 0) {
        (self.flash, self.exposure, self.timestamp) = (flash, exposure, timestamp)
    }
}

extension Photo {
    /// Hands a photo over as C takes it, valid during the call.
    func with<Result>(
        _ info: PhotoInfo,
        _ body: (UnsafePointer<svbrdf_image>, UnsafePointer<svbrdf_photo_info>) throws -> Result
    ) throws -> Result {
        var stated = try filled(svbrdf_photo_info(), svbrdf_photo_info_init)
        (stated.exposure, stated.flash) = (info.exposure, info.flash.code)
        (stated.timestamp_ns, stated.focal_35mm) = (info.timestamp, info.focal35MM)
        stated.ambient_exposure = info.ambientExposure
        return try withExtendedLifetime((self, info.ambient)) {
            try withUnsafePointer(to: image()) { image in
                guard let ambient = info.ambient else { return try body(image, &stated) }
                return try withUnsafePointer(to: ambient.image()) { ambient in
                    stated.ambient = ambient
                    return try body(image, &stated)
                }
            }
        }
    }
}
