use glam::{DVec2, DVec3};

use super::*;
use crate::calibration::photometry::tests::{camera, photograph, pose};
use crate::calibration::photometry::{Lobe, Vignetting};
use crate::photo::ToneCurve;

fn unit_radiometry() -> Radiometry {
    Radiometry {
        gain: [1.0; 3],
        tone: ToneCurve::default(),
        veil: 0.0,
        vignetting: Vignetting::default(),
        lobe: Lobe::default(),
        flash_offset_mm: DVec3::ZERO,
        power_mm2: [1.0; 3],
        ambient: [0.0; 3],
        log_sigma: 0.0,
    }
}

fn photo(rgb: Vec<f32>, saturation: f32) -> Photo {
    Photo::from_linear(camera().width, camera().height, rgb, 1.0, saturation).unwrap()
}

fn top(size: usize) -> TopView {
    TopView { sample_mm: [100.0, 90.0], height_mm: 0.0, width: size, height: size, edge_px: 0.0 }
}

#[test]
fn dots_land_on_their_texels() {
    let dots = [DVec2::new(-38.0, 31.0), DVec2::new(22.5, 17.0), DVec2::new(5.0, -36.0)];
    for (tilt_x, tilt_y, roll) in [(0.0, 0.0, 0.0), (0.7, -0.4, 0.5), (-0.9, 0.2, 2.6)] {
        let pose = pose(tilt_x, tilt_y, roll, 260.0);
        let rgb = photograph(&camera(), &pose, 3, |p, _| {
            let near = |d: &DVec2| (-(p - *d).length_squared() / 8.0).exp();
            [dots.iter().map(near).sum::<f64>(), p.x * 0.01 + 0.6, p.y * 0.01 + 0.6]
        });
        let (w, h) = (200, 180); // half a mm per texel
        let o = rectify(
            &photo(rgb, f32::INFINITY),
            &camera(),
            &pose,
            &unit_radiometry(),
            [100.0, 90.0],
            w,
            h,
        )
        .unwrap();
        for dot in dots {
            let (mut sum, mut moment) = (0.0, DVec2::ZERO);
            for y in 0..h {
                for x in 0..w {
                    let [mx, my] = o.view.texel_mm(w, h, x, y);
                    let at = DVec2::new(mx.into(), my.into());
                    if (at - dot).length() < 8.0 {
                        let v = f64::from(o.radiance(0, y * w + x));
                        sum += v;
                        moment += v * at;
                    }
                }
            }
            // 0.05 mm is a tenth of a texel, and a seventh of a pixel at the steepest tilt.
            assert!((moment / sum - dot).length() < 0.05, "{dot} found at {}", moment / sum);
        }
        // Planes encode positions, to check texel positions and channel order.
        for y in (5..h - 5).step_by(17) {
            for x in (5..w - 5).step_by(13) {
                let [mx, my] = o.view.texel_mm(w, h, x, y);
                let (gx, gy) = (o.radiance(1, y * w + x), o.radiance(2, y * w + x));
                // 0.0015 is 0.15 mm on the ramps: curvature of the perspective within a pixel.
                assert!((gx - (mx * 0.01 + 0.6)).abs() < 1.5e-3);
                assert!((gy - (my * 0.01 + 0.6)).abs() < 1.5e-3);
            }
        }
    }
}

/// Fine stripes in many directions, and blocks with sharp edges; mean 0.5.
fn fine_pattern(p: DVec2) -> f64 {
    let mut v = 0.5;
    for k in 0..6 {
        let a = f64::from(k) * 0.55 + 0.1;
        let frequency = 2.2 + 0.9 * f64::from(k); // radians per mm
        v += 0.06 * ((a.cos() * p.x + a.sin() * p.y) * frequency).sin();
    }
    let (i, j) = ((p.x / 1.7).floor() as i64, (p.y / 1.3).floor() as i64);
    let hash = (i.wrapping_mul(7919) ^ j.wrapping_mul(104_729)).wrapping_mul(2_654_435_761) >> 7;
    v + if hash & 1 == 0 { 0.12 } else { -0.12 }
}

