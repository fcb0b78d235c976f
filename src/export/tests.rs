use super::*;
use crate::svbrdf::{CHANNELS, LOBES, MIN_ROUGHNESS, MIN_SHEEN_ROUGHNESS, channel, lobe};
use crate::test_support::picture;
use crate::{Error, Svbrdf};

/// Maps whose channels vary over their ranges.
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
    write_maps(dir.path(), &maps, &MapsOptions::default()).unwrap();
    let back = read_maps(dir.path()).unwrap();
    assert_eq!((back.width(), back.height()), (12, 7));
    for c in 0..CHANNELS {
        // Slopes are converted to the unit normal and back; other channels are stored directly.
        let tolerance = if c < channel::DIFFUSE { 1e-6 } else { 0.0 };
        assert!(largest_difference(&maps, &back, c) <= tolerance, "channel {c}");
    }
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    let back = read_maps(dir.path()).unwrap();
    for c in 0..CHANNELS {
        // Half a step of 1/65535, times 2 and the slope's derivative 1/nz² + ... < 6 for normals,
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

/// The maps with varying lobes: ratios of both alphas up to 4, a coat on the last two thirds, sheen on the first.
fn lobed(width: usize, height: usize) -> Svbrdf {
    let mut maps = varied(width, height);
    let n = maps.texels();
    for v in maps.roughness_mut() {
        *v *= 0.6;
    }
    let mut lobes = vec![0.0; LOBES * n];
    for i in 0..n {
        let t = ((i * 5) % n) as f32 / (n - 1) as f32;
        let (ratio, turn) = (1.4 * t, 6.0 * ((i * 11) % n) as f32 / n as f32);
        lobes[lobe::ANISOTROPY_X * n + i] = ratio * turn.cos();
        lobes[lobe::ANISOTROPY_Y * n + i] = ratio * turn.sin();
        lobes[lobe::COAT * n + i] = if i < n / 3 { 0.0 } else { t };
        lobes[lobe::COAT_ROUGHNESS * n + i] = MIN_ROUGHNESS + 0.9 * t;
        for c in 0..3 {
            lobes[(lobe::SHEEN + c) * n + i] = if i < n / 3 { 0.3 * t * c as f32 } else { 0.0 };
        }
        lobes[lobe::SHEEN_ROUGHNESS * n + i] = MIN_SHEEN_ROUGHNESS + 0.9 * t;
    }
    maps.set_lobes(lobes).unwrap();
    maps.clamp();
    maps
}

fn names(dir: &std::path::Path) -> Vec<String> {
    let entries = std::fs::read_dir(dir).unwrap();
    let mut names: Vec<_> =
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn lobes_come_back_and_go_with_the_maps_that_have_none() {
    let dir = tempfile::tempdir().unwrap();
    let maps = lobed(12, 7);
    write_maps(dir.path(), &maps, &MapsOptions::default()).unwrap();
    let compare = |back: &Svbrdf, tolerances: [f32; 3], kind: &str| {
        let difference = largest_difference(&maps, back, channel::ROUGHNESS);
        assert!(difference < tolerances[0], "{kind}: roughness {difference}");
        for c in 0..LOBES {
            let pairs = maps.lobe(c).unwrap().iter().zip(back.lobe(c).unwrap());
            let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let tolerance = tolerances[if c < lobe::COAT { 1 } else { 2 }];
            assert!(difference <= tolerance, "{kind}: lobe {c}: {difference}");
        }
    };
    compare(&read_maps(dir.path()).unwrap(), [1e-6, 2e-3, 0.0], "floats");
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    compare(&read_maps(dir.path()).unwrap(), [1e-4, 5e-3, 2e-5], "pictures");
    // As in glTF: the first anisotropic texel, where the alpha along the direction is mixed.
    let stored = picture(dir.path().join("anisotropy.png")).into_rgb32f();
    let across = picture(dir.path().join("roughness.png")).into_luma16();
    let (x, y) = (7, 2);
    let i = y * 12 + x;
    let [r, g, strength] = stored.get_pixel(x as u32, y as u32).0;
    let across = (f32::from(across.get_pixel(x as u32, y as u32)[0]) / 65535.0).powi(2);
    let along = across + (1.0 - across) * strength * strength;
    let (u, v) =
        (maps.lobe(lobe::ANISOTROPY_X).unwrap()[i], maps.lobe(lobe::ANISOTROPY_Y).unwrap()[i]);
    assert!(((along / across).ln() - u.hypot(v)).abs() < 5e-3);
    assert!(((along * across).sqrt() - maps.roughness()[i].powi(2)).abs() < 1e-4);
    // The parameters hold the doubled angle of the stored direction.
    let [dx, dy] = [2.0 * r - 1.0, 2.0 * g - 1.0];
    assert!((dx.hypot(dy) - 1.0).abs() < 1e-4);
    let (cos, sin) = (dx * dx - dy * dy, 2.0 * dx * dy);
    assert!((cos * v - sin * u).abs() < 1e-3 && cos * u + sin * v > 0.0);

    write_maps(dir.path(), &varied(12, 7), &MapsOptions::default()).unwrap();
    let left = ["diffuse.png", "maps.exr", "normal.png", "roughness.png", "specular.png"];
    assert_eq!(names(dir.path()), left);
    assert!(read_maps(dir.path()).unwrap().lobes().is_empty());
    // Lobes of zeros are not written; foreign files are checked.
    let mut flat = varied(12, 7);
    flat.set_lobes(vec![0.0; LOBES * 84]).unwrap();
    write_maps(dir.path(), &flat, &MapsOptions::default()).unwrap();
    assert_eq!(names(dir.path()), left);
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    image::RgbImage::new(3, 3).save(dir.path().join("coat.png")).unwrap();
    let fault = read_maps(dir.path()).unwrap_err().to_string();
    assert!(fault.contains("coat.png") && fault.contains("12 x 7"), "{fault}");
}

/// 8-bit textures as made by hand.
#[test]
fn textures_of_eight_bits_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, rgb: [u8; 3]| {
        let picture = image::RgbImage::from_pixel(2, 2, image::Rgb(rgb));
        picture.save(dir.path().join(name)).unwrap();
    };
    write("normal.png", [128, 128, 255]);
    write("diffuse.png", [90; 3]);
    write("specular.png", [200; 3]);
    write("roughness.png", [77; 3]); // alpha across 0.0912
    write("anisotropy.png", [218, 218, 128]); // along the diagonal up, strength 0.502
    write("coat.png", [255, 51, 0]);
    write("sheen.png", [188, 0, 255]);
    let fault = read_maps(dir.path()).unwrap_err().to_string();
    assert!(fault.contains("sheen_roughness"), "{fault}");
    write("sheen_roughness.png", [102; 3]);
    let maps = read_maps(dir.path()).unwrap();
    let at = |lobe: usize| maps.lobe(lobe).unwrap()[3];
    let across = (77f32 / 255.0).powi(2);
    let along = across + (1.0 - across) * (128f32 / 255.0).powi(2);
    assert!((at(lobe::ANISOTROPY_Y) - (along / across).ln()).abs() < 1e-4);
    assert!(at(lobe::ANISOTROPY_X).abs() < 1e-4);
    assert!((maps.roughness()[3] - (along * across).powf(0.25)).abs() < 1e-6);
    assert_eq!((at(lobe::COAT), at(lobe::COAT_ROUGHNESS)), (1.0, 0.2));
    assert!((at(lobe::SHEEN) - 0.503).abs() < 1e-3, "{}", at(lobe::SHEEN));
    assert_eq!(
        [at(lobe::SHEEN + 1), at(lobe::SHEEN + 2), at(lobe::SHEEN_ROUGHNESS)],
        [0.0, 1.0, 0.4]
    );
}

/// Both kinds of files state the size of the sample; other files do not.
#[test]
fn maps_state_the_size_of_their_sample() {
    let dir = tempfile::tempdir().unwrap();
    let maps = varied(12, 7);
    write_maps(dir.path(), &maps, &MapsOptions::default()).unwrap();
    assert_eq!(read_sample_mm(dir.path()).unwrap(), None);
    write_maps(
        dir.path(),
        &maps,
        &MapsOptions { sample_mm: Some([60.0, 35.5]), uncertainty: None },
    )
    .unwrap();
    assert_eq!(read_sample_mm(dir.path()).unwrap(), Some([60.0, 35.5]));
    assert_eq!(read_maps(dir.path()).unwrap().texels(), 84);
    std::fs::remove_file(dir.path().join("maps.exr")).unwrap();
    // PNG stores whole texels per metre: an error of half of one in 200.
    let [x, y] = read_sample_mm(dir.path()).unwrap().unwrap();
    assert!((x - 60.0).abs() < 0.16 && (y - 35.5).abs() < 0.1, "{x} {y}");
    assert!(
        write_maps(
            dir.path(),
            &maps,
            &MapsOptions { sample_mm: Some([0.0, 1.0]), uncertainty: None }
        )
        .is_err()
    );
    std::fs::remove_file(dir.path().join("normal.png")).unwrap();
    assert!(read_sample_mm(dir.path()).unwrap_err().to_string().contains("normal"));
}

#[test]
fn values_that_are_not_finite_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let mut maps = varied(6, 4);
    maps.specular_mut()[2][8] = f32::NAN;
    write_maps(dir.path(), &maps, &MapsOptions::default()).unwrap();
    let fault = read_maps(dir.path()).unwrap_err();
    let text = fault.to_string();
    assert!(matches!(&fault, Error::Field { .. }) && text.contains("maps.exr"), "{text}");
    assert!(text.contains("specular.B") && text.contains("column 2, row 1"), "{text}");
}

