//! X-corners: saddle points of the picture at which two edges cross.
//!
//! Candidates are maxima of `-det(Hessian)` relative to the local brightness. A ring around each
//! must show exactly four alternating sectors, with equal opposite ones. The four transitions give
//! the directions of the two edges.

use super::luma::LumaImage;
use glam::DVec2;
use std::f64::consts::{PI, TAU};

/// Radius of the ring, px of the level. Squares must be slightly larger.
const RING_RADIUS_PX: f64 = 4.0;
const RING_SAMPLES: usize = 24;
/// Candidates checked per level.
const CANDIDATES_MAX: usize = 12_000;
/// Corners kept per level.
const SADDLES_MAX: usize = 4_000;
/// Response relative to brightness: a quarter of full contrast with 3 px of blur.
const RESPONSE_MIN: f32 = 0.008;
/// Difference of bright and dark sectors relative to the bright ones, on the square-root scale.
const CONTRAST_MIN: f32 = 0.12;
/// Smallest angle between two edges, radians, at a tilt of about 75 degrees.
const SECTOR_MIN: f64 = 0.3;
/// Largest deviation of opposite transitions from a straight line, radians.
const BEND_MAX: f64 = 0.45;

/// An X-corner of one level of the pyramid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Saddle {
    /// Position, px of its level.
    pub px: DVec2,
    /// Unit directions of the four edges leaving the corner, by ascending angle in the picture
    /// (clockwise as displayed). The first and third, second and fourth are opposite.
    pub ports: [DVec2; 4],
    /// Whether the sector from port 0 to port 1 is bright; sectors alternate.
    pub first_bright: bool,
    /// Bright minus dark.
    pub contrast: f32,
}

impl Saddle {
    /// Whether the sector from port `k` to port `k + 1` is bright.
    pub fn is_bright(&self, k: usize) -> bool {
        self.first_bright == k.is_multiple_of(2)
    }
}

/// All X-corners of a level, strongest first.
pub(super) fn find(level: &LumaImage) -> Vec<Saddle> {
    if level.width < 16 || level.height < 16 {
        return Vec::new();
    }
    let smooth = level.smoothed();
    let mut maxima = response_maxima(&smooth);
    let by_response = |a: &(f32, u32), b: &(f32, u32)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
    if maxima.len() > CANDIDATES_MAX {
        maxima.select_nth_unstable_by(CANDIDATES_MAX, by_response);
        maxima.truncate(CANDIDATES_MAX);
    }
    maxima.sort_unstable_by(by_response);
    let mut saddles: Vec<Saddle> = maxima
        .iter()
        .filter_map(|&(_, i)| {
            let (x, y) = (i as usize % level.width, i as usize / level.width);
            ring_check(&smooth, saddle_point(&smooth, x, y)?)
        })
        .collect();
    saddles.truncate(SADDLES_MAX);
    saddles
}

/// Relative response and pixel of every local maximum (5 x 5) above the threshold.
fn response_maxima(smooth: &LumaImage) -> Vec<(f32, u32)> {
    let (w, h) = (smooth.width, smooth.height);
    // Ignore deep shadows, where noise dominates the relative response.
    let mean = smooth.data.iter().map(|&v| f64::from(v)).sum::<f64>() / smooth.data.len() as f64;
    let floor = 0.1 * mean as f32 + 1e-6;
    let mut response = vec![0.0f32; w * h];
    for y in 1..h - 1 {
        let upper = &smooth.data[(y - 1) * w..][..w];
        let here = &smooth.data[y * w..][..w];
        let lower = &smooth.data[(y + 1) * w..][..w];
        let out = &mut response[y * w..][..w];
        for x in 1..w - 1 {
            let centre = here[x];
            let xx = here[x - 1] - 2.0 * centre + here[x + 1];
            let yy = upper[x] - 2.0 * centre + lower[x];
            let xy = 0.25 * ((upper[x - 1] + lower[x + 1]) - (upper[x + 1] + lower[x - 1]));
            let scale = centre + floor;
            out[x] = (xy * xy - xx * yy) / (scale * scale);
        }
    }
    let threshold = RESPONSE_MIN * RESPONSE_MIN;
    let margin = RING_RADIUS_PX as usize + 1;
    let mut maxima = Vec::new();
    for y in margin..h.saturating_sub(margin) {
        let row = &response[y * w..][..w];
        for x in margin..w.saturating_sub(margin) {
            let r = row[x];
            if r <= threshold || row[x - 1] >= r || row[x + 1] > r {
                continue;
            }
            // Ties go to the first pixel in reading order.
            let before = |dy: usize| response[(y - dy) * w + x - 2..][..5].iter().all(|&v| v < r);
            let after = |dy: usize| response[(y + dy) * w + x - 2..][..5].iter().all(|&v| v <= r);
            if row[x - 2] < r && row[x + 2] <= r && before(1) && after(1) && before(2) && after(2) {
                maxima.push((r, (y * w + x) as u32));
            }
        }
    }
    maxima
}

