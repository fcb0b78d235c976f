//! The photographs of an estimate at several resolutions, and their views.
//!
//! Phases work on at most 256 texels along each side. Larger photographs are strided: every second, fourth,
//! ... texel is kept, because averages would hide relief. Only the latent code works on averages.

use std::borrow::Cow;

use super::correction::Correction;
use super::parts::Contradiction;
use crate::networks::CODE_TEXELS;
use crate::observation::{Observation, View};
use crate::svbrdf::{halved, halvings_to};
use crate::{Error, Result, Svbrdf};

/// Least shorter side of a kept level, texels.
const MIN_TEXELS: usize = 32;

/// Rectified photographs of one size, with given and corrected views.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Photographs {
    /// Uncorrected views.
    given: Vec<View>,
    correction: Correction,
    /// Full resolution, corrected views, outlier regions masked.
    full: Vec<Observation>,
    /// Outlier regions, and the photographs without the mask.
    masked: Vec<Option<(Contradiction, Observation)>>,
    /// Photographs halved once, twice, ...; none if they are strided.
    levels: Vec<Vec<Observation>>,
    /// Largest number of photographs in a step.
    at_once: usize,
    /// Largest number of texels along the longer side in a phase.
    working_texels: usize,
    /// Strided photographs for the phases, if the full ones are larger.
    strided: Option<Box<Self>>,
    /// Averages for the latent code, if photographs are strided.
    averaged: Vec<Observation>,
}

impl Photographs {
    /// No photographs.
    pub fn new() -> Self {
        Self {
            given: Vec::new(),
            correction: Correction::default(),
            full: Vec::new(),
            masked: Vec::new(),
            levels: Vec::new(),
            at_once: usize::MAX,
            working_texels: usize::MAX,
            strided: None,
            averaged: Vec::new(),
        }
    }

    /// Limits the photographs of a step, and the texels along the longer side in phases.
    pub fn limited(self, at_once: usize, working_texels: usize) -> Self {
        Self { at_once: at_once.max(1), working_texels, ..self }
    }

    /// Adds photographs with uncorrected views, and a correction.
    ///
    /// # Errors
    /// When sizes differ.
    pub fn restored(
        mut self,
        observations: Vec<Observation>,
        correction: Correction,
    ) -> Result<Self> {
        self.correction = correction;
        observations.into_iter().try_for_each(|observation| self.add(observation))?;
        Ok(self)
    }

    /// Number of photographs.
    pub fn len(&self) -> usize {
        self.full.len()
    }

    /// Median (the lower of two) of the photographs' deviations of log radiances, as their boards show them;
    /// 0 without a board.
    pub fn log_sigma(&self) -> f32 {
        let mut sigmas: Vec<f32> =
            self.full.iter().map(|o| o.log_sigma).filter(|sigma| *sigma > 0.0).collect();
        let middle = sigmas.len().saturating_sub(1) / 2;
        if sigmas.is_empty() {
            0.0
        } else {
            *sigmas.select_nth_unstable_by(middle, f32::total_cmp).1
        }
    }

    /// Adds a photograph with an uncorrected view.
    ///
    /// # Errors
    /// When its size is not that of the first.
    pub fn add(&mut self, mut observation: Observation) -> Result<()> {
        self.check_size(&observation)?;
        let index = self.full.len();
        self.given.push(observation.view);
        observation.view = self.correction.apply(&observation.view, index);
        self.full.push(observation);
        self.masked.push(None);
        if index == 0 && self.stride_log2() > 0 {
            self.strided = Some(Box::new(Self::new().limited(self.at_once, usize::MAX)));
        } else if index == 0 {
            self.levels = vec![Vec::new(); halvings(&self.full[0])];
        }
        let (times, averaging) = (self.stride_log2(), self.averaging());
        let (given, full) = (self.given[index], &self.full[index]);
        if let Some(strided) = &mut self.strided {
            let mut observation = full.strided(times);
            observation.view = given;
            strided.add(observation)?;
            strided.correct(self.correction.clone());
            self.averaged.push(halved(full, averaging, Observation::downsampled));
        }
        let mut small = Cow::Borrowed(full);
        for level in &mut self.levels {
            small = Cow::Owned(small.downsampled());
            level.push(small.clone().into_owned());
        }
        Ok(())
    }

