//! The time of day, where the system knows it.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A clock that says less has never been set: a board without a battery begins in 1970. It is 2020-01-01.
const CREDIBLE: Duration = Duration::from_secs(1_577_836_800);

/// The time of day, in UTC and to the millisecond, at a moment not long ago; `None` if the system does not know it.
pub fn rfc3339(moment: Instant) -> Option<String> {
    since_1970(SystemTime::now().checked_sub(moment.elapsed())?).map(written)
}

/// A moment told in seconds since 1970, as RFC 3339 has it, in UTC.
pub fn rfc3339_of_unix(unix_s: u64) -> String {
    written(Duration::from_secs(unix_s))
}

/// Seconds since 1970 by the system's clock; `None` if that was never set.
pub fn unix_now_s() -> Option<u64> {
    since_1970(SystemTime::now()).map(|since| since.as_secs())
}

fn since_1970(time: SystemTime) -> Option<Duration> {
    let since = time.duration_since(UNIX_EPOCH).ok()?;
    (since >= CREDIBLE).then_some(since)
}

fn written(since_1970: Duration) -> String {
    let seconds = since_1970.as_secs();
    let (year, month, day) = date(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    let millisecond = u64::from(since_1970.subsec_millis());
    // Digit by digit, since every heading has one: `format!` was nine tenths of the instructions of all this.
    let mut text = *b"0000-00-00T00:00:00.000Z";
    let parts = [
        (0..4, year),
        (5..7, month),
        (8..10, day),
        (11..13, hour),
        (14..16, minute),
        (17..19, second),
        (20..23, millisecond),
    ];
    for (place, mut number) in parts {
        for digit in text[place].iter_mut().rev() {
            *digit = b'0' + (number % 10) as u8;
            number /= 10;
        }
    }
    text.into_iter().map(char::from).collect()
}

/// Year, month and day of a number of days since 1970-01-01. The year is taken to begin in March, so that the
/// leap day is its last.
fn date(days: u64) -> (u64, u64, u64) {
    const DAYS_IN_400_YEARS: u64 = 146_097;
    // Since 0000-03-01.
    let days = days + 719_468;
    let in_era = days % DAYS_IN_400_YEARS;
    let year_in_era = (in_era - in_era / 1460 + in_era / 36_524 - in_era / 146_096) / 365;
    let in_year = in_era - (365 * year_in_era + year_in_era / 4 - year_in_era / 100);
    let month = (5 * in_year + 2) / 153;
    let day = in_year - (153 * month + 2) / 5 + 1;
    let year = year_in_era + days / DAYS_IN_400_YEARS * 400;
    if month < 10 {
        (year, month + 3, day)
    } else {
        (year + 1, month - 9, day)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with `date -u -d @N`.
    #[test]
    fn seconds_become_dates() {
        for (milliseconds, text) in [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_400_007, "2000-02-29T00:00:00.007Z"),
            (1_709_251_199_999, "2024-02-29T23:59:59.999Z"),
            (1_795_271_132_250, "2026-11-21T14:25:32.250Z"),
            (4_107_542_400_000, "2100-03-01T00:00:00.000Z"),
        ] {
            assert_eq!(written(Duration::from_millis(milliseconds)), text);
        }
    }

    #[test]
    fn a_moment_ago_is_earlier_than_now() {
        let now = Instant::now();
        let (earlier, later) = (rfc3339(now - Duration::from_secs(2)), rfc3339(now));
        assert!(earlier.is_some() && earlier < later);
    }
}