#[test]
fn a_slope_to_the_right_is_red_and_one_upwards_green() {
    let dir = tempfile::tempdir().unwrap();
    let mut maps = Svbrdf::new(2, 1);
    maps.normal_slopes_mut()[0][0] = 1.0;
    maps.normal_slopes_mut()[1][1] = 1.0;
    write_maps(dir.path(), &maps, &MapsOptions::default()).unwrap();
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
    write_maps(dir.path(), &varied(4, 4), &MapsOptions::default()).unwrap();
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
    // A folder blocks the rename: no temporary file remains.
    let taken = dir.path().join("taken");
    std::fs::create_dir(&taken).unwrap();
    std::fs::write(taken.join("inside"), b"").unwrap();
    let fault = write_atomic(&taken, b"data").unwrap_err();
    assert!(fault.to_string().contains("taken"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
    // Nothing can be created below a file.
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
    let whole = lobed(12, 9);
    let small = resized(&whole, 5, 4);
    for c in 0..LOBES {
        let mean = |m: &Svbrdf| m.lobe(c).unwrap().iter().sum::<f32>() / m.texels() as f32;
        assert!((mean(&small) - mean(&whole)).abs() < 1e-5, "lobe {c}");
    }
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
    // Magnified six times: pictures of 240 x 120 px below captions of 24 px, 12 px apart.
    assert_eq!(sheet.dimensions(), (4 * 240 + 5 * 12, 2 * (120 + 24) + 3 * 12));
    // Each of the eight pictures has content and a caption.
    for (column, row) in (0..4).flat_map(|c| (0..2).map(move |r| (c, r))) {
        let (x0, y0) = (12 + column * 252, 12 + row * 156);
        let bright = |x: u32, y: u32| sheet.get_pixel(x0 + x, y0 + y)[1] > 60;
        let any = |rows: std::ops::Range<u32>| {
            rows.flat_map(|y| (0..240).map(move |x| (x, y))).any(|(x, y)| bright(x, y))
        };
        assert!(any(0..24), "caption {column} {row}");
        assert!(any(24..144), "picture {column} {row}");
    }
    // Lobes add a row between both.
    write_preview(&path, &lobed(40, 20), [100.0, 50.0]).unwrap();
    let sheet = picture(&path).into_rgb8();
    assert_eq!(sheet.height(), 3 * (120 + 24) + 4 * 12);
    let bright = |column: u32, row: u32| {
        let pixels = (0..240).flat_map(|x| (24..144).map(move |y| (x, y)));
        let at = |(x, y)| sheet.get_pixel(12 + column * 252 + x, 12 + row * 156 + y)[1];
        pixels.filter(|pixel| at(*pixel) > 60).count()
    };
    assert!(bright(0, 1) > 9000 && bright(1, 1) > 9000);
    // Sheen is on a third of the texels.
    assert!((5000..9600).contains(&bright(2, 1)) && bright(3, 1) == 0);
    assert!((0..4).all(|column| bright(column, 2) > 1000));
}
