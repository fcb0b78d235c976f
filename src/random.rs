//! Reproducible random numbers (SplitMix64) for simulation and evaluation.

/// A generator of random numbers; the same seed gives the same numbers everywhere.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// Starts from a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mean 0, variance 1: the sum of four uniform numbers, a sufficient approximation of normal noise.
    pub fn bell(&mut self) -> f64 {
        let sum: f64 = (0..4).map(|_| self.uniform()).sum();
        (sum - 2.0) * 3.0f64.sqrt()
    }

    /// A direction uniform over the spherical cap within `limit` radians of +Z.
    pub fn direction(&mut self, limit: f64) -> [f64; 3] {
        let z = 1.0 - self.uniform() * (1.0 - limit.cos());
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    }
}
