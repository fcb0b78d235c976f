//! What a camera app can tell its user about an accepted photograph, and where to go next.

use glam::{DVec2, DVec3};

use crate::Rejection;
use crate::calibration::Target;
use crate::calibration::photometry::{Photometry, patch_values};
use crate::frame::Photo;
use crate::geometry::{Camera, Pose};

/// A view less than this from an earlier one, seen from the sample, shows nothing new, degrees.
const NEW_DEGREES: f64 = 2.0;
/// The same for the distance, relative.
const NEW_DISTANCE: f64 = 0.1;
/// Black over white as printed: ink on paper lies well inside.
const BLACK_OVER_WHITE: std::ops::RangeInclusive<f64> = 0.006..=0.2;
/// Gray patch over white one. As printed with the sRGB curve it is 0.21; printers differ widely.
const GRAY_OVER_WHITE: std::ops::RangeInclusive<f64> = 0.08..=0.4;
/// Half vectors this far off the vertical are what samples' slopes ask for (tangent of 20 degrees).
const SLOPE_MAX: f64 = 0.36;
/// Points of the sample along each side, and of the disc of slopes along its diameter.
const POINTS: u32 = 5;
const SLOPES: i32 = 9;
/// Angles off the vertical that are proposed, degrees.
const TILTS: [f64; 5] = [0.0, 12.0, 24.0, 36.0, 45.0];
const AZIMUTHS: u32 = 16;
/// The same of those that are told by what they would show.
const REACH: [f64; 5] = [10.0, 20.0, 30.0, 40.0, 50.0];

/// Something to tell about a photograph that was accepted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Hint {
    /// An earlier photograph has nearly the same view.
    #[error("photo {} has nearly the same view: move the camera", index + 1)]
    NothingNew {
        /// Its number among the accepted ones, from 0.
        index: usize,
    },
    /// The board's grays do not come out as linear values of a print do.
    #[error("the pixel values are not linear ({what} is {ratio:.3} of white): {}", remedy(*undone))]
    NotLinear {
        /// What was looked at: `black` or `gray`.
        what: &'static str,
        /// Its value, as the file has it, over that of white.
        ratio: f32,
        /// Whether a tone curve that explains it was found and undone; the photograph is then as good
        /// as a linear one, or nearly so.
        undone: bool,
    },
    /// What is known better now asks for an earlier photograph to be rectified anew, and it cannot be.
    #[error("photo {} stays rectified as it was: {rejection}", index + 1)]
    NotRemade {
        /// Its number among the accepted ones, from 0.
        index: usize,
        /// What speaks against it.
        rejection: Rejection,
    },
}

fn remedy(undone: bool) -> &'static str {
    if undone {
        "the camera's tone curve was estimated and undone"
    } else {
        "no tone curve could be found that explains it; turn tone mapping off, check `encoding`"
    }
}

impl Hint {
    /// Stable name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NothingNew { .. } => "nothing_new",
            Self::NotLinear { .. } => "not_linear",
            Self::NotRemade { .. } => "not_remade",
        }
    }
}

/// Where the next photograph tells most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextView {
    /// Unit vector from the sample towards the camera, board frame.
    pub direction: [f32; 3],
    /// Angle off the vertical, degrees.
    pub tilt_deg: f32,
    /// Side to go to: degrees counter-clockwise from the sample's +X.
    pub azimuth_deg: f32,
}

/// The earlier photograph with nearly the same view.
pub(super) fn nothing_new(earlier: &[Pose], new: &Pose) -> Option<Hint> {
    let centre = new.camera_centre();
    let same = |pose: &Pose| {
        let other = pose.camera_centre();
        other.angle_between(centre).to_degrees() < NEW_DEGREES
            && (other.length() / centre.length()).ln().abs() < NEW_DISTANCE
            // Turned about the line of sight the flash comes from elsewhere.
            && turn(pose, new).to_degrees() < 4.0 * NEW_DEGREES
    };
    earlier.iter().position(same).map(|index| Hint::NothingNew { index })
}

fn turn(a: &Pose, b: &Pose) -> f64 {
    let r = a.rotation * b.rotation.transpose();
    (0.5 * (r.x_axis.x + r.y_axis.y + r.z_axis.z - 1.0)).clamp(-1.0, 1.0).acos()
}

