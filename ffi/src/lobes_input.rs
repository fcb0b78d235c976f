//! Planes of optional lobes from the terms of glTF. The Python module compiles this file as well.

use engine::svbrdf::{Anisotropy, LOBES, NO_LOBES, lobe};

/// Planes of roughness, from that of the smaller alpha, and of the optional lobes; none of these without
/// anisotropy, coat and sheen. Each texel of `anisotropy` is cosine and sine of the direction, and strength; each
/// of `coat` weight and roughness; each of `sheen` linear colour and roughness.
pub(crate) fn planes(
    mut roughness: Vec<f32>,
    anisotropy: Option<impl Iterator<Item = [f32; 3]>>,
    coat: Option<impl Iterator<Item = [f32; 2]>>,
    sheen: Option<impl Iterator<Item = [f32; 4]>>,
) -> (Vec<f32>, Vec<f32>) {
    if anisotropy.is_none() && coat.is_none() && sheen.is_none() {
        return (roughness, Vec::new());
    }
    let texels = roughness.len();
    let count = if sheen.is_some() { LOBES } else { lobe::SHEEN };
    let mut lobes: Vec<f32> = Vec::with_capacity(count * texels);
    for none in &NO_LOBES[..count] {
        lobes.resize(lobes.len() + texels, *none as f32);
    }
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
    (roughness, lobes)
}
