//! Photographs at a subset of texels.

use std::ops::Range;

use crate::estimate::clusters::Feature;
use crate::estimate::coordinates::clamped;
use crate::estimate::coordinates::{Coordinates, to_coordinate};
use crate::estimate::photographs::Photographs;
use crate::observation::{Observation, View};
use crate::parallel;
use crate::render::PointView;
use crate::simd::{LANES, Lanes};
use crate::svbrdf::Svbrdf;

/// One photograph at the sample's texels.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Photograph {
    /// The uncorrected view.
    pub view: View,
    /// Three planes of radiances, negative where saturated.
    pub radiance: Vec<f32>,
    pub weight: Vec<f32>,
}

/// A grid of texels with all photographs.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Sample {
    /// Texel centres, mm.
    pub places: Vec<[f64; 2]>,
    pub photographs: Vec<Photograph>,
    /// Halvings of the maps, and indices of the texels in them.
    halvings: u32,
    texels: Vec<usize>,
}

impl Sample {
    /// Photographs halved to at most `averaged` texels along the longer side, then a grid of at most `side`.
    /// Averages reduce noise; single texels keep relief.
    pub fn new(photographs: &Photographs, averaged: usize, side: usize) -> Self {
        let halvings = photographs.halvings_to(averaged);
        let observations = photographs.level(halvings);
        let (width, height) = observations.first().map_or((1, 1), |o| (o.width(), o.height()));
        let texels = grid(width, height, side);
        let photograph = |(o, view): (&Observation, &View)| Photograph {
            view: *view,
            radiance: (0..3).flat_map(|c| texels.iter().map(move |t| o.radiance(c, *t))).collect(),
            weight: texels.iter().map(|t| o.weight(*t)).collect(),
        };
        let given = photographs.given();
        let place = |t: &usize| {
            let mm = |v: &View| v.texel_mm(width, height, t % width, t / width).map(f64::from);
            given.first().map_or([0.0; 2], mm)
        };
        Self {
            places: texels.iter().map(place).collect(),
            photographs: observations.iter().zip(given).map(photograph).collect(),
            halvings,
            texels,
        }
    }

    pub fn texels(&self) -> usize {
        self.places.len()
    }

    /// Places of at most eight texels.
    #[inline(always)]
    pub(super) fn eight_places<V: Lanes>(&self, texels: Range<usize>) -> [V; 2] {
        let mut at = [[0.0; LANES]; 2];
        for (lane, place) in self.places[texels].iter().enumerate() {
            at[0][lane] = place[0] as f32;
            at[1][lane] = place[1] as f32;
        }
        [V::from_array(at[0]), V::from_array(at[1])]
    }

    /// Colours of the texels in some of the photographs, see [`colours`].
    pub fn colours(&self, which: &[usize]) -> Vec<Feature> {
        let n = self.texels();
        let seen = |i: usize, t: usize| {
            let photograph: &Photograph = &self.photographs[which[i]];
            let radiance = [0, 1, 2].map(|c| photograph.radiance[c * n + t]);
            (photograph.weight[t] > 0.0).then_some(radiance)
        };
        let views: Vec<View> = which.iter().map(|&i| self.photographs[i].view).collect();
        colours(&views, n, |t| self.places[t], seen)
    }

    /// Coordinates of maps of the photographs' size at the sample's texels.
    pub fn coordinates(&self, maps: &Svbrdf) -> Vec<Coordinates> {
        let mut small = None;
        for _ in 0..self.halvings {
            small = Some(small.as_ref().unwrap_or(maps).downsampled());
        }
        let maps = small.as_ref().unwrap_or(maps);
        let at = |t: usize, c: usize| f64::from(to_coordinate(c, maps.plane(c)[t]));
        let coordinates = |t: &usize| std::array::from_fn(|c| clamped(c, at(*t, c)));
        self.texels.iter().map(coordinates).collect()
    }
}

/// Texels of a regular grid, at most `side` along the longer side.
fn grid(width: usize, height: usize, side: usize) -> Vec<usize> {
    let stride = width.max(height).div_ceil(side.max(1));
    let (w, h) = ((width / stride).max(1), (height / stride).max(1));
    let along = |i: usize, size: usize| (i * stride + stride / 2).min(size - 1);
    (0..w * h).map(|i| along(i / w, height) * width + along(i % w, width)).collect()
}

/// Colours of texels without highlights, as roots of albedos. Each photograph gives an albedo, as if the
/// texel were diffuse and flat; the colour is the 33rd percentile. `seen` is a texel's radiance in a
/// photograph, if visible.
pub(in crate::estimate) fn colours(
    views: &[View],
    texels: usize,
    place: impl Fn(usize) -> [f64; 2] + Sync,
    seen: impl Fn(usize, usize) -> Option<[f32; 3]> + Sync,
) -> Vec<Feature> {
    let lights: Vec<PointView> = views.iter().map(PointView::new).collect();
    let mut colours = vec![[UNSEEN; 3]; texels];
    let albedos = || [const { Vec::<f64>::new() }; 3];
    parallel::parts_with(colours.chunks_mut(CHUNK), albedos, |albedos, part, colours| {
        for (colour, t) in colours.iter_mut().zip(part * CHUNK..) {
            albedos.iter_mut().for_each(Vec::clear);
            for (i, light) in lights.iter().enumerate() {
                let Some(radiance) = seen(i, t) else { continue };
                let white = light.white(place(t));
                for ((albedos, radiance), white) in albedos.iter_mut().zip(radiance).zip(white) {
                    albedos.push(f64::from(radiance.abs()) / white.max(1e-9));
                }
            }
            for (value, albedos) in colour.iter_mut().zip(albedos.iter_mut()) {
                let rank = albedos.len().saturating_sub(1) / 3;
                if rank < albedos.len() {
                    let albedo = *albedos.select_nth_unstable_by(rank, f64::total_cmp).1;
                    *value = albedo.clamp(1e-4, 1.0).sqrt() as f32;
                }
            }
        }
    });
    colours
}

/// Root albedo of texels that no photograph shows.
const UNSEEN: f32 = 0.4;
/// Texels per task.
const CHUNK: usize = 1024;
