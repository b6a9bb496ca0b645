//! Dates and times of files in their time systems, to TAI and back.
//!
//! | system | relation |
//! |---|---|
//! | UTC | leap seconds of `base::time`; 23:59:60 where there was one |
//! | TAI, TT, GPS | TAI, TAI + 32.184 s, TAI - 19 s, exactly |
//! | TDB | TT and two sines of the year, approximate: 60 us at most (test beside ERFA's numbers) |
//!
//! Text is a calendar date `2026-03-01T12:00:00.5` or a day of the year `2026-060T12:00:00.5`, with any number of
//! decimals (rounded to a nanosecond) and an optional `Z`.

use base::time::{Span, Tai};
use base::units::{DAY_S, NS_PER_S};

/// A time system of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TimeSystem {
    Utc,
    Tai,
    Tt,
    Tdb,
    Gps,
}

/// Names that files use, by system.
const NAMES: [(&str, TimeSystem); 5] = [
    ("UTC", TimeSystem::Utc),
    ("TAI", TimeSystem::Tai),
    ("TT", TimeSystem::Tt),
    ("TDB", TimeSystem::Tdb),
    ("GPS", TimeSystem::Gps),
];
/// Time systems as messages list them.
pub(crate) const WANTED_SYSTEM: &str = "a time system of UTC, TAI, TT, TDB, GPS";
/// Forms of time as messages list them.
pub(crate) const WANTED_EPOCH: &str =
    "a time such as 2026-03-01T12:00:00.000 or 2026-060T12:00:00.000, years 1680 to 2260";
/// TAI - GPS (IS-GPS-200).
const TAI_LESS_GPS: Span = Span::from_ns(19 * NS_PER_S);
/// J2000.0 on the count of TT since 1970.
pub(crate) const J2000_TT_NS: i64 = (10_957 * 86_400 + 43_200) * NS_PER_S;
/// Years whose nanoseconds fit into 64 bits in every system.
const YEARS: core::ops::RangeInclusive<i64> = 1680..=2260;

impl TimeSystem {
    /// Returns the system of this name; capitals do not matter.
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        NAMES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, system)| *system)
    }

    /// Returns what must be said of an approximate system.
    pub(crate) fn note(self) -> Option<&'static str> {
        match self {
            Self::Tdb => Some("times are TDB, by two sines of the year: within 60 us"),
            Self::Utc | Self::Tai | Self::Tt | Self::Gps => None,
        }
    }

    /// Reads a date with a time; `None` when it is malformed, or outside the years that can be counted.
    pub(crate) fn read(self, text: &str) -> Option<Tai> {
        let civil = Civil::read(text)?;
        let ns = civil.ns_since_1970();
        let plain = |ns| (civil.second < 60).then(|| Tai::from_ns(ns));
        match self {
            Self::Utc => civil.utc(ns),
            Self::Tai => plain(ns),
            Self::Gps => plain(ns).map(|at| at + TAI_LESS_GPS),
            Self::Tt => (civil.second < 60).then(|| Tai::from_tt_ns(ns)),
            Self::Tdb => (civil.second < 60).then(|| Tai::from_tt_ns(ns - tdb_less_tt_ns(ns))),
        }
    }
}

/// Returns TDB - TT at a count of nanoseconds TT since 1970 (Explanatory Supplement 1992, eq. 2.222-1).
fn tdb_less_tt_ns(tt_ns: i64) -> i64 {
    let days = (tt_ns - J2000_TT_NS) as f64 / (DAY_S * NS_PER_S as f64);
    let anomaly_rad = (357.53 + 0.985_600_28 * days).to_radians();
    Span::from_s(0.001_658 * anomaly_rad.sin() + 0.000_014 * (2.0 * anomaly_rad).sin()).ns()
}

/// A date and a time of day, in no system.
struct Civil {
    days: i64,
    hour: i64,
    minute: i64,
    second: i64,
    ns: i64,
}

impl Civil {
    fn read(text: &str) -> Option<Self> {
        let text = text.trim();
        let (date, time) = text.strip_suffix(['Z', 'z']).unwrap_or(text).split_once(['T', 't'])?;
        let (time, decimals) = time.split_once('.').unwrap_or((time, ""));
        let mut parts = time.split(':');
        let mut two = || parts.next().filter(|part| part.len() == 2).and_then(digits);
        let (hour, minute, second) = (two()?, two()?, two()?);
        let is_time = parts.next().is_none() && hour < 24 && minute < 60 && second <= 60;
        let days = days_of(date)?;
        is_time.then_some(Self { days, hour, minute, second, ns: fraction_ns(decimals)? })
    }

