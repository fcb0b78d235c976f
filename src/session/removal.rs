//! Photographs that are taken back, and what each of them is worth.

use std::sync::PoisonError;

use crossbeam_channel::bounded;

use super::Session;
use super::intake::{Intake, Remaining};
use super::reports::FrameFit;
use super::settings::Settings;
use super::worker::{Command, Removal};
use crate::{Error, Result};

/// Photographs from which on one may stand out.
const OUTLIER_FROM: usize = 4;
/// A residual stands out that is so many robust standard deviations above the median, and so many
/// times as large: of photographs that agree, deviations are tiny.
const OUTLIER_SIGMA: f32 = 5.0;
const OUTLIER_RATIO: f32 = 1.5;
/// Standard deviation of a normal distribution over its median absolute deviation.
const MAD_TO_SIGMA: f32 = 1.4826;

impl Session {
    /// Takes an accepted photograph back: the session is as if it had never come, calibration
    /// included. `index` counts the accepted photographs from 0; later ones move up by one. The fit
    /// begins anew with the photographs that are left, and when this returns, maps that do not
    /// know of it are available: those that the first photograph left gives. Without any left, there are none.
    ///
    /// What is left is taken in again from what is kept of it. Views are rectified from parts of photographs,
    /// or brought to the new light as half floats, and squares of the board are not measured again: maps are
    /// those of a session without the photograph but for rounding. With rectified photographs they are
    /// the same to the bit. Once a session with a given camera has settled on paper and height of
    /// the sample (see [`Scene`](super::Scene)), these stay.
    ///
    /// Waits for a push, and for a step of the fit.
    ///
    /// # Errors
    /// [`Error::Argument`] for `index` when there is no such photograph, or when another one would have
    /// been rejected without it; when the session has failed or was cancelled. Nothing has changed then.
    pub fn remove_frame(&self, index: usize) -> Result<()> {
        self.usable()?;
        let mut intake = self.intake.lock().unwrap_or_else(PoisonError::into_inner);
        let frames = self.shared.lock().progress.frames;
        if index >= frames {
            let message = format!("{index} given, but there are {frames} photographs");
            return Err(Error::argument("index", message));
        }
        let Settings { sample_mm, resolution, .. } = self.settings;
        let left = self.pool.install(|| intake.without(index, frames, sample_mm, resolution));
        let Remaining { intake: mut fresh, updates, power } =
            left.map_err(|(other, rejection)| {
                let why = format!("photograph {other} cannot be used without it: {rejection}");
                Error::argument("index", why)
            })?;
        let (reply, answer) = bounded(1);
        let removal = Removal { index, updates, power, reply };
        let found = self.ask(Command::Remove(Box::new(removal)), &answer);
        let Some(power_mm2) = found else {
            return Err(self.usable().err().unwrap_or(Error::Cancelled));
        };
        if let Intake::Rectified { power_mm2: kept, .. } = &mut fresh
            && power
        {
            *kept = power_mm2;
        }
        *intake = fresh;
        self.remember(&intake);
        Ok(())
    }

    /// How the maps of the moment explain each accepted photograph, and whether one contradicts the
    /// others. Empty before the first. Waits for a step of the fit.
    ///
    /// # Errors
    /// When the session has failed or was cancelled.
    pub fn frame_fits(&self) -> Result<Vec<FrameFit>> {
        self.usable()?;
        let (reply, answer) = bounded(1);
        let Some(residuals) = self.ask(Command::Residuals(reply), &answer) else {
            return Err(self.usable().err().unwrap_or(Error::Cancelled));
        };
        let limit = limit(residuals.iter().map(|r| r.median).collect());
        let fit = |r: &crate::estimate::Residual| FrameFit {
            residual: r.median,
            weight: r.weight,
            outlier: r.median > limit,
            part: r.part,
        };
        Ok(residuals.iter().map(fit).collect())
    }
}

/// The residual above which a photograph stands out.
fn limit(mut residuals: Vec<f32>) -> f32 {
    if residuals.len() < OUTLIER_FROM {
        return f32::INFINITY;
    }
    let median = |values: &mut Vec<f32>| {
        values.sort_by(f32::total_cmp);
        values[(values.len() - 1) / 2]
    };
    let middle = median(&mut residuals);
    let mut off: Vec<f32> = residuals.iter().map(|r| (r - middle).abs()).collect();
    let sigma = MAD_TO_SIGMA * median(&mut off);
    (middle + OUTLIER_SIGMA * sigma).max(OUTLIER_RATIO * middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_out_is_above_the_limit() {
        assert_eq!(limit(vec![0.01, 0.01, 0.5]), f32::INFINITY);
        let limit_of = |values: &[f32]| limit(values.to_vec());
        assert!(limit_of(&[0.02, 0.021, 0.019, 0.2]) < 0.1);
        // Photographs that agree well do not differ enough to matter.
        assert!(limit_of(&[0.01, 0.01, 0.01, 0.012]) > 0.012);
        assert!(limit_of(&[0.02, 0.05, 0.03, 0.06]) > 0.06);
    }
}