/// Whether black squares and the gray patch have the values of linear photographs, or have them now
/// that the camera's tone curve is undone.
pub(super) fn linearity(
    photo: &Photo,
    target: &Target,
    camera: &Camera,
    pose: &Pose,
    photometry: &Photometry,
) -> Option<Hint> {
    let nominal = target.black_albedo / target.white_albedo;
    let black = nominal * photometry.black_ratio.iter().sum::<f64>() / 3.0;
    // Without an estimate of the black squares the ratio is the nominal one.
    let hint = |what, ratio: f64, undone| {
        let ratio = photometry.tone.stored_ratio(ratio as f32);
        Some(Hint::NotLinear { what, ratio, undone })
    };
    if nominal > 0.0 && !BLACK_OVER_WHITE.contains(&black) {
        return hint("black", black, false);
    }
    if let Some(gray) = gray_over_white(photo, target, camera, pose, photometry)
        && !GRAY_OVER_WHITE.contains(&gray)
    {
        return hint("gray", gray, false);
    }
    if photometry.tone.is_identity() { None } else { hint("black", black, true) }
}

/// Linear value of the gray patch over that of the white one; `None` where they are not seen: they are
/// out of view or covered, or the board was printed without them.
fn gray_over_white(
    photo: &Photo,
    target: &Target,
    camera: &Camera,
    pose: &Pose,
    photometry: &Photometry,
) -> Option<f64> {
    let [_, gray, white] = patch_values(photo, target, camera, pose)?;
    let linear = |value: [f64; 3]| {
        let linear = photometry.tone.undone(value.map(|v| v as f32));
        Some(linear.into_iter().map(f64::from).sum::<f64>()).filter(|v| *v > 0.0)
    };
    Some(linear(gray)? / linear(white)?)
}

/// The direction from which highlights reach most of the slopes that they have not swept yet.
///
/// A texel is bright where its normal is near the half vector between light and camera. For points
/// over the sample the slopes of the half vectors so far are known; slopes far from all of them
/// are dark in every photograph and tell nothing about gloss. The view is proposed whose half
/// vectors, with the flash at its place beside the lens, come nearest to most of them.
pub(super) fn next_view(
    views: &[Pose],
    flash_offset_mm: DVec3,
    sample_mm: [f32; 2],
) -> Option<NextView> {
    let distance = usual_distance(views)?;
    let half = |camera: DVec3, light: DVec3, p: DVec3| {
        let h = (camera - p).normalize() + (light - p).normalize();
        h.truncate() / h.z.max(1e-3)
    };
    let points: Vec<DVec3> = (0..POINTS * POINTS)
        .map(|i| {
            let at = |k: u32| f64::from(k) / f64::from(POINTS - 1) - 0.5;
            let (x, y) = (at(i % POINTS), at(i / POINTS));
            DVec3::new(x * f64::from(sample_mm[0]), y * f64::from(sample_mm[1]), 0.0)
        })
        .collect();
    let slopes: Vec<DVec2> = (0..SLOPES * SLOPES)
        .map(|i| DVec2::new(f64::from(i % SLOPES), f64::from(i / SLOPES)))
        .map(|s| (s * 2.0 / f64::from(SLOPES - 1) - 1.0) * SLOPE_MAX)
        .filter(|s| s.length() <= SLOPE_MAX * 1.01)
        .collect();
    // Squared distance of each slope at each point from the nearest half vector so far.
    let nearest: Vec<Vec<f64>> = points
        .iter()
        .map(|p| {
            let seen: Vec<DVec2> = views
                .iter()
                .map(|v| half(v.camera_centre(), v.to_board(flash_offset_mm), *p))
                .collect();
            let least = |s: &DVec2| {
                seen.iter().map(|h| h.distance_squared(*s)).fold(f64::INFINITY, f64::min)
            };
            slopes.iter().map(least).collect()
        })
        .collect();
    let mut best: Option<(f64, NextView)> = None;
    for tilt in TILTS {
        for k in 0..if tilt == 0.0 { 1 } else { AZIMUTHS } {
            let azimuth = 360.0 * f64::from(k) / f64::from(AZIMUTHS);
            let Candidate { view, camera_mm, light_mm } =
                Candidate::new(tilt, azimuth, distance, flash_offset_mm);
            let gain: f64 = points
                .iter()
                .zip(&nearest)
                .map(|(p, nearest)| {
                    let h = half(camera_mm, light_mm, *p);
                    let closer = |(s, n): (&DVec2, &f64)| (n - h.distance_squared(*s)).max(0.0);
                    slopes.iter().zip(nearest).map(closer).sum::<f64>()
                })
                .sum();
            if best.is_none_or(|b| gain > b.0 * (1.0 + 1e-9)) {
                best = Some((gain, view));
            }
        }
    }
    best.map(|b| b.1)
}

