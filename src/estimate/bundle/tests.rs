use std::sync::Arc;

use nalgebra::DVector;

use super::sums::{Block, Reduced, Sums};
use super::*;
use crate::estimate::coordinates::{Coordinates, natural};
use crate::estimate::correction::{Correction, LightCorrection};
use crate::estimate::noise::Noise;
use crate::estimate::photographs::Photographs;
use crate::estimate::posterior::at;
use crate::loss::{self, log_residual};
use crate::observation::{Falloff, Observation, View};
use crate::random::Random;
use crate::render::PointView;
use crate::simd::{Kernel, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, Svbrdf, channel};
use crate::test_support::{photograph, view_from};

const SIDE: usize = 24;

/// A bumpy material with glossy and matte patches.
fn material() -> Svbrdf {
    let mut maps = Svbrdf::new(SIDE, SIDE);
    for t in 0..SIDE * SIDE {
        let (u, v) = ((t % SIDE) as f32 / 4.0, (t / SIDE) as f32 / 3.0);
        maps.plane_mut(channel::SLOPE_X)[t] = 0.15 * u.sin() * v.cos();
        maps.plane_mut(channel::SLOPE_Y)[t] = 0.1 * (u + v).cos();
        for c in 0..3 {
            maps.plane_mut(channel::DIFFUSE + c)[t] = 0.25 + 0.1 * (u * 0.7).sin();
            maps.plane_mut(channel::SPECULAR + c)[t] = 0.05 + 0.02 * v.sin();
        }
        maps.plane_mut(channel::ROUGHNESS)[t] = 0.4 + 0.1 * (0.5 * (u - v)).sin();
    }
    maps
}

fn photographs(count: usize) -> Photographs {
    let mut all = Photographs::new();
    let mut random = Random::new(4);
    for i in 0..count {
        let angle = 2.4 * i as f32;
        let at = [50.0 * angle.sin(), 50.0 * angle.cos(), 140.0 + 12.0 * (i % 3) as f32];
        let falloff = Falloff::InverseSquare { power_mm2: [6e4; 3] };
        let view = View { falloff, ambient: [0.02; 3], ..view_from(at) };
        let (mut radiance, weight) = photograph(&material(), view).planes();
        radiance.iter_mut().for_each(|v| *v *= 1.0 + 0.02 * random.bell() as f32);
        all.add(Observation::new(SIDE, SIDE, view, &radiance, &weight).unwrap()).unwrap();
    }
    all
}

const COUNT: usize = 4;

/// A problem with every kind of parameter, and two groups that share all texels.
fn problem() -> (Problem, State) {
    let sample = Arc::new(Sample::new(&photographs(COUNT), usize::MAX, SIDE));
    let mut shared = vec![
        Shared::new(Parameter::Exponent, 4.0, 0.3),
        Shared::new(Parameter::Ambient, 500.0, 0.1).within(0.0, 0.4),
    ];
    shared.extend((0..3).map(|axis| Shared::new(Parameter::Flash(axis), 0.01, 15.0)));
    for i in 0..COUNT {
        shared.push(Shared::new(Parameter::Gain(i), 400.0, 1.0));
        shared.push(Shared::new(Parameter::Mirrored(i), 50.0, 1.0));
        shared.extend((0..2).map(|axis| Shared::new(Parameter::Rotation(i, axis), 400.0, 0.06)));
    }
    for i in [0, 1] {
        let lobes = [Parameter::Anisotropy(0, i), Parameter::Anisotropy(1, i), Parameter::Coat(i)];
        shared.extend(lobes.map(|lobe| Shared::new(lobe, 2000.0, 0.3)));
    }
    shared.extend((0..4).map(|i| Shared::new(Parameter::Sheen(i), 2000.0, 0.3)));
    let texels = sample.texels();
    let shares = (0..texels).flat_map(|t| [t as f32, (texels - t) as f32]);
    let mut start = material();
    start.plane_mut(channel::ROUGHNESS).iter_mut().for_each(|r| *r += 0.05);
    let problem = Problem {
        which: (0..COUNT).collect(),
        mean: sample.coordinates(&start),
        precision: [100.0; CHANNELS],
        groups: Groups {
            coordinates: channel::SPECULAR..CHANNELS,
            range: [-1.0, 1.0],
            shares: shares.map(|s| s / texels as f32).collect(),
            mean: vec![[0.0; CHANNELS], [0.01; CHANNELS]],
            precision: vec![[50.0; CHANNELS], [40.0; CHANNELS]],
        },
        shared,
        noise: Noise { scale: 0.05, huber: 0.02 },
        sample,
    };
    let views = problem.sample.photographs.iter().map(|p| &p.view).collect::<Vec<_>>();
    let exposure = LightCorrection {
        log_gains: vec![0.02, -0.03, 0.05, 0.01],
        exponent: 0.7,
        offset_mm: [1.0, 2.0, -3.0],
        ..LightCorrection::as_given(views.into_iter())
    };
    let rotations = vec![[0.03, -0.02], [0.01, 0.02], [-0.02, 0.0], [0.0, 0.01]];
    let mirrored = vec![0.1, -0.2, 0.3, 0.0];
    let mut state =
        problem.start(Correction { turns: rotations, ambient: 0.05, mirrored, exposure });
    let anisotropy = vec![[0.2, -0.3], [0.4, 0.1]];
    state.lobes =
        Some(SharedLobes { anisotropy, coat: [0.2, 0.5], sheen: Some([0.2, 0.1, 0.15, 0.5]) });
    (problem, state)
}

