use super::*;
use crate::estimate::correction::corrected;
use crate::observation::{Falloff, Observation, View};
use crate::random::Random;
use crate::render;

const SIDE: usize = 96;

/// Bumpy, with glossy and matt patches.
fn material() -> Svbrdf {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let i = y * SIDE + x;
            let (u, v) = (x as f32 / 9.0, y as f32 / 7.0);
            maps.plane_mut(channel::SLOPE_X)[i] = 0.2 * u.sin() * v.cos();
            maps.plane_mut(channel::SLOPE_Y)[i] = 0.15 * (u + v).cos();
            for c in 0..3 {
                maps.plane_mut(channel::DIFFUSE + c)[i] = 0.25 + 0.1 * (u * 0.7).sin();
                maps.plane_mut(channel::SPECULAR + c)[i] = 0.05 + 0.02 * v.sin();
            }
            maps.plane_mut(channel::ROUGHNESS)[i] = 0.4 + 0.15 * (0.5 * (u - v)).sin();
        }
    }
    maps
}

fn capture(maps: &Svbrdf, ambient: f32) -> (Vec<Observation>, Vec<View>) {
    let mut random = Random::new(4);
    let (mut observations, mut views) = (Vec::new(), Vec::new());
    for _ in 0..6 {
        let at = random.direction(0.6).map(|v| 120.0 * v as f32);
        let view = View {
            sample_mm: [100.0; 2],
            camera_mm: at,
            light_mm: at,
            falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
            ambient: [ambient; 3],
            mirrored: 1.0,
        };
        let mut radiance = vec![0.0; 3 * maps.texels()];
        render::render(maps, &view, &mut radiance);
        let (width, height) = (maps.width(), maps.height());
        let weight = vec![1.0; maps.texels()];
        observations.push(Observation::new(width, height, view, &radiance, &weight).unwrap());
        views.push(View { ambient: [0.0; 3], ..view });
    }
    (observations, views)
}

fn spoiled(maps: &Svbrdf) -> Svbrdf {
    let mut maps = maps.clone();
    maps.plane_mut(channel::ROUGHNESS).iter_mut().for_each(|r| *r += 0.05);
    for c in channel::DIFFUSE..channel::ROUGHNESS {
        maps.plane_mut(c).iter_mut().for_each(|a| *a *= 1.1);
    }
    for c in [channel::SLOPE_X, channel::SLOPE_Y] {
        maps.plane_mut(c).iter_mut().for_each(|s| *s *= 0.7);
    }
    maps
}

const TURNING: Free = Free { turn: true, ambient: true, mirror: false };
const HELD: Free = Free { turn: false, ..TURNING };

/// Photographs with their views as given, corrected.
fn photographs(
    observations: &[Observation],
    given: &[View],
    correction: &Correction,
) -> Photographs {
    let mut all = Photographs::new();
    for (observation, view) in observations.iter().zip(given) {
        let mut observation = observation.clone();
        observation.view = *view;
        all.add(observation).unwrap();
    }
    all.correct(correction.clone());
    all
}

/// Runs a fit to its end; whether correction and offset changed.
fn fit(
    start: &Svbrdf,
    (observations, given): (&[Observation], &[View]),
    free: Free,
    correction: &mut Correction,
    offset: &mut Offset,
) -> bool {
    let options = EstimateOptions::default();
    let (prior, photographs) = (Prior::default(), photographs(observations, given, correction));
    let begin =
        Start { photographs: &photographs, maps: start, base: start, prior: &prior, offset };
    let mut fit = LightFit::new(begin, free, &options).unwrap();
    while !fit.is_done() {
        fit.step();
    }
    let Some(result) = fit.result() else { return false };
    (*correction, *offset) = result;
    true
}

/// From an estimate that is taken for right as a whole.
fn refined(
    start: &Svbrdf,
    observations: &[Observation],
    given: &[View],
    free: Free,
    correction: &mut Correction,
) -> bool {
    fit(start, (observations, given), free, correction, &mut Offset::default())
}

