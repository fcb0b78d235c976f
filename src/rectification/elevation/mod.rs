//! Estimates the height of the sample's surface above the board's plane.
//!
//! # Method
//! The line from the camera through a point of the sample at height `h` meets the board's plane at `x' = f +
//! (x - f) z / (z - h)`, with the camera at height `z` above its foot `f`. A photograph rectified to the
//! board's plane thus shows the raised sample scaled about `f`, and registration has one unknown.
//!
//! Photographs of a rough glossy surface from different sides differ by more than scale: slopes are
//! bright on the flash's side, and highlights move. The criterion therefore uses only the mutual
//! information of details (octaves of log radiance, which gain and fall-off do not affect). Details
//! of all photographs are compared in blocks small enough for one light direction. Minus half the
//! log determinant of their correlation matrix is the information shared by Gaussian variables. It
//! is greatest at correct registration, for any sign and size of the correlation of two
//! photographs. With four or more photographs, albedo and two slopes of a texel may vary
//! independently. Blocks without detail, or with a highlight in one photograph, contribute little.
//!
//! Relief with steep slopes still shifts apparent edges towards the camera, as height would. Colour (red over
//! blue) hardly depends on slopes: where it has detail, its disagreement with brightness counts as error.
//!
//! # Significance
//! The standard deviation combines the estimates of the blocks and the disagreement of the octaves.
//! The height is 0 unless the photographs clearly contradict that.

mod detail;

pub(crate) use detail::Detail;

use detail::{Band, CHANNELS, LEVELS};
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::parallel;

const BRIGHTNESS: usize = 0;
const COLOUR: usize = 1;
/// Search range of heights, mm.
pub const RANGE_MM: [f64; 2] = [-5.0, 20.0];
/// Most photographs compared; the most different are selected.
const MOST_PHOTOGRAPHS: usize = 8;
/// Texels at the edge affected by the sample's surroundings.
const BORDER: usize = 5;
/// Side of a block, texels.
const BLOCK: usize = 32;
/// Texels per independent filtered value.
const CORRELATED: f64 = 9.0;
/// Standard deviation of an unknown height, mm.
const UNKNOWN_MM: f64 = 5.0;
/// The height is 0 unless it differs from 0 by this many standard deviations and mm (paper is a
/// tenth thick, and slopes lit from one side imitate some), and the blocks gain this much
/// information, in total and in standard deviations of their gains.
const SIGMAS: f64 = 4.0;
const LEAST_MM: f64 = 0.3;
const GAIN_MIN: f64 = 25.0;
const GAIN_SIGMAS: f64 = 4.0;
/// Least difference of parallaxes that determines a height.
const SPREAD_MIN: f64 = 0.05;
/// Distance from a peak, texels, at which the information must be lower.
const FAR: f64 = 3.0;
/// Peaks refined beyond the coarse octaves.
const PEAKS: usize = 3;
/// Noise and interpolation floor of details (logs).
const FLOOR: f64 = 0.005;

/// Whether a height is in range, mm.
pub(crate) fn is_possible(mm: f64) -> bool {
    (RANGE_MM[0]..=RANGE_MM[1]).contains(&mm)
}

/// Height of the sample's surface above the board's plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ElevationEstimate {
    /// Height, mm; 0 unless the photographs clearly contradict that.
    pub mm: f64,
    /// Standard deviation, mm.
    pub sigma_mm: f64,
}

impl Default for ElevationEstimate {
    /// In the board's plane, with the prior's deviation.
    fn default() -> Self {
        Self { mm: 0.0, sigma_mm: UNKNOWN_MM }
    }
}

impl ElevationEstimate {
    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        is_possible(self.mm) && (0.0..=f64::MAX).contains(&self.sigma_mm)
    }
}

/// Estimates the height. Inconclusive photographs do not revoke the estimate `before` the latest one.
pub(crate) fn estimate(details: &[&Detail], before: ElevationEstimate) -> ElevationEstimate {
    let views = Views { details: most_different(details) };
    let estimate = views.estimate().unwrap_or_default();
    let is_open = estimate.mm == 0.0 && before.mm.abs() < SIGMAS * estimate.sigma_mm;
    if before.mm != 0.0 && is_open { before } else { estimate }
}

/// Estimate of one channel.
struct ChannelHeight {
    mm: f64,
    sigma_mm: f64,
}

/// Photographs to compare.
struct Views<'a> {
    details: Vec<&'a Detail>,
}

