//! Each fault is found in rendered photographs, and none in good ones.

use super::*;
use crate::estimate::Part;
use crate::observation::{Falloff, View};
use crate::render::render;
use crate::svbrdf::channel;
use crate::test_support::noise;

const SIDE: usize = 128;

/// A bumpy and speckled material.
fn material(seed: u64, bumps: f32, specks: f32) -> Svbrdf {
    let mut random = noise(seed);
    let mut maps = Svbrdf::new(SIDE, SIDE);
    for t in 0..SIDE * SIDE {
        let tone = 0.3 * (specks * (random() - 0.5)).exp();
        maps.normal_slopes_mut()[0][t] = bumps * (random() - 0.5);
        maps.normal_slopes_mut()[1][t] = bumps * (random() - 0.5);
        maps.roughness_mut()[t] = 0.5;
        for c in 0..3 {
            maps.diffuse_mut()[c][t] = tone;
            maps.specular_mut()[c][t] = 0.04;
        }
    }
    maps
}

fn view(i: usize) -> View {
    view_from(25.0 * i as f32, 2.1 * i as f32)
}

/// View from `away` mm beside the sample's centre, in the direction `radians`.
fn view_from(away: f32, radians: f32) -> View {
    let (sin, cos) = radians.sin_cos();
    let camera_mm = [away * cos, away * sin, 270.0];
    View {
        sample_mm: [100.0; 2],
        camera_mm,
        light_mm: [camera_mm[0] + 9.0, camera_mm[1] - 6.0, 270.0],
        falloff: Falloff::InverseSquare { power_mm2: [3e5; 3] },
        ambient: [0.0; 3],
        mirrored: 1.0,
    }
}

/// A photograph with some noise; `change` scales each radiance by its angle to the normal.
fn photograph(maps: &Svbrdf, i: usize, change: impl Fn(f32) -> f32) -> Observation {
    photograph_from(maps, view(i), i, change)
}

fn photograph_from(
    maps: &Svbrdf,
    view: View,
    i: usize,
    change: impl Fn(f32) -> f32,
) -> Observation {
    let mut random = noise(100 + i as u64);
    let mut planes = vec![0.0; 3 * SIDE * SIDE];
    render(maps, &view, &mut planes);
    for (k, value) in planes.iter_mut().enumerate() {
        let t = k % (SIDE * SIDE);
        let [x, y] = view.texel_mm(SIDE, SIDE, t % SIDE, t / SIDE);
        let [cx, cy, cz] = view.camera_mm;
        let degrees = (cx - x).hypot(cy - y).atan2(cz).to_degrees();
        *value *= change(degrees) * (1.0 + 0.1 * (random() - 0.5));
    }
    Observation::new(SIDE, SIDE, view, &planes, &vec![1.0; SIDE * SIDE]).unwrap()
}

fn same(_: f32) -> f32 {
    1.0
}

/// The maps moved along the rows by some texels.
fn moved(maps: &Svbrdf, by: usize) -> Svbrdf {
    let mut out = maps.clone();
    for c in channel::SLOPE_X..=channel::ROUGHNESS {
        let plane = maps.plane(c);
        let at = |t: usize| plane[t / SIDE * SIDE + (t % SIDE + by) % SIDE];
        let shifted: Vec<f32> = (0..SIDE * SIDE).map(at).collect();
        out.plane_mut(c).copy_from_slice(&shifted);
    }
    out
}

#[test]
fn two_samples_and_a_moved_one_are_two_groups() {
    // Relief alone is invisible under light along the view from above.
    for (bumps, specks) in [(0.1, 0.8), (0.0, 0.5), (0.3, 0.8)] {
        let (one, other) = (material(1, bumps, specks), material(2, bumps, specks));
        for (second, members) in
            [(&[2, 3, 4, 5][..], "1 and 2"), (&[3, 4, 5], "4, 5 and 6"), (&[1, 4], "2 and 5")]
        {
            for maps in [&other, &moved(&one, 3)] {
                let shown = |i: usize| if second.contains(&i) { maps } else { &one };
                let photographs: Vec<_> = (0..6).map(|i| photograph(shown(i), i, same)).collect();
                let group = groups::find(&photographs).map(|group| group.to_string());
                let what = format!("{bumps} {specks} {second:?}");
                assert_eq!(group, Some(format!("photos {members}")), "{what}");
            }
        }
    }
}

