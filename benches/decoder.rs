//! Times the decoder on a code of `SIDE x SIDE` (default 16: maps of 256x256).
//!
//! `cargo bench --bench decoder -- [MODELS_DIR] [SIDE]`

use std::time::Instant;

use svbrdf::networks::{Decoder, Workspace};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Cargo adds `--bench`.
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let folder = arguments.next().unwrap_or_else(|| "models".to_owned());
    let side: usize = arguments.next().map_or(Ok(16), |s| s.parse())?;
    let decoder = Decoder::from_bytes(&std::fs::read(format!("{folder}/decoder.bin"))?)?;
    let code: Vec<f32> = (0..decoder.code_channels() * side * side)
        .map(|i| ((i * 2_654_435_761) % 1000) as f32 / 500.0 - 1.0)
        .collect();
    let operations = decoder.operations(side, side) as f64;
    println!("{side}x{side} code, {:.3} GFLOP a pass", operations * 1e-9);
    for threads in [1, 2, 4] {
        if threads > std::thread::available_parallelism()?.get() {
            continue;
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| -> Result<(), svbrdf::Error> {
            let mut workspace = Workspace::new(&decoder, side, side)?;
            let mut gradient = vec![0.0; code.len()];
            let (mut forward, mut backward) = (f64::MAX, f64::MAX);
            for _ in 0..60 {
                let start = Instant::now();
                let maps = decoder.forward(&code, &mut workspace)?.to_vec();
                let middle = Instant::now();
                decoder.vjp(&mut workspace, &maps, &mut gradient)?;
                forward = forward.min((middle - start).as_secs_f64());
                backward = backward.min(middle.elapsed().as_secs_f64());
            }
            println!(
                "{threads} threads: forward {:.2} ms ({:.0} GFLOP/s), product {:.2} ms ({:.0} GFLOP/s)",
                1e3 * forward,
                1e-9 * operations / forward,
                1e3 * backward,
                1e-9 * operations / backward
            );
            Ok(())
        })?;
    }
    Ok(())
}
