//! Sub-pixel position of an X-corner.
//!
//! On an edge through the corner the gradient is perpendicular to the edge; elsewhere it vanishes.
//! Every pixel `p` with gradient `g` thus satisfies `g . (q - p) = 0` at the corner `q` (Förstner
//! and Gülch 1987). The weighted least-squares solution is iterated with a moving window.
//!
//! The window is a cross along the two edges, sheared like the cell. It covers much of both edges,
//! no neighbouring edge and little noise between them, for any tilt of the board.

use super::luma::LumaImage;
use glam::{DMat2, DVec2};

/// Longest arm, px: lens distortion bends longer edges.
const ARM_MAX_PX: f64 = 24.0;
/// Least length and width of an arm, px.
const ARM_MIN_PX: f64 = 2.5;
const ITERATIONS_MAX: usize = 12;
/// Steps shorter than this end the iteration, px.
const STEP_MIN_PX: f64 = 1e-3;
/// The corner may move this far within one patch of gradients, px.
const PATCH_MARGIN_PX: f64 = 2.0;

/// Shape of the window: lengths from the corner, in cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// Along each edge; below 0.5.
    pub along: f64,
    /// To the sides of each edge.
    pub across: f64,
}

/// Refines corners, with reused buffers.
#[derive(Default)]
pub(super) struct Refiner {
    raw: Vec<f32>,
    smooth: Vec<f32>,
    /// Products xx, xy, yy of the gradient.
    products: Vec<[f32; 3]>,
}

/// Pixels of the picture that a patch covers.
struct Patch {
    x0: usize,
    y0: usize,
    width: usize,
    height: usize,
}

impl Refiner {
    /// Moves `start` to the X-corner near it. `cell` holds the pixels per column and per row of the
    /// board. `None` if it leaves the picture, moves by more than `max_shift` px, or the window
    /// holds no crossing edges.
    pub fn refine(
        &mut self,
        image: &LumaImage,
        start: DVec2,
        cell: DMat2,
        window: Window,
        max_shift: f64,
    ) -> Option<DVec2> {
        let (long, short) = {
            let (a, b) = (cell.x_axis.length(), cell.y_axis.length());
            (a.max(b), a.min(b))
        };
        if !(short > 1.0 && cell.determinant().abs() > 0.1 * short * long) {
            return None;
        }
        let along = window.along.min(ARM_MAX_PX / long).max(ARM_MIN_PX / short);
        let across = window.across.min(along).max(ARM_MIN_PX / short);
        let to_cells = cell.inverse();
        let arm = |f: f64, g: f64| f * cell.x_axis.abs() + g * cell.y_axis.abs();
        let half = arm(along, across).max(arm(across, along)) + PATCH_MARGIN_PX;
        let mut q = start;
        let mut centre = DVec2::INFINITY;
        let mut patch = Patch { x0: 0, y0: 0, width: 0, height: 0 };
        for _ in 0..ITERATIONS_MAX {
            if (q - centre).abs().max_element() > PATCH_MARGIN_PX {
                centre = q;
                patch = self.gradients(image, q, half)?;
            }
            let step = self.step(&patch, q, to_cells, along, across)?;
            q += step;
            if (q - start).length() > max_shift || !image.contains(q, 1.0) {
                return None;
            }
            if step.length() < STEP_MIN_PX {
                break;
            }
        }
        Some(q)
    }

    /// Gradient products of the smoothed picture around `q`.
    fn gradients(&mut self, image: &LumaImage, q: DVec2, half: DVec2) -> Option<Patch> {
        if !image.contains(q, 4.0) {
            return None;
        }
        // Smoothing and differences need two pixels on each side.
        let low = (q - half).floor().max(DVec2::splat(2.0));
        let limit = DVec2::new(image.width as f64, image.height as f64) - 3.0;
        let high = (q + half).ceil().min(limit);
        let (x0, y0) = (low.x as usize, low.y as usize);
        let (width, height) = ((high.x - low.x) as usize + 1, (high.y - low.y) as usize + 1);
        let (w, h) = (width + 2, height + 2);
        self.raw.clear();
        // Binomial 1 2 1 across, then down.
        for y in y0 - 2..y0 + height + 2 {
            let row = &image.data[y * image.width + x0 - 2..][..w + 2];
            self.raw.extend(row.windows(3).map(|v| v[0] + 2.0 * v[1] + v[2]));
        }
        self.smooth.clear();
        for y in 0..h {
            let (a, rest) = self.raw[y * w..].split_at(w);
            let (b, c) = rest.split_at(w);
            self.smooth.extend(a.iter().zip(b).zip(c).map(|((a, b), c)| a + 2.0 * b + c));
        }
        self.products.clear();
        for y in 1..=height {
            let (above, here) = (&self.smooth[(y - 1) * w..][..w], &self.smooth[y * w..][..w]);
            let below = &self.smooth[(y + 1) * w..][..w];
            self.products.extend((1..=width).map(|x| {
                let (gx, gy) = (here[x + 1] - here[x - 1], below[x] - above[x]);
                [gx * gx, gx * gy, gy * gy]
            }));
        }
        Some(Patch { x0, y0, width, height })
    }

