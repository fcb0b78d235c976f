#if canImport(Metal)
import Metal

extension TextureData {
    /// A texture of the bytes; nil where the device has no memory for it.
    /// - Parameter srgb: for bytes of diffuse and specular maps.
    public func makeTexture(on device: any MTLDevice, srgb: Bool = false) -> (any MTLTexture)? {
        let pixels: MTLPixelFormat = switch format {
        case .rgba16Float: .rgba16Float
        case .rgba32Float: .rgba32Float
        case .rgba8: srgb ? .rgba8Unorm_srgb : .rgba8Unorm
        case .r8: .r8Unorm
        }
        let descriptor = MTLTextureDescriptor.texture2DDescriptor(
            pixelFormat: pixels, width: width, height: height, mipmapped: false
        )
        guard let texture = device.makeTexture(descriptor: descriptor) else { return nil }
        bytes.withUnsafeBytes { all in
            guard let start = all.baseAddress else { return }
            let region = MTLRegionMake2D(0, 0, width, height)
            texture.replace(region: region, mipmapLevel: 0, withBytes: start, bytesPerRow: bytesPerRow)
        }
        return texture
    }
}
#endif
