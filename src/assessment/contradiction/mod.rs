//! Parts of photographs that contradict the others: a hand, sun on a part of the sample, a shadow,
//! glare.
//!
//! Each photograph is predicted from all others, on a coarse grid (leave-one-out, [`left_out`]). Where
//! it differs by much more than the prediction's standard deviation and than photographs of the sample
//! usually do, while the others agree with each other without it, it shows something that they do not
//! ([`regions`]). Such parts have weight 0 in the fit and are reported. So has a whole photograph whose board's
//! squares are much farther off their model of light than those of the others.

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

/// Cells along the longer side of the sample, where its size can be halved as often.
const CELLS: usize = 32;
/// Deviation of a board's squares from their model of light, in units of the median photograph's and as it
/// is, from which on a photograph's light contradicts the others': tone-mapped in parts, for example.
const SQUARES: (f32, f32) = (4.0, 0.01);

/// Photographs without which nothing contradicts: of two that differ, either may be right.
const CONTRADICTION_FROM: usize = 3;

impl Estimation {
    /// Adds a photograph, the first with the maps to start from, without its parts that contradict the others.
    /// `restart`: earlier ones were replaced ([`Estimation::replace`]) by others that lie so far elsewhere that the
    /// maps so far are no start any more.
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

    /// Looks for parts of photographs that contradict the others, and leaves them out of the fit.
    ///
    /// # Errors
    /// Without photographs.
    fn mask_contradictions(&mut self) -> Result<()> {
        let which = self.photographs.working().drawn(self.photographs.len());
        // Where lights are only roughly known, all photographs differ.
        if which.len() < CONTRADICTION_FROM || self.task.free_lights {
            return Ok(());
        }
        let thinning = self.photographs.thinning();
        let maps = self.maps()?.thinned(thinning);
        let seen: Vec<Observation> =
            which.iter().map(|&i| self.photographs.seen(i).thinned(thinning)).collect();
        let times = halvings(maps.width(), maps.height());
        let seen = seen.iter().map(|o| halved(o, times, Observation::downsampled)).collect();
        let maps = halved(&maps, times, Svbrdf::downsampled);
        for (index, found) in which.into_iter().zip(find(&maps, seen, &self.options.noise)?) {
            self.photographs.set_aside(index, found);
        }
        Ok(())
    }
}

/// Halvings after which there is a texel for each cell, or which the size allows.
fn halvings(width: usize, height: usize) -> u32 {
    let can_be = |times: &u32| {
        let longer = width.max(height) >> times;
        longer > CELLS && (width >> times).is_multiple_of(2) && (height >> times).is_multiple_of(2)
    };
    (0..).take_while(can_be).count() as u32
}

/// Photographs whose boards tell of a light that the others do not have.
fn otherwise_lit(photographs: &[Observation]) -> Vec<usize> {
    let mut sigmas: Vec<f32> = photographs.iter().map(|o| o.log_sigma).collect();
    sigmas.sort_by(f32::total_cmp);
    let limit = (SQUARES.0 * sigmas[sigmas.len() / 2]).max(SQUARES.1);
    // Without a board nothing is known: all are 0.
    let has_board = sigmas[0] > 0.0;
    (0..photographs.len()).filter(|&i| has_board && photographs[i].log_sigma > limit).collect()
}

/// What contradicts the others in each photograph: the clearest region is taken out, then the others
/// are looked at without it, as long as there is one.
fn find(
    maps: &Svbrdf,
    mut photographs: Vec<Observation>,
    options: &NoiseOptions,
) -> Result<Vec<Option<Contradiction>>> {
    let size = [maps.width(), maps.height()];
    let mut found: Vec<Option<Contradiction>> = vec![None; photographs.len()];
    for index in otherwise_lit(&photographs) {
        let whole = Contradiction::whole(size);
        photographs[index] = whole.taken_from(&photographs[index]);
        found[index] = Some(whole);
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
            // The model fails there, or any of several photographs may be the wrong one.
            all.forget(&region.cells);
            continue;
        };
        found[index].get_or_insert_with(|| Contradiction::none(size)).add(&single);
        (photographs, all) = (without, after.without_forgotten(&all));
    }
    Ok(found)
}
