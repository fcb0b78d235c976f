//! Two visible faults of maps that rendering errors hardly reveal: tilt of the sample, and
//! highlights baked into the gloss.

use std::ops::AddAssign;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use svbrdf::Svbrdf;
use svbrdf::export::resized;

use super::colours::{CLASSES, classes};
use super::regression::{Basis, explained};
use crate::statistics::median;

/// Texels per side, and blocks per side whose means are tested for highlights.
const SIDE: usize = 256;
const BLOCKS: usize = 16;
/// Parts per side whose normals are compared.
const PARTS: usize = 4;
/// Lower limit of F0, whose smaller values look alike but differ in their logarithm.
const LEAST_F0: f64 = 0.01;
/// Strength of a highlight: the cosine between half vector and +Z to this power, a standard
/// deviation of 7 degrees.
const POWER: f64 = 64.0;
/// A weaker highlight over the whole sample counts as none.
const LEAST_HIGHLIGHT: f64 = 0.01;

/// Camera and light of a photograph, mm.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub camera: DVec3,
    pub light: DVec3,
}

/// Faults of maps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Artifacts {
    /// Angle between the mean normal and the true one, degrees.
    pub tilt: f64,
    /// The largest such angle of 4 x 4 parts.
    pub tilt_of_parts: f64,
    /// Standard deviation of the part of the error of log F0 that the photographs' highlights
    /// explain beyond colour.
    pub baked_f0: f64,
    /// The same for roughness.
    pub baked_roughness: f64,
}

impl AddAssign for Artifacts {
    fn add_assign(&mut self, other: Self) {
        let numbers = self.numbers_mut();
        numbers.into_iter().zip(other.numbers()).for_each(|(sum, v)| *sum += v);
    }
}

impl Artifacts {
    /// Names of [`Artifacts::numbers`].
    pub const NAMES: [&str; 4] = ["tilt", "tilt of parts", "baked log F0", "baked roughness"];

    /// Values in the order of the fields.
    pub fn numbers(&self) -> [f64; 4] {
        [self.tilt, self.tilt_of_parts, self.baked_f0, self.baked_roughness]
    }

    fn numbers_mut(&mut self) -> [&mut f64; 4] {
        [&mut self.tilt, &mut self.tilt_of_parts, &mut self.baked_f0, &mut self.baked_roughness]
    }

    /// Mean; zeros without values.
    pub fn mean(all: impl Iterator<Item = Self>) -> Self {
        let (mut mean, mut count) = (Self::default(), 0.0);
        for artifacts in all {
            mean += artifacts;
            count += 1.0;
        }
        mean.numbers_mut().into_iter().for_each(|v| *v /= f64::max(count, 1.0));
        mean
    }

    /// Artifacts of maps fitted to photographs from some positions, compared with the true maps.
    /// Without true maps the sample counts as flat, and the gloss of each colour as even.
    pub fn of(
        maps: &Svbrdf,
        truth: Option<&Svbrdf>,
        sample_mm: [f32; 2],
        places: &[Place],
    ) -> Self {
        let maps = resized(maps, SIDE, SIDE);
        let truth = truth.map(|truth| resized(truth, SIDE, SIDE));
        let [tilt, tilt_of_parts] = [1, PARTS].map(|parts| tilt(&maps, truth.as_ref(), parts));
        let diffuse = [0, 1, 2].map(|c| truth.as_ref().unwrap_or(&maps).diffuse()[c]);
        let classes = classes(diffuse);
        let highlights = Highlights::new(&classes, sample_mm, places);
        let error = |value: fn(&Svbrdf, usize) -> f64| -> Vec<f64> {
            let all = |maps: &Svbrdf| (0..SIDE * SIDE).map(|i| value(maps, i)).collect::<Vec<_>>();
            let found = all(&maps);
            let expected = match &truth {
                Some(truth) => all(truth),
                None => medians(&classes, &found),
            };
            found.iter().zip(expected).map(|(found, expected)| found - expected).collect()
        };
        Self {
            tilt,
            tilt_of_parts,
            baked_f0: highlights.baked(&error(log_f0)),
            baked_roughness: highlights.baked(&error(roughness)),
        }
    }
}

