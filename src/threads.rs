//! The threads that share work, and a hook at their start, by which programs set priorities.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use crate::{Error, Result};

/// What a thread is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Role {
    /// Steers the fit of a session.
    Fit,
    /// Shares the work of fits and of calls.
    Work,
}

/// Called on a thread before anything else.
pub type StartHook = Arc<dyn Fn(Role) + Send + Sync>;

static HOOK: RwLock<Option<StartHook>> = RwLock::new(None);

/// Has every thread that the library starts from now on call `hook` first; `None` ends that. What
/// runs outside of sessions, such as renderings and exports, is shared among rayon's global threads:
/// the first hook starts them, unless the program has. A panic of the hook is dropped.
pub fn set_start_hook(hook: Option<StartHook>) {
    let starts = hook.is_some();
    *HOOK.write().unwrap_or_else(PoisonError::into_inner) = hook;
    if starts {
        // Fails where they run already: then they are not of the library's starting.
        let _ = rayon::ThreadPoolBuilder::new()
            .thread_name(|i| format!("svbrdf-global-{i}"))
            .start_handler(|_| started(Role::Work))
            .build_global();
    }
}

/// The content of a mutex that no panic leaves half changed.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Calls the hook on a thread that has just started.
pub(crate) fn started(role: Role) {
    let hook = HOOK.read().unwrap_or_else(PoisonError::into_inner).clone();
    if let Some(hook) = hook {
        // Threads of a pool would end the process.
        let _ = catch_unwind(AssertUnwindSafe(|| hook(role)));
    }
}

/// What the work of a session is shared among.
pub(crate) enum Pool {
    /// Threads of its own.
    Threads(rayon::ThreadPool),
    /// The calling thread alone: WebAssembly in a browser has no other without headers that few
    /// servers send.
    Caller,
}

impl Pool {
    /// As many threads as are asked for, where the platform has threads.
    pub(crate) fn new(threads: usize) -> Result<Self> {
        if cfg!(all(target_family = "wasm", not(target_feature = "atomics"))) {
            return Ok(Self::Caller);
        }
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("svbrdf-{i}"))
            .start_handler(|_| started(Role::Work))
            .build()
            .map(Self::Threads)
            .map_err(|e| Error::Internal(format!("cannot start the threads of the fit: {e}")))
    }

    /// Does `work` where [`parallel`](crate::parallel) shares it among these threads.
    pub(crate) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self {
            Self::Threads(pool) => pool.install(work),
            Self::Caller => work(),
        }
    }
}