impl Views<'_> {
    fn estimate(&self) -> Option<ElevationEstimate> {
        let spread = spread(&self.details);
        if self.details.len() < 2 || spread < SPREAD_MIN {
            return None;
        }
        let start = self.coarse(spread);
        let height = |channel| self.fine(channel, start, spread);
        let (mut brightness, colour) = (height(BRIGHTNESS), height(COLOUR));
        if let (Some(brightness), Some(colour)) = (&mut brightness, &colour) {
            // Slopes lit from one side shift brightness, but hardly colour.
            let disagreement = brightness.mm - colour.mm;
            brightness.sigma_mm = brightness.sigma_mm.hypot(disagreement);
        }
        let (mut weight, mut sum) = (0.0, 0.0);
        for ChannelHeight { mm, sigma_mm } in brightness.into_iter().chain(colour) {
            weight += sigma_mm.powi(-2);
            sum += sigma_mm.powi(-2) * mm;
        }
        if weight <= 0.0 {
            return None;
        }
        let mm = sum / weight;
        let sigma_mm = weight.sqrt().recip();
        let is_clear = mm.abs() > (SIGMAS * sigma_mm).max(LEAST_MM)
            && (0..CHANNELS).any(|c| self.is_gain(c, mm, 0.0));
        Some(ElevationEstimate { mm: if is_clear { mm } else { 0.0 }, sigma_mm })
    }

    /// Best height by the coarse octaves, over the whole range.
    fn coarse(&self, spread: f64) -> f64 {
        let both = |levels: std::ops::Range<usize>, h: f64| -> f64 {
            let level =
                |l: usize| (0..CHANNELS).map(move |c| self.information(c, l, h)).sum::<f64>();
            levels.map(level).sum()
        };
        let [low, high] = RANGE_MM;
        let step = 0.5 * self.texel_mm(2) / spread;
        let count = ((high - low) / step).ceil().clamp(8.0, 100.0) as usize;
        let step = (high - low) / count as f64;
        let grid: Vec<(f64, f64)> =
            (0..=count).map(|i| low + i as f64 * step).map(|h| (h, both(2..LEVELS, h))).collect();
        let is_peak = |&i: &usize| {
            (i == 0 || grid[i - 1].1 <= grid[i].1) && (i == count || grid[i + 1].1 < grid[i].1)
        };
        let mut peaks: Vec<(f64, f64)> = (0..=count).filter(is_peak).map(|i| grid[i]).collect();
        peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
        peaks.truncate(PEAKS);
        peaks.push((0.0, 0.0));
        let found = peaks.iter().map(|&(h, _)| {
            climb(h, step, 0.5 * self.texel_mm(1) / spread, &|h| both(1..LEVELS, h))
        });
        found.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |best| best.0)
    }

    /// Best height by all octaves of a channel near another one; `None` without a peak.
    fn fine(&self, channel: usize, near: f64, spread: f64) -> Option<ChannelHeight> {
        let texel = self.texel_mm(0) / spread;
        let all = |h: f64| (0..LEVELS).map(|l| self.information(channel, l, h)).sum::<f64>();
        let (mut mm, _) = climb(near, FAR * texel, 0.75 * texel, &all);
        for reach in [0.5 * texel, 0.25 * texel] {
            let [low, here, high] = [mm - reach, mm, mm + reach].map(all);
            mm += vertex(low, here, high, reach)?.clamp(-reach, reach);
        }
        // Noise has peaks too.
        if ![-FAR, FAR].iter().all(|far| self.is_gain(channel, mm, mm + far * texel)) {
            return None;
        }
        // Deviations of blocks and octaves from the peak.
        let reach = 0.25 * texel;
        let (mut push, mut bend, mut disagreement) = (0.0, 0.0, 0.0_f64);
        for level in 0..LEVELS {
            let [low, here, high] =
                [mm - reach, mm, mm + reach].map(|h| self.blocks(channel, level, h));
            let mut own = 0.0;
            for ((low, here), high) in low.iter().zip(&here).zip(&high) {
                push += ((high - low) / (2.0 * reach)).powi(2);
                own += (low + high - 2.0 * here) / (reach * reach);
            }
            bend += own;
            let [low, here, high] = [low, here, high].map(|b| -b.iter().sum::<f64>());
            if let Some(shift) = vertex(low, here, high, reach) {
                disagreement = disagreement.max(shift.abs() - 2.0 / own.sqrt());
            }
        }
        let sigma_mm = (push.sqrt() / bend).hypot(disagreement);
        (bend > 0.0 && sigma_mm < UNKNOWN_MM).then_some(ChannelHeight { mm, sigma_mm })
    }

    /// Whether the blocks of a channel significantly prefer a height to another one.
    fn is_gain(&self, channel: usize, mm: f64, other_mm: f64) -> bool {
        let (mut sum, mut squares) = (0.0, 0.0);
        for level in 0..LEVELS {
            let before = self.blocks(channel, level, other_mm);
            let after = self.blocks(channel, level, mm);
            for (before, after) in before.iter().zip(after) {
                sum += before - after;
                squares += (before - after) * (before - after);
            }
        }
        sum > (GAIN_SIGMAS * squares.sqrt()).max(GAIN_MIN)
    }

    /// Size of a texel, mm.
    fn texel_mm(&self, level: usize) -> f64 {
        let first = self.details[0];
        first.sample_mm[0] / first.channels[0][level].width as f64
    }

    /// Information shared by the photographs.
    fn information(&self, channel: usize, level: usize, h: f64) -> f64 {
        -self.blocks(channel, level, h).iter().sum::<f64>()
    }

    fn blocks(&self, channel: usize, level: usize, h: f64) -> Vec<f64> {
        blocks(&self.details, channel, level, h)
    }
}