fn log_f0(maps: &Svbrdf, texel: usize) -> f64 {
    let sum: f32 = (0..3).map(|c| maps.specular()[c][texel]).sum();
    (f64::from(sum) / 3.0).max(LEAST_F0).ln()
}

fn roughness(maps: &Svbrdf, texel: usize) -> f64 {
    maps.roughness()[texel].into()
}

/// Largest angle between the mean normals of `parts * parts` pieces of the maps and of the truth (or +Z).
fn tilt(maps: &Svbrdf, truth: Option<&Svbrdf>, parts: usize) -> f64 {
    let size = SIDE / parts;
    let mean = |maps: &Svbrdf, part: usize| -> DVec3 {
        let (left, top) = (part % parts * size, part / parts * size);
        let texels = (0..size * size).map(|i| (left + i % size, top + i / size));
        texels.map(|(x, y)| glam::Vec3::from(maps.normal(x, y)).as_dvec3()).sum()
    };
    let angle = |part: usize| {
        let expected = truth.map_or(DVec3::Z, |truth| mean(truth, part));
        mean(maps, part).angle_between(expected).to_degrees()
    };
    (0..parts * parts).map(angle).fold(0.0, f64::max)
}

/// Median of each texel's class.
fn medians(classes: &[usize], values: &[f64]) -> Vec<f64> {
    let of_class = |class: usize| {
        let own = classes.iter().zip(values).filter(|(c, _)| **c == class).map(|(_, v)| *v);
        median(own).unwrap_or_default()
    };
    let medians: Vec<f64> = (0..CLASSES).map(of_class).collect();
    classes.iter().map(|class| medians[*class]).collect()
}

/// Means of blocks.
fn reduced(texel: impl Fn(usize) -> f64) -> Vec<f64> {
    let size = SIDE / BLOCKS;
    let mut sums = vec![0.0; BLOCKS * BLOCKS];
    for i in 0..SIDE * SIDE {
        sums[i / SIDE / size * BLOCKS + i % SIDE / size] += texel(i) / (size * size) as f64;
    }
    sums
}

/// Strengths of the highlights, with the part explained by colour removed.
struct Highlights {
    columns: Vec<Vec<f64>>,
}

impl Highlights {
    fn new(classes: &[usize], sample_mm: [f32; 2], places: &[Place]) -> Self {
        let mut colours = Basis::default();
        colours.add(vec![1.0; BLOCKS * BLOCKS]);
        for class in 0..CLASSES {
            colours.add(reduced(|i| f64::from(u8::from(classes[i] == class))));
        }
        let mut all = Basis::default();
        let mut columns = Vec::new();
        for place in places {
            let strength = strength(sample_mm, place);
            if strength.iter().any(|v| *v > LEAST_HIGHLIGHT) {
                columns.extend(all.add(colours.rest(strength)).map(<[f64]>::to_vec));
            }
        }
        Self { columns }
    }

    /// Standard deviation of the part of an error map that the highlights explain.
    fn baked(&self, error: &[f64]) -> f64 {
        explained(&self.columns, &reduced(|i| error[i])).sqrt()
    }
}

