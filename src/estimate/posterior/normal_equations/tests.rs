use super::*;
use crate::Svbrdf;
use crate::estimate::noise::Noise;
use crate::random::Random;
use crate::simd::{Kernel, LANES, dispatch};
use nalgebra::{SMatrix, SVector};

type Matrix = SMatrix<f64, CHANNELS, CHANNELS>;

/// Results for random equations of eight texels.
struct Results {
    /// Lower triangle.
    equations: [[f32; LANES]; PAIRS],
    /// Upper triangle.
    covariance: [[f32; LANES]; PAIRS],
    gradient: [[f32; LANES]; CHANNELS],
    step: [[f32; LANES]; CHANNELS],
    variances: [[f32; LANES]; CHANNELS],
}

struct Random12;

impl Kernel for Random12 {
    type Output = Results;
    #[inline(always)]
    fn run<V: Lanes>(self) -> Results {
        let posterior = Posterior {
            observations: &[],
            noise: Noise { scale: 0.05, huber: 0.02 },
            precision: [100.0; CHANNELS],
            lobes: &Svbrdf::new(1, 1),
        };
        let x = [V::splat(0.3); CHANNELS];
        let mut equations = NormalEquations::of_prior(&posterior, &x, &x);
        let mut random = Random::new(21);
        let mut any =
            || V::from_array(std::array::from_fn(|_| 4.0 * random.uniform() as f32 - 2.0));
        for i in 0..12 {
            equations.add(i % 3, [any(), any(), any(), any(), any()], any(), V::splat(50.0));
        }
        let factor = equations.factor(V::splat(0.0));
        Results {
            equations: equations.matrix.map(V::to_array),
            covariance: factor.inverse().map(V::to_array),
            gradient: equations.gradient.map(V::to_array),
            step: equations.solve(V::splat(0.0)).map(V::to_array),
            variances: std::array::from_fn(|c| factor.variance(c).to_array()),
        }
    }
}

/// The symmetric matrix with these entries, one for each of `pairs`.
fn symmetric(
    entries: &[[f32; LANES]; PAIRS],
    lane: usize,
    pairs: impl Iterator<Item = (usize, usize)>,
) -> Matrix {
    let mut out = Matrix::zeros();
    for ((i, j), lanes) in pairs.zip(entries) {
        out[(i, j)] = f64::from(lanes[lane]);
        out[(j, i)] = out[(i, j)];
    }
    out
}

#[test]
fn step_and_covariance_match_a_dense_inverse() {
    let results = dispatch(Random12);
    for lane in 0..LANES {
        let lower = (0..CHANNELS).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let upper = (0..CHANNELS).flat_map(|i| (i..CHANNELS).map(move |j| (i, j)));
        let inverse = symmetric(&results.equations, lane, lower).try_inverse().unwrap();
        // Single precision, condition number of a few hundred.
        let tolerance = 1e-4 * inverse.diagonal().max();
        let covariance = symmetric(&results.covariance, lane, upper);
        assert!((covariance - inverse).amax() < tolerance, "{covariance} {inverse}");

        let vector = |values: &[[f32; LANES]; CHANNELS]| {
            SVector::<f64, CHANNELS>::from_fn(|i, _| f64::from(values[i][lane]))
        };
        let (step, expected) = (vector(&results.step), -inverse * vector(&results.gradient));
        assert!((step - expected).amax() < 1e-4 * expected.amax(), "{step} {expected}");

        for (i, value) in results.variances.iter().enumerate() {
            let (value, expected) = (f64::from(value[lane]), inverse[(i, i)]);
            assert!((value - expected).abs() < 1e-4 * expected, "{value} {expected}");
        }
    }
}
