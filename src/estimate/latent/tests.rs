use super::*;
use crate::observation::Observation;
use crate::render;
use crate::svbrdf::{channel, encoding};
use crate::test_support::{self, view_from};

fn networks() -> Arc<Networks> {
    Arc::new(Networks::embedded().unwrap())
}

pub(super) use crate::test_support::two_tones as material;

/// A photograph that is saturated above 1.
pub(super) fn photograph(truth: &Svbrdf, camera: [f32; 3]) -> Observation {
    test_support::photograph(truth, view_from(camera))
        .changed(|radiance, _| radiance.iter_mut().filter(|v| **v >= 1.0).for_each(|v| *v = -1.0))
}

pub(super) const TOP: [f32; 3] = [0.0, 0.0, 107.0];
pub(super) const SIDE: [f32; 3] = [50.0, -20.0, 107.0];

/// A fit and its photographs.
struct Fit {
    latent: LatentFit,
    photographs: Photographs,
}

impl Fit {
    fn new(
        networks: Arc<Networks>,
        start: &Svbrdf,
        photograph: &Observation,
        options: &LatentOptions,
    ) -> Result<Self> {
        let size = [photograph.width(), photograph.height()];
        let latent = LatentFit::new(networks, start, size, options)?;
        let mut fit = Self { latent, photographs: Photographs::new() };
        fit.add(photograph)?;
        Ok(fit)
    }

    fn add(&mut self, photograph: &Observation) -> Result<()> {
        self.photographs.add(photograph.clone())?;
        self.latent.add_photograph(self.photographs.full())
    }

    fn step(&mut self) -> StepReport {
        self.latent.step(&self.photographs).unwrap()
    }

    /// Steps to the end; returns their number.
    fn settle(&mut self) -> usize {
        let mut steps = 1;
        while !self.step().settled {
            steps += 1;
        }
        steps
    }

    fn maps(&self) -> Svbrdf {
        self.latent.maps()
    }
}

#[test]
fn the_fit_starts_at_the_start_maps_and_lowers_the_loss() {
    let networks = networks();
    let truth = material(64);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    let start = networks.photo_maps(&top).unwrap();
    let before = render::loss(&start, std::slice::from_ref(&top));
    let options = LatentOptions { first_steps: 40, steps: 40, ..LatentOptions::default() };
    let mut fit = Fit::new(networks, &start, &top, &options).unwrap();
    for (a, b) in fit.maps().planes().iter().zip(start.planes()) {
        // Through the square-root encoding and back.
        assert!((a - b).abs() < 1e-5);
    }
    let first = fit.step();
    // Gains of the maps come first.
    assert!(first.loss < 1.001 * before);
    assert!(!first.settled && fit.latent.work() == [1, 40]);
    fit.settle();
    let after = render::loss(&fit.maps(), std::slice::from_ref(&top));
    // The network's maps are already close.
    assert!(after < 0.8 * before, "{before} -> {after}");
    let both = [top, side.clone()];
    let before = render::loss(&fit.maps(), &both);
    fit.add(&side).unwrap();
    assert!(!fit.latent.is_settled());
    fit.settle();
    let after = render::loss(&fit.maps(), &both);
    assert!(after < 0.95 * before, "{before} -> {after}");
    // Further steps change nothing.
    let maps = fit.maps();
    assert!(fit.step().settled && fit.maps() == maps);
}

#[test]
fn results_repeat_for_any_number_of_threads() {
    let networks = networks();
    let truth = material(64);
    let top = photograph(&truth, TOP);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let start = networks.photo_maps(&top).unwrap();
            let options = LatentOptions { steps: 5, ..LatentOptions::default() };
            let mut fit = Fit::new(networks.clone(), &start, &top, &options).unwrap();
            fit.settle();
            fit.maps()
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(1));
}

#[test]
fn unfitted_photographs_add_their_steps() {
    let truth = material(32);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    // Without a restart.
    let options =
        LatentOptions { first_steps: 8, steps: 6, all_steps_to: 1, ..LatentOptions::default() };
    let mut fit = Fit::new(networks(), &truth, &top, &options).unwrap();
    fit.step();
    fit.add(&side).unwrap();
    assert_eq!(fit.settle(), 8 + 3);
    fit.add(&side).unwrap();
    fit.settle();
    // The fit has converged on the third: only the fourth adds steps.
    fit.add(&side).unwrap();
    assert_eq!(fit.settle(), 2);
}

#[test]
fn black_and_unseen_photographs_do_not_break_the_fit() {
    let networks = networks();
    let truth = material(32);
    let black = photograph(&truth, TOP).changed(|radiance, _| radiance.fill(0.0));
    let start = networks.photo_maps(&black).unwrap();
    let options = LatentOptions { steps: 5, ..LatentOptions::default() };
    let mut fit = Fit::new(networks, &start, &black, &options).unwrap();
    fit.settle();
    let unseen = photograph(&truth, SIDE).changed(|_, weight| weight.fill(0.0));
    fit.add(&unseen).unwrap();
    fit.settle();
    assert!(fit.maps().planes().iter().all(|v| v.is_finite()));
}

#[test]
fn sizes_that_do_not_fit_are_errors() {
    let networks = networks();
    let top = photograph(&material(64), TOP);
    let options = LatentOptions::default();
    let odd = photograph(&material(40), TOP);
    assert!(Fit::new(networks.clone(), &material(40), &odd, &options).is_err());
    assert!(Fit::new(networks.clone(), &material(48), &top, &options).is_err());
    let mut fit = Fit::new(networks, &material(32), &top, &options).unwrap();
    assert!(fit.add(&odd).is_err());
    let maps = fit.maps();
    assert_eq!([maps.width(), maps.height()], [64, 64]);
}

