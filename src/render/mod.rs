//! Renderings of maps, their distance to photographs, and the gradient of that distance.
//!
//! Radiance of a texel: `BRDF * NoL * E + ambient * (kd + mirrored * ks)`, with `E` from
//! [`Falloff`](crate::observation::Falloff), not clamped at 1: a photograph's saturation is a mark on
//! its values, see [`loss`](crate::loss). Rows are shared among rayon's threads; sums are formed in
//! the same order for any number of them, so results do not depend on it.

mod gradient;

pub use gradient::{loss, loss_and_gradient};

use crate::observation::{FULL_WEIGHT, Observation, Packed, View};
use crate::parallel;
use crate::reflectance::{Directions, Lobes, Material, TexelView};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, Svbrdf, bands};
use crate::{Error, Result};
use std::ops::Range;

/// Rows that one task works on.
pub(crate) const BAND_ROWS: usize = 4;

/// Renders maps into three planes (R, G, B) of `width * height` radiances.
///
/// # Panics
/// When `out` does not hold `3 * maps.texels()` values.
pub fn render(maps: &Svbrdf, view: &View, out: &mut [f32]) {
    assert_eq!(out.len(), 3 * maps.texels(), "three planes of {} texels", maps.texels());
    let view = TexelView::new(view, maps.width(), maps.height());
    parallel::parts(bands::<3, _>(out, maps.width(), maps.height(), BAND_ROWS), |band, out| {
        dispatch(RenderBand { maps, view: &view, first_row: band * BAND_ROWS, out });
    });
}

/// An error where an observation has not the maps' size.
pub(crate) fn check_observations(maps: &Svbrdf, observations: &[Observation]) -> Result<()> {
    let (width, height) = (maps.width(), maps.height());
    for o in observations {
        if (o.width(), o.height()) != (width, height) {
            let message = format!("{}x{} texels, expected {width}x{height}", o.width(), o.height());
            return Err(Error::argument("observations", message));
        }
    }
    Ok(())
}

/// Observations with their views prepared for one size of maps.
pub(crate) struct Prepared<'a> {
    pub view: TexelView,
    packed: [&'a [Packed]; 3],
}

impl<'a> Prepared<'a> {
    /// # Panics
    /// When an observation has not the maps' size.
    pub fn new(maps: &Svbrdf, observations: &'a [Observation]) -> Vec<Self> {
        let n = maps.texels();
        observations
            .iter()
            .map(|o| {
                assert_eq!(
                    (o.width(), o.height()),
                    (maps.width(), maps.height()),
                    "an observation must have the maps' size"
                );
                Self {
                    view: TexelView::new(&o.view, o.width(), o.height()),
                    packed: std::array::from_fn(|c| &o.packed()[c * n..(c + 1) * n]),
                }
            })
            .collect()
    }

    /// Weights of some texels, at most eight.
    #[inline(always)]
    pub fn load_weight<V: Lanes>(&self, texels: &Range<usize>) -> V {
        let lacks = V::load_lowest(self.packed.map(|plane| &plane[texels.clone()]));
        let full = f32::from(FULL_WEIGHT);
        (V::splat(full) - lacks) * V::splat(1.0 / full)
    }

    /// Radiances of some texels, at most eight.
    #[inline(always)]
    pub fn load_radiance<V: Lanes>(&self, c: usize, texels: &Range<usize>) -> V {
        V::load_halves(&self.packed[c][texels.clone()])
    }
}

/// Directions of eight texels in every photograph. They are found before anything else of these
/// texels: roots and divisions of several photographs then overlap, where a photograph after the
/// other is one chain longer than processors look ahead.
#[inline(always)]
pub(crate) fn find_directions<V: Lanes>(
    observations: &[Prepared],
    column: usize,
    row: usize,
    out: &mut [Directions<V>],
) {
    for (out, observation) in out.iter_mut().zip(observations) {
        *out = Directions::new(&observation.view, column, row);
    }
}

/// Loads the parameters of eight texels from `first` on; `end` is the end of their row.
#[inline(always)]
pub(crate) fn load_texels<V: Lanes>(maps: &Svbrdf, first: usize, end: usize) -> [V; CHANNELS] {
    let (n, planes) = (maps.texels(), maps.planes());
    let mut parameters = [V::splat(0.0); CHANNELS];
    for (c, p) in parameters.iter_mut().enumerate() {
        *p = V::load(&planes[c * n + first..c * n + end], 0.0);
    }
    parameters
}

struct RenderBand<'a> {
    maps: &'a Svbrdf,
    view: &'a TexelView,
    first_row: usize,
    out: [&'a mut [f32]; 3],
}

impl Kernel for RenderBand<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let width = self.maps.width();
        for r in 0..self.out[0].len() / width {
            let row = self.first_row + r;
            for column in (0..width).step_by(LANES) {
                let end = (column + LANES).min(width);
                let at = row * width;
                let material = Material::new(&load_texels(self.maps, at + column, at + end));
                let directions = Directions::<V>::new(self.view, column, row);
                let lobes = Lobes::new(&material, &directions);
                for c in 0..3 {
                    let (brdf, _) = lobes.brdf(&material, c);
                    let ambient = V::splat(self.view.ambient[c]) * material.diffuse[c]
                        + V::splat(self.view.mirrored[c]) * material.specular[c];
                    let radiance =
                        brdf.mul_add(lobes.irradiance * V::splat(self.view.power[c]), ambient);
                    radiance.store(&mut self.out[c][r * width + column..r * width + end]);
                }
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
