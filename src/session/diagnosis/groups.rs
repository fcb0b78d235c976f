//! Photographs in two groups: of two samples, or of one sample that was moved or turned on the board.
//!
//! The fine detail of a texel's log radiance comes from its albedo and from its slopes along the direction of the
//! light. Over a sample, the details of photographs `i` and `j` have the covariance `a² + s² t_i . t_j`, where `t` is
//! the horizontal part of the light's direction, if both show the same texels; otherwise they have none. The search
//! looks for the division that explains the correlations of all pairs best.
//!
//! Contrast that changes with the angle (bare metal beside paint) divides photographs as well: steep views correlate
//! with oblique ones now more, now less, even negatively. Two groups must therefore prove that they show different
//! texels: their details do not correlate at all, or they correlate well once one group is shifted.

use crate::observation::Observation;
use crate::parallel;
use crate::session::hint::Group;

/// Fewest photographs in a group. A single one is a contradiction instead.
const LEAST: usize = 2;
/// Most photographs of which all divisions are tried; with more, only divisions in their order.
const ALL_DIVISIONS: usize = 10;
/// Largest misfit of the correlations with a division, relative to that without one.
const LEFT: f64 = 0.5;
/// Least mean correlation inside groups, and largest one between them relative to it.
const INSIDE: f64 = 0.15;
const BETWEEN: f64 = 0.45;
/// Largest root mean square correlation between unrelated groups, relative to that inside.
const NOTHING: f64 = 0.2;
/// Largest shift tried, relative to the sample's side; step of the first search, texels; least correlation that the
/// right shift restores, relative to that inside.
const SHIFT: f32 = 0.06;
const STRIDE: usize = 3;
const RESTORED: f64 = 0.6;
/// Radius of detail, relative to the sample's side.
const DETAIL: f32 = 0.03;
/// Border of the sample that is left out, relative to its side: edges are alike in all photographs.
const BORDER: f32 = 0.015;
/// Half vectors nearer to the normal show a highlight instead of albedo, degrees.
const HIGHLIGHT_DEG: f32 = 10.0;
/// Fewest texels that two photographs share.
const SHARED: usize = 500;

