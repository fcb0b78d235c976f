//! Benefit of suggested views: errors with photographs from them, from a circle, and from random
//! positions; the first photograph is from above.

use std::time::Instant;

use svbrdf::Result;
use svbrdf::assessment::Place;
use svbrdf::comparison::compare;
use svbrdf::estimate::Method;
use svbrdf::estimator::Estimator;
use svbrdf::random::Random;

use crate::experiments::seed;
use crate::protocol::{self, Conditions, Crop, DISTANCE, HALF_WIDTH, crops, photograph};
use crate::streaming::Setup;

/// Arguments of `svbrdf-eval next-view`.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    materials: protocol::Arguments,
    /// Numbers of photographs
    #[arg(long, value_delimiter = ',', default_value = "3,4,6")]
    photos: Vec<usize>,
}

/// Source of the positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Suggested,
    Circle,
    Random,
}

const WAYS: [(&str, Way); 3] =
    [("suggested", Way::Suggested), ("circle at 30°", Way::Circle), ("random", Way::Random)];

/// Azimuths on the circle in order of capture, degrees.
const SIDES: [f64; 8] = [0.0, 180.0, 90.0, 270.0, 45.0, 225.0, 135.0, 315.0];
/// Light offset from the camera, half widths: 7 mm.
const LIGHT_BESIDE: [f32; 2] = [0.14, 0.0];

/// A position `tilt` from the normal at azimuth `side` (degrees), in half widths.
fn place(tilt: f64, side: f64) -> [f32; 3] {
    let ((s, c), (sin, cos)) = (tilt.to_radians().sin_cos(), side.to_radians().sin_cos());
    [s * cos, s * sin, c].map(|v| v as f32 * DISTANCE)
}

/// Positions within reach of a hand.
fn candidates() -> Vec<[f32; 3]> {
    let tilts = (1..=5).map(|i| 10.0 * f64::from(i));
    tilts.flat_map(|t| (0..16).map(move |k| place(t, 22.5 * f64::from(k)))).collect()
}

/// The candidate with the lowest expected error.
fn suggested(estimator: &Estimator) -> Result<[f32; 3]> {
    let candidates = candidates();
    let mm = |at: [f32; 3]| at.map(|v| v * HALF_WIDTH);
    let places: Vec<Place> = candidates
        .iter()
        .map(|at| Place {
            camera_mm: mm(*at),
            light_mm: mm([at[0] + LIGHT_BESIDE[0], at[1] + LIGHT_BESIDE[1], at[2]]),
        })
        .collect();
    let gains = estimator.outlook(&places)?;
    let best = gains.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    Ok(candidates[best.map_or(0, |(i, _)| i)])
}

/// Rendering errors after each number of photographs.
fn errors(
    crop: &Crop,
    index: usize,
    way: Way,
    arguments: &Arguments,
    setup: &Setup,
) -> Result<Vec<f64>> {
    let conditions = Conditions {
        light_beside: LIGHT_BESIDE,
        levels: Some(1023.0),
        ..Conditions::new(arguments.materials.noise)
    };
    let (mut random, mut noise) = (Random::new(seed(index)), Random::new(seed(index) ^ 0x5EED));
    let mut estimator = setup.estimator(Method::Deep, true);
    estimator.correct_lights(false);
    let most = arguments.photos.iter().copied().max().unwrap_or(1);
    let (mut found, mut seconds) = (Vec::new(), 0.0);
    for i in 0..most {
        let at = match way {
            _ if i == 0 => place(0.0, 0.0),
            Way::Suggested => {
                let begun = Instant::now();
                let at = suggested(&estimator)?;
                seconds += begun.elapsed().as_secs_f64();
                at
            }
            Way::Circle => place(30.0, SIDES[(i - 1) % SIDES.len()]),
            Way::Random => random.direction(50.0f64.to_radians()).map(|v| v as f32 * DISTANCE),
        };
        if arguments.materials.verbose && way == Way::Suggested {
            let tilt = (at[2] / DISTANCE).min(1.0).acos().to_degrees();
            let side = at[1].atan2(at[0]).to_degrees();
            println!("{}: photograph {i}: {tilt:.0}° off the top, side {side:.0}°", crop.name);
        }
        estimator.add(photograph(&crop.truth, at, &conditions, &mut noise))?;
        let maps = estimator.settle()?;
        if arguments.photos.contains(&(i + 1)) {
            found.push(compare(&maps, &crop.truth)?.render);
        }
    }
    if arguments.materials.verbose && way == Way::Suggested {
        let ms = 1e3 * seconds / (most - 1).max(1) as f64;
        println!("{}: {ms:.0} ms a suggestion", crop.name);
    }
    Ok(found)
}

/// Runs the command.
pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let mut sums = vec![[0.0; WAYS.len()]; arguments.photos.len()];
    let mut wins = vec![0; arguments.photos.len()];
    let crops = crops(&arguments.materials)?;
    for (index, crop) in crops.iter().enumerate() {
        let crop = Crop { name: crop.name.clone(), truth: crop.truth.downsampled() };
        let mut columns = Vec::new();
        for (_, way) in WAYS {
            columns.push(errors(&crop, index, way, arguments, setup)?);
        }
        for (k, photos) in arguments.photos.iter().enumerate() {
            let of: Vec<f64> = columns.iter().map(|c| c[k]).collect();
            sums[k].iter_mut().zip(&of).for_each(|(sum, e)| *sum += e.max(1e-6).ln());
            wins[k] += usize::from(of[1..].iter().all(|other| of[0] < *other));
            println!("{}, {photos}: {:.4} {:.4} {:.4}", crop.name, of[0], of[1], of[2]);
        }
    }
    let names: Vec<&str> = WAYS.iter().map(|(name, _)| *name).collect();
    println!("\n| photos | {} | below circle, % | below random, % | best of |", names.join(" | "));
    println!("|---|---|---|---|---|---|---|");
    for (k, photos) in arguments.photos.iter().enumerate() {
        let [a, b, c] = sums[k].map(|sum| (sum / crops.len() as f64).exp());
        let below = |other: f64| 100.0 * (1.0 - a / other);
        println!(
            "| {photos} | {a:.4} | {b:.4} | {c:.4} | {:.0} | {:.0} | {} of {} |",
            below(b),
            below(c),
            wins[k],
            crops.len()
        );
    }
    Ok(())
}
