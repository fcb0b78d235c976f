import SVBRDF

/// Status of the library, by its number in C.
public struct ScanStatus: RawRepresentable, Hashable, Sendable {
    public let rawValue: Int32

    public init(rawValue: Int32) {
        self.rawValue = rawValue
    }

    public static let rejected = Self(rawValue: SVBRDF_REJECTED)
    public static let timeout = Self(rawValue: SVBRDF_TIMEOUT)
    /// No photo has been accepted yet.
    public static let noMaps = Self(rawValue: SVBRDF_NO_MAPS)
    /// Three photos are on their way: add it again when one has been answered.
    public static let busy = Self(rawValue: SVBRDF_BUSY)
    /// The material does not show this lobe, so that there is no such map.
    public static let noLobe = Self(rawValue: SVBRDF_NO_LOBE)
    public static let invalidArgument = Self(rawValue: SVBRDF_INVALID_ARGUMENT)
    public static let invalidHandle = Self(rawValue: SVBRDF_INVALID_HANDLE)
    public static let cancelled = Self(rawValue: SVBRDF_CANCELLED)
    public static let io = Self(rawValue: SVBRDF_IO)
    public static let badModel = Self(rawValue: SVBRDF_BAD_MODEL)
    public static let unsupported = Self(rawValue: SVBRDF_UNSUPPORTED)
    public static let badState = Self(rawValue: SVBRDF_BAD_STATE)
    /// More than `ScanOptions.memoryLimit` would be needed, copies of photos on their way included.
    public static let memoryLimit = Self(rawValue: SVBRDF_MEMORY_LIMIT)
    public static let failed = Self(rawValue: SVBRDF_FAILED)
}

extension ScanStatus: CustomStringConvertible {
    public var description: String { String(cString: svbrdf_status_name(rawValue)) }
}

/// Why a call was not done. A photo that cannot be used is no error: see `Outcome.rejected`.
public struct ScanError: Error, Hashable, Sendable {
    public let status: ScanStatus
    /// Which argument, or field of a struct of C, is at fault, where it is one.
    public let field: String?
    /// The library's words.
    public let message: String

    /// Of this thread's latest call.
    init(_ status: svbrdf_status) {
        self.init(status, String(cString: svbrdf_last_error_message()))
    }

    init(_ status: svbrdf_status, _ message: String) {
        self.status = ScanStatus(rawValue: status)
        self.message = message
        let name = message.prefix { $0.isLetter || $0.isNumber || "_.[]".contains($0) }
        let named = !name.isEmpty && message.dropFirst(name.count).hasPrefix(": ")
        field = named ? String(name) : nil
    }
}

extension ScanError: CustomStringConvertible {
    public var description: String { "\(status): \(message)" }
}

/// Throws the fault of a call.
func check(_ status: svbrdf_status) throws {
    if status != SVBRDF_OK { throw ScanError(status) }
}

/// A struct of C with the library's defaults.
func filled<T>(_ value: T, _ fill: (UnsafeMutablePointer<T>?, Int) -> svbrdf_status) throws -> T {
    var value = value
    try check(fill(&value, MemoryLayout<T>.stride))
    return value
}

/// Text in an array of C, which Swift sees as a tuple.
func text<T>(_ characters: T) -> String {
    withUnsafeBytes(of: characters) { String(decoding: $0.prefix { $0 != 0 }, as: UTF8.self) }
}

/// Numbers of an array of C, which Swift sees as a tuple.
func numbers<T, Number>(_ tuple: T, as: Number.Type) -> [Number] {
    withUnsafeBytes(of: tuple) { Array($0.bindMemory(to: Number.self)) }
}
