//! Generated materials of even gloss and little relief, which textures rarely have: plaster,
//! polished stone, plastic, painted and bare metal.

use svbrdf::Svbrdf;
use svbrdf::random::Random;
use svbrdf::svbrdf::channel;

/// Kinds of generated materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Plaster,
    PolishedStone,
    Plastic,
    Metal,
}

/// Lattice cells per side of the coarsest noise, number of octaves, and ratio of their amplitudes.
const CELLS: usize = 3;
const OCTAVES: usize = 5;
const GAIN: f64 = 0.6;

/// Ranges of a kind's parameters.
struct Ranges {
    /// Number of colours, and deviation of diffuse albedos from gray, 0 to 1.
    colours: usize,
    saturation: f64,
    diffuse: [f64; 2],
    f0: [f64; 2],
    roughness: [f64; 2],
    /// RMS of each slope.
    slopes: [f64; 2],
}

impl Kind {
    pub const ALL: [Self; 4] = [Self::Plaster, Self::PolishedStone, Self::Plastic, Self::Metal];

    pub fn name(self) -> &'static str {
        match self {
            Self::Plaster => "plaster",
            Self::PolishedStone => "polished-stone",
            Self::Plastic => "plastic",
            Self::Metal => "metal",
        }
    }

    fn ranges(self) -> Ranges {
        let (colours, saturation) = match self {
            Self::Plaster => (1, 0.15),
            Self::PolishedStone => (3, 0.4),
            Self::Plastic => (2, 0.8),
            Self::Metal => (2, 0.4),
        };
        let (diffuse, f0, roughness, slopes) = match self {
            Self::Plaster => ([0.4, 0.8], [0.03, 0.05], [0.6, 0.9], [0.02, 0.12]),
            Self::PolishedStone => ([0.03, 0.5], [0.04, 0.06], [0.15, 0.35], [0.0, 0.004]),
            Self::Plastic => ([0.03, 0.6], [0.04, 0.05], [0.25, 0.5], [0.01, 0.06]),
            Self::Metal => ([0.0, 0.03], [0.35, 0.85], [0.25, 0.5], [0.0, 0.03]),
        };
        Ranges { colours, saturation, diffuse, f0, roughness, slopes }
    }
}

/// Maps of a kind, `side * side` texels.
pub fn maps(kind: Kind, side: usize, random: &mut Random) -> Svbrdf {
    let ranges = kind.ranges();
    let between =
        |random: &mut Random, [low, high]: [f64; 2]| low + (high - low) * random.uniform();
    let mut maps = Svbrdf::new(side, side);
    let veins = noise(side, random);
    // Within a colour, albedo varies slightly and gloss does not.
    let shade = noise(side, random);
    let colours: Vec<[f64; 7]> = (0..ranges.colours)
        .map(|_| {
            let (kd, f0) = (between(random, ranges.diffuse), between(random, ranges.f0));
            let mut tint = || 1.0 - ranges.saturation * random.uniform();
            let tints = [tint(), tint(), tint()];
            // Surface reflection of dielectrics is white.
            let metallic = f64::from(u8::from(kind == Kind::Metal));
            let gloss = tints.map(|t| f0 * (1.0 - metallic + metallic * t));
            let [r, g, b] = tints.map(|t| kd * t);
            [r, g, b, gloss[0], gloss[1], gloss[2], between(random, ranges.roughness)]
        })
        .collect();
    let mut order: Vec<usize> = (0..side * side).collect();
    order.sort_by(|a, b| veins[*a].total_cmp(&veins[*b]));
    for (rank, &i) in order.iter().enumerate() {
        let colour = &colours[rank * colours.len() / order.len()];
        for (c, value) in colour.iter().enumerate() {
            let shade = if c < 3 { 1.0 + 0.1 * shade[i] } else { 1.0 };
            maps.plane_mut(channel::DIFFUSE + c)[i] = (value * shade) as f32;
        }
    }
    relief(&mut maps, between(random, ranges.slopes), random);
    maps.clamp();
    maps
}

/// Adds the slopes of a noise height with a given RMS.
fn relief(maps: &mut Svbrdf, rms: f64, random: &mut Random) {
    let side = maps.width();
    let height = noise(side, random);
    let at = |x: usize, y: usize| height[y % side * side + x % side];
    let difference = |i: usize| {
        let (x, y) = (i % side, i / side);
        // rows run downwards; slopes are those of the normal
        [at(x + side - 1, y) - at(x + 1, y), at(x, y + 1) - at(x, y + side - 1)]
    };
    let slopes: Vec<[f64; 2]> = (0..side * side).map(difference).collect();
    let square: f64 = slopes.iter().flatten().map(|v| v * v).sum();
    let scale = rms / (square / (2 * side * side) as f64).sqrt().max(1e-9);
    for (c, slope) in [channel::SLOPE_X, channel::SLOPE_Y].into_iter().enumerate() {
        let plane = maps.plane_mut(slope);
        plane.iter_mut().zip(&slopes).for_each(|(v, s)| *v = (scale * s[c]) as f32);
    }
}

/// Periodic noise of several octaves, of about unit variance.
fn noise(side: usize, random: &mut Random) -> Vec<f64> {
    let mut sum = vec![0.0; side * side];
    let (mut cells, mut weight, mut square) = (CELLS, 1.0, 0.0);
    for _ in 0..OCTAVES {
        let lattice: Vec<f64> = (0..cells * cells).map(|_| random.bell()).collect();
        let axis = |k: usize| {
            let t = k as f64 / side as f64 * cells as f64;
            let f = t.fract();
            (t as usize % cells, (t as usize + 1) % cells, f * f * (3.0 - 2.0 * f))
        };
        for (i, v) in sum.iter_mut().enumerate() {
            let ((x0, x1, fx), (y0, y1, fy)) = (axis(i % side), axis(i / side));
            let row = |y: usize| {
                let row = &lattice[y * cells..][..cells];
                row[x0] + fx * (row[x1] - row[x0])
            };
            let (top, bottom) = (row(y0), row(y1));
            *v += weight * (top + fy * (bottom - top));
        }
        square += weight * weight * 0.55;
        (cells, weight) = (cells * 2, weight * GAIN);
    }
    sum.iter_mut().for_each(|v| *v /= f64::sqrt(square));
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each colour has one gloss, the sample is flat, and all values are in range.
    #[test]
    fn gloss_is_even_and_samples_are_flat() {
        for (seed, kind) in Kind::ALL.into_iter().enumerate() {
            let maps = maps(kind, 128, &mut Random::new(seed as u64));
            let ranges = kind.ranges();
            let mut gloss = maps.roughness().to_vec();
            gloss.sort_by(f32::total_cmp);
            gloss.dedup();
            assert_eq!(gloss.len(), ranges.colours, "{kind:?}");
            for slope in [channel::SLOPE_X, channel::SLOPE_Y] {
                let plane = maps.plane(slope);
                let mean = plane.iter().sum::<f32>() / plane.len() as f32;
                let square = plane.iter().map(|v| v * v).sum::<f32>() / plane.len() as f32;
                assert!(mean.abs() < 1e-4, "{kind:?}: {mean}");
                assert!(f64::from(square.sqrt()) <= 1.3 * ranges.slopes[1], "{kind:?}: {square}");
            }
            let white = maps.diffuse()[0].iter().copied().fold(0.0, f32::max);
            assert!(white <= 1.0, "{kind:?}");
        }
    }
}