/// Position of the maximum of the parabola through three equidistant values, if it has one.
fn vertex(low: f64, here: f64, high: f64, distance: f64) -> Option<f64> {
    let bend = low + high - 2.0 * here;
    (bend < 0.0).then(|| 0.5 * distance * (low - high) / bend)
}

/// The best height within `reach`, in steps of at most `step`.
fn climb(h: f64, reach: f64, step: f64, value: &dyn Fn(f64) -> f64) -> (f64, f64) {
    let n = (reach / step).ceil() as i32;
    let step = reach / f64::from(n);
    (-n..=n)
        .map(|i| h + f64::from(i) * step)
        .filter(|h| (RANGE_MM[0]..=RANGE_MM[1]).contains(h))
        .map(|h| (h, value(h)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((h, f64::NEG_INFINITY))
}

/// Shift of a point of the sample per height.
fn parallax(detail: &Detail) -> DVec2 {
    detail.camera_mm.truncate() / detail.camera_mm.z
}

/// Largest difference between the parallaxes of two photographs.
fn spread(details: &[&Detail]) -> f64 {
    let pairs = details.iter().flat_map(|a| details.iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| parallax(a).distance(parallax(b))).fold(0.0, f64::max)
}

/// The first photograph, then repeatedly the one farthest from those chosen.
fn most_different<'a>(details: &[&'a Detail]) -> Vec<&'a Detail> {
    if details.len() <= MOST_PHOTOGRAPHS {
        return details.to_vec();
    }
    let mut chosen = vec![details[0]];
    while chosen.len() < MOST_PHOTOGRAPHS {
        let distance = |d: &Detail| {
            let each = chosen.iter().map(|c| parallax(c).distance(parallax(d)));
            each.fold(f64::INFINITY, f64::min)
        };
        let next = details.iter().max_by(|a, b| distance(a).total_cmp(&distance(b)));
        let Some(next) = next else { break };
        chosen.push(next);
    }
    chosen
}

/// Half the log determinant of each block's correlations at a height, times its number of independent values.
fn blocks(details: &[&Detail], channel: usize, level: usize, h: f64) -> Vec<f64> {
    let Band { width, height, .. } = details[0].channels[channel][level];
    let across = cuts(width);
    let down = cuts(height);
    let columns = across.len() - 1;
    parallel::map_with(columns * (down.len() - 1), Scratch::default, |scratch, i| {
        let (x, y) = (i % columns, i / columns);
        block(
            details,
            channel,
            level,
            h,
            [across[x], across[x + 1]],
            [down[y], down[y + 1]],
            scratch,
        )
    })
}

/// Borders of blocks along a side. Coarse octaves of narrow samples have none.
fn cuts(texels: usize) -> Vec<usize> {
    let inner = texels.saturating_sub(2 * BORDER);
    if inner == 0 {
        return vec![BORDER];
    }
    let count = ((inner as f64 / BLOCK as f64).round() as usize).max(1);
    (0..=count).map(|i| BORDER + i * inner / count).collect()
}

/// Reused buffers.
#[derive(Default)]
struct Scratch {
    patches: Vec<f32>,
    matrix: Vec<f64>,
    row: Vec<f32>,
    taps: Vec<Option<(usize, [f32; 4])>>,
}

