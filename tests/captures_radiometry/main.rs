//! Photometry and rectification against captures rendered by an independent path tracer: with the
//! true poses, the white squares must give the true light back, and the true maps, rendered texel by
//! texel with the contract's BRDF, must reproduce the rectified photos.

mod capture;
#[path = "../common/picture.rs"]
mod picture;
#[path = "../common/test_data.rs"]
mod test_data;

use std::path::Path;

use glam::DVec3;
use picture::picture;
use svbrdf::calibration::photometry::{FlashOffset, PhotometricCalibrator, Radiometry};
use svbrdf::calibration::{LumaImage, detect, estimate_pose};
use svbrdf::observation::Observation;
use svbrdf::rectification::rectify;

use capture::{CAPTURES, Capture, SIZE, data, srgb_to_linear};

/// Scale, response and ambient from the white squares against the truth.
#[test]
fn white_squares_give_the_true_light() {
    let Some(root) = data() else { return };
    for name in CAPTURES {
        let capture = Capture::open(&root, name);
        for photos in [1, 3, capture.photos()] {
            let calibrator = capture.calibrate(photos, capture.flash());
            let p = calibrator.photometry().unwrap();
            let mut worst_scale = 0.0_f64;
            let mut text = String::new();
            for i in 0..photos {
                let r = calibrator.radiometry(i).unwrap();
                for c in 0..3 {
                    let error = r.gain[c] * capture.true_scale() - 1.0;
                    worst_scale = worst_scale.max(error.abs());
                    if c == 1 {
                        text += &format!(" {:+.2}", 100.0 * error);
                    }
                }
            }
            let mut worst_response = 0.0_f64;
            for cos in [0.995, 0.98, 0.95, 0.9, 0.85] {
                let v = p.vignetting.at(1.0 / (cos * cos) - 1.0) * cos.powf(p.lobe.exponent);
                let truth = capture.vignetting(cos) * cos.powf(capture.lobe_exponent());
                worst_response = worst_response.max((v / truth - 1.0).abs());
            }
            let truth = capture.true_ambient()[1];
            let (raw, sigma) = p.ambient_raw[1];
            println!(
                "{name}, {photos} photos: gain error (green, %){text}; worst {:.2}; response \
                 m {:.2} k {:.2} n {:.2} (true {:.2}), error to 32 degrees {:.2} %; ambient {:.4} (raw {raw:.4} +- \
                 {sigma:.4}), true {truth:.4}; black ratio {:.3}; residual {:.4}",
                100.0 * worst_scale,
                p.vignetting.exponent,
                p.vignetting.curvature,
                p.lobe.exponent,
                capture.lobe_exponent(),
                100.0 * worst_response,
                p.ambient[1],
                p.black_ratio[1],
                p.sigma,
            );
            // One frontal photo cannot tell the ambient from the rest and takes it as none.
            let blind = photos == 1 && truth > 0.0;
            let (scale, response) = match photos {
                1 if blind => (0.06, 0.06),
                1 => (0.008, 0.025),
                _ => (0.004, 0.014),
            };
            assert!(worst_scale < scale && worst_response < response, "{name}, {photos}");
            assert!(blind || (p.ambient[1] - truth).abs() < 0.003, "{name}, {photos}");
        }
    }
}

/// The same with nothing known of the flash.
#[test]
fn white_squares_give_the_flash_offset() {
    let Some(root) = data() else { return };
    for name in CAPTURES {
        let capture = Capture::open(&root, name);
        let flash =
            FlashOffset::Estimated { prior_mm: DVec3::ZERO, sigma_mm: DVec3::new(30.0, 30.0, 0.0) };
        for photos in [1, 3, capture.photos()] {
            let calibrator = capture.calibrate(photos, flash);
            let p = calibrator.photometry().unwrap();
            let error = (p.flash_offset_mm - capture.offset).length();
            println!(
                "{name}, {photos} photos: {:.2} +- {:.2}, true {:.2}: {error:.2} mm",
                p.flash_offset_mm, p.flash_offset_sigma_mm, capture.offset
            );
            // Its length trades with the lobe's exponent; 2 mm are 0.4 degrees.
            assert!(error < 2.0, "{name}, {photos}");
        }
    }
}

struct Maps {
    normal: Vec<DVec3>,
    diffuse: Vec<DVec3>,
    specular: [Vec<DVec3>; 2],
    roughness: Vec<f64>,
}

/// Which of the candidate forms the renderings follow.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Form {
    exact_smith: bool,
    specular_srgb: bool,
    ambient: Ambient,
}

/// Reflection of a uniform surround of radiance `a`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ambient {
    None,
    /// `a (kd + ks)`.
    Plain,
    /// `a (kd + A ks + B)` with the directional albedo of single-scattering GGX (Karis' fit).
    Directional,
}

