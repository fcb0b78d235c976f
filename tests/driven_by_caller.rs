//! A session without a thread of its own: the same maps, and every question answered between steps.

use std::time::Duration;

use svbrdf::capture::Capture;
use svbrdf::photo::Photo;
use svbrdf::session::{Budget, Driver, Outcome, RestoreOptions, Session, Settings};
use svbrdf::{Error, networks::Networks};

const CAPTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");

fn photos(count: usize) -> (Capture, Vec<Photo>) {
    let capture = Capture::load(CAPTURE).unwrap();
    let photos = capture.photos[..count].iter().map(|f| f.read().unwrap()).collect();
    (capture, photos)
}

fn session(capture: &Capture, driver: Driver, steps: Option<u32>) -> Session {
    let settings =
        Settings { sample_mm: capture.sample_mm, threads: 2, driver, ..Settings::default() };
    let session = Session::new(capture.scene.clone(), settings).unwrap();
    session.set_budget(Budget { steps, ..Budget::default() }).unwrap();
    session
}

fn accepted(session: &Session, photo: &Photo) {
    let outcome = session.add_photo(photo).unwrap();
    assert!(matches!(outcome, Outcome::Accepted(_)), "{outcome:?}");
}

#[test]
fn steps_of_the_caller_lead_to_the_maps_of_the_thread_to_the_bit() {
    let (capture, photos) = photos(2);
    let run = |driver, settle: &dyn Fn(&Session)| {
        let session = session(&capture, driver, Some(12));
        for photo in &photos {
            accepted(&session, photo);
            settle(&session);
        }
        assert!(session.progress().settled);
        let maps = session.snapshot().unwrap();
        (maps.planes().iter().map(|v| v.to_bits()).collect::<Vec<_>>(), session.evidence().is_ok())
    };
    let threaded = run(Driver::Thread, &|s| s.wait().unwrap());
    let stepped = run(Driver::Caller, &|s| {
        let mut steps = 0;
        while s.step().unwrap() {
            steps += 1;
        }
        assert!(steps > 3, "{steps}");
    });
    let waited = run(Driver::Caller, &|s| s.wait().unwrap());
    assert!(threaded == stepped && threaded == waited);
}

/// Without a thread nobody else would answer: each of these would wait for ever.
#[test]
fn questions_are_answered_between_two_steps() {
    let (capture, photos) = photos(2);
    let session = session(&capture, Driver::Caller, Some(8));
    accepted(&session, &photos[0]);
    // The maps of the photograph are there before the first step.
    session.snapshot().unwrap();
    assert!(!session.progress().settled);
    assert_eq!(session.photo_fits().unwrap().len(), 1);
    assert!(session.step().unwrap());
    assert!(session.next_view().is_some());
    session.snapshot_with_uncertainty().unwrap();
    assert!(!session.wait_timeout(Duration::ZERO).unwrap());
    accepted(&session, &photos[1]);
    let saved = session.save().unwrap();
    session.remove_photo(0).unwrap();
    assert_eq!(session.progress().photos, 1);
    while session.step().unwrap() {}
    assert!(session.progress().settled);

    // A saved session is driven as whoever restores it says.
    let networks = std::sync::Arc::new(Networks::embedded().unwrap());
    let options = RestoreOptions { driver: Driver::Caller, ..RestoreOptions::default() };
    let restored = Session::restore(&saved, networks, options).unwrap();
    assert_eq!(restored.progress().photos, 2);
    assert!(restored.step().unwrap());
}

/// A photograph that comes early takes nothing back: the fraction goes from 0 to 1 over all that were announced.
#[test]
fn the_fraction_of_announced_photographs_never_falls() {
    let (capture, photos) = photos(3);
    let session = session(&capture, Driver::Caller, Some(12));
    let mut told = vec![session.progress().fraction];
    let mut tell = |session: &Session| told.push(session.progress().fraction);
    session.announce(photos.len() + 1);
    // The second comes when the fit has settled, the third in its middle.
    for (photo, steps) in photos.iter().zip([usize::MAX, 5, usize::MAX]) {
        accepted(&session, photo);
        tell(&session);
        let mut left = steps;
        while left > 0 && session.step().unwrap() {
            tell(&session);
            left -= 1;
        }
    }
    assert!(session.progress().settled && session.progress().fraction == 0.75);
    let black = Photo::from_linear(64, 48, vec![0.0; 3 * 64 * 48], 1.0, 9.0).unwrap();
    assert!(matches!(session.add_photo(&black), Ok(Outcome::Rejected(_))));
    tell(&session);
    assert!(told.is_sorted(), "{told:?}");
    assert_eq!([told[0], *told.last().unwrap()], [0.0, 1.0]);
    assert!(told.iter().filter(|&&f| f > 0.0 && f < 1.0).count() > 10, "{told:?}");

    // More than were announced: of each photograph again, from its push on.
    accepted(&session, &photos[0]);
    assert_eq!(session.progress().fraction, 0.0);
    session.wait().unwrap();
    assert_eq!(session.progress().fraction, 1.0);
    session.remove_photo(3).unwrap();
    assert_eq!(session.progress().fraction, 0.0);
}

#[test]
fn pauses_and_ends_are_told() {
    let (capture, photos) = photos(1);
    let stepped = session(&capture, Driver::Caller, Some(8));
    // The budget is a message.
    while stepped.step().unwrap() {}
    assert!(!stepped.step().unwrap(), "nothing to do");
    accepted(&stepped, &photos[0]);
    stepped.pause();
    // Messages are taken while paused, steps are not done.
    while stepped.step().unwrap() {}
    assert!(!stepped.progress().settled);
    stepped.resume();
    assert!(stepped.step().unwrap());
    stepped.cancel();
    assert!(matches!(stepped.step(), Err(Error::Cancelled)));
    assert!(matches!(stepped.save(), Err(Error::Cancelled)));
    stepped.snapshot().unwrap();

    // Who waits goes on when another thread ends the pause.
    let paused = session(&capture, Driver::Caller, Some(8));
    paused.pause();
    accepted(&paused, &photos[0]);
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| paused.wait());
        // Most likely it waits by then; the assertions hold in either case.
        std::thread::sleep(Duration::from_millis(50));
        assert!(!paused.progress().settled);
        paused.resume();
        waiting.join().unwrap().unwrap();
    });
    assert!(paused.progress().settled);

    let threaded = session(&capture, Driver::Thread, Some(8));
    assert!(matches!(threaded.step(), Err(Error::Argument { argument: "driver", .. })));
}