#[test]
fn lights_are_found_together_with_the_texels() {
    let maps = material();
    let (observations, mut given) = capture(&maps, 0.0);
    let truth: Vec<_> = given.iter().map(|v| glam::Vec3::from(v.light_mm)).collect();
    for (i, view) in given.iter_mut().enumerate() {
        let error = if i % 2 == 0 { [0.05, -0.02] } else { [-0.03, 0.04] };
        *view = corrected(view, error, 0.0, 0.0);
    }
    let start = spoiled(&maps);
    let mut correction = Correction::default();
    assert!(refined(&start, &observations, &given, TURNING, &mut correction));
    let errors = truth.iter().enumerate().map(|(i, truth)| {
        let found = glam::Vec3::from(correction.apply(&given[i], i).light_mm);
        found.angle_between(*truth).to_degrees()
    });
    // the rest of what all lights share, slopes within their expected mean explain as well
    let mean = errors.sum::<f32>() / truth.len() as f32;
    assert!(mean < 0.7, "{mean} degrees, 3 at the start");
}

/// A correction that had stopped short, with what it lacked taken for ambient light: what is left to
/// explain is too little to turn lights as they were told, but these have turned.
#[test]
fn lights_that_have_turned_go_on() {
    let maps = material();
    let (observations, mut given) = capture(&maps, 0.0);
    let errors = [[0.05, -0.02], [-0.03, 0.04]];
    let mut correction = Correction { ambient: 0.02, ..Correction::default() };
    for (i, view) in given.iter_mut().enumerate() {
        *view = corrected(view, errors[i % 2], 0.0, 0.0);
        correction.turns.push(errors[i % 2].map(|e| -0.98 * e));
    }
    assert!(refined(&maps, &observations, &given, TURNING, &mut correction));
    assert!(correction.ambient < 0.005, "{}", correction.ambient);
}

#[test]
fn ambient_light_is_found_without_turning_lights() {
    let maps = material();
    let (observations, given) = capture(&maps, 0.04);
    let mut correction = Correction::default();
    refined(&maps, &observations, &given, HELD, &mut correction);
    assert!((correction.ambient - 0.04).abs() < 0.01, "{}", correction.ambient);
    assert!(correction.turns.iter().flatten().all(|&t| t == 0.0));
}

#[test]
fn an_estimate_that_took_ambient_light_for_albedo_is_found_out() {
    let maps = material();
    let (observations, given) = capture(&maps, 0.08);
    let mut estimate = maps.clone();
    for c in channel::DIFFUSE..channel::DIFFUSE + 3 {
        estimate.plane_mut(c).iter_mut().for_each(|a| *a *= 1.1);
    }
    let (mut correction, mut offset) = (Correction::default(), Offset::default());
    fit(&estimate, (&observations, &given), HELD, &mut correction, &mut offset);
    assert!((correction.ambient - 0.08).abs() < 0.005, "{}", correction.ambient);
    let before = rms(&estimate, &maps);
    let after = rms(&offset.applied(&estimate), &maps);
    assert!(after < 0.5 * before, "{before} {after}");
}

/// Squares of many albedos, exactly lit by the flash alone: what a wrong estimate of their gloss leaves is no
/// ambient light, though ambient light explains some of it.
#[test]
fn errors_of_the_estimate_are_no_ambient_light() {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    let mut random = Random::new(3);
    let squares: Vec<[f32; 3]> =
        (0..36).map(|_| [0; 3].map(|_| 0.05 + 0.9 * random.uniform() as f32)).collect();
    for t in 0..SIDE * SIDE {
        let square = squares[t / SIDE / 16 * 6 + t % SIDE / 16];
        for c in 0..3 {
            maps.plane_mut(channel::DIFFUSE + c)[t] = square[c];
            maps.plane_mut(channel::SPECULAR + c)[t] = 0.04;
        }
        maps.plane_mut(channel::ROUGHNESS)[t] = 0.4;
    }
    let (observations, given) = capture(&maps, 0.0);
    for (roughness, factor) in [(0.2, 2.0), (0.3, 0.8)] {
        let mut estimate = maps.clone();
        for c in channel::SPECULAR..channel::ROUGHNESS {
            estimate.plane_mut(c).iter_mut().for_each(|v| *v *= factor);
        }
        estimate.plane_mut(channel::ROUGHNESS).iter_mut().for_each(|v| *v += roughness);
        let mut correction = Correction::default();
        refined(&estimate, &observations[..3], &given[..3], HELD, &mut correction);
        assert_eq!(correction.ambient, 0.0);
    }
}

