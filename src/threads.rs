//! Threads of the library, and a hook at their start for programs that set priorities.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use tracing::Dispatch;
use tracing::dispatcher::{get_default, with_default};
use tracing::subscriber::NoSubscriber;

use crate::{Error, Result};

/// Purpose of a thread.
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

/// Sets the hook that every new thread of the library calls first; `None` removes it. Work outside
/// of sessions, such as rendering and export, runs on rayon's global threads: the first hook starts
/// them unless the program has. A panic of the hook is ignored.
pub fn set_start_hook(hook: Option<StartHook>) {
    let starts = hook.is_some();
    *HOOK.write().unwrap_or_else(PoisonError::into_inner) = hook;
    if starts {
        // Fails if the program has started them: they are then not the library's.
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
        // An unwinding panic would abort the process.
        let _ = catch_unwind(AssertUnwindSafe(|| hook(role)));
    }
}

/// The subscriber of the thread that hands work to others, which receives the events of that work. `None`: the one
/// of the whole program, if there is one.
pub(crate) struct Subscriber(Option<Dispatch>);

impl Subscriber {
    /// That of the calling thread.
    pub(crate) fn current() -> Self {
        let is_none = |current: &Dispatch| current.is::<NoSubscriber>();
        Self(get_default(|current| (!is_none(current)).then(|| current.clone())))
    }

    /// Runs `work` on this thread with it.
    pub(crate) fn follow<R>(&self, work: impl FnOnce() -> R) -> R {
        match &self.0 {
            Some(subscriber) => with_default(subscriber, work),
            None => work(),
        }
    }
}

/// Threads that share the work of a session.
pub(crate) enum Pool {
    /// Threads of its own.
    Threads(rayon::ThreadPool),
    /// The calling thread alone. WebAssembly threads in a browser need headers that few servers send.
    Caller,
}

impl Pool {
    /// Uses `threads` threads where the platform has threads.
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

    /// Runs `work` so that [`parallel`](crate::parallel) uses these threads. Its events go to the subscriber of the
    /// calling thread.
    pub(crate) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self {
            Self::Threads(pool) => {
                let subscriber = Subscriber::current();
                pool.install(|| subscriber.follow(work))
            }
            Self::Caller => work(),
        }
    }
}
