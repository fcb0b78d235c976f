use super::*;
use crate::observation::{Falloff, View};
use crate::render;
use crate::svbrdf::channel;

fn networks() -> Arc<Networks> {
    Arc::new(Networks::embedded().unwrap())
}

/// A bumpy two-tone material.
pub(super) fn material(side: usize) -> Svbrdf {
    let mut maps = Svbrdf::new(side, side);
    for y in 0..side {
        for x in 0..side {
            let i = y * side + x;
            let (u, v) = (x as f32 / side as f32 * 12.0, y as f32 / side as f32 * 12.0);
            let tone = if u.sin() * v.cos() > 0.0 { 0.6 } else { 0.25 };
            maps.plane_mut(channel::SLOPE_X)[i] = 0.3 * u.cos();
            maps.plane_mut(channel::SLOPE_Y)[i] = 0.3 * v.sin();
            for c in 0..3 {
                maps.plane_mut(channel::DIFFUSE + c)[i] = tone * [1.0, 0.7, 0.4][c];
            }
            maps.plane_mut(channel::ROUGHNESS)[i] = 0.2 + 0.6 * tone;
        }
    }
    maps
}

pub(super) fn photograph(truth: &Svbrdf, camera: [f32; 3]) -> Observation {
    let view = View {
        sample_mm: [100.0, 100.0],
        camera_mm: camera,
        light_mm: camera,
        falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
        ambient: [0.0; 3],
        mirrored: 1.0,
    };
    let mut radiance = vec![0.0; 3 * truth.texels()];
    render::render(truth, &view, &mut radiance);
    for v in &mut radiance {
        *v = if *v >= 1.0 { -1.0 } else { *v };
    }
    let (width, height) = (truth.width(), truth.height());
    let weight = vec![1.0; truth.texels()];
    Observation::new(width, height, view, &radiance, &weight).unwrap()
}

pub(super) const TOP: [f32; 3] = [0.0, 0.0, 107.0];
pub(super) const SIDE: [f32; 3] = [50.0, -20.0, 107.0];

#[test]
fn the_fit_begins_at_the_start_and_lowers_the_loss_over_all_photographs() {
    let networks = networks();
    let truth = material(64);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    let start = networks.photo_maps(&top).unwrap();
    let before = render::loss(&start, std::slice::from_ref(&top));
    let options = FitOptions {
        first_steps: 40,
        steps: 40,
        global_correction: false,
        ..FitOptions::default()
    };
    let mut fit = LatentFit::new(networks, &start, &top, options).unwrap();
    for (a, b) in fit.maps().planes().iter().zip(start.planes()) {
        // through the square-root encoding and back
        assert!((a - b).abs() < 1e-5);
    }
    let first = fit.step().unwrap();
    assert!((first.loss - before).abs() < 1e-3 * before);
    assert!(!first.settled && first.fraction > 0.0);
    while !fit.step().unwrap().settled {}
    let after = render::loss(&fit.maps(), std::slice::from_ref(&top));
    assert!(after < 0.7 * before, "{before} -> {after}");
    let both = [top, side.clone()];
    let before = render::loss(&fit.maps(), &both);
    fit.add_observation(&side).unwrap();
    assert!(!fit.is_settled());
    while !fit.step().unwrap().settled {}
    let after = render::loss(&fit.maps(), &both);
    assert!(after < 0.95 * before, "{before} -> {after}");
    // settled: further steps change nothing
    let maps = fit.maps();
    assert!(fit.step().unwrap().fraction == 1.0 && fit.maps() == maps);
}

#[test]
fn finer_levels_are_fitted_and_keep_their_detail_when_a_photograph_comes() {
    let networks = networks();
    let truth = material(512);
    let top = photograph(&truth, TOP);
    let start = networks.photo_maps(&top).unwrap();
    assert_eq!(start.width(), 256);
    let options = FitOptions { first_steps: 2, steps: 2, fine_steps: 2, ..FitOptions::default() };
    let mut fit = LatentFit::new(networks, &start, &top, options).unwrap();
    assert_eq!(fit.maps().width(), 512);
    let mut levels = Vec::new();
    loop {
        let report = fit.step().unwrap();
        levels.push(report.level);
        if report.settled {
            break;
        }
    }
    assert_eq!(levels, [0, 1, 1, 1]);
    let fine = fit.maps();
    fit.add_observation(&photograph(&truth, SIDE)).unwrap();
    // nothing has moved yet: the fine maps are still there
    let difference = fine
        .planes()
        .iter()
        .zip(fit.maps().planes())
        .fold(0.0f32, |a, (x, y)| a.max((x - y).abs()));
    assert!(difference < 1e-4, "{difference}");
    assert_eq!(fit.step().unwrap().level, 0);
    assert_eq!(fit.step().unwrap().level, 1);
    assert!(fit.maps() != fine);
    while !fit.step().unwrap().settled {}
    // maps from elsewhere are taken over exactly where they are in range
    fit.set_maps(&truth).unwrap();
    let difference = |a: &Svbrdf, b: &Svbrdf| {
        a.planes().iter().zip(b.planes()).fold(0.0f32, |m, (x, y)| m.max((x - y).abs()))
    };
    assert!(difference(&fit.maps(), &truth) < 1e-5);
    assert!(fit.set_maps(&material(64)).is_err());
}