    fn ns_since_1970(&self) -> i64 {
        ((self.days * 24 + self.hour) * 60 + self.minute) * 60 * NS_PER_S + self.second * NS_PER_S + self.ns
    }

    /// Returns the instant of a UTC time. Unix time counts a second 60 as the first second of the next day.
    fn utc(&self, ns: i64) -> Option<Tai> {
        let at = Tai::from_unix_ns(ns);
        if self.second < 60 {
            return Some(at);
        }
        let before = Tai::from_unix_ns(ns - self.ns - NS_PER_S);
        let leap = before + Span::from_ns(NS_PER_S);
        let is_leap = leap.to_unix_ns() != before.to_unix_ns() + NS_PER_S || leap != Tai::from_unix_ns(ns - self.ns);
        is_leap.then(|| leap + Span::from_ns(self.ns))
    }
}

fn digits(text: &str) -> Option<i64> {
    let is_number = !text.is_empty() && text.len() <= 9 && text.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| text.parse().ok())?
}

/// Returns nanoseconds of decimals, rounded; 1e9 where they round up to a second.
fn fraction_ns(decimals: &str) -> Option<i64> {
    let is_number = decimals.bytes().all(|byte| byte.is_ascii_digit()) && decimals.len() <= 40;
    if decimals.is_empty() || !is_number {
        return decimals.is_empty().then_some(0);
    }
    let nine: String = decimals.chars().chain("000000000".chars()).take(9).collect();
    let rounds_up = decimals.as_bytes().get(9).is_some_and(|digit| *digit >= b'5');
    digits(&nine).map(|ns| ns + i64::from(rounds_up))
}

/// Days since 1970-01-01 of `YYYY-MM-DD` or `YYYY-DDD`.
fn days_of(date: &str) -> Option<i64> {
    let mut parts = date.split('-');
    let year = parts.next().filter(|year| year.len() == 4).and_then(digits).filter(|year| YEARS.contains(year))?;
    let (second, third) = (parts.next()?, parts.next());
    let is_done = parts.next().is_none();
    let days = match third {
        Some(day) if second.len() == 2 && day.len() == 2 => {
            let (month, day) = (digits(second)?, digits(day)?);
            let length = *month_days(year).get(usize::try_from(month - 1).ok()?)?;
            (1..=length).contains(&day).then(|| days_before_month(year, month) + day - 1)?
        }
        None if second.len() == 3 => {
            let day = digits(second)?;
            (1..=365 + i64::from(is_leap_year(year))).contains(&day).then_some(day - 1)?
        }
        Some(_) | None => return None,
    };
    is_done.then_some(days_before_year(year) + days)
}

fn is_leap_year(year: i64) -> bool {
    year % 4 == 0 && (year % 100 != 0 || year % 400 == 0)
}

fn month_days(year: i64) -> [i64; 12] {
    [31, 28 + i64::from(is_leap_year(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]
}

fn days_before_month(year: i64, month: i64) -> i64 {
    month_days(year).iter().zip(1..month).map(|(days, _)| days).sum()
}

/// Returns days from 1970-01-01 of a date; a day past the end of its month counts on.
#[cfg(feature = "spice")]
pub(crate) fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    days_before_year(year) + days_before_month(year, month) + day - 1
}

/// Days from 1970-01-01 to the first of a year, of the Gregorian calendar.
fn days_before_year(year: i64) -> i64 {
    let leap_years = |year: i64| year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * (year - 1970) + leap_years(year - 1) - leap_years(1969)
}

/// Returns UTC text with nine decimals and no zone, as CCSDS messages have it.
pub(crate) fn utc_text(at: Tai) -> String {
    let text = at.to_rfc3339();
    let whole = text.split('.').next().unwrap_or_default();
    format!("{whole}.{:09}", at.to_unix_ns().rem_euclid(NS_PER_S))
}

/// Months of STK's dates.
pub(crate) const MONTHS: [&str; 12] =
    ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];

/// Reads STK's `1 Jan 2026 00:00:00.000` (UTCG).
pub(crate) fn read_stk_date(text: &str) -> Option<Tai> {
    let mut words = text.split_whitespace();
    let (day, month, year, time) = (words.next()?, words.next()?, words.next()?, words.next()?);
    let month = 1 + MONTHS.iter().position(|known| month.to_ascii_lowercase().starts_with(known))?;
    let day = digits(day)?;
    let is_done = words.next().is_none();
    is_done.then(|| TimeSystem::Utc.read(&format!("{year}-{month:02}-{day:02}T{time}")))?
}

