import SVBRDF

/// Scene of the photos, and settings of the maps. Lengths are in millimetres.
public struct ScanOptions: Sendable {
    public var widthMM: Float = 100
    public var heightMM: Float = 100
    /// nil: the board that `svbrdf board` prints.
    public var board: Board?
    /// nil: estimated from the photos so far.
    public var camera: Camera?
    /// Position of the lamp in the camera frame (x right, y down, z forward); nil: not known.
    public var flashOffsetMM: SIMD3<Double>?
    /// Texels along each side of the maps: 256, 512, 1024 or 2048.
    public var resolution = 256
    public var refine = true
    /// Threads of the fit; 0: one per core, at most 4.
    public var threads = 0
    /// Most bytes a scan may need, networks apart; 0: any amount.
    public var memoryLimit: UInt64 = 0
    /// Height of the sample's surface above the printed side, -5 to 20; nil: estimated.
    public var elevationMM: Double?

    public init() {}
}

/// Intrinsics, px; pixel (0, 0) is the centre of the top-left pixel; OpenCV's distortion.
public struct Camera: Hashable, Sendable {
    public var width: Int
    public var height: Int
    public var fx: Double
    public var fy: Double
    public var cx: Double
    public var cy: Double
    /// k1, k2, p1, p2, k3.
    public var distortion: [Double] = [0, 0, 0, 0, 0]

    public init(width: Int, height: Int, fx: Double, fy: Double, cx: Double? = nil, cy: Double? = nil) {
        (self.width, self.height, self.fx, self.fy) = (width, height, fx, fy)
        self.cx = cx ?? 0.5 * Double(width - 1)
        self.cy = cy ?? 0.5 * Double(height - 1)
    }

    func filled() throws -> svbrdf_camera {
        guard distortion.count == 5 else {
            throw ScanError(SVBRDF_INVALID_ARGUMENT, "distortion: five numbers expected")
        }
        var camera = try SVBRDFScanner.filled(svbrdf_camera(), svbrdf_camera_init)
        (camera.width, camera.height) = (UInt32(clamping: width), UInt32(clamping: height))
        (camera.fx, camera.fy, camera.cx, camera.cy) = (fx, fy, cx, cy)
        let d = distortion
        camera.distortion = (d[0], d[1], d[2], d[3], d[4])
        return camera
    }
}

/// A printed board: squares round a rectangular hole; rows + columns is odd.
public struct Board: Hashable, Sendable {
    public var rows: Int
    public var columns: Int
    public var squareMM: Double
    /// Rows of the hole, from the printed top.
    public var holeRows: Range<Int>
    /// Columns of the hole, from the left.
    public var holeColumns: Range<Int>
    public var topLeftWhite = false
    /// Whether gray patches are printed below the ring as `svbrdf board` does.
    public var patches = false
    /// With a marker in every printed white square: OpenCV's name, e.g. "DICT_4X4_250".
    public var dictionary: String?
    public var markerMM = 0.0

    public init(
        rows: Int, columns: Int, squareMM: Double, holeRows: Range<Int>, holeColumns: Range<Int>
    ) {
        (self.rows, self.columns, self.squareMM) = (rows, columns, squareMM)
        (self.holeRows, self.holeColumns) = (holeRows, holeColumns)
    }

    /// `dictionary` is that of this board, in memory.
    func filled(_ dictionary: UnsafePointer<CChar>?) throws -> svbrdf_board {
        var board = try SVBRDFScanner.filled(svbrdf_board(), svbrdf_board_init)
        if dictionary != nil {
            board.kind = svbrdf_board_kind(SVBRDF_BOARD_CHARUCO_RING)
            (board.dictionary, board.marker_mm) = (dictionary, markerMM)
        }
        (board.rows, board.cols) = (UInt32(clamping: rows), UInt32(clamping: columns))
        board.hole_row_start = UInt32(clamping: holeRows.lowerBound)
        board.hole_row_end = UInt32(clamping: holeRows.upperBound)
        board.hole_col_start = UInt32(clamping: holeColumns.lowerBound)
        board.hole_col_end = UInt32(clamping: holeColumns.upperBound)
        board.square_mm = squareMM
        (board.top_left_white, board.patches) = (topLeftWhite ? 1 : 0, patches ? 1 : 0)
        return board
    }
}

extension ScanOptions {
    /// Hands the options over as C takes them, valid during the call.
    func with<Result>(
        _ body: (inout svbrdf_session_options) throws -> Result
    ) throws -> Result {
        var options = try filled(svbrdf_session_options(), svbrdf_session_options_init)
        options.sample_mm = (widthMM, heightMM)
        options.resolution = UInt32(clamping: resolution)
        options.refine = refine ? 1 : 0
        options.threads = UInt32(clamping: threads)
        options.memory_limit_bytes = memoryLimit
        if let elevationMM { options.elevation_mm = elevationMM }
        let offset = flashOffsetMM.map { [$0.x, $0.y, $0.z] }
        return try withText(board?.dictionary) { dictionary in
            try withPointer(board.map { try $0.filled(dictionary) }) { board in
                try withPointer(camera.map { try $0.filled() }) { camera in
                    try withArray(offset) { offset in
                        (options.board, options.camera, options.flash_offset_mm) = (board, camera, offset)
                        return try body(&options)
                    }
                }
            }
        }
    }
}

private func withText<Result>(
    _ text: String?, _ body: (UnsafePointer<CChar>?) throws -> Result
) rethrows -> Result {
    guard let text else { return try body(nil) }
    return try text.withCString(body)
}

private func withPointer<Value, Result>(
    _ value: Value?, _ body: (UnsafePointer<Value>?) throws -> Result
) rethrows -> Result {
    guard let value else { return try body(nil) }
    return try withUnsafePointer(to: value, body)
}

private func withArray<Value, Result>(
    _ values: [Value]?, _ body: (UnsafePointer<Value>?) throws -> Result
) rethrows -> Result {
    guard let values else { return try body(nil) }
    return try values.withUnsafeBufferPointer { try body($0.baseAddress) }
}
