use super::*;

use serde_json::json;

fn board_capture() -> Value {
    json!({
        "format": "svbrdf-capture/1",
        "sample": { "width_mm": 100.0, "height_mm": 80 },
        "board": { "kind": "checkerboard-ring", "rows": 17, "cols": 16, "square_mm": 10.0,
                   "hole_squares": [2, 2, 15, 14], "white_albedo": 0.8, "black_albedo": 0.05,
                   "top_left": "black" },
        "camera": { "width": 2016, "height": 1512, "fx": 1452.2, "fy": 1454.3, "cx": 1003.1,
                    "cy": 760.4, "distortion": [0.05, -0.083, 0.0, 0.0, 0.0] },
        "flash": { "offset_mm": [-4.7, -7.0, 0.0] },
        "frames": [ { "image": "a.png", "encoding": "srgb" },
                    { "image": "b.png", "encoding": "linear", "exposure": 0.5 } ],
        "comment": "unknown fields are ignored"
    })
}

fn rectified_capture() -> Value {
    json!({
        "format": "svbrdf-capture/1",
        "rectified": true,
        "falloff": "inverse-square",
        "light_power": 3.0e5,
        "sample": { "width_mm": 100.0, "height_mm": 100.0 },
        "frames": [ { "image": "a.png", "encoding": "gamma2.2", "camera_mm": [0, 1, 300],
                      "light_mm": [5, 0, 310.5] } ]
    })
}

/// A folder with two (empty) picture files and the description.
fn folder(text: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.png", "b.png"] {
        std::fs::write(dir.path().join(name), b"").unwrap();
    }
    std::fs::write(dir.path().join(FILE_NAME), text).unwrap();
    dir
}

fn load(value: &Value) -> Result<Capture> {
    Capture::load(folder(&value.to_string()).path())
}

/// Sets the value at a JSON pointer; `null` in an object removes it.
fn with(mut value: Value, pointer: &str, new: Value) -> Value {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    let parent = value.pointer_mut(parent).unwrap();
    match parent {
        Value::Object(map) if new.is_null() => drop(map.remove(key)),
        Value::Object(map) => drop(map.insert(key.to_owned(), new)),
        Value::Array(items) => items[key.parse::<usize>().unwrap()] = new,
        _ => panic!("{pointer}"),
    }
    value
}

#[test]
fn a_board_capture_is_read() {
    let dir = folder(&board_capture().to_string());
    let capture = Capture::load(dir.path()).unwrap();
    assert_eq!(capture.sample_mm, [100.0, 80.0]);
    let Scene::Board { target, camera, flash_offset_mm, .. } = &capture.scene else { panic!() };
    assert_eq!((target.rows, target.cols, target.square_mm), (17, 16, 10.0));
    assert_eq!(target.hole, Hole { row_start: 2, col_start: 2, row_end: 15, col_end: 14 });
    assert_eq!(target.top_left, TopLeft::Black);
    let camera = camera.unwrap();
    assert_eq!((camera.width, camera.fy, camera.distortion[1]), (2016, 1454.3, -0.083));
    assert_eq!(*flash_offset_mm, Some(DVec3::new(-4.7, -7.0, 0.0)));
    assert_eq!(capture.photos.len(), 2);
    assert_eq!(capture.photos[0].path, dir.path().join("a.png"));
    assert_eq!((capture.photos[0].encoding, capture.photos[0].exposure), (None, 1.0));
    assert_eq!(
        (capture.photos[1].encoding, capture.photos[1].exposure),
        (Some(Encoding::Linear), 0.5)
    );
}

