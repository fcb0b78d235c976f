use super::*;
use crate::estimate::coordinates::to_coordinate;
use crate::observation::{Falloff, View};
use crate::render::tests::noise;
use crate::svbrdf::{RANGE, channel};

pub(crate) fn gauss(r: &mut impl FnMut() -> f32) -> f32 {
    (0..12).map(|_| r()).sum::<f32>() - 6.0
}

/// Random maps: slopes up to 0.3, all colours, metals and dielectrics, roughness 0.15 to 0.8.
pub(crate) fn truth(size: usize, seed: u64) -> Svbrdf {
    let mut r = noise(seed);
    let mut maps = Svbrdf::new(size, size);
    for c in 0..CHANNELS {
        for v in maps.plane_mut(c) {
            *v = match c {
                0 | 1 => 0.6 * r() - 0.3,
                8 => 0.15 + 0.65 * r(),
                2..5 => 0.03 + 0.7 * r() * r(),
                _ => 0.03 + 0.5 * r() * r(),
            };
        }
    }
    maps
}

/// The truth with normal noise of `sigma` in every coordinate.
pub(crate) fn perturbed(truth: &Svbrdf, sigma: f32, seed: u64) -> Svbrdf {
    let mut r = noise(seed);
    let mut maps = truth.clone();
    for c in 0..CHANNELS {
        for v in maps.plane_mut(c) {
            let x = to_coordinate(c, *v) + sigma * gauss(&mut r);
            let natural = if (2..8).contains(&c) { x * x.abs() } else { x };
            *v = natural.clamp(RANGE[c].0, RANGE[c].1);
        }
    }
    maps
}

/// Photographs from above the sample, the first from the top, with log-normal noise.
pub(crate) fn photographs(truth: &Svbrdf, count: usize, sigma: f32, seed: u64) -> Vec<Observation> {
    photographs_in(0.005, truth, count, sigma, seed)
}

/// Photographs in a room: white reflects `ambient` as a fraction of its reflection of the flash.
fn photographs_in(
    ambient: f32,
    truth: &Svbrdf,
    count: usize,
    sigma: f32,
    seed: u64,
) -> Vec<Observation> {
    let mut r = noise(seed);
    (0..count)
        .map(|i| {
            let mut offset = || if i == 0 { 0.0 } else { 160.0 * r() - 80.0 };
            let camera_mm = [offset(), offset(), 107.0];
            let light_mm = [camera_mm[0] + 3.0, camera_mm[1] - 5.0, 107.0];
            let falloff = Falloff::InverseSquare { power_mm2: [3.6e4; 3] };
            let view = View {
                sample_mm: [100.0; 2],
                camera_mm,
                light_mm,
                falloff,
                ambient: [ambient; 3],
                mirrored: 1.7,
            };
            let mut radiance = vec![0.0; 3 * truth.texels()];
            render::render(truth, &view, &mut radiance);
            for v in &mut radiance {
                *v *= (sigma * gauss(&mut r)).exp();
            }
            let weight = vec![1.0; truth.texels()];
            Observation::new(truth.width(), truth.height(), view, &radiance, &weight).unwrap()
        })
        .collect()
}

/// A prior with the estimate's true errors as sigmas: root mean squares, at least 0.001, pooled over the
/// three colours.
pub(crate) fn prior_of(estimate: &Svbrdf, truth: &Svbrdf) -> Prior {
    let square = |c: usize| {
        let pairs = estimate.plane(c).iter().zip(truth.plane(c));
        pairs.map(|(a, b)| (to_coordinate(c, *a) - to_coordinate(c, *b)).powi(2)).sum::<f32>()
    };
    let rms = |channels: std::ops::Range<usize>| {
        let count = (channels.len() * truth.texels()) as f32;
        (channels.map(square).sum::<f32>() / count).sqrt().max(1e-3)
    };
    let [slope, diffuse, specular, roughness] = [rms(0..2), rms(2..5), rms(5..8), rms(8..9)];
    let mut sigma = [slope; CHANNELS];
    sigma[2..5].fill(diffuse);
    sigma[5..8].fill(specular);
    sigma[channel::ROUGHNESS] = roughness;
    Prior { sigma }
}

/// Root mean square errors in coordinates: slopes, diffuse, specular, roughness.
pub(crate) fn errors(a: &Svbrdf, b: &Svbrdf) -> [f32; 4] {
    let s = prior_of(a, b).sigma;
    [s[0], s[2], s[5], s[8]]
}