    /// Replaces a photograph by one with an uncorrected view; does nothing without a photograph of this
    /// index.
    ///
    /// # Errors
    /// When its size is another.
    pub fn replace(&mut self, index: usize, mut observation: Observation) -> Result<()> {
        self.check_size(&observation)?;
        let Some(old) = self.full.get_mut(index) else { return Ok(()) };
        self.given[index] = observation.view;
        observation.view = self.correction.apply(&observation.view, index);
        *old = observation;
        self.masked[index] = None;
        self.derive(index);
        Ok(())
    }

    fn check_size(&self, observation: &Observation) -> Result<()> {
        let size = |o: &Observation| [o.width(), o.height()];
        if let Some(first) = self.full.first().filter(|first| size(first) != size(observation)) {
            let ([w, h], [found_w, found_h]) = (size(first), size(observation));
            let message = format!("{found_w}x{found_h} texels, {w}x{h} expected");
            return Err(Error::argument("observation", message));
        }
        Ok(())
    }

    /// A photograph without its mask.
    pub fn unmasked(&self, index: usize) -> Observation {
        let Some((_, seen)) = &self.masked[index] else { return self.full[index].clone() };
        let mut seen = seen.clone();
        seen.view = self.full[index].view;
        seen
    }

    /// Outlier regions of each photograph.
    pub fn contradictions(&self) -> impl Iterator<Item = Option<&Contradiction>> {
        self.masked.iter().map(|masked| masked.as_ref().map(|(regions, _)| regions))
    }

    /// Masks outlier regions of a photograph instead of those masked before.
    pub fn mask(&mut self, index: usize, regions: Option<Contradiction>) {
        if regions.is_none() && self.masked[index].is_none() {
            return;
        }
        let seen = self.unmasked(index);
        self.full[index] =
            regions.as_ref().map_or(seen.clone(), |regions| regions.taken_from(&seen));
        self.masked[index] = regions.map(|regions| (regions, seen));
        self.derive(index);
    }

    /// Halves and strides a photograph that has changed.
    fn derive(&mut self, index: usize) {
        let (times, averaging) = (self.stride_log2(), self.averaging());
        if let Some(strided) = &mut self.strided {
            strided.full[index] = self.full[index].strided(times);
            strided.given[index] = self.given[index];
            strided.derive(index);
            self.averaged[index] = halved(&self.full[index], averaging, Observation::downsampled);
        }
        let mut small = Cow::Borrowed(&self.full[index]);
        for level in &mut self.levels {
            small = Cow::Owned(small.downsampled());
            level[index] = small.clone().into_owned();
        }
    }

    /// Photographs at full resolution.
    pub fn full(&self) -> &[Observation] {
        &self.full
    }

