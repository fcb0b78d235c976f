use super::*;
use crate::estimate::options::EstimateOptions;
use crate::estimate::solver::solve;
use crate::random::Random;
use crate::test_support::{photograph, view_from};

const SIDE: usize = 64;

/// A bumpy, half glossy material.
fn truth() -> Svbrdf {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    let mut random = Random::new(9);
    let waves: Vec<[f32; 3]> = (0..6)
        .map(|_| {
            let mut any = || random.uniform() as f32;
            [0.6 * any() - 0.3, 0.6 * any() - 0.3, 6.0 * any()]
        })
        .collect();
    for t in 0..SIDE * SIDE {
        let (x, y) = ((t % SIDE) as f32, (t / SIDE) as f32);
        let (mut slope, mut shade) = ([0.0; 2], 0.0);
        for [a, b, phase] in &waves {
            let (sin, cos) = (a * x + b * y + phase).sin_cos();
            slope = [slope[0] + a * cos, slope[1] - b * cos];
            shade += 0.05 * sin;
        }
        maps.plane_mut(channel::SLOPE_X)[t] = slope[0];
        maps.plane_mut(channel::SLOPE_Y)[t] = slope[1];
        for c in 0..3 {
            maps.plane_mut(channel::DIFFUSE + c)[t] = 0.3 + shade;
            maps.plane_mut(channel::SPECULAR + c)[t] = 0.05;
        }
        maps.plane_mut(channel::ROUGHNESS)[t] = 0.45 - shade;
    }
    maps
}

fn photographs(truth: &Svbrdf, places: &[[f32; 2]]) -> Photographs {
    let mut photographs = Photographs::new();
    let photograph = |&[x, y]: &[f32; 2]| photograph(truth, view_from([x, y, 100.0]));
    places.iter().for_each(|at| photographs.add(photograph(at)).unwrap());
    photographs
}

/// A fit from flat slopes.
fn fitted(truth: &Svbrdf) -> (MapState, Photographs) {
    let photographs = photographs(truth, &[[0.0, 0.0], [60.0, 15.0], [-40.0, 50.0]]);
    let mut mean = truth.clone();
    mean.plane_mut(channel::SLOPE_X).fill(0.0);
    mean.plane_mut(channel::SLOPE_Y).fill(0.0);
    let mut map_state = MapState::new(mean, &EstimateOptions::default());
    step(&mut map_state, &photographs);
    (map_state, photographs)
}

/// Eight steps of the solver with the default prior.
fn step(map_state: &mut MapState, photographs: &Photographs) {
    let MapState { maps, mean, prior, noise, .. } = map_state;
    solve(maps, mean, prior, photographs.full(), 8, *noise).unwrap();
}

fn record(map_state: &MapState, photographs: &Photographs) -> FitRecord {
    FitRecord::new(photographs, map_state).unwrap()
}

#[test]
fn shifts_are_interpolated_between_texel_centres() {
    for factor in [1, 2, 4] {
        let few = 8;
        let between = neighbours(few * factor, factor, few);
        for (i, ([a, b], share)) in between.into_iter().enumerate() {
            let at = (i as f32 + 0.5) / factor as f32 - 0.5;
            let found = a as f32 + share * (b as f32 - a as f32);
            assert!((found - at.clamp(0.0, 7.0)).abs() < 1e-5, "{factor} {i}: {found} {at}");
        }
    }
}

#[test]
fn shifts_move_coordinates_and_square_into_albedos() {
    let mut maps = Svbrdf::new(8, 4);
    let shift = Svbrdf::from_planes(4, 2, vec![0.1; CHANNELS * 8]).unwrap();
    let before = maps.clone();
    move_by(&mut maps, &shift);
    for c in 0..CHANNELS {
        for (after, before) in maps.plane(c).iter().zip(before.plane(c)) {
            let expected = to_coordinate(c, *before) + 0.1;
            assert!((to_coordinate(c, *after) - expected).abs() < 1e-6, "{c}");
        }
    }
}

#[test]
fn features_rotate_with_the_sample() {
    use crate::networks::{COMPLETION_ODD, MAPS_ODD, half_turn};
    let truth = truth();
    let map_state = fitted(&truth).0;
    let turned = |maps: &Svbrdf| {
        let mut planes = maps.planes().to_vec();
        half_turn(&mut planes, SIDE * SIDE, &MAPS_ODD);
        Svbrdf::from_planes(SIDE, SIDE, planes).unwrap()
    };
    let features = |map_state: &MapState, truth: &Svbrdf, sign: f32| {
        let places = [[60.0, 15.0], [-40.0, 50.0]].map(|at: [f32; 2]| at.map(|v| sign * v));
        let record = record(map_state, &photographs(truth, &places));
        record.features(&record.scales())
    };
    let mut expected = features(&map_state, &truth, 1.0);
    half_turn(&mut expected, SIDE * SIDE, &COMPLETION_ODD);
    let map_state =
        MapState { mean: turned(&map_state.mean), maps: turned(&map_state.maps), ..map_state };
    let found = features(&map_state, &turned(&truth), -1.0);
    // Single precision, through the inverses of the texels' equations.
    let off = found.iter().zip(&expected).fold(0f32, |a, (f, e)| a.max((f - e).abs()));
    assert!(off < 0.02, "{off}");
}

