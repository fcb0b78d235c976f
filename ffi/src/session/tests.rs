use std::ptr;

use super::*;
use crate::handles::svbrdf_session;
use crate::live::act;
use crate::options::{SVBRDF_SCENE_RECTIFIED, svbrdf_session_options};
use crate::reports::{SVBRDF_STATE_FAILED, svbrdf_progress};
use crate::status::{SVBRDF_FAILED, SVBRDF_INVALID_HANDLE, SVBRDF_NO_MAPS, SVBRDF_OK};

fn create() -> *mut svbrdf_session {
    let options =
        svbrdf_session_options { scene: SVBRDF_SCENE_RECTIFIED, threads: 1, ..Default::default() };
    let mut session = ptr::null_mut();
    // SAFETY: both live here; the options point to nothing.
    assert_eq!(unsafe { svbrdf_session_create(&raw const options, &raw mut session) }, SVBRDF_OK);
    session
}

#[test]
fn a_panic_makes_the_session_fail_for_ever_and_no_other() {
    let (session, other) = (create(), create());
    assert_eq!(act(session, |_| panic!("deliberate")), SVBRDF_FAILED);
    assert_eq!(svbrdf_session_wait(session, 0), SVBRDF_FAILED);
    assert_eq!(svbrdf_session_pause(session), SVBRDF_FAILED);
    let mut progress = svbrdf_progress::default();
    // SAFETY: the struct lives here and has its size.
    assert_eq!(unsafe { svbrdf_session_progress(session, &raw mut progress) }, SVBRDF_OK);
    assert_eq!(progress.state, SVBRDF_STATE_FAILED);
    let mut maps = ptr::null_mut();
    // SAFETY: the result lives here.
    assert_eq!(unsafe { svbrdf_session_snapshot_maps(session, &raw mut maps) }, SVBRDF_NO_MAPS);
    assert_eq!(svbrdf_session_wait(other, 0), SVBRDF_OK);
    assert_eq!(svbrdf_session_destroy(session), SVBRDF_OK);
    assert_eq!(svbrdf_session_destroy(session), SVBRDF_INVALID_HANDLE);
    assert_eq!(svbrdf_session_destroy(other), SVBRDF_OK);
}

#[test]
fn a_panic_while_locks_are_held_does_not_lock_others_out() {
    let session = create();
    let panicking = act(session, |live| {
        let _held = live.notifier.lock();
        panic!("deliberate")
    });
    assert_eq!(panicking, SVBRDF_FAILED);
    assert_eq!(svbrdf_session_destroy(session), SVBRDF_OK);
}

#[path = "../../../fuzz/shared/c_calls/mod.rs"]
mod c_calls;
#[path = "../../../fuzz/shared/mutate.rs"]
mod mutate;

/// A short run of the fuzz target: the committed seeds and changes of them, the same every time.
#[test]
fn any_calls_in_any_order_do_no_harm() {
    let seeds = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/c_calls");
    let times = std::env::var("SVBRDF_FUZZ_ROUNDS").ok().and_then(|v| v.parse().ok());
    // Seeds begin with something, and go on with it.
    mutate::each(&seeds, 150 * times.unwrap_or(1_usize), &[], |data| c_calls::run(data) > 1);
}
