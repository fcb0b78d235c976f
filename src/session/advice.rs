//! Hints about a single photograph: its view and its pixel values.

use super::hint::Hint;
use crate::calibration::Target;
use crate::calibration::photometry::{Photometry, Squares};
use crate::geometry::Pose;

/// A view shows nothing new if it differs from an earlier one by less than this angle at the sample, degrees, ...
const NEW_DEGREES: f64 = 2.0;
/// ... and by less than this distance, relative.
const NEW_DISTANCE: f64 = 0.1;
/// Plausible ratios of black to white; ink on paper lies well inside.
const BLACK_OVER_WHITE: std::ops::RangeInclusive<f64> = 0.006..=0.2;
/// Plausible ratios of the gray patch to the white one. The sRGB curve gives 0.21; printers differ widely.
const GRAY_OVER_WHITE: std::ops::RangeInclusive<f64> = 0.08..=0.4;

/// The hint about an earlier photograph with nearly the same view.
pub(super) fn nothing_new(earlier: &[Pose], new: &Pose) -> Option<Hint> {
    let centre = new.camera_centre();
    let turn = |pose: &Pose| {
        let r = pose.rotation * new.rotation.transpose();
        (0.5 * (r.x_axis.x + r.y_axis.y + r.z_axis.z - 1.0)).clamp(-1.0, 1.0).acos()
    };
    let same = |pose: &Pose| {
        let other = pose.camera_centre();
        other.angle_between(centre).to_degrees() < NEW_DEGREES
            && (other.length() / centre.length()).ln().abs() < NEW_DISTANCE
            // Turned about the line of sight, the flash comes from another direction.
            && turn(pose).to_degrees() < 4.0 * NEW_DEGREES
    };
    earlier.iter().position(same).map(|index| Hint::NothingNew { index })
}

/// The hint if black squares or the gray patch do not have linear values, or have them only without the camera's tone
/// curve.
pub(super) fn linearity(
    squares: &Squares,
    target: &Target,
    photometry: &Photometry,
) -> Option<Hint> {
    let nominal = target.black_albedo / target.white_albedo;
    let black = nominal * photometry.black_ratio.iter().sum::<f64>() / 3.0;
    // The nominal ratio if the black squares were not estimated.
    let hint = |what, ratio: f64, undone| {
        let ratio = photometry.tone.stored_ratio(ratio as f32);
        Some(Hint::NotLinear { what, ratio, undone })
    };
    if nominal > 0.0 && !BLACK_OVER_WHITE.contains(&black) {
        return hint("black", black, false);
    }
    // `None` for patches out of view, covered or not printed.
    let linear =
        |value: [f32; 3]| photometry.tone.undone(value).into_iter().map(f64::from).sum::<f64>();
    let [_, gray, white] = squares.patches.unwrap_or_default().map(linear);
    let ratio = gray / white;
    if gray > 0.0 && white > 0.0 && !GRAY_OVER_WHITE.contains(&ratio) {
        return hint("gray", ratio, false);
    }
    if photometry.tone.is_identity() { None } else { hint("black", black, true) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::photometry::tests::pose;
    use crate::photo::{Encoding, Photo, ToneCurve};
    use glam::{DVec2, DVec3};

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
        // Black squares `ratio` times as bright as the target states.
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
            log_gain: vec![[0.0; 2]],
            turned: vec![false],
            veil: 0.0,
            veil_sigma: 0.0,
            local_tone: 0.0,
            local_scale: 0,
            photo_sigma: vec![0.01],
            black_ratio: [ratio; 3],
            sigma: 0.01,
        };
        let measured =
            |photo: &Photo| Squares::measure(photo, &target, &camera, &pose, 0.0).unwrap();
        let hint = |curve: &dyn Fn(f64) -> f64| {
            let rgb = photograph(&camera, &pose, 2, |p, _| {
                let to_light = light - p.extend(0.0);
                let cosine = to_light.normalize().z;
                [1e5 * albedo(p) * cosine / to_light.length_squared(); 3]
            });
            let rgb = rgb.into_iter().map(|v| curve(f64::from(v)) as f32).collect();
            let photo = Photo::from_linear(camera.width, camera.height, rgb, 1.0, 9.0).unwrap();
            linearity(&measured(&photo), &target, &known(1.0)).map(|h| h.to_string())
        };
        assert_eq!(hint(&|v| v), None);
        // sRGB values read as linear: the gray of 0.2 becomes one of 0.5.
        let said = hint(&|v| v.powf(1.0 / 2.2)).unwrap();
        assert!(said.contains("gray is 0.5") && said.contains("turn tone mapping off"), "{said}");
        let said = hint(&|v| v.powf(2.2)).unwrap();
        assert!(said.contains("gray is 0.0"), "{said}");
        // The same with a known curve that undoes it.
        let rgb = |curve: &dyn Fn(f64) -> f64| {
            let linear = photograph(&camera, &pose, 2, |p, _| [0.9 * albedo(p); 3]);
            linear.into_iter().map(|v| curve(f64::from(v)) as f32).collect()
        };
        let photo = |rgb| Photo::from_linear(camera.width, camera.height, rgb, 1.0, 9.0).unwrap();
        let tone = ToneCurve { log_slopes: [2.2_f64.ln(); 3], unknown_from: 0.0 };
        let curved = Photometry { tone, ..known(1.0) };
        let encoded = photo(rgb(&|v| v.powf(1.0 / 2.2)));
        let said = linearity(&measured(&encoded), &target, &curved).unwrap();
        // The ratio 0.0625 as stored.
        let Hint::NotLinear { what: "black", ratio, undone: true } = said else { panic!("{said}") };
        assert!((ratio - 0.0625_f32.powf(1.0 / 2.2)).abs() < 0.002, "{ratio}");
        assert!(said.to_string().contains("estimated and undone"), "{said}");
        // A curve that does not fit: linear values then look curved.
        let said = linearity(&measured(&photo(rgb(&|v| v))), &target, &curved).unwrap();
        assert!(matches!(said, Hint::NotLinear { undone: false, .. }), "{said}");
        // Black squares alone, printed with a ratio of 0.0625.
        let plain = Target { patches: false, ..target.clone() };
        for (ratio, odd) in [(1.0, false), (4.0, true), (0.05, true)] {
            let known = known(ratio);
            let squares = Squares { patches: None, ..measured(&encoded) };
            let said = linearity(&squares, &plain, &known);
            assert_eq!(said.is_some(), odd, "{ratio}");
        }
    }
}