#[test]
fn the_same_steps_give_the_same_bits_whatever_the_threads() {
    let networks = networks();
    let truth = material(64);
    let top = photograph(&truth, TOP);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let start = networks.photo_maps(&top).unwrap();
            let options = FitOptions { steps: 5, ..FitOptions::default() };
            let mut fit = LatentFit::new(networks.clone(), &start, &top, options).unwrap();
            while !fit.step().unwrap().settled {}
            fit.maps()
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(1));
}

#[test]
fn photographs_that_were_not_fitted_bring_their_steps_along() {
    let truth = material(32);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    let options = FitOptions { first_steps: 8, steps: 3, ..FitOptions::default() };
    let mut fit = LatentFit::new(networks(), &truth, &top, options).unwrap();
    let mut steps_of_the_next = |left_early: bool| {
        fit.step().unwrap();
        if left_early {
            fit.count_as_fitted();
        }
        fit.add_observation(&side).unwrap();
        let mut steps = 1;
        while !fit.step().unwrap().settled {
            steps += 1;
        }
        fit.add_observation(&side).unwrap();
        steps
    };
    assert_eq!(steps_of_the_next(false), 6);
    assert_eq!(steps_of_the_next(true), 3);
}

#[test]
fn black_and_unseen_photographs_do_not_break_the_fit() {
    let networks = networks();
    let truth = material(32);
    let black = photograph(&truth, TOP).changed(|radiance, _| radiance.fill(0.0));
    let start = networks.photo_maps(&black).unwrap();
    let options = FitOptions { steps: 5, ..FitOptions::default() };
    let mut fit = LatentFit::new(networks, &start, &black, options).unwrap();
    while !fit.step().unwrap().settled {}
    let unseen = photograph(&truth, SIDE).changed(|_, weight| weight.fill(0.0));
    fit.add_observation(&unseen).unwrap();
    while !fit.step().unwrap().settled {}
    assert!(fit.maps().planes().iter().all(|v| v.is_finite()));
}

#[test]
fn sizes_that_do_not_fit_are_errors() {
    let networks = networks();
    let top = photograph(&material(64), TOP);
    let options = FitOptions::default();
    let odd = photograph(&material(40), TOP);
    assert!(LatentFit::new(networks.clone(), &material(40), &odd, options.clone()).is_err());
    assert!(LatentFit::new(networks.clone(), &material(48), &top, options.clone()).is_err());
    let mut fit = LatentFit::new(networks, &material(32), &top, options).unwrap();
    assert!(fit.add_observation(&odd).is_err());
    assert_eq!(fit.size(), [64, 64]);
}

#[test]
fn resolutions_far_above_the_finest_fitted_are_interpolated() {
    let networks = networks();
    let truth = material(1024);
    let top = photograph(&truth, TOP);
    let start = networks.photo_maps(&top).unwrap();
    let options = FitOptions {
        first_steps: 1,
        finest_texels: 256,
        global_correction: false,
        ..FitOptions::default()
    };
    let mut fit = LatentFit::new(networks, &start, &top, options).unwrap();
    while !fit.step().unwrap().settled {}
    let maps = fit.maps();
    assert_eq!([maps.width(), maps.height()], [1024, 1024]);
    assert_eq!(fit.coarse_maps().width(), 256);
    assert!(maps.planes().iter().all(|v| v.is_finite()));
}

#[test]
fn photographs_that_come_before_the_fit_has_settled_add_their_steps() {
    let networks = networks();
    let truth = material(32);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    let start = networks.photo_maps(&top).unwrap();
    let options = FitOptions { steps: 3, global_correction: false, ..FitOptions::default() };
    let mut fit = LatentFit::new(networks, &start, &top, options).unwrap();
    let steps_to_settle = |fit: &mut LatentFit| {
        let mut steps = 1;
        while !fit.step().unwrap().settled {
            steps += 1;
        }
        steps
    };
    fit.add_observation(&side).unwrap();
    assert_eq!(steps_to_settle(&mut fit), 6, "two came at once");
    fit.add_observation(&side).unwrap();
    assert_eq!(steps_to_settle(&mut fit), 3, "one alone");
    fit.set_observations(&[top, side.clone(), side]).unwrap();
    assert_eq!(steps_to_settle(&mut fit), 3, "known ones again: as one");
}
