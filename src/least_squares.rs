//! Levenberg-Marquardt for small problems (Marquardt 1963): the loop of pose, camera and photometry.
//!
//! Each step solves the normal equations with their diagonal scaled by `1 + damping`. The damping
//! grows until a step lowers the cost, and shrinks after each such step.

use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector};

pub(crate) trait LeastSquares {
    /// The unknowns.
    type State;
    /// The problem linearised at a state.
    type Equations;

    /// Weighted sum of squared residuals.
    fn cost(&self, state: &Self::State) -> f64;

    /// Normal equations at `state`.
    fn linearise(&self, state: &Self::State) -> Self::Equations;

    /// The state after a damped step; `None` if the equations have no solution or the state is impossible.
    fn step(
        &self,
        state: &Self::State,
        equations: &Self::Equations,
        damping: f64,
    ) -> Option<Self::State>;

    /// Whether a step was too small for further steps to matter.
    fn is_settled(&self, _before: &Self::State, _after: &Self::State) -> bool {
        false
    }
}

/// Settings of a minimisation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Options {
    /// Most steps.
    pub max_steps: usize,
    /// Dampings tried for a step.
    pub max_trials: usize,
    /// Damping of the first trial; 0 is Gauss-Newton.
    pub damping: f64,
    /// Lower limit of the damping.
    pub min_damping: f64,
    /// Iteration ends at a step that lowers the cost by no more than this fraction.
    pub min_gain: f64,
    /// Whether each step must lower the cost. False for reweighted problems: their cost changes
    /// with the weights.
    pub descent: bool,
}

/// Reason for the end of a minimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stop {
    /// The last step was small.
    Converged,
    /// No damping tried lowers the cost.
    NoDescent,
    /// `max_steps` steps were taken.
    MaxSteps,
}

/// Outcome of a minimisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Summary {
    /// Steps taken.
    pub steps: usize,
    /// Cost at the end.
    pub cost: f64,
    /// Why it ended.
    pub stop: Stop,
}

/// Finds the minimum near a state.
pub(crate) fn minimise<P: LeastSquares>(
    problem: &P,
    mut state: P::State,
    options: &Options,
) -> (P::State, Summary) {
    let mut cost = problem.cost(&state);
    let mut damping = options.damping;
    let mut stop = Stop::MaxSteps;
    let mut steps = 0;
    while steps < options.max_steps {
        let equations = problem.linearise(&state);
        let mut taken = None;
        for _ in 0..options.max_trials {
            if let Some(next) = problem.step(&state, &equations, damping) {
                let next_cost = problem.cost(&next);
                if next_cost < cost || !options.descent {
                    damping = (0.1 * damping).max(options.min_damping);
                    taken = Some((next, next_cost));
                    break;
                }
            }
            damping = if damping > 0.0 { 8.0 * damping } else { 1e-4 };
        }
        let Some((next, next_cost)) = taken else {
            stop = Stop::NoDescent;
            break;
        };
        steps += 1;
        let small = options.descent && cost - next_cost <= options.min_gain * cost;
        let settled = small || problem.is_settled(&state, &next);
        (state, cost) = (next, next_cost);
        if settled {
            stop = Stop::Converged;
            break;
        }
    }
    (state, Summary { steps, cost, stop })
}

/// Step against the gradient by damped dense normal equations; `None` unless the matrix is positive definite.
pub(crate) fn damped_step<D: Dim>(
    normal: &OMatrix<f64, D, D>,
    gradient: &OVector<f64, D>,
    damping: f64,
) -> Option<OVector<f64, D>>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    let mut damped = normal.clone();
    for i in 0..damped.nrows() {
        damped[(i, i)] *= 1.0 + damping;
    }
    Some(-damped.cholesky()?.solve(gradient))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    const OPTIONS: Options = Options {
        max_steps: 200,
        max_trials: 10,
        damping: 1e-4,
        min_damping: 1e-12,
        min_gain: 1e-12,
        descent: true,
    };

    /// Rosenbrock's valley: residuals `10 (y - x²)` and `1 - x`, minimum 0 at (1, 1).
    struct Valley;

    impl LeastSquares for Valley {
        type State = Vector2<f64>;
        type Equations = (Matrix2<f64>, Vector2<f64>);

        fn cost(&self, s: &Vector2<f64>) -> f64 {
            (10.0 * (s.y - s.x * s.x)).powi(2) + (1.0 - s.x).powi(2)
        }

        fn linearise(&self, s: &Vector2<f64>) -> Self::Equations {
            let jacobian = Matrix2::new(-20.0 * s.x, 10.0, -1.0, 0.0);
            let residual = Vector2::new(10.0 * (s.y - s.x * s.x), 1.0 - s.x);
            (jacobian.transpose() * jacobian, jacobian.transpose() * residual)
        }

        fn step(
            &self,
            s: &Vector2<f64>,
            (normal, gradient): &Self::Equations,
            damping: f64,
        ) -> Option<Vector2<f64>> {
            Some(s + damped_step(normal, gradient, damping)?)
        }
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_minimum() {
        let start = Vector2::new(-1.2, 1.0);
        let (found, summary) = minimise(&Valley, start, &OPTIONS);
        assert!((found - Vector2::new(1.0, 1.0)).amax() < 1e-9, "{found}");
        // At the minimum no step lowers a cost of 0.
        assert!(matches!(summary.stop, Stop::Converged | Stop::NoDescent), "{summary:?}");
        assert!(summary.cost < 1e-18 && summary.steps < 60, "{summary:?}");
        let few = Options { max_steps: 2, ..OPTIONS };
        let (found, summary) = minimise(&Valley, start, &few);
        assert_eq!((summary.steps, summary.stop), (2, Stop::MaxSteps));
        assert!(summary.cost < Valley.cost(&start) && summary.cost == Valley.cost(&found));
    }

    #[test]
    fn undamped_unconditional_steps_are_gauss_newton() {
        // From (-1.2, 1) Gauss-Newton climbs first, then hits the minimum: residuals are linear in
        // y, so that two steps suffice.
        let newton = Options { damping: 0.0, min_damping: 0.0, max_trials: 1, ..OPTIONS };
        let start = Vector2::new(-1.2, 1.0);
        let free = Options { max_steps: 1, descent: false, ..newton };
        let (found, summary) = minimise(&Valley, start, &free);
        assert!((found.x - 1.0).abs() < 1e-9 && summary.cost > Valley.cost(&start), "{found}");
        let (found, _) = minimise(&Valley, start, &Options { max_steps: 2, ..free });
        assert!((found - Vector2::new(1.0, 1.0)).amax() < 1e-9, "{found}");
        let (found, summary) = minimise(&Valley, start, &newton);
        assert_eq!((found, summary.steps, summary.stop), (start, 0, Stop::NoDescent));
    }

    #[test]
    fn singular_equations_give_no_step() {
        let singular = Matrix2::new(1.0, 1.0, 1.0, 1.0);
        assert!(damped_step(&singular, &Vector2::new(1.0, 0.0), 0.0).is_none());
        assert!(damped_step(&singular, &Vector2::new(1.0, 0.0), 0.1).is_some());
    }
}
