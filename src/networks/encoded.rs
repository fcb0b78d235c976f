//! Conversion of maps to and from the networks' planes in [-1, 1].

use crate::svbrdf::encoding;
use crate::{Result, Svbrdf};

/// Nine planes in [-1, 1], see [`encoding`].
pub(crate) fn encoded_maps(maps: &Svbrdf) -> Vec<f32> {
    let n = maps.texels();
    let encode = |(i, &v): (usize, &f32)| encoding::encode(i / n, v);
    maps.planes().iter().enumerate().map(encode).collect()
}

/// Maps of nine encoded planes, clamped to their physical range.
pub(super) fn decoded_maps(width: usize, height: usize, mut encoded: Vec<f32>) -> Result<Svbrdf> {
    for (c, plane) in encoded.chunks_exact_mut(width * height).enumerate() {
        for v in plane {
            *v = encoding::decode(c, *v);
        }
    }
    let mut maps = Svbrdf::from_planes(width, height, encoded)?;
    maps.clamp();
    Ok(maps)
}
