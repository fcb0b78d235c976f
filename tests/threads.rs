//! The hook at the start of the library's threads: one for the process, so one test.

use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use svbrdf::observation::Falloff;
use svbrdf::session::{RectifiedFalloff, Scene, Session, Settings};
use svbrdf::threads::{Role, set_start_hook};

/// How long a busy machine may take to run a thread.
const PATIENCE: Duration = Duration::from_secs(600);

#[test]
fn every_thread_of_a_session_calls_the_hook_first() {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let hook = {
        let seen = seen.clone();
        Arc::new(move |role| {
            let name = thread::current().name().unwrap_or_default().to_owned();
            seen.lock().unwrap().push((name, role));
            panic!("deliberate: a hook's panic is dropped");
        })
    };
    let start = || {
        let falloff = RectifiedFalloff::Given(Falloff::None { power: [1.0; 3] });
        let settings = Settings { threads: 3, ..Settings::default() };
        Session::new(Scene::Rectified { falloff }, settings).unwrap()
    };
    // Those that pools start run the hook in their own time.
    let wait = |count: usize| {
        let of_session = |(name, _): &&(String, Role)| !name.starts_with("svbrdf-global");
        let begun = Instant::now();
        while seen.lock().unwrap().iter().filter(of_session).count() < count {
            assert!(begun.elapsed() < PATIENCE, "{:?}", seen.lock().unwrap());
            thread::sleep(Duration::from_millis(1));
        }
        let mut found: Vec<_> = seen.lock().unwrap().iter().filter(of_session).cloned().collect();
        found.sort_by(|a, b| a.0.cmp(&b.0));
        found
    };
    set_start_hook(Some(hook));
    let session = start();
    let work = |i: usize| (format!("svbrdf-{i}"), Role::Work);
    let expected = [work(0), work(1), work(2), ("svbrdf-fit".to_owned(), Role::Fit)];
    assert_eq!(wait(4), expected);
    // The threads of work outside of sessions.
    let begun = Instant::now();
    while !seen.lock().unwrap().iter().any(|(name, _)| name == "svbrdf-global-0") {
        assert!(begun.elapsed() < PATIENCE, "{:?}", seen.lock().unwrap());
        thread::sleep(Duration::from_millis(1));
    }
    set_start_hook(None);
    drop(start());
    drop(session);
    assert_eq!(wait(4), expected, "nobody is called any more");
}