    /// Step from `q` to the weighted least-squares corner.
    fn step(
        &self,
        patch: &Patch,
        q: DVec2,
        to_cells: DMat2,
        along: f64,
        across: f64,
    ) -> Option<DVec2> {
        // Weight: two strips, (1 - s²)² in both directions.
        let (f, g) = ((1.0 / (along * along)) as f32, (1.0 / (across * across)) as f32);
        let bump = |s2: f32| {
            let t = (1.0 - s2).max(0.0);
            t * t
        };
        let column = to_cells.x_axis.as_vec2();
        let (mut xx, mut xy, mut yy) = (0.0f64, 0.0f64, 0.0f64);
        let (mut bx, mut by) = (0.0f64, 0.0f64);
        for (j, row) in self.products.chunks_exact(patch.width).take(patch.height).enumerate() {
            let dy = ((patch.y0 + j) as f64 - q.y) as f32;
            let dx0 = (patch.x0 as f64 - q.x) as f32;
            let start = to_cells.y_axis.as_vec2() * dy;
            let mut sums = [0.0f32; 5];
            for (i, [gxx, gxy, gyy]) in row.iter().enumerate() {
                let dx = dx0 + i as f32;
                let (u, v) = (start.x + column.x * dx, start.y + column.y * dx);
                let (u2, v2) = (u * u, v * v);
                let weight = bump(u2 * f) * bump(v2 * g) + bump(u2 * g) * bump(v2 * f);
                let (a, b, c) = (weight * gxx, weight * gxy, weight * gyy);
                sums[0] += a;
                sums[1] += b;
                sums[2] += c;
                sums[3] += a * dx + b * dy;
                sums[4] += b * dx + c * dy;
            }
            xx += f64::from(sums[0]);
            xy += f64::from(sums[1]);
            yy += f64::from(sums[2]);
            bx += f64::from(sums[3]);
            by += f64::from(sums[4]);
        }
        let det = xx * yy - xy * xy;
        let trace = xx + yy;
        // A single edge has a singular matrix.
        if det.is_nan() || det <= 1e-3 * trace * trace {
            return None;
        }
        Some(DVec2::new(yy * bx - xy * by, xx * by - xy * bx) / det)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A checkerboard with a corner at `centre`; edges have a blur of about 0.7 px.
    fn board(centre: DVec2, cell: DMat2) -> LumaImage {
        let (width, height) = (90, 80);
        let to_cells = cell.inverse();
        // Distance across edges per cell, px.
        let wide = [cell.y_axis, cell.x_axis].map(|edge| cell.determinant().abs() / edge.length());
        let side = |c: f64, wide: f64| {
            ((c * std::f64::consts::PI).sin() / std::f64::consts::PI * wide / 0.8).tanh()
        };
        let data = (0..width * height)
            .map(|i| {
                let p = DVec2::new((i % width) as f64, (i / width) as f64);
                let c = to_cells * (p - centre);
                (0.425 - 0.375 * side(c.x, wide[0]) * side(c.y, wide[1])).sqrt() as f32
            })
            .collect();
        LumaImage { width, height, data }
    }

    #[test]
    fn corners_of_tilted_cells_are_found_to_a_fiftieth_of_a_pixel() {
        let mut refiner = Refiner::default();
        let window = Window { along: 0.4, across: 0.2 };
        for (u, v) in [
            (DVec2::new(22.0, 3.0), DVec2::new(-4.0, 20.0)),
            (DVec2::new(18.0, 12.0), DVec2::new(-7.0, 6.0)),
            (DVec2::new(26.0, 1.0), DVec2::new(2.0, 8.5)),
        ] {
            let cell = DMat2::from_cols(u, v);
            for k in 0..10 {
                let k = f64::from(k);
                let centre = DVec2::new(43.0 + 0.137 * k, 38.0 - 0.219 * k);
                let image = board(centre, cell);
                let start = centre + DVec2::from_angle(k) * 1.2;
                let found = refiner.refine(&image, start, cell, window, 4.0).unwrap();
                let error = (found - centre).length();
                assert!(error < 0.02, "{u} {v}: {error}");
            }
        }
    }

    #[test]
    fn edges_and_flat_pictures_have_no_corner() {
        let mut refiner = Refiner::default();
        let window = Window { along: 0.4, across: 0.2 };
        let cell = DMat2::from_diagonal(DVec2::splat(20.0));
        let start = DVec2::new(30.0, 30.0);
        let flat = LumaImage { width: 60, height: 60, data: vec![0.5; 3600] };
        assert!(refiner.refine(&flat, start, cell, window, 5.0).is_none());
        let data = (0..3600).map(|i| if i % 60 < 31 { 0.2 } else { 0.9 }).collect();
        let edge = LumaImage { width: 60, height: 60, data };
        assert!(refiner.refine(&edge, start, cell, window, 5.0).is_none());
        assert!(refiner.refine(&edge, DVec2::new(1.0, 1.0), cell, window, 5.0).is_none());
    }
}