fn block(
    details: &[&Detail],
    channel: usize,
    level: usize,
    h: f64,
    x: [usize; 2],
    y: [usize; 2],
    scratch: &mut Scratch,
) -> f64 {
    let (columns, rows) = (x[1] - x[0], y[1] - y[0]);
    let (texels, n) = (columns * rows, details.len());
    let Scratch { patches, matrix, row, taps } = scratch;
    patches.clear();
    patches.resize(n * texels, 0.0);
    for (detail, patch) in details.iter().zip(patches.chunks_mut(texels)) {
        warp(detail, &detail.channels[channel][level], h, [x[0], y[0]], columns, row, taps, patch);
    }
    let patch = |i: usize| &patches[i * texels..][..texels];
    matrix.clear();
    matrix.resize(n * n, 0.0);
    for i in 0..n {
        for j in 0..=i {
            matrix[i * n + j] = dot(patch(i), patch(j)) / texels as f64;
        }
    }
    let spread: [f64; MOST_PHOTOGRAPHS] = std::array::from_fn(|i| {
        let own = if i < n { matrix[i * n + i] } else { 0.0 };
        (own + FLOOR * FLOOR).sqrt()
    });
    // Cholesky factor of the correlation matrix, in place.
    let mut log = 0.0;
    for i in 0..n {
        for j in 0..=i {
            let own = if i == j { 1.0 } else { matrix[i * n + j] / (spread[i] * spread[j]) };
            let rest: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            matrix[i * n + j] = if i == j {
                let square = (own - rest).max(1e-9);
                log += square.ln();
                square.sqrt()
            } else {
                (own - rest) / matrix[j * n + j]
            };
        }
    }
    0.5 * log * texels as f64 / CORRELATED
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f32; 16];
    let (a_chunks, b_chunks) = (a.chunks_exact(16), b.chunks_exact(16));
    let rest: f32 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for k in 0..16 {
            sums[k] += a[k] * b[k];
        }
    }
    f64::from(sums.iter().sum::<f32>() + rest)
}

/// Details of a block of texels at a height; 0 where unseen. Uses Catmull-Rom, because the
/// smoothing of linear interpolation would favour height 0.
fn warp(
    detail: &Detail,
    band: &Band,
    h: f64,
    corner: [usize; 2],
    columns: usize,
    row: &mut Vec<f32>,
    taps: &mut Vec<Option<(usize, [f32; 4])>>,
    out: &mut [f32],
) {
    let eye = detail.camera_mm;
    let scale = eye.z / (eye.z - h);
    let [mm_x, mm_y] = detail.sample_mm;
    let (w, hh) = (band.width as f64, band.height as f64);
    // Foot of the camera, texels.
    let foot = [(eye.x / mm_x + 0.5) * w - 0.5, (0.5 - eye.y / mm_y) * hh - 0.5];
    let source = |foot: f64, i: usize| foot + (i as f64 - foot) * scale;
    taps.clear();
    taps.extend((0..columns).map(|i| cubic(source(foot[0], corner[0] + i), band.width)));
    let mut firsts = taps.iter().flatten().map(|t| t.0);
    let Some(left) = firsts.next() else { return };
    let right = firsts.next_back().unwrap_or(left) + 4;
    row.clear();
    row.resize(right - left, 0.0);
    for (j, out) in out.chunks_mut(columns).enumerate() {
        let Some((first, t)) = cubic(source(foot[1], corner[1] + j), band.height) else {
            continue;
        };
        let line = |k: usize| &band.values[(first + k) * band.width..][left..right];
        let (a, b, c, d) = (line(0), line(1), line(2), line(3));
        for ((((row, a), b), c), d) in row.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *row = t[0] * a + t[1] * b + t[2] * c + t[3] * d;
        }
        for (out, taps) in out.iter_mut().zip(&*taps) {
            if let Some((first, t)) = taps {
                let r = &row[first - left..][..4];
                *out = t[0] * r[0] + t[1] * r[1] + t[2] * r[2] + t[3] * r[3];
            }
        }
    }
}

/// First of four neighbours and their weights; `None` if one is missing.
fn cubic(at: f64, size: usize) -> Option<(usize, [f32; 4])> {
    let below = at.floor();
    if !(below >= 1.0 && below + 2.0 < size as f64) {
        return None;
    }
    let t = (at - below) as f32;
    let weights = [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (-2.5 + 1.5 * t),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t),
    ];
    Some((below as usize - 1, weights))
}

#[cfg(test)]
mod tests;
