use super::*;
use crate::Error;
use crate::estimate::options::ScheduleOptions;
use crate::estimate::{Addition, Meter, Method, Task, first_maps};
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
fn rewritten(change: impl FnOnce(&mut Head, &mut Body)) -> Vec<u8> {
    let (mut head, rest) = format::read::<Head>(format::content(example()).unwrap()).unwrap();
    let (mut body, rest) = format::read::<Body>(rest).unwrap();
    assert!(rest.is_empty());
    change(&mut head, &mut body);
    format::write(&head, &body).unwrap()
}

fn restore(bytes: &[u8]) -> Result<Session> {
    Session::restore(bytes, networks(), RestoreOptions::default())
}

/// The first photograph of a board, changed.
fn first(body: &mut Body, change: impl FnOnce(&mut Photograph)) {
    let Capture::Board(board) = body.capture.to_mut() else { panic!("no board") };
    change(&mut board.photographs[0]);
}

#[test]
fn what_was_read_is_written_to_the_same_bytes() {
    assert!(rewritten(|_, _| {}) == example());
    let session = restore(example()).unwrap();
    assert!(session.save().unwrap() == example());
}

/// Sums are right, but what they cover is nonsense: a fault or a session, never a panic.
#[test]
fn nonsense_with_the_right_sums_does_no_harm() {
    let (mut taken, mut refused) = (0, 0);
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = (any::<prop::sample::Index>(), 0..5_u8, any::<[u8; 8]>());
    for round in 0..120 {
        use proptest::strategy::ValueTree;
        let (place, kind, value) = strategy.new_tree(&mut runner).unwrap().current();
        let mut bytes = example().to_vec();
        // Beginnings hold what steers, ends are pixels.
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
    let damaged = |what: &str, change: &dyn Fn(&mut Head, &mut Body)| {
        let fault = restore(&rewritten(change)).err();
        assert!(matches!(fault, Some(Error::State(_))), "{what}: {fault:?}");
    };
    damaged("sample", &|head, _| head.settings.to_mut().sample_mm[0] = f32::NAN);
    damaged("resolution", &|head, _| head.settings.to_mut().resolution = 300);
    damaged("resolution", &|head, _| head.settings.to_mut().resolution = 512);
    damaged("budget", &|head, _| head.budget.seconds = Some(-1.0));
    damaged("count", &|head, _| head.photographs += 1);
    damaged("corner", &|_, body| first(body, |p| p.measured.corners[3].px.x = f64::INFINITY));
    damaged("prior", &|_, body| first(body, |p| p.measured.prior.focal_sigma = -1.0));
    damaged("exposure", &|_, body| first(body, |p| p.measured.squares.exposure = 0.0));
    damaged("pose", &|_, body| first(body, |p| p.pose.rotation.x_axis.x += 0.1));
    damaged("pose", &|_, body| first(body, |p| p.pose.rotation.x_axis.x = f64::NAN));
    damaged("part", &|_, body| first(body, |p| p.part = None));
    damaged("maps", &|_, body| body.maps = None);
    damaged("exposure", &|_, body| body.light_correction.exponent = f64::NAN);
    damaged("loss", &|_, body| body.loss_before = f32::NAN);
    damaged("capture", &|_, body| {
        let scene = Scene::Rectified { falloff: Default::default() };
        let rectified = Capture::new(scene, &Settings::default()).unwrap();
        body.capture = Cow::Owned(rectified);
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

/// Wherever a fit is left, it is gone on with from where its latest photograph came, or its end: to the
/// same bits as if nothing had happened. With so many photographs and tasks that all phases lie between.
#[test]
fn a_fit_that_is_begun_again_where_its_photograph_came_ends_the_same() {
    let networks = networks();
    let run = |task: Task, count: usize, options: &EstimateOptions, covered: bool, saved: bool| {
        let again = |estimation: &Estimation, photographs: &[Observation]| {
            let bytes = postcard::to_stdvec(&estimation.save()).unwrap();
            let read = postcard::from_bytes(&bytes).unwrap();
            let (networks, options) = (networks.clone(), options.clone());
            let (photographs, maps) = (photographs.to_vec(), estimation.maps().ok());
            Estimation::restore(networks, task, options, read, photographs, maps).unwrap()
        };
        let mut estimation = Estimation::new(networks.clone(), task, options.clone());
        let mut meter = Meter::new(Budget::default());
        let all = photographs(count, covered);
        for (i, observation) in all.iter().enumerate() {
            let start = (i == 0).then(|| first_maps(&networks, observation).unwrap());
            estimation.add(Addition::new(observation.clone()), start.as_ref()).unwrap();
            if saved {
                estimation = again(&estimation, &all[..=i]);
            }
            // Most come before the fit has settled, the last but one when it has.
            let steps = if i + 2 == count { usize::MAX } else { 3 };
            for _ in 0..steps {
                if estimation.step(&mut meter).unwrap().done {
                    break;
                }
            }
            if saved && estimation.is_done() {
                estimation = again(&estimation, &all[..=i]);
            }
        }
        let mut fraction = 0.0;
        loop {
            let step = estimation.step(&mut meter).unwrap();
            assert!(step.fraction >= fraction, "the share done goes back");
            fraction = step.fraction;
            if step.done {
                let parts = estimation.residuals().unwrap().iter().any(|fit| fit.part.is_some());
                assert_eq!(parts, covered, "a part is left out where a hand covers it");
                let phases =
                    estimation.reports().iter().map(|report| report.name).collect::<Vec<_>>();
                return (estimation.maps().unwrap(), estimation.loss(), phases);
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
        (deep, 5, &default, false),
        (deep, 5, &default, true),
        (free, 8, &default, false),
        (classic, 2, &default, false),
        (free, 5, &large, false),
    ] {
        let [plain, saved] = [false, true].map(|saved| run(task, count, options, covered, saved));
        assert!(plain == saved, "{task:?} {count}: {} {}", plain.1, saved.1);
        phases.extend(plain.2);
    }
    for phase in ["latent", "relief", "choice", "joint", "texels", "baseline"] {
        assert!(phases.contains(&phase), "{phase:?} was not tested");
    }
}

#[test]
fn other_networks_go_on_from_the_maps() {
    // As if the decoder's answer to the probe had been another one.
    let bytes = rewritten(|_, body| body.milestone.estimate.forget_networks());
    let restore = |bytes: &[u8]| super::tests::restore(bytes).unwrap();
    let (same, other) = (restore(example()), restore(&bytes));
    assert_eq!(same.snapshot().unwrap(), other.snapshot().unwrap());
    other.set_budget(Budget { steps: Some(6), ..Budget::default() }).unwrap();
    other.wait().unwrap();
    assert!(other.progress().loss < other.progress().loss_before);
}