/// RMS error against the pattern averaged over each texel.
fn rmse(o: &Observation) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    let n = 10;
    // A few thousand texels suffice.
    let step = (o.width() / 48).max(1);
    for y in (0..o.height()).step_by(step) {
        for x in (0..o.width()).step_by(step) {
            if o.weight(y * o.width() + x) <= 0.0 {
                continue;
            }
            let mut mean = 0.0;
            for i in 0..n * n {
                let at = |k: usize, s: usize, size: usize| {
                    (s as f64 + (k as f64 + 0.5) / n as f64) / size as f64
                };
                mean += fine_pattern(DVec2::new(
                    100.0 * (at(i % n, x, o.width()) - 0.5),
                    90.0 * (0.5 - at(i / n, y, o.height())),
                ));
            }
            let error = f64::from(o.radiance(0, y * o.width() + x)) - mean / (n * n) as f64;
            sum += error * error;
            count += 1.0;
        }
    }
    (sum / count).sqrt()
}

#[test]
fn fine_texture_is_averaged_not_aliased() {
    let mut failed = false;
    // (size, tilt, distance, largest error, least gain over bilinear)
    for (size, tilt, distance, limit, gain) in [
        (32, 0.2, 240.0, 0.008, 10.0),
        (48, 1.05, 200.0, 0.013, 4.5),
        (64, 0.7, 200.0, 0.010, 5.0),
        (128, 0.3, 200.0, 0.016, 1.2),
        (512, 0.2, 170.0, 0.035, 1.3),
    ] {
        let pose = pose(tilt, 0.05, 0.3, distance);
        let rgb = photograph(&camera(), &pose, 4, |p, _| [fine_pattern(p); 3]);
        let photo = photo(rgb, f32::INFINITY);
        let error = |filter| {
            let o =
                rectify_filtered(&photo, &camera(), &pose, &unit_radiometry(), top(size), filter);
            rmse(&o.unwrap())
        };
        let (adaptive, bilinear) = (error(Filter::Adaptive), error(Filter::Bilinear));
        println!("{size} texels, tilt {tilt}: {adaptive:.4}, bilinear {bilinear:.4}");
        failed |= !(adaptive < limit && bilinear > gain * adaptive);
    }
    assert!(!failed, "see the figures above");
}

#[test]
fn gain_and_vignetting_turn_values_into_radiance() {
    let pose = pose(0.4, -0.2, 0.3, 230.0);
    let vignetting = Vignetting { exponent: 5.0, curvature: -2.0 };
    let rgb = photograph(&camera(), &pose, 1, |_, tan2| {
        let v = vignetting.at(tan2);
        [0.4 * v, 0.2 * v, 0.1 * v]
    });
    let radiometry = Radiometry { gain: [2.0, 3.0, 5.0], vignetting, ..unit_radiometry() };
    for size in [64, 300] {
        let o = rectify(
            &photo(rgb.clone(), 1.0),
            &camera(),
            &pose,
            &radiometry,
            [100.0, 90.0],
            size,
            size,
        )
        .unwrap();
        for i in 0..size * size {
            if o.weight(i) > 0.0 {
                for (c, expected) in [0.8, 0.6, 0.5].into_iter().enumerate() {
                    let v = o.radiance(c, i);
                    // Interpolation of a smooth V, its table, f32.
                    assert!((v / expected - 1.0).abs() < 1e-3, "{v} {expected}");
                }
            }
        }
        assert_eq!(o.view.falloff, Falloff::InverseSquare { power_mm2: [1.0; 3] });
    }
}