/// Zero of the gradient near a pixel, by the local quadratic.
fn saddle_point(smooth: &LumaImage, x: usize, y: usize) -> Option<DVec2> {
    let w = smooth.width;
    let at = |dx: isize, dy: isize| {
        let i = (y as isize + dy) * w as isize + x as isize + dx;
        f64::from(smooth.data[i as usize])
    };
    let (gx, gy) = (0.5 * (at(1, 0) - at(-1, 0)), 0.5 * (at(0, 1) - at(0, -1)));
    let xx = at(-1, 0) - 2.0 * at(0, 0) + at(1, 0);
    let yy = at(0, -1) - 2.0 * at(0, 0) + at(0, 1);
    let xy = 0.25 * (at(-1, -1) + at(1, 1) - at(1, -1) - at(-1, 1));
    let det = xx * yy - xy * xy;
    if det >= 0.0 {
        return None;
    }
    let shift = DVec2::new(xy * gy - yy * gx, xy * gx - xx * gy) / det;
    (shift.abs().max_element() < 1.5).then(|| DVec2::new(x as f64, y as f64) + shift)
}

/// Checks for four alternating sectors on a ring around `px`.
fn ring_check(smooth: &LumaImage, px: DVec2) -> Option<Saddle> {
    if !smooth.contains(px, RING_RADIUS_PX) {
        return None;
    }
    let step = TAU / RING_SAMPLES as f64;
    let mut ring = [0.0f32; RING_SAMPLES];
    for (k, v) in ring.iter_mut().enumerate() {
        *v = smooth.sample(px + RING_RADIUS_PX * DVec2::from_angle(step * k as f64));
    }
    let mut sorted = ring;
    sorted.sort_unstable_by(f32::total_cmp);
    let low = 0.25 * sorted[..4].iter().sum::<f32>();
    let high = 0.25 * sorted[RING_SAMPLES - 4..].iter().sum::<f32>();
    let contrast = high - low;
    if contrast <= CONTRAST_MIN * high {
        return None;
    }
    let middle = 0.5 * (low + high);
    let mut crossings = [(0.0, false); 4];
    let mut count = 0;
    for k in 0..RING_SAMPLES {
        let (a, b) = (ring[k] - middle, ring[(k + 1) % RING_SAMPLES] - middle);
        if (a > 0.0) != (b > 0.0) {
            if count == 4 {
                return None;
            }
            crossings[count] = (step * (k as f64 + f64::from(a / (a - b))), b > 0.0);
            count += 1;
        }
    }
    if count != 4 {
        return None;
    }
    // Extremes of the four sectors; opposite sectors must agree.
    let mut extremes = [0.0f32; 4];
    for (k, extreme) in extremes.iter_mut().enumerate() {
        let (from, bright) = crossings[k];
        let to = if k == 3 { crossings[0].0 + TAU } else { crossings[k + 1].0 };
        let inside = (from / step).ceil() as usize..=(to / step).floor() as usize;
        let values = inside.map(|i| ring[i % RING_SAMPLES]);
        *extreme = if bright {
            values.fold(f32::NEG_INFINITY, f32::max)
        } else {
            values.fold(f32::INFINITY, f32::min)
        };
    }
    let unlike = |a: f32, b: f32| (a - b).abs() > 0.6 * contrast;
    if unlike(extremes[0], extremes[2]) || unlike(extremes[1], extremes[3]) {
        return None;
    }
    let angles = crossings.map(|c| c.0);
    let bend = [angles[2] - angles[0] - PI, angles[3] - angles[1] - PI];
    if bend.iter().any(|b| b.abs() > BEND_MAX) {
        return None;
    }
    let lines = [angles[0] + 0.5 * bend[0], angles[1] + 0.5 * bend[1]];
    let opening = lines[1] - lines[0];
    if !(SECTOR_MIN..=PI - SECTOR_MIN).contains(&opening) {
        return None;
    }
    let [a, b] = lines.map(DVec2::from_angle);
    Some(Saddle { px, ports: [a, b, -a, -b], first_bright: crossings[0].1, contrast })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two slightly soft edges that cross at `centre` at the given angles.
    fn crossing(centre: DVec2, angles: [f64; 2], noise: f32) -> LumaImage {
        let (width, height) = (64, 48);
        let normals = angles.map(|a| DVec2::from_angle(a).perp());
        let mut state = 1u32;
        let data = (0..width * height)
            .map(|i| {
                let p = DVec2::new((i % width) as f64, (i / width) as f64) - centre;
                let side = |n: DVec2| (p.dot(n) / 0.8).tanh();
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let grain = (state >> 8) as f32 / 16_777_216.0 - 0.5;
                (0.55 + 0.35 * side(normals[0]) * side(normals[1])) as f32 + noise * grain
            })
            .collect();
        LumaImage { width, height, data }
    }

    #[test]
    fn position_directions_and_colours_of_a_crossing() {
        for (first, second) in [(0.1, 1.6), (0.8, 1.7), (-0.4, 0.5)] {
            let centre = DVec2::new(30.3, 21.8);
            let found = find(&crossing(centre, [first, second], 0.02));
            assert_eq!(found.len(), 1);
            let saddle = found[0];
            // A fifth of a pixel from 5 x 5 noisy pixels suffices for the later refinement.
            assert!((saddle.px - centre).length() < 0.2);
            for angle in [first, second] {
                let d = DVec2::from_angle(angle);
                let nearest = saddle.ports.iter().map(|p| p.dot(d)).fold(-1.0, f64::max);
                assert!(nearest > 0.99, "{angle}: {nearest}");
            }
            for k in 0..4 {
                let inside = (saddle.ports[k] + saddle.ports[(k + 1) % 4]).normalize();
                let bright = crossing(centre, [first, second], 0.0).sample(centre + 4.0 * inside);
                assert_eq!(saddle.is_bright(k), bright > 0.55);
            }
        }
    }

    #[test]
    fn edges_blobs_lines_and_flat_pictures_have_no_corner() {
        let picture = |value: &dyn Fn(DVec2) -> f64| {
            let (width, height) = (64, 48);
            let data = (0..width * height)
                .map(|i| value(DVec2::new((i % width) as f64, (i / width) as f64)) as f32)
                .collect();
            find(&LumaImage { width, height, data }).len()
        };
        let centre = DVec2::new(31.0, 22.0);
        assert_eq!(picture(&|_| 0.0), 0);
        assert_eq!(picture(&|_| 1.0), 0);
        assert_eq!(picture(&|p| (p.x - 20.3).tanh() + 1.0), 0);
        assert_eq!(picture(&|p| (-(p - centre).length_squared() / 18.0).exp() + 0.1), 0);
        assert_eq!(picture(&|p| 1.0 - 0.9 * (-(p.x - p.y).powi(2) / 8.0).exp()), 0);
        // An L-corner (one dark quadrant).
        assert_eq!(
            picture(&|p| 1.0 - 0.25 * ((p.x - 30.0).tanh() + 1.0) * ((p.y - 20.0).tanh() + 1.0)),
            0
        );
    }
}
