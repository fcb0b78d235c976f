//! Regression of slopes: bumps carried from where the photographs show them to where they do not.
//!
//! In most materials relief goes with colour (grout is low, the pile of a carpet is dark at its
//! roots), and a network's bumps are right in shape rather than in height. How strongly is each
//! material's own matter: what the solver found is regressed on slopes of the prior's mean and on
//! gradients of colour at several scales, each by one coefficient for the whole material. With the
//! solver's normal equations that is the maximum of the coefficients' marginal likelihood, all
//! texels' slopes integrated out: where photographs say nothing of a slope it does not count.

use std::ops::Range;

use nalgebra::{SMatrix, SVector};

use crate::estimate::belief::Belief;
use crate::estimate::noise::Noise;
use crate::estimate::options::NoiseOptions;
use crate::estimate::photographs::Photographs;
use crate::estimate::posterior::{At, slope_precision};
use crate::estimate::prior::Prior;
use crate::parallel;
use crate::render::check_observations;
use crate::svbrdf::channel;
use crate::{Result, Svbrdf};

/// Radii over which the maps' slopes are averaged, texels.
const SLOPE_RADII: [usize; 3] = [0, 1, 3];
/// Radii over which a colour is averaged before its gradient is taken.
const COLOUR_RADII: [usize; 4] = [0, 1, 2, 4];
/// Regressors: slopes at each radius, gradients of three colours.
const REGRESSORS: usize = SLOPE_RADII.len() + 3 * COLOUR_RADII.len();
/// Albedo that keeps logarithms of dark colours finite.
const DARK: f32 = 0.02;
/// Fraction of their own information by which coefficients are held at zero.
const RIDGE: f64 = 1e-3;
/// Rows worked on at a time.
const BAND: usize = 32;

type Coefficients = SVector<f64, REGRESSORS>;

/// Regresses slopes, and moves the prior's mean by what the regression says, and the maps with it as
/// far as the photographs leave them open.
///
/// # Errors
/// When sizes differ.
pub(crate) fn regress_slopes(
    photographs: &Photographs,
    belief: &mut Belief,
    noise: &NoiseOptions,
) -> Result<()> {
    let Belief { mean, maps, found: prior, .. } = belief;
    let observations = photographs.full();
    check_observations(mean, observations)?;
    check_observations(maps, observations)?;
    let at = At { maps, mean, prior, noise: Noise::expected(noise) };
    let known = Known { precision: slope_precision(at, observations), prior };
    let regressors = Regressors::new(mean, maps);
    let Some(coefficients) = regress(&regressors, &known, mean, maps) else { return Ok(()) };
    let width = regressors.width;
    let explained: Vec<[Vec<f32>; 2]> = parallel::map_parts(regressors.bands(), |_, band| {
        let n = band.len() * width;
        let mut sums = [vec![0.0; n], vec![0.0; n]];
        for (regressor, coefficient) in regressors.of_rows(band).iter().zip(&coefficients) {
            for (sums, regressor) in sums.iter_mut().zip(regressor) {
                sums.iter_mut().zip(regressor).for_each(|(s, v)| *s += *coefficient as f32 * v);
            }
        }
        sums
    });
    for (axis, plane) in [channel::SLOPE_X, channel::SLOPE_Y].into_iter().enumerate() {
        parallel::parts(mean.plane_mut(plane).chunks_mut(BAND * width), |band, out| {
            out.iter_mut().zip(&explained[band][axis]).for_each(|(out, v)| *out += v);
        });
        parallel::parts(maps.plane_mut(plane).chunks_mut(BAND * width), |band, out| {
            let [x, y] = &explained[band];
            for (i, out) in out.iter_mut().enumerate() {
                *out += known.left_open(band * BAND * width + i, [x[i], y[i]])[axis];
            }
        });
    }
    mean.clamp();
    maps.clamp();
    Ok(())
}

/// What the solver knows of slopes.
struct Known<'a> {
    /// Planes of xx, xy, yy, the prior's included.
    precision: Vec<f32>,
    prior: &'a Prior,
}

