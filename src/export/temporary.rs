//! Names of temporary files, and removal of those of killed processes.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use web_time::{SystemTime, UNIX_EPOCH};

/// Age of stale files on systems that do not list processes.
const OLD: Duration = Duration::from_secs(24 * 60 * 60);

/// A unique hidden name beside `path`.
pub fn name(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}-{:x}-{count}.tmp", std::process::id(), start()))
}

/// Removes temporary files of processes that no longer run.
pub fn sweep(dir: &Path) {
    for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
        let path = entry.path();
        let writer = path.file_name().and_then(|name| writer(name.to_str()?));
        if writer.is_some_and(|writer| is_left_over(&path, writer)) {
            // Another process may have removed it.
            let _ = fs::remove_file(path);
        }
    }
}

/// Distinguishes processes with the same id: every container counts from 1.
fn start() -> u64 {
    static START: OnceLock<u64> = OnceLock::new();
    *START.get_or_init(|| {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        since.as_nanos() as u64
    })
}

/// Id and start of the process in a temporary name.
fn writer(name: &str) -> Option<(u32, u64)> {
    let (_, ending) = name.strip_prefix('.')?.strip_suffix(".tmp")?.rsplit_once('.')?;
    let mut parts = ending.split('-');
    let (process, start, count) = (parts.next()?, parts.next()?, parts.next()?);
    count.parse::<u64>().ok()?;
    Some((process.parse().ok()?, u64::from_str_radix(start, 16).ok()?))
}

fn is_left_over(path: &Path, (process, begun): (u32, u64)) -> bool {
    if process == std::process::id() {
        return begun != start();
    }
    let processes = Path::new("/proc");
    if processes.join("self").exists() {
        return !processes.join(process.to_string()).exists();
    }
    let modified = fs::metadata(path).and_then(|known| known.modified());
    modified.is_ok_and(|time| time.elapsed().is_ok_and(|age| age > OLD))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temporary_files_of_killed_processes_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let own = name(&at("maps.exr"));
        assert_ne!(own, name(&at("maps.exr")));
        let number = std::process::id();
        // No process has an id this large.
        let gone = at(&format!(".maps.exr.{}-1a-0.tmp", u32::MAX));
        let earlier = at(&format!(".maps.exr.{number}-1a-0.tmp"));
        let others =
            ["maps.exr", ".hidden", ".notes.tmp", ".a.b-c-d.tmp", ".x.12-zz-0.tmp"].map(at);
        let first =
            if Path::new("/proc/1").exists() { Some(at(".maps.exr.1-1a-0.tmp")) } else { None };
        let kept: Vec<&PathBuf> = others.iter().chain(&first).chain([&own]).collect();
        for path in kept.iter().copied().chain([&gone, &earlier]) {
            fs::write(path, b"half").unwrap();
        }
        sweep(dir.path());
        assert!(kept.iter().all(|path| path.exists()));
        assert!(!earlier.exists() && gone.exists() != first.is_some());
        sweep(&at("nowhere"));
    }
}
