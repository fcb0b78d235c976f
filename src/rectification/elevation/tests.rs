use glam::{DVec2, DVec3};

use super::*;
use crate::calibration::photometry::tests::{camera, photograph, pose};
use crate::geometry::Pose;
use crate::photo::Photo;
use crate::random::Random;

const SAMPLE_MM: [f32; 2] = [100.0, 80.0];

/// Waves of 4 to 25 mm in all directions.
fn waves(seed: u64) -> impl Fn(DVec2) -> f64 + Sync {
    let mut random = Random::new(seed);
    let waves: Vec<(DVec2, f64)> = (0..24)
        .map(|_| {
            let length = 4.0 * (21.0 / 4.0_f64).powf(random.uniform());
            let angle = std::f64::consts::TAU * random.uniform();
            (DVec2::from_angle(angle) * std::f64::consts::TAU / length, 9.0 * random.uniform())
        })
        .collect();
    move |p| waves.iter().map(|(k, phase)| (k.dot(p) + phase).sin()).sum::<f64>() / 24.0
}

fn views() -> [Pose; 3] {
    [pose(0.05, 0.02, 0.0, 300.0), pose(0.5, 0.3, 0.2, 300.0), pose(-0.4, -0.5, -0.1, 320.0)]
}

/// Photographs of a surface at a height, given the radiance of a point in a view.
fn details(mm: f64, radiance: impl Fn(usize, DVec2) -> f64 + Sync) -> Vec<Detail> {
    details_of(SAMPLE_MM, mm, radiance)
}

fn details_of(
    sample_mm: [f32; 2],
    mm: f64,
    radiance: impl Fn(usize, DVec2) -> f64 + Sync,
) -> Vec<Detail> {
    let camera = camera();
    let detail = |(view, pose): (usize, &Pose)| {
        let translation = pose.transform(DVec3::Z * mm);
        let raised = Pose { translation, ..*pose };
        let rgb = photograph(&camera, &raised, 2, |p, _| [radiance(view, p); 3]);
        let photo = Photo::from_linear(camera.width, camera.height, rgb, 1.0, 9.0).unwrap();
        Detail::new(&photo, &camera, pose, sample_mm).unwrap()
    };
    views().iter().enumerate().map(detail).collect()
}

fn found(details: &[Detail]) -> ElevationEstimate {
    estimate(&details.iter().collect::<Vec<_>>(), ElevationEstimate::default())
}

#[test]
fn the_height_is_that_of_the_surface() {
    let texture = waves(5);
    for mm in [-3.0, 0.5, 4.0, 15.0] {
        let details = details(mm, |_, p| 0.4 + 0.8 * texture(p));
        for n in [2, 3] {
            let e = found(&details[..n]);
            // Tolerance: points move by about half of it, a twentieth of a texel, because
            // photographs and texels are sampled differently.
            assert!((e.mm - mm).abs() < 0.04, "{mm} from {n}: {e:?}");
            assert!(e.sigma_mm < 0.05, "{mm} from {n}: {e:?}");
        }
    }
}

/// Brightness correlates negatively between photographs, as on slopes lit from different sides.
#[test]
fn any_correlation_between_photographs_registers() {
    let texture = waves(6);
    let gain = [0.4, -0.8, 0.2];
    let details = details(3.0, |view, p| 0.4 + gain[view] * texture(p));
    for n in [2, 3] {
        let e = found(&details[..n]);
        assert!((e.mm - 3.0).abs() < 0.03, "from {n}: {e:?}");
    }
}

#[test]
fn a_surface_in_the_plane_or_without_texture_stays_at_0() {
    let texture = waves(7);
    let plane = details(0.0, |_, p| 0.4 + 0.8 * texture(p));
    assert_eq!(found(&plane).mm, 0.0);
    assert!(found(&plane).sigma_mm < 0.05);
    let plain = details(4.0, |_, p| 0.4 + 1e-3 * p.x);
    assert_eq!(found(&plain).mm, 0.0);
    assert!(found(&plain).sigma_mm > 1.0);
    // Photographs of different surfaces.
    let others = [waves(1), waves(2), waves(3)];
    let different = details(4.0, |view, p| 0.4 + 0.8 * others[view](p));
    assert_eq!(found(&different).mm, 0.0);
    assert_eq!(found(&plane[..1]), ElevationEstimate::default());
    let same = [plane[0].clone(), plane[0].clone()];
    assert_eq!(found(&same), ElevationEstimate::default());
}

#[test]
fn inconclusive_photographs_do_not_revoke_a_height() {
    let known = ElevationEstimate { mm: 3.0, sigma_mm: 0.01 };
    let plain = details(4.0, |_, p| 0.4 + 1e-3 * p.x);
    assert_eq!(estimate(&plain.iter().collect::<Vec<_>>(), known), known);
    let texture = waves(7);
    let plane = details(0.0, |_, p| 0.4 + 0.8 * texture(p));
    assert_eq!(estimate(&plane.iter().collect::<Vec<_>>(), known).mm, 0.0);
}

#[test]
fn narrow_samples_have_no_coarse_octaves() {
    let texture = waves(9);
    for sample_mm in [[100.0, 12.0], [12.0, 100.0]] {
        let details = details_of(sample_mm, 2.0, |_, p| 0.4 + 0.8 * texture(p));
        let e = found(&details);
        assert!(e.mm == 0.0 || (e.mm - 2.0).abs() < 0.2, "{sample_mm:?}: {e:?}");
    }
}

#[test]
fn most_different_views_are_compared() {
    let texture = waves(8);
    let three = details(1.0, |_, p| 0.4 + 0.8 * texture(p));
    let mut many: Vec<Detail> = vec![three[0].clone(); 9];
    many.extend_from_slice(&three[1..]);
    let e = found(&many);
    assert!((e.mm - 1.0).abs() < 0.02, "{e:?}");
}
