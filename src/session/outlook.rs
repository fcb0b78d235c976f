//! Where the next photograph tells most.

use std::sync::{Arc, PoisonError};

use crossbeam_channel::bounded;

use super::feedback::{self, NextView};
use super::worker::Command;
use super::{Pose, Session};
use crate::estimate::Place;

impl Session {
    /// Where the next photograph tells most: the view within reach of a hand, 10 to 50 degrees off the
    /// top, that lowers the expected error of renderings most, by what photographs have left open of
    /// the maps of the moment. `None` before the first photograph, and for rectified ones. Probes
    /// refer to it from then on.
    ///
    /// Waits for a push and a step of the fit. Where the fit has failed or was cancelled, the view whose
    /// highlights reach slopes of the sample that none has swept.
    pub fn next_view(&self) -> Option<NextView> {
        let (views, flash_mm) = {
            let intake = self.intake.lock().unwrap_or_else(PoisonError::into_inner);
            let views: Vec<Pose> = intake.poses().into_iter().map(|p| p.pose).collect();
            (views, intake.flash_offset_mm())
        };
        let candidates = feedback::candidates(&views, flash_mm)?;
        let places = candidates.iter().map(|candidate| Place {
            camera_mm: candidate.camera_mm.as_vec3().to_array(),
            light_mm: candidate.light_mm.as_vec3().to_array(),
        });
        let next = match self.outlook(places.collect()) {
            Some(gains) => {
                let best = gains.iter().zip(&candidates).max_by(|a, b| a.0.total_cmp(b.0));
                best.map(|(_, candidate)| candidate.view)
            }
            None => feedback::next_view(&views, flash_mm, self.settings.sample_mm),
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        // A photograph may have come meanwhile.
        if let Some(known) = known.as_mut().filter(|known| known.poses == views) {
            Arc::make_mut(known).next = next;
        }
        next
    }

    /// By how much a photograph from each of some places lowers the expected error; `None` where the
    /// fit does not answer.
    fn outlook(&self, places: Vec<Place>) -> Option<Vec<f64>> {
        self.usable().ok()?;
        let (reply, answer) = bounded(1);
        self.commands.send(Command::Outlook(places, reply)).ok()?;
        answer.recv().ok()?.ok()
    }
}
