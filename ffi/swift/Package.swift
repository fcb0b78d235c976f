// swift-tools-version:5.9
import PackageDescription

// It stands here and not at the top of the repository: SwiftPM takes a repository's top only with the
// library inside or at a fixed address, and neither is so. Apps take this folder by its path, with
// what `xcframework.sh` has put beside this file.
#if os(Linux)
// As installed (`ffi/install.sh`), found by pkg-config.
let library = Target.systemLibrary(name: "SVBRDF", path: "System", pkgConfig: "svbrdf")
#else
let library = Target.binaryTarget(name: "SVBRDF", path: "SVBRDF.xcframework")
#endif

let package = Package(
    name: "svbrdf",
    // For actors on a queue of their own.
    platforms: [.iOS(.v17), .macOS(.v14)],
    products: [.library(name: "SVBRDFScanner", targets: ["SVBRDFScanner"])],
    targets: [
        library,
        .target(
            name: "SVBRDFScanner",
            dependencies: ["SVBRDF"],
            swiftSettings: [.enableExperimentalFeature("StrictConcurrency")]
        ),
    ]
)