#[test]
fn saturation_marks_texels_that_a_clipped_pixel_reaches() {
    let pose = pose(0.3, 0.1, 0.2, 230.0);
    // Red clips in a disc of radius 12 mm.
    let rgb: Vec<f32> = photograph(&camera(), &pose, 2, |p, _| {
        [if p.length() < 12.0 { 3.0 } else { 0.3 }, 0.4, 0.5]
    })
    .into_iter()
    .map(|v| v.min(1.0))
    .collect();
    for size in [40, 200] {
        let o = rectify(
            &photo(rgb.clone(), 1.0),
            &camera(),
            &pose,
            &Radiometry { gain: [2.0; 3], ..unit_radiometry() },
            [100.0, 90.0],
            size,
            size,
        )
        .unwrap();
        let texel = 100.0 / size as f32;
        for y in 0..size {
            for x in 0..size {
                let [mx, my] = o.view.texel_mm(size, size, x, y);
                let (r, v) = ((mx * mx + my * my).sqrt(), o.radiance(0, y * size + x));
                if r < 12.0 - texel {
                    assert!((v + 2.0).abs() < 0.01, "inside: {v}");
                } else if r < 12.0 {
                    assert!((-2.001..0.0).contains(&v), "edge: {v}");
                } else if r > 13.0 + 2.0 * texel + 1.5 {
                    // Dilation and interpolation reach one pixel each: about 1.4 mm.
                    assert!((v - 0.6).abs() < 0.01, "outside: {v} at {r}");
                }
                assert!((o.radiance(1, y * size + x) - 0.8).abs() < 1e-3);
                assert!((o.radiance(2, y * size + x) - 1.0).abs() < 1e-3);
            }
        }
    }
    // All of the sample is clipped.
    let burnt = photo(vec![1.0; 3 * 640 * 480], 1.0);
    assert!(matches!(
        rectify(&burnt, &camera(), &pose, &unit_radiometry(), [100.0, 90.0], 64, 64),
        Err(Rejection::Clipped { share }) if share > 0.99
    ));
}

#[test]
fn weights_are_the_cosine_inside_the_photo_and_zero_outside() {
    // Close-up: the sample is larger than the photo.
    let mut near = pose(0.3, 0.0, 0.0, 90.0);
    near.translation.x += 20.0;
    let rgb = vec![0.5; 3 * 640 * 480];
    let size = 150;
    let flat = photo(rgb, 1.0);
    let o =
        rectify(&flat, &camera(), &near, &unit_radiometry(), [100.0, 90.0], size, size).unwrap();
    let eye = DVec3::from_array(o.view.camera_mm.map(f64::from));
    let (mut inside, mut outside) = (0, 0);
    for y in 0..size {
        for x in 0..size {
            let [mx, my] = o.view.texel_mm(size, size, x, y);
            let point = DVec3::new(mx.into(), my.into(), 0.0);
            let pixel = camera().project(near.transform(point));
            let (weight, value) = (o.weight(y * size + x), o.radiance(0, y * size + x));
            // The texel's footprint (up to 3 px here) decides, not its centre.
            let margin = |m: f64| {
                pixel.is_some_and(|p| p.x >= m && p.y >= m && p.x <= 639.0 - m && p.y <= 479.0 - m)
            };
            if margin(3.0) {
                let cos = (eye - point).normalize().z;
                // Weights are stored in sevenths, values to 0.1 %.
                assert!((f64::from(weight) - cos).abs() <= 0.5 / 7.0 + 1e-5);
                assert!((value - 0.5).abs() < 5e-4);
                inside += 1;
            } else if !margin(0.0) {
                assert!(weight == 0.0 && value < 1e-7);
                outside += 1;
            }
        }
    }
    assert!(inside > 2000 && outside > 2000, "{inside} {outside}");

    let mut gone = near;
    gone.translation.x += 150.0;
    assert!(matches!(
        rectify(&flat, &camera(), &gone, &unit_radiometry(), [100.0, 90.0], size, size),
        Err(Rejection::SampleOutside { share }) if share < 0.25
    ));
    let grazing = pose(1.45, 0.0, 0.0, 300.0);
    assert!(matches!(
        rectify(&flat, &camera(), &grazing, &unit_radiometry(), [100.0, 90.0], size, size),
        Err(Rejection::TooGrazing { degrees, .. }) if degrees > 80.0
    ));
    let small = Photo::from_linear(2, 2, vec![0.5; 12], 1.0, 1.0).unwrap();
    assert!(matches!(
        rectify(&small, &camera(), &near, &unit_radiometry(), [100.0, 90.0], size, size),
        Err(Rejection::WrongSize { found_width: 2, .. })
    ));
}

