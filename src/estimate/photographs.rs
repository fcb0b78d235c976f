//! The photographs of an estimate: radiances at several resolutions, and the one owner of their
//! views.

use std::borrow::Cow;

use super::correction::Correction;
use crate::observation::{Observation, View};
use crate::{Error, Result, Svbrdf};

/// Shortest side that is kept, texels.
const MIN_TEXELS: usize = 32;

/// Rectified photographs of one size. Views are kept as given and as corrected.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Photographs {
    /// Views before their correction.
    given: Vec<View>,
    correction: Correction,
    /// At full resolution, views as corrected.
    full: Vec<Observation>,
    /// The same halved so many times, where the longer side is at most `finest` texels.
    levels: Vec<(u32, Vec<Observation>)>,
    finest: usize,
    /// Photographs that a step sees, at most.
    at_once: usize,
    /// Texels along the longer side that phases work with, at most; and these, where there are more.
    working_texels: usize,
    thinned: Option<Box<Self>>,
}

impl Photographs {
    /// None yet; halved ones are kept where they have at most `finest` texels along the longer side.
    pub fn new(finest: usize) -> Self {
        let (given, full, levels) = (Vec::new(), Vec::new(), Vec::new());
        let correction = Correction::default();
        let (at_once, working_texels, thinned) = (usize::MAX, usize::MAX, None);
        Self { given, correction, full, levels, finest, at_once, working_texels, thinned }
    }

    /// The same, of which a step sees so many at most, and phases so many texels along the longer
    /// side.
    pub fn limited(self, at_once: usize, working_texels: usize) -> Self {
        Self { at_once: at_once.max(1), working_texels, ..self }
    }

    /// The same with photographs, their views as given, and a correction of these.
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

    /// At full resolution, with their views as given.
    pub fn into_given(self) -> Vec<Observation> {
        let mut photographs = self.full;
        photographs.iter_mut().zip(&self.given).for_each(|(o, view)| o.view = *view);
        photographs
    }

    /// Photographs so far.
    pub fn len(&self) -> usize {
        self.full.len()
    }

    /// Adds a photograph whose view is as given.
    ///
    /// # Errors
    /// When its size is not that of the first.
    pub fn add(&mut self, mut observation: Observation) -> Result<()> {
        let size = |o: &Observation| [o.width(), o.height()];
        if let Some(first) = self.full.first().filter(|first| size(first) != size(&observation)) {
            let ([w, h], [found_w, found_h]) = (size(first), size(&observation));
            let message = format!("{found_w}x{found_h} texels, {w}x{h} expected");
            return Err(Error::argument("observation", message));
        }
        if self.full.is_empty() {
            let [width, height] = size(&observation);
            self.levels = kept_levels(width, height, self.finest);
        }
        self.given.push(observation.view);
        observation.view = self.correction.apply(&observation.view, self.full.len());
        let last = self.levels.last().map_or(0, |(halvings, _)| *halvings);
        let mut small = Cow::Borrowed(&observation);
        for halvings in 1..=last {
            small = Cow::Owned(small.downsampled());
            if let Some((_, level)) = self.levels.iter_mut().find(|(h, _)| *h == halvings) {
                level.push(small.clone().into_owned());
            }
        }
        self.full.push(observation);
        let halvings = self.halvings_to(self.working_texels);
        if halvings > 0 {
            let index = self.full.len() - 1;
            let thinned = self.as_given(index).thinned(halvings);
            let none = || Box::new(Self::new(self.finest).limited(self.at_once, usize::MAX));
            let all = self.thinned.get_or_insert_with(none);
            all.add(thinned)?;
            all.correct(self.correction.clone());
        }
        Ok(())
    }

    /// A photograph with its view as given.
    fn as_given(&self, index: usize) -> Observation {
        let mut observation = self.full[index].clone();
        observation.view = self.given[index];
        observation
    }

    /// Changes a photograph, which it sees with its view as given; nothing where there is none of
    /// that index.
    pub fn change(&mut self, index: usize, change: impl FnOnce(&mut Observation)) {
        let Some(observation) = self.full.get_mut(index) else { return };
        observation.view = self.given[index];
        change(observation);
        self.given[index] = observation.view;
        observation.view = self.correction.apply(&observation.view, index);
        self.derive(index);
    }

    /// Halves and thins out a photograph that has changed.
    fn derive(&mut self, index: usize) {
        if let Some(thinned) = &mut self.thinned {
            let times = (self.full[index].width() / thinned.full[index].width()).ilog2();
            thinned.full[index] = self.full[index].thinned(times);
            thinned.given[index] = self.given[index];
            thinned.derive(index);
        }
        let (last, mut small) =
            (self.levels.last().map_or(0, |(h, _)| *h), Cow::Borrowed(&self.full[index]));
        for halvings in 1..=last {
            small = Cow::Owned(small.downsampled());
            if let Some((_, level)) = self.levels.iter_mut().find(|(h, _)| *h == halvings) {
                level[index] = small.clone().into_owned();
            }
        }
    }

    /// At full resolution.
    pub fn full(&self) -> &[Observation] {
        &self.full
    }

