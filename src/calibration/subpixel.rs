//! Sub-pixel position of an X-corner.
//!
//! On an edge through the corner the gradient stands across the edge, elsewhere it vanishes: for
//! every pixel `p` with gradient `g`, `g . (q - p) = 0` at the corner `q` (Förstner and Gülch
//! 1987). The weighted least-squares solution is iterated with the window moved to it.

use super::luma::LumaImage;
use glam::DVec2;

/// Half side of the window relative to the smallest cell: beyond 0.3 the edges of the
/// neighbouring corners come in on foreshortened boards.
pub(super) const WINDOW_CELLS: f64 = 0.25;
/// Smallest and largest half side of the window, px.
const HALF_WINDOW_PX: [f64; 2] = [2.0, 16.0];
const ITERATIONS_MAX: usize = 20;
/// Steps shorter than this end the iteration, px.
const STEP_MIN_PX: f64 = 2e-3;

/// Half side of the window for corners whose smallest cell side is `cell` px.
pub(super) fn half_window(cell: f64) -> usize {
    (WINDOW_CELLS * cell).clamp(HALF_WINDOW_PX[0], HALF_WINDOW_PX[1]).round() as usize
}

/// Moves `start` to the X-corner near it; `None` when it leaves the picture, moves further than
/// `max_shift` px, or the window holds no crossing edges.
pub(super) fn refine(
    image: &LumaImage,
    start: DVec2,
    half_window: usize,
    max_shift: f64,
) -> Option<DVec2> {
    let n = half_window as isize;
    let width = half_window as f64;
    let mut q = start;
    for _ in 0..ITERATIONS_MAX {
        if !image.contains(q, width + 2.0) {
            return None;
        }
        let (base, fraction) = (q.floor(), q - q.floor());
        let (x0, y0) = (base.x as isize, base.y as isize);
        let (fx, fy) = (fraction.x as f32, fraction.y as f32);
        let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for dy in -n..=n {
            // Four rows of pixels give the interpolated gradient of one row of samples.
            let row = |k: isize| {
                let start = (y0 + dy + k) as usize * image.width + (x0 - n - 1) as usize;
                &image.data[start..start + 2 * half_window + 4]
            };
            let (r0, r1, r2, r3) = (row(-1), row(0), row(1), row(2));
            let weight_y = (-(dy as f64 / width).powi(2)).exp();
            for i in 0..=2 * half_window {
                let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
                let line = |k: usize| mix(r1[k], r2[k], fy);
                let right = mix(line(i + 2), line(i + 3), fx);
                let left = mix(line(i), line(i + 1), fx);
                let below = mix(mix(r2[i + 1], r3[i + 1], fy), mix(r2[i + 2], r3[i + 2], fy), fx);
                let above = mix(mix(r0[i + 1], r1[i + 1], fy), mix(r0[i + 2], r1[i + 2], fy), fx);
                let (gx, gy) = (f64::from(right - left), f64::from(below - above));
                let dx = i as f64 - width;
                let weight = weight_y * (-(dx / width).powi(2)).exp();
                let (gxx, gxy, gyy) = (weight * gx * gx, weight * gx * gy, weight * gy * gy);
                xx += gxx;
                xy += gxy;
                yy += gyy;
                bx += gxx * dx + gxy * dy as f64;
                by += gxy * dx + gyy * dy as f64;
            }
        }
        let det = xx * yy - xy * xy;
        let trace = xx + yy;
        // A single edge has a singular matrix.
        if det.is_nan() || det <= 1e-4 * trace * trace {
            return None;
        }
        let step = DVec2::new(yy * bx - xy * by, xx * by - xy * bx) / det;
        q += step;
        if (q - start).length() > max_shift {
            return None;
        }
        if step.length() < STEP_MIN_PX {
            return Some(q);
        }
    }
    Some(q)
}
