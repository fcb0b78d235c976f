//! Limits of the work of a fit.

use engine::session::Budget;

use crate::handles::svbrdf_session;
use crate::live::act;
use crate::status::{Fault, entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// Limits of the work on each photo. At a limit the fit settles on the current maps. Each photo
/// has the full budget; pauses do not count. Default: no limits.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_budget {
    /// Size of this struct.
    pub size: usize,
    /// Seconds of work on each photo, not counting the step in progress; negative: no limit.
    pub seconds: f32,
    /// Optimiser steps on each photo; 0: no limit.
    pub max_steps: u32,
    /// 1: also end where the remaining change is less than half a step of 8-bit maps.
    pub stop_when_invisible: u32,
    /// 0.
    pub reserved: u32,
}

defaults!(svbrdf_budget { seconds: -1.0 });
versioned!(svbrdf_budget, size_of::<svbrdf_budget>());

/// Fills a budget with defaults: pass sizeof(svbrdf_budget).
///
/// # Safety
/// `budget` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_budget_init(
    budget: *mut svbrdf_budget,
    size: usize,
) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(budget, size) })
}

/// Limits the work on each photo from now on; NULL: no limits. A fit that an earlier budget has ended
/// continues if this one allows it.
///
/// # Safety
/// `budget` is NULL or initialised by svbrdf_budget_init().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_session_set_budget(
    session: *mut svbrdf_session,
    budget: *const svbrdf_budget,
) -> svbrdf_status {
    act(session, |live| {
        // SAFETY: the caller vouches for the struct.
        let budget = unsafe { versioned::read_or_default(budget) }?;
        if budget.stop_when_invisible > 1 {
            return Err(Fault::argument("svbrdf_budget.stop_when_invisible: 0 or 1 is expected"));
        }
        Ok(live.session.set_budget(Budget {
            // Not a number is refused there.
            seconds: if budget.seconds < 0.0 { None } else { Some(budget.seconds) },
            steps: (budget.max_steps > 0).then_some(budget.max_steps),
            stop_when_invisible: budget.stop_when_invisible == 1,
        })?)
    })
}
