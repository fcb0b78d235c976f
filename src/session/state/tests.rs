use super::bytes::{Sections, StateWriter};
use super::*;
use crate::Error;
use crate::estimate::options::ScheduleOptions;
use crate::estimate::{
    Addition, Budget, EstimateOptions, Estimation, Meter, Method, Phase, Task, first_maps,
};
use crate::observation::{Observation, View};
use crate::session::{RestoreOptions, Scene, Session, Settings};
use crate::test_support::{photograph, two_tones, view_from};
use proptest::prelude::*;
use std::sync::OnceLock;

fn networks() -> Arc<Networks> {
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    NETWORKS.get_or_init(|| Arc::new(Networks::embedded().unwrap())).clone()
}

/// A session with two photographs of a board, the camera unknown, the fit begun.
fn example() -> &'static [u8] {
    static STATE: OnceLock<Vec<u8>> = OnceLock::new();
    STATE.get_or_init(|| {
        let dir = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");
        let capture = crate::capture::Capture::load(dir).unwrap();
        let Scene::Board { target, .. } = capture.scene else { panic!("no board") };
        let scene =
            Scene::Board { target, camera: None, flash_offset_mm: None, elevation_mm: None };
        let settings = Settings { sample_mm: capture.sample_mm, threads: 2, ..Settings::default() };
        let session = Session::with_networks(scene, settings, networks()).unwrap();
        let budget = Budget { steps: Some(4), ..Budget::default() };
        session.set_budget(budget).unwrap();
        for frame in &capture.frames[..2] {
            session.push(&frame.read().unwrap()).unwrap();
        }
        session.wait().unwrap();
        session.save().unwrap()
    })
}

/// The same sections with new content, their sums right.
fn resealed(change: impl Fn(&[u8; 4], &mut Vec<u8>)) -> Vec<u8> {
    let mut state = StateWriter::new();
    for (tag, content) in Sections::read(example()).unwrap().raw() {
        let mut content = content.to_vec();
        change(tag, &mut content);
        state.section(tag, |w| w.bytes(&content));
    }
    state.finish()
}

#[test]
fn unchanged_sections_are_taken() {
    assert_eq!(resealed(|_, _| {}), example());
    assert!(Session::restore(example(), networks(), RestoreOptions::default()).is_ok());
}

/// Sums are right, but what they cover is nonsense: a fault or a session, never a panic.
#[test]
fn nonsense_with_the_right_sums_does_no_harm() {
    let tags: Vec<[u8; 4]> =
        Sections::read(example()).unwrap().raw().iter().map(|(tag, _)| *tag).collect();
    let (mut taken, mut refused) = (0, 0);
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = (0..tags.len(), any::<prop::sample::Index>(), 0..5_u8, any::<[u8; 8]>());
    for round in 0..120 {
        use proptest::strategy::ValueTree;
        let (section, place, kind, value) = strategy.new_tree(&mut runner).unwrap().current();
        let bytes = resealed(|tag, content| {
            if *tag != tags[section] || content.is_empty() {
                return;
            }
            // Beginnings hold what steers, ends are pixels.
            let reach = if round % 2 == 0 { content.len() } else { content.len().min(200) };
            let at = place.index(reach);
            match kind {
                0 => content[at] ^= value[0] | 1,
                1 => content.truncate(at),
                2 => content.extend_from_slice(&value),
                _ => {
                    let end = (at + 8).min(content.len());
                    let special = [value, [0xFF; 8], [0; 8], f64::NAN.to_le_bytes()];
                    let value = special[usize::from(value[0] % 4)];
                    content[at..end].copy_from_slice(&value[..end - at]);
                }
            }
        });
        match Session::restore(&bytes, networks(), RestoreOptions::default()) {
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

/// Photographs from round the sample in a room, for an estimate of a few texels.
fn photographs(count: usize) -> Vec<Observation> {
    let truth = two_tones(SIDE);
    let at = |i: usize| [40.0 * (i as f32 * 2.0).sin(), 40.0 * (i as f32 * 2.0).cos(), 120.0];
    let view = |i| View { ambient: [0.05; 3], ..view_from(at(i)) };
    (0..count).map(|i| photograph(&truth, view(i))).collect()
}

const SIDE: usize = 64;

/// Saved between any two steps, whatever the phase: the same bits as if nothing had happened.
#[test]
fn an_estimate_that_is_saved_after_every_step_ends_the_same() {
    let networks = networks();
    let run = |task: Task, count: usize, options: &EstimateOptions, saved: bool| {
        let mut estimation = Estimation::new(networks.clone(), task, options.clone());
        let mut meter = Meter::new(Budget::default(), 0.0, 0);
        let mut phases = Vec::new();
        let mut fraction = 0.0;
        for observation in photographs(count) {
            let none = estimation.frames() == 0;
            let start = none.then(|| first_maps(&networks, &observation).unwrap());
            estimation.add(Addition::new(observation), start.as_ref()).unwrap();
        }
        loop {
            let step = estimation.step(&mut meter).unwrap();
            assert!(step.fraction >= fraction, "the share done goes back");
            fraction = step.fraction;
            phases.extend(step.phase.filter(|phase| !phases.contains(phase)));
            if step.done {
                return (estimation.maps().unwrap(), estimation.loss(), phases);
            }
            if saved {
                let mut state = StateWriter::new();
                let progress =
                    estimation::SavedProgress { loss_before: 0.1, seconds: 1.0, steps: 3 };
                estimation::write(&mut state, &estimation, &progress);
                let bytes = state.finish();
                let sections = Sections::read(&bytes).unwrap();
                let read = estimation::read(&sections, &networks, task, SIDE, options.clone());
                let read = read.unwrap();
                assert_eq!(read.2, progress);
                estimation = read.0;
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
    for (task, count, options) in
        [(deep, 5, &default), (free, 3, &default), (classic, 1, &default), (free, 5, &large)]
    {
        let [plain, saved] = [false, true].map(|saved| run(task, count, options, saved));
        assert!(plain == saved, "{task:?} {count}: {} {}", plain.1, saved.1);
        phases.extend(plain.2);
    }
    use Phase::{Baseline, Classes, HeldLights, Latent, Maps, Network, PoolGloss};
    for phase in [Latent, PoolGloss, HeldLights, Maps, Phase::Slopes, Classes, Network, Baseline] {
        assert!(phases.contains(&phase), "{phase:?} was not tested");
    }
}

#[test]
fn other_networks_go_on_from_the_maps() {
    // As if the decoder's answer to the probe had been another one.
    let bytes = resealed(|tag, content| {
        if tag == b"LATN" {
            content[4..8].copy_from_slice(&9.0_f32.to_le_bytes());
        }
    });
    let restore =
        |bytes: &[u8]| Session::restore(bytes, networks(), RestoreOptions::default()).unwrap();
    let (same, other) = (restore(example()), restore(&bytes));
    assert_eq!(same.snapshot().unwrap(), other.snapshot().unwrap());
    other.set_budget(Budget { steps: Some(6), ..Budget::default() }).unwrap();
    other.wait().unwrap();
    assert!(other.progress().loss < other.progress().loss_before);
}
