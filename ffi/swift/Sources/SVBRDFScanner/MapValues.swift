import SVBRDF

/// Values of maps, row by row: three a texel, one for roughness.
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

    public init(
        width: Int, height: Int, sampleMM: SIMD2<Float>, normal: [Float], diffuse: [Float], specular: [Float],
        roughness: [Float], anisotropy: [Float]? = nil, coat: [Float]? = nil
    ) {
        (self.width, self.height, self.sampleMM) = (width, height, sampleMM)
        (self.normal, self.diffuse, self.specular, self.roughness) = (normal, diffuse, specular, roughness)
        (self.anisotropy, self.coat) = (anisotropy, coat)
    }

    func made() throws -> OpaquePointer {
        var input = try filled(svbrdf_maps_input(), svbrdf_maps_input_init)
        (input.width, input.height) = (UInt32(clamping: width), UInt32(clamping: height))
        input.sample_mm = (sampleMM.x, sampleMM.y)
        let texels = Int(input.width).multipliedReportingOverflow(by: Int(input.height))
        let three = [normal, diffuse, specular] + [anisotropy, coat].compactMap { $0 }
        guard !texels.overflow, roughness.count == texels.partialValue,
              three.allSatisfy({ $0.count / 3 == texels.partialValue && $0.count % 3 == 0 })
        else {
            throw ScanError(SVBRDF_INVALID_ARGUMENT, "MapValues: width x height texels expected in every map")
        }
        // One array, so that all pointers are valid at once.
        let all = three.flatMap { $0 } + roughness
        var maps: OpaquePointer?
        try all.withUnsafeBufferPointer { floats in
            if let start = floats.baseAddress {
                let map = { (index: Int) in start + 3 * index * texels.partialValue }
                (input.normal, input.diffuse, input.specular) = (map(0), map(1), map(2))
                input.anisotropy = anisotropy == nil ? nil : map(3)
                input.coat = coat == nil ? nil : map(anisotropy == nil ? 3 : 4)
                input.roughness = map(three.count)
            }
            try check(svbrdf_maps_from_memory(&input, &maps))
        }
        return maps!
    }
}
