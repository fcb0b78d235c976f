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
        let structured = StructuredOptions { steps: 25, texels: SIDE, ..options().structured };
        let options = EstimateOptions { structured, ..options() };
        let mut belief = Belief::new(Svbrdf::new(SIDE, SIDE), &EstimateOptions::default());
        fit(&mut photographs, &mut belief, options.structured.candidates[0], true, &options);
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

#[test]
fn nothing_is_corrected_where_a_board_tells_exposure_and_flash() {
    let mut photographs = photographs(&material(0.0), 4, &Exposure::default(), 0.02);
    let options = options();
    let mut belief = Belief::new(Svbrdf::new(SIDE, SIDE), &EstimateOptions::default());
    fit(&mut photographs, &mut belief, options.structured.candidates[0], false, &options);
    let found = &photographs.correction().exposure;
    assert!(found.gains.iter().all(|g| *g == 0.0) && found.offset_mm == [0.0; 3]);
    assert_eq!(photographs.full()[2].view, given(2));
}

fn chosen(photographs: &Photographs, free: bool) -> Option<Widths> {
    chosen_after(photographs, free, &[])
}

/// What is chosen when earlier maps have predicted photographs like this.
fn chosen_after(photographs: &Photographs, free: bool, predicted: &[Predicted]) -> Option<Widths> {
    let mut trials = WidthTrials::new(photographs, &material(0.0), free, predicted, &options());
    while !trials.is_done() {
        trials.step();
    }
    trials.chosen()
}

/// Photographs of a flat sheet that the model cannot explain (lights elsewhere, noise alike over
/// texels of a photograph) ask for one class; a bumpy one that it explains asks for none.
#[test]
fn flat_sheets_take_a_narrow_prior_and_explained_bumps_none() {
    let flat = photographs(&material(0.0), 6, &Exposure::default(), 0.15);
    // Maps before that were worse than either.
    let poor = [Predicted { error: 1.0, structured: false, photographs: 5 }];
    for free in [false, true] {
        let narrow = chosen_after(&flat, free, &poor);
        assert!(narrow.is_some_and(|w| w.slope < 0.05), "{narrow:?}");
    }
    let bumpy = photographs(&material(0.4), 6, &Exposure::default(), 0.0);
    assert_eq!(chosen_after(&bumpy, true, &poor), None);
}

/// Maps of the other phases that predict better than a narrow prior would go on; those of a narrow
/// prior are no such rivals.
#[test]
fn maps_that_predict_the_latest_photograph_better_go_on() {
    let flat = photographs(&material(0.0), 6, &Exposure::default(), 0.15);
    let after = |error: f64, structured| {
        chosen_after(&flat, true, &[Predicted { error, structured, photographs: 5 }]).is_some()
    };
    assert!(after(1.0, false) && !after(1e-6, false));
    assert!(after(1.0, true) && after(1e-6, true));
}

/// Noise makes every texel deviate, and small deviations are what a narrow prior is for; what is
/// explained to within noise and rounding needs none, unless it was chosen before.
#[test]
fn photographs_that_free_texels_explain_begin_no_narrow_prior() {
    let exact = photographs(&material(0.0), 6, &Exposure::default(), 0.002);
    assert_eq!(chosen(&exact, true), None);
}

/// Without maps before, a narrow prior needs more evidence; once chosen, less.
#[test]
fn a_choice_once_made_needs_less_evidence() {
    let flat = photographs(&material(0.0), 6, &Exposure::default(), 0.15);
    let mut options = options();
    let mut choose = |evidence: f64, alone: f64, structured: Option<bool>| {
        (options.structured.evidence, options.structured.evidence_alone) = (evidence, alone);
        let predicted =
            structured.map(|structured| Predicted { error: 1.0, structured, photographs: 5 });
        let predicted = predicted.as_slice();
        let choose = |free| {
            let mut trials = WidthTrials::new(&flat, &material(0.0), free, predicted, &options);
            while !trials.is_done() {
                trials.step();
            }
            trials.chosen().is_some()
        };
        let chosen = choose(false);
        let expected = chosen && structured.is_some();
        assert_eq!(choose(true), expected, "without a board and without maps before, none");
        chosen
    };
    assert!(choose(0.0, 0.0, Some(true)));
    assert!(!choose(0.0, 1.0, Some(false)) && choose(1.0, 0.0, Some(false)));
    assert!(!choose(1.0, 0.0, None) && choose(0.0, 1.0, None));
}

/// What predicts best in the sum may be no better than the maps before for the photographs that these
/// have predicted; the best of those that are better is taken then.
#[test]
fn the_best_of_the_candidates_that_are_better_is_taken() {
    let flat = photographs(&material(0.0), 6, &Exposure::default(), 0.15);
    let options = options();
    let candidates = &options.structured.candidates;
    let choose = |errors: &[f64], light: f64, as_given: f64| {
        let of = |(i, error): (usize, &f64)| Predicted {
            error: *error,
            structured: false,
            photographs: 6 - errors.len() + i,
        };
        let predicted: Vec<Predicted> = errors.iter().enumerate().map(of).collect();
        let mut trials = WidthTrials::new(&flat, &material(0.0), true, &predicted, &options);
        let folds = trials.folds.len();
        let mut errors = vec![1.0; 2 + candidates.len() * folds];
        errors[0] = light;
        let left_out = &mut errors[2..];
        left_out[..folds].copy_from_slice(&[0.4, 0.4, 0.2]);
        left_out[folds..2 * folds].copy_from_slice(&[0.1, 0.1, 0.6]);
        left_out[4 * folds..5 * folds].copy_from_slice(&[0.1, 0.1, 0.1]);
        errors.extend(vec![as_given; folds]); // of the best, the light as given
        errors.push(0.1); // residual of the widest
        assert!(trials.resume(&errors) && trials.is_done());
        trials.chosen()
    };
    assert_eq!(
        choose(&[1.0], 1.0, 1.0),
        Some(candidates[1]),
        "best in the sum, and for the latest"
    );
    assert_eq!(
        choose(&[0.5], 1.0, 1.0),
        Some(candidates[0]),
        "the other is no better for the latest"
    );
    assert_eq!(choose(&[0.5, 0.5], 1.0, 1.0), Some(candidates[1]), "but for the last two");
    assert_eq!(choose(&[0.05, 0.5], 1.0, 1.0), None, "nor for the last two");
    assert_eq!(choose(&[0.1], 1.0, 1.0), None);
    assert_eq!(
        choose(&[0.1], 2.0, 0.0),
        Some(candidates[4]),
        "the light is not as given: best of all"
    );
    assert_eq!(choose(&[0.1], 1.4, 0.2), Some(candidates[4]), "predictions confirm it");
    assert_eq!(choose(&[0.1], 1.4, 0.1), None, "as given it predicts as well");
}

