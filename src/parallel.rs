//! Parallel loops on the current rayon pool.
//!
//! rayon's iterators compile some thirty functions for every closure. These functions call closures
//! through a trait object, so the machinery compiles once.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Parts of the work per thread, so that no thread waits long for the last part.
const PARTS: usize = 4;

/// Values per task of [`values`]: enough to hide the cost of a task.
const CHUNK: usize = 4096;

/// Calls `f` for every index below `count`. Every task makes one `scratch`.
fn for_each<S>(count: usize, scratch: impl Fn() -> S + Sync, f: impl Fn(&mut S, usize) + Sync) {
    share(0..count, &|range| {
        let mut scratch = scratch();
        range.for_each(|i| f(&mut scratch, i));
    });
}

/// Results of `f` for every index below `count`, in order.
pub(crate) fn map<R: Send>(count: usize, f: impl Fn(usize) -> R + Sync) -> Vec<R> {
    map_with(count, || (), |(), i| f(i))
}

/// As [`map`] with one `scratch` per task.
pub(crate) fn map_with<S, R: Send>(
    count: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize) -> R + Sync,
) -> Vec<R> {
    let results = slots((0..count).map(|_| None));
    for_each(count, scratch, |scratch, i| fill(&results[i], f(scratch, i)));
    results.into_iter().map(emptied).collect()
}

/// Calls `f` with the index and value of every part.
pub(crate) fn parts<P: Send>(parts: impl Iterator<Item = P>, f: impl Fn(usize, P) + Sync) {
    parts_with(parts, || (), |(), i, part| f(i, part));
}

/// As [`parts`] with one `scratch` per task.
pub(crate) fn parts_with<P: Send, S>(
    parts: impl Iterator<Item = P>,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize, P) + Sync,
) {
    let parts = slots(parts.map(Some));
    for_each(parts.len(), scratch, |scratch, i| f(scratch, i, taken(&parts[i])));
}

/// Results of `f` for every part, in order.
pub(crate) fn map_parts<P: Send, R: Send>(
    parts: impl Iterator<Item = P>,
    f: impl Fn(usize, P) -> R + Sync,
) -> Vec<R> {
    map_parts_with(parts, || (), |(), i, part| f(i, part))
}

/// As [`map_parts`] with one `scratch` per task.
pub(crate) fn map_parts_with<P: Send, S, R: Send>(
    parts: impl Iterator<Item = P>,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize, P) -> R + Sync,
) -> Vec<R> {
    let parts = slots(parts.map(Some));
    map_with(parts.len(), scratch, |scratch, i| f(scratch, i, taken(&parts[i])))
}

/// Results of a cheap `f` for every index below `count`.
pub(crate) fn values<T: Send + Clone + Default>(
    count: usize,
    f: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let mut out = vec![T::default(); count];
    parts(out.chunks_mut(CHUNK), |chunk, out| {
        for (i, out) in out.iter_mut().enumerate() {
            *out = f(chunk * CHUNK + i);
        }
    });
    out
}

/// Input or output of one task.
type Slot<T> = Mutex<Option<T>>;

fn slots<T>(values: impl Iterator<Item = Option<T>>) -> Vec<Slot<T>> {
    values.map(Mutex::new).collect()
}

fn fill<T>(slot: &Slot<T>, value: T) {
    *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
}

fn taken<T>(slot: &Slot<T>) -> T {
    slot.lock().unwrap_or_else(PoisonError::into_inner).take().expect("indices come once")
}

fn emptied<T>(slot: Slot<T>) -> T {
    slot.into_inner().unwrap_or_else(PoisonError::into_inner).expect("every index comes")
}

/// Calls `task` with ranges that partition `range`.
fn share(range: Range<usize>, task: &(dyn Fn(Range<usize>) + Sync)) {
    match rayon::current_num_threads() {
        1 => task(range),
        threads => split(range, PARTS * threads, false, task),
    }
}

/// Splits in halves while threads are free. A half stolen by another thread is a sign of waiting
/// threads, so it is split among all of them again.
fn split(range: Range<usize>, parts: usize, taken: bool, task: &(dyn Fn(Range<usize>) + Sync)) {
    let parts = if taken { rayon::current_num_threads().max(parts) } else { parts };
    if range.len() < 2 || parts < 2 {
        return task(range);
    }
    let middle = range.start + range.len() / 2;
    let (first, second) = (range.start..middle, middle..range.end);
    let more = parts.div_ceil(2);
    rayon::join_context(
        |context| split(first, more, context.migrated(), task),
        |context| split(second, more, context.migrated(), task),
    );
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// Runs `test` in pools of one thread, of several, and of more threads than tasks.
    fn in_pools(test: impl Fn() + Send + Sync) {
        for threads in [1, 2, 5] {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&test);
        }
    }

    #[test]
    fn every_index_comes_once_and_results_keep_their_order() {
        in_pools(|| {
            for count in [0, 1, 2, 3, 7, 100] {
                let seen: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
                for_each(
                    count,
                    || (),
                    |(), i| {
                        seen[i].fetch_add(1, Ordering::Relaxed);
                    },
                );
                assert!(seen.iter().all(|n| n.load(Ordering::Relaxed) == 1));
                let squares: Vec<usize> = (0..count).map(|i| i * i).collect();
                assert_eq!(map(count, |i| i * i), squares);
            }
            assert_eq!(values(3 * CHUNK + 5, |i| i), (0..3 * CHUNK + 5).collect::<Vec<_>>());
        });
    }

    #[test]
    fn parts_come_with_their_index() {
        in_pools(|| {
            let mut data = vec![0; 103];
            parts(data.chunks_mut(10), |i, part| part.fill(i + 1));
            assert!(data.iter().enumerate().all(|(i, v)| *v == i / 10 + 1));
            let sums = map_parts(data.chunks(10), |i, part| (i, part.iter().sum::<usize>()));
            let expected = (0..11).map(|i| (i, if i < 10 { 10 * (i + 1) } else { 33 }));
            assert_eq!(sums, expected.collect::<Vec<_>>());
        });
    }

    #[test]
    fn scratch_is_made_once_a_task() {
        let made = AtomicUsize::new(0);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| {
            for_each(1000, || made.fetch_add(1, Ordering::Relaxed), |_, _| {});
        });
        assert_eq!(made.into_inner(), 1);
    }

    #[test]
    fn waiting_threads_take_work_from_a_slow_one() {
        // All costs lie in the first half, so the second thread helps only if stolen work is split again.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let helpers = Mutex::new(std::collections::HashSet::new());
        let helped = || helpers.lock().unwrap().len() == 2;
        // Milliseconds; a busy machine needs time to start the second thread.
        let half = 60_000;
        pool.install(|| {
            for_each(
                2 * half,
                || (),
                |(), i| {
                    if i < half && !helped() {
                        std::thread::sleep(std::time::Duration::from_millis(1));
                        helpers.lock().unwrap().insert(rayon::current_thread_index());
                    }
                },
            );
        });
        assert!(helped());
    }
}
