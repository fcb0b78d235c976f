use super::*;
use crate::estimate::correction::LightCorrection;
use crate::estimate::options::EstimateOptions;
use crate::observation::{Falloff, Observation, View};
use crate::random::Random;
use crate::svbrdf::{CHANNELS, NO_LOBES, channel, lobe};
use crate::test_support::{photograph, view_from};

const SIDE: usize = 32;

/// Two colours of one gloss on a flat or bumpy sheet.
fn material(bumps: f32) -> Svbrdf {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    let mut random = Random::new(5);
    for t in 0..SIDE * SIDE {
        let dark = (t % SIDE / 4 + t / SIDE / 4).is_multiple_of(2);
        for c in 0..3 {
            maps.plane_mut(channel::DIFFUSE + c)[t] = if dark { 0.1 } else { [0.4, 0.3, 0.2][c] };
            maps.plane_mut(channel::SPECULAR + c)[t] = 0.05;
        }
        for c in [channel::SLOPE_X, channel::SLOPE_Y] {
            maps.plane_mut(c)[t] = bumps * (2.0 * random.uniform() as f32 - 1.0);
        }
        maps.plane_mut(channel::ROUGHNESS)[t] = 0.35;
    }
    maps
}

fn place(i: usize) -> [f32; 3] {
    let angle = 2.4 * i as f32;
    [50.0 * angle.sin(), 50.0 * angle.cos(), 140.0 + 12.0 * (i % 3) as f32]
}

fn given(i: usize) -> View {
    let falloff = Falloff::InverseSquare { power_mm2: [6e4; 3] };
    View { falloff, ..view_from(place(i)) }
}

/// Noisy photographs with a wrong exposure and flash; their views are uncorrected.
fn photographs(
    truth: &Svbrdf,
    count: usize,
    exposure: &LightCorrection,
    noise: f32,
) -> Photographs {
    let mut all = Photographs::new();
    let mut random = Random::new(8);
    let correction = Correction { exposure: exposure.clone(), ..Correction::default() };
    for i in 0..count {
        let taken = photograph(truth, correction.apply(&given(i), i));
        let (mut radiance, weight) = taken.planes();
        radiance.iter_mut().for_each(|v| *v *= 1.0 + noise * random.bell() as f32);
        let observation = Observation::new(SIDE, SIDE, given(i), &radiance, &weight).unwrap();
        all.add(observation).unwrap();
    }
    all
}

fn planted() -> LightCorrection {
    let views: Vec<View> = (0..6).map(given).collect();
    let log_gains = vec![0.05, -0.04, 0.03, 0.0, -0.05, 0.02];
    let offset_mm = [6.0, -9.0, 3.0];
    LightCorrection {
        log_gains,
        exponent: 1.5,
        offset_mm,
        ..LightCorrection::as_given(views.iter())
    }
}

fn options() -> EstimateOptions {
    EstimateOptions::default()
}

/// A prior of one class with one gloss.
fn one_class() -> JointPrior {
    JointPrior {
        between_classes: 0.001,
        specular: 0.002,
        roughness: 0.001,
        ..JointPrior::default()
    }
}

/// Runs a joint solve to its end.
fn fit(photographs: &mut Photographs, prior: JointPrior, board: bool) -> MapState {
    fit_with_lobes(photographs, prior, board).0
}

fn fit_with_lobes(
    photographs: &mut Photographs,
    prior: JointPrior,
    board: bool,
) -> (MapState, Vec<EstimatedLobes>) {
    let options = options();
    let mut map_state = MapState::new(Svbrdf::new(SIDE, SIDE), &options);
    let mut fit = JointFit::new(photographs, &map_state.maps, prior, board, &options);
    while !fit.is_done() {
        fit.step();
    }
    let lobes = fit.finish(photographs, &mut map_state);
    (map_state, lobes)
}

/// Compares the sum of gain and exponent, because their priors divide the explained part between them.
#[test]
fn exposure_and_flash_are_estimated() {
    for exposure in [planted(), LightCorrection::default()] {
        let mut photographs = photographs(&material(0.0), 6, &exposure, 0.0);
        let map_state = fit(&mut photographs, one_class(), true);
        let estimated = &photographs.correction().exposure;
        for (a, b) in estimated.offset_mm.iter().zip(exposure.offset_mm).take(2) {
            // An angle of 0.1 degrees is 0.25 mm at this distance.
            assert!((a - b).abs() < 1.5, "{estimated:?}");
        }
        let logs = |exposure: &LightCorrection| -> Vec<f64> {
            let all: Vec<f64> = (0..6).map(|i| exposure.factor(&given(i), Some(i)).ln()).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            all.into_iter().map(|v| v - mean).collect()
        };
        for (a, b) in logs(estimated).iter().zip(logs(&exposure)) {
            assert!((a - b).abs() < 0.03, "{estimated:?}");
        }
        let roughness = map_state.mean.plane(channel::ROUGHNESS);
        let mean = roughness.iter().sum::<f32>() / roughness.len() as f32;
        assert!((mean - 0.35).abs() < 0.05, "{mean}");
        assert_eq!(map_state.noise.scale, options().joint.two_photographs.noise as f32);
    }
}