/// Strength of a photograph's highlight at the centre of every block.
fn strength(sample_mm: [f32; 2], place: &Place) -> Vec<f64> {
    let [width, height] = sample_mm.map(f64::from);
    let part = |i: usize| (i as f64 + 0.5) / BLOCKS as f64 - 0.5;
    let cosine = |i: usize| {
        let point = DVec3::new(width * part(i % BLOCKS), -height * part(i / BLOCKS), 0.0);
        let to = |from: DVec3| (from - point).normalize();
        (to(place.camera) + to(place.light)).normalize().z.max(0.0).powf(POWER)
    };
    (0..BLOCKS * BLOCKS).map(cosine).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use svbrdf::random::Random;

    const SAMPLE: [f32; 2] = [100.0; 2];

    fn places() -> Vec<Place> {
        let eyes = [(0.0, 5.0), (70.0, 40.0), (-80.0, 60.0), (-20.0, -90.0), (100.0, -50.0)];
        let place = |(x, y)| {
            let camera = DVec3::new(x, y, 240.0);
            Place { camera, light: camera + DVec3::new(8.0, -5.0, 0.0) }
        };
        eyes.map(place).to_vec()
    }

    /// Two colours with different gloss, and texels that vary by a tenth.
    fn maps() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        let mut random = Random::new(5);
        for i in 0..SIDE * SIDE {
            let dark = (i % SIDE / 40 + i / SIDE / 40).is_multiple_of(2);
            let stray = 1.0 + 0.1 * random.bell() as f32;
            for c in 0..3 {
                maps.diffuse_mut()[c][i] = if dark { 0.1 } else { 0.4 };
                maps.specular_mut()[c][i] = stray * if dark { 0.08 } else { 0.04 };
            }
            maps.roughness_mut()[i] = stray * if dark { 0.3 } else { 0.5 };
        }
        maps
    }

    /// Slopes of tan 5° tilt by 5 degrees; those of one part tilt only that part.
    #[test]
    fn leaning_maps_are_tilted() {
        let truth = maps();
        let tilted = |texels: fn(usize) -> bool| {
            let mut maps = truth.clone();
            let slope = 5f32.to_radians().tan();
            let [plane, _] = maps.normal_slopes_mut();
            (0..SIDE * SIDE).filter(|i| texels(*i)).for_each(|i| plane[i] += slope);
            [Some(&truth), None].map(|t| Artifacts::of(&maps, t, SAMPLE, &places()))
        };
        for artifacts in tilted(|_| true) {
            assert!((artifacts.tilt - 5.0).abs() < 1e-3, "{artifacts:?}");
        }
        for artifacts in tilted(|i| i % SIDE < 64 && i / SIDE < 64) {
            assert!((artifacts.tilt_of_parts - 5.0).abs() < 1e-3, "{artifacts:?}");
            assert!((artifacts.tilt - 5.0 / 16.0).abs() < 0.01, "{artifacts:?}");
        }
    }

    /// A highlight that raised F0 and lowered roughness is detected in both; gloss that varies with
    /// colour and random texels are not.
    #[test]
    fn highlights_in_the_gloss_are_baked() {
        let truth = maps();
        for against in [Some(&truth), None] {
            let clean = Artifacts::of(&maps(), against, SAMPLE, &places());
            assert!(clean.baked_f0 < 0.005 && clean.baked_roughness < 0.003, "{clean:?}");
            let mut maps = maps();
            let camera = places()[1].camera;
            let mut square = 0.0;
            for i in 0..SIDE * SIDE {
                let part = |i: usize| 100.0 * ((i as f64 + 0.5) / SIDE as f64 - 0.5);
                let point = DVec3::new(part(i % SIDE), -part(i / SIDE), 0.0);
                let bump = 0.4 * (camera - point).normalize().z.powi(60);
                square += (bump - 0.1f64).powi(2) / (SIDE * SIDE) as f64;
                for c in 0..3 {
                    maps.specular_mut()[c][i] *= bump.exp() as f32;
                }
                maps.roughness_mut()[i] -= 0.3 * bump as f32;
            }
            let found = Artifacts::of(&maps, against, SAMPLE, &places());
            let about = square.sqrt();
            assert!((0.5..1.1).contains(&(found.baked_f0 / about)), "{found:?} {about}");
            assert!((0.15..0.33).contains(&(found.baked_roughness / about)), "{found:?} {about}");
        }
    }

    /// Five highlights explain less than half of an unrelated smooth error of 0.2.
    #[test]
    fn errors_elsewhere_are_not_baked() {
        let truth = maps();
        let mut maps = maps();
        let mut random = Random::new(8);
        let waves: Vec<[f64; 3]> = (0..12)
            .map(|_| [3.0 * random.bell(), 3.0 * random.bell(), 6.3 * random.uniform()])
            .collect();
        for i in 0..SIDE * SIDE {
            let (x, y) = ((i % SIDE) as f64 / SIDE as f64, (i / SIDE) as f64 / SIDE as f64);
            let wave = |w: &[f64; 3]| (6.3 * (w[0] * x + w[1] * y) + w[2]).sin();
            let error = waves.iter().map(wave).sum::<f64>() / 6f64.sqrt();
            for c in 0..3 {
                maps.specular_mut()[c][i] *= (0.2 * error).exp() as f32;
            }
        }
        let found = Artifacts::of(&maps, Some(&truth), SAMPLE, &places());
        assert!(found.baked_f0 < 0.1, "{found:?}");
    }
}
