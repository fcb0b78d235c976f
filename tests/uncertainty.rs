//! How far maps are said to be off, and how far they are; where a photograph would tell most.

#[path = "common/rectified.rs"]
mod rectified;

use std::sync::Arc;

use rectified::{POSITIONS, SIZE, material, observation, photo, scene, view};
use svbrdf::assessment::Place;
use svbrdf::estimate::Method;
use svbrdf::estimator::Estimator;
use svbrdf::export::{MapsOptions, read_maps, write_maps};
use svbrdf::networks::Networks;
use svbrdf::observation::Observation;
use svbrdf::session::{Driver, MapsWithUncertainty, RestoreOptions, Session, Settings};
use svbrdf::svbrdf::{CHANNELS, LOBES, channel, lobe};
use svbrdf::uncertainty::MapDeviations;
use svbrdf::{Error, Svbrdf};

/// Driven from here: photographs come at the same moments of the fit.
fn session() -> Session {
    let (sample_mm, driver) = ([100.0; 2], Driver::Caller);
    let settings = Settings { sample_mm, threads: 2, driver, ..Settings::default() };
    Session::new(scene(), settings).unwrap()
}

fn as_list(of: MapDeviations) -> [f32; 4] {
    [of.normal, of.diffuse, of.specular, of.roughness]
}

/// Root mean square errors of normal, diffuse, specular, roughness.
fn errors(maps: &Svbrdf, truth: &Svbrdf) -> [f32; 4] {
    let starts = [
        channel::SLOPE_X,
        channel::DIFFUSE,
        channel::SPECULAR,
        channel::ROUGHNESS,
        channel::ROUGHNESS + 1,
    ];
    std::array::from_fn(|m| {
        let of = |c: usize| {
            maps.plane(c).iter().zip(truth.plane(c)).map(|(a, b)| f64::from(a - b).powi(2)).sum()
        };
        let sums: Vec<f64> = (starts[m]..starts[m + 1]).map(of).collect();
        (sums.iter().sum::<f64>() / (sums.len() * maps.texels()) as f64).sqrt() as f32
    })
}

#[test]
fn deviations_follow_the_errors_and_are_kept_with_the_session() {
    let truth = material();
    let session = session();
    assert!(matches!(session.snapshot_with_uncertainty(), Err(Error::NoMaps)));
    let mut stated = Vec::new();
    for (i, position) in POSITIONS.into_iter().enumerate() {
        session
            .add_rectified_photo(&photo(&truth, position), position, position)
            .unwrap()
            .into_result()
            .unwrap();
        if i == 1 {
            continue;
        }
        session.wait().unwrap();
        let MapsWithUncertainty { maps, uncertainty } =
            session.snapshot_with_uncertainty().unwrap();
        assert_eq!(maps, session.snapshot().unwrap());
        let (found, errors) = (as_list(uncertainty.of_maps()), errors(&maps, &truth));
        for (found, error) in found.into_iter().zip(errors) {
            // Of one material deviations may be off as a whole: by less than half a decade mostly.
            assert!(found > 0.1 * error && found < 10.0 * error, "{found} {error}");
        }
        stated.push(found);
    }
    let [one, three] = [stated[0], stated[1]];
    // Three show how badly the model fits, which one cannot: that widens slopes.
    assert!(three[0] < 1.25 * one[0], "slopes are known hardly worse: {three:?} {one:?}");
    assert!(three[2] < one[2], "photographs tell specular albedo: {three:?} {one:?}");
    assert!(three[1] < one[1], "photographs tell albedo: {three:?} {one:?}");
    // One photograph leaves no residuals; three show how badly the model fits, which widens roughness.
    assert!(three[3] < 1.05 * one[3], "roughness is known no worse: {three:?} {one:?}");

    let saved = session.save().unwrap();
    let networks = Arc::new(Networks::embedded().unwrap());
    let restored = Session::restore(&saved, networks, RestoreOptions::default()).unwrap();
    let [before, after] = [
        session.snapshot_with_uncertainty().unwrap(),
        restored.snapshot_with_uncertainty().unwrap(),
    ];
    assert_eq!(before.maps, after.maps);
    // The latent code is found again: its maps differ by roundings.
    for (a, b) in before.uncertainty.planes().iter().zip(after.uncertainty.planes()) {
        assert!((a - b).abs() < 0.01 * a, "a restored session says the same: {a} {b}");
    }
    session.cancel();
    assert!(matches!(session.snapshot_with_uncertainty(), Err(Error::Cancelled)));
}

