//! Sessions saved and gone on with, budgets and memory limits, from the outside.

#[path = "common/rectified.rs"]
mod rectified;

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use rectified::{POSITIONS, material, scene};
use svbrdf::capture::Capture;
use svbrdf::networks::Networks;
use svbrdf::photo::Photo;
use svbrdf::session::{
    Budget, Driver, Method, Outcome, RectifiedFalloff, RestoreOptions, Scene, Session, Settings,
};
use svbrdf::{Error, StateFault, Svbrdf};

fn networks() -> Arc<Networks> {
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    NETWORKS.get_or_init(|| Arc::new(Networks::embedded().unwrap())).clone()
}

/// A photograph of the material.
fn photo(camera_mm: [f32; 3]) -> Photo {
    rectified::photo(&material(), camera_mm)
}

fn session(settings: Settings) -> Session {
    let settings = Settings { threads: 2, ..settings };
    Session::with_networks(scene(), settings, networks()).unwrap()
}

fn push(session: &Session, i: usize) {
    let outcome =
        session.add_rectified_photo(&photo(POSITIONS[i]), POSITIONS[i], POSITIONS[i]).unwrap();
    assert!(matches!(outcome, Outcome::Accepted(_)));
}

fn restore(state: &[u8]) -> Session {
    Session::restore(state, networks(), RestoreOptions::default()).unwrap()
}

/// Root mean square difference, all planes together.
fn difference(a: &Svbrdf, b: &Svbrdf) -> f32 {
    let sum: f32 = a.planes().iter().zip(b.planes()).map(|(a, b)| (a - b).powi(2)).sum();
    (sum / a.planes().len() as f32).sqrt()
}

/// Steps of the caller's until so much of the work is done.
fn step_until(session: &Session, fraction: f32) {
    while session.step().unwrap() && session.progress().fraction < fraction {}
}

/// Saved wherever the fit is, restored and gone on with: to the same bits as if nothing had happened. The caller
/// drives the fit, so that photographs come at the same moments.
#[test]
fn going_on_after_restoring_is_going_on() {
    for method in [Method::Deep, Method::Classic] {
        let settings = Settings { method, driver: Driver::Caller, ..Settings::default() };
        let options = RestoreOptions { driver: Driver::Caller, ..RestoreOptions::default() };
        let again = |session: &Session| {
            let state = session.save().unwrap();
            let begun = Instant::now();
            let restored = Session::restore(&state, networks(), options).unwrap();
            println!("{method:?}: {} bytes restored in {:?}", state.len(), begun.elapsed());
            restored
        };
        let run = |saved: bool| {
            let mut session = session(settings.clone());
            push(&session, 0);
            session.wait().unwrap();
            if saved {
                // Settled: everything is as it was.
                let restored = again(&session);
                assert_eq!(restored.snapshot().unwrap(), session.snapshot().unwrap());
                assert_eq!(restored.progress(), session.progress());
                assert_eq!(restored.settings(), session.settings());
                assert_eq!(restored.scene(), session.scene());
                session = restored;
            }
            // One comes once the fit has settled, one in its middle.
            for (i, share) in [(1, 0.4), (2, 0.7)] {
                push(&session, i);
                step_until(&session, share);
                if saved {
                    let restored = again(&session);
                    assert_eq!(restored.progress().photos, i + 1);
                    // Maps are the latest; what led to them is done again.
                    assert_eq!(restored.snapshot().unwrap(), session.snapshot().unwrap());
                    assert!(!restored.progress().settled);
                    session = restored;
                    let begun = Instant::now();
                    step_until(&session, share);
                    println!("{method:?}: {share} of the fit again in {:?}", begun.elapsed());
                }
            }
            session.wait().unwrap();
            (session.snapshot().unwrap(), session.progress().loss, session.light_correction())
        };
        assert!(run(false) == run(true), "{method:?}");
    }
}

