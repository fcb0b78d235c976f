//! Steps of Levenberg and Marquardt.

use nalgebra::{DMatrix, DVector};

use super::problem::{CLASS, Column, GLOSS, MAX_STEP, Problem, Shared, Solved, State};
use super::sample::range;
use crate::parallel;
use crate::svbrdf::CHANNELS;

/// Fractions of a step that are tried: of what is shared, of texels.
const LENGTHS: [f64; 2] = [1.0, 0.3];
const TEXEL_LENGTHS: [f64; 3] = [1.0, 0.3, 0.0];
/// Damping: the first, the least, what it is multiplied by after a step that helps and one that does
/// not, and when to give up.
const FIRST_DAMPING: f64 = 1e-3;
const MIN_DAMPING: f64 = 1e-6;
const EASE: f64 = 0.3;
const RAISE: f64 = 20.0;
const MAX_DAMPING: f64 = 10.0;
/// Relative gain of a step that is not worth another.
const CONVERGED: f64 = 1e-4;
/// Texels of a task.
const CHUNK: usize = 128;

impl Problem<'_> {
    /// The most probable state near another.
    pub fn descend(&self, mut state: State, steps: usize) -> State {
        let mut damping = FIRST_DAMPING;
        let mut cost = self.cost(&state);
        for _ in 0..steps {
            let Some((shared, solved)) = self.step(&state, damping) else { break };
            let tried = LENGTHS.map(|length| self.stepped(&state, &shared, &solved, length));
            let best = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
            match best {
                Some((next, value)) if value < cost => {
                    let gain = cost - value;
                    (state, cost, damping) = (next, value, (damping * EASE).max(MIN_DAMPING));
                    if gain < CONVERGED * cost {
                        break;
                    }
                }
                _ if damping < MAX_DAMPING => damping *= RAISE,
                _ => break,
            }
        }
        state
    }

    /// The step of all; nothing when the equations cannot be solved.
    fn step(&self, state: &State, damping: f64) -> Option<(DVector<f64>, Vec<Solved>)> {
        let first = CLASS * self.widths.classes;
        let size = first + self.nuisance_count();
        let empty = Shared { matrix: DMatrix::zeros(size, size), gradient: DVector::zeros(size) };
        let lights = self.lights(state);
        let n = self.sample.texels();
        let chunks: Vec<usize> = (0..n).step_by(CHUNK).collect();
        let parts: Vec<(Shared, Vec<Solved>)> = parallel::map_parts(chunks.iter(), |_, &from| {
            let mut sum = empty.clone();
            let texels = from..(from + CHUNK).min(n);
            let solved =
                texels.map(|t| self.eliminate(t, state, &lights, damping, &mut sum)).collect();
            (sum, solved)
        });
        let (mut sum, mut solved) = (empty, Vec::with_capacity(n));
        for (part, texels) in parts {
            sum.matrix += part.matrix;
            sum.gradient += part.gradient;
            solved.extend(texels);
        }
        let scale = self.scale();
        for (k, class) in state.classes.iter().enumerate() {
            for (i, [mean, sigma]) in self.class_prior(k).into_iter().enumerate() {
                let weight = scale / self.widths.classes as f64 * sigma.powi(-2);
                sum.matrix[(CLASS * k + i, CLASS * k + i)] += weight;
                sum.gradient[CLASS * k + i] += weight * (class[i] - mean);
            }
        }
        for (a, [value, sigma, _]) in self.nuisances(state).into_iter().enumerate() {
            let weight = scale * sigma.powi(-2);
            sum.matrix[(first + a, first + a)] += weight;
            sum.gradient[first + a] += weight * value;
        }
        for i in 0..size {
            sum.matrix[(i, i)] *= 1.0 + damping;
        }
        sum.matrix.fill_upper_triangle_with_lower_triangle();
        let shared = sum.matrix.cholesky()?.solve(&-sum.gradient);
        Some((shared, solved))
    }

    /// After `length` of a step of what is shared, and of each texel's own what is best for it; and
    /// its cost.
    fn stepped(
        &self,
        state: &State,
        shared: &DVector<f64>,
        solved: &[Solved],
        length: f64,
    ) -> (State, f64) {
        let first = CLASS * self.widths.classes;
        let mut next = state.clone();
        for (k, class) in next.classes.iter_mut().enumerate() {
            for (i, v) in class.iter_mut().enumerate() {
                let by = (length * shared[CLASS * k + i]).clamp(-MAX_STEP, MAX_STEP);
                let (low, high) = range(GLOSS.start + i);
                *v = (*v + by).clamp(low, high);
            }
        }
        let moved: Vec<f64> = self
            .nuisances(state)
            .into_iter()
            .enumerate()
            .map(|(a, [v, _, most])| v + (length * shared[first + a]).clamp(-most, most))
            .collect();
        self.set_nuisances(&mut next.correction, &moved);
        let n = self.sample.texels();
        let steps: Vec<Column> = (0..n)
            .map(|t| {
                let mut step = -solved[t].own;
                for (i, column) in solved[t].columns.iter().enumerate() {
                    let by = match i {
                        0..CLASS => self
                            .texel_shares(t)
                            .iter()
                            .enumerate()
                            .map(|(k, s)| f64::from(*s) * shared[CLASS * k + i])
                            .sum::<f64>(),
                        _ => shared[first + i - CLASS],
                    };
                    step.axpy(-length * by, column, 1.0);
                }
                step
            })
            .collect();
        let mut costs = vec![f64::MAX; n];
        let base = next.clone();
        for own in TEXEL_LENGTHS {
            let mut trial = base.clone();
            for (t, step) in steps.iter().enumerate() {
                let mean = self.mean(t, &base);
                for c in 0..CHANNELS {
                    let by = (own * step[c]).clamp(-MAX_STEP, MAX_STEP);
                    let (low, high) = range(c);
                    let x = (mean[c] + state.deviations[t][c] + by).clamp(low, high);
                    trial.deviations[t][c] = x - mean[c];
                }
            }
            for (t, cost) in self.texel_costs(&trial).into_iter().enumerate() {
                if cost < costs[t] {
                    costs[t] = cost;
                    next.deviations[t] = trial.deviations[t];
                }
            }
        }
        let cost = costs.iter().sum::<f64>() + self.shared_cost(&next);
        (next, cost)
    }
}
