//! Ambient occlusion from height.

use std::f32::consts::{FRAC_PI_2, PI};

use super::height::{Height, texel_mm};
use crate::{Error, Result, Svbrdf, parallel};

/// Slices through a texel, each in both directions.
const SLICES: usize = 8;

/// Distances of the horizon samples of a slice, texels.
const DISTANCES: [f32; 9] = [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0, 27.0, 40.0];

/// Share of uniform ambient light that reaches each texel, 0 to 1: the cosine-weighted sky above
/// the horizon within 40 texels, in closed form per slice (Jimenez et al., *Practical Real-Time
/// Strategies for Accurate Indirect Occlusion*, 2016).
///
/// # Errors
/// [`Error::Argument`] if the size of the sample is not positive or the height is of other maps.
pub fn occlusion(
    maps: &Svbrdf,
    height: &Height,
    sample_mm: [f32; 2],
    periodic: bool,
) -> Result<Vec<f32>> {
    let (w, h) = (maps.width(), maps.height());
    let spacing = texel_mm(maps, sample_mm)?;
    if height.mm.len() != w * h {
        let message = format!("{} values given, {w} * {h} expected", height.mm.len());
        return Err(Error::argument("height", message));
    }
    let surface = Surface { mm: &height.mm, width: w, height: h, periodic };
    let slices: Vec<Slice> = (0..SLICES).map(|k| Slice::new(k, spacing)).collect();
    let [p, q] = maps.normal_slopes();
    let mut out = vec![0.0; w * h];
    // Branch-free loops over the texels of a row vectorise.
    let rows = || [(); 3].map(|()| vec![0.0; w]);
    parallel::parts_with(out.chunks_mut(w), rows, |[lean, ahead, behind], y, row| {
        let (p, q) = (&p[y * w..][..w], &q[y * w..][..w]);
        for slice in &slices {
            for x in 0..w {
                lean[x] = p[x] * slice.direction[0] + q[x] * slice.direction[1];
                // The tangent plane is the lowest horizon.
                (ahead[x], behind[x]) = (-lean[x], lean[x]);
            }
            slice.raise(ahead, &surface, y, 1);
            slice.raise(behind, &surface, y, -1);
            for x in 0..w {
                row[x] += open_part(lean[x], ahead[x], behind[x]);
            }
        }
        for x in 0..w {
            let up = (1.0 + p[x] * p[x] + q[x] * q[x]).sqrt().recip();
            row[x] = (row[x] * up / SLICES as f32).clamp(0.0, 1.0);
        }
    });
    Ok(out)
}

/// Light between two horizons of one slice relative to an open sky over a level texel, times the
/// normal's length in the slice over its height. `lean`: tangent of the normal's angle towards the
/// direction; `ahead`, `behind`: tangents of the horizons' elevations.
fn open_part(lean: f32, ahead: f32, behind: f32) -> f32 {
    // cos(2a + c) and similar terms from tangents; c is the angle of the lean, 1 / cos c the
    // projected length.
    let double = |t: f32| {
        let k = (1.0 + t * t).recip();
        ((1.0 - t * t) * k, 2.0 * t * k)
    };
    let ((cos_a, sin_a), (cos_b, sin_b)) = (double(ahead), double(behind));
    let first = cos_a - lean * sin_a + 1.0 + (PI - 2.0 * arctangent(ahead)) * lean;
    let second = cos_b + lean * sin_b + 1.0 - (PI - 2.0 * arctangent(behind)) * lean;
    0.25 * (first + second)
}

/// The arctangent within 3e-7, without branches (Abramowitz and Stegun, 4.4.49).
fn arctangent(t: f32) -> f32 {
    const COEFFICIENTS: [f32; 8] = [
        -0.016_165_737,
        0.042_909_614,
        -0.075_289_64,
        0.106_562_64,
        -0.142_089,
        0.199_935_51,
        -0.333_331_45,
        1.0,
    ];
    let steep = t.abs() > 1.0;
    let x = if steep { t.abs().recip() } else { t.abs() };
    let square = x * x;
    let series = COEFFICIENTS.into_iter().fold(0.002_866_225_7, |sum, c| sum * square + c);
    let angle = if steep { FRAC_PI_2 - x * series } else { x * series };
    angle.copysign(t)
}

/// Heights, mm, row by row.
struct Surface<'a> {
    mm: &'a [f32],
    width: usize,
    height: usize,
    /// Whether it repeats beyond the borders.
    periodic: bool,
}