/// A photograph takes six bytes a texel, and what is measured in it; the fit up to 130 bytes a texel.
#[test]
fn fifty_photographs_are_saved_small() {
    let session = session(Settings::default());
    session.pause();
    let photo = photo(POSITIONS[0]);
    for i in 0..50 {
        let at = [i as f32, 0.0, 110.0];
        let outcome = session.add_rectified_photo(&photo, at, at).unwrap();
        assert!(matches!(outcome, Outcome::Accepted(_)));
    }
    let begun = Instant::now();
    let state = session.save().unwrap();
    let saved = begun.elapsed();
    let begun = Instant::now();
    assert_eq!(restore(&state).progress().photos, 50);
    let texels = rectified::SIZE * rectified::SIZE;
    println!("{} bytes, saved in {saved:?}, restored in {:?}", state.len(), begun.elapsed());
    assert!(state.len() < 50 * (6 * texels + 200) + 130 * texels, "{} bytes", state.len());
}

#[test]
fn saving_does_not_change_or_hold_up_a_fit() {
    let [saved, plain] = [Driver::Caller, Driver::Thread].map(|driver| {
        let session = session(Settings { driver, ..Settings::default() });
        // Both fits begin with both photographs, and a saved one that is held is not waited for.
        session.pause();
        (0..2).for_each(|i| push(&session, i));
        session.save().unwrap();
        session.resume();
        session
    });
    let (mut slowest, mut count) = (Duration::ZERO, 0);
    while saved.step().unwrap() {
        let begun = Instant::now();
        saved.save().unwrap();
        slowest = slowest.max(begun.elapsed());
        count += 1;
    }
    plain.wait().unwrap();
    println!("saved {count} times during a fit, {slowest:?} at most");
    assert_eq!(saved.snapshot().unwrap(), plain.snapshot().unwrap());
    assert!(count >= 3);
}

#[test]
fn sessions_without_photographs_are_saved_and_cancelled_ones_are_not() {
    let empty = session(Settings { resolution: 512, ..Settings::default() });
    let state = empty.save().unwrap();
    println!("an empty session takes {} bytes", state.len());
    let restored = restore(&state);
    assert_eq!(restored.settings(), empty.settings());
    assert!(matches!(restored.snapshot(), Err(Error::NoMaps)));
    assert!(restored.wait_timeout(Duration::ZERO).unwrap());
    empty.cancel();
    assert!(matches!(empty.save(), Err(Error::Cancelled)));
}

/// With a camera that is estimated every photograph changes what is known of the earlier ones.
#[test]
fn camera_and_light_go_on_as_well() {
    let capture = Capture::load(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile"));
    let capture = capture.unwrap();
    let Scene::Board { target, camera, .. } = capture.scene.clone() else { panic!("no board") };
    for camera in [None, camera] {
        let scene = Scene::Board {
            target: target.clone(),
            camera,
            flash_offset_mm: None,
            elevation_mm: None,
        };
        // Without the fit: this is about what happens before it.
        let driver = Driver::Caller;
        let settings = Settings { sample_mm: capture.sample_mm, driver, ..Settings::default() };
        let straight = Session::with_networks(scene, settings, networks()).unwrap();
        let push = |session: &Session, i: usize| {
            let photo = capture.photos[i].read().unwrap();
            assert!(matches!(session.add_photo(&photo).unwrap(), Outcome::Accepted(_)));
        };
        push(&straight, 0);
        push(&straight, 1);
        let state = straight.save().unwrap();
        println!("two photographs of {} px: {} bytes", 2016 * 1512, state.len());
        let options = RestoreOptions { driver, ..RestoreOptions::default() };
        let restored = Session::restore(&state, networks(), options).unwrap();
        assert_eq!(restored.camera(), straight.camera());
        assert_eq!(restored.camera_sigma(), straight.camera_sigma());
        assert_eq!(restored.poses(), straight.poses());
        push(&straight, 2);
        push(&restored, 2);
        // What was measured is stored exactly.
        assert_eq!(restored.camera(), straight.camera());
        assert_eq!(restored.poses(), straight.poses());
        assert_eq!(restored.flash_offset_mm(), straight.flash_offset_mm());
        assert_eq!(restored.ambient_fraction(), straight.ambient_fraction());
        // The fit has the same photographs, those rectified anew too.
        let few = Budget { steps: Some(5), ..Budget::default() };
        let maps = [&straight, &restored].map(|session| {
            session.set_budget(few).unwrap();
            session.wait().unwrap();
            session.snapshot().unwrap()
        });
        assert!(maps[0] == maps[1]);
    }
}

#[test]
fn damaged_states_are_faults_of_their_own_kind() {
    let session = session(Settings::default());
    session.pause();
    push(&session, 0);
    let state = session.save().unwrap();
    let fault = |bytes: &[u8]| match Session::restore(bytes, networks(), RestoreOptions::default())
    {
        Err(Error::State(fault)) => fault,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("{} bytes were taken", bytes.len()),
    };
    assert_eq!(fault(b""), StateFault::Foreign);
    assert_eq!(fault(b"not a session at all, but long enough to be one"), StateFault::Foreign);
    // Cut anywhere: in the header, at its end, in the content.
    let mut ends = vec![1, 7, 8, 12, 19, 25, 26, 27, state.len() - 1];
    ends.extend((1..40).map(|i| state.len() * i / 40));
    for end in ends {
        assert_eq!(fault(&state[..end]), StateFault::Truncated, "{end} bytes");
    }
    let mut random = 1_u64;
    for _ in 0..300 {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let mut bad = state.clone();
        let bit = (random >> 16) as usize % (8 * bad.len());
        bad[bit / 8] ^= 1 << (bit % 8);
        fault(&bad);
    }
    let mut newer = state.clone();
    newer[8] = 2;
    let sum = crc32(&newer[..22]);
    newer[22..26].copy_from_slice(&sum.to_le_bytes());
    assert_eq!(fault(&newer), StateFault::Newer { found: 2, known: 1 });
    // Nothing of all this has touched the session.
    session.resume();
    session.wait().unwrap();
}

/// The checksum as defined (IEEE 802.3), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 * (crc & 1)))
    })
}

