// The package on the desktop: the bundled capture's photos (PPM files) to maps.
//
//     check FOLDER-OF-PHOTOS OUT

import Foundation
import SVBRDFScanner

struct Failure: Error, CustomStringConvertible {
    let description: String
}

func verify(_ condition: Bool, _ what: String) throws {
    if !condition { throw Failure(description: what) }
}

func expect<T: Sendable>(_ status: ScanStatus, field: String? = nil, _ body: () async throws -> T) async throws {
    do {
        _ = try await body()
    } catch let fault as ScanError {
        try verify(fault.status == status && !fault.message.isEmpty, "\(status) expected, \(fault) came")
        try verify(field == nil || fault.field == field, "\(field ?? "") expected in: \(fault)")
        return
    }
    throw Failure(description: "\(status) expected, nothing came")
}

func photo(_ folder: String, _ index: Int) throws -> Photo {
    let name = String(format: "%@/%02d.ppm", folder, index)
    let file = [UInt8](try Data(contentsOf: URL(fileURLWithPath: name)))
    let header = Array("P6 2016 1512 255\n".utf8)
    try verify(Array(file.prefix(header.count)) == header, "not the photo expected")
    let pixels = Array(file.dropFirst(header.count))
    return Photo(.rgb8, width: 2016, height: 1512, pixels: pixels)
}

func bundled() -> ScanOptions {
    var options = ScanOptions()
    (options.widthMM, options.heightMM) = (88, 88)
    options.board = Board(rows: 19, columns: 14, squareMM: 10, holeRows: 3..<16, holeColumns: 2..<12)
    var camera = Camera(
        width: 2016, height: 1512, fx: 1493.9383274679394, fy: 1492.8832900664995,
        cx: 1014.8386867404545, cy: 755.2944690154574
    )
    camera.distortion = [0.0421587926023828, -0.042918096580716374, 0, 0, 0]
    options.camera = camera
    options.flashOffsetMM = SIMD3(4.9223925516757925, 7.8090039183605695, 0)
    options.threads = 2
    return options
}

/// Photos of 16 x 16 pixels in every layout that a camera hands over reach the library as they are.
func layouts(_ scanner: MaterialScanner) async throws {
    let words = [UInt8](repeating: 120, count: 2048)
    let copy = UnsafeMutableRawBufferPointer.allocate(byteCount: words.count, alignment: 16)
    defer { copy.deallocate() }
    copy.copyBytes(from: words)
    let start = UnsafeRawPointer(copy.baseAddress!)
    let luma = Plane(data: start, bytes: 512, bytesPerRow: 32, bytesPerPixel: 2)
    let blue = Plane(data: start + 512, bytes: 256, bytesPerRow: 32, bytesPerPixel: 4)
    let red = Plane(data: start + 514, bytes: 254, bytesPerRow: 32, bytesPerPixel: 4)
    let video = Photo(
        .p010, width: 16, height: 16, planes: [luma, blue, red], transfer: .hlg, primaries: .rec2020,
        yuvMatrix: YUVMatrix(.bt2020, fullRange: false), release: {}
    )
    for picture in [video, Photo(.bgra8, width: 16, height: 16, pixels: Array(words.prefix(1024)))] {
        let probe = try await scanner.probe(picture)
        try verify(!probe.acceptable && probe.rejection == .boardNotFound, "\(probe)")
        try verify(probe.pose == nil && !probe.advice.isEmpty, "\(probe)")
    }
    let short = Plane(data: start, bytes: 500, bytesPerRow: 32, bytesPerPixel: 2)
    let cut = Photo(.p010, width: 16, height: 16, planes: [short, blue, red], release: {})
    try await expect(.invalidArgument) { try await scanner.probe(cut) }
    let none = Photo(PixelFormat(rawValue: 99), width: 1, height: 1, pixels: [0, 0, 0])
    try await expect(.invalidArgument, field: "svbrdf_image.format") { try await scanner.probe(none) }
}