/// A view that may be proposed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) view: NextView,
    pub(super) camera_mm: DVec3,
    pub(super) light_mm: DVec3,
}

impl Candidate {
    fn new(tilt: f64, azimuth: f64, distance: f64, flash_offset_mm: DVec3) -> Self {
        let (s, c) = tilt.to_radians().sin_cos();
        let (sa, ca) = azimuth.to_radians().sin_cos();
        let direction = DVec3::new(s * ca, s * sa, c);
        let camera_mm = distance * direction;
        // Held upright as seen from that side; the flash is beside the lens.
        let right = DVec3::Z.cross(direction).try_normalize().unwrap_or(DVec3::X);
        let down = -direction.cross(right);
        let light_mm = camera_mm + flash_offset_mm.x * right + flash_offset_mm.y * down;
        let view = NextView {
            direction: direction.as_vec3().to_array(),
            tilt_deg: tilt as f32,
            azimuth_deg: azimuth as f32,
        };
        Self { view, camera_mm, light_mm }
    }
}

/// Views within reach of a hand, at the distance of those so far; `None` before the first.
pub(super) fn candidates(views: &[Pose], flash_offset_mm: DVec3) -> Option<Vec<Candidate>> {
    let distance = usual_distance(views)?;
    let sides = (0..AZIMUTHS).map(|k| 360.0 * f64::from(k) / f64::from(AZIMUTHS));
    let of =
        |tilt| sides.clone().map(move |side| Candidate::new(tilt, side, distance, flash_offset_mm));
    Some(REACH.into_iter().flat_map(of).collect())
}