impl Known<'_> {
    fn prior_precision(&self) -> [f32; 2] {
        [channel::SLOPE_X, channel::SLOPE_Y].map(|c| self.prior.sigma[c].powi(-2))
    }

    /// Covariance of a texel's slopes.
    fn covariance(&self, texel: usize) -> [f32; 3] {
        let texels = self.precision.len() / 3;
        let [xx, xy, yy] = [0, 1, 2].map(|i| self.precision[i * texels + texel]);
        let scale = (xx * yy - xy * xy).max(1e-6 * xx * yy).recip();
        [yy * scale, -xy * scale, xx * scale]
    }

    /// How a texel's slopes follow when the prior's mean moves.
    fn left_open(&self, texel: usize, moved: [f32; 2]) -> [f32; 2] {
        let ([xx, xy, yy], [px, py]) = (self.covariance(texel), self.prior_precision());
        let (x, y) = (px * moved[0], py * moved[1]);
        [xx * x + xy * y, xy * x + yy * y]
    }

    /// Information of what was found beside the prior's mean: P - P C P, with the prior's
    /// precision P and the covariance C.
    fn information(&self, texel: usize) -> [f32; 3] {
        let ([xx, xy, yy], [px, py]) = (self.covariance(texel), self.prior_precision());
        [px - px * px * xx, -(px * py * xy), py - py * py * yy]
    }
}

/// Coefficients that make what was found most probable.
fn regress(
    regressors: &Regressors,
    known: &Known,
    mean: &Svbrdf,
    maps: &Svbrdf,
) -> Option<Coefficients> {
    let width = regressors.width;
    let [px, py] = known.prior_precision();
    let slopes = [channel::SLOPE_X, channel::SLOPE_Y];
    let parts: Vec<(SMatrix<f64, REGRESSORS, REGRESSORS>, Coefficients)> =
        parallel::map_parts(regressors.bands(), |_, band| {
            let (n, first) = (band.len() * width, band.start * width);
            let values = regressors.of_rows(band);
            let mut found = [vec![0.0; n], vec![0.0; n]];
            let mut information = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
            for t in 0..n {
                for ((found, c), p) in found.iter_mut().zip(slopes).zip([px, py]) {
                    found[t] = p * (maps.plane(c)[first + t] - mean.plane(c)[first + t]);
                }
                for (out, v) in information.iter_mut().zip(known.information(first + t)) {
                    out[t] = v;
                }
            }
            let (mut matrix, mut right) = (SMatrix::zeros(), Coefficients::zeros());
            let (mut wx, mut wy) = (vec![0.0; n], vec![0.0; n]);
            for i in 0..REGRESSORS {
                let [x, y] = &values[i];
                right[i] = dot(x, &found[0]) + dot(y, &found[1]);
                for t in 0..n {
                    wx[t] = information[0][t] * x[t] + information[1][t] * y[t];
                    wy[t] = information[1][t] * x[t] + information[2][t] * y[t];
                }
                for j in i..REGRESSORS {
                    let [x, y] = &values[j];
                    matrix[(j, i)] = dot(x, &wx) + dot(y, &wy);
                }
            }
            (matrix, right)
        });
    // In order: the same for any number of threads.
    let (mut matrix, mut right) = (SMatrix::zeros(), Coefficients::zeros());
    for (m, r) in &parts {
        matrix += m;
        right += r;
    }
    let least = 1e-9 * matrix.trace();
    for i in 0..REGRESSORS {
        matrix[(i, i)] += RIDGE * matrix[(i, i)] + least;
    }
    let coefficients = matrix.cholesky()?.solve(&right);
    coefficients.iter().all(|v| v.is_finite()).then_some(coefficients)
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0; 8];
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    for (a, b) in a.iter().zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    f64::from(sums.iter().sum::<f32>() + rest)
}

/// What slopes may go with: slopes of the prior's mean, gradients of the logarithm of each colour.
struct Regressors<'a> {
    width: usize,
    height: usize,
    slopes: [&'a [f32]; 2],
    colours: [Vec<f32>; 3],
}

impl<'a> Regressors<'a> {
    fn new(mean: &'a Svbrdf, maps: &Svbrdf) -> Self {
        let colour = |c: usize| {
            let plane = maps.plane(channel::DIFFUSE + c);
            parallel::values(plane.len(), |t| (plane[t] + DARK).ln())
        };
        Self {
            width: mean.width(),
            height: mean.height(),
            slopes: [mean.plane(channel::SLOPE_X), mean.plane(channel::SLOPE_Y)],
            colours: [colour(0), colour(1), colour(2)],
        }
    }

    fn bands(&self) -> impl Iterator<Item = Range<usize>> {
        let end = |first: usize| (first + BAND).min(self.height);
        (0..self.height).step_by(BAND).map(move |first| first..end(first))
    }

    /// Each regressor's x and y in some rows.
    fn of_rows(&self, rows: Range<usize>) -> Vec<[Vec<f32>; 2]> {
        let averaged = SLOPE_RADII.into_iter().map(|radius| {
            self.slopes.map(|slopes| {
                let (blurred, first) = self.blurred(slopes, rows.clone(), radius);
                blurred[(rows.start - first) * self.width..][..rows.len() * self.width].to_vec()
            })
        });
        let gradients = COLOUR_RADII
            .into_iter()
            .flat_map(|radius| self.colours.iter().map(move |colour| (colour, radius)));
        averaged
            .chain(gradients.map(|(colour, radius)| self.gradient(colour, rows.clone(), radius)))
            .collect()
    }

