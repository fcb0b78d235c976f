//! The schedule of what follows the latent code: which phase runs from how many photographs on, for how many
//! steps, how often.
//!
//! | phase                | photographs | rounds | steps before | steps after | changes          |
//! |----------------------|-------------|--------|--------------|-------------|------------------|
//! | widths               | 2           | 1      |              |             | views, mean, widths |
//! | pool gloss           | 1           | 1      |              |             | base, mean, maps |
//! | lights held          | 3           | 4 or 2 | 4            |             | views, mean      |
//! | lights turn          | 8           | 4      | 4            |             | views, mean      |
//! | maps alone           | 1 only      | 1      | 8            |             | maps             |
//! | regress slopes       | 2           | 1      | 6            | 4 for 2     | mean, maps       |
//! | material classes     | 3           | 1      |              | 2           | mean, maps       |
//! | learned prior        | 2           | 1      |              | 4           | mean, widths     |
//! | maps, full size      | 1           | 1      | 6            |             | maps             |
//!
//! Steps are the solver's, of the maps; those at full size at most so many. All work on maps of at
//! most 256 texels a side but the last row, which larger ones get, and the structured prior's. Lights
//! are only looked for where they are not known well: held ones in photographs of which only their
//! rough place is known, or in a room that a smooth sample shows; they end early when they stay.

use super::options::ScheduleOptions;
use super::updates::{CLASS_TEXELS, NETWORK_TEXELS};

/// What changes the belief.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Fits the latent code.
    Latent,
    /// Asks whether photographs contradict the light as given; if so, chooses the widths of the structured
    /// prior by leaving photographs out, and fits it.
    Widths,
    /// Pools gloss of the base.
    PoolGloss,
    /// Corrects ambient light, or what a room mirrors.
    HeldLights,
    /// Corrects lights as well.
    TurningLights,
    /// Steps of the maps alone.
    Maps,
    /// Regresses slopes.
    Slopes,
    /// Infers material classes.
    Classes,
    /// Asks the learned prior.
    Network,
    /// The baseline without a prior.
    Baseline,
}

/// A row of the schedule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Row {
    pub phase: Phase,
    /// How often it runs, at most.
    pub rounds: usize,
    /// Steps of the maps before and after it, in each round.
    pub before: usize,
    pub after: usize,
    /// Whether the maps are those of the photographs' resolution.
    pub fine: bool,
}

impl Row {
    /// At the resolution that the phases work at.
    pub fn new(phase: Phase, rounds: usize, before: usize, after: usize) -> Self {
        Self { phase, rounds, before, after, fine: false }
    }
}

/// What the schedule depends on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Situation {
    pub photographs: usize,
    pub lights: LightsKnown,
    /// Whether the structured prior was chosen.
    pub structured: bool,
    /// Whether the phases work at a coarser resolution than that of the photographs.
    pub coarse: bool,
}

/// What is known of the lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LightsKnown {
    /// Well: by a board, in a dark room.
    Well,
    /// Well, but a smooth sample mirrors a room.
    InRoom,
    /// Roughly: lights and ambient light are to be corrected.
    Roughly,
}

/// The rows that run.
pub(crate) fn rows(situation: &Situation, options: &ScheduleOptions) -> Vec<Row> {
    let &Situation { photographs, lights, structured, coarse } = situation;
    let row = Row::new;
    let held_rounds = match lights {
        LightsKnown::Well => 0,
        LightsKnown::InRoom => 2,
        LightsKnown::Roughly => 4,
    };
    let turn_rounds = if lights == LightsKnown::Roughly { 4 } else { 0 };
    let width_rounds = usize::from(lights == LightsKnown::Roughly);
    // Classes have steps of their own.
    let slopes_after = if photographs < options.determined_from { 4 } else { 0 };
    let table = [
        (2, row(Phase::Widths, width_rounds, 0, 0)),
        (1, row(Phase::PoolGloss, 1, 0, 0)),
        (options.determined_from, row(Phase::HeldLights, held_rounds, 4, 0)),
        (options.turns_from, row(Phase::TurningLights, turn_rounds, 4, 0)),
        (1, row(Phase::Maps, usize::from(photographs == 1), 8, 0)),
        (2, row(Phase::Slopes, 1, 6, slopes_after)),
        (options.determined_from, row(Phase::Classes, 1, 0, 2)),
        (2, row(Phase::Network, 1, 0, 4)),
        (1, Row { fine: true, ..row(Phase::Maps, usize::from(coarse), 6, 0) }),
    ];
    let runs = |(from, row): &(usize, Row)| photographs >= *from && row.rounds > 0;
    let mut rows: Vec<Row> = table.into_iter().filter(runs).map(|(_, row)| row).collect();
    if structured {
        // The structured prior needs no other phase than steps of the maps.
        rows.retain(|row| row.phase == Phase::Widths);
        rows.push(Row { fine: true, ..row(Phase::Maps, 1, 8, 0) });
    }
    rows
}

