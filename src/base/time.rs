//! Time inside starloop: i64 nanoseconds of TAI since 1970-01-01T00:00:00 TAI (the PTP epoch).
//!
//! Civil text (RFC 3339, UTC) and the dynamical scales are converted here and nowhere else, by `hifitime`, which
//! carries the leap-second table. Range: years 1678 to 2262.

use crate::base::units::{DAY_S, JULIAN_YEAR_D, NS_PER_S};
use core::fmt;
use core::ops::{Add, Sub};
use hifitime::leap_seconds::LatestLeapSeconds;
use hifitime::{Duration, Epoch, TimeScale};
use std::str::FromStr;

/// An instant: nanoseconds of TAI since 1970-01-01T00:00:00 TAI.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Tai {
    ns: i64,
}

/// A span between two instants, nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Span {
    ns: i64,
}

/// Text that is not an RFC 3339 instant.
#[derive(Debug, thiserror::Error)]
#[error("not a time: got \"{got}\", wanted RFC 3339 such as 2026-03-01T12:00:00Z ({why})")]
pub struct TimeError {
    got: String,
    why: String,
}

impl Span {
    /// No time at all.
    pub const ZERO: Self = Self { ns: 0 };

    /// From nanoseconds.
    #[must_use]
    pub const fn from_ns(ns: i64) -> Self {
        Self { ns }
    }

    /// From milliseconds.
    #[must_use]
    pub const fn from_ms(ms: i64) -> Self {
        Self { ns: ms * 1_000_000 }
    }

    /// From seconds, rounded to the nanosecond (saturating at the ends of i64).
    #[must_use]
    pub fn from_s(s: f64) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "float-to-int casts saturate; the range is 292 years")]
        Self { ns: (s * NS_PER_S as f64).round() as i64 }
    }

    /// Nanoseconds.
    #[must_use]
    pub const fn ns(self) -> i64 {
        self.ns
    }

    /// Seconds.
    #[must_use]
    pub fn s(self) -> f64 {
        self.ns as f64 / NS_PER_S as f64
    }

    /// Milliseconds.
    #[must_use]
    pub fn ms(self) -> f64 {
        self.ns as f64 / 1e6
    }
}

impl Tai {
    /// From nanoseconds of TAI since 1970-01-01T00:00:00 TAI.
    #[must_use]
    pub const fn from_ns(ns: i64) -> Self {
        Self { ns }
    }

    /// Nanoseconds of TAI since 1970-01-01T00:00:00 TAI.
    #[must_use]
    pub const fn ns(self) -> i64 {
        self.ns
    }

    /// Reads an RFC 3339 instant (UTC or with an offset).
    ///
    /// # Errors
    /// When the text is not such an instant, with the text and the reason.
    pub fn from_rfc3339(text: &str) -> Result<Self, TimeError> {
        let refuse = |why: String| TimeError { got: text.into(), why };
        let epoch = Epoch::from_str(text.trim()).map_err(|e| refuse(e.to_string()))?;
        let ns = (epoch.to_time_scale(TimeScale::TAI) - ptp_epoch()).total_nanoseconds();
        i64::try_from(ns).map(Self::from_ns).map_err(|_| refuse("outside the years 1678 to 2262".into()))
    }

    /// UTC text, RFC 3339 with microseconds.
    #[must_use]
    pub fn to_rfc3339(self) -> String {
        let (y, mo, d, h, mi, s, ns) = self.epoch().to_gregorian_utc();
        format!("{y:04}-{mo:02}-{d:02}T{h:02}:{mi:02}:{s:02}.{:06}Z", ns / 1000)
    }

    /// Julian years (TDB) since J2000.0: the argument of space motion and of ephemerides.
    #[must_use]
    pub fn years_since_j2000(self) -> f64 {
        self.days_tdb_since_j2000() / JULIAN_YEAR_D
    }

    /// Days (TDB) since J2000.0 = JD 2451545.0 TDB.
    #[must_use]
    pub fn days_tdb_since_j2000(self) -> f64 {
        self.epoch().to_tdb_seconds() / DAY_S
    }

    /// Julian date on the UTC scale (for SGP4 and displays; ambiguous inside a leap second).
    #[must_use]
    pub fn julian_date_utc(self) -> f64 {
        self.epoch().to_jde_utc_days()
    }

    /// Seconds UTC since 1970-01-01T00:00:00 UTC, as Unix time counts them.
    #[must_use]
    pub fn unix_s(self) -> f64 {
        self.epoch().to_unix_seconds()
    }

    /// Unix time, ns: exact. A leap second reads as the second after it.
    #[must_use]
    pub fn to_unix_ns(self) -> i64 {
        let begins = |unix_ns: i64, ahead_ns: i64| self.ns >= unix_ns.saturating_add(ahead_ns);
        self.ns.saturating_sub(tai_ahead_ns(begins))
    }

