import Foundation
import SVBRDF

public enum MapKind: Hashable, Sendable, CaseIterable {
    case normal, diffuse, specular, roughness
    /// Y down.
    case normalDirectX
    /// Of materials with `Lobes.anisotropy`: cosine and sine of the direction of the larger alpha,
    /// counter-clockwise from X, and strength, as glTF's KHR_materials_anisotropy.
    case anisotropy
    /// Of materials with `Lobes.coat`: weight, roughness, 0, as glTF's KHR_materials_clearcoat.
    case coat
    /// Of materials with `Lobes.sheen`: colour, linear Rec. 709, as glTF's KHR_materials_sheen.
    case sheen
    /// Of materials with `Lobes.sheen`: roughness of the sheen.
    case sheenRoughness

    var code: svbrdf_map {
        switch self {
        case .normal: svbrdf_map(SVBRDF_MAP_NORMAL)
        case .diffuse: svbrdf_map(SVBRDF_MAP_DIFFUSE)
        case .specular: svbrdf_map(SVBRDF_MAP_SPECULAR)
        case .roughness: svbrdf_map(SVBRDF_MAP_ROUGHNESS)
        case .normalDirectX: svbrdf_map(SVBRDF_MAP_NORMAL_DIRECTX)
        case .anisotropy: svbrdf_map(SVBRDF_MAP_ANISOTROPY)
        case .coat: svbrdf_map(SVBRDF_MAP_COAT)
        case .sheen: svbrdf_map(SVBRDF_MAP_SHEEN)
        case .sheenRoughness: svbrdf_map(SVBRDF_MAP_SHEEN_ROUGHNESS)
        }
    }
}

/// Optional lobes of a material.
public struct Lobes: OptionSet, Hashable, Sendable {
    public let rawValue: UInt32

    public init(rawValue: UInt32) {
        self.rawValue = rawValue
    }

    /// The highlight is longer in one direction: `MapKind.anisotropy`.
    public static let anisotropy = Self(rawValue: UInt32(SVBRDF_LOBE_ANISOTROPY))
    /// A clear coat: `MapKind.coat`.
    public static let coat = Self(rawValue: UInt32(SVBRDF_LOBE_COAT))
    /// Sheen of cloth: `MapKind.sheen` and `MapKind.sheenRoughness`.
    public static let sheen = Self(rawValue: UInt32(SVBRDF_LOBE_SHEEN))
}

/// Texels as Metal takes them.
public enum TexelFormat: Hashable, Sendable, CaseIterable {
    /// `.rgba16Float`: linear. Roughness: 1 (occlusion), roughness, 0 (metalness).
    case rgba16Float
    /// `.rgba32Float`.
    case rgba32Float
    /// Bytes: `.rgba8Unorm_srgb` for diffuse, specular and sheen, `.rgba8Unorm` for the others.
    case rgba8
    /// `.r8Unorm`, for roughness and sheen roughness.
    case r8

    var code: svbrdf_map_format {
        switch self {
        case .rgba16Float: svbrdf_map_format(SVBRDF_MAP_FORMAT_RGBA16F)
        case .rgba32Float: svbrdf_map_format(SVBRDF_MAP_FORMAT_RGBA32F)
        case .rgba8: svbrdf_map_format(SVBRDF_MAP_FORMAT_RGBA8)
        case .r8: svbrdf_map_format(SVBRDF_MAP_FORMAT_R8)
        }
    }

    public var bytesPerTexel: Int {
        switch self {
        case .rgba16Float: 8
        case .rgba32Float: 16
        case .rgba8: 4
        case .r8: 1
        }
    }
}

/// A map for `MTLTexture.replace(region:mipmapLevel:withBytes:bytesPerRow:)`.
public struct TextureData: Sendable {
    public let format: TexelFormat
    public let width: Int
    public let height: Int
    public let bytesPerRow: Int
    /// `height` rows.
    public let bytes: Data
}

/// Camera and light of a rendering: mm from the sample's centre, X right, Y up, Z towards the camera.
public struct Lighting: Sendable {
    public var cameraMM = SIMD3<Float>(0, 0, 300)
    public var lightMM = SIMD3<Float>(0, 0, 300)
    /// pi: a white matt texel that faces the light comes out at 1.
    public var power = SIMD3<Float>(repeating: .pi)
    public var ambient = SIMD3<Float>()

    public init() {}
}

/// Maps of a moment. They do not change and need no scanner.
public final class MaterialMaps: @unchecked Sendable {
    public let width: Int
    public let height: Int
    /// Size of the sample, mm.
    public let sampleMM: SIMD2<Float>
    private let maps: OpaquePointer

