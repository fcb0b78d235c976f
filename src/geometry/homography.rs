//! Plane-to-plane projective maps.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

/// A projective map of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography(pub DMat3);

impl Homography {
    /// Least-squares map from `source` to `target` (normalised direct linear transform, Hartley);
    /// `None` for fewer than four points or a degenerate configuration.
    pub fn fit(source: &[DVec2], target: &[DVec2]) -> Option<Self> {
        if source.len() < 4 || source.len() != target.len() {
            return None;
        }
        let (ts, tt) = (normaliser(source)?, normaliser(target)?);
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        for (s, t) in source.iter().zip(target) {
            let u = ts * s.extend(1.0);
            let v = tt * t.extend(1.0);
            for row in [
                [u.x, u.y, 1.0, 0.0, 0.0, 0.0, -v.x * u.x, -v.x * u.y, -v.x],
                [0.0, 0.0, 0.0, u.x, u.y, 1.0, -v.y * u.x, -v.y * u.y, -v.y],
            ] {
                let r = SVector::<f64, 9>::from(row);
                normal += r * r.transpose();
            }
        }
        let eigen = normal.symmetric_eigen();
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        // A second vanishing eigenvalue means collinear points.
        if eigen.eigenvalues[order[1]] < 1e-12 * eigen.eigenvalues[order[8]] {
            return None;
        }
        let h = eigen.eigenvectors.column(order[0]);
        let h = DMat3::from_cols_array(&[h[0], h[3], h[6], h[1], h[4], h[7], h[2], h[5], h[8]]);
        let h = tt.inverse() * h * ts;
        let scale = h.z_axis.z;
        let h = if scale.abs() > 1e-12 { h * scale.recip() } else { h };
        h.is_finite().then_some(Self(h))
    }

    /// Image of a point; not finite on the horizon.
    pub fn apply(&self, p: DVec2) -> DVec2 {
        let q = self.0 * p.extend(1.0);
        q.truncate() / q.z
    }

    /// The inverse map.
    pub fn inverse(&self) -> Self {
        Self(self.0.inverse())
    }
}

/// Similarity that normalises points to mean 0 and mean distance sqrt(2).
fn normaliser(points: &[DVec2]) -> Option<DMat3> {
    let n = points.len() as f64;
    let centre = points.iter().sum::<DVec2>() / n;
    let spread = points.iter().map(|p| (*p - centre).length()).sum::<f64>() / n;
    if !(spread > 0.0 && spread.is_finite()) {
        return None;
    }
    let k = std::f64::consts::SQRT_2 / spread;
    Some(DMat3::from_cols(
        DVec3::new(k, 0.0, 0.0),
        DVec3::new(0.0, k, 0.0),
        DVec3::new(-k * centre.x, -k * centre.y, 1.0),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_known_map_and_refuses_points_on_a_line() {
        let h = Homography(DMat3::from_cols_array(&[
            1.2, 0.1, 1e-4, -0.2, 0.9, -2e-4, 30.0, 40.0, 1.0,
        ]));
        let source: Vec<DVec2> =
            (0..12).map(|i| DVec2::new(f64::from(i % 4) * 50.0, f64::from(i / 4) * 70.0)).collect();
        let target: Vec<DVec2> = source.iter().map(|p| h.apply(*p)).collect();
        let fitted = Homography::fit(&source, &target).unwrap();
        for p in &source {
            assert!((fitted.apply(*p) - h.apply(*p)).length() < 1e-8);
            assert!((fitted.inverse().apply(h.apply(*p)) - *p).length() < 1e-8);
        }
        let line: Vec<DVec2> = (0..6).map(|i| DVec2::new(f64::from(i), 2.0)).collect();
        assert!(Homography::fit(&line, &line).is_none());
    }
}