#[test]
fn budgets_end_the_fit_and_larger_ones_take_it_up_again() {
    for method in [Method::Deep, Method::Classic] {
        let full = session(Settings { method, ..Settings::default() });
        push(&full, 0);
        full.wait().unwrap();
        let cut = session(Settings { method, ..Settings::default() });
        cut.set_budget(Budget { steps: Some(5), ..Budget::default() }).unwrap();
        push(&cut, 0);
        cut.wait().unwrap();
        let (little, all) = (cut.progress().loss, full.progress().loss);
        println!("{method:?}: loss {little} after 5 steps, {all} after all");
        assert!(little < cut.progress().loss_before && little > 1.02 * all);
        let before = cut.snapshot().unwrap();
        // Saved and restored, it is still at its end.
        let cut = restore(&cut.save().unwrap());
        cut.wait().unwrap();
        assert_eq!(cut.snapshot().unwrap(), before);
        // A smaller budget changes nothing, none at all goes on to the end.
        cut.set_budget(Budget { steps: Some(4), ..Budget::default() }).unwrap();
        cut.wait().unwrap();
        assert_eq!(cut.snapshot().unwrap(), before);
        cut.pause();
        cut.set_budget(Budget::default()).unwrap();
        assert!(!cut.progress().settled);
        cut.resume();
        cut.wait().unwrap();
        let off = difference(&cut.snapshot().unwrap(), &full.snapshot().unwrap());
        println!("{method:?}: {off} off after going on");
        // Adam on the maps begins anew, the latent fit goes on where it was.
        assert!(cut.progress().loss < 1.05 * all && (method == Method::Classic || off < 0.01));
    }
}

#[test]
fn budgets_that_change_to_and_fro_leave_nobody_waiting() {
    let session = session(Settings::default());
    let steps = |n: u32| Budget { steps: Some(n), ..Budget::default() };
    session.set_budget(steps(2)).unwrap();
    push(&session, 0);
    session.wait().unwrap();
    for i in 0..10 {
        session.set_budget(steps(3 + i)).unwrap();
        session.set_budget(steps(2)).unwrap();
        assert!(session.wait_timeout(Duration::from_secs(600)).unwrap());
    }
}