/// The smaller of two groups that contradict each other, if any.
pub(super) fn find(photographs: &[Observation]) -> Option<Group> {
    let n = photographs.len();
    if n < 2 * LEAST {
        return None;
    }
    let details = parallel::map(n, |i| Detail::of(&photographs[i]));
    let mut pairs = Vec::new();
    for i in 0..n {
        for j in 0..i {
            if let Some(correlation) = correlation(&details[i], &details[j]) {
                let [a, b] = [i, j].map(|k| details[k].towards_light);
                let lights = f64::from(a[0] * b[0] + a[1] * b[1]);
                pairs.push(Pair { members: [i, j], correlation, lights });
            }
        }
    }
    let whole = misfit(&pairs, 0);
    let masks: Vec<u64> = if n <= ALL_DIVISIONS {
        (1..1 << (n - 1)).collect()
    } else {
        (1..n).map(|k| (1 << k) - 1).collect()
    };
    let sizes = |mask: u64| {
        let inside = mask.count_ones() as usize;
        inside.min(n - inside)
    };
    let tried = masks.into_iter().filter(|mask| sizes(*mask) >= LEAST);
    let (left, mask) =
        tried.map(|mask| (misfit(&pairs, mask), mask)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mean = |of: &dyn Fn([u64; 2]) -> bool| {
        let each = pairs.iter().filter(|p| of(p.members.map(|i| mask >> i & 1)));
        let (sum, count) = each.fold((0.0, 0.0), |(s, n), p| (s + p.correlation, n + 1.0));
        (count > 0.0).then(|| sum / count)
    };
    // Each group must show one texture. Relief shows none from above.
    let inside = [0, 1].map(|group| mean(&|[a, b]| a == group && b == group));
    let inside = inside[0]?.min(inside[1]?);
    let between = mean(&|[a, b]| a != b)?;
    let divided = left < LEFT * whole
        && inside > INSIDE
        && between < BETWEEN * inside
        && are_other_texels(&details, &pairs, mask, inside);
    let members = (0..n).filter(|i| mask >> i & 1 == 1);
    let others = (0..n).filter(|i| mask >> i & 1 == 0);
    let smaller = 2 * (mask.count_ones() as usize) < n
        || (2 * (mask.count_ones() as usize) == n && mask & 1 == 0);
    divided.then(|| if smaller { Group::of(members) } else { Group::of(others) })
}

/// Correlation of the details of two photographs.
struct Pair {
    members: [usize; 2],
    correlation: f64,
    /// Scalar product of the horizontal parts of the directions to their lights.
    lights: f64,
}

impl Pair {
    fn is_inside(&self, mask: u64) -> bool {
        let [a, b] = self.members.map(|i| mask >> i & 1);
        a == b
    }
}

/// Whether two groups show different texels. `inside` is the mean correlation inside the groups.
fn are_other_texels(details: &[Detail], pairs: &[Pair], mask: u64, inside: f64) -> bool {
    let between = || pairs.iter().filter(|p| !p.is_inside(mask));
    let count = between().count().max(1) as f64;
    let square = between().map(|p| p.correlation * p.correlation).sum::<f64>() / count;
    if square.sqrt() < NOTHING * inside {
        return true;
    }
    // Lights from similar directions show the same detail.
    let apart = |p: &&Pair| {
        let [a, b] = p.members.map(|i| details[i].towards_light);
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    let nearest = between().min_by(|p, q| apart(p).total_cmp(&apart(q)));
    let Some([a, b]) = nearest.map(|p| p.members.map(|i| &details[i])) else { return false };
    let reach = (SHIFT * a.width as f32).ceil() as isize;
    let rows: Vec<isize> = (-reach..=reach).collect();
    let best = parallel::map(rows.len(), |i| {
        let tried = (-reach..=reach).filter_map(|x| {
            let shift = [x, rows[i]];
            Some((correlation_shifted(a, b, shift, STRIDE)?, shift))
        });
        tried.max_by(|a, b| a.0.total_cmp(&b.0))
    });
    let best = best.into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
    let restored = best.and_then(|(_, shift)| correlation_shifted(a, b, shift, 1));
    restored.is_some_and(|correlation| correlation > RESTORED * inside)
}

/// Mean squared residual of the correlations, explained by albedo and slopes inside groups and by nothing between them.
fn misfit(pairs: &[Pair], mask: u64) -> f64 {
    let inside = || pairs.iter().filter(|p| p.is_inside(mask));
    let sum = |f: &dyn Fn(&Pair) -> f64| inside().map(f).sum::<f64>();
    let (n, t, tt) = (sum(&|_| 1.0), sum(&|p| p.lights), sum(&|p| p.lights * p.lights));
    let (r, rt) = (sum(&|p| p.correlation), sum(&|p| p.correlation * p.lights));
    let determinant = n * tt - t * t;
    let both = (determinant > 1e-9 * n * tt)
        .then(|| [(r * tt - rt * t) / determinant, (n * rt - t * r) / determinant]);
    let least = |v: f64| v.max(0.0);
    // Both are variances: negative solutions become 0.
    let [albedo, slopes] = match both {
        Some([a, s]) if a >= 0.0 && s >= 0.0 => [a, s],
        Some([a, _]) if a < 0.0 && tt > 0.0 => [0.0, least(rt / tt)],
        _ => [if n > 0.0 { least(r / n) } else { 0.0 }, 0.0],
    };
    let left = |p: &Pair| {
        let expected = if p.is_inside(mask) { albedo + slopes * p.lights } else { 0.0 };
        (p.correlation - expected).powi(2)
    };
    pairs.iter().map(left).sum::<f64>() / pairs.len().max(1) as f64
}

/// The fine detail of a photograph.
struct Detail {
    /// Log radiance minus its local mean; `None` in highlights and where nothing is visible.
    values: Vec<Option<f32>>,
    /// Texels along a row.
    width: usize,
    /// Horizontal part of the direction of the light over its vertical part.
    towards_light: [f32; 2],
}

impl Detail {
    fn of(photograph: &Observation) -> Self {
        let (w, h) = (photograph.width(), photograph.height());
        let view = &photograph.view;
        let limit = HIGHLIGHT_DEG.to_radians().cos();
        let border = (BORDER * w.max(h) as f32).ceil() as usize;
        let inside = |i: usize, n: usize| (border..n.saturating_sub(border)).contains(&i);
        let log = |t: usize| {
            if photograph.weight(t) <= 0.0 || !inside(t % w, w) || !inside(t / w, h) {
                return None;
            }
            let [x, y] = view.texel_mm(w, h, t % w, t / w);
            let unit = |p: [f32; 3]| {
                let d = [p[0] - x, p[1] - y, p[2]];
                let length = d.iter().map(|v| v * v).sum::<f32>().sqrt();
                d.map(|v| v / length)
            };
            let (a, b) = (unit(view.camera_mm), unit(view.light_mm));
            let half: [f32; 3] = std::array::from_fn(|k| a[k] + b[k]);
            let glossy = half[2] > limit * half.iter().map(|v| v * v).sum::<f32>().sqrt();
            let values: [f32; 3] = std::array::from_fn(|c| photograph.radiance(c, t));
            let sum: f32 = values.iter().sum();
            let saturated = values.iter().any(|v| *v < 0.0);
            (!glossy && !saturated && sum > 1e-4).then(|| sum.ln())
        };
        let logs: Vec<Option<f32>> = (0..w * h).map(log).collect();
        let radius = (DETAIL * w.max(h) as f32).ceil() as usize;
        let means = box_means(&logs, w, h, radius);
        let values =
            logs.iter().zip(means).map(|(v, mean)| v.zip(mean).map(|(v, m)| v - m)).collect();
        let [x, y, z] = view.light_mm;
        Self { values, width: w, towards_light: [x / z, y / z] }
    }
}

/// Means over the square round each texel; `None` where most of its values are missing.
fn box_means(values: &[Option<f32>], w: usize, h: usize, radius: usize) -> Vec<Option<f32>> {
    let stride = w + 1;
    let mut sums = vec![[0.0_f64; 2]; stride * (h + 1)];
    for y in 0..h {
        let mut row = [0.0; 2];
        for x in 0..w {
            if let Some(v) = values[y * w + x] {
                row = [row[0] + f64::from(v), row[1] + 1.0];
            }
            let above = sums[y * stride + x + 1];
            sums[(y + 1) * stride + x + 1] = [above[0] + row[0], above[1] + row[1]];
        }
    }
    let mean = |i: usize| {
        let (x, y) = (i % w, i / w);
        let (x0, x1) = (x.saturating_sub(radius), (x + radius + 1).min(w));
        let (y0, y1) = (y.saturating_sub(radius), (y + radius + 1).min(h));
        let at = |x: usize, y: usize| sums[y * stride + x];
        let of = |k: usize| at(x1, y1)[k] - at(x0, y1)[k] - at(x1, y0)[k] + at(x0, y0)[k];
        let (sum, count) = (of(0), of(1));
        (2.0 * count > ((x1 - x0) * (y1 - y0)) as f64).then(|| (sum / count) as f32)
    };
    (0..w * h).map(mean).collect()
}

/// `None` if the photographs share too few texels.
fn correlation(a: &Detail, b: &Detail) -> Option<f64> {
    correlation_shifted(a, b, [0, 0], 1)
}

/// The same with `b` shifted, texels, from every `stride`-th texel of each row.
fn correlation_shifted(a: &Detail, b: &Detail, [dx, dy]: [isize; 2], stride: usize) -> Option<f64> {
    let (w, h) = (a.width, a.values.len() / a.width.max(1));
    let (mut ab, mut aa, mut bb, mut count) = (0.0_f64, 0.0, 0.0, 0);
    for y in 0..h {
        let Some(from) = y.checked_add_signed(dy).filter(|y| *y < h) else { continue };
        // Rows start at different columns, so that a texture of columns is sampled evenly.
        for x in (y % stride..w).step_by(stride) {
            let Some(other) = x.checked_add_signed(dx).filter(|x| *x < w) else { continue };
            if let (Some(a), Some(b)) = (a.values[y * w + x], b.values[from * w + other]) {
                // Specks of dust must not outweigh the texture.
                let (a, b) = (f64::from(a.clamp(-0.5, 0.5)), f64::from(b.clamp(-0.5, 0.5)));
                (ab, aa, bb, count) = (ab + a * b, aa + a * a, bb + b * b, count + stride);
            }
        }
    }
    (count >= SHARED && aa > 0.0 && bb > 0.0).then(|| ab / (aa * bb).sqrt())
}