/// Central differences of step h err by h² / 6 times the third derivative (at most 1e3 for slopes in a lobe
/// of roughness 0.35) and by rounding, 1e-15 / h. Views are in single precision: half a per cent may be
/// rounding where the parts of a derivative by a rotation nearly cancel. The dimming below a sheen has a kink
/// where the cosines of light and camera are equal: one per cent more.
#[test]
fn sums_match_differences_of_residuals() {
    let (problem, mut state) = problem();
    for t in [0, 137, 300, SIDE * SIDE - 1] {
        state.deviations[t] = [0.05, -0.03, 0.05, 0.02, -0.01, 0.03, 0.02, -0.02, 0.05];
        check_sums(&problem, &state, t);
    }
}

fn residuals(problem: &Problem, x: &Coordinates, state: &State, t: usize) -> Vec<f64> {
    let lobes = problem.lobes(t, state).unwrap();
    let n = problem.sample.texels();
    let lights = problem.photographs().enumerate();
    let lights = lights.map(|(i, p)| PointView::new(&state.correction.apply(&p.view, i)));
    let of = |(light, photograph): (PointView, &super::sample::Photograph)| {
        let radiance = light.radiance(&natural(x), &lobes, problem.sample.places[t]);
        let seen = |c: usize| f64::from(photograph.radiance[c * n + t]);
        [0, 1, 2].map(|c| log_residual(radiance.value[c].max(0.0), seen(c)))
    };
    lights.zip(problem.photographs()).flat_map(of).collect()
}

/// Compares a few hundred residuals of size one, some saturated and some invisible. Each is within 3e-6 of
/// double precision with a coat.
#[test]
fn costs_in_lanes_match_those_of_single_texels() {
    let (mut problem, mut state) = problem();
    let mut sample = (*problem.sample).clone();
    let mut random = Random::new(9);
    for photograph in &mut sample.photographs {
        photograph.radiance.iter_mut().step_by(7).for_each(|v| *v *= -0.7);
        photograph.weight.iter_mut().step_by(5).for_each(|w| *w = 0.0);
    }
    problem.sample = Arc::new(sample);
    for deviation in state.deviations.iter_mut().flatten() {
        *deviation = 0.05 * random.bell();
    }
    let none = vec![[0.0; CHANNELS]; problem.sample.texels()];
    let costs = problem.texel_costs(&state, [&state.deviations, &none]);
    let still = State { deviations: none, ..state.clone() };
    let Noise { scale, huber } = problem.noise;
    for (t, costs) in costs.iter().enumerate() {
        for (state, cost) in [&state, &still].into_iter().zip(costs) {
            let weights = problem.photographs().flat_map(|p| [p.weight[t]; 3]);
            let x = problem.coordinates(t, state);
            let residuals = residuals(&problem, &x, state, t);
            let of_residuals = weights.zip(residuals).map(|(weight, r)| {
                f64::from(weight) * loss::huber(r, f64::from(huber)) / f64::from(scale)
            });
            let prior = state.deviations[t].iter().zip(problem.precision);
            let expected: f64 = of_residuals.sum::<f64>()
                + prior.map(|(d, precision)| 0.5 * precision * d * d).sum::<f64>();
            assert!((cost - expected).abs() < 3e-5 * expected.max(1.0), "{t}: {cost} {expected}");
        }
    }
}