#[test]
fn optional_parts_may_be_missing() {
    let value = with(board_capture(), "/flash", Value::Null);
    let value = with(value, "/camera/distortion", Value::Null);
    let Scene::Board { camera, flash_offset_mm, .. } = load(&value).unwrap().scene else {
        panic!()
    };
    let camera = camera.unwrap();
    assert_eq!((camera.distortion, flash_offset_mm), ([0.0; 5], None));
    let unknown = load(&with(board_capture(), "/camera", Value::Null)).unwrap().scene;
    assert!(matches!(unknown, Scene::Board { camera: None, elevation_mm: None, .. }));
    let raised = load(&with(board_capture(), "/sample/elevation_mm", json!(4.5))).unwrap().scene;
    assert!(matches!(raised, Scene::Board { elevation_mm: Some(mm), .. } if mm == 4.5));
    // A given camera replaces the file's, also a missing one.
    let other = Camera { fx: 1000.0, ..camera };
    for value in [with(board_capture(), "/camera", Value::Null), board_capture()] {
        let dir = folder(&value.to_string());
        let capture = Capture::load_with_camera(dir.path(), Some(other)).unwrap();
        assert!(matches!(capture.scene, Scene::Board { camera, .. } if camera == Some(other)));
    }
}

#[test]
fn photographs_are_turned_as_stated() {
    let capture = load(&with(board_capture(), "/frames/1/turn", json!(270))).unwrap();
    assert_eq!(capture.photos[0].turn, Rotation::None);
    assert_eq!(capture.photos[1].turn, Rotation::ThreeQuarters);
}

#[test]
fn photographs_without_flash_are_named() {
    let capture = with(board_capture(), "/frames/1/ambient", json!("a.png"));
    let loaded = load(&capture).unwrap();
    assert_eq!(loaded.photos[0].ambient, None);
    let (path, exposure) = loaded.photos[1].ambient.clone().unwrap();
    assert!(path.ends_with("a.png") && exposure == 0.5);
    let capture = with(capture, "/frames/1/ambient_exposure", json!(2.0));
    assert_eq!(load(&capture).unwrap().photos[1].ambient.as_ref().unwrap().1, 2.0);
    let missing = with(board_capture(), "/frames/0/ambient", json!("c.png"));
    assert!(load(&missing).unwrap_err().to_string().contains("frames[0].ambient"));
}

#[test]
fn a_charuco_ring_names_its_markers() {
    let value = with(board_capture(), "/board/kind", json!("charuco-ring"));
    let value = with(value, "/board/dictionary", json!("DICT_4X4_250"));
    let value = with(value, "/board/marker_mm", json!(7.2));
    let Scene::Board { target, .. } = load(&value).unwrap().scene else { panic!() };
    let dictionary = "DICT_4X4_250".to_owned();
    assert_eq!(target.kind, TargetKind::CharucoRing { dictionary, marker_mm: 7.2 });
}

#[test]
fn rectified_captures_are_read() {
    let capture = load(&rectified_capture()).unwrap();
    let power_mm2 = [3.0e5; 3];
    let falloff = RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2 });
    assert_eq!(capture.scene, Scene::Rectified { falloff });
    let view = capture.photos[0].rectified.unwrap();
    assert_eq!((view.camera_mm, view.light_mm), ([0.0, 1.0, 300.0], [5.0, 0.0, 310.5]));

    let three = with(rectified_capture(), "/light_power", json!([1.0, 2.0, 3.0]));
    let falloff = RectifiedFalloff::Given(Falloff::InverseSquare { power_mm2: [1.0, 2.0, 3.0] });
    assert_eq!(load(&three).unwrap().scene, Scene::Rectified { falloff });

    let auto = with(rectified_capture(), "/light_power", Value::Null);
    let falloff = RectifiedFalloff::InverseSquareAuto;
    assert_eq!(load(&auto).unwrap().scene, Scene::Rectified { falloff });

    let none = with(rectified_capture(), "/falloff", json!("none"));
    let power = [std::f32::consts::PI; 3];
    let falloff = RectifiedFalloff::Given(Falloff::None { power });
    assert_eq!(load(&none).unwrap().scene, Scene::Rectified { falloff });
}