impl Surface<'_> {
    fn row(&self, y: usize) -> &[f32] {
        &self.mm[y * self.width..][..self.width]
    }

    /// The row `rows` below row `y`; `None` outside.
    fn row_from(&self, y: usize, rows: isize) -> Option<&[f32]> {
        let at = y as isize + rows;
        let at = if self.periodic { at.rem_euclid(self.height as isize) } else { at };
        let at = usize::try_from(at).ok().filter(|&at| at < self.height);
        at.map(|at| self.row(at))
    }
}

/// A direction and its samples.
struct Slice {
    /// Unit vector, X right, Y up.
    direction: [f32; 2],
    /// Columns, rows (downwards) and distance in mm.
    steps: [(isize, isize, f32); DISTANCES.len()],
}

impl Slice {
    fn new(k: usize, spacing: [f32; 2]) -> Self {
        let angle = PI * (k as f32 + 0.5) / SLICES as f32;
        let unit = spacing[0].min(spacing[1]);
        let steps = DISTANCES.map(|d| {
            let dx = (d * unit * angle.cos() / spacing[0]).round();
            let dy = (d * unit * angle.sin() / spacing[1]).round();
            (dx as isize, -dy as isize, (dx * spacing[0]).hypot(dy * spacing[1]))
        });
        Self { direction: [angle.cos(), angle.sin()], steps }
    }

    /// Raises the tangents of the horizon's elevation of a row by the samples on one side.
    fn raise(&self, horizon: &mut [f32], surface: &Surface, y: usize, side: isize) {
        let (w, here) = (surface.width, surface.row(y));
        for &(dx, dy, distance) in &self.steps {
            let Some(there) = surface.row_from(y, side * dy) else { break };
            let (columns, per_mm) = (side * dx, distance.recip());
            let mut raise = |from: usize, to: usize, count: usize| {
                let pairs = here[from..][..count].iter().zip(&there[to..][..count]);
                for (horizon, (here, there)) in horizon[from..][..count].iter_mut().zip(pairs) {
                    *horizon = horizon.max((there - here) * per_mm);
                }
            };
            if surface.periodic {
                let shift = columns.rem_euclid(w as isize) as usize;
                raise(0, shift, w - shift);
                raise(w - shift, 0, shift);
            } else {
                let shift = columns.unsigned_abs().min(w);
                let (from, to) = if columns > 0 { (0, shift) } else { (shift, 0) };
                raise(from, to, w - shift);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arctangents_are_those_of_the_standard_library() {
        for i in -4000..=4000 {
            let t = (0.004 * i as f32).sinh();
            assert!((arctangent(t) - t.atan()).abs() < 3e-7, "{t}");
        }
    }

    /// In the middle of an endless trench of width `w` and depth `d`, the visible sky is the form
    /// factor of the opening: `(w / 2) / hypot(w / 2, d)`. Planes, level or tilted, see all of it.
    #[test]
    fn occlusion_is_the_form_factor_of_what_is_open() {
        let n = 96;
        let open = |maps: &Svbrdf, mm: Vec<f32>, periodic: bool| {
            let height = Height { mm, unexplained: 0.0 };
            occlusion(maps, &height, [n as f32; 2], periodic).unwrap()[n / 2 * n + n / 2]
        };
        let flat = Svbrdf::new(n, n);
        assert!((open(&flat, vec![0.0; n * n], true) - 1.0).abs() < 1e-5);
        let mut tilted = Svbrdf::new(n, n);
        tilted.normal_slopes_mut()[0].fill(-0.5);
        let ramp = (0..n * n).map(|i| 0.5 * (i % n) as f32).collect();
        // Tolerance for sixteen directions.
        assert!((open(&tilted, ramp, false) - 1.0).abs() < 0.02);
        for (width, depth) in [(6usize, 3.0f32), (6, 6.0), (10, 5.0)] {
            let wall = |i: usize| (i % n).abs_diff(n / 2) >= width / 2;
            let mm = (0..n * n).map(|i| if wall(i) { depth } else { 0.0 }).collect();
            let half = 0.5 * width as f32;
            let expected = half / half.hypot(depth);
            let found = open(&flat, mm, true);
            // Nine sample distances place walls slightly too far away.
            assert!((found - expected).abs() < 0.06, "{width} {depth}: {found} for {expected}");
        }
    }

    #[test]
    fn heights_of_other_maps_are_refused() {
        let height = Height { mm: vec![0.0; 3], unexplained: 0.0 };
        let fault = occlusion(&Svbrdf::new(8, 8), &height, [1.0; 2], false).unwrap_err();
        assert!(fault.to_string().contains("3 values given, 8 * 8 expected"), "{fault}");
    }
}
