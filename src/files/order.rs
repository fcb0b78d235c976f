//! Order of capture.

use std::cmp::Ordering;
use std::iter::Peekable;
use std::path::{Path, PathBuf};
use std::str::Chars;

use super::metadata::Metadata;

const MINUTE: i64 = 60;
const DAY: i64 = 24 * 60 * MINUTE;

/// Sorts photographs by time of capture, then by name; those without a time come last. Time zones
/// apply only if every time has one.
pub fn sort(photographs: &mut [(Metadata, PathBuf)]) {
    let is_zoned =
        photographs.iter().all(|(known, _)| known.taken.is_none() || universal(known).is_some());
    let time = |known: &Metadata| {
        let time = if is_zoned { universal(known) } else { known.taken.clone() };
        (time.is_none(), time)
    };
    photographs
        .sort_by(|(a, path), (b, other)| time(a).cmp(&time(b)).then_with(|| by_name(path, other)));
}

/// Compares by name with 9 before 10, then by folder.
pub fn by_name(a: &Path, b: &Path) -> Ordering {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    natural(&name(a), &name(b)).then_with(|| a.cmp(b))
}

/// Compares texts with runs of digits as numbers.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a.chars().peekable(), b.chars().peekable());
    loop {
        let order = match (left.peek().copied(), right.peek().copied()) {
            (None, None) => return Ordering::Equal,
            (Some(x), Some(y)) if x.is_ascii_digit() && y.is_ascii_digit() => {
                let (x, y) = (digits(&mut left), digits(&mut right));
                x.len().cmp(&y.len()).then_with(|| x.cmp(&y))
            }
            (x, y) => {
                left.next();
                right.next();
                x.cmp(&y)
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// Takes a run of digits without leading zeros.
fn digits(chars: &mut Peekable<Chars>) -> String {
    let mut run = String::new();
    while let Some(digit) = chars.next_if(char::is_ascii_digit) {
        run.push(digit);
    }
    run.trim_start_matches('0').to_owned()
}

/// Universal time of capture, in digits that sort by time.
fn universal(known: &Metadata) -> Option<String> {
    let taken = known.taken.as_ref()?;
    let (seconds, fraction) = taken.split_once('.')?;
    let numbers: Option<Vec<i64>> =
        seconds.split([':', ' ']).map(|part| part.parse().ok()).collect();
    let [year, month, day, hour, minute, second] = numbers?[..] else { return None };
    let local = days(year, month, day) * DAY + (hour * 60 + minute) * MINUTE + second;
    let utc = local - i64::from(known.utc_offset_min?) * MINUTE;
    Some(format!("{utc:020}.{fraction}"))
}

/// Days of the Gregorian calendar since 1 March of the year 0.
fn days(year: i64, month: i64, day: i64) -> i64 {
    // Years start in March, so that the leap day is the last one.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(photographs: &[(Metadata, PathBuf)]) -> Vec<&str> {
        photographs.iter().map(|(_, path)| path.to_str().unwrap()).collect()
    }

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut all =
            ["IMG_10.jpg", "img_9.JPG", "IMG_9 (1).jpg", "IMG_009.jpg", "a10b2", "a10b10"]
                .map(|name| (Metadata::default(), PathBuf::from(name)))
                .to_vec();
        sort(&mut all);
        assert_eq!(
            names(&all),
            ["a10b2", "a10b10", "IMG_9 (1).jpg", "IMG_009.jpg", "img_9.JPG", "IMG_10.jpg"]
        );
    }

    #[test]
    fn time_zones_count_where_all_state_them() {
        let photo = |name: &str, taken: &str, minutes: Option<i32>| {
            let known = Metadata {
                taken: Some(taken.into()),
                utc_offset_min: minutes,
                ..Metadata::default()
            };
            (known, PathBuf::from(name))
        };
        // Around midnight and the end of a leap month.
        let mut all = vec![
            photo("c", "2024:03:01 00:10:00.5", Some(60)),
            photo("a", "2024:02:29 22:50:00.", Some(0)),
            photo("b", "2024:02:29 18:40:00.25", Some(-270)),
        ];
        sort(&mut all);
        assert_eq!(names(&all), ["a", "b", "c"]);
        all.push(photo("d", "2024:02:29 20:00:00.", None));
        sort(&mut all);
        assert_eq!(names(&all), ["b", "d", "a", "c"]);
        assert_eq!(days(1970, 1, 1) - days(1969, 12, 31), 1);
        assert_eq!(days(2024, 3, 1) - days(2024, 2, 28), 2);
        assert_eq!(days(2100, 3, 1) - days(2100, 2, 28), 1);
        // 1 January 2000 to 1 January 2026.
        assert_eq!(days(2026, 1, 1) - days(2000, 1, 1), 9497);
    }
}