impl Maps {
    fn open(folder: &Path) -> Self {
        let read = |name: &str| -> Vec<DVec3> {
            let image = picture(folder.join("truth").join(name));
            assert_eq!((image.width() as usize, image.height() as usize), (SIZE, SIZE));
            let raw = image.to_rgb16().into_raw();
            raw.chunks_exact(3)
                .map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()) / 65535.0)
                .collect()
        };
        let linear = |v: &DVec3| DVec3::from_array(v.to_array().map(srgb_to_linear));
        let specular = read("specular.png");
        Self {
            normal: read("normal.png").iter().map(|v| (*v * 2.0 - 1.0).normalize()).collect(),
            diffuse: read("diffuse.png").iter().map(linear).collect(),
            specular: [specular.clone(), specular.iter().map(linear).collect()],
            roughness: read("roughness.png").iter().map(|v| v.x).collect(),
        }
    }

    /// Radiance of a texel, straight from the formulae.
    fn radiance(&self, o: &Observation, x: usize, y: usize, form: Form) -> DVec3 {
        let i = y * SIZE + x;
        let [px, py] = o.view.texel_mm(SIZE, SIZE, x, y);
        let p = DVec3::new(px.into(), py.into(), 0.0);
        let to_light = DVec3::from_array(o.view.light_mm.map(f64::from)) - p;
        let to_eye = DVec3::from_array(o.view.camera_mm.map(f64::from)) - p;
        let (n, l, v) = (self.normal[i], to_light.normalize(), to_eye.normalize());
        let h = (l + v).normalize();
        let (nol, nov) = (n.dot(l).max(1e-6), n.dot(v).max(1e-6));
        let (noh, voh) = (n.dot(h).max(1e-6), v.dot(h).max(1e-6));
        let (kd, ks) = (self.diffuse[i], self.specular[usize::from(form.specular_srgb)][i]);
        let r = self.roughness[i];
        let alpha2 = r.powi(4);
        let d = alpha2 / (std::f64::consts::PI * (noh * noh * (alpha2 - 1.0) + 1.0).powi(2));
        let g1 = |c: f64| {
            if form.exact_smith {
                2.0 / (1.0 + (1.0 + alpha2 * (1.0 - c * c) / (c * c)).sqrt())
            } else {
                let k = r * r / 2.0;
                c / (c * (1.0 - k) + k)
            }
        };
        let f = ks + (DVec3::ONE - ks) * ((-5.55473 * voh - 6.98316) * voh).exp2();
        let brdf = kd / std::f64::consts::PI + f * (d * g1(nol) * g1(nov) / (4.0 * nol * nov));
        let svbrdf::observation::Falloff::InverseSquare { power_mm2 } = o.view.falloff else {
            panic!("photos of a board have inverse-square light")
        };
        brdf * (nol * f64::from(power_mm2[0]) / to_light.length_squared())
            + DVec3::from_array(o.view.ambient.map(f64::from))
                * match form.ambient {
                    Ambient::None => DVec3::ZERO,
                    Ambient::Plain => kd + ks,
                    Ambient::Directional => {
                        let x = 1.0 - r;
                        let low = (x * x).min((-9.28 * nov).exp2()) * x + 0.0425 - 0.0275 * r;
                        let scale = -1.04 * low + 1.04 - 0.572 * r;
                        let bias = 1.04 * low - 0.04 + 0.022 * r;
                        kd + ks * scale + DVec3::splat(bias)
                    }
                }
    }
}

