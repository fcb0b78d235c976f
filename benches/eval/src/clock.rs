//! Time taken: on the wall, and by the processor, which other work on the machine disturbs less.

use std::ops::AddAssign;
use std::time::Instant;

/// Seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Seconds {
    pub wall: f64,
    /// Of all threads of this process; of the wall where the system does not tell.
    pub processor: f64,
}

impl AddAssign for Seconds {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.processor += other.processor;
    }
}

/// Runs `work`; its result and the time it took.
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

    /// Sleeping takes time on the wall only, computing both.
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
        // Tests run beside each other and other work may hold the processor.
        assert!(busy.processor > 0.0, "{busy:?}");
    }
}
