import Foundation
import SVBRDF

/// A photo as a file in memory: JPEG, PNG, TIFF, OpenEXR or DNG.
public struct PhotoFile: Sendable {
    public var content: Data
    /// Relative exposure; nil: that of the metadata.
    public var exposure: Float?
    /// Curve of the values; nil: that of the file.
    public var transfer: Transfer?
    /// How far the upright image is turned clockwise, degrees; the camera describes the turned image.
    public var rotation: Int
    /// Largest image, pixels; nil: 100 million.
    public var maxPixels: UInt64?
    /// Most memory that decoding may take, bytes; nil: 6 GiB.
    public var maxBytes: UInt64?

    public init(
        _ content: Data, exposure: Float? = nil, transfer: Transfer? = nil, rotation: Int = 0,
        maxPixels: UInt64? = nil, maxBytes: UInt64? = nil
    ) {
        (self.content, self.exposure, self.transfer) = (content, exposure, transfer)
        (self.rotation, self.maxPixels, self.maxBytes) = (rotation, maxPixels, maxBytes)
    }

    /// The metadata of the file, without reading its pixels.
    public func lookAt() throws -> FileInfo {
        var info = try filled(svbrdf_file_info(), svbrdf_file_info_init)
        try content.withUnsafeBytes { bytes in
            try check(svbrdf_file_look_at(bytes.baseAddress, bytes.count, &info))
        }
        return FileInfo(info)
    }

    func add(to session: Session) throws -> (outcome: Outcome, info: FileInfo) {
        var options = try filled(svbrdf_file_options(), svbrdf_file_options_init)
        options.exposure = exposure ?? 0
        options.transfer = transfer?.code ?? 0
        options.rotation = UInt32(clamping: rotation)
        (options.max_pixels, options.max_bytes) = (maxPixels ?? 0, maxBytes ?? 0)
        var info = try filled(svbrdf_file_info(), svbrdf_file_info_init)
        var report = try filled(svbrdf_photo_report(), svbrdf_photo_report_init)
        let status = content.withUnsafeBytes { bytes in
            svbrdf_session_add_photo_file(
                session.handle, bytes.baseAddress, bytes.count, &options, &info, &report)
        }
        if status != SVBRDF_REJECTED { try check(status) }
        return (Outcome(report), FileInfo(info))
    }
}

/// Remarks about a photo's file.
public struct FileRemarks: OptionSet, Hashable, Sendable {
    public let rawValue: UInt32

    public init(rawValue: UInt32) {
        self.rawValue = rawValue
    }

    /// Its colour metadata cannot be used; it was read as sRGB.
    public static let profileUnusable = Self(rawValue: UInt32(SVBRDF_REMARK_PROFILE_UNUSABLE))
    /// It has a gain map (Ultra HDR), which is left out.
    public static let gainMap = Self(rawValue: UInt32(SVBRDF_REMARK_GAIN_MAP))
    /// Its orientation tag mirrors it.
    public static let mirrored = Self(rawValue: UInt32(SVBRDF_REMARK_MIRRORED))
    /// It does not say how it was exposed.
    public static let noExposure = Self(rawValue: UInt32(SVBRDF_REMARK_NO_EXPOSURE))
    /// It says that the flash did not fire.
    public static let noFlash = Self(rawValue: UInt32(SVBRDF_REMARK_NO_FLASH))
    /// Its end marker is missing, and nothing else.
    public static let endMissing = Self(rawValue: UInt32(SVBRDF_REMARK_END_MISSING))
    /// It is gray, and so will the maps be.
    public static let gray = Self(rawValue: UInt32(SVBRDF_REMARK_GRAY))
}

/// Metadata of a photo's file; unknown values are 0 or empty. Photos that differ in
/// maker, model, lens, focal lengths, zoom or size need scanners of their own.
public struct FileInfo: Hashable, Sendable {
    /// As the sensor has it, px.
    public let width, height: Int
    /// How far the stored image is turned clockwise to stand upright, degrees.
    public let uprightDegrees: Int
    /// Floats or raw values.
    public let isLinear: Bool
    /// Exposure time * ISO / F-number², relative.
    public let exposure: Float
    /// Focal length of the lens, and on film of 36 x 24 mm, mm.
    public let focalMM, focal35MM: Float
    public let digitalZoom: Float
    public let remarks: FileRemarks
    public let make, model, lens: String
    /// Digits whose order, as text, is that of time.
    public let taken: String

    init(_ info: svbrdf_file_info) {
        (width, height) = (Int(info.width), Int(info.height))
        (uprightDegrees, isLinear) = (Int(info.upright_deg), info.is_linear == 1)
        (exposure, focalMM, focal35MM) = (info.exposure, info.focal_mm, info.focal_35mm)
        (digitalZoom, remarks) = (info.digital_zoom, FileRemarks(rawValue: info.remarks))
        (make, model) = (text(info.make), text(info.model))
        (lens, taken) = (text(info.lens), text(info.taken))
    }
}