    /// Halved so many times. Sizes must be even so often.
    pub fn level(&self, halvings: u32) -> Cow<'_, [Observation]> {
        let kept = self.levels.iter().find(|(h, _)| *h == halvings);
        match (halvings, kept) {
            (0, _) => Cow::Borrowed(&self.full),
            (_, Some((_, level))) => Cow::Borrowed(level),
            _ => self.level(halvings - 1).iter().map(Observation::downsampled).collect(),
        }
    }

    /// Photographs that a step sees: all, or the latest third and of the others, in turn, some that
    /// are evenly spaced.
    pub fn drawn(&self, turn: usize) -> Vec<usize> {
        let (count, latest) = (self.len(), self.at_once.div_ceil(3));
        if count <= self.at_once {
            return (0..count).collect();
        }
        let (earlier, others) = (count - latest, self.at_once - latest);
        let mut drawn: Vec<usize> =
            (0..others).map(|i| (turn + i * earlier / others) % earlier).collect();
        drawn.sort_unstable();
        drawn.extend(earlier..count);
        drawn
    }

    /// Some photographs halved so many times.
    pub fn some(&self, halvings: u32, which: &[usize]) -> Cow<'_, [Observation]> {
        let level = self.level(halvings);
        if which.len() == level.len() {
            return level;
        }
        which.iter().map(|&i| level[i].clone()).collect()
    }

    /// Those that the phases work with: large ones thinned out, texels as they are.
    pub fn working(&self) -> &Self {
        self.thinned.as_deref().unwrap_or(self)
    }

    /// Those of the size of these maps: all texels, or those that phases work with.
    pub fn like(&self, maps: &Svbrdf) -> &Self {
        let has = |p: &&Self| {
            p.full.first().is_some_and(|o| [o.width(), o.height()] == [maps.width(), maps.height()])
        };
        Some(self).filter(has).unwrap_or(self.working())
    }

    /// Of how many texels along each side the phases work with one, as a power of two.
    pub fn thinning(&self) -> u32 {
        match &self.thinned {
            Some(_) => self.halvings_to(self.working_texels),
            None => 0,
        }
    }

    /// Halvings after which the longer side has at most so many texels, or which the size allows.
    pub fn halvings_to(&self, texels: usize) -> u32 {
        let Some(first) = self.full.first() else { return 0 };
        let (width, height) = (first.width(), first.height());
        let mut halvings = 0;
        while width.max(height) >> halvings > texels
            && (width >> halvings).is_multiple_of(2)
            && (height >> halvings).is_multiple_of(2)
        {
            halvings += 1;
        }
        halvings
    }

    /// Views before their correction.
    pub fn given(&self) -> &[View] {
        &self.given
    }

    /// The correction in use.
    pub fn correction(&self) -> &Correction {
        &self.correction
    }

    /// Corrects all views.
    pub fn correct(&mut self, correction: Correction) {
        self.correction = correction;
        let views = self.given.iter().enumerate().map(|(i, view)| self.correction.apply(view, i));
        let views: Vec<View> = views.collect();
        let levels = self.levels.iter_mut().map(|(_, level)| level);
        for level in levels.chain([&mut self.full]) {
            level.iter_mut().zip(&views).for_each(|(observation, view)| observation.view = *view);
        }
        if let Some(thinned) = &mut self.thinned {
            thinned.correct(self.correction.clone());
        }
    }
}

/// Halvings whose results are kept.
fn kept_levels(width: usize, height: usize, finest: usize) -> Vec<(u32, Vec<Observation>)> {
    let is_kept = |halvings: &u32| width.max(height) >> halvings <= finest;
    let can_be = |halvings: &u32| {
        let half = |n: usize| (n >> (halvings - 1)).is_multiple_of(2);
        half(width) && half(height) && width.min(height) >> halvings >= MIN_TEXELS
    };
    (1..).take_while(can_be).filter(is_kept).map(|halvings| (halvings, Vec::new())).collect()
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
    fn levels_kept_or_not_are_the_halved_photographs() {
        let mut photographs = Photographs::new(128);
        photographs.add(photograph(512, 256, 0.5)).unwrap();
        photographs.add(photograph(512, 256, 0.25)).unwrap();
        assert_eq!(photographs.levels.iter().map(|l| l.0).collect::<Vec<_>>(), [2, 3]);
        for halvings in 0..4 {
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
    fn every_level_has_the_corrected_views() {
        let mut photographs = Photographs::new(256);
        photographs.add(photograph(64, 64, 0.5)).unwrap();
        let correction = Correction { turns: vec![[0.02, 0.0]], ..Correction::default() };
        photographs.correct(correction.clone());
        let view = correction.apply(&photographs.given()[0], 0);
        assert_ne!(view, photographs.given()[0]);
        assert!((0..2).all(|h| photographs.level(h)[0].view == view));
        // a change sees the view as given
        photographs.change(0, |o| o.view.light_mm[2] = 200.0);
        assert_eq!(photographs.given()[0].light_mm, [10.0, 0.0, 200.0]);
        assert_eq!(photographs.full()[0].view, correction.apply(&photographs.given()[0], 0));
        assert_eq!(photographs.level(1)[0].view, photographs.full()[0].view);
    }
}