/// Anisotropy of the brushed material: alphas that differ by a factor of five.
const STRENGTH: f32 = 1.6;

#[test]
fn deviations_of_lobes_are_stated_and_kept_with_the_session() {
    let mut brushed = material();
    let mut lobes = vec![0.0; lobe::SHEEN * brushed.texels()];
    lobes[..brushed.texels()].fill(STRENGTH);
    brushed.set_lobes(lobes).unwrap();
    let session = session();
    let further = [[-30.0, -50.0, 120.0], [20.0, 60.0, 110.0]];
    for position in POSITIONS.into_iter().chain(further) {
        let outcome = session.add_rectified_photo(&photo(&brushed, position), position, position);
        outcome.unwrap().into_result().unwrap();
    }
    session.wait().unwrap();
    let MapsWithUncertainty { maps, uncertainty } = session.snapshot_with_uncertainty().unwrap();
    assert_eq!(uncertainty.planes().len(), maps.planes().len() / CHANNELS * 4 + maps.lobes().len());
    let [found, _] = maps.anisotropy().unwrap();
    let deviations = uncertainty.lobe(lobe::ANISOTROPY_X).unwrap();
    let within =
        found.iter().zip(deviations).filter(|(v, sigma)| (**v - STRENGTH).abs() < 2.0 * **sigma);
    let within = within.count();
    assert!(10 * within > 9 * maps.texels(), "{within} {} {}", found[0], deviations[0]);
    assert!(deviations.iter().all(|sigma| (0.01..0.4).contains(sigma)), "{}", deviations[0]);
    assert!(uncertainty.lobe(lobe::COAT).unwrap().iter().all(|sigma| *sigma == 0.0));
    assert_eq!(uncertainty.of_maps().coat, None);

    let networks = Arc::new(Networks::embedded().unwrap());
    let options = RestoreOptions::default();
    let restored = Session::restore(&session.save().unwrap(), networks, options).unwrap();
    let after = restored.snapshot_with_uncertainty().unwrap().uncertainty;
    assert_eq!(after.lobe(lobe::ANISOTROPY_X), uncertainty.lobe(lobe::ANISOTROPY_X));
}

#[test]
fn texels_that_no_photograph_shows_are_known_least() {
    let truth = material();
    let networks = Arc::new(Networks::embedded().unwrap());
    let mut estimator = Estimator::new(networks, Method::Deep, true);
    estimator.correct_lights(false);
    let hidden = |texel: usize| texel % SIZE < SIZE / 4;
    for position in POSITIONS {
        let seen = observation(&truth, view(position));
        let n = seen.texels();
        let radiance: Vec<f32> = (0..3 * n).map(|i| seen.radiance(i / n, i % n)).collect();
        let weight: Vec<f32> = (0..n).map(|i| if hidden(i) { 0.0 } else { 1.0 }).collect();
        estimator
            .add(Observation::new(SIZE, SIZE, seen.view, &radiance, &weight).unwrap())
            .unwrap();
    }
    estimator.settle().unwrap();
    let uncertainty = estimator.evidence().unwrap().uncertainty().unwrap();
    let mean = |plane: &[f32], is_hidden: bool| {
        let of = plane.iter().enumerate().filter(|(i, _)| hidden(*i) == is_hidden);
        let (sum, count) = of.fold((0.0, 0.0), |(sum, count), (_, v)| (sum + v, count + 1.0));
        sum / count
    };
    // Slopes that are seen stay near the learned ones: they are hardly better known.
    let planes = [
        (uncertainty.normal(), 1.0),
        (uncertainty.specular(), 1.2),
        (uncertainty.roughness(), 1.2),
    ];
    for (plane, times) in planes {
        let (hidden, seen) = (mean(plane, true), mean(plane, false));
        assert!(hidden > times * seen, "{hidden} {seen}");
    }
}