func capture(_ folder: String, _ out: URL) async throws {
    let scanner = try MaterialScanner(bundled())
    let updates = Task {
        // Of both photos: it never falls, and the last one is told however slow this reader is.
        var last: Float = 0
        for await progress in scanner.progressUpdates {
            if progress.fraction < last { return progress.fraction }
            last = progress.fraction
            if last == 1 { break }
        }
        return last
    }
    try verify(await scanner.snapshot() == nil, "maps before the first photo")
    try verify(await scanner.nextView() == nil, "a view before the first photo")
    try await expect(.noMaps) { try await scanner.export(to: out) }
    try await layouts(scanner)
    try await scanner.announce(3)
    let info = PhotoInfo(flash: .torch, timestamp: 7)
    for index in 0..<2 {
        let shot = try photo(folder, index)
        let probe = try await scanner.probe(shot, info)
        try verify(probe.acceptable && probe.rejection == nil && probe.hints.isEmpty, "\(probe)")
        try verify((probe.offNextDegrees == nil) == (index == 0), "\(probe)")
        if index == 0 {
            try verify(await scanner.guide(shot, PhotoInfo()).action == .hold, "not steady yet")
            let guided = try await scanner.guide(shot, PhotoInfo(timestamp: 200_000_000))
            try verify(guided.action == .shoot && guided.photos == 0, "\(guided)")
            try verify(guided.target?.tiltDegrees == 0 && guided.probe == probe, "\(guided)")
            try await scanner.beginGuide()
        }
        guard case .accepted(index, let hints, let pose?, _) = try await scanner.addPhoto(shot, info) else {
            throw Failure(description: "photo \(index) is not in the maps")
        }
        try verify(hints.isEmpty && pose.translationMM[2] > 50, "\(pose)")
        try verify(pose.rotation.count == 9 && pose.reprojectionRMSPixels < 0.5, "\(pose)")
    }
    let dark = Photo(.rgb8, width: 2016, height: 1512, pixels: [UInt8](repeating: 0, count: 9_144_576))
    guard case .rejected(.tooDark, _, let advice) = try await scanner.addPhoto(dark) else {
        throw Failure(description: "a black photo was not rejected")
    }
    try verify(advice.contains("too dark"), advice)
    let next = try await scanner.nextView()
    try verify(next.map { $0.tiltDegrees < 90 && $0.direction.z > 0 } == true, "next view")
    try await results(scanner, out)
    try verify(await scanner.progress().fraction == 1, "of three, one of which was rejected")
    try verify(await updates.value == 1, "progress to the end")

    // Taken back, saved, gone on with.
    try await scanner.pause()
    try await scanner.removePhoto(1)
    try verify(await scanner.progress().photos == 1, "a photo is left")
    try await expect(.invalidArgument, field: "index") { try await scanner.removePhoto(5) }
    let state = out.appendingPathComponent("scan.state")
    try await scanner.save(to: state)
    let restored = try MaterialScanner(restoring: state)
    // It goes on at once. The fit of one photo begins anew, and ends with the same maps.
    try await scanner.resume()
    try await scanner.settle()
    try await restored.settle()
    let (own, other) = (try await scanner.snapshot()!, try await restored.snapshot()!)
    try verify(own.texture(.diffuse).bytes == other.texture(.diffuse).bytes, "other maps")
    try scanner.cancel()
    try await expect(.cancelled) { try await scanner.addPhoto(dark) }
    let broken = out.appendingPathComponent("broken.state")
    try Data("nothing".utf8).write(to: broken)
    try await expect(.badState) { try MaterialScanner(restoring: broken) }
    try await expect(.io) { try MaterialScanner(restoring: out.appendingPathComponent("none")) }
}

func results(_ scanner: MaterialScanner, _ out: URL) async throws {
    try await scanner.settle()
    let maps = try await scanner.snapshot()!
    try verify(maps.width == 256 && maps.height == 256 && maps.sampleMM == SIMD2(88, 88), "size")
    let normal = try maps.texture(.normal, alignment: 256)
    try verify(normal.bytesPerRow == 2048 && normal.bytes.count == 2048 * 256, "rows")
    let small = try await scanner.snapshot(reducedBy: 3)!
    let rough = try small.texture(.roughness, .r8, alignment: 64)
    try verify(rough.bytesPerRow == 64 && rough.bytes.count == 64 * 32, "rows of bytes")
    // A texel as floats and as half floats: length 1, and the same.
    let whole = try maps.texture(.normal, .rgba32Float).bytes.withUnsafeBytes {
        Array($0.bindMemory(to: Float.self).prefix(4))
    }
    let half = normal.bytes.withUnsafeBytes { bytes in
        (0..<4).map { i in float(bytes.loadUnaligned(fromByteOffset: 2 * i, as: UInt16.self)) }
    }
    let length = whole[0] * whole[0] + whole[1] * whole[1] + whole[2] * whole[2]
    try verify(abs(length - 1) < 1e-5 && whole[3] == 1, "\(whole)")
    try verify(zip(whole, half).allSatisfy { abs($0 - $1) < 1e-3 }, "\(whole) \(half)")
    try verify(maps.rendered().bytes.count == 4 * 256 * 256, "a picture")
    try await expect(.invalidArgument) { try maps.uncertainty() }
    let known = try await scanner.snapshotWithUncertainty()!
    let uncertainty = try known.uncertainty()
    let deviations = try known.deviations(of: .roughness)
    let mean = (deviations.reduce(0) { $0 + Double($1 * $1) } / Double(deviations.count)).squareRoot()
    try verify(abs(mean - Double(uncertainty.roughness)) < 1e-4, "\(mean) \(uncertainty)")
    let fit = try await scanner.photoFit(of: 0)
    try verify(fit.residual > 0 && !fit.outlier, "\(fit)")
    for hint in try await scanner.hints() {
        try verify(hint.index >= 0 && !hint.code.isEmpty && !hint.text.isEmpty, "\(hint)")
    }
    try await scanner.export(to: out)
    let file = out.appendingPathComponent("normal.png").path
    try verify(FileManager.default.fileExists(atPath: file), "a file")
}

