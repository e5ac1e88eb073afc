//! Times in UTC as text.

#![allow(clippy::disallowed_methods, reason = "a manifest says when its run started; no key or result holds a time")]

use std::time::{SystemTime, UNIX_EPOCH};

/// The time now, such as `2026-08-02T14:35:01Z`.
pub(super) fn now() -> String {
    text(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64))
}

/// The seconds from 1970 to now.
pub(super) fn now_secs() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// The seconds from 1970 to a time such as `2026-08-02T14:35:01Z`; `None` where the text is no such time.
pub(super) fn secs(text: &str) -> Option<u64> {
    let part = |from: usize, to: usize| text.get(from..to)?.parse::<u64>().ok();
    let (year, month, day) = (part(0, 4)?, part(5, 7)?, part(8, 10)?);
    let of_day = part(11, 13)? * 3600 + part(14, 16)? * 60 + part(17, 19)?;
    // The same author, days_from_civil.
    let year = if month <= 2 { year.checked_sub(1)? } else { year };
    let (era, of_era) = (year / 400, year % 400);
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day.checked_sub(1)?;
    let days = era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year;
    Some(days.checked_sub(719_468)? * 86_400 + of_day)
}

/// The last second of the year 9999: a year has four digits, whatever the clock says.
const LAST_SEC: u64 = 253_402_300_799;

/// A time in milliseconds since 1970 as `2026-08-02T14:35:01Z`.
pub(super) fn text(unix_millis: u64) -> String {
    let secs = (unix_millis / 1000).min(LAST_SEC);
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
    use super::{secs, text};

    #[test]
    fn times_are_written_in_utc() {
        assert_eq!(text(0), "1970-01-01T00:00:00Z");
        assert_eq!(text(951_827_696_000), "2000-02-29T12:34:56Z");
    }

    #[test]
    fn a_time_is_read_as_it_was_written() {
        for time in (0..4_102_444_800).step_by(7_654_321) {
            assert_eq!(secs(&text(time * 1000)), Some(time));
        }
        assert_eq!([secs(""), secs("yesterday"), secs("1969-12-31T23:59:59Z")], [None; 3]);
    }
}
