//! Events of the library as lines on standard error.

use tracing_subscriber::filter::LevelFilter;

/// Shows them from now on: none, those of photographs, or also those of phases and calibration.
pub fn listen(times: u8) {
    let level = match times {
        0 => return,
        1 => LevelFilter::INFO,
        _ => LevelFilter::DEBUG,
    };
    let lines = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_timer(tracing_subscriber::fmt::time::uptime())
        .with_target(false)
        // A reader that has gone away is no reason to end.
        .log_internal_errors(false);
    // There is no other subscriber in this program.
    let _ = tracing_subscriber::util::SubscriberInitExt::try_init(lines.finish());
}
