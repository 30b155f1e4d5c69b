//! The time of day as a duration since 1970, and as text. Pure: the caller brings the time.

use std::time::Duration;

use time::format_description::well_known::Rfc3339;
use time::{Date, OffsetDateTime};

/// A clock that says less has never been set, or has lost count: a board without a battery begins in 1970, and an old
/// receiver's weeks begin anew after 1024. It is 2020-01-01.
pub const CREDIBLE: Duration = Duration::from_secs(1_577_836_800);

/// The year 9999 begins: what is timed from here on may leave the years that RFC 3339 can write.
pub const LATEST: Duration = Duration::from_secs(253_370_764_800);

/// The last moment of the year 9999, to the millisecond.
const END: Duration = Duration::from_millis(253_402_300_799_999);

/// As RFC 3339 has it, in UTC and to the millisecond; beyond the year 9999 its last moment.
pub fn rfc3339(since_1970: Duration) -> String {
    let since_1970 = since_1970.min(END);
    let date = date(since_1970);
    let (seconds, milliseconds) = (since_1970.as_secs(), since_1970.subsec_millis());
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{date}T{hour:02}:{minute:02}:{second:02}.{milliseconds:03}Z")
}

/// The moment that a text in RFC 3339 names; `None` if it is none, or is before 1970.
pub fn parse_rfc3339(text: &str) -> Option<Duration> {
    let moment = OffsetDateTime::parse(text, &Rfc3339).ok()?;
    Duration::try_from(moment - OffsetDateTime::UNIX_EPOCH).ok()
}

/// The day, in UTC; beyond the year 9999 its last.
pub fn date(since_1970: Duration) -> Date {
    i64::try_from(since_1970.as_secs())
        .ok()
        .and_then(|seconds| OffsetDateTime::from_unix_timestamp(seconds).ok())
        .map_or(Date::MAX, OffsetDateTime::date)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with `date -u -d @N`.
    #[test]
    fn seconds_become_dates_and_dates_seconds() {
        for (milliseconds, text) in [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_400_007, "2000-02-29T00:00:00.007Z"),
            (1_709_251_199_999, "2024-02-29T23:59:59.999Z"),
            (1_795_271_132_250, "2026-11-21T14:25:32.250Z"),
            (4_107_542_400_000, "2100-03-01T00:00:00.000Z"),
            (253_402_300_799_999, "9999-12-31T23:59:59.999Z"),
        ] {
            let moment = Duration::from_millis(milliseconds);
            assert_eq!(rfc3339(moment), text);
            assert_eq!(parse_rfc3339(text), Some(moment));
        }
        let elsewhere = parse_rfc3339("2026-11-21T07:25:32.25-07:00");
        assert_eq!(elsewhere, Some(Duration::from_millis(1_795_271_132_250)));
        for wrong in [
            "",
            "2026-11-21",
            "2026-02-30T00:00:00Z",
            "1969-12-31T23:59:59Z",
        ] {
            assert_eq!(parse_rfc3339(wrong), None, "{wrong}");
        }
        assert_eq!(date(Duration::MAX), Date::MAX);
        assert_eq!(rfc3339(LATEST), "9999-01-01T00:00:00.000Z");
        for beyond in [END + Duration::from_secs(1), Duration::MAX] {
            assert_eq!(rfc3339(beyond), rfc3339(END));
        }
    }
}