/// A half float's value.
func float(_ bits: UInt16) -> Float {
    let exponent = Int(bits >> 10) & 31
    let fraction = Float(bits & 1023) / 1024
    let value = exponent == 0 ? fraction * 0x1p-14 : (1 + fraction) * Float(sign: .plus, exponent: exponent - 15, significand: 1)
    return bits >> 15 == 1 ? -value : value
}

/// Maps of values in memory, with and without anisotropy, a coat and sheen.
func lobes() async throws {
    func everywhere(_ texel: [Float]) -> [Float] { (0..<16).flatMap { _ in texel } }
    var values = MapValues(
        width: 4, height: 4, sampleMM: SIMD2(40, 30), normal: everywhere([0, 0, 1]),
        diffuse: everywhere([0.2, 0.3, 0.4]), specular: everywhere([0.8, 0.7, 0.6]), roughness: everywhere([0.25])
    )
    let plain = try MaterialMaps(values)
    try verify(plain.lobes.isEmpty && plain.width == 4 && plain.sampleMM == SIMD2(40, 30), "\(plain.lobes)")
    try await expect(.noLobe) { try plain.texture(.coat) }
    values.coat = everywhere([0.75, 0.1, 0])
    try verify(MaterialMaps(values).lobes == .coat, "a coat alone")
    values.anisotropy = everywhere([0.6, 0.8, 0.5])
    let maps = try MaterialMaps(values)
    try verify(maps.lobes == [.anisotropy, .coat], "\(maps.lobes)")
    values.sheen = everywhere([0.5, 0.25, 0])
    try await expect(.invalidArgument, field: "svbrdf_maps_input.sheen_roughness") { try MaterialMaps(values) }
    values.sheenRoughness = everywhere([0.6])
    let velvet = try MaterialMaps(values)
    try verify(velvet.lobes == [.anisotropy, .coat, .sheen], "\(velvet.lobes)")
    for (map, expected) in [(MapKind.sheen, [0.5, 0.25, 0, 1]), (.sheenRoughness, [0.6, 0.6, 0.6, 1])] as [(MapKind, [Float])] {
        let found = try velvet.texture(map, .rgba32Float).bytes.withUnsafeBytes { Array($0.bindMemory(to: Float.self)) }
        try verify(found.indices.allSatisfy { found[$0] == expected[$0 % 4] }, "\(map): \(found)")
    }
    (values.sheen, values.sheenRoughness) = (nil, nil)
    for (map, expected) in [(MapKind.anisotropy, [0.6, 0.8, 0.5, 1]), (.coat, [0.75, 0.1, 0, 1]), (.roughness, [1, 0.25, 0, 1])] as [(MapKind, [Float])] {
        let found = try maps.texture(map, .rgba32Float).bytes.withUnsafeBytes { Array($0.bindMemory(to: Float.self)) }
        try verify(found.indices.allSatisfy { abs(found[$0] - expected[$0 % 4]) < 1e-4 }, "\(map): \(found)")
    }
    // From beside, so that no highlight is clipped.
    var lighting = Lighting()
    lighting.lightMM = SIMD3(150, 0, 300)
    try verify(maps.rendered(lighting).bytes != plain.rendered(lighting).bytes, "lobes are rendered")
    try verify(maps.reduced(by: 1).lobes == maps.lobes, "of fewer texels")
    values.roughness = [0.5]
    try await expect(.invalidArgument, field: "MapValues") { try MaterialMaps(values) }
    values.roughness = everywhere([1.5])
    try await expect(.invalidArgument, field: "svbrdf_maps_input.roughness") { try MaterialMaps(values) }
}

func limits() async throws {
    var options = bundled()
    options.memoryLimit = 1
    try await expect(.memoryLimit) { try MaterialScanner(options) }
    options.memoryLimit = 0
    options.resolution = 300
    try await expect(.invalidArgument, field: "resolution") { try MaterialScanner(options) }
}

@main
struct Check {
    static func main() async throws {
        let arguments = CommandLine.arguments
        let out = URL(fileURLWithPath: arguments[2])
        try FileManager.default.createDirectory(at: out, withIntermediateDirectories: true)
        try await limits()
        try await lobes()
        try await capture(arguments[1], out)
        print("done")
    }
}