/// Of the diffuse albedos.
fn rms(a: &Svbrdf, b: &Svbrdf) -> f32 {
    let range = channel::DIFFUSE * a.texels()..(channel::DIFFUSE + 3) * a.texels();
    let pairs = a.planes()[range.clone()].iter().zip(&b.planes()[range.clone()]);
    (pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>() / range.len() as f32).sqrt()
}

#[test]
fn a_room_that_a_metal_mirrors_differently_in_each_photograph_is_found() {
    let mut maps = material();
    for c in 0..3 {
        maps.plane_mut(channel::DIFFUSE + c).fill(0.02);
        maps.plane_mut(channel::SPECULAR + c).iter_mut().for_each(|v| *v *= 10.0);
    }
    let factors = [0.4, 1.5, 0.7, 2.0, 1.0, 0.6];
    let (mut observations, mut views) = capture(&maps, 0.05);
    for ((o, view), factor) in observations.iter_mut().zip(&mut views).zip(factors) {
        o.view.mirrored = factor;
        let mut radiance = vec![0.0; 3 * maps.texels()];
        render::render(&maps, &o.view, &mut radiance);
        let weight = vec![1.0; maps.texels()];
        *o = Observation::new(SIDE, SIDE, o.view, &radiance, &weight).unwrap();
        *view = View { mirrored: 1.0, ..o.view };
    }
    let (mut correction, mut start) = (Correction::default(), maps.clone());
    for c in channel::SPECULAR..channel::ROUGHNESS {
        start.plane_mut(c).iter_mut().for_each(|v| *v *= 0.8);
    }
    let room = Free { turn: false, ambient: false, mirror: true };
    assert!(refined(&start, &observations, &views, room, &mut correction));
    for (i, factor) in factors.into_iter().enumerate() {
        let found = correction.apply(&views[i], i).mirrored;
        assert!((found / factor).ln().abs() < 0.1, "{i}: {found} {factor}");
    }
    assert_eq!(correction.ambient, 0.0);
}

#[test]
fn true_lights_stay() {
    let maps = material();
    let (observations, given) = capture(&maps, 0.0);
    let mut correction = Correction::default();
    refined(&maps, &observations, &given, TURNING, &mut correction);
    let zero = Correction { turns: vec![[0.0; 2]; given.len()], ..Default::default() };
    assert!(correction.distance(&zero, &LightOptions::default()) < 0.02, "{correction:?}");
}

/// What the least albedo adds to a black texel must be too little to see: turned lights and a sample
/// that bulges would explain it.
#[test]
fn right_lights_of_a_mirror_without_diffuse_albedo_stay() {
    let mut maps = material();
    for c in 0..CHANNELS {
        let value = match c {
            channel::SLOPE_X | channel::SLOPE_Y => 0.0,
            channel::ROUGHNESS => 0.2,
            c if c < channel::SPECULAR => 0.0,
            _ => 0.6,
        };
        maps.plane_mut(c).fill(value);
    }
    let (observations, given) = capture(&maps, 0.0);
    let mut correction = Correction::default();
    refined(&maps, &observations, &given, TURNING, &mut correction);
    let widest = correction.turns.iter().flatten().fold(0.0f64, |m, t| m.max(t.abs()));
    assert!(widest < 5e-4, "{widest} radians");
}
