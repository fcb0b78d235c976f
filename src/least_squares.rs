//! Levenberg-Marquardt for small problems (Marquardt 1963): the loop of pose, camera and
//! photometry.
//!
//! Each step linearises the problem, then solves its normal equations with their diagonal enlarged
//! by a factor of `1 + damping`. The damping grows until a step lowers the cost and shrinks after
//! each one that does.

use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector};

/// A least-squares problem.
pub(crate) trait LeastSquares {
    /// What is estimated.
    type State;
    /// The problem linearised at a state.
    type Equations;

    /// Weighted sum of squared residuals.
    fn cost(&self, state: &Self::State) -> f64;

    /// Normal equations at a state.
    fn linearise(&self, state: &Self::State) -> Self::Equations;

    /// The state after a damped step; `None` where the equations cannot be solved or the state
    /// would make no sense.
    fn step(
        &self,
        state: &Self::State,
        equations: &Self::Equations,
        damping: f64,
    ) -> Option<Self::State>;

    /// Whether a step was so small that the next ones do not matter.
    fn is_settled(&self, _before: &Self::State, _after: &Self::State) -> bool {
        false
    }
}

/// How a problem is minimised.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Options {
    /// Most steps.
    pub max_steps: usize,
    /// Dampings tried for a step.
    pub max_trials: usize,
    /// Damping of the first trial; 0: Gauss-Newton.
    pub damping: f64,
    /// Least damping after steps that lowered the cost.
    pub min_damping: f64,
    /// A step that lowers the cost by no more than this fraction of it is the last one.
    pub min_gain: f64,
    /// Whether steps must lower the cost. Those of a problem whose weights follow its residuals
    /// are taken as they come: it is another problem after each.
    pub descent: bool,
}

/// Why a minimisation has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stop {
    /// Steps have become small.
    Converged,
    /// No damping that was tried lowers the cost.
    NoDescent,
    /// All steps allowed were taken.
    MaxSteps,
}

/// What a minimisation has done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Summary {
    /// Steps taken.
    pub steps: usize,
    /// Cost at the end.
    pub cost: f64,
    /// Why it ended.
    pub stop: Stop,
}

/// The minimum next to a state.
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

/// Solves dense normal equations, damped: the step against the gradient. `None` where the matrix
/// is not positive definite.
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
    fn undamped_steps_taken_as_they_come_are_gauss_newton() {
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
    fn equations_that_cannot_be_solved_are_no_step() {
        let singular = Matrix2::new(1.0, 1.0, 1.0, 1.0);
        assert!(damped_step(&singular, &Vector2::new(1.0, 0.0), 0.0).is_none());
        assert!(damped_step(&singular, &Vector2::new(1.0, 0.0), 0.1).is_some());
    }
}
