//! What runs in every step of a fit allocates no planes: only lists of bands, the packing of small
//! matrices and the thread pool's own bookkeeping.

use std::ops::ControlFlow;

use svbrdf::Svbrdf;
use svbrdf::initial_estimate::Networks;
use svbrdf::network::Workspace;
use svbrdf::observation::{Falloff, Observation, View};
use svbrdf::svbrdf::CHANNELS;
use svbrdf::{refinement, render};

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

        // Buffers are made once, however many steps follow.
        let refine = |steps| {
            let mut refined = start.clone();
            allocations::during(|| {
                let options = refinement::Options { steps, ..Default::default() };
                refinement::refine(
                    &mut refined,
                    &start,
                    &refinement::Prior::default(),
                    &observations,
                    &options,
                    &mut |_, _| ControlFlow::Continue(()),
                )
                .unwrap();
            })
        };
        refine(1);
        let (one, five) = (refine(1), refine(5));
        let each = (five.bytes - one.bytes) / 4;
        println!(
            "a step of the refinement: {} allocations, {each} bytes",
            (five.calls - one.calls) / 4
        );
        assert!(each < limit, "{each} bytes");
    });
}
