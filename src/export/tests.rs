use super::*;
use crate::svbrdf::{CHANNELS, MIN_ROUGHNESS, channel};
use crate::test_support::picture;
use crate::{Error, Svbrdf};

/// Maps whose every channel varies over its range.
fn varied(width: usize, height: usize) -> Svbrdf {
    let mut maps = Svbrdf::new(width, height);
    let n = maps.texels();
    for c in 0..CHANNELS {
        for (i, v) in maps.plane_mut(c).iter_mut().enumerate() {
            let t = ((i * (2 * c + 3)) % n) as f32 / (n - 1) as f32;
            *v = match c {
                channel::SLOPE_X | channel::SLOPE_Y => 2.0 * t - 1.0,
                channel::ROUGHNESS => MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * t,
                _ => t,
            };
        }
    }
    maps
}

fn largest_difference(a: &Svbrdf, b: &Svbrdf, c: usize) -> f32 {
    a.plane(c).iter().zip(b.plane(c)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn maps_come_back_from_floats_and_from_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let maps = varied(12, 7);
    write_maps(dir.path(), &maps).unwrap();
    let back = read_maps(dir.path()).unwrap();
    assert_eq!((back.width(), back.height()), (12, 7));
    for c in 0..CHANNELS {
        // Slopes pass through the unit normal: a few roundings; the rest is stored as it is.
        let tolerance = if c < channel::DIFFUSE { 1e-6 } else { 0.0 };
        assert!(largest_difference(&maps, &back, c) <= tolerance, "channel {c}");
    }
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    let back = read_maps(dir.path()).unwrap();
    for c in 0..CHANNELS {
        // Half a step of 1/65535; times 2 and the slope's derivative 1/nz² + ... < 6 for normals;
        // times the sRGB curve's steepest slope 2.28 for albedos.
        let steps = match c {
            channel::SLOPE_X | channel::SLOPE_Y => 12.0,
            channel::ROUGHNESS => 1.0,
            _ => 2.3,
        };
        let difference = largest_difference(&maps, &back, c);
        assert!(difference <= 0.5 * steps / 65535.0 + 1e-6, "channel {c}: {difference}");
    }
    let roughness = picture(dir.path().join("roughness.png"));
    assert_eq!(roughness.color(), image::ColorType::L16);
    let normal = picture(dir.path().join("normal.png"));
    assert_eq!(normal.color(), image::ColorType::Rgb16);
}

/// Both kinds of files state the size of the sample; others state none.
#[test]
fn maps_state_the_size_of_their_sample() {
    let dir = tempfile::tempdir().unwrap();
    let maps = varied(12, 7);
    write_maps(dir.path(), &maps).unwrap();
    assert_eq!(read_sample_mm(dir.path()).unwrap(), None);
    write_sized_maps(dir.path(), &maps, [60.0, 35.5]).unwrap();
    assert_eq!(read_sample_mm(dir.path()).unwrap(), Some([60.0, 35.5]));
    assert_eq!(read_maps(dir.path()).unwrap().texels(), 84);
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    // Whole texels a metre: half of one in 200.
    let [x, y] = read_sample_mm(dir.path()).unwrap().unwrap();
    assert!((x - 60.0).abs() < 0.16 && (y - 35.5).abs() < 0.1, "{x} {y}");
    assert!(write_sized_maps(dir.path(), &maps, [0.0, 1.0]).is_err());
    std::fs::remove_file(dir.path().join("normal.png")).unwrap();
    assert!(read_sample_mm(dir.path()).unwrap_err().to_string().contains("normal"));
}

#[test]
fn values_that_are_no_numbers_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let mut maps = varied(6, 4);
    maps.plane_mut(channel::SPECULAR + 2)[8] = f32::NAN;
    write_maps(dir.path(), &maps).unwrap();
    let fault = read_maps(dir.path()).unwrap_err();
    let text = fault.to_string();
    assert!(matches!(&fault, Error::Field { .. }) && text.contains("maps.exr"), "{text}");
    assert!(text.contains("specular.B") && text.contains("column 2, row 1"), "{text}");
}

#[test]
fn a_slope_to_the_right_is_red_and_one_upwards_green() {
    let dir = tempfile::tempdir().unwrap();
    let mut maps = Svbrdf::new(2, 1);
    maps.plane_mut(channel::SLOPE_X)[0] = 1.0;
    maps.plane_mut(channel::SLOPE_Y)[1] = 1.0;
    write_maps(dir.path(), &maps).unwrap();
    let normal = picture(dir.path().join("normal.png")).into_rgb32f();
    let raised = 0.5 + 0.5 * 0.5f32.sqrt();
    let (right, up) = (normal.get_pixel(0, 0), normal.get_pixel(1, 0));
    for (found, expected) in [(right, [raised, 0.5, raised]), (up, [0.5, raised, raised])] {
        for c in 0..3 {
            assert!((found[c] - expected[c]).abs() < 1e-5);
        }
    }
}