const SIGMA: f32 = 0.1;
const NOISE: Noise = Noise { scale: 0.05, huber: 0.02 };

fn prior() -> Prior {
    Prior { sigma: [SIGMA; CHANNELS] }
}

/// Maps after `steps` steps from `start`, which is also the prior's mean, their loss, and that of the start.
fn run_with(start: &Svbrdf, photos: &[Observation], steps: usize) -> (Svbrdf, f64, f64) {
    let mut maps = start.clone();
    let loss = solve(&mut maps, start, &prior(), photos, steps, NOISE).unwrap();
    let mut clamped = start.clone();
    clamped.clamp();
    (maps, loss, render::loss(&clamped, photos))
}

fn run(start: &Svbrdf, photos: &[Observation]) -> (Svbrdf, f64, f64) {
    run_with(start, photos, 8)
}

/// Five clean photographs: the loss falls by far more than a factor of ten, and the error of every map falls.
#[test]
fn clean_photographs_are_explained() {
    let truth = truth(32, 1);
    let start = perturbed(&truth, SIGMA, 2);
    let (maps, loss, before) = run(&start, &photographs(&truth, 5, 0.0, 3));
    assert!(loss < 0.03 * before, "{loss}, {before} before");
    let (before, after) = (errors(&start, &truth), errors(&maps, &truth));
    // Slopes and diffuse albedo are determined best.
    let share = [0.45, 0.3, 0.8, 0.8];
    for i in 0..4 {
        assert!(after[i] < share[i] * before[i], "{before:?} {after:?}");
    }
}

/// Noise of 3 %, two to twenty photographs: every map improves, and more photographs never hurt.
#[test]
fn noisy_photographs_improve_every_map() {
    let truth = truth(32, 4);
    let start = perturbed(&truth, SIGMA, 5);
    let mut last = errors(&start, &truth);
    for count in [2, 5, 20] {
        let (maps, ..) = run(&start, &photographs(&truth, count, 0.03, 6));
        let now = errors(&maps, &truth);
        for i in 0..4 {
            assert!(now[i] < 0.98 * last[i], "{count} photographs: {now:?} after {last:?}");
        }
        last = now;
    }
}

/// One photograph does not determine nine parameters: the others stay at the start.
#[test]
fn one_photograph_does_no_harm() {
    let truth = truth(32, 7);
    let start = perturbed(&truth, SIGMA, 8);
    let (maps, loss, before) = run(&start, &photographs(&truth, 1, 0.03, 9));
    assert!(loss < 0.1 * before);
    let (before, after) = (errors(&start, &truth), errors(&maps, &truth));
    for i in 0..4 {
        // The errors are means of 1024 random texels, good to about 2 %.
        assert!(after[i] < 1.02 * before[i], "{before:?} {after:?}");
    }
}

/// A second, scalar implementation of the objective: no parameter of the result improves it when moved by
/// 0.01.
#[test]
fn no_nearby_texel_is_more_probable() {
    for ambient in [0.005, 0.2] {
        no_nearby_texel_is_more_probable_in(ambient);
    }
}

fn no_nearby_texel_is_more_probable_in(ambient: f32) {
    let truth = truth(8, 10);
    let start = perturbed(&truth, SIGMA, 11);
    let photos = photographs_in(ambient, &truth, 3, 0.03, 12);
    let (maps, ..) = run_with(&start, &photos, 40);
    let Noise { scale, huber } = NOISE;
    let objective = |maps: &Svbrdf, i: usize| {
        let mut sum = 0.0;
        for photo in &photos {
            let mut rendered = vec![0.0; 3 * maps.texels()];
            render::render(maps, &photo.view, &mut rendered);
            for c in 0..3 {
                let at = c * maps.texels() + i;
                let (r, o) = (rendered[at] as f64, photo.radiance(c, i) as f64);
                let residual = crate::loss::log_residual(r, o);
                sum += crate::loss::huber(residual, huber.into()) / f64::from(scale);
            }
        }
        for c in 0..CHANNELS {
            let x = |m: &Svbrdf| to_coordinate(c, m.plane(c)[i]);
            sum += 0.5 * ((x(maps) - x(&start)) / SIGMA).powi(2) as f64;
        }
        sum
    };
    let mut worse = 0;
    for i in 0..maps.texels() {
        let here = objective(&maps, i);
        assert!(here < objective(&start, i));
        for c in 0..CHANNELS {
            for d in [-0.01, 0.01] {
                let mut moved = maps.clone();
                let x = to_coordinate(c, maps.plane(c)[i]) + d;
                let natural = if (2..8).contains(&c) { x * x } else { x };
                moved.plane_mut(c)[i] = natural.clamp(RANGE[c].0, RANGE[c].1);
                worse += usize::from(objective(&moved, i) < here - 1e-3);
            }
        }
    }
    // A few texels crawl along kinks of the L1 or lie in a corner of the range.
    assert!(worse <= 12, "{worse} of {} neighbours are better", 18 * maps.texels());
}