/// Trials end when no further one could change the choice: against tables of all errors, drawn at
/// random.
#[test]
fn trials_that_are_left_out_change_no_choice() {
    let flat = photographs(&material(0.0), 4, &Exposure::default(), 0.15);
    let mut random = Random::new(11);
    let (mut done, mut all, mut narrow) = (0, 0, 0);
    for case in 0..600 {
        let mut value = |low: f64, high: f64| low + (high - low) * random.uniform();
        let error = value(0.5, 1.5);
        let of = |photographs, structured| Predicted { error, structured, photographs };
        let predicted = match case % 4 {
            0 => vec![],
            1 => vec![of(3, true)],
            2 => vec![of(3, false)],
            _ => vec![of(2, false), of(3, false)],
        };
        let mut trials = WidthTrials::new(&flat, &material(0.0), true, &predicted, &options());
        let (_, rest) = trials.errors.split_last().unwrap();
        let mut table: Vec<f64> = rest.iter().map(|_| value(0.3, 1.6)).collect();
        // nothing where as given it leaves nothing visible
        table[0] = if case % 7 == 0 { 0.0 } else { table[1] * value(0.9, 1.8) };
        table.push(value(0.0, 0.05));
        let undone = trials.save();
        assert!(trials.resume(&table));
        let expected = trials.chosen();
        assert!(trials.resume(&undone));
        while let Some(next) = trials.next() {
            assert!(trials.errors[next].is_nan());
            trials.errors[next] = table[next];
            done += 1;
        }
        assert_eq!(trials.chosen(), expected, "{case}: {table:?}");
        all += table.len();
        narrow += usize::from(expected.is_some());
    }
    assert!(narrow > 60 && 10 * done < 8 * all, "{narrow} narrow, {done} of {all}");
}

/// Trials whose errors are no numbers are done like others, and choose nothing.
#[test]
fn errors_that_are_no_numbers_end_the_trials() {
    let flat = photographs(&material(0.0), 4, &Exposure::default(), 0.15);
    for error in [f64::NAN, f64::INFINITY] {
        let mut trials = WidthTrials::new(&flat, &material(0.0), true, &[], &options());
        for _ in 0..trials.errors.len() {
            if let Some(next) = trials.next() {
                trials.record(next, error);
            }
        }
        assert!(trials.is_done() && trials.chosen().is_none(), "{:?}", trials.errors);
        assert!(trials.save().iter().all(|e| e.is_finite()));
    }
}

/// Two photographs whose flash and exposure are not as given contradict them; others do not, nor where
/// a board tells them.
#[test]
fn two_photographs_take_classes_where_the_light_is_not_as_given() {
    let wrong = photographs(&material(0.0), 2, &planted(), 0.01);
    assert_eq!(chosen(&wrong, true), Some(options().structured.few));
    assert_eq!(chosen(&wrong, false), None);
    let right = photographs(&material(0.0), 2, &Exposure::default(), 0.01);
    assert_eq!(chosen(&right, true), None);
}

/// More photographs of a bumpy sheet as well: one of the priors with relief is taken, unless the maps
/// before predicted clearly better; where the light is as given, or a board tells it, or nothing of it can
/// be seen, none.
#[test]
fn relief_is_kept_where_the_light_of_photographs_is_not_as_given() {
    let before = |error: f64| [Predicted { error, structured: false, photographs: 5 }];
    let wrong = photographs(&material(0.1), 6, &planted(), 0.01);
    let relief = chosen_after(&wrong, true, &before(1.0));
    assert!(relief.is_some_and(|w| w.slope >= 0.1), "{relief:?}");
    assert_eq!(chosen_after(&wrong, true, &before(1e-6)), None);
    assert!(chosen_after(&wrong, false, &before(1.0)).is_none_or(|w| w.slope < 0.1));
    let Exposure { gains, exponent, offset_mm, .. } = planted();
    let little = Exposure {
        gains: gains.iter().map(|g| 0.1 * g).collect(),
        exponent: 0.1 * exponent,
        offset_mm: offset_mm.map(|v| 0.1 * v),
        ..planted()
    };
    for (bumps, exposure) in [(0.02, little), (0.1, Exposure::default())] {
        let right = photographs(&material(bumps), 6, &exposure, 0.002);
        assert_eq!(chosen_after(&right, true, &before(1.0)), None, "{exposure:?}");
    }
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
    let maps = gloss.flat_maps(&estimate, Some(1.0), &photographs, &options.structured);
    for (found, expected) in maps.planes().iter().zip(estimate.planes()) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}
