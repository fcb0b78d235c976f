//! Resamples maps.

use crate::{Svbrdf, parallel};

/// Resamples maps to `width * height` texels over the same rectangle: area means to fewer texels,
/// linear interpolation between texel centres to more. Border texels extend outwards.
///
/// # Panics
/// If a size is 0.
pub fn resized(maps: &Svbrdf, width: usize, height: usize) -> Svbrdf {
    let (w, h) = (maps.width(), maps.height());
    if (w, h) == (width, height) {
        return maps.clone();
    }
    let (columns, rows) = (taps(w, width), taps(h, height));
    let resampled = |planes: &[f32]| {
        let mut data = vec![0.0; planes.len() / (w * h) * width * height];
        let buffer = || vec![0.0f32; width * h];
        let parts = data.chunks_exact_mut(width * height).zip(planes.chunks_exact(w * h));
        parallel::parts_with(parts, buffer, |narrow, _, (out, plane)| {
            for (row, out) in plane.chunks_exact(w).zip(narrow.chunks_exact_mut(width)) {
                for (v, tap) in out.iter_mut().zip(&columns) {
                    *v = tap.iter().map(|&(i, k)| k * row[i]).sum();
                }
            }
            for (tap, out) in rows.iter().zip(out.chunks_exact_mut(width)) {
                for &(y, k) in tap {
                    for (v, s) in out.iter_mut().zip(&narrow[y * width..][..width]) {
                        *v += k * s;
                    }
                }
            }
        });
        data
    };
    maps.with_planes([width, height], resampled)
}

/// Maps of at most `longest` texels along each side, and at least `least`.
pub(super) fn at_most(maps: &Svbrdf, longest: usize, least: usize) -> Svbrdf {
    let scale = (longest as f64 / maps.width().max(maps.height()) as f64).min(1.0);
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(least);
    resized(maps, side(maps.width()), side(maps.height()))
}

/// Source texels along an axis and their weights (sum 1) for each texel of the result: triangles
/// between centres, or boxes where texels merge.
fn taps(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let step = from as f64 / to as f64;
    let last = from as i64 - 1;
    (0..to)
        .map(|i| {
            if step <= 1.0 {
                let centre = (i as f64 + 0.5) * step - 0.5;
                let low = centre.floor();
                let k = (centre - low) as f32;
                let at = |j: i64| j.clamp(0, last) as usize;
                return vec![(at(low as i64), 1.0 - k), (at(low as i64 + 1), k)];
            }
            let (start, end) = (i as f64 * step, (i + 1) as f64 * step);
            (start.floor() as usize..(end.ceil() as usize).min(from))
                .map(|j| {
                    let overlap = end.min((j + 1) as f64) - start.max(j as f64);
                    (j, (overlap / step) as f32)
                })
                .collect()
        })
        .collect()
}