#[test]
fn faults_name_file_field_and_expectation() {
    let null = Value::Null;
    let board = [
        ("/format", null.clone(), "format", "svbrdf-capture/1"),
        ("/format", json!("svbrdf-capture/2"), "format", "svbrdf-capture/1"),
        ("/sample", null.clone(), "sample.width_mm", "length"),
        ("/sample/height_mm", json!(-3), "sample.height_mm", "positive length"),
        ("/sample/height_mm", json!("80"), "sample.height_mm", "positive length"),
        ("/sample/width_mm", json!(1e300), "sample.width_mm", "kilometre"),
        ("/sample/height_mm", json!(1e-320), "sample.height_mm", "nanometre"),
        ("/rectified", json!("no"), "rectified", "true or false"),
        ("/board", null.clone(), "board", "object"),
        ("/board/kind", json!("dots"), "board.kind", "checkerboard-ring"),
        ("/board/kind", json!("charuco-ring"), "board.dictionary", "DICT_4X4_250"),
        ("/board/rows", json!(16.5), "board.rows", "rows of squares"),
        ("/board/rows", json!(2), "board.rows", "3 to 200"),
        ("/board/cols", json!(17), "board.cols", "odd"),
        ("/board/square_mm", json!(0), "board.square_mm", "positive length"),
        ("/board/hole_squares", json!([2, 2, 15]), "board.hole_squares", "four whole numbers"),
        ("/board/hole_squares", json!([2, 2, 99, 14]), "board.hole_squares", "inside 17 x 16"),
        ("/board/hole_squares", json!([0, 0, 17, 16]), "board.hole_squares", "inner corners"),
        ("/board/white_albedo", json!(1.5), "board.white_albedo", "albedo"),
        ("/board/top_left", json!("grey"), "board.top_left", "white"),
        ("/sample/elevation_mm", json!("high"), "sample.elevation_mm", "a height above"),
        ("/sample/elevation_mm", json!(50), "sample.elevation_mm", "-5 to 20"),
        ("/camera", json!([1]), "camera", "object"),
        ("/camera/fx", null.clone(), "camera.fx", "number of pixels"),
        ("/camera/fx", json!("NaN"), "camera.fx", "finite number"),
        ("/camera/fy", json!(-1.0), "camera.fy", "positive number"),
        ("/camera/width", json!(0), "camera.width", "at least 1"),
        ("/camera/distortion", json!([0, 0, 0, 0]), "camera.distortion", "k1, k2, p1, p2, k3"),
        ("/flash/offset_mm", null.clone(), "flash.offset_mm", "three finite numbers"),
        ("/flash/offset_mm", json!([1, 2]), "flash.offset_mm", "three finite numbers"),
        ("/frames", null.clone(), "frames", "a list"),
        ("/frames", json!([]), "frames", "at least one"),
        ("/frames/1", json!("b.png"), "frames[1]", "object"),
        ("/frames/1/image", null.clone(), "frames[1].image", "path of an image"),
        ("/frames/1/image", json!("c.png"), "frames[1].image", "path of an image"),
        ("/frames/0/image", json!(""), "frames[0].image", "path of an image"),
        ("/frames/1/encoding", null.clone(), "frames[1].encoding", "gamma2.2"),
        ("/frames/1/encoding", json!("sRGB"), "frames[1].encoding", "srgb"),
        ("/frames/1/turn", json!(45), "frames[1].turn", "180"),
        ("/frames/1/turn", json!("left"), "frames[1].turn", "clockwise"),
        ("/frames/1/exposure", json!(0), "frames[1].exposure", "positive number"),
        ("/frames/1/exposure", json!(1e-300), "frames[1].exposure", "positive number"),
    ];
    let rectified = [
        ("/falloff", null.clone(), "falloff", "inverse-square"),
        ("/light_power", json!(-1), "light_power", "positive number"),
        ("/light_power", json!([1, 2]), "light_power", "or three"),
        ("/frames/0/camera_mm", null.clone(), "frames[0].camera_mm", "three finite numbers"),
        ("/frames/0/light_mm", json!([0, 0, -5]), "frames[0].light_mm", "z > 0"),
    ];
    let cases = board.into_iter().map(|c| (board_capture(), c));
    for (base, (pointer, new, field, expected)) in
        cases.chain(rectified.into_iter().map(|c| (rectified_capture(), c)))
    {
        let fault = load(&with(base, pointer, new)).unwrap_err();
        assert!(matches!(&fault, Error::Field { .. }), "{pointer}: {fault:?}");
        let text = fault.to_string();
        assert!(text.contains(FILE_NAME), "{text}");
        assert!(text.contains(&format!("`{field}`")), "{pointer}: {text}");
        assert!(text.split("; expected ").nth(1).unwrap().contains(expected), "{text}");
    }
}

