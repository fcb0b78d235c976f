//! Access of the texel kernels to observations and maps: eight texels at a time, rows in bands.

use crate::observation::{FULL_WEIGHT, LEAST_WEIGHT, Observation, Packed};
use crate::reflectance::{Directions, LobeParameters, TexelView};
use crate::simd::Lanes;
use crate::svbrdf::{CHANNELS, LOBES, Svbrdf, lobe};
use crate::{Error, Result};
use std::ops::Range;

/// Rows per task.
pub(crate) const BAND_ROWS: usize = 4;

/// Checks that all observations have the maps' size.
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
    /// If the size of an observation differs from that of the maps.
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

    /// Weights of up to eight texels.
    #[inline(always)]
    pub fn load_weight<V: Lanes>(&self, texels: &Range<usize>) -> V {
        let lacks = V::load_lowest(self.packed.map(|plane| &plane[texels.clone()]));
        let full = f32::from(FULL_WEIGHT);
        let packed = V::splat(full) - lacks;
        packed.if_greater(
            V::splat(1.5),
            packed * V::splat(1.0 / full),
            packed * V::splat(LEAST_WEIGHT),
        )
    }

    /// Radiances of up to eight texels.
    #[inline(always)]
    pub fn load_radiance<V: Lanes>(&self, c: usize, texels: &Range<usize>) -> V {
        V::load_halves(&self.packed[c][texels.clone()])
    }
}

/// Directions of eight texels in every photograph. Computing them first overlaps the roots and divisions of
/// several photographs; one photograph at a time would form a chain longer than a processor's look-ahead.
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

/// Loads the optional lobes of these texels; `None` if the material has none.
#[inline(always)]
pub(crate) fn load_lobes<V: Lanes>(
    maps: &Svbrdf,
    first: usize,
    end: usize,
) -> Option<LobeParameters<V>> {
    let (n, planes) = (maps.texels(), maps.lobes());
    if planes.is_empty() {
        return None;
    }
    let mut base = [V::splat(0.0); lobe::SHEEN];
    for (c, p) in base.iter_mut().enumerate() {
        *p = V::load(&planes[c * n + first..c * n + end], 0.0);
    }
    if planes.len() < LOBES * n {
        return Some(LobeParameters { base, sheen: None });
    }
    let mut sheen = [V::splat(0.0); LOBES - lobe::SHEEN];
    for (c, p) in sheen.iter_mut().enumerate() {
        let at = (lobe::SHEEN + c) * n;
        *p = V::load(&planes[at + first..at + end], 0.0);
    }
    Some(LobeParameters { base, sheen: Some(sheen) })
}
