//! Segments of an SPK file -> an orbit.
//!
//! Types 9 (Lagrange) and 13 (Hermite) have rows, and are interpolated as they say. Types 2 and 3 (Chebyshev) are series,
//! and are evaluated as they are (`chebyshev`).

use super::clock::EarthTime;
use super::daf::{Daf, Summary, uncountable, whole};
use super::{axes_from_icrf, chosen};
use crate::chebyshev::{ChebyshevSeries, Record};
use crate::error::{HistoryError, Source};
use crate::newton::MOST_NODES;
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState};
use crate::segments::Unfit;
use glam::{DQuat, DVec3};

/// Rows of a directory.
const DIRECTORY: usize = 100;
/// Numbers of bodies.
const CENTRES: [(i32, Centre); 4] =
    [(399, Centre::Earth), (301, Centre::Moon), (10, Centre::Sun), (0, Centre::Barycentre)];

/// Reads the orbit of one target.
pub(super) fn read(
    daf: &Daf<'_>,
    source: &Source<'_>,
    target: Option<i32>,
    earth: EarthTime,
) -> Result<OrbitHistory, HistoryError> {
    let numbers: Vec<i32> = daf.segments.iter().map(|segment| segment.integers[0]).collect();
    let target = chosen(&numbers, target, "target", source)?;
    let mine = || daf.segments.iter().filter(|summary| summary.integers[0] == target);
    let centre = mine().next().map_or(0, |summary| summary.integers[1]);
    let Some((_, known)) = CENTRES.into_iter().find(|(number, _)| *number == centre) else {
        return Err(
            source.whole(format!("centre {centre}; wanted 399 (Earth), 301 (Moon), 10 (Sun) or 0 (barycentre)"))
        );
    };
    if let Some(other) = mine().find(|summary| summary.integers[1] != centre) {
        let why = format!("segments about {centre} and about {}; wanted one centre: split it", other.integers[1]);
        return Err(source.whole(why));
    }
    let mut segments = Vec::new();
    for summary in mine() {
        let reader = Reader { earth, source, axes_from_icrf: axes_from_icrf(summary.integers[2], source)? };
        let words = daf.words(summary, source)?;
        segments.push(match summary.integers[3] {
            2 => reader.chebyshev(&words, 3, summary)?,
            3 => reader.chebyshev(&words, 6, summary)?,
            9 => reader.rows(&words, lagrange, summary)?,
            13 => reader.rows(&words, hermite, summary)?,
            other => return Err(source.whole(format!("a segment of type {other}; wanted type 2, 3, 9 or 13"))),
        });
    }
    let orbit = OrbitHistory::layered("SPICE SPK", known, &segments);
    let mut orbit = orbit.map_err(|unfit| source.whole(unfit.to_string()))?;
    orbit.name = Some(target.to_string());
    Ok(orbit)
}

/// Returns the interpolation of a segment of type 9, which stores its degree.
fn lagrange(degree: usize) -> Result<OrbitInterpolation, String> {
    if degree < MOST_NODES {
        return Ok(OrbitInterpolation::Lagrange(degree));
    }
    Err(format!("degree {degree}; wanted at most {}", MOST_NODES - 1))
}

/// Returns the interpolation of a segment of type 13, which stores its number of rows less one.
fn hermite(rows_less_one: usize) -> Result<OrbitInterpolation, String> {
    let rows = rows_less_one.saturating_add(1);
    if rows <= MOST_NODES / 2 {
        return Ok(OrbitInterpolation::Hermite { rows });
    }
    Err(format!("windows of {rows} rows; wanted at most {} (degree {})", MOST_NODES / 2, MOST_NODES - 1))
}

struct Reader<'a> {
    earth: EarthTime,
    source: &'a Source<'a>,
    /// Those of the segment; `None` where they are those of ICRF.
    axes_from_icrf: Option<DQuat>,
}