/// The maps turned by 180 degrees.
fn turned(maps: &Svbrdf) -> Svbrdf {
    let mut out = maps.clone();
    for c in channel::SLOPE_X..=channel::ROUGHNESS {
        let sign = if c < channel::DIFFUSE { -1.0 } else { 1.0 };
        let plane: Vec<f32> = maps.plane(c).iter().rev().map(|v| sign * v).collect();
        out.plane_mut(c).copy_from_slice(&plane);
    }
    out
}

/// A bright rim, as paper beside a dark sample leaves.
fn rimmed(mut maps: Svbrdf) -> Svbrdf {
    let near = |i: usize| !(2..SIDE - 2).contains(&i);
    for t in (0..SIDE * SIDE).filter(|t| near(t % SIDE) || near(t / SIDE)) {
        (0..3).for_each(|c| maps.diffuse_mut()[c][t] = 0.9);
    }
    maps
}

/// Rims are alike in both groups.
#[test]
fn a_turned_board_divides_photographs_whatever_its_rim() {
    for (bumps, specks) in [(0.1, 0.8), (0.0, 0.5), (0.3, 0.8)] {
        let one = material(11, bumps, specks);
        let (one, other) = (rimmed(one.clone()), rimmed(turned(&one)));
        for (second, members) in [(&[3, 4, 5][..], "4, 5 and 6"), (&[4, 5], "5 and 6")] {
            let shown = |i: usize| if second.contains(&i) { &other } else { &one };
            let photographs: Vec<_> = (0..6).map(|i| photograph(shown(i), i, same)).collect();
            let group = groups::find(&photographs).map(|group| group.to_string());
            assert_eq!(group, Some(format!("photos {members}")), "{bumps} {specks} {second:?}");
        }
        let photographs: Vec<_> = (0..6).map(|i| photograph(&one, i, same)).collect();
        assert_eq!(groups::find(&photographs), None, "{bumps} {specks}");
    }
}

#[test]
fn photographs_of_one_sample_are_no_two_groups() {
    for (bumps, specks) in [(0.6, 0.0), (0.0, 0.5), (0.3, 0.3), (0.05, 0.02), (0.0, 0.0)] {
        let maps = material(3, bumps, specks);
        for count in 2..9 {
            let photographs: Vec<_> = (0..count).map(|i| photograph(&maps, i, same)).collect();
            assert_eq!(groups::find(&photographs), None, "{bumps} {specks}, {count}");
        }
        // A single photograph of another sample is a contradiction instead.
        let other = material(4, bumps, specks);
        let odd = |i: usize| photograph(if i == 3 { &other } else { &maps }, i, same);
        let photographs: Vec<_> = (0..5).map(odd).collect();
        assert_eq!(groups::find(&photographs), None);
    }
}

/// Bare metal is brighter than the paint beside it near the mirrored flash, and darker elsewhere, which divides
/// photographs of one sample.
#[test]
fn contrast_that_changes_with_the_angle_is_no_second_sample() {
    for (seed, roughness) in [(7, 0.4), (8, 0.5), (9, 0.55)] {
        let mut maps = material(seed, 0.05, 0.3);
        let mut random = noise(seed);
        for t in (0..SIDE * SIDE).filter(|_| random() < 0.4) {
            maps.roughness_mut()[t] = roughness;
            for c in 0..3 {
                maps.diffuse_mut()[c][t] = 0.02;
                maps.specular_mut()[c][t] = 0.6;
            }
        }
        let photographs: Vec<_> = [0.0, 20.0, 230.0, 45.0, 120.0, 70.0, 220.0]
            .into_iter()
            .enumerate()
            .map(|(i, away)| photograph_from(&maps, view_from(away, 2.1 * i as f32), i, same))
            .collect();
        assert_eq!(groups::find(&photographs), None, "{roughness}");
    }
}