#[test]
fn features_match_those_of_training() {
    let (mut map_state, photographs) = fitted(&truth());
    map_state.mean.plane_mut(channel::DIFFUSE).fill(0.09);
    let fit = record(&map_state, &photographs);
    let MapState { maps, mean, prior, .. } = &map_state;
    let scales = fit.scales();
    let (n, record, features) = (SIDE * SIDE, fit.planes(), fit.features(&scales));
    assert_eq!(record.len(), (3 * CHANNELS + 45) * n + CHANNELS);
    let t = 20 * SIDE + 33;
    let at = |values: &[f32], plane: usize| values[plane * n + t];
    let root = |maps: &Svbrdf| maps.plane(channel::DIFFUSE)[t].sqrt();
    let sigma = &record[(3 * CHANNELS + 45) * n..];
    assert_eq!(sigma, prior.sigma);
    let slopes = maps.planes()[..2 * n].iter().map(|v| v * v).sum::<f32>();
    let steepness = (slopes / (2 * n) as f32).sqrt();
    let pairs = [
        (at(&features, 0), maps.plane(0)[t] / steepness),
        (at(&features, 2), 2.0 * (root(maps) - 0.4)),
        (at(&features, 9 + 2), 0.3 * (0.3 - root(maps)) / (sigma[2] * scales[2])),
        (at(&features, 18 + 2), 0.3 * (root(mean) - root(maps)) / (sigma[2] * scales[2])),
        (at(&features, 27), at(&record, 27)),
        (at(&features, 27 + 8), at(&record, 27 + 44)),
        (at(&features, 36), at(&record, 27 + 1)),
        (at(&features, 37), 3.0f32.ln()),
        (at(&features, 38), steepness.ln()),
        (at(&features, 39), scales[0].ln()),
        (at(&features, 42), scales[8].ln()),
    ];
    for (found, expected) in pairs {
        assert!((found - expected.clamp(-4.0, 4.0)).abs() < 1e-5, "{found} {expected}");
    }
    assert_eq!(features.len(), 43 * n);
    // Variances lie between determined and undetermined.
    assert!((0..CHANNELS).all(|c| (0.0..1.001).contains(&at(&features, 27 + c))));
}

#[test]
fn undetermined_slopes_move_closer_to_the_truth() {
    let networks = Networks::embedded().unwrap();
    let truth = truth();
    let (mut map_state, photographs) = fitted(&truth);
    let fit = record(&map_state, &photographs);
    let shift = fit.shift(&networks).unwrap();
    // Determined slopes move less than undetermined ones.
    let open = fit.covariance.plane(0, 0);
    let mut texels: Vec<usize> = (0..SIDE * SIDE).collect();
    texels.sort_by(|&a, &b| open[a].total_cmp(&open[b]));
    let moves = |texels: &[usize]| texels.iter().map(|&t| shift.plane(0)[t].abs()).sum::<f32>();
    let (known, unknown) = (&texels[..SIDE * SIDE / 10], &texels[SIDE * SIDE * 9 / 10..]);
    assert!(open[known[0]] < 0.1, "{}", open[known[0]]);
    assert!(moves(known) < 0.5 * moves(unknown), "{} {}", moves(known), moves(unknown));

    let error = |maps: &Svbrdf| {
        let of = |c: usize| {
            let pairs = maps.plane(c).iter().zip(truth.plane(c));
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>()
        };
        ((of(0) + of(1)) / (SIDE * SIDE) as f32).sqrt()
    };
    let before = error(&map_state.maps);
    fit.complete(&networks, &mut map_state.maps).unwrap();
    let after = error(&map_state.maps);
    assert!(after < before, "{before} {after}");
    assert!(fit.complete(&networks, &mut Svbrdf::new(8, 8)).is_err());
}

#[test]
fn large_maps_are_completed_at_the_resolution_of_the_network() {
    let flat = Svbrdf::new(1024, 512);
    let photographs = photographs(&flat, &[[0.0; 2]]);
    let mut map_state = MapState::new(flat, &EstimateOptions::default());
    let fit = record(&map_state, &photographs);
    assert_eq!(fit.size(), [256, 128]);
    fit.complete(&Networks::embedded().unwrap(), &mut map_state.maps).unwrap();
}