fn check_sums(problem: &Problem, state: &State, t: usize) {
    let x = problem.coordinates(t, state);
    let here = residuals(problem, &x, state, t);
    let q = problem.shared.len();
    let mut columns: Vec<DVector<f64>> = Vec::new();
    let mut difference = |plus: Vec<f64>, minus: Vec<f64>, h: f64| {
        let difference = plus.iter().zip(&minus).map(|(a, b)| (a - b) / (2.0 * h));
        columns.push(DVector::from_iterator(plus.len(), difference));
    };
    for c in 0..CHANNELS {
        let moved = |h: f64| {
            let mut x = x;
            x[c] += h;
            residuals(problem, &x, state, t)
        };
        difference(moved(1e-4), moved(-1e-4), 1e-4);
    }
    for shared in &problem.shared {
        // NoL and NoV are nearly equal here, and the dimming below sheen bends where they cross.
        let h = match shared.parameter {
            Parameter::Flash(_) => 0.7,
            Parameter::Rotation(..) => 2e-4,
            _ => 2e-3,
        };
        let moved = |h: f64| {
            let mut moved = state.clone();
            shared.parameter.set(&mut moved, shared.parameter.get(state) + h);
            residuals(problem, &x, &moved, t)
        };
        difference(moved(h), moved(-h), h);
    }
    let jacobian = nalgebra::DMatrix::from_columns(&columns);
    let Noise { scale, huber } = problem.noise;
    let weight = |r: &f64| loss::huber_weight(*r, f64::from(huber)) / f64::from(scale);
    let weights = DVector::from_iterator(here.len(), here.iter().map(weight));
    let weighted =
        nalgebra::DMatrix::from_fn(here.len(), CHANNELS + q, |i, j| weights[i] * jacobian[(i, j)]);
    let (matrix, gradient) =
        (jacobian.transpose() * &weighted, weighted.transpose() * DVector::from_vec(here.clone()));

    let linear = problem.linear(state);
    let whole = whole(problem.block(t..t + 1, state, &linear));
    for i in 0..CHANNELS + q {
        for j in 0..=i {
            let size = (matrix[(i, i)] * matrix[(j, j)]).sqrt();
            let (found, numeric) = (whole.matrix[(i, j)], matrix[(i, j)]);
            let close = (found - numeric).abs() < 1.5e-2 * size + 1e-3;
            assert!(close, "{t}: {i} {j}: {found} {numeric}, {size}");
        }
        let size = (matrix[(i, i)] * weights.sum()).sqrt();
        let (found, numeric) = (whole.gradient[i], gradient[i]);
        assert!((found - numeric).abs() < 1e-3 * size + 1e-3, "{t}: {i}: {found} {numeric}");
    }
}

/// The equations of a block's first texel and of the parameters.
fn whole(block: Block) -> Reduced {
    dispatch(Whole(block))
}

struct Whole<'a>(Block<'a>);

impl Kernel for Whole<'_> {
    type Output = Reduced;

    fn run<V: Lanes>(self) -> Reduced {
        let q = self.0.problem.shared.len();
        let (mut whole, mut of_parameters) = (Reduced::zeros(CHANNELS + q), Reduced::zeros(q));
        let Sums { texels, mixed } = Sums::<V>::new(&self.0, &mut of_parameters);
        let first = |value: V| f64::from(value.to_array()[0]);
        for i in 0..CHANNELS {
            whole.gradient[i] = first(texels.gradient[i]);
            for j in 0..=i {
                whole.matrix[(i, j)] = first(texels.matrix[at(i, j)]);
            }
            for (a, mixed) in mixed.iter().enumerate() {
                whole.matrix[(CHANNELS + a, i)] = first(mixed[i]);
            }
        }
        whole.gradient.rows_mut(CHANNELS, q).copy_from(&of_parameters.gradient);
        whole.matrix.view_mut((CHANNELS, CHANNELS), (q, q)).copy_from(&of_parameters.matrix);
        whole
    }
}

