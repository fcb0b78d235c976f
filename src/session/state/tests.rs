use super::bytes::{Sections, StateWriter};
use super::*;
use crate::Error;
use crate::observation::{Falloff, View};
use crate::session::fit::NewFrame;
use crate::session::{RestoreOptions, Session};
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

/// A board's photographs in a room that the sample mirrors differently in each.
#[test]
fn what_a_sample_mirrors_is_kept() {
    let (size, networks) = (256, networks());
    let settings = Settings { resolution: size, ..Settings::default() };
    let mut fit = Fit::new(networks.clone(), &settings);
    let truth = two_tones(size);
    for i in 0..3 {
        let at = [20.0 * i as f32, 0.0, 250.0];
        let falloff = Falloff::InverseSquare { power_mm2: [2e5; 3] };
        let view = View { falloff, ambient: [0.05; 3], ..view_from(at) };
        let observation = photograph(&truth, view);
        let start = (i == 0).then(|| Arc::new(truth.clone()));
        fit.add(NewFrame { observation, start, updates: Vec::new(), restart: false }).unwrap();
    }
    fit.correction.mirrored = vec![0.3, -0.5, 0.0];
    let mut state = StateWriter::new();
    let progress = fit::SavedProgress { loss_before: 0.1, fraction: 0.5, seconds: 1.0, steps: 3 };
    fit::write(&mut state, &fit, &std::collections::VecDeque::new(), &progress);
    let bytes = state.finish();
    let (read, _) = fit::read(&Sections::read(&bytes).unwrap(), &networks, &settings).unwrap();
    assert_eq!(read.correction, fit.correction);
    for ((observation, given), log) in
        read.observations.iter().zip(&read.given).zip(&fit.correction.mirrored)
    {
        assert_eq!(given.mirrored, 1.0);
        assert!((observation.view.mirrored - log.exp() as f32).abs() < 1e-6);
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