#[test]
fn values_that_are_not_finite_have_no_weight_and_do_not_spread() {
    let pose = pose(0.2, 0.1, 0.0, 230.0);
    let mut rgb = vec![0.5; 3 * 640 * 480];
    rgb[3 * (240 * 640 + 320) + 1] = f32::NAN;
    for size in [50, 200] {
        let o = rectify(
            &photo(rgb.clone(), 1.0),
            &camera(),
            &pose,
            &unit_radiometry(),
            [100.0, 90.0],
            size,
            size,
        )
        .unwrap();
        let (radiance, weight) = o.planes();
        assert!(radiance.iter().all(|v| v.is_finite()));
        let lost = weight.iter().filter(|w| **w == 0.0).count();
        assert!(lost > 0 && lost < size * size / 100, "{lost}");
        for i in 0..size * size {
            assert!(o.weight(i) == 0.0 || (o.radiance(1, i) - 0.5).abs() < 1e-5);
        }
    }
}

/// A surface above the board: a dot painted where its ray meets the board appears at its position
/// on the surface.
#[test]
fn a_raised_surface_is_seen_where_it_is() {
    let pose = pose(0.6, 0.2, 0.2, 250.0);
    let height = 6.0;
    let dot = DVec3::new(12.0, -8.0, height);
    let eye = pose.camera_centre();
    let ray = dot - eye;
    let on_board = (eye - ray * (eye.z / ray.z)).truncate();
    let rgb =
        photograph(&camera(), &pose, 3, |p, _| [(-(p - on_board).length_squared() / 4.0).exp(); 3]);
    let o = rectify_raised(
        &photo(rgb, f32::INFINITY),
        &camera(),
        &pose,
        &unit_radiometry(),
        TopView {
            sample_mm: [100.0, 90.0],
            height_mm: height as f32,
            width: 200,
            height: 180,
            edge_px: 0.0,
        },
    )
    .unwrap();
    let best =
        (0..200 * 180).max_by(|&a, &b| o.radiance(0, a).total_cmp(&o.radiance(0, b))).unwrap();
    let [x, y] = o.view.texel_mm(200, 180, best % 200, best / 200);
    assert!((x - 12.0).abs() < 0.8 && (y + 8.0).abs() < 0.8, "{x} {y}");
    assert!((f64::from(o.view.camera_mm[2]) - (eye.z - height)).abs() < 1e-3);
}

#[test]
fn an_improved_radiometry_can_be_applied_afterwards() {
    let pose = pose(0.4, -0.2, 0.3, 230.0);
    let rgb: Vec<f32> =
        photograph(&camera(), &pose, 1, |p, _| [fine_pattern(p), 0.4, 0.5 + 0.005 * p.x])
            .into_iter()
            .map(|v| v.min(0.7))
            .collect();
    let photo = photo(rgb, 0.7);
    let old = unit_radiometry();
    let new = Radiometry {
        gain: [1.5, 0.8, 1.1],
        tone: ToneCurve::default(),
        veil: 0.0,
        vignetting: Vignetting { exponent: 4.0, curvature: 1.0 },
        lobe: Lobe { exponent: 3.0, pattern: [0.3, -0.2] },
        flash_offset_mm: DVec3::new(5.0, 9.0, 0.0),
        power_mm2: [2.0; 3],
        ambient: [0.1, 0.0, 0.0],
        log_sigma: 0.01,
    };
    let size = 130;
    let make = |r| rectify(&photo, &camera(), &pose, r, [100.0, 90.0], size, size).unwrap();
    let (mut updated, expected) = (make(&old), make(&new));
    update_radiometry(&mut updated, &camera(), &pose, 0.0, &old, &new);
    assert_eq!(updated.view, expected.view);
    let ((updated, weight), (expected, expected_weight)) = (updated.planes(), expected.planes());
    assert_eq!(weight, expected_weight);
    for (a, b) in updated.iter().zip(&expected) {
        assert!((a - b).abs() <= 3e-3 * b.abs(), "{a} {b}"); // three roundings of 0.1 %
    }
}

