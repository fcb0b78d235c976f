//! Adam (Kingma and Ba 2015).

use crate::parallel;

/// Values per task.
const CHUNK: usize = 1 << 14;

/// First and second moments of the gradient, and number of steps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Adam {
    first: Vec<f32>,
    second: Vec<f32>,
    pub steps: i32,
}

impl Adam {
    pub fn new(length: usize) -> Self {
        Self { first: vec![0.0; length], second: vec![0.0; length], steps: 0 }
    }

    /// Moves `values` against `gradient`, at most about `rate` per element.
    pub fn step(&mut self, values: &mut [f32], gradient: &[f32], rate: f32, betas: [f32; 2]) {
        // Gradients of a mean over 10^5 texels are tiny: the usual 1e-8 would damp them.
        const TINY: f32 = 1e-16;
        let [b1, b2] = betas;
        self.steps = self.steps.saturating_add(1);
        let rate = rate / (1.0 - b1.powi(self.steps));
        let unbias = 1.0 / (1.0 - b2.powi(self.steps));
        let moments = self.first.chunks_mut(CHUNK).zip(self.second.chunks_mut(CHUNK));
        let parts = values.chunks_mut(CHUNK).zip(gradient.chunks(CHUNK)).zip(moments);
        parallel::parts(parts, |_, ((values, gradient), (first, second))| {
            for ((value, &g), (m, v)) in
                values.iter_mut().zip(gradient).zip(first.iter_mut().zip(second))
            {
                *m = b1 * *m + (1.0 - b1) * g;
                *v = b2 * *v + (1.0 - b2) * g * g;
                *value -= rate * *m / ((*v * unbias).sqrt() + TINY);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_rate_and_a_quadratic_is_minimised() {
        let mut x = [3.0f32, -2.0];
        let mut adam = Adam::new(2);
        adam.step(&mut x, &[1e-6, -40.0], 0.1, [0.9, 0.99]);
        assert!((x[0] - 2.9).abs() < 1e-4 && (x[1] + 1.9).abs() < 1e-4);
        for i in 0..300 {
            let g = [1e-5 * x[0], 10.0 * x[1]];
            adam.step(&mut x, &g, 0.1 * (1.0 - i as f32 / 300.0), [0.9, 0.99]);
        }
        assert!(x[0].abs() < 0.02 && x[1].abs() < 0.02, "{x:?}");
    }
}
