//! Outlier regions of photographs: a hand, sun on a part of the sample, a shadow, glare.
//!
//! Each photograph is predicted from all others on a coarse grid (leave-one-out, [`left_out`]). A region is
//! an outlier if it differs by much more than the prediction's standard deviation and the usual residual, and
//! if the remaining photographs agree there without it ([`regions`]). Outlier regions have weight 0 in the
//! fit and are reported. A whole photograph has weight 0 if the squares of its board deviate from their model
//! of light much more than those of the other photographs.

mod left_out;
mod regions;

use self::left_out::{Deviations, deviations};
use crate::estimate::options::NoiseOptions;
use crate::estimate::{Contradiction, Estimation};
use crate::observation::Observation;
use crate::svbrdf::halved;
use crate::{Error, Result, Svbrdf};

#[cfg(test)]
mod tests;

/// Largest number of cells along the longer side of the sample, if its size can be halved to it.
const CELLS: usize = 32;
/// Deviation of a board's squares from their model of light above which a photograph is left out (tone
/// mapping of a part, for example): in units of the median photograph's, and absolute.
const SQUARES: (f32, f32) = (4.0, 0.01);

/// Fewest photographs that reveal an outlier: of two that differ, either may be right.
const CONTRADICTION_FROM: usize = 3;

impl Estimation {
    /// Adds a photograph and masks outlier regions. The first photograph comes with the maps to start from.
    /// `restart` says that earlier ones, replaced by [`Estimation::replace`], moved too far for the current
    /// maps to be a start.
    ///
    /// # Errors
    /// When sizes differ, the first has no start, or a network is broken.
    pub fn add(
        &mut self,
        observation: Observation,
        restart: bool,
        start: Option<&Svbrdf>,
    ) -> Result<()> {
        self.take(observation, restart, start)?;
        self.mask_contradictions()?;
        self.start(start)
    }

    /// Finds outlier regions and masks them.
    ///
    /// # Errors
    /// Without photographs.
    fn mask_contradictions(&mut self) -> Result<()> {
        let which = self.photographs.working().subset(self.photographs.len());
        // Photographs with only roughly known lights differ everywhere.
        if which.len() < CONTRADICTION_FROM || self.task.free_lights {
            return Ok(());
        }
        let stride_log2 = self.photographs.stride_log2();
        let maps = self.maps()?.strided(stride_log2);
        let seen: Vec<Observation> =
            which.iter().map(|&i| self.photographs.unmasked(i).strided(stride_log2)).collect();
        let times = halvings(maps.width(), maps.height());
        let seen = seen.iter().map(|o| halved(o, times, Observation::downsampled)).collect();
        let maps = halved(&maps, times, Svbrdf::downsampled);
        for (index, outliers) in which.into_iter().zip(find(&maps, seen, &self.options.noise)?) {
            self.photographs.mask(index, outliers);
        }
        Ok(())
    }
}

/// Halvings to one texel per cell, or as many as the size allows.
fn halvings(width: usize, height: usize) -> u32 {
    let can_be = |times: &u32| {
        let longer = width.max(height) >> times;
        longer > CELLS && (width >> times).is_multiple_of(2) && (height >> times).is_multiple_of(2)
    };
    (0..).take_while(can_be).count() as u32
}

/// Photographs whose boards deviate from the model of light far more than the others'.
fn otherwise_lit(photographs: &[Observation]) -> Vec<usize> {
    let mut sigmas: Vec<f32> = photographs.iter().map(|o| o.log_sigma).collect();
    sigmas.sort_by(f32::total_cmp);
    let limit = (SQUARES.0 * sigmas[sigmas.len() / 2]).max(SQUARES.1);
    // Photographs without a board have a deviation of 0.
    let has_board = sigmas[0] > 0.0;
    (0..photographs.len()).filter(|&i| has_board && photographs[i].log_sigma > limit).collect()
}

/// Outlier regions of each photograph. Each round masks the clearest region and judges the others without it.
fn find(
    maps: &Svbrdf,
    mut photographs: Vec<Observation>,
    options: &NoiseOptions,
) -> Result<Vec<Option<Contradiction>>> {
    let size = [maps.width(), maps.height()];
    let mut outliers: Vec<Option<Contradiction>> = vec![None; photographs.len()];
    for index in otherwise_lit(&photographs) {
        let whole = Contradiction::whole(size);
        photographs[index] = whole.taken_from(&photographs[index]);
        outliers[index] = Some(whole);
    }
    let mut all: Deviations = deviations(maps, &photographs, options)?;
    for _ in 0..2 * photographs.len() {
        let Some((index, region)) = regions::clearest(&all, size) else { break };
        let single = Contradiction { size, cells: region.cells.clone(), part: region.part };
        let without = |index: usize| {
            let mut without = photographs.clone();
            without[index] = single.taken_from(&photographs[index]);
            let after = deviations(maps, &without, options)?;
            Ok::<_, Error>(regions::agree(&after, &region, index).then_some((without, after)))
        };
        let mut after = without(index)?;
        for rival in regions::rivals(&all, &region, index) {
            if after.is_some() && without(rival)?.is_some() {
                after = None;
            }
        }
        let Some((without, after)) = after else {
            // Either the model fails in this region, or any of several photographs may be the outlier.
            all.forget(&region.cells);
            continue;
        };
        outliers[index].get_or_insert_with(|| Contradiction::none(size)).add(&single);
        (photographs, all) = (without, after.without_forgotten(&all));
    }
    Ok(outliers)
}
