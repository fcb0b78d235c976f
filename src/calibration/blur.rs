//! Sharpness of the board's edges.

use super::layout::{Labelling, Layout};
use super::luma::LumaImage;
use crate::statistics::median;
use glam::DVec2;

/// Half length of an edge profile on plain squares, in squares.
const PROFILE_CELLS: f64 = 0.3;

/// Edges must be this many times softer than the others to indicate a direction.
const DIRECTED: f64 = 1.5;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EdgeSpread {
    /// Standard deviation, px.
    pub px: f64,
    /// Direction across the softer edges if they are clearly softer: degrees clockwise from the
    /// picture's x axis, 0 to 180.
    pub direction_deg: Option<f64>,
}

/// Edge spread in the softer of the board's two directions, the median over its edges; `None` if no
/// edge has both ends.
///
/// The profile across an edge is modelled as a step smoothed by a Gaussian. On boards with markers
/// the profile is narrow, and a larger width is reported as its half length.
pub(super) fn edge_spread(
    image: &LumaImage,
    layout: &Layout,
    labelling: &Labelling,
) -> Option<EdgeSpread> {
    let mut spreads = [Vec::new(), Vec::new()];
    // Angles are doubled, because a normal and its opposite are one direction.
    let mut normals = [DVec2::ZERO; 2];
    for (i, &(row, col)) in layout.corners.iter().enumerate() {
        let Some(from) = labelling.px[i] else { continue };
        for (along, next) in [(0, (row, col + 1)), (1, (row + 1, col))] {
            let Ok(j) = layout.corners.binary_search(&next) else { continue };
            let Some(to) = labelling.px[j] else { continue };
            let middle = DVec2::new(f64::from(col + next.1), f64::from(row + next.0)) / 2.0;
            let cell = labelling.model.cell(middle);
            let across = if along == 0 { cell.y_axis } else { cell.x_axis };
            let reach = if layout.plain() < 0.2 { layout.plain() } else { PROFILE_CELLS };
            // Project the reach onto the edge's normal.
            let normal = (to - from).perp().normalize_or_zero();
            let half = reach * across.dot(normal).abs();
            if let Some(spread) = spread_of_edge(image, from, to, half) {
                spreads[along].push(spread);
                normals[along] += normal.rotate(normal);
            }
        }
    }
    let medians = spreads.map(median);
    let softer = usize::from(medians[1] > medians[0]);
    let px = medians[softer]?;
    let directed = medians[1 - softer].is_some_and(|other| px > DIRECTED * other);
    let degrees = 0.5 * normals[softer].to_angle().to_degrees();
    Some(EdgeSpread { px, direction_deg: directed.then_some(degrees.rem_euclid(180.0)) })
}

/// Width of the edge from `from` to `to`, from two differences across it at `inner` and `half` px:
/// their ratio is `erf(inner / (sqrt(2) sigma)) / erf(half / (sqrt(2) sigma))`.
fn spread_of_edge(image: &LumaImage, from: DVec2, to: DVec2, half: f64) -> Option<f64> {
    if half < 1.5 {
        return None;
    }
    let normal = (to - from).perp().normalize_or_zero();
    let difference = |offset: f64| {
        let mut sum = 0.0;
        for t in [0.35, 0.425, 0.5, 0.575, 0.65] {
            let p = from + t * (to - from);
            // Blur acts on linear light; the image holds square roots.
            let (a, b) = (image.sample(p + offset * normal), image.sample(p - offset * normal));
            sum += f64::from(a * a - b * b);
        }
        sum
    };
    let whole = difference(half);
    let mut sigma: f64 = 0.0;
    for _ in 0..3 {
        let inner = (0.8 * sigma).clamp(0.75, 0.7 * half.max(1.1));
        let ratio = difference(inner) / whole;
        if !ratio.is_finite() || ratio <= 0.0 {
            return None;
        }
        let expected = |s: f64| erf(inner / s) / erf(half / s);
        // `expected` falls from 1 to inner / half.
        let (mut low, mut high) = (0.05, std::f64::consts::SQRT_2 * half);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if expected(middle) > ratio { low = middle } else { high = middle }
        }
        sigma = 0.5 * (low + high) * std::f64::consts::FRAC_1_SQRT_2;
    }
    Some(sigma)
}

/// Error function to 1.5e-7 (Abramowitz and Stegun 7.1.26), `x >= 0`.
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = 0.254_829_592
        + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429)));
    1.0 - t * series * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_width_of_a_gaussian_edge_comes_back() {
        for sigma in [0.8, 1.5, 3.0, 5.0] {
            let (width, height) = (80, 60);
            let data = (0..width * height)
                .map(|i| {
                    let x = (i % width) as f64 - 40.2;
                    let step = x.signum() * erf(x.abs() / sigma * std::f64::consts::FRAC_1_SQRT_2);
                    (0.45 + 0.4 * step).sqrt() as f32
                })
                .collect();
            let image = LumaImage { width, height, data };
            let ends = (DVec2::new(40.2, 15.0), DVec2::new(40.2, 45.0));
            let found = spread_of_edge(&image, ends.0, ends.1, 9.0).unwrap();
            // Bilinear interpolation widens an edge by up to half a pixel, added in squares.
            assert!((found - sigma).abs() < 0.12 * sigma + 0.05, "{sigma}: {found}");
        }
    }
}
