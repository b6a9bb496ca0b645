//! TAI - UTC: the table of leap seconds.
//!
//! Source: IERS Bulletin C (C 52 of 2016 is the last that announced one; C 70 says that there is none up to the end of
//! 2025, and none has been announced since). The table is written out because what a library has must be exact in the
//! last minute before a leap second as well, where `hifitime` 4.3 gives UTC a second early. Before 1972 UTC ran at
//! another rate: here it is TAI.

use crate::units::NS_PER_S;

/// Unix time, s, from which TAI - UTC is the second number, s.
const TABLE: [(i64, i64); 28] = [
    (63_072_000, 10),    // 1972-01-01
    (78_796_800, 11),    // 1972-07-01
    (94_694_400, 12),    // 1973-01-01
    (126_230_400, 13),   // 1974-01-01
    (157_766_400, 14),   // 1975-01-01
    (189_302_400, 15),   // 1976-01-01
    (220_924_800, 16),   // 1977-01-01
    (252_460_800, 17),   // 1978-01-01
    (283_996_800, 18),   // 1979-01-01
    (315_532_800, 19),   // 1980-01-01
    (362_793_600, 20),   // 1981-07-01
    (394_329_600, 21),   // 1982-07-01
    (425_865_600, 22),   // 1983-07-01
    (489_024_000, 23),   // 1985-07-01
    (567_993_600, 24),   // 1988-01-01
    (631_152_000, 25),   // 1990-01-01
    (662_688_000, 26),   // 1991-01-01
    (709_948_800, 27),   // 1992-07-01
    (741_484_800, 28),   // 1993-07-01
    (773_020_800, 29),   // 1994-07-01
    (820_454_400, 30),   // 1996-01-01
    (867_715_200, 31),   // 1997-07-01
    (915_148_800, 32),   // 1999-01-01
    (1_136_073_600, 33), // 2006-01-01
    (1_230_768_000, 34), // 2009-01-01
    (1_341_100_800, 35), // 2012-07-01
    (1_435_708_800, 36), // 2015-07-01
    (1_483_228_800, 37), // 2017-01-01
];

/// Returns TAI - UTC, s, of a count of TAI nanoseconds. A leap second still has the old number.
pub(super) fn tai_less_utc_s(tai_ns: i64) -> i64 {
    let has_begun = |(unix_s, after): &(i64, i64)| tai_ns >= (unix_s + after) * NS_PER_S;
    TABLE.iter().rev().find(|row| has_begun(row)).map_or(0, |row| row.1)
}

/// Returns TAI - UTC, s, of a Unix time in whole seconds; that after the leap second where it counts twice.
pub(super) fn tai_less_utc_of_unix_s(unix_s: i64) -> i64 {
    TABLE.iter().rev().find(|row| unix_s >= row.0).map_or(0, |row| row.1)
}

/// Returns true inside a second 60. (The ten seconds of 1972-01-01 do not count as leap seconds.)
pub(super) fn is_leap_second(tai_ns: i64) -> bool {
    let begins_ns = |(unix_s, after): &(i64, i64)| (unix_s + after - 1) * NS_PER_S;
    TABLE.iter().skip(1).any(|row| (begins_ns(row)..begins_ns(row) + NS_PER_S).contains(&tai_ns))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Tai;

    /// The other table at hand, away from where it is wrong.
    #[test]
    fn the_table_is_that_of_hifitime() {
        for (unix_s, after) in TABLE {
            for (at_s, wanted) in [(unix_s - 3600, after - 1), (unix_s + 3600, after)] {
                let epoch = hifitime::Epoch::from_unix_seconds(at_s as f64);
                let theirs = (epoch.to_tai_seconds() - epoch.to_utc_seconds()).round() as i64;
                // 1971 has 0 in both tables, not 9.
                let wanted = if unix_s == TABLE[0].0 && at_s < unix_s { 0 } else { wanted };
                assert_eq!((theirs, tai_less_utc_of_unix_s(at_s)), (wanted, wanted), "{at_s}");
                assert_eq!(tai_less_utc_s((at_s + wanted) * NS_PER_S), wanted, "{at_s}");
            }
        }
    }

    #[test]
    fn the_table_is_that_of_erfa() {
        // TAI - UTC from this day on, by erfa.dat (pyerfa 2.0.1.5): all there were since 1991.
        let days = [
            "1991-01-01",
            "1992-07-01",
            "1993-07-01",
            "1994-07-01",
            "1996-01-01",
            "1997-07-01",
            "1999-01-01",
            "2006-01-01",
            "2009-01-01",
            "2012-07-01",
            "2015-07-01",
            "2017-01-01",
        ];
        for (day, after) in days.into_iter().zip(26_i64..) {
            let midnight = Tai::from_rfc3339(&format!("{day}T00:00:00Z")).expect("a valid instant");
            assert_eq!(midnight.ns() - midnight.to_unix_ns(), after * NS_PER_S, "{day}");
            let before = midnight - crate::time::Span::from_s(2.0);
            assert_eq!(before.ns() - before.to_unix_ns(), (after - 1) * NS_PER_S, "the day before {day}");
        }
    }

    #[test]
    fn leap_seconds_are_one_second_long() {
        let (unix_s, after) = TABLE[TABLE.len() - 1];
        let new_year_ns = (unix_s + after) * NS_PER_S;
        let is_inside = [-NS_PER_S - 1, -NS_PER_S, -1, 0].map(|ns| is_leap_second(new_year_ns + ns));
        assert_eq!(is_inside, [false, true, true, false]);
        assert_eq!(Tai::from_unix_ns(unix_s * NS_PER_S).ns(), new_year_ns);
    }
}
