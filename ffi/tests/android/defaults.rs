//! The defaults of the binding are those of the library.

use std::fs;

use engine::calibration::Target;
use engine::session::{Budget, Method, Settings};

use crate::example;

fn source(name: &str) -> String {
    let folder = example().join("scanner/src/main/kotlin/org/svbrdf/scanner");
    fs::read_to_string(folder.join(name)).unwrap()
}

#[test]
fn the_default_board_of_the_binding_is_the_librarys() {
    let t = Target::default();
    let hole = &t.hole;
    let expected = format!(
        "val DEFAULT = Board({}, {}, {}, {}, {}, {}, {}, patches = {})",
        t.rows,
        t.cols,
        t.square_mm,
        hole.row_start,
        hole.col_start,
        hole.row_end,
        hole.col_end,
        t.patches
    );
    assert!(source("ScanOptions.kt").contains(&expected), "{expected}");
    assert_eq!((t.white_albedo, t.black_albedo), (0.8, 0.05));
}

#[test]
fn the_default_options_of_the_binding_are_the_librarys() {
    let Settings { sample_mm, resolution, method, refine, threads, memory_limit_bytes, .. } =
        Settings::default();
    let budget = Budget::default();
    assert_eq!((budget.seconds, budget.steps, budget.stop_when_invisible), (None, None, false));
    assert_eq!((method, memory_limit_bytes), (Method::Deep, None));
    let options = source("ScanOptions.kt");
    for expected in [
        format!("val widthMm: Float = {}f,", sample_mm[0]),
        format!("val heightMm: Float = {}f,", sample_mm[1]),
        format!("val resolution: Int = {resolution},"),
        format!("val refine: Boolean = {refine},"),
        format!("val threads: Int = {threads},"),
        "val method: Method = Method.DEEP,".into(),
        "val memoryLimitBytes: Long = 0,".into(),
        // Estimated, as the board's scene has it.
        "val elevationMm: Double? = null,".into(),
        "val seconds: Float? = null,".into(),
        "val maxSteps: Int = 0,".into(),
        "val stopWhenInvisible: Boolean = false,".into(),
    ] {
        assert!(options.contains(&expected), "{expected}");
    }
}

#[test]
fn the_guides_default_options_are_the_librarys() {
    let o = engine::guide::GuideOptions::default();
    let binding = source("Guide.kt");
    for expected in [
        format!("val worth: Float = {}f,", o.worth),
        format!("val steady: Float = {}f,", o.steady),
        format!("val steadySeconds: Float = {}f,", o.steady_seconds),
        format!("val enough: Float = {}f,", o.enough),
        format!("val least: Int = {},", o.least),
        format!("val most: Int = {},", o.most),
        format!("val firstTiltDeg: Float = {}f,", o.first_tilt_deg),
        format!("val shotSeconds: Float = {}f,", o.shot_seconds),
    ] {
        assert!(binding.contains(&expected), "{expected}");
    }
}

/// Defaults that only the C ABI has, read from its initial structs.
#[test]
fn the_defaults_of_the_binding_are_those_of_the_header() {
    let rust = |file: &str| {
        let path = crate::common::root().join("ffi/src").join(file);
        fs::read_to_string(path).unwrap()
    };
    let pairs = [
        ("image.rs", "transfer: SVBRDF_TRANSFER_SRGB,", "Photo.kt", "Transfer = Transfer.SRGB"),
        ("image.rs", "yuv_matrix: SVBRDF_YUV_BT601_FULL,", "Photo.kt", "YuvMatrix.BT601_FULL"),
        ("image.rs", "saturation: f32::INFINITY,", "Photo.kt", "= Float.POSITIVE_INFINITY"),
        ("image.rs", "primaries: SVBRDF_PRIMARIES_REC709,", "Photo.kt", "= Primaries.REC709"),
        ("image.rs", "bayer_pattern: SVBRDF_BAYER_RGGB,", "Photo.kt", "BayerPattern.RGGB"),
        ("image.rs", "white_level: 65535.0,", "Photo.kt", "FloatArray(4), 65535f"),
        // What it does not name is 0.
        (
            "options/photo.rs",
            "defaults!(svbrdf_photo_info { exposure: 1.0 });",
            "Photo.kt",
            "val exposure: Float = 1f,",
        ),
        (
            "options/photo.rs",
            "SVBRDF_FLASH_UNKNOWN: svbrdf_flash = 0;",
            "Photo.kt",
            "= Flash.UNKNOWN",
        ),
        (
            "options/photo.rs",
            "pub ambient_exposure: f32,",
            "Photo.kt",
            "ambientExposure: Float = 0f",
        ),
        ("options/fit.rs", "falloff: SVBRDF_FALLOFF_AUTO,", "ScanOptions.kt", "= Falloff.AUTO"),
        (
            "render.rs",
            "light_mm: [0.0, 0.0, 300.0],",
            "Lighting.kt",
            "lightMm: FloatArray = floatArrayOf(0f, 0f, 300f)",
        ),
        (
            "render.rs",
            "camera_mm: [0.0, 0.0, 300.0],",
            "Lighting.kt",
            "cameraMm: FloatArray = floatArrayOf(0f, 0f, 300f)",
        ),
        (
            "render.rs",
            "light_power: [PI; 3],",
            "Lighting.kt",
            "FloatArray(3) { Math.PI.toFloat() }",
        ),
        ("render.rs", "falloff: SVBRDF_FALLOFF_NONE,", "Lighting.kt", "Falloff = Falloff.NONE"),
    ];
    for (file, ours, binding, theirs) in pairs {
        assert!(rust(file).contains(ours), "{file}: {ours}");
        assert!(source(binding).contains(theirs), "{binding}: {theirs}");
    }
}
