//! The time of day of something that happened a moment ago, as clients read it.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// The time of day at `then`, RFC 3339 in UTC, to the millisecond; `None` if the system's clock stands
/// before 1970, so that it has never been set.
pub(super) fn at(then: Instant) -> Option<String> {
    let time = SystemTime::now().checked_sub(then.elapsed())?;
    let since = time.duration_since(UNIX_EPOCH).ok()?;
    Some(utc(u64::try_from(since.as_millis()).ok()?))
}

/// Milliseconds since 1970 as RFC 3339.
fn utc(unix_ms: u64) -> String {
    let (seconds, ms) = (unix_ms / 1000, unix_ms % 1000);
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Days since 1 March of the year 0, in eras of 400 years: a leap day is the last of its year.
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    format!(
        "{:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}.{ms:03}Z",
        400 * era + year + next,
        second / 3600,
        second / 60 % 60,
        second % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        // As `date -u -d @SECONDS +%FT%TZ` has them.
        for (seconds, right) in [
            (0, "1970-01-01T00:00:00"),
            (951_782_399, "2000-02-28T23:59:59"),
            (951_782_400, "2000-02-29T00:00:00"),
            (951_868_800, "2000-03-01T00:00:00"),
            (1_735_689_599, "2024-12-31T23:59:59"),
            (4_107_542_400, "2100-03-01T00:00:00"),
        ] {
            assert_eq!(utc(1000 * seconds + 7), format!("{right}.007Z"));
        }
    }
}
