#if canImport(CoreVideo)
import CoreVideo
import SVBRDF

extension Photo {
    /// A buffer of the camera, read in place: 32BGRA, 420 of 8 or 10 bits in two planes, or 64RGBAHalf. It
    /// stays locked for reading, and the camera's, as long as the photo lives.
    ///
    /// Primaries, transfer function and matrix are those of its attachments where they are not stated.
    /// ITU-R BT.709's and unknown curves are taken as sRGB's: the phone's further tone mapping is
    /// estimated from the board.
    public convenience init(
        _ buffer: CVPixelBuffer, transfer: Transfer? = nil, primaries: Primaries? = nil,
        rotation: Int = 0
    ) throws {
        let code = CVPixelBufferGetPixelFormatType(buffer)
        guard let layout = Layout(code) else {
            throw ScanError(SVBRDF_UNSUPPORTED, "CVPixelBuffer: pixel format \(code) is not read")
        }
        guard CVPixelBufferLockBaseAddress(buffer, .readOnly) == kCVReturnSuccess else {
            throw ScanError(SVBRDF_INVALID_ARGUMENT, "CVPixelBuffer: it cannot be locked")
        }
        guard let planes = layout.planes(buffer) else {
            CVPixelBufferUnlockBaseAddress(buffer, .readOnly)
            throw ScanError(SVBRDF_INVALID_ARGUMENT, "CVPixelBuffer: it has no memory")
        }
        self.init(
            layout.format, width: CVPixelBufferGetWidth(buffer),
            height: CVPixelBufferGetHeight(buffer), planes: planes,
            transfer: transfer ?? attachedTransfer(buffer),
            primaries: primaries ?? attachedPrimaries(buffer),
            yuvMatrix: YUVMatrix(attachedMatrix(buffer), fullRange: layout.fullRange),
            rotation: rotation, saturation: layout.format == .rgba16Float ? 1 : .infinity,
            release: { CVPixelBufferUnlockBaseAddress(buffer, .readOnly) }
        )
    }
}

private struct Layout {
    let format: PixelFormat
    var fullRange = true

    init?(_ code: OSType) {
        switch code {
        case kCVPixelFormatType_32BGRA: format = .bgra8
        case kCVPixelFormatType_64RGBAHalf: format = .rgba16Float
        case kCVPixelFormatType_420YpCbCr8BiPlanarFullRange: format = .yuv420
        case kCVPixelFormatType_420YpCbCr8BiPlanarVideoRange: (format, fullRange) = (.yuv420, false)
        case kCVPixelFormatType_420YpCbCr10BiPlanarFullRange: format = .p010
        case kCVPixelFormatType_420YpCbCr10BiPlanarVideoRange: (format, fullRange) = (.p010, false)
        default: return nil
        }
    }

    /// Of a buffer that is locked.
    func planes(_ buffer: CVPixelBuffer) -> [Plane]? {
        guard format == .yuv420 || format == .p010 else {
            guard let data = CVPixelBufferGetBaseAddress(buffer) else { return nil }
            let row = CVPixelBufferGetBytesPerRow(buffer)
            let bytes = row * CVPixelBufferGetHeight(buffer)
            return [Plane(data: UnsafeRawPointer(data), bytes: bytes, bytesPerRow: row)]
        }
        let sample = format == .p010 ? 2 : 1
        guard let luma = plane(buffer, 0, sample), let blue = plane(buffer, 1, 2 * sample) else {
            return nil
        }
        // Blue and red by turns: red begins one sample later.
        var red = blue
        red.data += sample
        red.bytes -= sample
        return [luma, blue, red]
    }

    private func plane(_ buffer: CVPixelBuffer, _ index: Int, _ bytesPerPixel: Int) -> Plane? {
        guard let data = CVPixelBufferGetBaseAddressOfPlane(buffer, index) else { return nil }
        let row = CVPixelBufferGetBytesPerRowOfPlane(buffer, index)
        let bytes = row * CVPixelBufferGetHeightOfPlane(buffer, index)
        return Plane(
            data: UnsafeRawPointer(data), bytes: bytes, bytesPerRow: row, bytesPerPixel: bytesPerPixel
        )
    }
}

private func attachment(_ buffer: CVPixelBuffer, _ key: CFString) -> String? {
    CVBufferCopyAttachment(buffer, key, nil) as? String
}

private func text(_ constant: CFString) -> String {
    constant as String
}

private func attachedPrimaries(_ buffer: CVPixelBuffer) -> Primaries {
    switch attachment(buffer, kCVImageBufferColorPrimariesKey) {
    case text(kCVImageBufferColorPrimaries_P3_D65): .displayP3
    case text(kCVImageBufferColorPrimaries_ITU_R_2020): .rec2020
    default: .rec709
    }
}

private func attachedTransfer(_ buffer: CVPixelBuffer) -> Transfer {
    switch attachment(buffer, kCVImageBufferTransferFunctionKey) {
    case text(kCVImageBufferTransferFunction_Linear): .linear
    case text(kCVImageBufferTransferFunction_ITU_R_2100_HLG): .hlg
    case text(kCVImageBufferTransferFunction_SMPTE_ST_2084_PQ): .pq
    default: .srgb
    }
}

private func attachedMatrix(_ buffer: CVPixelBuffer) -> YUVMatrix.Coefficients {
    switch attachment(buffer, kCVImageBufferYCbCrMatrixKey) {
    case text(kCVImageBufferYCbCrMatrix_ITU_R_709_2): .bt709
    case text(kCVImageBufferYCbCrMatrix_ITU_R_2020): .bt2020
    default: .bt601
    }
}
#endif
