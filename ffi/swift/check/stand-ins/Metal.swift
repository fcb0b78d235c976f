// What the package uses of Apple's Metal, as its documentation declares it, so that a compiler elsewhere
// can look at the code that does. Nothing here works.

public enum MTLPixelFormat: UInt {
    case r8Unorm = 10, rgba8Unorm = 70, rgba8Unorm_srgb = 71, rgba16Float = 115, rgba32Float = 125
}

public struct MTLRegion {}

public func MTLRegionMake2D(_: Int, _: Int, _: Int, _: Int) -> MTLRegion { MTLRegion() }

open class MTLTextureDescriptor {
    public class func texture2DDescriptor(
        pixelFormat: MTLPixelFormat, width: Int, height: Int, mipmapped: Bool
    ) -> MTLTextureDescriptor { MTLTextureDescriptor() }
}

public protocol MTLTexture: AnyObject {
    func replace(
        region: MTLRegion, mipmapLevel: Int, withBytes: UnsafeRawPointer, bytesPerRow: Int
    )
}

public protocol MTLDevice: AnyObject {
    func makeTexture(descriptor: MTLTextureDescriptor) -> (any MTLTexture)?
}