#[test]
fn unseen_texels_keep_the_prior_mean() {
    let truth = truth(12, 13);
    let start = perturbed(&truth, SIGMA, 14);
    let mut photos = photographs(&truth, 2, 0.0, 15);
    for photo in &mut photos {
        *photo = photo.changed(|radiance, weight| {
            weight[..50].fill(0.0);
            radiance[..50].fill(f32::NAN);
        });
    }
    let mut clamped = start.clone();
    clamped.clamp();
    let (maps, loss, _) = run(&start, &photos);
    assert!(loss.is_finite());
    for c in 0..CHANNELS {
        for i in 0..maps.texels() {
            let (a, b) = (maps.plane(c)[i], clamped.plane(c)[i]);
            assert!(a.is_finite());
            // The least albedo kept is 0.001².
            assert!(i >= 50 || (a - b).abs() < 3e-5, "{a} {b}");
        }
    }
}

/// Clipped photographs of the truth leave the truth as it is.
#[test]
fn explained_saturation_does_not_pull() {
    let truth = truth(16, 16);
    let mut photos = photographs(&truth, 4, 0.0, 17);
    for photo in &mut photos {
        *photo = photo.changed(|radiance, _| {
            radiance.iter_mut().filter(|v| **v > 0.4).for_each(|v| *v = -0.4);
        });
    }
    let (maps, loss, before) = run(&truth, &photos);
    // Radiances err by up to 1/1024, on average by a third of that.
    assert!(before < 4e-4 && loss < 4e-4, "{loss}");
    let (unclipped, ..) = run(&truth, &photographs(&truth, 4, 0.0, 17));
    let (estimated, whole) = (errors(&maps, &truth), errors(&unclipped, &truth));
    // Rounding moves both; clipped photographs determine less.
    assert!(
        estimated.iter().zip(whole).all(|(f, w)| *f < 1.2 * w && w < 1.1e-3),
        "{estimated:?} {whole:?}"
    );
}

#[test]
fn results_repeat_for_any_number_of_threads() {
    let truth = truth(19, 18);
    let start = perturbed(&truth, SIGMA, 19);
    let photos = photographs(&truth, 3, 0.02, 20);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut maps = start.clone();
            let mut steps = Solver::new(&mut maps, &photos, &prior(), NOISE).unwrap();
            let mut losses = Vec::new();
            for _ in 0..3 {
                losses.push(steps.step(&mut maps, &start, &photos).unwrap());
            }
            (maps, losses)
        })
    };
    let (maps, losses) = run(1);
    // The step's own sum is the loss of the resulting maps, to single precision.
    let loss = render::loss(&maps, &photos);
    assert!((losses[2] - loss).abs() < 1e-5 * loss + 1e-6, "{losses:?} {loss}");
    assert_eq!((maps, losses), run(3));
}

#[test]
fn bad_arguments_are_refused() {
    let good = Svbrdf::new(4, 4);
    let photos = photographs(&good, 1, 0.0, 1);
    let attempt = |mean: &Svbrdf, prior: Prior, photos: &[Observation], scale: f32| {
        solve(&mut good.clone(), mean, &prior, photos, 2, Noise { scale, ..NOISE })
    };
    assert!(attempt(&good, prior(), &photos, 0.05).is_ok());
    assert!(attempt(&good, prior(), &[], 0.05).is_ok());
    assert!(attempt(&Svbrdf::new(4, 5), prior(), &photos, 0.05).is_err());
    let other = photographs(&Svbrdf::new(5, 4), 1, 0.0, 1);
    assert!(attempt(&good, prior(), &other, 0.05).is_err());
    assert!(attempt(&good, Prior { sigma: [0.0; CHANNELS] }, &photos, 0.05).is_err());
    assert!(attempt(&good, prior(), &photos, f32::NAN).is_err());
}