/// Where in the schedule an estimate is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Position {
    pub row: usize,
    pub round: usize,
    pub part: Part,
}

/// A part of a row's round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Part {
    /// Steps of the maps before the phase.
    #[default]
    Before,
    /// The phase itself.
    Phase,
    /// Steps of the maps after it.
    After,
}

impl Position {
    /// The first part at or after this one that has work; `None` at the end.
    pub fn settled(mut self, rows: &[Row]) -> Option<Self> {
        loop {
            let row = rows.get(self.row)?;
            let has_work = match self.part {
                Part::Before => row.before > 0,
                Part::Phase => row.phase != Phase::Maps,
                Part::After => row.after > 0,
            };
            if has_work {
                return Some(self);
            }
            self = self.following(row);
        }
    }

    /// The next part, with or without work.
    pub fn following(self, row: &Row) -> Self {
        match self.part {
            Part::Before => Self { part: Part::Phase, ..self },
            Part::Phase => Self { part: Part::After, ..self },
            Part::After if self.round + 1 < row.rounds => {
                Self { round: self.round + 1, part: Part::Before, ..self }
            }
            Part::After => self.next_row(),
        }
    }

    /// The next row.
    pub fn next_row(self) -> Self {
        Self { row: self.row + 1, ..Self::default() }
    }
}

/// What a step costs, in milliseconds of two cores of a busy desktop processor: only their ratios
/// matter. The first number is without photographs, the second for each.
#[derive(Debug, Clone, Copy)]
struct Cost(f32, f32);

impl Cost {
    /// Of steps at 256 texels a side.
    const LATENT: Self = Self(45.0, 2.5);
    /// Of the gains of the maps as a whole, in the first step.
    const GAINS: Self = Self(115.0, 8.5);
    const MAPS: Self = Self(6.5, 2.2);
    const POOLING: Self = Self(15.0, 3.5);
    const SLOPES: Self = Self(45.0, 0.5);
    const WIDTHS: Self = Self(130.0, 155.0);
    const NETWORK: Self = Self(210.0, 1.0);
    /// Of a trial at 128 texels a side.
    const CLASS: Self = Self(35.0, 3.0);
    /// Of a step of lights on a grid of one size.
    const LIGHTS: Self = Self(25.0, 2.5);

    fn of(self, photographs: usize) -> f32 {
        self.0 + self.1 * photographs as f32
    }
}

/// Steps of the lights in a round, rounds of them, and trials of classes, on average.
const LIGHT_STEPS: f32 = 8.0;
const LIGHT_ROUNDS: f32 = 1.5;
const CLASS_TRIALS: f32 = 7.0;

/// Cost of a whole part of a row, from its beginning. Texels are those that the phases work at, and
/// all.
pub(crate) fn cost(row: &Row, part: Part, photographs: usize, [texels, all]: [usize; 2]) -> f32 {
    let texels = if row.fine { all } else { texels };
    let scale = |most: usize| texels.min(most) as f32 / (256.0 * 256.0);
    let steps = match part {
        Part::Before => row.before,
        Part::Phase => 0,
        Part::After => row.after,
    };
    let maps = scale(usize::MAX) * steps as f32 * Cost::MAPS.of(photographs);
    if part != Part::Phase {
        return maps;
    }
    match row.phase {
        Phase::HeldLights => LIGHT_STEPS * Cost::LIGHTS.of(photographs),
        Phase::TurningLights => 2.0 * LIGHT_STEPS * Cost::LIGHTS.of(photographs),
        Phase::Classes => {
            4.0 * scale(CLASS_TEXELS.pow(2)) * CLASS_TRIALS * Cost::CLASS.of(photographs)
        }
        Phase::Network => scale(NETWORK_TEXELS.pow(2)) * Cost::NETWORK.of(photographs),
        Phase::PoolGloss => scale(usize::MAX) * Cost::POOLING.of(photographs),
        Phase::Slopes => scale(usize::MAX) * Cost::SLOPES.of(photographs),
        Phase::Widths => Cost::WIDTHS.of(photographs),
        Phase::Maps | Phase::Latent | Phase::Baseline => 0.0,
    }
}

