//! Wall time, and processor time, which other processes disturb less.

use std::ops::AddAssign;
use std::time::Instant;

/// Seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Seconds {
    pub wall: f64,
    /// Of all threads of this process; wall time on systems without it.
    pub processor: f64,
}

impl AddAssign for Seconds {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.processor += other.processor;
    }
}

/// Runs `work`; returns its result and its time.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Seconds) {
    let (begun, before) = (Instant::now(), processor_seconds());
    let result = work();
    let wall = begun.elapsed().as_secs_f64();
    let processor = match (before, processor_seconds()) {
        (Some(before), Some(after)) => after - before,
        _ => wall,
    };
    (result, Seconds { wall, processor })
}

#[cfg(unix)]
fn processor_seconds() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
}

#[cfg(not(unix))]
fn processor_seconds() -> Option<f64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sleep takes only wall time, computation both.
    #[test]
    fn sleep_is_no_work() {
        let pause = std::time::Duration::from_millis(60);
        let (_, asleep) = timed(|| std::thread::sleep(pause));
        let (_, busy) = timed(|| {
            let begun = Instant::now();
            while begun.elapsed() < pause {
                std::hint::spin_loop();
            }
        });
        assert!(asleep.wall >= 0.06 && busy.wall >= 0.06, "{asleep:?} {busy:?}");
        // Parallel tests and other processes may take the processor.
        assert!(busy.processor > 0.0, "{busy:?}");
    }
}