/// Median distance of the camera.
fn usual_distance(views: &[Pose]) -> Option<f64> {
    let mut distances: Vec<f64> = views.iter().map(|v| v.camera_centre().length()).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::photometry::tests::pose;
    use crate::frame::{Encoding, ToneCurve};

    fn from(direction: DVec3, distance: f64) -> Pose {
        let z = -direction.normalize();
        let x = DVec3::Y.cross(z).try_normalize().unwrap_or(DVec3::X);
        let rotation = glam::DMat3::from_cols(x, z.cross(x), z).transpose();
        Pose { rotation, translation: DVec3::new(0.0, 0.0, distance) }
    }

    #[test]
    fn the_same_view_is_nothing_new() {
        let first = pose(0.2, 0.1, 0.0, 300.0);
        let hint = nothing_new(&[pose(0.6, 0.1, 0.0, 300.0), first], &first);
        assert_eq!(hint, Some(Hint::NothingNew { index: 1 }));
        assert_eq!(nothing_new(&[first], &pose(0.3, 0.1, 0.0, 300.0)), None);
        assert_eq!(nothing_new(&[first], &pose(0.2, 0.1, 0.0, 400.0)), None);
    }

    #[test]
    fn photographs_that_are_not_linear_are_told() {
        use crate::calibration::photometry::tests::{camera, photograph};
        use crate::calibration::photometry::{Lobe, Vignetting};
        let (camera, pose) = (camera(), pose(0.3, 0.1, 0.0, 420.0));
        let target = Target::default();
        let albedo = |p: DVec2| {
            let patch = target
                .patches()
                .into_iter()
                .find(|q| (p - q.centre_mm).abs().max_element() < 0.5 * q.side_mm);
            if let Some(patch) = patch {
                return 0.04 + 0.76 * Encoding::Srgb.decode(patch.gray);
            }
            let row = (0.5 * f64::from(target.rows) - p.y / target.square_mm).floor() as i64;
            let col = (p.x / target.square_mm + 0.5 * f64::from(target.cols)).floor() as i64;
            let black = target.has_square(row, col) && !target.is_white(row, col);
            if black { target.black_albedo } else { target.white_albedo }
        };
        let light = pose.camera_centre();
        // What the squares told, blacks being so many times what the target says.
        let known = |ratio| Photometry {
            tone: ToneCurve::default(),
            tone_sigma: [0.0; 3],
            vignetting: Vignetting::default(),
            lobe: Lobe::default(),
            ambient: [0.0; 3],
            ambient_raw: [(0.0, 0.0); 3],
            flash_offset_mm: DVec3::ZERO,
            flash_offset_sigma_mm: DVec3::ZERO,
            reference_mm: 400.0,
            log_scale: vec![[0.0; 3]],
            photo_sigma: vec![0.01],
            black_ratio: [ratio; 3],
            sigma: 0.01,
        };
        let hint = |curve: &dyn Fn(f64) -> f64| {
            let rgb = photograph(&camera, &pose, 2, |p, _| {
                let to_light = light - p.extend(0.0);
                let cosine = to_light.normalize().z;
                [1e5 * albedo(p) * cosine / to_light.length_squared(); 3]
            });
            let rgb = rgb.into_iter().map(|v| curve(f64::from(v)) as f32).collect();
            let photo = Photo::from_linear(camera.width, camera.height, rgb, 1.0, 9.0).unwrap();
            linearity(&photo, &target, &camera, &pose, &known(1.0)).map(|h| h.to_string())
        };
        assert_eq!(hint(&|v| v), None);
        // Encoded values taken for linear ones: the gray of 0.2 becomes one of 0.5.
        let said = hint(&|v| v.powf(1.0 / 2.2)).unwrap();
        assert!(said.contains("gray is 0.5") && said.contains("turn tone mapping off"), "{said}");
        let said = hint(&|v| v.powf(2.2)).unwrap();
        assert!(said.contains("gray is 0.0"), "{said}");
        // The same with a curve known that undoes it.
        let rgb = |curve: &dyn Fn(f64) -> f64| {
            let linear = photograph(&camera, &pose, 2, |p, _| [0.9 * albedo(p); 3]);
            linear.into_iter().map(|v| curve(f64::from(v)) as f32).collect()
        };
        let photo = |rgb| Photo::from_linear(camera.width, camera.height, rgb, 1.0, 9.0).unwrap();
        let tone = ToneCurve { log_slopes: [2.2_f64.ln(); 3], unknown_from: 0.0 };
        let curved = Photometry { tone, ..known(1.0) };
        let encoded = photo(rgb(&|v| v.powf(1.0 / 2.2)));
        let said = linearity(&encoded, &target, &camera, &pose, &curved).unwrap();
        // 0.0625 as the file has it.
        let Hint::NotLinear { what: "black", ratio, undone: true } = said else { panic!("{said}") };
        assert!((ratio - 0.0625_f32.powf(1.0 / 2.2)).abs() < 0.002, "{ratio}");
        assert!(said.to_string().contains("estimated and undone"), "{said}");
        // A curve that does not: linear values look like those of another curve then.
        let said = linearity(&photo(rgb(&|v| v)), &target, &camera, &pose, &curved).unwrap();
        assert!(matches!(said, Hint::NotLinear { undone: false, .. }), "{said}");
        // Black squares alone tell it too: 0.0625 as printed.
        let plain = Target { patches: false, ..target.clone() };
        for (ratio, odd) in [(1.0, false), (4.0, true), (0.05, true)] {
            let known = known(ratio);
            let photo = Photo::from_linear(1, 1, vec![0.5; 3], 1.0, 9.0).unwrap();
            let said = linearity(&photo, &plain, &camera, &pose, &known);
            assert_eq!(said.is_some(), odd, "{ratio}");
        }
    }

    #[test]
    fn views_go_where_none_was_and_round_the_sample() {
        assert_eq!(next_view(&[], DVec3::ZERO, [100.0; 2]), None);
        let mut views = vec![from(DVec3::Z, 250.0)];
        let mut sides = Vec::new();
        for _ in 0..4 {
            let next = next_view(&views, DVec3::ZERO, [100.0; 2]).unwrap();
            let direction = DVec3::from_array(next.direction.map(f64::from));
            let near = |v: &Pose| v.camera_centre().angle_between(direction).to_degrees();
            assert!(views.iter().all(|v| near(v) > 8.0), "{next:?}");
            sides.push(next.azimuth_deg);
            views.push(from(direction, 250.0));
        }
        // The second goes to the other side of the first.
        let apart = (sides[0] - sides[1]).abs();
        assert!((120.0..=240.0).contains(&apart), "{sides:?}");
    }
}