#[test]
fn a_budget_of_time_is_kept() {
    let settings = || Settings { driver: Driver::Caller, ..Settings::default() };
    let limited = session(settings());
    push(&limited, 0);
    // At least the time that the meter counts.
    let mut worked = Duration::ZERO;
    let mut step = || {
        let begun = Instant::now();
        let more = limited.step().unwrap();
        worked += begun.elapsed();
        (more, worked)
    };
    let (_, worked) = (0..4).map(|_| step()).last().unwrap();
    let seconds = 4.0 * worked.as_secs_f32() + 0.1;
    limited.set_budget(Budget { seconds: Some(seconds), ..Budget::default() }).unwrap();
    // Time in which nothing is done does not count; only a step that takes as long as all that is left ends it.
    std::thread::sleep(Duration::from_secs_f32(seconds));
    let ((more, _), (_, worked)) = (step(), step());
    println!("{worked:?} of {seconds} s");
    assert!(worked.as_secs_f32() > 0.4 * seconds || more && !limited.progress().settled);
    // Long over after any step.
    limited.set_budget(Budget { seconds: Some(1e-6), ..Budget::default() }).unwrap();
    let steps = (0..20).take_while(|_| step().0).count();
    assert!(steps < 5 && limited.progress().settled, "{steps}");
    assert!(limited.progress().loss < limited.progress().loss_before);
    let none = session(Settings::default());
    none.set_budget(Budget { seconds: Some(0.0), ..Budget::default() }).unwrap();
    push(&none, 0);
    none.wait().unwrap();
    assert!(none.snapshot().is_ok());
    assert!(none.set_budget(Budget { seconds: Some(f32::NAN), ..Budget::default() }).is_err());
}

#[test]
fn what_cannot_be_seen_is_not_fitted() {
    let budget = Budget { stop_when_invisible: true, ..Budget::default() };
    let (eager, thrifty) = (session(Settings::default()), session(Settings::default()));
    thrifty.set_budget(budget).unwrap();
    for i in 0..3 {
        let took = [&eager, &thrifty].map(|session| {
            let begun = Instant::now();
            push(session, i);
            session.wait().unwrap();
            begun.elapsed()
        });
        let off = difference(&eager.snapshot().unwrap(), &thrifty.snapshot().unwrap());
        let (all, less) = (eager.progress().loss, thrifty.progress().loss);
        println!("{} photographs: {off} off, {all} after {took:?}, {less}", i + 1);
        // At each photograph half a step of 8 bits may be left on either side; a fit that gives up at
        // once is off by twice that at the first.
        assert!(off < (i + 1) as f32 / 255.0, "{off}");
    }
}

#[test]
fn memory_limits_are_answered_before_anything_is_taken() {
    let limit = |mib: u64| Settings { memory_limit_bytes: Some(mib << 20), ..Settings::default() };
    let falloff = RectifiedFalloff::InverseSquareAuto;
    let scene = Scene::Rectified { falloff };
    let fault = Session::with_networks(scene, limit(16), networks()).err().unwrap();
    assert!(matches!(fault, Error::MemoryLimit { needed, limit } if needed > limit), "{fault}");
    let roomy = session(limit(100_000));
    roomy.pause();
    push(&roomy, 0);
    let state = roomy.save().unwrap();
    let options = RestoreOptions { memory_limit_bytes: Some(1 << 20), ..Default::default() };
    let fault = Session::restore(&state, networks(), options).err().unwrap();
    assert!(matches!(fault, Error::MemoryLimit { .. }), "{fault}");
    // Photographs are taken until the limit is reached; nothing is lost then.
    let Error::MemoryLimit { needed, .. } = fault else { return };
    let tight = session(Settings { memory_limit_bytes: Some(needed + (20 << 20)), ..limit(0) });
    tight.pause();
    let mut taken = 0;
    let fault = loop {
        let i = taken % POSITIONS.len();
        match tight.add_rectified_photo(&photo(POSITIONS[i]), POSITIONS[i], POSITIONS[i]) {
            Ok(_) => taken += 1,
            Err(fault) => break fault,
        }
        assert!(taken < 50);
    };
    assert!(taken > 0 && matches!(fault, Error::MemoryLimit { .. }), "{taken}: {fault}");
    assert_eq!(tight.progress().photos, taken);
    assert!(tight.snapshot().is_ok() && tight.save().is_ok());
}