/// Without a board, the solve estimates most of a rotation of the lights by four degrees and of unstated
/// ambient light.
#[test]
fn wrong_lights_are_corrected() {
    let rotation = |i: usize| [0.07 * (2.1 * i as f64).sin(), 0.07 * (2.1 * i as f64).cos()];
    let turns: Vec<[f64; 2]> = (0..8).map(rotation).collect();
    let planted = Correction { turns, ambient: 0.05, ..Correction::default() };
    let mut photographs = Photographs::new();
    for i in 0..8 {
        let taken = photograph(&material(0.0), planted.apply(&given(i), i));
        let (radiance, weight) = taken.planes();
        let stated = Observation::new(SIDE, SIDE, given(i), &radiance, &weight).unwrap();
        photographs.add(stated).unwrap();
    }
    let places = |correction: &Correction| -> Vec<glam::Vec3> {
        (0..8).map(|i| correction.apply(&given(i), i).light_mm.into()).collect()
    };
    let (truth, as_given) = (places(&planted), places(&Correction::default()));
    fit(&mut photographs, one_class(), false);
    let estimated = places(photographs.correction());
    let error = |places: &[glam::Vec3]| -> f32 {
        places.iter().zip(&truth).map(|(a, b)| a.angle_between(*b).powi(2)).sum::<f32>().sqrt()
    };
    assert!(
        error(&estimated) < 0.5 * error(&as_given),
        "{} {}",
        error(&estimated),
        error(&as_given)
    );
    let ambient = photographs.correction().ambient;
    assert!((ambient - 0.05).abs() < 0.025, "{ambient}");
}

fn chosen(photographs: &Photographs, maps: &Svbrdf) -> JointPrior {
    let mut choice = PriorChoice::new(photographs, maps, true, &options());
    let mut before = 0.0;
    while !choice.is_done() {
        choice.step();
        let [done, all] = choice.work();
        let fraction = done as f64 / all as f64;
        assert!(fraction >= before, "{fraction} after {before}");
        before = fraction;
    }
    choice.chosen().unwrap()
}

/// The choice keeps learned slopes that predict photographs and drops made-up ones.
#[test]
fn learned_slopes_are_kept_if_they_predict() {
    for bumps in [0.0, 0.2] {
        let photographs = photographs(&material(bumps), 6, &LightCorrection::default(), 0.02);
        let right = chosen(&photographs, &material(bumps));
        let made_up = chosen(&photographs, &material(0.2 - bumps));
        if bumps > 0.0 {
            assert!(right.relief > 0.95, "{right:?}");
        } else {
            assert!(made_up.relief < 0.05 && made_up.slope < 0.05, "{made_up:?}");
        }
    }
}

fn undone() -> PriorChoice {
    let flat = photographs(&material(0.0), 4, &LightCorrection::default(), 0.15);
    let mut choice = PriorChoice::new(&flat, &material(0.0), true, &options());
    // No lobe, no second direction.
    choice.end_round();
    choice.end_round();
    choice
}

/// Photographs of a brushed, a coated, a velvet and a plain material select the right lobes.
#[test]
fn optional_lobes_are_chosen_if_they_predict_and_estimated() {
    let with = |[x, y, coat, roughness]: [f64; 4]| {
        let [.., r, g, b, sheen] = NO_LOBES;
        [x, y, coat, roughness, r, g, b, sheen]
    };
    let (brushed, coated) = (with([0.8, -0.6, 0.0, 0.2]), with([0.0, 0.0, 1.0, 0.15]));
    let mut velvet = NO_LOBES;
    velvet[lobe::SHEEN..].copy_from_slice(&[0.4, 0.3, 0.2, 0.5]);
    let all = [None, Some(brushed), Some(coated), Some(velvet)];
    for (seed, lobes) in all.into_iter().enumerate() {
        let mut truth = material(0.0);
        let planes = lobes.iter().flatten().flat_map(|v| [*v as f32; SIDE * SIDE]);
        truth.set_lobes(planes.collect()).unwrap();
        let mut photographs = photographs(&truth, 5, &planted(), 0.02);
        let prior = chosen(&photographs, &material(0.0));
        let expected = [brushed, coated, velvet].map(|kind| lobes == Some(kind));
        let chosen = [prior.directions == 1, prior.coated, prior.sheen];
        assert_eq!(chosen, expected, "{seed}: {prior:?}");
        let estimated = fit(&mut photographs, prior, true).mean;
        let value = |i: usize| estimated.lobe(i).map_or(NO_LOBES[i] as f32, |plane| plane[0]);
        for (i, expected) in lobes.unwrap_or(NO_LOBES).into_iter().enumerate() {
            // The roughness of an absent coat or sheen is arbitrary.
            let absent = [(lobe::COAT_ROUGHNESS, coated), (lobe::SHEEN_ROUGHNESS, velvet)];
            if absent.iter().all(|(at, kind)| i != *at || lobes == Some(*kind)) {
                // Photographs from above show the tail of a sheen alone.
                let tolerance = if i < lobe::SHEEN { 0.1 } else { 0.15 };
                let found = f64::from(value(i));
                assert!((found - expected).abs() < tolerance, "{i}: {found} {expected}");
            }
        }
    }
}