    /// Differences across a texel of a plane averaged, x to the right and y upwards.
    fn gradient(&self, plane: &[f32], rows: Range<usize>, radius: usize) -> [Vec<f32>; 2] {
        let width = self.width;
        // one row more on either side
        let around = rows.start.saturating_sub(1)..(rows.end + 1).min(self.height);
        let (blurred, first) = self.blurred(plane, around, radius);
        let row = |y: usize| &blurred[(y - first) * width..][..width];
        let mut out = [0, 1].map(|_| Vec::with_capacity(rows.len() * width));
        for line in rows {
            let (here, above) = (row(line), row(line.saturating_sub(1)));
            let below = row((line + 1).min(self.height - 1));
            let [x, y] = &mut out;
            x.extend(
                (0..width)
                    .map(|c| 0.5 * (here[(c + 1).min(width - 1)] - here[c.saturating_sub(1)])),
            );
            y.extend(above.iter().zip(below).map(|(above, below)| 0.5 * (above - below)));
        }
        out
    }

    /// Means of means over `radius` texels to each side, right in these rows; and the row that the
    /// result begins with.
    fn blurred(&self, plane: &[f32], rows: Range<usize>, radius: usize) -> (Vec<f32>, usize) {
        let first = rows.start.saturating_sub(2 * radius);
        let end = (rows.end + 2 * radius).min(self.height);
        let mut values = plane[first * self.width..end * self.width].to_vec();
        if radius > 0 {
            let mut other = vec![0.0; values.len()];
            for _ in 0..2 {
                means_along_rows(&values, &mut other, self.width, radius);
                means_of_rows(&other, &mut values, self.width, radius);
            }
        }
        (values, first)
    }
}

fn window(i: usize, n: usize, radius: usize) -> Range<usize> {
    i.saturating_sub(radius)..(i + radius + 1).min(n)
}

fn means_along_rows(values: &[f32], out: &mut [f32], width: usize, radius: usize) {
    for (row, out) in values.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
        for (i, out) in out.iter_mut().enumerate() {
            let near = &row[window(i, width, radius)];
            *out = near.iter().sum::<f32>() / near.len() as f32;
        }
    }
}

