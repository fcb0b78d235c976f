use super::*;
use crate::estimate::noise::Noise;
use crate::estimate::options::NoiseOptions;
use crate::estimate::posterior::{At, covariance};
use crate::estimate::solver::tests::{errors, gauss, mean_noise, photographs};
use crate::estimate::solver::{Summary, solve};
use crate::observation::Observation;
use crate::render::tests::noise;
use crate::svbrdf::channel;
use std::sync::LazyLock;

const SIDE: usize = 48;
const SLOPES: Range<usize> = 0..2;
const ROUGHNESS: Range<usize> = 8..9;

/// A dark, glossy material with the given slopes.
fn material(mut slope: impl FnMut(usize, f32, f32) -> f32) -> Svbrdf {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    for c in 0..9 {
        for (t, v) in maps.plane_mut(c).iter_mut().enumerate() {
            *v = match c {
                0..2 => slope(c, (t % SIDE) as f32, (t / SIDE) as f32),
                2..5 => 0.05,
                5..8 => 0.06,
                _ => 0.35,
            };
        }
    }
    maps
}

fn solved(prior: &Prior, mean: &Svbrdf, photographs: &[Observation]) -> (Svbrdf, Summary) {
    let mut maps = mean.clone();
    let options = &NoiseOptions::default();
    let summary = solve(&mut maps, mean, prior, photographs, 8, options).unwrap();
    (maps, summary)
}

fn deviations<'a>(
    maps: &'a Svbrdf,
    mean: &'a Svbrdf,
    summary: &'a Summary,
    covariance: &'a Covariance,
    columns: usize,
) -> Deviations<'a> {
    static OPTIONS: LazyLock<ReliefOptions> = LazyLock::new(ReliefOptions::default);
    let noise = mean_noise(summary) / NoiseOptions::default().expected;
    let prior = &summary.prior;
    Deviations { options: &OPTIONS, maps, mean, prior, covariance, noise, columns }
}

fn at<'a>(maps: &'a Svbrdf, mean: &'a Svbrdf, prior: &'a Prior) -> At<'a> {
    At { maps, mean, prior, noise: Noise::expected(&NoiseOptions::default()) }
}

/// The prior that steps round a flat mean lead to.
fn narrowed(truth: &Svbrdf, photographs: &[Observation]) -> (Svbrdf, Prior) {
    let mut mean = truth.clone();
    (0..2).for_each(|c| mean.plane_mut(c).fill(0.0));
    let (maps, summary) = solved(&Prior::default(), &mean, photographs);
    let covariance = covariance(at(&maps, &mean, &summary.prior), photographs);
    let found = deviations(&maps, &mean, &summary, &covariance, SIDE);
    let narrowed = found.narrowed(&found.narrowed(&Prior::default(), SLOPES), ROUGHNESS);
    (mean, narrowed)
}

/// Noise that a narrower prior keeps out of flat maps, which a second solution shows.
#[test]
fn a_flat_material_is_found_to_be_flat() {
    let truth = material(|_, _, _| 0.0);
    let photographs = photographs(&truth, 5, 0.1, 3);
    let (mean, narrow) = narrowed(&truth, &photographs);
    assert!(narrow.sigma[0] < 0.2 * Prior::default().sigma[0], "{narrow:?}");
    assert!(narrow.sigma[8] < 0.2 * Prior::default().sigma[8], "{narrow:?}");
    assert_eq!(narrow.sigma[2..8], Prior::default().sigma[2..8]);
    let error = |prior| errors(&solved(prior, &mean, &photographs).0, &truth);
    let (wide, narrow) = (error(&Prior::default()), error(&narrow));
    for i in [0, 3] {
        assert!(narrow[i] < 0.5 * wide[i], "{i}: {narrow:?} {wide:?}");
    }
}

/// Slopes without anything in common with their neighbours, as noise would be, but seen well.
#[test]
fn sigma_comes_to_that_of_what_is_seen() {
    let mut random = noise(5);
    let truth = material(|_, _, _| 0.03 * gauss(&mut random));
    let (_, narrow) = narrowed(&truth, &photographs(&truth, 12, 0.005, 6));
    assert!((narrow.sigma[0] / 0.03 - 1.0).abs() < 0.15, "{narrow:?}");
    assert_eq!(narrow.sigma[0], narrow.sigma[1]);
}

/// Neighbours alike: the sigma is twice what they have in common, or stays as it is.
#[test]
fn relief_is_no_noise() {
    for (height, expected) in [(0.042, 0.06), (0.2, 0.1)] {
        let wave = |c: usize, x: f32, y: f32| height * (0.2 * if c == 0 { x } else { y }).sin();
        let truth = material(wave);
        let (_, narrow) = narrowed(&truth, &photographs(&truth, 12, 0.01, 7));
        assert!((narrow.sigma[0] / expected - 1.0).abs() < 0.1, "{narrow:?}");
    }
}

#[test]
fn a_coarser_covariance_is_of_every_second_texel() {
    let truth = material(|c, x, y| 0.05 * (0.3 * if c == 0 { x } else { y }).sin());
    let photographs = photographs(&truth, 5, 0.05, 8);
    let mean = material(|_, _, _| 0.0);
    let (maps, summary) = solved(&Prior::default(), &mean, &photographs);
    let prior = &summary.prior;
    let of = |columns: usize| {
        let small: Vec<_> = photographs.iter().map(Observation::downsampled).collect();
        let half = columns < SIDE;
        let covariance = if half {
            covariance(at(&maps.downsampled(), &mean.downsampled(), prior), &small)
        } else {
            covariance(at(&maps, &mean, prior), &photographs)
        };
        let found = deviations(&maps, &mean, &summary, &covariance, columns);
        found.narrowed(&Prior::default(), SLOPES).sigma[channel::SLOPE_X]
    };
    let (fine, coarse) = (of(SIDE), of(SIDE / 2));
    assert!((coarse / fine - 1.0).abs() < 0.1, "{fine} {coarse}");
}

#[test]
fn nothing_seen_nothing_narrowed() {
    let truth = material(|_, _, _| 0.0);
    let (_, narrow) = narrowed(&truth, &[]);
    assert_eq!(narrow, Prior::default());
}
