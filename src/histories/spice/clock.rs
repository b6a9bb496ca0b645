//! Ticks of a spacecraft's clock, and SPICE's ephemeris time -> TAI.
//!
//! A clock of type 1 gives for ranges of ticks the parallel time, in s after J2000, and its rate per count of the most
//! significant field: `p + r (ticks - t) / ticks per count`. TDB - TT is `K sin E`, `E = M + EB sin M` (LSK).

use super::text_kernel::{TextKernel, find};
use crate::{epoch::J2000_TT_NS, error::HistoryError};
use base::{time::Tai, units::NS_PER_S};

/// Latest instant that is taken, s after J2000: the year 2250.
const MOST_S: f64 = 7.9e9;

/// One record in so many may be out of order: in the clock of one spacecraft 3 of 103 are.
const FALLING_PART: usize = 20;

/// TDB less TT.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EarthTime {
    k_s: f64,
    eb: f64,
    m_rad: [f64; 2],
}

impl EarthTime {
    /// Returns the constants of a leap-second kernel, or the usual ones.
    pub(super) fn of(texts: &[TextKernel]) -> Self {
        let given = |name: &str, count: usize| {
            let numbers = find(texts, name).map(|(values, _)| values.numbers.as_slice());
            numbers.filter(|numbers| numbers.len() == count && numbers.iter().all(|number| number.is_finite()))
        };
        Self {
            k_s: given("DELTET/K", 1).map_or(1.657e-3, |k| k[0]),
            eb: given("DELTET/EB", 1).map_or(1.671e-2, |eb| eb[0]),
            m_rad: given("DELTET/M", 2).map_or([6.239_996, 1.990_968_71e-7], |m| [m[0], m[1]]),
        }
    }

    /// Returns TAI in ns since 1970 of an instant of TDB, s after J2000, that is the sum of two numbers.
    pub(super) fn tai_ns_of_tdb(&self, parts_s: [f64; 2]) -> Option<i64> {
        let tdb_s = parts_s[0] + parts_s[1];
        let anomaly = self.m_rad[0] + self.m_rad[1] * tdb_s;
        let less_s = self.k_s * (anomaly + self.eb * anomaly.sin()).sin();
        tai_ns_of_tt([parts_s[0], parts_s[1], -less_s])
    }
}

/// Returns TAI in ns since 1970 of an instant of TT, s after J2000: large parts keep their digits.
fn tai_ns_of_tt(parts_s: [f64; 3]) -> Option<i64> {
    if !parts_s.iter().all(|part| part.abs() < MOST_S) {
        return None;
    }
    let ns = |part: f64| {
        let whole = part.floor();
        #[allow(clippy::cast_possible_truncation, reason = "below 7.9e9 s")]
        let (whole, rest) = (whole as i64, ((part - whole) * 1e9).round() as i64);
        whole * NS_PER_S + rest
    };
    Some(Tai::from_tt_ns(parts_s.into_iter().map(ns).sum::<i64>() + J2000_TT_NS).ns())
}

/// A spacecraft's clock.
#[derive(Debug)]
pub(super) struct SpacecraftClock {
    ticks_per_count: f64,
    is_tt: bool,
    /// Ticks, parallel time, rate.
    ranges: Vec<[f64; 3]>,
    earth: EarthTime,
    /// Ranges that begin no later than the one before them.
    pub(super) falling: usize,
}

impl SpacecraftClock {
    /// Returns the clock of an instrument: that of the spacecraft with a thousandth of its number. Errors name the text
    /// kernel at fault, and its line.
    pub(super) fn of(texts: &[TextKernel], instrument: i32, earth: EarthTime) -> Result<Self, HistoryError> {
        let clock = if instrument <= -1000 { instrument / -1000 } else { -instrument };
        let all: Vec<&str> = texts.iter().map(|kernel| kernel.file.as_str()).collect();
        let all = if all.is_empty() { "no text kernel".to_owned() } else { all.join(", ") };
        let found = |name: &str| find(texts, &format!("{name}_{clock}"));
        let refuse = |name: &str, why: &str| {
            let (file, line) = found(name).map_or((all.as_str(), None), |(values, file)| (file, Some(values.line)));
            let why = format!("{why} {name}_{clock}; wanted the text kernel (SCLK) of this clock, whole");
            HistoryError { file: file.to_owned(), line, why }
        };
        let numbers = |name: &str| {
            let (values, _) = found(name).ok_or_else(|| refuse(name, "no"))?;
            let is_whole = !values.numbers.is_empty() && values.numbers.iter().all(|number| number.is_finite());
            if is_whole { Ok(values.numbers.as_slice()) } else { Err(refuse(name, "values that are not numbers in")) }
        };
        let is_one_of = |value: f64, known: &[f64]| known.iter().any(|known| (value - known).abs() < 1e-9);
        if !is_one_of(numbers("SCLK_DATA_TYPE")?[0], &[1.0]) {
            return Err(refuse("SCLK_DATA_TYPE", "another type than 1 in"));
        }
        let system = if found("SCLK01_TIME_SYSTEM").is_some() { numbers("SCLK01_TIME_SYSTEM")?[0] } else { 1.0 };
        if !is_one_of(system, &[1.0, 2.0]) {
            return Err(refuse("SCLK01_TIME_SYSTEM", "neither TDB (1) nor TT (2) in"));
        }
        let ticks_per_count: f64 = numbers("SCLK01_MODULI")?.iter().skip(1).product();
        if ticks_per_count < 1.0 {
            return Err(refuse("SCLK01_MODULI", "less than one tick in a count by"));
        }
        let coefficients = numbers("SCLK01_COEFFICIENTS")?;
        let ranges: Vec<[f64; 3]> = coefficients.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        if ranges.is_empty() || coefficients.len() % 3 != 0 {
            return Err(refuse("SCLK01_COEFFICIENTS", "numbers that are not in threes in"));
        }
        let falling = ranges.windows(2).filter(|pair| pair[0][0] >= pair[1][0]).count();
        if falling > 1 + ranges.len() / FALLING_PART {
            return Err(refuse("SCLK01_COEFFICIENTS", "ticks that do not rise in"));
        }
        Ok(Self { ticks_per_count, is_tt: system > 1.5, ranges, earth, falling })
    }

    /// Returns the range that an instant is in, by the search of CSPICE, which finds its way past a record out of order.
    fn range(&self, ticks: f64) -> Option<&[f64; 3]> {
        let (mut lower, mut upper) = (0, self.ranges.len() - 1);
        if ticks.is_nan() || ticks < self.ranges[0][0] {
            return None;
        }
        if ticks >= self.ranges[upper][0] {
            return self.ranges.get(upper);
        }
        while upper > lower + 1 {
            let middle = usize::midpoint(lower, upper);
            if ticks < self.ranges[middle][0] { upper = middle } else { lower = middle }
        }
        self.ranges.get(lower)
    }

    /// Returns TAI in ns since 1970; `None` before the clock's first range, and for ticks that are not finite.
    pub(super) fn tai_ns(&self, ticks: f64) -> Option<i64> {
        let [from, time_s, rate] = *self.range(ticks)?;
        let since_s = (ticks - from) / self.ticks_per_count * rate;
        if self.is_tt { tai_ns_of_tt([time_s, since_s, 0.0]) } else { self.earth.tai_ns_of_tdb([time_s, since_s]) }
    }
}