fn means_of_rows(values: &[f32], out: &mut [f32], width: usize, radius: usize) {
    let height = values.len() / width;
    for (i, out) in out.chunks_exact_mut(width).enumerate() {
        let near = window(i, height, radius);
        let scale = (near.len() as f32).recip();
        out.fill(0.0);
        for row in near {
            let row = &values[row * width..][..width];
            out.iter_mut().zip(row).for_each(|(out, v)| *out += scale * v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::options::EstimateOptions;
    use crate::estimate::solver::solve;
    use crate::estimate::updates::pooling::tests::photograph;
    use crate::observation::Observation;
    use crate::random::Random;

    const SIDE: usize = 64;

    /// Relief that goes with colour, or not.
    fn truth(goes_with_colour: bool) -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        let height = |t: usize, turned: bool| {
            let (x, y) = ((t % SIDE) as f32, (t / SIDE) as f32);
            let (x, y) = if turned { (y, -x) } else { (x, y) };
            (0.5 * x + 0.2 * y).sin() + (0.15 * x - 0.4 * y).sin()
        };
        for t in 0..SIDE * SIDE {
            let shade = 0.25 * (0.3 * height(t, false)).exp();
            for c in 0..3 {
                maps.plane_mut(channel::DIFFUSE + c)[t] = shade;
            }
            maps.plane_mut(channel::ROUGHNESS)[t] = 0.6;
            if t % SIDE > 0 && t % SIDE < SIDE - 1 && t / SIDE > 0 && t / SIDE < SIDE - 1 {
                let h = |t: usize| height(t, !goes_with_colour);
                maps.plane_mut(channel::SLOPE_X)[t] = 0.15 * (h(t - 1) - h(t + 1));
                maps.plane_mut(channel::SLOPE_Y)[t] = 0.15 * (h(t + SIDE) - h(t - SIDE));
            }
        }
        maps
    }

    /// The belief after a regression.
    fn regressed(
        mean: Svbrdf,
        maps: Svbrdf,
        found: Prior,
        photographs: Vec<Observation>,
    ) -> Belief {
        let mut all = Photographs::new();
        photographs.into_iter().for_each(|o| all.add(o).unwrap());
        let mut belief = Belief { maps, found, ..Belief::new(mean, &EstimateOptions::default()) };
        let noise = NoiseOptions::default();
        regress_slopes(&all, &mut belief, &noise).unwrap();
        belief
    }

    /// Error of slopes before and after, of a flat estimate.
    fn errors(truth: &Svbrdf, photographs: &[[f32; 2]]) -> [f32; 2] {
        let observations: Vec<_> = photographs.iter().map(|&at| photograph(truth, at)).collect();
        let mut mean = truth.clone();
        for plane in [channel::SLOPE_X, channel::SLOPE_Y] {
            mean.plane_mut(plane).fill(0.0);
        }
        let mut maps = mean.clone();
        let options = &NoiseOptions::default();
        let prior = Prior::default();
        let summary = solve(&mut maps, &mean, &prior, &observations, 8, options).unwrap();
        let before = error(&maps, truth);
        let belief = regressed(mean, maps, summary.prior, observations);
        [before, error(&belief.maps, truth)]
    }

    fn error(maps: &Svbrdf, truth: &Svbrdf) -> f32 {
        let of = |plane: usize| {
            let pairs = maps.plane(plane).iter().zip(truth.plane(plane));
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>()
        };
        let squares = of(channel::SLOPE_X) + of(channel::SLOPE_Y);
        (squares / maps.texels() as f32).sqrt()
    }

    const PHOTOGRAPHS: [[f32; 2]; 2] = [[0.0, 0.0], [80.0, 20.0]];

    #[test]
    fn relief_that_goes_with_colour_is_found_by_it() {
        let [before, after] = errors(&truth(true), &PHOTOGRAPHS);
        assert!(after < 0.5 * before, "{before} {after}");
    }

    #[test]
    fn relief_that_does_not_is_left() {
        let [before, after] = errors(&truth(false), &PHOTOGRAPHS);
        assert!(after < 1.02 * before, "{before} {after}");
    }

    #[test]
    fn what_no_photograph_shows_tells_nothing() {
        let truth = truth(true);
        let unseen = photograph(&truth, [0.0; 2]).changed(|_, weight| weight.fill(0.0));
        let mut mean = truth.clone();
        let mut random = Random::new(3);
        for v in mean.plane_mut(channel::SLOPE_X) {
            *v = random.uniform() as f32 - 0.5;
        }
        let before = mean.clone();
        let belief = regressed(mean.clone(), mean, Prior::default(), vec![unseen]);
        for maps in [&belief.mean, &belief.maps] {
            assert!(error(maps, &before) < 1e-4, "{}", error(maps, &before));
        }
    }

    #[test]
    fn bands_join_without_a_seam() {
        let maps = truth(true);
        let regressors = Regressors::new(&maps, &maps);
        let width = regressors.width;
        let plane = maps.plane(channel::SLOPE_X);
        let (all, first) = regressors.blurred(plane, 0..SIDE, 4);
        assert_eq!((all.len(), first), (plane.len(), 0));
        let (some, first) = regressors.blurred(plane, 20..30, 4);
        for y in 20..30 {
            for x in 0..width {
                let (a, b) = (all[y * width + x], some[(y - first) * width + x]);
                assert!((a - b).abs() < 1e-6, "{x} {y}: {a} {b}");
            }
        }
        // a mean of means of the middle of a ramp is the middle
        let ramp: Vec<f32> = (0..SIDE * SIDE).map(|t| (t % SIDE) as f32).collect();
        let (ramp, _) = regressors.blurred(&ramp, 0..SIDE, 4);
        assert!((ramp[5 * width + 30] - 30.0).abs() < 1e-4);
    }

    #[test]
    fn coefficients_are_those_of_the_whole_likelihood() {
        // One texel's marginal likelihood of what was found, by the definition: found - mean is
        // normal with the prior's covariance less the posterior's.
        let prior = Prior::default();
        let known = Known { precision: vec![180.0, 35.0, 140.0], prior: &prior };
        let [px, py] = known.prior_precision();
        let data = nalgebra::Matrix2::new(180.0 - px, 35.0, 35.0, 140.0 - py);
        let wide = nalgebra::Matrix2::new(1.0 / px, 0.0, 0.0, 1.0 / py);
        let expected = (data.try_inverse().unwrap() + wide).try_inverse().unwrap();
        let [xx, xy, yy] = known.information(0);
        for (a, b) in [(xx, expected.m11), (xy, expected.m12), (yy, expected.m22)] {
            assert!((a - b).abs() < 1e-3 * expected.m11, "{a} {b}");
        }
    }
}