/// `cargo test --release rectification::tests::timing -- --ignored --nocapture`
#[test]
#[ignore = "prints timings"]
fn timing() {
    let big = Camera {
        width: 2016,
        height: 1512,
        fx: 1450.0,
        fy: 1450.0,
        cx: 1000.0,
        cy: 750.0,
        ..camera()
    };
    let rgb: Vec<f32> =
        (0..3 * 2016 * 1512).map(|i| 0.1 + 0.8 * ((i % 977) as f32 / 977.0)).collect();
    let photo = Photo::from_linear(2016, 1512, rgb, 1.0, 0.899).unwrap();
    for (size, distance) in [(256, 260.0), (1024, 260.0), (1024, 120.0), (2048, 260.0)] {
        for filter in [Filter::Adaptive, Filter::Bilinear] {
            let pose = pose(0.3, 0.2, 0.5, distance);
            let best = (0..5)
                .map(|_| {
                    let start = std::time::Instant::now();
                    let o = rectify_filtered(
                        &photo,
                        &big,
                        &pose,
                        &unit_radiometry(),
                        top(size),
                        filter,
                    );
                    assert!(o.is_ok());
                    start.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min);
            println!("{size} at {distance} mm, {filter:?}: {:.1} ms", best * 1e3);
        }
    }
}

/// Beside the edge of a dark sample on white paper, blurred texels have almost no weight and inner
/// ones full weight; those with full weight are not contaminated by the paper.
#[test]
fn contaminated_edge_texels_have_little_weight() {
    let pose = pose(0.3, -0.2, 0.4, 230.0);
    let inside = |p: DVec2| p.x.abs() < 50.0 && p.y.abs() < 45.0;
    // A box blur of 4 mm, several pixels wide, has a standard deviation of 1.15 mm.
    let blurred = |p: DVec2| {
        let taps = (0..25).map(|i| DVec2::new(f64::from(i % 5) - 2.0, f64::from(i / 5) - 2.0));
        taps.map(|d| if inside(p + 0.9 * d) { 0.1 } else { 0.8 }).sum::<f64>() / 25.0
    };
    let rgb = photograph(&camera(), &pose, 2, |p, _| [blurred(p); 3]);
    let size = 100;
    let seen = |edge_px| {
        let top = TopView { edge_px, ..top(size) };
        rectify_raised(
            &photo(rgb.clone(), f32::INFINITY),
            &camera(),
            &pose,
            &unit_radiometry(),
            top,
        )
    };
    let plain = seen(0.0).unwrap();
    let middle = size * size / 2 + size / 2;
    assert!((plain.radiance(0, middle) - 0.1).abs() < 0.01 && plain.radiance(0, size / 2) > 0.2);
    // Pixels per millimetre of the sample.
    let px_per_mm = camera().fx / 230.0;
    let faded = seen((1.15 * px_per_mm) as f32).unwrap();
    assert!(faded.weight(middle) == plain.weight(middle) && faded.weight(0) < 0.05);
    for t in 0..size * size {
        assert!(faded.weight(t) > 0.0, "no texel is lost");
        assert!(faded.weight(t) <= plain.weight(t));
        if faded.weight(t) > 0.5 {
            assert!(faded.radiance(0, t) < 0.15, "{t}: {}", faded.radiance(0, t));
        }
    }
}