#[test]
fn a_sheen_is_the_fault_of_the_material() {
    let maps = material(5, 0.2, 0.2);
    let sheen = |degrees: f32| 0.8 + 0.6 * (degrees / 35.0).powi(2);
    let photographs: Vec<_> = (0..6).map(|i| photograph(&maps, i, sheen)).collect();
    let found = material::find(&maps, &photographs);
    assert!(matches!(found, Some(Hint::OtherMaterial { .. })), "{found:?}");
    // Photographs that match the maps, and a single brighter one, are not.
    let good: Vec<_> = (0..6).map(|i| photograph(&maps, i, same)).collect();
    assert_eq!(material::find(&maps, &good), None);
    for bad in [0, 3, 5] {
        let odd = |i: usize| photograph(&maps, i, |_| if i == bad { 1.6 } else { 1.0 });
        let photographs: Vec<_> = (0..6).map(odd).collect();
        assert_eq!(material::find(&maps, &photographs), None, "photo {bad}");
    }
}

/// A photograph of another exposure, clipped at full scale.
fn clipped(maps: &Svbrdf, away: f32, radians: f32, exposure: f32) -> Observation {
    let view = view_from(away, radians);
    let mut planes = vec![0.0; 3 * SIDE * SIDE];
    render(maps, &view, &mut planes);
    // White paper facing the flash has two thirds of full scale.
    let full = 1.5 * 0.8 / std::f32::consts::PI * 3e5 / 270.0_f32.powi(2) / exposure;
    planes.iter_mut().filter(|v| **v > full).for_each(|v| *v = -full);
    Observation::new(SIDE, SIDE, view, &planes, &vec![1.0; SIDE * SIDE]).unwrap()
}

/// A plain material.
fn glossy(albedo: f32, f0: f32, roughness: f32) -> Svbrdf {
    let mut maps = material(6, 0.0, 0.1);
    maps.roughness_mut().fill(roughness);
    for c in 0..3 {
        maps.diffuse_mut()[c].fill(albedo);
        maps.specular_mut()[c].fill(f0);
    }
    maps
}

/// Of polished metal the photographs show only tails. They show the shoulder of varnish, although its peak is clipped
/// too, and one darker photograph shows that of the metal.
#[test]
fn highlights_that_are_lost_are_told() {
    let found =
        |maps: &Svbrdf, photographs: &[Observation]| LostHighlights::find(maps, photographs);
    let is_lost = |maps: &Svbrdf, photographs: &[Observation]| found(maps, photographs).is_some();
    let photographs = |maps: &Svbrdf| -> Vec<Observation> {
        (0..6).map(|i| clipped(maps, 20.0 * i as f32, 2.1 * i as f32, 1.0)).collect()
    };
    for (f0, roughness) in [(0.9, 0.15), (0.9, 0.08), (0.5, 0.04)] {
        let polished = glossy(0.003, f0, roughness);
        let mut bright = photographs(&polished);
        assert!(is_lost(&polished, &bright), "{f0} {roughness}");
        // The same with the maps of a fit that took it for something wider and darker.
        let dimmer = glossy(0.003, 0.2 * f0, roughness * 5.0_f32.powf(0.25));
        let open = found(&dimmer, &bright).unwrap();
        assert!(open.texels.iter().all(|open| *open), "{f0} {roughness}");
        bright.push(clipped(&polished, 10.0, 1.0, 1.0 / 200.0));
        assert!(!is_lost(&polished, &bright), "{f0} {roughness}");
    }
    for (f0, roughness) in [(0.04, 0.2), (0.04, 0.3), (0.9, 0.5), (0.3, 0.6)] {
        let maps = glossy(0.3, f0, roughness);
        assert!(!is_lost(&maps, &photographs(&maps)), "{f0} {roughness}");
    }
}

