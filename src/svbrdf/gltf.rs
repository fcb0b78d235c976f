//! Optional lobes in the terms of glTF's `KHR_materials_anisotropy`, `KHR_materials_clearcoat` and
//! `KHR_materials_sheen`, texel by texel: for exports and bindings.

use super::{Anisotropy, LOBES, NO_LOBES, Svbrdf, lobe};
use crate::Result;

/// Optional lobes that a material shows: at any texel.
#[derive(Debug, Clone, Copy)]
pub struct Shown {
    /// Mean angle of the directions of anisotropy.
    pub anisotropy: Option<f32>,
    /// Whether any texel has a coat.
    pub coat: bool,
    /// Whether any texel has sheen.
    pub sheen: bool,
}

impl Shown {
    /// The lobes of these maps.
    pub fn of(maps: &Svbrdf) -> Self {
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
pub fn roughness(maps: &Svbrdf, texel: usize) -> f32 {
    let roughness = maps.roughness()[texel];
    match parameters(maps, texel) {
        [0.0, 0.0] => roughness,
        anisotropy => Anisotropy::new(roughness, anisotropy).roughness(),
    }
}

/// Both alphas of a texel. Of two opposite directions, the one nearer to the mean angle is taken, so that textures
/// can be filtered; isotropic texels have the mean one, which disturbs no neighbour.
pub fn alphas(maps: &Svbrdf, mean: f32, texel: usize) -> Anisotropy {
    let lobe = Anisotropy::new(maps.roughness()[texel], parameters(maps, texel));
    if lobe.along > lobe.across { lobe.facing(mean) } else { Anisotropy { angle: mean, ..lobe } }
}

/// Cosine and sine of a texel's direction, as [`alphas`] has it, and strength.
pub fn anisotropy(maps: &Svbrdf, mean: f32, texel: usize) -> [f32; 3] {
    let lobe = alphas(maps, mean, texel);
    let [cos, sin] = lobe.direction();
    [cos, sin, lobe.strength()]
}

/// Weight and roughness of a texel's coat.
pub fn coat(maps: &Svbrdf, texel: usize) -> [f32; 2] {
    [lobe::COAT, lobe::COAT_ROUGHNESS].map(|lobe| part(maps, lobe, texel))
}

/// Linear colour and roughness of a texel's sheen.
pub fn sheen(maps: &Svbrdf, texel: usize) -> [f32; 4] {
    [0, 1, 2, 3].map(|i| part(maps, lobe::SHEEN + i, texel))
}

/// Adds lobes to maps without any that hold the roughness of the smaller alpha; nothing where all are absent. Each
/// texel of `anisotropy` is cosine and sine of the direction, and strength; each of `coat` weight and roughness;
/// each of `sheen` linear colour and roughness.
///
/// # Errors
/// As [`Svbrdf::set_lobes`].
pub fn add_lobes(
    maps: &mut Svbrdf,
    anisotropy: Option<impl Iterator<Item = [f32; 3]>>,
    coat: Option<impl Iterator<Item = [f32; 2]>>,
    sheen: Option<impl Iterator<Item = [f32; 4]>>,
) -> Result<()> {
    if anisotropy.is_none() && coat.is_none() && sheen.is_none() {
        return Ok(());
    }
    let texels = maps.texels();
    let count = if sheen.is_some() { LOBES } else { lobe::SHEEN };
    let mut lobes = Vec::with_capacity(count * texels);
    for none in &NO_LOBES[..count] {
        lobes.resize(lobes.len() + texels, *none as f32);
    }
    let roughness = maps.roughness_mut();
    for (i, [cos, sin, strength]) in anisotropy.into_iter().flatten().enumerate() {
        if strength > 0.0 {
            let (mean, [x, y]) =
                Anisotropy::from_gltf(roughness[i], [cos, sin], strength).parameters();
            roughness[i] = mean;
            lobes[lobe::ANISOTROPY_X * texels + i] = x;
            lobes[lobe::ANISOTROPY_Y * texels + i] = y;
        }
    }
    for (i, [weight, coat_roughness]) in coat.into_iter().flatten().enumerate() {
        lobes[lobe::COAT * texels + i] = weight;
        lobes[lobe::COAT_ROUGHNESS * texels + i] = coat_roughness;
    }
    for (i, texel) in sheen.into_iter().flatten().enumerate() {
        for (value, plane) in texel.into_iter().zip(lobe::SHEEN..) {
            lobes[plane * texels + i] = value;
        }
    }
    maps.set_lobes(lobes)
}