#[test]
fn views_tell_most_where_none_was() {
    let truth = material();
    let networks = Arc::new(Networks::embedded().unwrap());
    let mut estimator = Estimator::new(networks, Method::Deep, true);
    let at = |camera_mm: [f32; 3]| Place { camera_mm, light_mm: camera_mm };
    assert!(matches!(estimator.outlook(&[at(POSITIONS[0])]), Err(Error::NoMaps)));
    estimator.correct_lights(false);
    estimator.add(observation(&truth, view(POSITIONS[0]))).unwrap();
    estimator.settle().unwrap();
    let elsewhere = [60.0, 0.0, 95.0];
    let places = [POSITIONS[0], [4.0, 0.0, 110.0], elsewhere].map(at);
    let [same, near, far] = estimator.outlook(&places).unwrap().try_into().unwrap();
    assert!(same == 0.0 && near < 0.2 * far && far < 1.0, "{same} {near} {far}");
    // The same view adds less the second time; the gain elsewhere falls too.
    estimator.add(observation(&truth, view(elsewhere))).unwrap();
    estimator.settle().unwrap();
    let gains = estimator.outlook(&[elsewhere, [0.0, 60.0, 95.0]].map(at)).unwrap();
    assert!(gains[0] == 0.0 && gains[1] > 0.0, "{gains:?}");
    assert_eq!(gains, estimator.outlook(&[elsewhere, [0.0, 60.0, 95.0]].map(at)).unwrap());
}

#[test]
fn files_of_maps_hold_deviations_beside_what_others_read() {
    let maps = Svbrdf::new(4, 2);
    let planes: Vec<f32> = (0..8 * (4 + LOBES)).map(|i| 0.01 * i as f32).collect();
    let uncertainty = svbrdf::uncertainty::Uncertainty::from_planes(4, 2, planes.clone()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("maps");
    write_maps(
        &dir,
        &maps,
        &MapsOptions { sample_mm: Some([10.0, 5.0]), uncertainty: Some(&uncertainty) },
    )
    .unwrap();
    let read = read_maps(&dir).unwrap();
    let image = exr::prelude::read_first_flat_layer_from_file(dir.join("maps.exr")).unwrap();
    std::fs::remove_dir_all(&dir).unwrap();
    assert_eq!(read.planes(), maps.planes());
    let names = [
        "normal",
        "diffuse",
        "specular",
        "roughness",
        "anisotropy.cosine",
        "anisotropy.sine",
        "coat.weight",
        "coat.roughness",
        "sheen.R",
        "sheen.G",
        "sheen.B",
        "sheen.roughness",
    ];
    for (name, plane) in names.into_iter().zip(planes.chunks(8)) {
        let channels = &image.layer_data.channel_data.list;
        let name = format!("deviation.{name}");
        let channel = channels.iter().find(|c| c.name.eq(name.as_str())).unwrap();
        assert_eq!(channel.sample_data.values_as_f32().collect::<Vec<_>>(), plane);
    }
    let small = Svbrdf::new(2, 2);
    assert!(matches!(
        write_maps(
            &dir,
            &small,
            &MapsOptions { sample_mm: Some([1.0; 2]), uncertainty: Some(&uncertainty) }
        ),
        Err(Error::Argument { .. })
    ));
    assert!(!dir.exists());
}
