use super::*;
use crate::Error;
use crate::estimate::options::ScheduleOptions;
use crate::estimate::{Budget, Meter, Method, Task, first_maps};
use crate::observation::{Observation, View};
use crate::session::capture::Photograph;
use crate::session::{Driver, RestoreOptions};
use crate::test_support::{photograph, two_tones, view_from};
use proptest::prelude::*;
use std::sync::OnceLock;

fn networks() -> Arc<Networks> {
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    NETWORKS.get_or_init(|| Arc::new(Networks::embedded().unwrap())).clone()
}

/// A session with two photographs of a board, the camera unknown, the fit ended early.
fn example() -> &'static [u8] {
    static STATE: OnceLock<Vec<u8>> = OnceLock::new();
    STATE.get_or_init(|| {
        let dir = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");
        let capture = crate::capture::Capture::load(dir).unwrap();
        let Scene::Board { target, .. } = capture.scene else { panic!("no board") };
        let scene = Scene::board(target);
        let (sample_mm, driver) = (capture.sample_mm, Driver::Caller);
        let settings = Settings { sample_mm, threads: 2, driver, ..Settings::default() };
        let session = Session::with_networks(scene, settings, networks()).unwrap();
        let budget = Budget { steps: Some(4), ..Budget::default() };
        session.set_budget(budget).unwrap();
        for file in &capture.photos[..2] {
            session.add_photo(&file.read().unwrap()).unwrap();
        }
        session.wait().unwrap();
        session.save().unwrap()
    })
}

/// The example with other values, its sums right.
fn rewritten(change: impl FnOnce(&mut Saved)) -> Vec<u8> {
    let mut saved = format::read::<Saved>(format::content(example()).unwrap()).unwrap();
    change(&mut saved);
    format::write(&saved).unwrap()
}

fn restore(bytes: &[u8]) -> Result<Session> {
    Session::restore(bytes, networks(), RestoreOptions::default())
}

/// The first photograph of a board, changed.
fn first(saved: &mut Saved, change: impl FnOnce(&mut Photograph)) {
    let Capture::Board(board) = saved.capture.to_mut() else { panic!("no board") };
    change(&mut board.photographs[0]);
}

#[test]
fn what_was_read_is_written_to_the_same_bytes() {
    assert!(rewritten(|_| {}) == example());
    let session = restore(example()).unwrap();
    assert_eq!(session.save().unwrap().len(), example().len());
}