/// Brushed and coated materials of a dozen strengths and angles, in photographs with wrong lights and noise: nine of
/// ten true parameters are within two of their standard deviations, which are below a third of most parameters.
#[test]
fn lobes_are_within_two_of_their_standard_deviations() {
    let (mut within, mut relative) = (0, Vec::new());
    for i in 0..12 {
        let (sin, cos) = (0.55 * f64::from(i)).sin_cos();
        let strength = 0.5 + 0.15 * f64::from(i % 5);
        let [weight, roughness] = [0.4 + 0.15 * f64::from(i % 4), 0.16 + 0.03 * f64::from(i % 5)];
        let anisotropic =
            (JointPrior { directions: 1, ..JointPrior::default() }, lobe::ANISOTROPY_X);
        let coated = (JointPrior { coated: true, ..JointPrior::default() }, lobe::COAT);
        let brushed = ([strength * cos, strength * sin], [strength; 2], anisotropic);
        let varnished = ([weight, roughness], [weight, roughness], coated);
        for (parameters, size, (prior, first)) in [brushed, varnished] {
            let mut lobes = NO_LOBES;
            lobes[first..first + 2].copy_from_slice(&parameters);
            let mut truth = material(0.05);
            truth.set_lobes(lobes.iter().flat_map(|v| [*v as f32; SIDE * SIDE]).collect()).unwrap();
            let mut photographs = photographs(&truth, 5, &planted(), 0.05);
            let (_, estimated) = fit_with_lobes(&mut photographs, prior, true);
            let [[values, deviations]] = estimated[..] else { panic!("{i}") };
            for c in first..first + 2 {
                let off = (values[c] - lobes[c]).abs() / deviations[c];
                within += usize::from(off < 2.0);
                relative.push(deviations[c] / size[c - first]);
            }
        }
    }
    relative.sort_by(f64::total_cmp);
    let all = relative.len();
    assert!(10 * within >= 9 * all, "{within} of {all}");
    // The weight of a coat is hardly known; the others are well within a third.
    assert!(relative[all / 2] < 0.33, "{relative:.2?}");
}

/// Bands of one colour whose directions differ by a quarter are told apart, texel by texel.
#[test]
fn two_directions_of_one_colour_are_told_apart() {
    let mut truth = Svbrdf::new(SIDE, SIDE);
    for c in 0..3 {
        truth.plane_mut(channel::DIFFUSE + c).fill(0.05);
        truth.plane_mut(channel::SPECULAR + c).fill(0.3);
    }
    truth.plane_mut(channel::ROUGHNESS).fill(0.4);
    let first = |t: usize| (t % SIDE / 5).is_multiple_of(2);
    let mut planes = vec![0.0; lobe::SHEEN * SIDE * SIDE];
    for t in 0..SIDE * SIDE {
        planes[t] = if first(t) { 0.9 } else { -0.9 };
        planes[lobe::COAT_ROUGHNESS * SIDE * SIDE + t] = 0.2;
    }
    truth.set_lobes(planes).unwrap();
    let mut photographs = photographs(&truth, 6, &LightCorrection::default(), 0.03);
    let prior = chosen(&photographs, &Svbrdf::new(SIDE, SIDE));
    assert_eq!((prior.directions, prior.coated, prior.sheen), (2, false, false), "{prior:?}");
    let estimated = fit(&mut photographs, prior, true).mean;
    let found = estimated.lobe(lobe::ANISOTROPY_X).unwrap().iter().enumerate();
    let off: Vec<f32> =
        found.map(|(t, u)| (*u - if first(t) { 0.9 } else { -0.9 }).abs()).collect();
    // Where all photographs see both directions alike, a texel stays between them.
    let right = off.iter().filter(|off| **off < 0.3).count();
    assert!(10 * right > 8 * off.len(), "{right} of {}", off.len());
}

