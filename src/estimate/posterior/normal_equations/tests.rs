use super::*;
use crate::Svbrdf;
use crate::estimate::noise::Noise;
use crate::random::Random;
use crate::simd::{Kernel, LANES, dispatch};
use nalgebra::{SMatrix, SVector};

type Matrix = SMatrix<f64, CHANNELS, CHANNELS>;

/// Results for random equations of eight texels.
struct Results {
    /// Upper triangles.
    equations: [[f32; LANES]; PAIRS],
    covariance: [[f32; LANES]; PAIRS],
    gradient: [[f32; LANES]; CHANNELS],
    step: [[f32; LANES]; CHANNELS],
    slopes: [[f32; LANES]; 2],
}

struct Random12;

impl Kernel for Random12 {
    type Output = Results;
    #[inline(always)]
    fn run<V: Lanes>(self) -> Results {
        let posterior = Posterior {
            observations: &[],
            noise: [Noise { scale: 0.05, huber: 0.02 }; 3],
            precision: [100.0; CHANNELS],
            lobes: &Svbrdf::new(1, 1),
        };
        let x = [V::splat(0.3); CHANNELS];
        let mut equations = NormalEquations::of_prior(&posterior, &x, &x);
        let mut random = Random::new(21);
        let mut any =
            || V::from_array(std::array::from_fn(|_| 4.0 * random.uniform() as f32 - 2.0));
        for i in 0..12 {
            let shape = [any(), any(), any()];
            equations.add(i % 3, shape, [any(), any()], any(), V::splat(50.0));
        }
        let mut matrix = [[V::splat(0.0); CHANNELS]; CHANNELS];
        let mut gradient = [V::splat(0.0); CHANNELS];
        let mut k = 0;
        for (i, row) in SHAPE.into_iter().enumerate() {
            gradient[row] = equations.shape_gradient[i];
            for column in &SHAPE[i..] {
                matrix[row][*column] = equations.shape[k];
                k += 1;
            }
        }
        for (c, colour) in equations.colour.iter().enumerate() {
            let own = [channel::DIFFUSE + c, channel::SPECULAR + c];
            let [dd, ds, ss] = colour.own;
            (matrix[own[0]][own[0]], matrix[own[0]][own[1]]) = (dd, ds);
            matrix[own[1]][own[1]] = ss;
            for (k, own) in own.into_iter().enumerate() {
                gradient[own] = colour.gradient[k];
                for (shape, value) in SHAPE.into_iter().zip(colour.mixed[k]) {
                    matrix[own.min(shape)][own.max(shape)] = value;
                }
            }
        }
        let mut upper = [V::splat(0.0); PAIRS];
        let pairs = (0..CHANNELS).flat_map(|i| (i..CHANNELS).map(move |j| [i, j]));
        pairs.zip(&mut upper).for_each(|([i, j], out)| *out = matrix[i][j]);
        Results {
            equations: upper.map(V::to_array),
            covariance: equations.covariance().map(V::to_array),
            gradient: gradient.map(V::to_array),
            step: equations.solve(V::splat(0.0)).map(V::to_array),
            slopes: equations.slope_variances().map(V::to_array),
        }
    }
}

fn symmetric(upper: &[[f32; LANES]; PAIRS], lane: usize) -> Matrix {
    let mut values = upper.iter();
    let mut out = Matrix::zeros();
    for i in 0..CHANNELS {
        for j in i..CHANNELS {
            out[(i, j)] = f64::from(values.next().unwrap()[lane]);
            out[(j, i)] = out[(i, j)];
        }
    }
    out
}

#[test]
fn step_and_covariance_match_a_dense_inverse() {
    let results = dispatch(Random12);
    for lane in 0..LANES {
        let inverse = symmetric(&results.equations, lane).try_inverse().unwrap();
        // Single precision, condition number of a few hundred.
        let tolerance = 1e-4 * inverse.diagonal().max();
        let covariance = symmetric(&results.covariance, lane);
        assert!((covariance - inverse).amax() < tolerance, "{covariance} {inverse}");

        let vector = |values: &[[f32; LANES]; CHANNELS]| {
            SVector::<f64, CHANNELS>::from_fn(|i, _| f64::from(values[i][lane]))
        };
        let (step, expected) = (vector(&results.step), -inverse * vector(&results.gradient));
        assert!((step - expected).amax() < 1e-4 * expected.amax(), "{step} {expected}");

        for (i, value) in results.slopes.iter().enumerate() {
            let (value, expected) = (f64::from(value[lane]), inverse[(i, i)]);
            assert!((value - expected).abs() < 1e-4 * expected, "{value} {expected}");
        }
    }
}
