use super::*;
use crate::estimate::correction::Exposure;
use crate::estimate::options::EstimateOptions;
use crate::observation::{Falloff, Observation, View};
use crate::random::Random;
use crate::svbrdf::{CHANNELS, channel};
use crate::test_support::{photograph, view_from};

const SIDE: usize = 32;

/// Two colours of one gloss on a sheet that is flat, or bumpy.
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

/// Photographs with lights moved, exposures changed and radiances spoiled; their views as given.
fn photographs(truth: &Svbrdf, count: usize, exposure: &Exposure, noise: f32) -> Photographs {
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

fn planted() -> Exposure {
    let views: Vec<View> = (0..6).map(given).collect();
    let gains = vec![0.05, -0.04, 0.03, 0.0, -0.05, 0.02];
    let offset_mm = [6.0, -9.0, 3.0];
    Exposure { gains, exponent: 1.5, offset_mm, ..Exposure::as_given(views.iter()) }
}

fn options() -> EstimateOptions {
    EstimateOptions::default()
}

/// Gains and exponent share what they explain as their priors say: their sum is compared.
#[test]
fn planted_exposure_and_flash_are_found_and_none_where_there_is_none() {
    for exposure in [planted(), Exposure::default()] {
        let mut photographs = photographs(&material(0.0), 6, &exposure, 0.0);
        let options = options();
        let mut belief = Belief::new(Svbrdf::new(SIDE, SIDE), &EstimateOptions::default());
        fit(&mut photographs, &mut belief, options.structured.candidates[0], &options);
        let found = &photographs.correction().exposure;
        for (a, b) in found.offset_mm.iter().zip(exposure.offset_mm).take(2) {
            // A tenth of a degree at this distance is 0.25 mm.
            assert!((a - b).abs() < 1.5, "{found:?}");
        }
        let logs = |exposure: &Exposure| -> Vec<f64> {
            let all: Vec<f64> = (0..6).map(|i| exposure.factor(&given(i), Some(i)).ln()).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            all.into_iter().map(|v| v - mean).collect()
        };
        for (a, b) in logs(found).iter().zip(logs(&exposure)) {
            assert!((a - b).abs() < 0.03, "{found:?}");
        }
        let roughness = belief.mean.plane(channel::ROUGHNESS);
        let mean = roughness.iter().sum::<f32>() / roughness.len() as f32;
        assert!((mean - 0.35).abs() < 0.05, "{mean}");
        assert_eq!(belief.fixed_noise, Some(options.structured.noise as f32));
    }
}

fn chosen(photographs: &Photographs) -> Option<Widths> {
    let mut trials = WidthTrials::new(photographs, &material(0.0), &options());
    while !trials.is_done() {
        trials.step();
    }
    trials.chosen()
}

/// Photographs whose light is as given take no structured prior, whatever else spoils them.
#[test]
fn the_light_as_given_asks_for_no_structured_prior() {
    for (bumps, noise) in [(0.0, 0.15), (0.0, 0.002), (0.4, 0.0), (0.1, 0.002)] {
        let photographs = photographs(&material(bumps), 6, &Exposure::default(), noise);
        assert_eq!(chosen(&photographs), None, "bumps {bumps}, noise {noise}");
    }
}

/// A flat sheet takes a candidate with little relief, a bumpy one a candidate with more.
#[test]
fn relief_is_as_wide_as_the_sample_where_the_light_is_not_as_given() {
    let widths = |bumps| chosen(&photographs(&material(bumps), 6, &planted(), 0.01));
    let [flat, bumpy] = [0.0, 0.1].map(widths);
    assert!(flat.is_some_and(|w| w.slope < 0.05), "{flat:?}");
    assert!(bumpy.is_some_and(|w| w.slope >= 0.1), "{bumpy:?}");
}

/// Texels that share their gloss leave the noise, whatever relief they have and however exposure and flash
/// are off; of exact photographs they leave less than counts as none.
#[test]
fn texels_that_share_their_gloss_leave_the_noise() {
    let residual = |bumps, exposure: &Exposure, noise| {
        let photographs = photographs(&material(bumps), 6, exposure, noise);
        WidthTrials::new(&photographs, &material(0.0), &options()).texel_residual()
    };
    for exposure in [planted(), Exposure::default()] {
        for bumps in [0.0, 0.2] {
            let exact = residual(bumps, &exposure, 0.0);
            assert!(exact < options().noise.texels, "{exact}, bumps {bumps}");
            let mut random = Random::new(8);
            let mean = (0..4096).map(|_| random.bell().abs()).sum::<f64>() / 4096.0;
            for noise in [0.03, 0.1] {
                let (found, spread) = (residual(bumps, &exposure, noise), noise * mean as f32);
                // A median of skewed sums is a little below their mean; errors of steep relief add to it.
                assert!((0.7..1.3).contains(&(found / spread)), "{found}, {spread}, bumps {bumps}");
            }
        }
    }
}

/// Lights that are off by four degrees, and ambient light that is not stated, are found and not taken for noise.
#[test]
fn wrong_lights_are_no_noise() {
    let turn = |i: usize| [0.07 * (2.1 * i as f64).sin(), 0.07 * (2.1 * i as f64).cos()];
    let turns = (0..8).map(turn).collect();
    let correction = Correction { turns, ambient: 0.05, ..Correction::default() };
    let mut photographs = Photographs::new();
    for i in 0..8 {
        let taken = photograph(&material(0.2), correction.apply(&given(i), i));
        let (radiance, weight) = taken.planes();
        let stated = Observation::new(SIDE, SIDE, given(i), &radiance, &weight).unwrap();
        photographs.add(stated).unwrap();
    }
    let found = WidthTrials::new(&photographs, &material(0.0), &options()).texel_residual();
    assert!(found < options().noise.texels, "{found}");
}

/// What of the light is off by too little to be seen contradicts nothing.
#[test]
fn faults_of_the_light_that_cannot_be_seen_are_none() {
    let Exposure { gains, exponent, offset_mm, .. } = planted();
    let little = Exposure {
        gains: gains.iter().map(|g| 0.1 * g).collect(),
        exponent: 0.1 * exponent,
        offset_mm: offset_mm.map(|v| 0.1 * v),
        ..planted()
    };
    assert_eq!(chosen(&photographs(&material(0.02), 6, &little, 0.002)), None);
}

/// Candidates that predict alike have a mean; one that predicts far better is taken as it is.
#[test]
fn widths_are_a_mean_weighted_by_predictions() {
    let flat = photographs(&material(0.0), 4, &Exposure::default(), 0.15);
    let mut trials = WidthTrials::new(&flat, &material(0.0), &options());
    let candidates = options().structured.candidates;
    trials.errors[..2].copy_from_slice(&[0.02, 0.01]);
    assert_eq!(trials.chosen(), None, "none has predicted");
    trials.errors[2..].fill(0.01);
    let slopes = candidates.iter().map(|widths| widths.slope.ln()).sum::<f64>();
    let mean = (slopes / candidates.len() as f64).exp();
    let found = trials.chosen().unwrap();
    assert!(
        (found.slope / mean - 1.0).abs() < 1e-9 && (1..=8).contains(&found.classes),
        "{found:?}"
    );
    let (folds, better) = (trials.folds.len(), 4);
    trials.errors[2 + better * folds..][..folds].fill(0.004);
    let found = trials.chosen().unwrap();
    assert_eq!(found.classes, candidates[better].classes);
    assert!((found.slope / candidates[better].slope - 1.0).abs() < 1e-9, "{found:?}");
}

/// Trials end when no further one could change the choice: against tables of all errors, drawn at
/// random.
#[test]
fn trials_that_are_left_out_change_no_choice() {
    let flat = photographs(&material(0.0), 4, &Exposure::default(), 0.15);
    let mut random = Random::new(11);
    let (mut done, mut all, mut chosen) = (0, 0, 0);
    for case in 0..600 {
        let mut value = |low: f64, high: f64| low + (high - low) * random.uniform();
        let mut trials = WidthTrials::new(&flat, &material(0.0), &options());
        let mut table: Vec<f64> = trials.errors.iter().map(|_| value(0.3, 1.6)).collect();
        // nothing where as given it leaves nothing visible
        table[0] = if case % 7 == 0 { 0.0 } else { table[1] * value(0.9, 1.8) };
        let undone = std::mem::replace(&mut trials.errors, table.clone());
        let expected = trials.chosen();
        trials.errors = undone;
        while let Some(next) = trials.next() {
            assert!(trials.errors[next].is_nan());
            trials.errors[next] = table[next];
            done += 1;
        }
        assert_eq!(trials.chosen(), expected, "{case}: {table:?}");
        all += table.len();
        chosen += usize::from(expected.is_some());
    }
    assert!(chosen > 60 && 10 * done < 8 * all, "{chosen} chosen, {done} of {all}");
}

/// Trials whose errors are no numbers are done like others, and choose nothing.
#[test]
fn errors_that_are_no_numbers_end_the_trials() {
    let flat = photographs(&material(0.0), 4, &Exposure::default(), 0.15);
    for error in [f64::NAN, f64::INFINITY] {
        let mut trials = WidthTrials::new(&flat, &material(0.0), &options());
        for _ in 0..trials.errors.len() {
            if let Some(next) = trials.next() {
                trials.record(next, error);
            }
        }
        assert!(trials.is_done() && trials.chosen().is_none(), "{:?}", trials.errors);
        assert!(trials.errors.iter().all(|e| !e.is_infinite()));
    }
}

/// Two photographs whose flash and exposure are not as given contradict them; others do not.
#[test]
fn two_photographs_take_classes_where_the_light_is_not_as_given() {
    let wrong = photographs(&material(0.0), 2, &planted(), 0.01);
    assert_eq!(chosen(&wrong), Some(options().structured.few));
    let right = photographs(&material(0.0), 2, &Exposure::default(), 0.01);
    assert_eq!(chosen(&right), None);
}

/// With all of its own deviations an estimate is its own mean: nothing is lost between classes and
/// texels.
#[test]
fn classes_and_all_own_deviations_make_up_the_estimate() {
    let mut estimate = material(0.0);
    let mut random = Random::new(3);
    for c in GLOSS {
        let plane = estimate.plane_mut(c).iter_mut();
        plane.for_each(|v| *v *= 0.8 + 0.4 * random.uniform() as f32);
    }
    let photographs = photographs(&material(0.0), 2, &Exposure::default(), 0.0);
    let options = options();
    let sample = Arc::new(Sample::new(&photographs, SIDE, SIDE));
    let coordinates = sample.coordinates(&estimate);
    let setup = Setup::new(&sample, &[0, 1], 4, &options).around(&coordinates, 1.0);
    let classes = setup.classes.clone();
    let problem =
        setup.problem(&sample, vec![0, 1], options.structured.few, Light::AsGiven, &options);
    let state = problem.start(Correction::default());
    for (t, estimate) in coordinates.iter().enumerate() {
        let mean = problem.mean(t, &state);
        for c in channel::DIFFUSE..CHANNELS {
            // shares are in single precision
            assert!((mean[c] - estimate[c]).abs() < 1e-6, "{t} {c}: {} {}", mean[c], estimate[c]);
        }
    }
    let gloss = Gloss { classes, values: vec![[0.0; CHANNELS]; 4] };
    let maps = gloss.flat_maps(&estimate, Some(1.0), &photographs);
    for (found, expected) in maps.planes().iter().zip(estimate.planes()) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}
