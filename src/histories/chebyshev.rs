//! Chebyshev series in records that follow each other, as SPICE kernels have them (SPK, types 2 and 3).
//!
//! A record is a polynomial in `u`, which goes from -1 to 1 in ephemeris time (TDB). Over a record TDB - TAI changes by
//! microseconds: `u` is the quadratic in TAI through the record's beginning, middle and end, which leaves 1e-12 of it.
//! Tests: `spice::tests`, `hil_scripts/tests/test_spice.py`.

use crate::attitude_methods::s_between;
use glam::DVec3;

/// The series of one segment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChebyshevSeries {
    /// By rising time; one at least.
    records: Vec<Record>,
}

/// One polynomial.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Record {
    /// Beginning, middle, end: ns of TAI.
    pub(crate) t_ns: [i64; 3],
    /// Half of its length, s of TDB.
    pub(crate) half_s: f64,
    /// Coefficients of the position, km.
    pub(crate) position: Vec<DVec3>,
    /// Coefficients of the velocity, km/s; without them it is the derivative of the position.
    pub(crate) velocity: Option<Vec<DVec3>>,
}

impl Record {
    fn u(&self, t_ns: i64) -> f64 {
        let [begin, middle, end] = self.t_ns;
        let [before_s, after_s] = [s_between(begin, middle), s_between(middle, end)];
        let bend = (1.0 / before_s - 1.0 / after_s) / (before_s + after_s);
        let since_s = s_between(middle, t_ns);
        since_s * (1.0 / after_s - bend * after_s) + bend * since_s * since_s
    }

    /// Returns position and velocity at an instant.
    pub(crate) fn at(&self, t_ns: i64) -> [DVec3; 2] {
        let u = self.u(t_ns);
        let [position_km, slope] = value_and_slope(&self.position, u);
        let velocity_km_s = match &self.velocity {
            Some(velocity) => value_and_slope(velocity, u)[0],
            None => slope / self.half_s,
        };
        [position_km, velocity_km_s]
    }
}

impl ChebyshevSeries {
    /// Returns the series of records; `None` where there is none, or their times do not rise.
    pub(crate) fn new(records: Vec<Record>) -> Option<Self> {
        let is_forward = records.iter().all(|record| record.t_ns.windows(2).all(|pair| pair[0] < pair[1]));
        let is_rising = records.windows(2).all(|pair| pair[0].t_ns[0] < pair[1].t_ns[0]);
        (is_forward && is_rising && !records.is_empty()).then_some(Self { records })
    }

    /// Returns position and velocity at an instant. Does not allocate.
    pub(crate) fn at(&self, t_ns: i64) -> [DVec3; 2] {
        let after = self.records.partition_point(|record| record.t_ns[0] <= t_ns);
        self.records[after.saturating_sub(1)].at(t_ns)
    }

    /// Returns the beginning of every record, and the end of the last one, ns of TAI.
    pub(crate) fn ends_ns(&self) -> impl Iterator<Item = i64> + '_ {
        let begins = self.records.iter().map(|record| record.t_ns[0]);
        begins.chain(self.records.last().map(|record| record.t_ns[2]))
    }
}

/// Returns the value and derivative of a series.
fn value_and_slope(coefficients: &[DVec3], u: f64) -> [DVec3; 2] {
    let (mut t, mut slopes) = ([1.0, u], [0.0, 1.0]);
    let [mut value, mut slope] = [DVec3::ZERO; 2];
    for coefficient in coefficients {
        value += *coefficient * t[0];
        slope += *coefficient * slopes[0];
        slopes = [slopes[1], 2.0 * t[1] + 2.0 * u * slopes[1] - slopes[0]];
        t = [t[1], 2.0 * u * t[1] - t[0]];
    }
    [value, slope]
}
