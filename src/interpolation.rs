//! Interpolation between the texels of coarser planes.

/// The two samples of `n` around `place` (the first sample lies at 0), and the weight of the
/// second. The end samples extend outwards.
pub(crate) fn between(place: f32, n: usize) -> (usize, usize, f32) {
    let place = place.clamp(0.0, (n - 1) as f32);
    let first = place as usize;
    (first, (first + 1).min(n - 1), place - first as f32)
}

/// Interpolates at `[x, y]`, 0 to 1, between four values: upper left, upper right, lower left, lower right.
pub(crate) fn bilinear([a, b, c, d]: [f32; 4], [x, y]: [f32; 2]) -> f32 {
    let (above, below) = (a + x * (b - a), c + x * (d - c));
    above + y * (below - above)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_between_samples_and_beyond() {
        assert_eq!(between(-0.5, 3), (0, 1, 0.0));
        assert_eq!(between(1.25, 3), (1, 2, 0.25));
        assert_eq!(between(7.0, 3), (2, 2, 0.0));
        assert_eq!(between(0.5, 1), (0, 0, 0.0));
        assert_eq!(bilinear([0.0, 1.0, 2.0, 3.0], [0.25, 0.5]), 1.25);
    }
}