    /// From Unix time, ns: exact. Of a leap second and the second after it, which have one Unix time, the second is meant.
    #[must_use]
    pub fn from_unix_ns(unix_ns: i64) -> Self {
        Self { ns: unix_ns.saturating_add(tai_ahead_ns(|begin_ns, _| unix_ns >= begin_ns)) }
    }

    fn epoch(self) -> Epoch {
        ptp_epoch() + Duration::from_truncated_nanoseconds(self.ns)
    }
}

/// How far TAI is ahead of UTC, ns, by the last step that `has_come`: told when it came (Unix time, ns) and what holds then.
fn tai_ahead_ns(has_come: impl Fn(i64, i64) -> bool) -> i64 {
    /// From 1900, where the table counts from, to 1970.
    const UNIX_FROM_1900_S: f64 = 2_208_988_800.0;
    let steps = LatestLeapSeconds::default().filter(|step| step.announced_by_iers).map(|step| {
        let ns = |s: f64| Span::from_s(s).ns();
        (ns(step.timestamp_tai_s - UNIX_FROM_1900_S), ns(step.delta_at))
    });
    steps.filter(|(unix_ns, ahead_ns)| has_come(*unix_ns, *ahead_ns)).last().map_or(0, |(_, ahead_ns)| ahead_ns)
}

fn ptp_epoch() -> Epoch {
    Epoch::from_gregorian(1970, 1, 1, 0, 0, 0, 0, TimeScale::TAI)
}

impl Add<Span> for Tai {
    type Output = Self;
    fn add(self, span: Span) -> Self {
        Self { ns: self.ns.saturating_add(span.ns) }
    }
}

impl Sub<Span> for Tai {
    type Output = Self;
    fn sub(self, span: Span) -> Self {
        Self { ns: self.ns.saturating_sub(span.ns) }
    }
}

impl Sub for Tai {
    type Output = Span;
    fn sub(self, earlier: Self) -> Span {
        Span { ns: self.ns.saturating_sub(earlier.ns) }
    }
}

impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { ns: self.ns.saturating_add(other.ns) }
    }
}

impl fmt::Display for Tai {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.to_rfc3339())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utc_text_round_trips_across_leap_seconds() {
        for text in ["2026-11-20T12:34:56.000001Z", "1999-12-31T23:59:59.500000Z", "2017-01-01T00:00:00.000000Z"] {
            let at = Tai::from_rfc3339(text).expect("a valid instant");
            assert_eq!(at.to_rfc3339(), text, "through {} ns", at.ns());
        }
    }

    #[test]
    fn tai_is_37_s_ahead_of_utc_since_2017() {
        let at = Tai::from_rfc3339("2020-01-01T00:00:00Z").expect("a valid instant");
        // 2020-01-01 is 18262 days after 1970-01-01 (IERS Bulletin C 52: TAI - UTC = 37 s).
        assert_eq!(at.ns(), (18_262 * 86_400 + 37) * NS_PER_S);
    }

    #[test]
    fn j2000_is_zero_days_of_tdb() {
        // J2000.0 TT = 2000-01-01T12:00:00 TT = 11:59:27.816 TAI = 11:58:55.816 UTC; TDB differs by < 2 ms.
        let at = Tai::from_rfc3339("2000-01-01T11:58:55.816Z").expect("a valid instant");
        assert!(at.days_tdb_since_j2000().abs() * DAY_S < 2e-3, "{} d", at.days_tdb_since_j2000());
    }

    #[test]
    fn unix_time_is_exact_on_both_sides_of_a_leap_second() {
        // IERS Bulletin C 52: TAI - UTC = 36 s until 2016-12-31T23:59:60 UTC, 37 s from 2017-01-01T00:00:00 on,
        // which is Unix time 1483228800.
        let midnight = Tai::from_ns((1_483_228_800 + 37) * NS_PER_S);
        assert_eq!(midnight.to_unix_ns(), 1_483_228_800 * NS_PER_S);
        let before_leap = midnight - Span::from_ns(NS_PER_S + 1);
        assert_eq!(before_leap.to_unix_ns(), 1_483_228_799_999_999_999);
        assert_eq!(
            (midnight - Span::from_ns(1)).to_unix_ns(),
            1_483_228_800_999_999_999,
            "inside: as the second after"
        );
        for at in [midnight, before_leap, Tai::from_ns(1_790_000_000_123_456_789)] {
            assert_eq!(Tai::from_unix_ns(at.to_unix_ns()), at);
        }
        let inside = midnight - Span::from_ns(1);
        assert_eq!(
            Tai::from_unix_ns(inside.to_unix_ns()) - inside,
            Span::from_ns(NS_PER_S),
            "the second after is meant"
        );
    }

    #[test]
    fn text_that_is_no_time_says_what_was_wanted() {
        let error = Tai::from_rfc3339("yesterday").expect_err("no instant").to_string();
        assert!(error.contains("yesterday") && error.contains("RFC 3339"), "{error}");
    }
}