/// Cost of the latent code's steps that are done, and of all, for so many texels.
pub(crate) fn latent_cost([done, all]: [usize; 2], texels: usize, photographs: usize) -> [f32; 2] {
    let scale = texels as f32 / (256.0 * 256.0);
    let (step, gains) = (Cost::LATENT.of(photographs), Cost::GAINS.of(photographs));
    let cost = |steps: usize| scale * (step * steps as f32 + if steps > 0 { gains } else { 0.0 });
    [cost(done), cost(all)]
}

/// Rounds of a row that are left on average when so many have begun.
pub(crate) fn rounds_left(row: &Row, begun: usize) -> f32 {
    let left = row.rounds.saturating_sub(begun) as f32;
    match row.phase {
        Phase::HeldLights | Phase::TurningLights => {
            left.min((LIGHT_ROUNDS - begun as f32).max(0.0))
        }
        _ => left,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of small photographs, without the structured prior.
    fn situation(photographs: usize, lights: LightsKnown) -> Situation {
        Situation { photographs, lights, structured: false, coarse: false }
    }

    /// Parts of all rounds in their order.
    fn walk(rows: &[Row]) -> Vec<(Phase, Part)> {
        let mut parts = Vec::new();
        let mut position = Position::default().settled(rows);
        while let Some(at) = position {
            parts.push((rows[at.row].phase, at.part));
            position = at.following(&rows[at.row]).settled(rows);
        }
        parts
    }

    #[test]
    fn few_photographs_have_few_phases() {
        let options = ScheduleOptions::default();
        let one = walk(&rows(&situation(1, LightsKnown::Roughly), &options));
        let expected = [(Phase::PoolGloss, Part::Phase), (Phase::Maps, Part::Before)];
        assert_eq!(one, expected);
        let two = walk(&rows(&situation(2, LightsKnown::Roughly), &options));
        let expected = [
            (Phase::Widths, Part::Phase),
            (Phase::PoolGloss, Part::Phase),
            (Phase::Slopes, Part::Before),
            (Phase::Slopes, Part::Phase),
            (Phase::Slopes, Part::After),
            (Phase::Network, Part::Phase),
            (Phase::Network, Part::After),
        ];
        assert_eq!(two, expected);
    }

    #[test]
    fn rounds_repeat_and_lights_are_left_alone_where_they_are_known() {
        let options = ScheduleOptions::default();
        let count = |phase, lights, photographs| {
            let walked = walk(&rows(&situation(photographs, lights), &options));
            walked.iter().filter(|p| **p == (phase, Part::Phase)).count()
        };
        assert_eq!(count(Phase::Widths, LightsKnown::Well, 5), 0);
        assert_eq!(count(Phase::HeldLights, LightsKnown::Well, 9), 0);
        assert_eq!(count(Phase::HeldLights, LightsKnown::InRoom, 9), 2);
        assert_eq!(count(Phase::TurningLights, LightsKnown::InRoom, 9), 0);
        assert_eq!(count(Phase::TurningLights, LightsKnown::Roughly, 9), 4);
        assert_eq!(count(Phase::TurningLights, LightsKnown::Roughly, 7), 0);
    }

    #[test]
    fn large_photographs_get_steps_at_full_size_last() {
        let options = ScheduleOptions::default();
        for photographs in 1..9 {
            let small = situation(photographs, LightsKnown::Well);
            let large = rows(&Situation { coarse: true, ..small }, &options);
            let (last, others) = large.split_last().unwrap();
            assert!(last.fine && last.phase == Phase::Maps && others.iter().all(|row| !row.fine));
            assert_eq!(others, rows(&small, &options));
        }
    }

    #[test]
    fn the_structured_prior_needs_steps_of_the_maps_only() {
        let options = ScheduleOptions::default();
        let five = Situation { structured: true, ..situation(5, LightsKnown::Roughly) };
        let walked = walk(&rows(&five, &options));
        let expected = [(Phase::Widths, Part::Phase), (Phase::Maps, Part::Before)];
        assert_eq!(walked, expected);
    }
}