    /// Photographs after this many halvings, which their size must allow.
    pub fn level(&self, halvings: u32) -> Cow<'_, [Observation]> {
        match (halvings, self.levels.get(halvings as usize - usize::from(halvings > 0))) {
            (0, _) => Cow::Borrowed(&self.full),
            (_, Some(level)) => Cow::Borrowed(level),
            _ => self.level(halvings - 1).iter().map(Observation::downsampled).collect(),
        }
    }

    /// Photographs that a step sees: all, or the latest third and an evenly spaced subset of the others,
    /// which shifts with `round`.
    pub fn subset(&self, round: usize) -> Vec<usize> {
        let (count, latest) = (self.len(), self.at_once.div_ceil(3));
        if count <= self.at_once {
            return (0..count).collect();
        }
        let (earlier, others) = (count - latest, self.at_once - latest);
        let mut subset: Vec<usize> =
            (0..others).map(|i| (round + i * earlier / others) % earlier).collect();
        subset.sort_unstable();
        subset.extend(earlier..count);
        subset
    }

    /// The photographs with these indices.
    pub fn some(&self, which: &[usize]) -> Cow<'_, [Observation]> {
        chosen(&self.full, which)
    }

    /// Photographs at the resolution of the phases.
    pub fn working(&self) -> &Self {
        self.strided.as_deref().unwrap_or(self)
    }

    /// Averages at the resolution of the latent code.
    pub fn averaged(&self) -> Cow<'_, [Observation]> {
        match self.strided {
            Some(_) => Cow::Borrowed(&self.averaged),
            None => self.level(self.averaging()),
        }
    }

    /// Photographs of the size of these maps: full or strided.
    pub fn like(&self, maps: &Svbrdf) -> &Self {
        if self.full.first().is_some_and(|o| o.width() == maps.width()) {
            self
        } else {
            self.working()
        }
    }

    /// Logarithm to base 2 of the phases' stride.
    pub fn stride_log2(&self) -> u32 {
        self.halvings_to(self.working_texels)
    }

    /// Halvings for the latent code.
    fn averaging(&self) -> u32 {
        self.halvings_to(CODE_TEXELS.min(self.working_texels))
    }

    /// Halvings to at most `texels` along the longer side, or as many as the size allows.
    pub fn halvings_to(&self, texels: usize) -> u32 {
        self.full.first().map_or(0, |first| halvings_to([first.width(), first.height()], texels))
    }

    /// Uncorrected views.
    pub fn given(&self) -> &[View] {
        &self.given
    }

    /// The correction of the views.
    pub fn correction(&self) -> &Correction {
        &self.correction
    }

    /// Corrects all views.
    pub fn correct(&mut self, correction: Correction) {
        self.correction = correction;
        let views = self.given.iter().enumerate().map(|(i, view)| self.correction.apply(view, i));
        let views: Vec<View> = views.collect();
        for level in self.levels.iter_mut().chain([&mut self.full, &mut self.averaged]) {
            level.iter_mut().zip(&views).for_each(|(observation, view)| observation.view = *view);
        }
        if let Some(strided) = &mut self.strided {
            strided.correct(self.correction.clone());
        }
    }
}

/// The photographs with these indices.
pub(super) fn chosen<'a>(all: &'a [Observation], which: &[usize]) -> Cow<'a, [Observation]> {
    if which.len() == all.len() {
        return Cow::Borrowed(all);
    }
    which.iter().map(|&i| all[i].clone()).collect()
}

