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

/// Root mean square differences of each map, in units of the first session's stated deviation.
fn deviations_off(session: &Session, other: &Session) -> Vec<f32> {
    let stated = session.snapshot_with_uncertainty().unwrap().uncertainty.of_maps();
    let stated = [stated.normal, stated.diffuse, stated.specular, stated.roughness];
    let (maps, others) = (session.snapshot().unwrap(), other.snapshot().unwrap());
    let of_map = |(planes, stated): (std::ops::Range<usize>, f32)| {
        let count = planes.len() * maps.texels();
        let of_plane = |c| maps.plane(c).iter().zip(others.plane(c));
        let sum: f32 = planes.flat_map(of_plane).map(|(a, b)| (a - b).powi(2)).sum();
        (sum / count as f32).sqrt() / stated
    };
    [0..2, 2..5, 5..8, 8..9].into_iter().zip(stated).map(of_map).collect()
}

/// Adds the photograph of a number.
type Push<'a> = &'a dyn Fn(&Session, usize);

/// Adds one photograph after the other, most before the fit has settled. `saved`: after each, and again in the
/// middle of its fit, the session is replaced by one that was restored.
fn gone_on_with(session: Session, push: Push, count: usize, saved: bool) -> Session {
    let options = RestoreOptions { driver: Driver::Caller, ..RestoreOptions::default() };
    let again = |session: Session| {
        let state = session.save().unwrap();
        let begun = Instant::now();
        let restored = Session::restore(&state, networks(), options).unwrap();
        println!("{} bytes restored in {:?}", state.len(), begun.elapsed());
        assert_eq!(restored.progress().photos, session.progress().photos);
        assert_eq!(restored.progress().settled, session.progress().settled);
        assert!(restored.snapshot().is_ok());
        restored
    };
    let mut session = session;
    for i in 0..count {
        push(&session, i);
        step_until(&session, [0.1, 0.6][i % 2]);
        if saved {
            session = again(session);
        }
        session.wait().unwrap();
        if saved {
            let restored = again(session);
            session = restored;
        }
    }
    session
}

/// Saved wherever the fit is, restored and gone on with, a session ends with the maps of one that was never left, within
/// a twentieth of their stated deviations. The caller drives the fit, so that photographs come at the same moments.
#[test]
fn going_on_after_restoring_is_going_on() {
    let settings = Settings { driver: Driver::Caller, threads: 2, ..Settings::default() };
    let tile = Capture::load(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile"));
    let tile = tile.unwrap();
    let photos: Vec<Photo> = tile.photos[..4].iter().map(|f| f.read().unwrap()).collect();
    let of_board = |session: &Session, i: usize| {
        assert!(matches!(session.add_photo(&photos[i]).unwrap(), Outcome::Accepted(_)));
    };
    let board = Settings { sample_mm: tile.sample_mm, ..settings.clone() };
    let Scene::Board { target, .. } = tile.scene.clone() else { panic!("no board") };
    let unknown = Scene::board(target).into();
    let cases: [(&str, Scene, Settings, Push, usize); 3] = [
        ("rectified", scene(), settings, &push, 3),
        ("board", tile.scene.clone(), board.clone(), &of_board, 4),
        ("unknown camera", unknown, board, &of_board, 4),
    ];
    for (name, scene, settings, push, count) in cases {
        let run = |saved: bool| {
            let session = Session::with_networks(scene.clone(), settings.clone(), networks());
            gone_on_with(session.unwrap(), push, count, saved)
        };
        let (plain, left) = (run(false), run(true));
        assert_eq!((left.settings(), left.scene()), (plain.settings(), plain.scene()));
        let off = deviations_off(&plain, &left);
        println!("{name}: {off:.4?} of the stated deviations off");
        assert!(off.iter().all(|off| *off < 0.05), "{name}: {off:?}");
    }
}

/// Settled sessions come back as they are.
#[test]
fn settled_sessions_come_back_as_they_are() {
    let session = session(Settings { driver: Driver::Caller, ..Settings::default() });
    push(&session, 0);
    session.wait().unwrap();
    let restored = restore(&session.save().unwrap());
    assert_eq!(restored.snapshot().unwrap(), session.snapshot().unwrap());
    assert_eq!(restored.progress(), session.progress());
    assert_eq!(restored.settings().sample_mm, session.settings().sample_mm);
    assert_eq!(restored.scene(), session.scene());
    assert_eq!(restored.light_correction(), session.light_correction());
}

/// A photograph takes six bytes a texel and its measurements; two sets of maps take 36 bytes a texel each.
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
    assert!(state.len() < 50 * (6 * texels + 200) + 80 * texels, "{} bytes", state.len());
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

/// With an estimated camera every photograph changes the estimates of the earlier ones.
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
        // Without the fit: this tests the calibration before it.
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
        // Measurements are stored exactly.
        assert_eq!(restored.camera(), straight.camera());
        assert_eq!(restored.poses(), straight.poses());
        assert_eq!(restored.flash_offset_mm(), straight.flash_offset_mm());
        assert_eq!(restored.ambient_fraction(), straight.ambient_fraction());
        // The fit has the same photographs but for roundings, those rectified anew too.
        let few = Budget { steps: Some(5), ..Budget::default() };
        for session in [&straight, &restored] {
            session.set_budget(few).unwrap();
            session.wait().unwrap();
        }
        let off = deviations_off(&straight, &restored);
        assert!(off.iter().all(|off| *off < 0.05), "{off:?}");
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
    let sum = crc32fast::hash(&newer[..22]);
    newer[22..26].copy_from_slice(&sum.to_le_bytes());
    assert_eq!(fault(&newer), StateFault::Newer { found: 2, known: 1 });
    // Nothing of all this has touched the session.
    session.resume();
    session.wait().unwrap();
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