/// One step solves the equations of all unknowns as a dense matrix does. Elimination is in single precision
/// (6e-8) and may cancel all but a hundredth of a parameter's equation.
#[test]
fn elimination_matches_a_dense_solve() {
    let (mut problem, mut state) = problem();
    // Five texels cannot separate lobes from gloss: the step would be lost in single precision.
    state.lobes = None;
    problem.shared.retain(|shared| {
        use Parameter::{Anisotropy, Coat, Sheen};
        !matches!(shared.parameter, Anisotropy(..) | Coat(_) | Sheen(_))
    });
    let texels = 5;
    let mut sample = (*problem.sample).clone();
    for photograph in &mut sample.photographs {
        photograph.weight.iter_mut().skip(texels).for_each(|w| *w = 0.0);
    }
    problem.sample = Arc::new(sample);
    let (g, q, damping) = (problem.groups.coordinates.len(), problem.shared.len(), 1e-9);
    let (shared, steps) = problem.step(&state, damping).unwrap();
    let size = CHANNELS * texels + 2 * g + q;
    let (mut matrix, mut gradient) =
        (nalgebra::DMatrix::<f64>::zeros(size, size), DVector::<f64>::zeros(size));
    let linear = problem.linear(&state);
    for t in 0..texels {
        let own = whole(problem.block(t..t + 1, &state, &linear));
        // Rows of the whole system for each row of the texel's equations.
        let mut places: Vec<Vec<(usize, f64)>> =
            (0..CHANNELS).map(|c| vec![(CHANNELS * t + c, 1.0)]).collect();
        for (k, share) in problem.texel_shares(t).iter().enumerate() {
            for (i, c) in problem.groups.coordinates.clone().enumerate() {
                places[c].push((CHANNELS * texels + g * k + i, f64::from(*share)));
            }
        }
        places.extend((0..q).map(|a| vec![(CHANNELS * texels + 2 * g + a, 1.0)]));
        for i in 0..CHANNELS + q {
            for (at, share) in &places[i] {
                gradient[*at] += share * own.gradient[i];
                for j in 0..CHANNELS + q {
                    for (other, of_other) in &places[j] {
                        let value = own.matrix[(i.max(j), i.min(j))];
                        matrix[(*at, *other)] += share * of_other * value;
                    }
                }
            }
        }
    }
    for i in 0..CHANNELS * texels {
        matrix[(i, i)] += problem.precision[i % CHANNELS];
    }
    let priors = problem.priors(&state);
    let first = CHANNELS * texels;
    for i in 0..2 * g + q {
        matrix[(first + i, first + i)] += priors.matrix[(i, i)];
        gradient[first + i] += priors.gradient[i];
    }
    let expected = matrix.cholesky().unwrap().solve(&-gradient);
    let tolerance = 1e-6 * expected.amax();
    for i in 0..2 * g + q {
        let (found, expected) = (shared[i], expected[first + i]);
        let close = (found - expected).abs() < 1e-4 * expected.abs() + tolerance;
        assert!(close, "{i}: {found} {expected}");
    }
    for t in 0..texels {
        let step = DVector::from_row_slice(&steps[t].with(1.0));
        let all = expected.rows(CHANNELS * t, CHANNELS);
        assert!((&step - all).amax() < tolerance, "{t}: {step} {all}");
    }
}

#[test]
fn a_parameter_stops_at_its_bound_and_the_cost_falls() {
    let (problem, mut state) = problem();
    state.correction.ambient = 0.002;
    let before = problem.cost(&state);
    let (shared, steps) = problem.step(&state, 1e-3).unwrap();
    let ambient = problem.shared.iter().position(|s| s.parameter == Parameter::Ambient).unwrap();
    let to = state.correction.ambient + shared[shared.len() - problem.shared.len() + ambient];
    assert!(to >= -1e-12, "{to}");
    let (next, cost) = problem.stepped(&state, &shared, &steps, 1.0);
    assert!(cost < before && next.correction.ambient >= 0.0, "{before} {cost}");
}