#[test]
fn missing_and_odd_files_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let missing = read_maps(dir.path()).unwrap_err();
    assert!(matches!(&missing, Error::Io { .. }) && missing.to_string().contains("normal"));
    write_maps(dir.path(), &varied(4, 4)).unwrap();
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    image::GrayImage::new(3, 3).save(dir.path().join("roughness.png")).unwrap();
    let fault = read_maps(dir.path()).unwrap_err().to_string();
    assert!(fault.contains("roughness.png") && fault.contains("4 x 4"), "{fault}");
    std::fs::write(dir.path().join("maps.exr"), b"no floats").unwrap();
    let fault = read_maps(dir.path()).unwrap_err();
    assert!(matches!(&fault, Error::Image { .. }) && fault.to_string().contains("maps.exr"));
    write_exr_image(dir.path().join("maps.exr"), 1, 1, &[0.0; 3]).unwrap();
    let fault = read_maps(dir.path()).unwrap_err().to_string();
    assert!(fault.contains("normal.X"), "{fault}");
}

#[test]
fn files_appear_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("file");
    write_atomic(&path, b"first").unwrap();
    write_atomic(&path, b"second").unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"second");
    // A folder in the way: renaming fails, no temporary file stays.
    let taken = dir.path().join("taken");
    std::fs::create_dir(&taken).unwrap();
    std::fs::write(taken.join("inside"), b"").unwrap();
    let fault = write_atomic(&taken, b"data").unwrap_err();
    assert!(fault.to_string().contains("taken"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
    // Below a file nothing can be made.
    let fault = check_writable(path.join("below")).unwrap_err();
    assert!(matches!(&fault, Error::Io { .. }) && fault.to_string().contains("below"));
    check_writable(dir.path().join("new/deep")).unwrap();
    assert_eq!(std::fs::read_dir(dir.path().join("new/deep")).unwrap().count(), 0);
}

#[test]
fn pictures_of_renderings_hold_the_values() {
    let dir = tempfile::tempdir().unwrap();
    let rgb = [0.0, 0.25, 0.5, 1.5, 0.1, -1.0];
    write_exr_image(dir.path().join("a.exr"), 2, 1, &rgb).unwrap();
    let back = picture(dir.path().join("a.exr")).into_rgb32f().into_raw();
    assert_eq!(back, [0.0, 0.5, 0.1, 0.25, 1.5, -1.0]);
    write_png16_image(dir.path().join("a.png"), 2, 1, &rgb).unwrap();
    let back = picture(dir.path().join("a.png")).into_rgb16().into_raw();
    assert_eq!(back, [0, 32768, 6554, 16384, 65535, 0]);
    assert!(write_png16_image(dir.path().join("a.png"), 2, 2, &rgb).is_err());
}

#[test]
fn resizing_keeps_means_and_ramps() {
    let maps = varied(12, 9);
    let mean = |m: &Svbrdf, c: usize| m.plane(c).iter().sum::<f32>() / m.texels() as f32;
    for (w, h) in [(6, 3), (5, 4), (1, 1)] {
        let small = resized(&maps, w, h);
        for c in 0..CHANNELS {
            assert!((mean(&small, c) - mean(&maps, c)).abs() < 1e-5);
        }
    }
    assert_eq!(resized(&maps, 12, 9), maps);
    let (twice, reference) = (resized(&maps, 24, 18), maps.upsampled());
    for c in 0..CHANNELS {
        assert!(largest_difference(&twice, &reference, c) < 1e-6);
    }
}

#[test]
fn the_preview_shows_maps_and_renderings_with_captions() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("preview.png");
    write_preview(&path, &varied(40, 20), [100.0, 50.0]).unwrap();
    let sheet = picture(&path).into_rgb8();
    // Enlarged six times: pictures of 240 x 120 px under captions of 24 px, 12 px apart.
    assert_eq!(sheet.dimensions(), (4 * 240 + 5 * 12, 2 * (120 + 24) + 3 * 12));
    // Every one of the eight pictures has something to show, and a caption above it.
    for (column, row) in (0..4).flat_map(|c| (0..2).map(move |r| (c, r))) {
        let (x0, y0) = (12 + column * 252, 12 + row * 156);
        let bright = |x: u32, y: u32| sheet.get_pixel(x0 + x, y0 + y)[1] > 60;
        let any = |rows: std::ops::Range<u32>| {
            rows.flat_map(|y| (0..240).map(move |x| (x, y))).any(|(x, y)| bright(x, y))
        };
        assert!(any(0..24), "caption {column} {row}");
        assert!(any(24..144), "picture {column} {row}");
    }
}
