//! Tables of the objects behind callers' handles.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use crate::status::{Fault, SVBRDF_INVALID_HANDLE};

/// A session: add photos, take maps at any time.
pub struct svbrdf_session {
    _opaque: (),
}

/// The next handle. Each number is used once in a process, for whatever kind; 0 is never used. Small
/// numbers cannot be taken for addresses, because the lowest addresses are not mapped.
static NEXT: AtomicUsize = AtomicUsize::new(1);

/// Live objects of one kind.
pub(crate) struct Handles<T> {
    kind: &'static str,
    live: RwLock<BTreeMap<usize, Arc<T>>>,
}

impl<T> Handles<T> {
    pub(crate) const fn new(kind: &'static str) -> Self {
        Self { kind, live: RwLock::new(BTreeMap::new()) }
    }

    /// A number for something that is put in later.
    pub(crate) fn reserve() -> usize {
        NEXT.fetch_add(1, Ordering::Relaxed)
    }

    pub(crate) fn insert(&self, handle: usize, value: Arc<T>) {
        self.live.write().unwrap_or_else(PoisonError::into_inner).insert(handle, value);
    }

    /// Keeps the object alive while the result is held.
    pub(crate) fn get(&self, handle: usize) -> Result<Arc<T>, Fault> {
        let live = self.live.read().unwrap_or_else(PoisonError::into_inner);
        live.get(&handle).cloned().ok_or_else(|| self.unknown(handle))
    }

    /// Removes the object from the table; calls inside it continue.
    pub(crate) fn remove(&self, handle: usize) -> Result<Arc<T>, Fault> {
        let mut live = self.live.write().unwrap_or_else(PoisonError::into_inner);
        live.remove(&handle).ok_or_else(|| self.unknown(handle))
    }

    fn unknown(&self, handle: usize) -> Fault {
        let kind = self.kind;
        let message = if handle == 0 {
            format!("{kind}: NULL given")
        } else {
            format!("{kind}: no such handle; it was destroyed or is of another kind")
        };
        Fault::new(SVBRDF_INVALID_HANDLE, message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn handles_are_never_given_out_twice() {
        static TABLE: Handles<u32> = Handles::new("thing");
        let a = Handles::<u32>::reserve();
        TABLE.insert(a, Arc::new(7));
        let held = TABLE.get(a).unwrap();
        assert_eq!(*TABLE.remove(a).unwrap(), 7);
        assert_eq!(*held, 7, "what is in use stays");
        assert!(TABLE.get(a).is_err() && TABLE.remove(a).is_err() && TABLE.get(0).is_err());
        assert_ne!(Handles::<u32>::reserve(), a);
    }
}
