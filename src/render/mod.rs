//! Renderings of maps, their distance to photographs, and its gradient.
//!
//! Radiance of a texel: `BRDF * NoL * E + ambient * (kd + mirrored * ks)` with `E` from
//! [`Falloff`](crate::observation::Falloff). It is not clamped at 1; saturated values of
//! photographs are marked (see [`loss`](crate::loss)). Rows are divided among rayon's threads. Sums
//! have a fixed order, so results do not depend on the number of threads.

mod gradient;
mod point;
mod prepared;

pub use gradient::{loss, loss_and_gradient};
pub(crate) use point::{PointView, Radiance};
pub(crate) use prepared::{
    BAND_ROWS, Prepared, check_observations, find_directions, load_lobes, load_texels,
};

use crate::observation::View;
use crate::parallel;
use crate::reflectance::{Directions, Lobes, Material, TexelView};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{Svbrdf, bands};

/// Renders maps into three planes (R, G, B) of `width * height` radiances.
///
/// # Panics
/// If `out` does not hold `3 * maps.texels()` values.
pub fn render(maps: &Svbrdf, view: &View, out: &mut [f32]) {
    assert_eq!(out.len(), 3 * maps.texels(), "three planes of {} texels", maps.texels());
    let view = TexelView::new(view, maps.width(), maps.height());
    parallel::parts(bands::<3, _>(out, maps.width(), maps.height(), BAND_ROWS), |band, out| {
        dispatch(RenderBand { maps, view: &view, first_row: band * BAND_ROWS, out });
    });
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
                let (at, begin) = (row * width, self.first_row * width);
                let (first, end) = (at + column, at + end);
                let lobes = load_lobes(self.maps, first, end);
                let material = Material::new(&load_texels(self.maps, first, end), lobes);
                let directions = Directions::<V>::new(self.view, column, row);
                let lobes = Lobes::new(&material, &directions);
                for c in 0..3 {
                    let (brdf, _) = lobes.brdf(&material, c);
                    let ambient = V::splat(self.view.ambient[c]) * material.diffuse[c]
                        + V::splat(self.view.mirrored[c]) * material.specular[c];
                    let radiance =
                        brdf.mul_add(lobes.irradiance * V::splat(self.view.power[c]), ambient);
                    radiance.store(&mut self.out[c][first - begin..end - begin]);
                }
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
