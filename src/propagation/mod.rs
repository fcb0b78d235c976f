//! What highlights tell of some texels, told to those that no highlight has swept.
//!
//! Roughness and specular albedo show only where a photograph looks into the lobe. Texels of the
//! same diffuse colour are mostly the same stuff, so the gloss of those that were seen is a better
//! guess for the others than what the fit started from. Each texel's value and its group's are
//! averaged by their precisions: what the photographs tell of the texel whatever its other
//! parameters are (a matt lobe may as well be diffuse albedo) and a broad belief in the fit, against
//! the spread within the group.
//!
//! Averages do not help where the fit has settled on a wrong kind of gloss, so from a few
//! photographs on the kinds that highlights have shown compete for every texel, see
//! [`choose_glosses`]. Slopes are told from texel to texel by [`propagate_slopes`].

mod colours;
mod kinds;
mod slopes;

pub use kinds::choose_glosses;
pub use slopes::propagate_slopes;

use crate::observation::Observation;
use crate::parallel;
use crate::refinement::{self, Evidence, GLOSS, Prior, evidence};
use crate::svbrdf::channel;
use crate::{Result, Svbrdf};
use colours::Membership;

/// Log residual that one photograph's model error and noise leave.
const NOISE: f32 = 0.1;
/// How far the fit may be off where nothing was seen: roughness, root of specular albedo.
const DEVIATION: [f32; 2] = [0.25, 0.15];

/// Moves roughness and specular albedo of texels that the photographs say little of towards those
/// of texels of like diffuse albedo of which they say more.
///
/// # Errors
/// When sizes differ.
pub fn propagate(maps: &mut Svbrdf, observations: &[Observation]) -> Result<()> {
    crate::render::check_observations(maps, observations)?;
    let evidence = gloss_evidence(maps, observations);
    let members = Membership::new(maps);
    for (gloss, seen) in Gloss::all().into_iter().zip(evidence.precision()) {
        let own = gloss.own();
        let values = gloss.read(maps);
        let groups = members.statistics(&values, |t| seen[t] / (seen[t] + own));
        gloss.write(maps, |t| {
            let [precision, sum] = members.told(t, &groups);
            let trusted = seen[t] + own;
            (sum + trusted * values[t]) / (precision + trusted)
        });
    }
    maps.clamp();
    Ok(())
}

/// Moves roughness and specular albedo of an estimate by what a refinement from there has found
/// of texels of like diffuse albedo, as far as the photographs told it: the mean for another
/// refinement. Where a highlight has shown that the estimate is too smooth, it is too smooth beside
/// the highlight as well.
///
/// # Errors
/// When sizes differ.
pub fn propagate_corrections(
    estimate: &mut Svbrdf,
    refined: &Svbrdf,
    observations: &[Observation],
) -> Result<()> {
    crate::render::check_observations(estimate, observations)?;
    crate::render::check_observations(refined, observations)?;
    let evidence = gloss_evidence(refined, observations);
    let members = Membership::new(refined);
    for (gloss, seen) in Gloss::all().into_iter().zip(evidence.precision()) {
        let own = gloss.own();
        let values = gloss.read(estimate);
        let mut corrections = gloss.read(refined);
        corrections.iter_mut().zip(&values).for_each(|(v, before)| *v -= before);
        let groups = members.statistics(&corrections, |t| seen[t] / (seen[t] + own));
        gloss.write(estimate, |t| {
            let [precision, sum] = members.told(t, &groups);
            values[t] + sum / (precision + own)
        });
    }
    estimate.clamp();
    Ok(())
}

/// What the photographs tell of each [`Gloss`] of every texel.
fn gloss_evidence(maps: &Svbrdf, observations: &[Observation]) -> Evidence {
    let mut prior = Prior::default();
    for gloss in Gloss::all() {
        prior.sigma[gloss.plane] = gloss.deviation();
    }
    let options = refinement::Options { noise: NOISE, huber: NOISE, ..Default::default() };
    evidence(maps, maps, &prior, observations, &options)
}

/// A plane of what highlights tell: roughness, or the root of a specular albedo.
#[derive(Clone, Copy)]
struct Gloss {
    plane: usize,
}

impl Gloss {
    fn all() -> [Self; 4] {
        GLOSS.map(|plane| Self { plane })
    }

    fn is_roughness(self) -> bool {
        self.plane == channel::ROUGHNESS
    }

    fn deviation(self) -> f32 {
        DEVIATION[usize::from(!self.is_roughness())]
    }

    /// Precision of the fit where nothing was seen.
    fn own(self) -> f32 {
        self.deviation().powi(-2)
    }

