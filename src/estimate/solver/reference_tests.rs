//! The reference project's rectified photographs, from another renderer with the same equations.
//! `SVBRDF_TEST_DATA` names their folder; the tests are skipped without it.

use super::tests::{errors, prior_of};
use super::*;
use crate::estimate::baseline::Baseline;
use crate::observation::{Falloff, View};
use crate::test_support::picture;
use std::path::{Path, PathBuf};

fn folder() -> Option<PathBuf> {
    let folder =
        std::env::var_os("SVBRDF_TEST_DATA").map(|d| Path::new(&d).join("captures/reference"));
    if folder.is_none() {
        eprintln!("SKIPPED: SVBRDF_TEST_DATA is not set");
    }
    folder
}

fn planes(path: &Path, decode: impl Fn(f32) -> f32) -> Vec<f32> {
    let image = picture(path).to_rgb32f();
    (0..3).flat_map(|c| image.pixels().map(move |p| p.0[c])).map(decode).collect()
}

fn srgb(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn maps(folder: &Path) -> Svbrdf {
    let normal = planes(&folder.join("normal.png"), |v| 2.0 * v - 1.0);
    let n = normal.len() / 3;
    let mut data: Vec<f32> =
        (0..2 * n).map(|i| normal[i] / normal[2 * n + i % n].max(0.1)).collect();
    data.extend(planes(&folder.join("diffuse.png"), srgb));
    data.extend(planes(&folder.join("specular.png"), srgb));
    data.extend(&planes(&folder.join("roughness.png"), |v| v)[..n]);
    let size = (n as f64).sqrt() as usize;
    let mut maps = Svbrdf::from_planes(size, size, data).expect("square maps");
    maps.clamp();
    maps
}

fn photographs(folder: &Path) -> Vec<Observation> {
    let text = std::fs::read_to_string(folder.join("capture.json")).expect("capture.json");
    let capture: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let point = |v: &serde_json::Value| [0, 1, 2].map(|i| v[i].as_f64().expect("a number") as f32);
    let frames = capture["frames"].as_array().expect("frames");
    frames
        .iter()
        .map(|frame| {
            let path = folder.join(frame["image"].as_str().expect("a path"));
            let radiance = planes(&path, |v| if v >= 1.0 { -1.0 } else { v.powf(2.2) });
            let n = radiance.len() / 3;
            let size = (n as f64).sqrt() as usize;
            let view = View {
                sample_mm: [100.0; 2],
                camera_mm: point(&frame["camera_mm"]),
                light_mm: point(&frame["light_mm"]),
                falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
                ambient: [0.0; 3],
                mirrored: 1.0,
            };
            Observation::new(size, size, view, &radiance, &vec![1.0; n]).unwrap()
        })
        .collect()
}

/// Mean squared error of unit normals, as in the paper's table.
fn normal_error(a: &Svbrdf, b: &Svbrdf) -> f64 {
    let (w, mut sum) = (a.width(), 0.0);
    for i in 0..a.texels() {
        let (m, n) = (a.normal(i % w, i / w), b.normal(i % w, i / w));
        sum += (0..3).map(|c| (m[c] - n[c]).powi(2) as f64).sum::<f64>();
    }
    sum / (3 * a.texels()) as f64
}

/// Renders the true maps and compares them with the reference's photographs.
#[test]
fn the_reference_photographs_are_reproduced() {
    let Some(folder) = folder() else { return };
    let (truth, photos) = (maps(&folder.join("truth")), photographs(&folder));
    let loss = render::loss(&truth, &photos);
    println!("mean log difference {loss:.5}");
    // Photographs have 8 bits: half a level at mid grey is 0.5 % of the linear value.
    assert!(loss < 0.02, "{loss}");
}

/// Five photographs, started at a single-image network's estimate: the solver predicts held-out photographs
/// and normals better than Adam on the maps.
#[test]
fn the_reference_example_ends_closer_than_the_baseline() {
    let Some(folder) = folder() else { return };
    let truth = maps(&folder.join("truth"));
    let start = maps(&folder.join("start"));
    let photos = photographs(&folder);
    let (given, held_out) = photos.split_at(5);
    let show = |name: &str, m: &Svbrdf| {
        let held_out = render::loss(m, held_out);
        println!(
            "{name:10} loss {:.4} held out {held_out:.4} normal MSE {:.5} errors {:.4?}",
            render::loss(m, given),
            normal_error(m, &truth),
            errors(m, &truth)
        );
        (held_out, normal_error(m, &truth))
    };
    show("start", &start);
    let mut adam = start.clone();
    let mut baseline = Baseline::new(&mut adam, given).unwrap();
    while !baseline.is_done() {
        baseline.step(&mut adam, given);
    }
    let by_adam = show("Adam", &adam);
    let solved = |prior: &Prior| {
        let mut maps = start.clone();
        let noise = Noise { scale: 0.05, huber: 0.02 };
        solve(&mut maps, &start, prior, given, 20, noise).unwrap();
        maps
    };
    // A single-image estimate has large errors and needs a wide prior.
    let by_map = show("MAP", &solved(&Prior { sigma: [0.3; CHANNELS] }));
    for prior in [Prior::default(), prior_of(&start, &truth)] {
        show("narrower", &solved(&prior));
    }
    assert!(by_map.0 < by_adam.0 && by_map.1 < by_adam.1, "{by_map:?} {by_adam:?}");
}
