import SVBRDF

/// Values of maps, row by row: three a texel, one for roughnesses.
public struct MapValues: Sendable {
    public var width: Int
    public var height: Int
    /// Size of the sample, mm.
    public var sampleMM: SIMD2<Float>
    /// Unit vectors: X right, Y up, Z out of the surface.
    public var normal: [Float]
    /// Linear Rec. 709.
    public var diffuse: [Float]
    /// F0, linear Rec. 709.
    public var specular: [Float]
    /// Of the smaller alpha where there is anisotropy.
    public var roughness: [Float]
    /// As in `MapKind.anisotropy`; nil: isotropic.
    public var anisotropy: [Float]?
    /// As in `MapKind.coat`; nil: none.
    public var coat: [Float]?
    /// As in `MapKind.sheen`, with `sheenRoughness`; nil: none.
    public var sheen: [Float]?
    /// As in `MapKind.sheenRoughness`.
    public var sheenRoughness: [Float]?

    public init(
        width: Int, height: Int, sampleMM: SIMD2<Float>, normal: [Float], diffuse: [Float], specular: [Float],
        roughness: [Float], anisotropy: [Float]? = nil, coat: [Float]? = nil, sheen: [Float]? = nil,
        sheenRoughness: [Float]? = nil
    ) {
        (self.width, self.height, self.sampleMM) = (width, height, sampleMM)
        (self.normal, self.diffuse, self.specular, self.roughness) = (normal, diffuse, specular, roughness)
        (self.anisotropy, self.coat) = (anisotropy, coat)
        (self.sheen, self.sheenRoughness) = (sheen, sheenRoughness)
    }

    func made() throws -> OpaquePointer {
        var input = try filled(svbrdf_maps_input(), svbrdf_maps_input_init)
        (input.width, input.height) = (UInt32(clamping: width), UInt32(clamping: height))
        input.sample_mm = (sampleMM.x, sampleMM.y)
        let texels = Int(input.width).multipliedReportingOverflow(by: Int(input.height))
        let three = [normal, diffuse, specular] + [anisotropy, coat, sheen].compactMap { $0 }
        let one = [roughness] + [sheenRoughness].compactMap { $0 }
        guard !texels.overflow, one.allSatisfy({ $0.count == texels.partialValue }),
              three.allSatisfy({ $0.count / 3 == texels.partialValue && $0.count % 3 == 0 })
        else {
            throw ScanError(SVBRDF_INVALID_ARGUMENT, "MapValues: width x height texels expected in every map")
        }
        // One array, so that all pointers are valid at once.
        let all = (three + one).flatMap { $0 }
        var maps: OpaquePointer?
        try all.withUnsafeBufferPointer { floats in
            if let start = floats.baseAddress {
                var place = 0
                func next(_ values: [Float]?) -> UnsafePointer<Float>? {
                    guard let values else { return nil }
                    defer { place += values.count }
                    return start + place
                }
                (input.normal, input.diffuse, input.specular) = (next(normal), next(diffuse), next(specular))
                (input.anisotropy, input.coat, input.sheen) = (next(anisotropy), next(coat), next(sheen))
                (input.roughness, input.sheen_roughness) = (next(roughness), next(sheenRoughness))
            }
            try check(svbrdf_maps_from_memory(&input, &maps))
        }
        return maps!
    }
}
