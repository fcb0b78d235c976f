use super::*;
use crate::estimate::solver::solve;
use crate::random::Random;
use crate::test_support::{photograph, view_from};

const SIDE: usize = 64;

/// A knobbly, half glossy material.
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

/// A fit from a flat guess.
fn fitted(truth: &Svbrdf) -> (Belief, Photographs) {
    let photographs = photographs(truth, &[[0.0, 0.0], [60.0, 15.0], [-40.0, 50.0]]);
    let mut mean = truth.clone();
    mean.plane_mut(channel::SLOPE_X).fill(0.0);
    mean.plane_mut(channel::SLOPE_Y).fill(0.0);
    let mut belief = Belief::new(mean, &EstimateOptions::default());
    step(&mut belief, &photographs);
    (belief, photographs)
}

/// Eight steps of the solver, with the widths of the options.
fn step(belief: &mut Belief, photographs: &Photographs) {
    let EstimateOptions { noise, prior, .. } = EstimateOptions::default();
    let Belief { maps, mean, .. } = belief;
    let summary = solve(maps, mean, &prior, photographs.full(), 8, &noise).unwrap();
    belief.found = summary.prior;
}

fn record(belief: &Belief, photographs: &Photographs) -> FitRecord {
    FitRecord::new(photographs, belief, &EstimateOptions::default()).unwrap()
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
fn coordinates_move_and_albedos_follow_by_their_roots() {
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
fn features_of_a_turned_sample_are_turned() {
    use crate::networks::{COMPLETION_ODD, MAPS_ODD, half_turn};
    let truth = truth();
    let belief = fitted(&truth).0;
    let turned = |maps: &Svbrdf| {
        let mut planes = maps.planes().to_vec();
        half_turn(&mut planes, SIDE * SIDE, &MAPS_ODD);
        Svbrdf::from_planes(SIDE, SIDE, planes).unwrap()
    };
    let features = |belief: &Belief, truth: &Svbrdf, sign: f32| {
        let places = [[60.0, 15.0], [-40.0, 50.0]].map(|at: [f32; 2]| at.map(|v| sign * v));
        let record = record(belief, &photographs(truth, &places));
        record.features(&record.scales())
    };
    let mut expected = features(&belief, &truth, 1.0);
    half_turn(&mut expected, SIDE * SIDE, &COMPLETION_ODD);
    let belief = Belief { mean: turned(&belief.mean), maps: turned(&belief.maps), ..belief };
    let found = features(&belief, &turned(&truth), -1.0);
    // single precision, through the inverses of the texels' equations
    let off = found.iter().zip(&expected).fold(0f32, |a, (f, e)| a.max((f - e).abs()));
    assert!(off < 0.02, "{off}");
}

#[test]
fn features_are_what_training_makes_of_a_record() {
    let (mut belief, photographs) = fitted(&truth());
    belief.mean.plane_mut(channel::DIFFUSE).fill(0.09);
    let fit = record(&belief, &photographs);
    let Belief { maps, mean, found: prior, .. } = &belief;
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
    // variances are between nothing known and all
    assert!((0..CHANNELS).all(|c| (0.0..1.001).contains(&at(&features, 27 + c))));
}

#[test]
fn what_is_seen_stays_and_what_is_not_comes_nearer() {
    let networks = Networks::embedded().unwrap();
    let truth = truth();
    let (mut belief, photographs) = fitted(&truth);
    let fit = record(&belief, &photographs);
    let shift = fit.shift(&networks).unwrap();
    // Slopes that the photographs know well move less than those that they leave open.
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
    let before = error(&belief.maps);
    fit.complete(&networks, &mut belief.maps).unwrap();
    let after = error(&belief.maps);
    assert!(after < before, "{before} {after}");
    assert!(fit.complete(&networks, &mut Svbrdf::new(8, 8)).is_err());
}

#[test]
fn large_maps_are_completed_at_the_network_s_resolution() {
    let flat = Svbrdf::new(1024, 512);
    let photographs = photographs(&flat, &[[0.0; 2]]);
    let mut belief = Belief::new(flat, &EstimateOptions::default());
    let fit = record(&belief, &photographs);
    assert_eq!(fit.size(), [256, 128]);
    fit.complete(&Networks::embedded().unwrap(), &mut belief.maps).unwrap();
}