#[test]
fn photographs_during_a_fit_add_their_steps() {
    let networks = networks();
    let truth = material(32);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    let start = networks.photo_maps(&top).unwrap();
    let options = LatentOptions { first_steps: 5, steps: 3, ..LatentOptions::default() };
    let mut fit = Fit::new(networks, &start, &top, &options).unwrap();
    fit.add(&side).unwrap();
    assert_eq!(fit.settle(), 5 + 3, "two came at once");
    fit.add(&side).unwrap();
    assert_eq!(fit.settle(), 5 + 3 + 3, "the third begins anew");
    fit.add(&side).unwrap();
    assert_eq!(fit.settle(), 3, "one alone");
}

/// Averages hide detail, which stays that of the start.
#[test]
fn steps_move_averages_and_keep_detail() {
    let networks = networks();
    let truth = material(256);
    let [top, side] = [TOP, SIDE].map(|place| photograph(&truth, place));
    let start = networks.photo_maps(&top).unwrap();
    let options = LatentOptions { first_steps: 5, ..LatentOptions::default() };
    let mut fit = Fit::new(networks, &start, &top, &options).unwrap();
    for (found, expected) in fit.maps().planes().iter().zip(start.planes()) {
        assert!((found - expected).abs() < 1e-5);
    }
    fit.settle();
    let [moved, small] = [fit.maps(), fit.latent.code.maps().clone()];
    assert_eq!([small.width(), moved.width()], [128, 256]);
    let change = |c: usize| {
        let pairs = moved.plane(c).iter().zip(start.plane(c));
        pairs.map(|(a, b)| encoding::encode(c, *a) - encoding::encode(c, *b)).collect::<Vec<_>>()
    };
    let (changes, averages) = (change(channel::SLOPE_X), moved.downsampled());
    // A change from a grid of half the resolution differs little between neighbours.
    let size =
        |values: &[f32]| (values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32).sqrt();
    let steps: Vec<f32> = changes.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(size(&changes) > 1e-3 && size(&steps) < 0.5 * size(&changes));
    // Interpolation smooths differences between neighbours only.
    let before = start.downsampled();
    for c in [channel::SLOPE_X, channel::ROUGHNESS] {
        let off = |maps: &Svbrdf| -> Vec<f32> {
            maps.plane(c).iter().zip(small.plane(c)).map(|(a, b)| a - b).collect()
        };
        let [left, moved] = [off(&averages), off(&before)].map(|values| size(&values));
        assert!(left < 0.6 * moved, "{c}: {left} of {moved}");
    }
    fit.add(&side).unwrap();
    assert_eq!(fit.maps().width(), 256);
}

/// The result with three photographs does not depend on earlier fits.
#[test]
fn the_third_photograph_restarts_the_code() {
    let networks = networks();
    let truth = material(64);
    let places = [TOP, SIDE, [-40.0, 45.0, 100.0]];
    let [top, side, third] = places.map(|place| photograph(&truth, place));
    let options = LatentOptions { first_steps: 3, steps: 3, ..LatentOptions::default() };
    let start = networks.photo_maps(&top).unwrap();
    let run = |one_by_one: bool| {
        let mut fit = Fit::new(networks.clone(), &start, &top, &options).unwrap();
        for photograph in [&side, &third] {
            if one_by_one {
                fit.settle();
            }
            fit.add(photograph).unwrap();
        }
        fit.settle();
        fit.maps()
    };
    assert!(run(true) == run(false));
}

/// A restored fit repeats its steps in progress from the same maps; a converged one differs by rounding.
#[test]
fn a_restored_fit_continues_from_its_maps() {
    let networks = networks();
    let truth = material(64);
    let (top, side) = (photograph(&truth, TOP), photograph(&truth, SIDE));
    let start = networks.photo_maps(&top).unwrap();
    let options = LatentOptions { first_steps: 4, steps: 6, ..LatentOptions::default() };
    let run = |left_at: &[usize]| {
        let mut fit = Fit::new(networks.clone(), &start, &top, &options).unwrap();
        let mut steps = 0;
        loop {
            if left_at.contains(&steps) {
                let saved = fit.latent.save(true);
                let latent =
                    LatentFit::restore(networks.clone(), saved, &fit.photographs, &options);
                fit.latent = latent.unwrap();
                assert_eq!(fit.latent.is_settled(), steps == 4);
            }
            if steps == 4 {
                fit.add(&side).unwrap();
            }
            if steps > 4 && fit.latent.is_settled() {
                return (steps, fit.maps());
            }
            fit.step();
            steps += 1;
        }
    };
    let (steps, plain) = run(&[]);
    assert_eq!(steps, 4 + 6);
    for (left_at, expected) in [(&[4][..], steps), (&[7], steps + 3)] {
        let (found, maps) = run(left_at);
        assert_eq!(found, expected);
        let off = plain.planes().iter().zip(maps.planes()).map(|(a, b)| (a - b).powi(2));
        let off = (off.sum::<f32>() / plain.planes().len() as f32).sqrt();
        println!("{off} off when left at {left_at:?}");
        assert!(off < 1e-4, "{off}");
    }
}
