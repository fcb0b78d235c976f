//! Waiting that Ctrl-C can end.

use std::time::{Duration, Instant};

use pyo3::prelude::*;
use svbrdf::session::Session;

use crate::errors::detached;

/// Longest time without a look at signals.
const LOOK: Duration = Duration::from_millis(50);

/// Waits until the fit has settled, for at most `timeout`; returns whether it has. Raises the exceptions of signal
/// handlers.
pub fn wait(py: Python<'_>, session: &Session, timeout: Option<Duration>) -> PyResult<bool> {
    let end = timeout.and_then(|timeout| Instant::now().checked_add(timeout));
    loop {
        let left = end.map_or(LOOK, |end| end.saturating_duration_since(Instant::now()).min(LOOK));
        if detached(py, || session.wait_timeout(left))? {
            return Ok(true);
        }
        py.check_signals()?;
        if end.is_some_and(|end| Instant::now() >= end) {
            return Ok(false);
        }
    }
}