impl Reader<'_> {
    fn in_icrf(&self, [x, y, z]: [f64; 3]) -> DVec3 {
        let v = DVec3::new(x, y, z);
        self.axes_from_icrf.map_or(v, |axes| axes.conjugate() * v)
    }

    fn instant(&self, et_s: f64) -> Result<i64, HistoryError> {
        let refuse =
            || self.source.whole(format!("an instant of {et_s} s after J2000; wanted one up to the year 2250"));
        self.earth.tai_ns_of_tdb([et_s, 0.0]).ok_or_else(refuse)
    }

    fn state(&self, et_s: f64, values: &[f64]) -> Result<OrbitState, HistoryError> {
        let [x, y, z, vx, vy, vz] = *values else { return Err(uncountable(self.source)) };
        let [position_km, velocity_km_s] = [[x, y, z], [vx, vy, vz]].map(|v| self.in_icrf(v));
        if !(position_km.is_finite() && velocity_km_s.is_finite()) {
            return Err(self.source.whole(format!("the state at {et_s} s after J2000 is not finite; wanted numbers")));
        }
        Ok(OrbitState { t_ns: self.instant(et_s)?, position_km, velocity_km_s })
    }

    /// Returns from when to when a segment may be used, ns.
    fn usable_ns(&self, summary: &Summary) -> Result<[Option<i64>; 2], HistoryError> {
        let [begin, end] = summary.doubles;
        Ok([Some(self.instant(begin)?), Some(self.instant(end)?)])
    }

    fn unfit(&self, why: &Unfit) -> HistoryError {
        self.source.whole(why.to_string())
    }

    /// Types 9 and 13: states, epochs, a directory, what the method needs, the count.
    fn rows(
        &self,
        words: &[f64],
        method: fn(usize) -> Result<OrbitInterpolation, String>,
        summary: &Summary,
    ) -> Result<OrbitSegment, HistoryError> {
        let [.., degree, count] = words else { return Err(uncountable(self.source)) };
        let [degree, count] = [*degree, *count].map(whole);
        let directory = count.checked_sub(1).map(|n| n / DIRECTORY);
        let total = count.checked_mul(7).zip(directory).and_then(|(rows, more)| rows.checked_add(more + 2));
        // Older writers have a directory entry for a full last hundred, too.
        if !total.is_some_and(|total| total == words.len() || total + 1 == words.len()) {
            return Err(uncountable(self.source));
        }
        let method = method(degree).map_err(|why| self.source.whole(format!("a segment with polynomials of {why}")))?;
        let (states, epochs) = words.split_at(6 * count);
        let states = states.chunks_exact(6).zip(epochs).map(|(state, et_s)| self.state(*et_s, state));
        let states = states.collect::<Result<Vec<_>, _>>()?;
        OrbitSegment::new(states, method, self.usable_ns(summary)?).map_err(|unfit| self.unfit(&unfit))
    }

    /// Types 2 and 3: records of middle, half length and coefficients; then begin, length, size and count of records.
    fn chebyshev(&self, words: &[f64], series: usize, summary: &Summary) -> Result<OrbitSegment, HistoryError> {
        let [.., size, count] = words else { return Err(uncountable(self.source)) };
        let [size, count] = [*size, *count].map(whole);
        let fits = size.checked_mul(count).and_then(|n| n.checked_add(4)) == Some(words.len());
        let terms = size.saturating_sub(2) / series;
        if !fits || count == 0 || terms == 0 || terms * series + 2 != size {
            return Err(uncountable(self.source));
        }
        let record = |record: &[f64]| {
            let (middle_s, half_s, numbers) = (record[0], record[1], &record[2..]);
            if !(half_s.is_finite() && half_s > 0.0 && numbers.iter().all(|number| number.is_finite())) {
                return Err(uncountable(self.source));
            }
            let part = |first: usize| {
                let coefficient =
                    |term: usize| self.in_icrf([0, 1, 2].map(|axis| numbers[(first + axis) * terms + term]));
                (0..terms).map(coefficient).collect()
            };
            let t_ns = [self.instant(middle_s - half_s)?, self.instant(middle_s)?, self.instant(middle_s + half_s)?];
            Ok(Record { t_ns, half_s, position: part(0), velocity: (series == 6).then(|| part(3)) })
        };
        let records = words.chunks_exact(size).take(count).map(record).collect::<Result<Vec<_>, _>>()?;
        let series = ChebyshevSeries::new(records).ok_or_else(|| uncountable(self.source))?;
        OrbitSegment::of_series(series, self.usable_ns(summary)?).map_err(|unfit| self.unfit(&unfit))
    }
}