/// Damaged contents under right checksums give a fault or a session, never a panic.
#[test]
fn nonsense_with_the_right_sums_does_no_harm() {
    let (mut taken, mut refused) = (0, 0);
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = (any::<prop::sample::Index>(), 0..5_u8, any::<[u8; 8]>());
    for round in 0..120 {
        use proptest::strategy::ValueTree;
        let (place, kind, value) = strategy.new_tree(&mut runner).unwrap().current();
        let mut bytes = example().to_vec();
        // Lengths and options lie at the beginning, pixels at the end.
        let reach = if round % 2 == 0 { bytes.len() } else { 8000 };
        let at = (26 + place.index(reach)).min(bytes.len() - 1);
        match kind {
            0 => bytes[at] ^= value[0] | 1,
            1 => bytes.truncate(at),
            2 => bytes.extend_from_slice(&value),
            _ => {
                let end = (at + 8).min(bytes.len());
                let special = [value, [0xFF; 8], [0; 8], f64::NAN.to_le_bytes()];
                let value = special[usize::from(value[0] % 4)];
                bytes[at..end].copy_from_slice(&value[..end - at]);
            }
        }
        format::seal(&mut bytes, 1);
        match restore(&bytes) {
            Ok(session) => {
                taken += 1;
                session.pause();
                session.progress();
            }
            Err(Error::State(_)) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    println!("{taken} taken, {refused} refused");
    assert!(taken > 0 && refused > 20);
}

/// Numbers that postcard reads and no session writes.
#[test]
fn values_out_of_range_are_refused() {
    let damaged = |what: &str, change: &dyn Fn(&mut Saved)| {
        let fault = restore(&rewritten(change)).err();
        assert!(matches!(fault, Some(Error::State(_))), "{what}: {fault:?}");
    };
    damaged("sample", &|saved| saved.settings.to_mut().sample_mm[0] = f32::NAN);
    damaged("resolution", &|saved| saved.settings.to_mut().resolution = 300);
    damaged("resolution", &|saved| saved.settings.to_mut().resolution = 512);
    damaged("budget", &|saved| saved.meter.budget.seconds = Some(-1.0));
    damaged("corner", &|saved| first(saved, |p| p.measured.corners[3].px.x = f64::INFINITY));
    damaged("prior", &|saved| first(saved, |p| p.measured.prior.focal_sigma = -1.0));
    damaged("exposure", &|saved| first(saved, |p| p.measured.squares.exposure = 0.0));
    damaged("pose", &|saved| first(saved, |p| p.pose.rotation.x_axis.x += 0.1));
    damaged("pose", &|saved| first(saved, |p| p.pose.rotation.x_axis.x = f64::NAN));
    damaged("photograph", &|saved| drop(saved.rectified.pop()));
    damaged("maps", &|saved| saved.estimate.maps = None);
    damaged("exposure", &|saved| saved.estimate.correction.exposure.exponent = f64::NAN);
    damaged("loss", &|saved| saved.loss_before = f32::NAN);
    damaged("capture", &|saved| {
        let scene = Scene::Rectified { falloff: Default::default() };
        let given = Capture::new(scene, &Settings::default()).unwrap();
        saved.capture = Cow::Owned(given);
    });
}

const SIDE: usize = 64;

/// Photographs from round the sample in a room, for an estimate of a few texels; a hand may cover a corner of
/// the second.
fn photographs(count: usize, covered: bool) -> Vec<Observation> {
    let truth = two_tones(SIDE);
    let at = |i: usize| [40.0 * (i as f32 * 2.0).sin(), 40.0 * (i as f32 * 2.0).cos(), 120.0];
    let view = |i| View { ambient: [0.05; 3], ..view_from(at(i)) };
    let mut all: Vec<Observation> = (0..count).map(|i| photograph(&truth, view(i))).collect();
    if covered {
        all[1] = all[1].changed(|radiance, _| {
            for (k, value) in radiance.iter_mut().enumerate() {
                let [x, y] = [k % SIDE, k / SIDE % SIDE];
                *value *= if x < SIDE / 2 && y < SIDE / 2 { 0.2 } else { 1.0 };
            }
        });
    }
    all
}

/// Root mean square differences of each map, in units of its stated deviation.
fn deviations_off(estimation: &Estimation, other: &Estimation) -> Vec<f32> {
    let stated = estimation.evidence().unwrap().uncertainty().unwrap().of_maps();
    let stated = [stated.normal, stated.diffuse, stated.specular, stated.roughness];
    let (maps, others) = (estimation.maps().unwrap(), other.maps().unwrap());
    let planes = [0..2, 2..5, 5..8, 8..9].into_iter().zip(stated);
    let off = planes.map(|(planes, stated)| {
        let of_plane = |c| maps.plane(c).iter().zip(others.plane(c));
        let squares = planes.flat_map(of_plane).map(|(a, b)| (a - b).powi(2));
        let squares: Vec<f32> = squares.collect();
        (squares.iter().sum::<f32>() / squares.len() as f32).sqrt() / stated
    });
    off.collect()
}

/// Wherever a fit is left, it ends with the maps that it would have had, within a twentieth of their stated
/// deviations. With so many photographs and tasks that all phases lie between.
#[test]
fn a_fit_that_is_left_and_gone_on_with_ends_the_same() {
    let networks = networks();
    let run = |task: Task, count: usize, options: &EstimateOptions, covered: bool, share: f32| {
        let again = |estimation: &Estimation, photographs: &[Observation]| {
            let bytes = postcard::to_stdvec(&estimation.save()).unwrap();
            let read = postcard::from_bytes(&bytes).unwrap();
            let (networks, options) = (networks.clone(), options.clone());
            Estimation::restore(networks, task, options, read, photographs.to_vec()).unwrap()
        };
        let mut estimation = Estimation::new(networks.clone(), task, options.clone());
        let mut meter = Meter::new(Budget::default());
        let all = photographs(count, covered);
        for (i, observation) in all.iter().enumerate() {
            let start = (i == 0).then(|| first_maps(&networks, observation).unwrap());
            estimation.add(observation.clone(), false, start.as_ref()).unwrap();
            // Most come before the fit has settled, the last but one when it has.
            let steps = if i + 2 == count { usize::MAX } else { 3 };
            for _ in 0..steps {
                if estimation.step(&mut meter).unwrap().done {
                    break;
                }
            }
            if i + 2 == count && share < 1.0 {
                let left = again(&estimation, &all[..=i]);
                assert_eq!(left.maps().unwrap(), estimation.maps().unwrap());
                estimation = left;
            }
        }
        let (mut fraction, mut left) = (0.0, share >= 1.0);
        loop {
            let step = estimation.step(&mut meter).unwrap();
            assert!(step.fraction >= fraction, "the share done goes back");
            fraction = step.fraction;
            if !left && fraction > share {
                (left, fraction) = (true, 0.0);
                estimation = again(&estimation, &all);
            }
            if estimation.is_done() {
                let parts = estimation.residuals().unwrap().iter().any(|fit| fit.part.is_some());
                assert_eq!(parts, covered, "a part is left out where a hand covers it");
                return estimation;
            }
        }
    };
    let deep = Task { method: Method::Deep, refine: true, free_lights: false };
    let free = Task { free_lights: true, ..deep };
    let mut phases = Vec::new();
    let default = EstimateOptions::default();
    // Thinned out, and more photographs than a step sees.
    let schedule = ScheduleOptions { texels: SIDE / 2, photographs: 3, ..default.schedule.clone() };
    let large = EstimateOptions { schedule, ..default.clone() };
    let classic = Task { method: Method::Classic, ..deep };
    for (task, count, options, covered) in [
        (deep, 2, &default, false),
        (deep, 5, &default, false),
        (deep, 5, &default, true),
        (free, 8, &default, false),
        (classic, 2, &default, false),
        (free, 5, &large, false),
    ] {
        let plain = run(task, count, options, covered, 1.0);
        for share in [0.05, 0.6] {
            let left = run(task, count, options, covered, share);
            let off = deviations_off(&plain, &left);
            println!("{task:?} {count}, left at {share}: {off:.3?}");
            assert!(off.iter().all(|off| *off < 0.05), "{task:?} {count}, {share}: {off:?}");
        }
        phases.extend(plain.reports().iter().map(|report| report.name));
    }
    for phase in ["latent", "relief", "choice", "joint", "texels", "baseline"] {
        assert!(phases.contains(&phase), "{phase:?} was not tested");
    }
}
