//! Segments of an SPK file -> an orbit.
//!
//! Types 9 (Lagrange) and 13 (Hermite) have rows, and are interpolated as they say. Types 2 and 3 (Chebyshev) are
//! evaluated at [`STEPS`] instants of each record, and interpolated by Hermite polynomials of degree 7 through them.

use super::clock::EarthTime;
use super::daf::{Daf, Summary, whole};
use super::{check_axes, chosen};
use crate::error::{HistoryError, Source};
use crate::newton::MOST_NODES;
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState};
use glam::DVec3;

/// Instants per record of Chebyshev coefficients.
const STEPS: u32 = 8;
/// Most rows that come of coefficients.
const ROWS_MAX: usize = 4_000_000;
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
    let reader = Reader { earth, source };
    let mut segments = Vec::new();
    for summary in mine() {
        check_axes(summary.integers[2], source)?;
        let words = daf.words(summary, source)?;
        segments.push(match summary.integers[3] {
            2 => reader.chebyshev(&words, 3, summary)?,
            3 => reader.chebyshev(&words, 6, summary)?,
            9 => reader.rows(
                &words,
                |degree| Some(degree).filter(|d| *d < MOST_NODES).map(OrbitInterpolation::Lagrange),
                summary,
            )?,
            13 => reader.rows(&words, hermite, summary)?,
            other => return Err(source.whole(format!("a segment of type {other}; wanted type 2, 3, 9 or 13"))),
        });
    }
    segments.sort_by_key(|segment| segment.states()[0].t_ns);
    let mut orbit = OrbitHistory::new("SPICE SPK", known, segments).map_err(|unfit| source.whole(unfit.to_string()))?;
    orbit.name = Some(target.to_string());
    Ok(orbit)
}

/// Returns the interpolation of a segment of type 13, which stores its number of rows less one.
fn hermite(rows_less_one: usize) -> Option<OrbitInterpolation> {
    let rows = rows_less_one.checked_add(1).filter(|rows| 2 * rows <= MOST_NODES)?;
    Some(OrbitInterpolation::Hermite { rows })
}

struct Reader<'a> {
    earth: EarthTime,
    source: &'a Source<'a>,
}

impl Reader<'_> {
    fn broken(&self) -> HistoryError {
        self.source
            .whole("the counts of a segment do not fit its length; wanted a whole file: copy it again, in binary")
    }

    fn instant(&self, et_s: f64) -> Result<i64, HistoryError> {
        let refuse =
            || self.source.whole(format!("an instant of {et_s} s after J2000; wanted one up to the year 2250"));
        self.earth.tai_ns_of_tdb([et_s, 0.0]).ok_or_else(refuse)
    }

    fn state(&self, et_s: f64, values: &[f64]) -> Result<OrbitState, HistoryError> {
        let [x, y, z, vx, vy, vz] = *values else { return Err(self.broken()) };
        let (position_km, velocity_km_s) = (DVec3::new(x, y, z), DVec3::new(vx, vy, vz));
        if !(position_km.is_finite() && velocity_km_s.is_finite()) {
            return Err(self.source.whole(format!("the state at {et_s} s after J2000 is not finite; wanted numbers")));
        }
        Ok(OrbitState { t_ns: self.instant(et_s)?, position_km, velocity_km_s })
    }

    fn segment(
        &self,
        states: Vec<OrbitState>,
        method: OrbitInterpolation,
        summary: &Summary,
    ) -> Result<OrbitSegment, HistoryError> {
        let [begin, end] = summary.doubles;
        let usable = [Some(self.instant(begin)?), Some(self.instant(end)?)];
        OrbitSegment::new(states, method, usable).map_err(|unfit| self.source.whole(unfit.to_string()))
    }

    /// Types 9 and 13: states, epochs, a directory, what the method needs, the count.
    fn rows(
        &self,
        words: &[f64],
        method: impl Fn(usize) -> Option<OrbitInterpolation>,
        summary: &Summary,
    ) -> Result<OrbitSegment, HistoryError> {
        let [.., degree, count] = words else { return Err(self.broken()) };
        let [degree, count] = [*degree, *count].map(whole);
        let directory = count.checked_sub(1).map(|n| n / DIRECTORY);
        let total = count.checked_mul(7).zip(directory).and_then(|(rows, more)| rows.checked_add(more + 2));
        // Older writers have a directory entry for a full last hundred, too.
        if !total.is_some_and(|total| total == words.len() || total + 1 == words.len()) {
            return Err(self.broken());
        }
        let Some(method) = method(degree) else {
            let why = format!("a polynomial of degree or window {degree}; wanted at most degree {}", MOST_NODES - 1);
            return Err(self.source.whole(why));
        };
        let (states, epochs) = words.split_at(6 * count);
        let states = states.chunks_exact(6).zip(epochs).map(|(state, et_s)| self.state(*et_s, state));
        self.segment(states.collect::<Result<_, _>>()?, method, summary)
    }

    /// Types 2 and 3: records of middle, half length and coefficients; then begin, length, size and count of records.
    fn chebyshev(&self, words: &[f64], series: usize, summary: &Summary) -> Result<OrbitSegment, HistoryError> {
        let [.., size, count] = words else { return Err(self.broken()) };
        let [size, count] = [*size, *count].map(whole);
        let fits = size.checked_mul(count).and_then(|n| n.checked_add(4)) == Some(words.len());
        let terms = size.saturating_sub(2) / series;
        if !fits || count == 0 || terms == 0 || terms * series + 2 != size || count > ROWS_MAX / STEPS as usize {
            return Err(self.broken());
        }
        let mut states = Vec::with_capacity(count * STEPS as usize + 1);
        for (place, record) in words.chunks_exact(size).take(count).enumerate() {
            let (middle_s, half_s) = (record[0], record[1]);
            if !(half_s.is_finite() && half_s > 0.0) {
                return Err(self.broken());
            }
            for step in 0..STEPS + u32::from(place + 1 == count) {
                let at = 2.0 * f64::from(step) / f64::from(STEPS) - 1.0;
                let mut values = [0.0; 6];
                for axis in 0..3 {
                    let [value, slope] = series_at(&record[2 + axis * terms..][..terms], at);
                    values[axis] = value;
                    values[axis + 3] = slope / half_s;
                    if series == 6 {
                        values[axis + 3] = series_at(&record[2 + (axis + 3) * terms..][..terms], at)[0];
                    }
                }
                states.push(self.state(middle_s + at * half_s, &values)?);
            }
        }
        self.segment(states, OrbitInterpolation::Hermite { rows: 4 }, summary)
    }
}

/// Returns the value and derivative of a Chebyshev series.
fn series_at(coefficients: &[f64], at: f64) -> [f64; 2] {
    let (mut t, mut slopes) = ([1.0, at], [0.0, 1.0]);
    let [mut value, mut slope] = [0.0; 2];
    for coefficient in coefficients {
        value += coefficient * t[0];
        slope += coefficient * slopes[0];
        slopes = [slopes[1], 2.0 * t[1] + 2.0 * at * slopes[1] - slopes[0]];
        t = [t[1], 2.0 * at * t[1] - t[0]];
    }
    [value, slope]
}
