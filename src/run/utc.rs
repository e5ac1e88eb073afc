//! Times in UTC as text.

#![allow(clippy::disallowed_methods, reason = "a manifest says when its run started; no key or result holds a time")]

use std::time::{SystemTime, UNIX_EPOCH};

/// The time now, such as `2026-08-02T14:35:01Z`.
pub(super) fn now() -> String {
    text(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64))
}

/// A time in milliseconds since 1970 as `2026-08-02T14:35:01Z`.
pub(super) fn text(unix_millis: u64) -> String {
    let secs = unix_millis / 1000;
    let (days, of_day) = (secs / 86_400, secs % 86_400);
    // Days to year, month and day in the Gregorian calendar, counted from March of year 0 (Howard Hinnant,
    // "chrono-Compatible Low-Level Date Algorithms", civil_from_days).
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (of_day / 3_600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::text;

    #[test]
    fn times_are_written_in_utc() {
        assert_eq!(text(0), "1970-01-01T00:00:00Z");
        assert_eq!(text(951_827_696_000), "2000-02-29T12:34:56Z");
    }
}