    fn read(self, maps: &Svbrdf) -> Vec<f32> {
        let plane = maps.plane(self.plane).iter();
        if self.is_roughness() {
            plane.copied().collect()
        } else {
            plane.map(|v| v.max(0.0).sqrt()).collect()
        }
    }

    fn write(self, maps: &mut Svbrdf, value: impl Fn(usize) -> f32 + Sync) {
        let width = maps.width();
        parallel::parts(maps.plane_mut(self.plane).chunks_mut(width), |y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let value = value(y * width + x).max(0.0);
                *out = if self.is_roughness() { value } else { value * value };
            }
        });
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::observation::{Falloff, View};
    use crate::render::render;

    const SIDE: usize = 64;

    /// Stripes of two colours, each with its own gloss.
    fn truth() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        for t in 0..SIDE * SIDE {
            let red = (t % SIDE / 8).is_multiple_of(2);
            maps.plane_mut(channel::ROUGHNESS)[t] = if red { 0.2 } else { 0.45 };
            for c in 0..3 {
                maps.plane_mut(channel::DIFFUSE + c)[t] =
                    if red { [0.4, 0.1, 0.1][c] } else { [0.1, 0.2, 0.4][c] };
            }
        }
        maps
    }

    /// A photograph of known maps, 100 mm a side, with camera and light 100 mm above `at`.
    pub(crate) fn photograph(truth: &Svbrdf, at: [f32; 2]) -> Observation {
        let (width, height) = (truth.width(), truth.height());
        let at = [at[0], at[1], 100.0];
        let falloff = Falloff::None { power: [std::f32::consts::PI; 3] };
        let view = View {
            sample_mm: [100.0; 2],
            camera_mm: at,
            light_mm: at,
            falloff,
            ambient: [0.0; 3],
            mirrored: 1.0,
        };
        let mut radiance = vec![0.0; 3 * truth.texels()];
        render(truth, &view, &mut radiance);
        Observation::new(width, height, view, &radiance, &vec![1.0; truth.texels()]).unwrap()
    }

    fn observation(truth: &Svbrdf) -> Observation {
        photograph(truth, [-30.0, 0.0])
    }

    #[test]
    fn gloss_spreads_within_a_colour_and_no_further() {
        let truth = truth();
        let mut maps = truth.clone();
        // right where the highlight is, unknown elsewhere
        for (t, v) in maps.plane_mut(channel::ROUGHNESS).iter_mut().enumerate() {
            if t % SIDE > 3 * SIDE / 4 {
                *v = 0.8;
            }
        }
        propagate(&mut maps, &[observation(&truth)]).unwrap();
        for (t, (v, r)) in
            maps.plane(channel::ROUGHNESS).iter().zip(truth.plane(channel::ROUGHNESS)).enumerate()
        {
            assert!((v - r).abs() < 0.12, "{t}: {v} {r}");
        }
    }

    #[test]
    fn a_correction_under_the_highlight_reaches_its_colour() {
        let refined = truth();
        let mut estimate = truth();
        let observation = observation(&refined);
        let red = |t: usize| (t % SIDE / 8).is_multiple_of(2);
        let wrong = |t: usize| if red(t) { 0.25 } else { 0.0 };
        for (t, v) in estimate.plane_mut(channel::ROUGHNESS).iter_mut().enumerate() {
            *v += wrong(t);
        }
        // the refinement has mended what lies under the light, left of the middle
        let mut found = refined.clone();
        for (t, v) in found.plane_mut(channel::ROUGHNESS).iter_mut().enumerate() {
            *v += if t % SIDE > SIDE / 2 { wrong(t) } else { 0.0 };
        }
        propagate_corrections(&mut estimate, &found, &[observation]).unwrap();
        let pairs =
            estimate.plane(channel::ROUGHNESS).iter().zip(refined.plane(channel::ROUGHNESS));
        for (t, (v, r)) in pairs.enumerate() {
            assert!((v - r).abs() < 0.12, "{t}: {v} {r}");
        }
    }

    #[test]
    fn nothing_seen_nothing_moved() {
        let mut maps = truth();
        let before = maps.clone();
        let observation = observation(&maps).changed(|_, weight| weight.fill(0.0));
        propagate(&mut maps, &[observation]).unwrap();
        let most = |(a, b): (&f32, &f32)| (a - b).abs();
        let difference = maps.planes().iter().zip(before.planes()).map(most).fold(0.0f32, f32::max);
        assert!(difference < 1e-5, "{difference}");
    }
}