/// Halvings until the shorter side is [`MIN_TEXELS`].
fn halvings(photograph: &Observation) -> usize {
    let (width, height) = (photograph.width(), photograph.height());
    let can_be = |halvings: &u32| {
        let half = |n: usize| (n >> (halvings - 1)).is_multiple_of(2);
        half(width) && half(height) && width.min(height) >> halvings >= MIN_TEXELS
    };
    (1..).take_while(can_be).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::Falloff;

    fn photograph(width: usize, height: usize, value: f32) -> Observation {
        let view = View {
            sample_mm: [100.0; 2],
            camera_mm: [0.0, 0.0, 150.0],
            light_mm: [10.0, 0.0, 150.0],
            falloff: Falloff::None { power: [std::f32::consts::PI; 3] },
            ambient: [0.0; 3],
            mirrored: 1.0,
        };
        let n = width * height;
        Observation::new(width, height, view, &vec![value; 3 * n], &vec![1.0; n]).unwrap()
    }

    #[test]
    fn levels_are_the_halved_photographs() {
        let mut photographs = Photographs::new();
        photographs.add(photograph(512, 256, 0.5)).unwrap();
        photographs.add(photograph(512, 256, 0.25)).unwrap();
        assert_eq!(photographs.levels.len(), 3);
        for halvings in 0..5 {
            let level = photographs.level(halvings);
            let expected = photographs.full().iter();
            let expected = expected.map(|o| (0..halvings).fold(o.clone(), |o, _| o.downsampled()));
            assert_eq!(level.to_vec(), expected.collect::<Vec<_>>());
        }
        assert_eq!(photographs.halvings_to(128), 2);
        assert!(photographs.add(photograph(256, 256, 0.5)).is_err());
        assert_eq!(photographs.len(), 2);
    }

    #[test]
    fn the_median_board_states_the_deviation() {
        let mut photographs = Photographs::new();
        assert_eq!(photographs.log_sigma(), 0.0);
        let after = [(0.0, 0.0), (0.006, 0.006), (0.002, 0.002), (0.004, 0.004), (0.009, 0.004)];
        for (log_sigma, median) in after {
            let mut one = photograph(64, 64, 0.5);
            one.log_sigma = log_sigma;
            photographs.add(one).unwrap();
            assert_eq!(photographs.log_sigma(), median);
        }
    }

    #[test]
    fn every_level_has_the_corrected_views() {
        let mut photographs = Photographs::new();
        photographs.add(photograph(64, 64, 0.5)).unwrap();
        let correction = Correction { turns: vec![[0.02, 0.0]], ..Correction::default() };
        photographs.correct(correction.clone());
        let view = correction.apply(&photographs.given()[0], 0);
        assert_ne!(view, photographs.given()[0]);
        assert!((0..2).all(|h| photographs.level(h)[0].view == view));
        let mut better = photograph(64, 64, 0.5);
        better.view.light_mm[2] = 200.0;
        photographs.replace(0, better).unwrap();
        assert!(photographs.replace(0, photograph(32, 32, 0.5)).is_err());
        assert_eq!(photographs.given()[0].light_mm, [10.0, 0.0, 200.0]);
        assert_eq!(photographs.full()[0].view, correction.apply(&photographs.given()[0], 0));
        assert_eq!(photographs.level(1)[0].view, photographs.full()[0].view);
    }

    #[test]
    fn large_photographs_are_strided() {
        let n = 64 * 64;
        let radiance: Vec<f32> = (0..3 * n).map(|i| (i % 977) as f32 / 977.0).collect();
        let view = photograph(64, 64, 0.5).view;
        let textured = Observation::new(64, 64, view, &radiance, &vec![1.0; n]).unwrap();
        let mut photographs = Photographs::new().limited(usize::MAX, 16);
        for _ in 0..2 {
            photographs.add(textured.clone()).unwrap();
        }
        assert_eq!(photographs.stride_log2(), 2);
        let correction = Correction { turns: vec![[0.02, 0.0]], ..Correction::default() };
        photographs.correct(correction);
        let mut better = textured.clone();
        better.view.light_mm[2] = 200.0;
        photographs.replace(1, better).unwrap();
        let (full, working) = (photographs.full(), photographs.working().full());
        for (full, working) in full.iter().zip(working) {
            assert_eq!([working.width(), working.height()], [16, 16]);
            assert_eq!(working.view, full.view);
            for (x, y) in [(0, 0), (15, 3), (7, 15)] {
                let (few, all) = (y * 16 + x, (4 * y + 2) * 64 + 4 * x + 2);
                assert_eq!(working.radiance(1, few), full.radiance(1, all));
            }
        }
        assert_eq!(photographs.working().given(), photographs.given());
        for (full, averaged) in full.iter().zip(photographs.averaged().iter()) {
            assert_eq!(*averaged, full.downsampled().downsampled());
        }
    }

    #[test]
    fn a_subset_has_the_latest_photographs_and_all_others_in_turn() {
        let mut photographs = Photographs::new().limited(12, usize::MAX);
        for count in 1..60 {
            photographs.add(photograph(8, 8, 0.5)).unwrap();
            let mut seen = vec![false; count];
            for round in 0..count {
                let subset = photographs.subset(round);
                assert_eq!(subset.len(), count.min(12));
                assert!(subset.is_sorted_by(|a, b| a < b));
                assert!((count.saturating_sub(4)..count).all(|i| subset.contains(&i)));
                subset.iter().for_each(|i| seen[*i] = true);
            }
            assert!(seen.iter().all(|seen| *seen));
        }
    }
}