/// Equal candidates are averaged; one that predicts far better is chosen alone.
#[test]
fn the_prior_is_a_mean_weighted_by_predictions() {
    let mut choice = undone();
    let candidates = options().joint.candidates;
    assert_eq!(choice.chosen(), None, "none has predicted");
    choice.errors.fill(0.01);
    let slopes = candidates.iter().map(|prior| prior.slope.ln()).sum::<f64>();
    let mean = (slopes / candidates.len() as f64).exp();
    let estimated = choice.chosen().unwrap();
    assert!((estimated.slope / mean - 1.0).abs() < 1e-9);
    assert!((estimated.relief - 3.0 / 4.0).abs() < 1e-9, "{estimated:?}");
    let (folds, better) = (choice.folds.len(), 2);
    choice.errors[better * folds..][..folds].fill(0.004);
    let estimated = choice.chosen().unwrap();
    assert_eq!(estimated.relief, 1.0);
    assert!((estimated.slope / candidates[better].slope - 1.0).abs() < 1e-9, "{estimated:?}");
}

/// Predictions end when no further one is likely to change the choice: candidates are better or worse by
/// about one factor for all photographs. Random tables of all errors give the expected choice.
#[test]
fn skipped_predictions_do_not_change_the_choice() {
    let mut random = Random::new(11);
    let (mut done, mut all) = (0, 0);
    let mut choice = undone();
    let open = choice.errors.clone();
    for case in 0..600 {
        let mut value = |low: f64, high: f64| low + (high - low) * random.uniform();
        let folds = choice.folds.len();
        let logarithms: Vec<f64> = open.iter().map(|_| value(-2.0, 2.0)).collect();
        let of = |i: usize| logarithms[i / folds * folds] + logarithms[i % folds];
        let table: Vec<f64> = (0..open.len()).map(|i| (of(i) + value(-0.02, 0.02)).exp()).collect();
        choice.errors.clone_from(&table);
        let expected = choice.chosen();
        choice.errors.clone_from(&open);
        while let Some(next) = choice.next() {
            assert!(choice.errors[next].is_nan());
            choice.errors[next] = table[next];
            done += 1;
        }
        assert_eq!(choice.chosen(), expected, "{case}: {table:?}");
        all += table.len();
    }
    assert!(10 * done < 9 * all, "{done} of {all}");
}

/// A prediction with an infinite or undefined error counts as made.
#[test]
fn errors_that_are_not_finite_end_the_choice() {
    for error in [f64::NAN, f64::INFINITY] {
        let mut choice = undone();
        for _ in 0..choice.errors.len() {
            if let Some(next) = choice.next() {
                choice.record(next, error);
            }
        }
        assert!(choice.is_done(), "{:?}", choice.errors);
        assert!(choice.errors.iter().all(|e| !e.is_infinite()));
    }
}

/// An estimate with all of its own deviations is its own mean: classes and texels lose nothing.
#[test]
fn classes_and_own_deviations_sum_to_the_estimate() {
    let mut estimate = material(0.0);
    let mut random = Random::new(3);
    for c in GLOSS {
        let plane = estimate.plane_mut(c).iter_mut();
        plane.for_each(|v| *v *= 0.8 + 0.4 * random.uniform() as f32);
    }
    let photographs = photographs(&material(0.0), 2, &LightCorrection::default(), 0.0);
    let mut options = options();
    options.joint.classes = 4;
    let sample = Arc::new(Sample::new(&photographs, SIDE, SIDE));
    let coordinates = sample.coordinates(&estimate);
    let prior = options.joint.two_photographs;
    let setup = Setup::new(&sample, &[0, 1], &prior, &coordinates, &options.joint);
    let setup = setup.around(&coordinates, 1.0);
    let classes = setup.classes.clone();
    let problem = setup.problem(&sample, vec![0, 1], &prior, true, &options);
    let state = problem.start(Correction::default());
    for (t, estimate) in coordinates.iter().enumerate() {
        let mean = problem.mean(t, &state);
        for c in channel::DIFFUSE..CHANNELS {
            // The shares are in single precision.
            assert!((mean[c] - estimate[c]).abs() < 1e-6, "{t} {c}: {} {}", mean[c], estimate[c]);
        }
    }
    let (values, directions) = (vec![[0.0; CHANNELS]; 4], Vec::new());
    let gloss = ClassGloss { classes, values, lobes: None, directions };
    let maps = gloss.maps(&estimate, Some(1.0), &photographs);
    for (estimated, expected) in maps.planes().iter().zip(estimate.planes()) {
        assert!((estimated - expected).abs() < 1e-5, "{estimated} {expected}");
    }
}