/// Median relative difference and median ratio (photo over rendering).
fn compare(capture: &Capture, maps: &Maps, observations: &[Observation], form: Form) -> (f64, f64) {
    let (mut differences, mut ratios) = (Vec::new(), Vec::new());
    for o in observations {
        for y in (3..SIZE - 3).step_by(3) {
            for x in (3..SIZE - 3).step_by(3) {
                let i = y * SIZE + x;
                if o.weight(i) <= 0.0 {
                    continue;
                }
                let rendered = maps.radiance(o, x, y, form);
                for c in 0..3 {
                    let v = f64::from(o.radiance(c, i));
                    if v > 0.0 {
                        differences.push((v - rendered[c]).abs() / rendered[c].max(1e-3));
                        ratios.push(v / rendered[c].max(1e-3));
                    }
                }
            }
        }
    }
    assert!(differences.len() > 1_000, "{}", capture.folder.display());
    let median = |v: &mut Vec<f64>| {
        let middle = v.len() / 2;
        *v.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    (median(&mut differences), median(&mut ratios))
}

/// Rendering over photo at bright texels, sorted: saturated ones and others.
fn bright_ratios(maps: &Maps, observations: &[Observation], form: Form) -> [Vec<f64>; 2] {
    let mut ratios = [Vec::new(), Vec::new()];
    for o in observations {
        // Not at the outline, where the paper beyond clips.
        for y in (6..SIZE - 6).step_by(3) {
            for x in (6..SIZE - 6).step_by(3) {
                let i = y * SIZE + x;
                for c in 0..3 {
                    let v = f64::from(o.radiance(c, i));
                    if v.abs() > 0.5 && o.weight(i) > 0.0 {
                        let rendered = maps.radiance(o, x, y, form)[c];
                        ratios[usize::from(v > 0.0)].push(rendered / v.abs());
                    }
                }
            }
        }
    }
    for list in &mut ratios {
        list.sort_by(f64::total_cmp);
    }
    ratios
}

/// The whole chain as a session runs it: poses from the photos themselves.
#[test]
fn found_poses_do_as_well_as_true_ones() {
    let Some(root) = data() else { return };
    for name in CAPTURES {
        let capture = Capture::open(&root, name);
        let maps = Maps::open(&capture.folder);
        let photos = capture.photos();
        let mut calibrator = PhotometricCalibrator::new(capture.target.clone(), capture.flash());
        let mut poses = Vec::new();
        let mut seconds = 0.0;
        for i in 0..photos {
            let photo = capture.photo(i);
            let found = detect(&LumaImage::from_photo(&photo), &capture.target).unwrap();
            let estimate = estimate_pose(&capture.camera, &capture.target, &found.corners).unwrap();
            let start = std::time::Instant::now();
            calibrator.push(&photo, &capture.camera, &estimate.pose).unwrap();
            seconds += start.elapsed().as_secs_f64();
            poses.push(estimate.pose);
        }
        let observations: Vec<_> = (0..photos)
            .map(|i| {
                let (photo, r) = (capture.photo(i), calibrator.radiometry(i).unwrap());
                let mm = capture.sample_mm;
                rectify(&photo, &capture.camera, &poses[i], &r, mm, SIZE, SIZE).unwrap()
            })
            .collect();
        let form = Form { exact_smith: true, specular_srgb: true, ambient: Ambient::Plain };
        let (difference, ratio) = compare(&capture, &maps, &observations, form);
        println!(
            "{name}: found poses, estimated light: median difference {:.2} %, ratio {ratio:.4}; \
             photometry {:.0} ms a photo",
            100.0 * difference,
            1e3 * seconds / photos as f64
        );
        let limit = if name.starts_with("metal") { 0.2 } else { 0.03 };
        assert!(difference < limit, "{name}: {difference}");
    }
}

#[test]
fn true_maps_reproduce_the_rectified_photos() {
    let Some(root) = data() else { return };
    for name in CAPTURES {
        let capture = Capture::open(&root, name);
        let maps = Maps::open(&capture.folder);
        let photos = capture.photos();
        let calibrator = capture.calibrate(photos, capture.flash());
        let mut truth = Vec::new();
        let mut estimated = Vec::new();
        let mut shares = Vec::new();
        for i in 0..photos {
            let (photo, pose) = (capture.photo(i), capture.pose(i));
            let with = |r: &Radiometry| {
                rectify(&photo, &capture.camera, &pose, r, capture.sample_mm, SIZE, SIZE).unwrap()
            };
            truth.push(with(&capture.true_radiometry(i)));
            estimated.push(with(&calibrator.radiometry(i).unwrap()));
            let values = 0..3 * SIZE * SIZE;
            let clipped = values
                .filter(|v| truth[i].radiance(v / (SIZE * SIZE), v % (SIZE * SIZE)) < 0.0)
                .count();
            shares.push((100.0 * clipped as f64 / (3 * SIZE * SIZE) as f64).round());
        }
        println!("{name}: saturated share of the sample per frame (%): {shares:?}");
        let best = Form { exact_smith: true, specular_srgb: true, ambient: Ambient::Plain };
        for form in [
            best,
            Form { exact_smith: false, ..best },
            Form { specular_srgb: false, ..best },
            Form { ambient: Ambient::None, ..best },
            Form { ambient: Ambient::Directional, ..best },
        ] {
            let (difference, ratio) = compare(&capture, &maps, &truth, form);
            println!(
                "  true light, {form:?}: median difference {:.2} %, ratio {ratio:.4}",
                100.0 * difference
            );
            // The metal mirrors a room that is anything but uniform.
            let limit = if name.starts_with("metal") { 0.2 } else { 0.03 };
            assert!(form != best || difference < limit, "{name}: {difference}");
        }
        let [saturated, bright] = bright_ratios(&maps, &truth, best);
        let at = |list: &[f64], q: f64| list.get((q * list.len() as f64) as usize).copied();
        if let (Some(low), Some(middle), Some(noise)) =
            (at(&saturated, 0.05), at(&saturated, 0.5), at(&bright, 0.05))
        {
            println!(
                "  rendering over photo: saturated 5 % {low:.3}, median {middle:.3}; others as \
                 bright 5 % {noise:.3}"
            );
            // A saturated value is a lower bound, to the noise that bright texels have anyway:
            // highlights amplify the 8-bit steps of the normal map.
            assert!(low > noise.min(1.0) - 0.02 && middle > 1.2, "{name}");
        }
        let (difference, ratio) = compare(&capture, &maps, &estimated, best);
        println!("  estimated light: {:.2} %, ratio {ratio:.4}", 100.0 * difference);
        let (_, true_ratio) = compare(&capture, &maps, &truth, best);
        assert!((ratio / true_ratio - 1.0).abs() < 0.005, "{name}: {ratio} {true_ratio}");
    }
}