    /// Takes the handle over.
    init(_ maps: OpaquePointer) throws {
        var (width, height, sample) = (UInt32(0), UInt32(0), SIMD2<Float>())
        let status = withUnsafeMutableBytes(of: &sample) { bytes in
            svbrdf_maps_size(maps, &width, &height, bytes.bindMemory(to: Float.self).baseAddress)
        }
        guard status == SVBRDF_OK else {
            let fault = ScanError(status)
            svbrdf_maps_destroy(maps)
            throw fault
        }
        (self.width, self.height, sampleMM, self.maps) = (Int(width), Int(height), sample, maps)
    }

    /// Maps of values in memory, to be rendered, reduced or exported.
    public convenience init(_ values: MapValues) throws {
        try self.init(values.made())
    }

    deinit {
        svbrdf_maps_destroy(maps)
    }

    /// Lobes that the material shows. Without one of them, its map is `ScanStatus.noLobe`.
    public var lobes: Lobes {
        var found: svbrdf_lobes = 0
        svbrdf_maps_lobes(maps, &found)
        return Lobes(rawValue: found)
    }

    /// A map as bytes of a texture; rows begin at multiples of `alignment` bytes.
    public func texture(
        _ map: MapKind, _ format: TexelFormat = .rgba16Float, alignment: Int = 1
    ) throws -> TextureData {
        try fill(format, alignment) { data, bytes, row in
            svbrdf_maps_copy(maps, map.code, format.code, data, bytes, row)
        }
    }

    /// The material under a light, as an image.
    public func rendered(
        _ lighting: Lighting = Lighting(), _ format: TexelFormat = .rgba8, alignment: Int = 1
    ) throws -> TextureData {
        var options = try filled(svbrdf_render_options(), svbrdf_render_options_init)
        let (camera, light) = (lighting.cameraMM, lighting.lightMM)
        options.camera_mm = (camera.x, camera.y, camera.z)
        options.light_mm = (light.x, light.y, light.z)
        options.light_power = (lighting.power.x, lighting.power.y, lighting.power.z)
        options.ambient = (lighting.ambient.x, lighting.ambient.y, lighting.ambient.z)
        return try fill(format, alignment) { data, bytes, row in
            svbrdf_maps_render(maps, &options, format.code, data, bytes, row)
        }
    }

    private func fill(
        _ format: TexelFormat, _ alignment: Int,
        _ body: (UnsafeMutableRawPointer?, Int, Int) -> svbrdf_status
    ) throws -> TextureData {
        guard alignment > 0 else {
            throw ScanError(SVBRDF_INVALID_ARGUMENT, "alignment: a positive number expected")
        }
        let row = (width * format.bytesPerTexel + alignment - 1) / alignment * alignment
        var bytes = Data(count: row * height)
        try bytes.withUnsafeMutableBytes { try check(body($0.baseAddress, $0.count, row)) }
        return TextureData(
            format: format, width: width, height: height, bytesPerRow: row, bytes: bytes
        )
    }

    /// One number for each map, of maps that were taken with it.
    public func uncertainty() throws -> Uncertainty {
        var found = try filled(svbrdf_uncertainty(), svbrdf_uncertainty_init)
        try check(svbrdf_maps_uncertainty(maps, &found))
        return Uncertainty(found)
    }

    /// A standard deviation at every texel, of maps that were taken with it. Of `coat` (weight, roughness, 0), `sheen`
    /// (red, green, blue) and `anisotropy` three: of ln(larger alpha / smaller alpha) times the cosine and times the
    /// sine of twice the direction's angle, 0.
    public func deviations(of map: MapKind) throws -> [Float] {
        var view = try filled(svbrdf_map_view(), svbrdf_map_view_init)
        try check(svbrdf_maps_deviations(maps, map.code, &view))
        let bytes = UnsafeRawBufferPointer(start: view.data, count: view.bytes)
        return withExtendedLifetime(self) { Array(bytes.bindMemory(to: Float.self)) }
    }

    /// Maps at 1 / 2^level of the size.
    public func reduced(by level: Int) throws -> MaterialMaps {
        var smaller: OpaquePointer?
        try check(svbrdf_maps_reduced(maps, UInt32(clamping: level), &smaller))
        return try MaterialMaps(smaller!)
    }

    /// Writes PNG, OpenEXR and a preview into a folder.
    public func export(to folder: URL) throws {
        try check(svbrdf_maps_export(maps, nil, folder.path))
    }
}