/// One darker photograph shows the core of a metal's highlight. Maps with the right tails and a tenth of F0 do not
/// explain it; the true maps do, and so do those of other materials.
#[test]
fn cores_that_the_maps_do_not_explain_are_found() {
    for (f0, roughness) in [(0.9, 0.15), (0.9, 0.3), (0.5, 0.08)] {
        let metal = glossy(0.003, f0, roughness);
        let dimmer = glossy(0.003, 0.1 * f0, roughness * 10.0_f32.powf(0.25));
        let mut photographs: Vec<Observation> =
            (0..6).map(|i| clipped(&metal, 20.0 * i as f32, 2.1 * i as f32, 1.0)).collect();
        photographs.push(clipped(&metal, 20.0, 2.1, 1e-5));
        let errors = core_errors(&dimmer, &photographs);
        // The peak is 10 times as wide and 1/100 as bright.
        let ok = |log: &f32| (1.0..4.7).contains(log);
        assert!(errors.iter().all(ok), "{f0} {roughness}: {}", errors[0]);
        assert!(core_errors(&metal, &photographs).iter().all(|log| *log == 0.0));
    }
    for (f0, roughness) in [(0.04, 0.2), (0.04, 0.5), (0.9, 0.4)] {
        let maps = glossy(0.3, f0, roughness);
        let photographs: Vec<Observation> =
            (0..6).map(|i| clipped(&maps, 20.0 * i as f32, 2.1 * i as f32, 1.0)).collect();
        assert!(core_errors(&maps, &photographs).iter().all(|log| *log == 0.0));
    }
}

/// The highlights of brushed flakes are predicted where they are not. Sun on metal, and a shadow on anything with a
/// colour of its own, are told.
#[test]
fn a_highlight_that_is_missing_is_no_contradiction() {
    let maps = material(12, 0.1, 0.3);
    let photographs: Vec<_> = (0..4).map(|i| photograph(&maps, i, same)).collect();
    let is_told = |ratio: f32, highlight: f32| {
        let part = Part { share: 0.3, centre: [0.5; 2], ratio, highlight };
        let fit = |i| PhotoFit {
            residual: 0.02,
            weight: 0.9,
            outlier: false,
            part: (i == 2).then_some(part),
        };
        let fits: Vec<PhotoFit> = (0..4).map(fit).collect();
        let mut hints = vec![Vec::new(); 4];
        fits::tell(None, None, &photographs, &fits, None, &mut hints);
        matches!(hints[2].as_slice(), [Hint::PartContradicts { .. }])
    };
    assert!(!is_told(0.11, 0.97));
    assert!(is_told(1.5, 0.97) && is_told(0.5, 0.3) && is_told(0.11, 0.5));
}

/// A cut board was also called eight times as bright as stated.
#[test]
fn a_wrong_geometry_is_named_alone() {
    let (bright, bent) = (Hint::Exposure { ratio: 8.7 }, Hint::BoardBent { mm: 0.7, share: 0.2 });
    let local = Hint::LocalTone { exponent: 0.1 };
    let kept = |hints: &[Vec<Hint>]| {
        let mut all = hints.to_vec();
        super::drop_seeming(&mut all);
        all
    };
    let light = vec![vec![bright], vec![local]];
    assert_eq!(kept(&light), light);
    assert_eq!(kept(&[vec![bright, bent], vec![local, bent]]), [vec![bent], vec![bent]]);
    // A photograph that is not cropped may have another exposure than is stated.
    assert_eq!(kept(&[vec![bent], vec![bright, local]]), [vec![bent], vec![bright]]);
}