#[test]
fn invalid_json_is_located() {
    let text = serde_json::to_string_pretty(&board_capture()).unwrap();
    for (from, to) in [("1454.3", "NaN"), ("1454.3", "Infinity"), ("1454.3", "1e999")] {
        let broken = text.replace(from, to);
        let fault = Capture::load(folder(&broken).path()).unwrap_err().to_string();
        assert!(fault.contains("`fy`") && fault.contains("line") && fault.contains(FILE_NAME));
        assert!(fault.contains("finite"), "{fault}");
    }
    for broken in ["", "{", "[1", "\u{0}", "{\"format\": \"é", &"[".repeat(100_000)] {
        let fault = Capture::load(folder(broken).path()).unwrap_err();
        assert!(matches!(fault, Error::Field { .. }), "{fault:?}");
    }
    let dir = folder(&format!("\u{feff}{}", board_capture()));
    assert!(Capture::load(dir.path()).is_ok());
    let missing = Capture::load(dir.path().join("nowhere")).unwrap_err();
    assert!(matches!(&missing, Error::Io { .. }) && missing.to_string().contains(FILE_NAME));
}

#[test]
fn camera_files_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("camera.json");
    std::fs::write(&path, board_capture()["camera"].to_string()).unwrap();
    assert_eq!(read_camera(&path).unwrap().fx, 1452.2);
    std::fs::write(&path, "{\"width\": 10, \"height\": 10, \"fx\": \"wide\"}").unwrap();
    let fault = read_camera(&path).unwrap_err().to_string();
    assert!(fault.contains("camera.json") && fault.contains("`fx`"), "{fault}");
}

#[test]
fn a_sample_larger_than_the_hole_is_refused() {
    let base = board_capture();
    // 13 rows and 12 columns of 10 mm.
    for (pointer, most) in [("/sample/width_mm", 120.0), ("/sample/height_mm", 130.0)] {
        assert!(load(&with(base.clone(), pointer, json!(most))).is_ok());
        let fault = load(&with(base.clone(), pointer, json!(most + 1.0))).unwrap_err().to_string();
        let field = pointer[1..].replace('/', ".");
        assert!(fault.contains(&field) && fault.contains(&format!("at most {most} mm")), "{fault}");
    }
}

#[test]
fn unknown_fields_are_warned_about() {
    assert!(load(&board_capture()).unwrap().warnings.is_empty());
    assert!(load(&rectified_capture()).unwrap().warnings.is_empty());
    let misspelt = with(board_capture(), "/frames/1/exposre", json!(2.0));
    let warnings = load(&misspelt).unwrap().warnings;
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].contains("`frames[1].exposre`") && warnings[0].contains("`exposure`"));
}

#[test]
fn other_units_are_asked_about() {
    // Metres and inches: no camera resolves such squares.
    for square in [0.01, 0.0115, 0.39] {
        let scaled = |mm: f64| json!(mm * square / 10.0);
        let metres = with(board_capture(), "/board/square_mm", json!(square));
        let metres = with(metres, "/sample/width_mm", scaled(100.0));
        let metres = with(metres, "/sample/height_mm", scaled(80.0));
        let fault = load(&metres).unwrap_err().to_string();
        assert!(fault.contains("`board.square_mm`") && fault.contains("in mm"), "{fault}");
        assert!(fault.contains(&format!("squares of {square} mm")), "{fault}");
    }
    let centimetres = with(board_capture(), "/board/square_mm", json!(1.0));
    let centimetres = with(centimetres, "/sample/width_mm", json!(10));
    let centimetres = with(centimetres, "/sample/height_mm", json!(8));
    let warnings = load(&centimetres).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("centimetres"), "{warnings:?}");
    // Only the sample.
    let sample = with(board_capture(), "/sample/width_mm", json!(10));
    let sample = with(sample, "/sample/height_mm", json!(8));
    let warnings = load(&sample).unwrap().warnings;
    assert!(warnings[0].contains("10 x 8 mm in a hole of 120 x 130 mm"), "{warnings:?}");
    // Captures without a board have no squares.
    let rectified = with(rectified_capture(), "/sample/width_mm", json!(0.1));
    assert!(load(&rectified).unwrap().warnings.is_empty());
}
