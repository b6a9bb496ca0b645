//! Ticks of a spacecraft's clock, and SPICE's ephemeris time -> TAI.
//!
//! A clock of type 1 gives for ranges of ticks the parallel time, in s after J2000, and its rate per count of the most
//! significant field: `p + r (ticks - t) / ticks per count`. TDB - TT is `K sin E`, `E = M + EB sin M` (LSK).

use super::text_kernel::TextKernel;
use crate::error::{HistoryError, Source};
use base::units::NS_PER_S;

/// J2000.0 on the count of TT since 1970.
const J2000_TT_NS: i64 = (10_957 * 86_400 + 43_200) * NS_PER_S;
/// TT - TAI.
const TT_LESS_TAI_NS: i64 = 32_184_000_000;
/// Latest instant that is taken, s after J2000: the year 2250.
const MOST_S: f64 = 7.9e9;

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
            let numbers = texts.iter().rev().find_map(|kernel| kernel.numbers(name));
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
    Some(parts_s.into_iter().map(ns).sum::<i64>() + J2000_TT_NS - TT_LESS_TAI_NS)
}

/// A spacecraft's clock.
#[derive(Debug)]
pub(super) struct SpacecraftClock {
    ticks_per_count: f64,
    is_tt: bool,
    /// Ticks, parallel time, rate.
    ranges: Vec<[f64; 3]>,
    earth: EarthTime,
}

impl SpacecraftClock {
    /// Returns the clock of an instrument: that of the spacecraft with a thousandth of its number.
    pub(super) fn of(
        texts: &[TextKernel],
        instrument: i32,
        earth: EarthTime,
        source: &Source<'_>,
    ) -> Result<Self, HistoryError> {
        let clock = if instrument <= -1000 { instrument / -1000 } else { -instrument };
        let numbers = |name: &str| {
            let name = format!("{name}_{clock}");
            texts.iter().rev().find_map(|kernel| kernel.numbers(&name)).filter(|n| n.iter().all(|n| n.is_finite()))
        };
        let refuse = |why: String| source.whole(format!("{why}; wanted the text kernel (SCLK) of its clock beside it"));
        let kind = numbers("SCLK_DATA_TYPE").ok_or_else(|| refuse(format!("no SCLK_DATA_TYPE_{clock}")))?;
        if kind.first().is_none_or(|kind| (kind - 1.0).abs() > 0.0) {
            return Err(refuse(format!("SCLK_DATA_TYPE_{clock} is not 1")));
        }
        let system = numbers("SCLK01_TIME_SYSTEM").and_then(|system| system.first()).copied().unwrap_or(1.0);
        if ![1.0, 2.0].iter().any(|known| (system - known).abs() < 0.5) {
            return Err(refuse(format!("SCLK01_TIME_SYSTEM_{clock} is {system}, neither TDB (1) nor TT (2)")));
        }
        let moduli = numbers("SCLK01_MODULI").filter(|moduli| !moduli.is_empty());
        let moduli = moduli.ok_or_else(|| refuse(format!("no SCLK01_MODULI_{clock}")))?;
        let ticks_per_count: f64 = moduli.iter().skip(1).product();
        let coefficients = numbers("SCLK01_COEFFICIENTS").filter(|c| !c.is_empty() && c.len() % 3 == 0);
        let coefficients = coefficients.ok_or_else(|| refuse(format!("no SCLK01_COEFFICIENTS_{clock} in threes")))?;
        let ranges: Vec<[f64; 3]> = coefficients.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        if ticks_per_count < 1.0 || ranges.windows(2).any(|pair| pair[0][0] >= pair[1][0]) {
            return Err(refuse(format!("moduli or coefficients of clock {clock} do not rise")));
        }
        Ok(Self { ticks_per_count, is_tt: system > 1.5, ranges, earth })
    }

    /// Returns TAI in ns since 1970; `None` before the clock's first range, and for ticks that are not finite.
    pub(super) fn tai_ns(&self, ticks: f64) -> Option<i64> {
        let after = self.ranges.partition_point(|range| range[0] <= ticks);
        let [from, time_s, rate] = *self.ranges.get(after.checked_sub(1)?)?;
        let since_s = (ticks - from) / self.ticks_per_count * rate;
        if self.is_tt { tai_ns_of_tt([time_s, since_s, 0.0]) } else { self.earth.tai_ns_of_tdb([time_s, since_s]) }
    }

    /// Returns the parallel seconds per tick at an instant.
    pub(super) fn s_per_tick(&self, ticks: f64) -> f64 {
        let after = self.ranges.partition_point(|range| range[0] <= ticks);
        self.ranges[after.saturating_sub(1)][2] / self.ticks_per_count
    }
}
