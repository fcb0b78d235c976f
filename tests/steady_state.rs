//! Steps of a fit allocate no planes: only lists of bands, the packing of small matrices, and the bookkeeping of the
//! thread pool.

use svbrdf::estimate::{EstimateOptions, Method};
use svbrdf::estimator::Estimator;
use svbrdf::networks::{Networks, Workspace};
use svbrdf::observation::{Falloff, Observation, View};
use svbrdf::svbrdf::CHANNELS;
use svbrdf::{Svbrdf, render};

#[path = "common/allocations.rs"]
mod allocations;
#[path = "common/rectified.rs"]
mod rectified;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

const SIDE: usize = 256;

fn observation(maps: &Svbrdf) -> Observation {
    let falloff = Falloff::InverseSquare { power_mm2: [std::f32::consts::PI * 240.0 * 240.0; 3] };
    let view = View { falloff, ..rectified::view([20.0, -10.0, 240.0]) };
    rectified::observation(maps, view)
}

/// One test: other tests would allocate at the same time.
#[test]
fn steps_allocate_no_buffers() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let maps = Svbrdf::new(SIDE, SIDE);
        let observations = vec![observation(&maps); 3];
        let mut start = maps.clone();
        start.planes_mut().iter_mut().for_each(|v| *v = 0.9 * *v + 0.02);
        let mut gradient = vec![0.0; CHANNELS * maps.texels()];
        // Half of the smallest plane there is.
        let limit = 2 * maps.texels();

        let networks = Networks::embedded().unwrap();
        let decoder = networks.decoder();
        let side = SIDE / decoder.stride();
        let mut workspace = Workspace::new(decoder, side, side).unwrap();
        let mut code = vec![0.1; decoder.code_channels() * side * side];
        let mut step = |code: &mut [f32]| {
            decoder.forward(code, &mut workspace).unwrap();
            render::loss_and_gradient(&start, &observations, &mut gradient);
            decoder.vjp(&mut workspace, &gradient, code).unwrap();
        };
        step(&mut code);
        let latent = allocations::during(|| step(&mut code));
        println!("a step of the latent fit: {latent:?}");
        assert!(latent.largest < limit, "{latent:?}");

        let mut options = EstimateOptions::default();
        (options.latent.first_steps, options.latent.steps) = (1, 1);
        let networks = std::sync::Arc::new(networks);
        let mut estimator = Estimator::with_options(networks, Method::Deep, true, options);
        estimator.correct_lights(false);
        estimator.start_from(start.clone());
        observations.iter().for_each(|o| estimator.add(o.clone()).unwrap());
        let phase = |estimator: &Estimator| estimator.reports().last().map(|report| report.name);
        while phase(&estimator) != Some("relief") {
            estimator.step().unwrap();
        }
        // The network follows the third step.
        for _ in 0..2 {
            let step = allocations::during(|| {
                estimator.step().unwrap();
            });
            println!("a step of the maps: {} allocations, {} bytes", step.calls, step.bytes);
            assert_eq!(phase(&estimator), Some("relief"));
            assert!(step.bytes < limit, "{step:?}");
        }
    });
}
