//! Sequences of calls of the C library in any order with any arguments, as far as a caller may
//! choose them: pointers are NULL or valid, handles also stale or of another kind.

mod arguments;
mod bytes;
mod photos;
mod pictures;
mod results;
mod sessions;
mod world;

use std::ptr;
use std::sync::atomic::Ordering;

use self::bytes::Bytes;
use self::world::World;
use crate::buffer::*;
use crate::capture::*;
use crate::export::*;
use crate::maps::*;
use crate::session::*;
use crate::status::*;

/// Calls of one sequence.
const MAX_CALLS: usize = 64;

/// How many calls were done.
pub fn run(data: &[u8]) -> usize {
    let mut bytes = Bytes(data);
    let mut world = World::new();
    let mut done = 0;
    for _ in 0..MAX_CALLS {
        if bytes.done() {
            break;
        }
        let choice = bytes.u8() % (sessions::CALLS + photos::CALLS + results::CALLS);
        let status = if choice < sessions::CALLS {
            sessions::call(choice, &mut bytes, &mut world)
        } else if choice < sessions::CALLS + photos::CALLS {
            photos::call(choice - sessions::CALLS, &mut bytes, &mut world)
        } else {
            results::call(choice - sessions::CALLS - photos::CALLS, &mut bytes, &mut world)
        };
        assert_ne!(status, SVBRDF_FAILED, "call {choice}");
        done += usize::from(status == SVBRDF_OK);
    }
    end(&world);
    done
}

/// Ends each handle by the function of its kind; all others must refuse it.
fn end(world: &World) {
    for &handle in &world.handles {
        let session = svbrdf_session_destroy(ptr::without_provenance_mut(handle));
        let maps = svbrdf_maps_destroy(ptr::without_provenance_mut(handle));
        let buffer = svbrdf_buffer_destroy(ptr::without_provenance_mut(handle));
        let capture = svbrdf_capture_destroy(ptr::without_provenance_mut(handle));
        let package = svbrdf_package_destroy(ptr::without_provenance_mut(handle));
        let all = [session, maps, buffer, capture, package];
        assert!(all.iter().filter(|&&s| s == SVBRDF_OK).count() <= 1, "a handle is of one kind");
    }
    assert_eq!(world.answered.all.load(Ordering::Relaxed), world.asked, "answers of photos");
}