/// Returns STK's form of a date.
pub(crate) fn stk_date(at: Tai) -> String {
    let text = utc_text(at);
    let month = text.get(5..7).and_then(|month| month.parse::<usize>().ok()).unwrap_or(1);
    let name: String = MONTHS.get(month - 1).map_or("jan", |name| name).into();
    let (first, rest) = name.split_at(1);
    let day = text.get(8..10).unwrap_or_default().trim_start_matches('0');
    format!("{day} {}{rest} {} {}", first.to_uppercase(), &text[..4], &text[11..])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utc(text: &str) -> Tai {
        Tai::from_rfc3339(text).unwrap()
    }

    #[test]
    fn systems_differ_by_their_constants() {
        let at = utc("2026-03-01T12:00:00Z");
        for (system, text) in [
            (TimeSystem::Utc, "2026-03-01T12:00:00"),
            (TimeSystem::Utc, "2026-060T12:00:00.000Z"),
            (TimeSystem::Tai, "2026-03-01T12:00:37"),
            (TimeSystem::Tt, "2026-03-01T12:01:09.184"),
            (TimeSystem::Gps, "2026-03-01T12:00:18"),
        ] {
            assert_eq!(system.read(text), Some(at), "{system:?} {text}");
        }
        assert_ne!(TimeSystem::Tai.read("2026-03-01T12:00:00"), Some(at), "control: a swapped system differs");
        assert_eq!(TimeSystem::of_name("tdb"), Some(TimeSystem::Tdb));
        assert_eq!(TimeSystem::of_name("UT1"), None);
    }

    #[test]
    fn tdb_is_as_erfa_says() {
        /// UTC; TDB - TT, microseconds, by erfa.dtdb (pyerfa 2.0.1.5), as in `base::time`.
        const DTDB: [(&str, f64); 3] =
            [("1999-04-10T06:00:00Z", 1643.8), ("2026-03-01T12:00:00Z", 1364.2), ("2037-10-05T00:00:00Z", -1625.9)];
        for (text, wanted_us) in DTDB {
            let got_us = tdb_less_tt_ns(utc(text).to_tt_ns()) as f64 * 1e-3;
            assert!((got_us - wanted_us).abs() < 60.0, "{text}: {got_us} us");
        }
        let tt = TimeSystem::Tt.read("2026-03-01T12:00:00").unwrap();
        let tdb = TimeSystem::Tdb.read("2026-03-01T12:00:00").unwrap();
        assert!(((tt - tdb).s() - 1.364e-3).abs() < 60e-6, "{} s", (tt - tdb).s());
    }

    #[test]
    fn leap_seconds_are_read_and_written() {
        let leap = TimeSystem::Utc.read("2016-12-31T23:59:60.25").unwrap();
        assert_eq!(leap, utc("2016-12-31T23:59:60.25Z"));
        assert_eq!(utc_text(leap), "2016-12-31T23:59:60.250000000");
        for text in ["2016-12-30T23:59:60", "2016-12-31T22:59:60"] {
            assert_eq!(TimeSystem::Utc.read(text), None, "{text}");
        }
        assert_eq!(TimeSystem::Tai.read("2016-12-31T23:59:60"), None, "TAI has none");
    }

    #[test]
    fn nanoseconds_survive_and_more_are_rounded() {
        let at = TimeSystem::Utc.read("2026-03-01T12:00:00.123456789").unwrap();
        assert_eq!(utc_text(at), "2026-03-01T12:00:00.123456789");
        assert_eq!(TimeSystem::Utc.read("2026-03-01T12:00:00.1234567894999"), Some(at));
        assert_eq!(
            TimeSystem::Utc.read("2026-03-01T11:59:59.99999999951"),
            TimeSystem::Utc.read("2026-03-01T12:00:00")
        );
        assert_eq!(read_stk_date(&stk_date(at)), Some(at));
        assert_eq!(stk_date(at), "1 Mar 2026 12:00:00.123456789");
    }

    #[test]
    fn dates_agree_with_the_other_calendar_at_hand() {
        for text in ["1972-01-01", "1999-12-31", "2000-02-29", "2024-12-31", "2100-03-01", "2259-07-15"] {
            let midnight = format!("{text}T00:00:00");
            assert_eq!(TimeSystem::Utc.read(&midnight), Some(utc(&format!("{midnight}Z"))), "{text}");
        }
    }

    #[test]
    fn malformed_times_are_refused() {
        for text in [
            "",
            "2026-03-01",
            "2026-02-29T00:00:00",
            "2026-13-01T00:00:00",
            "2026-366T00:00:00",
            "2026-03-01T24:00:00",
            "2026-03-01T12:00",
            "2026-3-1T12:00:00",
            "9999-03-01T12:00:00",
            "2026-03-01T12:00:00.1e3",
        ] {
            assert_eq!(TimeSystem::Utc.read(text), None, "{text}");
        }
    }
}
