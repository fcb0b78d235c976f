//! Robust statistics.

use std::cmp::Ordering;

/// Standard deviation of a normal distribution over its median absolute deviation.
pub(crate) const MAD_TO_SIGMA: f64 = 1.4826;

/// Total order of the standard library.
pub(crate) trait Float: Copy {
    /// Total order, as of the standard library.
    fn compare(&self, other: &Self) -> Ordering;
}

impl Float for f32 {
    fn compare(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Float for f64 {
    fn compare(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// The median; the upper of the two middle values of an even number; `None` without values.
pub(crate) fn median<T: Float>(values: impl IntoIterator<Item = T>) -> Option<T> {
    let mut values: Vec<T> = values.into_iter().collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, T::compare).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn medians_stand_in_the_middle() {
        assert_eq!(median([0.0_f32; 0]), None);
        assert_eq!(median([2.0_f32]), Some(2.0));
        assert_eq!(median([3.0, -1.0]), Some(3.0));
        assert_eq!(median([3.0, f64::INFINITY, -1.0]), Some(3.0));
    }

    /// By definition of [`MAD_TO_SIGMA`]. 40 000 normal deviates determine their sigma to 0.6 %.
    #[test]
    fn the_deviation_of_normal_values_is_their_sigma() {
        let mut random = Random::new(1);
        // Box and Muller 1958
        let mut normal = || {
            let length = (-2.0 * (1.0 - random.uniform()).ln()).sqrt();
            length * (std::f64::consts::TAU * random.uniform()).cos()
        };
        let sigma = MAD_TO_SIGMA * median((0..40_000).map(|_| normal().abs())).unwrap();
        assert!((sigma - 1.0).abs() < 0.02, "{sigma}");
    }
}
