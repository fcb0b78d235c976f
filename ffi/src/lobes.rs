//! Optional lobes in the terms of glTF's `KHR_materials_anisotropy`, `KHR_materials_clearcoat` and
//! `KHR_materials_sheen`, texel by texel. The Python module and the web page compile this file as well.

use engine::Svbrdf;
use engine::svbrdf::{Anisotropy, lobe};

/// Which optional lobes a material shows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shown {
    /// Mean angle of the directions of anisotropy.
    pub anisotropy: Option<f32>,
    pub coat: bool,
    pub sheen: bool,
}

impl Shown {
    /// A lobe is shown where it is there at any texel.
    pub(crate) fn of(maps: &Svbrdf) -> Self {
        let sum = |plane: &[f32]| plane.iter().map(|v| f64::from(*v)).sum::<f64>();
        let mean = |[x, y]: [&[f32]; 2]| 0.5 * sum(y).atan2(sum(x)) as f32;
        let [coat, sheen] = [maps.coat().is_some(), maps.sheen().is_some()];
        Self { anisotropy: maps.anisotropy().map(mean), coat, sheen }
    }
}

/// A lobe's plane at a texel, 0 where there is none.
fn part(maps: &Svbrdf, lobe: usize, texel: usize) -> f32 {
    maps.lobe(lobe).map_or(0.0, |plane| plane[texel])
}

fn parameters(maps: &Svbrdf, texel: usize) -> [f32; 2] {
    [lobe::ANISOTROPY_X, lobe::ANISOTROPY_Y].map(|lobe| part(maps, lobe, texel))
}

/// Roughness of a texel, that of the smaller alpha.
pub(crate) fn roughness(maps: &Svbrdf, texel: usize) -> f32 {
    let roughness = maps.roughness()[texel];
    match parameters(maps, texel) {
        [0.0, 0.0] => roughness,
        anisotropy => Anisotropy::new(roughness, anisotropy).roughness(),
    }
}

/// Cosine and sine of a texel's direction, and strength. Of two opposite directions it is the one that is
/// nearer to the mean angle, so that textures can be filtered; isotropic texels have the mean one.
pub(crate) fn anisotropy(maps: &Svbrdf, mean: f32, texel: usize) -> [f32; 3] {
    let lobe = match parameters(maps, texel) {
        [0.0, 0.0] => return [mean.cos(), mean.sin(), 0.0],
        anisotropy => Anisotropy::new(maps.roughness()[texel], anisotropy),
    };
    let [cos, sin] = lobe.facing(mean).direction();
    [cos, sin, lobe.strength()]
}

/// Weight and roughness of a texel's coat.
pub(crate) fn coat(maps: &Svbrdf, texel: usize) -> [f32; 2] {
    [lobe::COAT, lobe::COAT_ROUGHNESS].map(|lobe| part(maps, lobe, texel))
}

/// Linear colour and roughness of a texel's sheen.
pub(crate) fn sheen(maps: &Svbrdf, texel: usize) -> [f32; 4] {
    [0, 1, 2, 3].map(|i| part(maps, lobe::SHEEN + i, texel))
}
