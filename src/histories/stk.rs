//! STK's text files: `stk.v.N`, one block of keywords, then rows up to its end. Remarks begin with `#`.
//!
//! A block `SegmentBoundaryTimes` inside says at which seconds nothing is interpolated across; rows of covariances, which
//! follow those of the ephemeris, are passed over.
//!
//! Attitude files (`.a`) have quaternions from the reference axes to the body's, scalar last or first, with or without
//! rates (deg/s, body axes); ephemeris files (`.e`) seconds, positions and velocities, in metres unless the file says
//! kilometres.

use crate::attitude::{AttitudeHistory, AttitudeSegment, Times};
use crate::attitude_methods::{AttitudeInterpolation, AttitudeState, MOST_DEGREE};
use crate::error::{HistoryError, Source};
use crate::message::{Entry, Row};
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState};
use crate::segments::Unfit;
use crate::{csv_table::COUNTED_NS, epoch::read_stk_date, newton::MOST_NODES, reference_axes::ReferenceAxes};
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::time::{Span, Tai};
use glam::{DQuat, DVec3};
use std::borrow::Cow;

/// One block.
pub(crate) struct Block<'a> {
    pub(crate) source: Source<'a>,
    keys: Vec<Entry<'a>>,
    /// The keyword after which rows follow.
    pub(crate) rows_are: Entry<'a>,
    pub(crate) rows: Vec<Row<'a>>,
    /// Seconds at which a segment ends and the next one begins.
    boundaries_s: Vec<f64>,
}

/// Where in a file a line is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Place {
    Outside,
    Inside,
    /// Among the seconds of segment boundaries.
    Boundaries,
    /// Among the rows of covariances.
    Covariances,
}

impl<'a> Block<'a> {
    /// Takes the file's block of this name (`Attitude`, `Ephemeris`) apart; `count` is the keyword of its number of
    /// rows.
    pub(crate) fn read(source: &Source<'a>, name: &str, count: &str) -> Result<Self, HistoryError> {
        let mut block = Self {
            source: *source,
            keys: Vec::new(),
            rows_are: Entry { key: "", value: "", offset: 0 },
            rows: Vec::new(),
            boundaries_s: Vec::new(),
        };
        let (mut place, mut is_ended, mut offset) = (Place::Outside, false, 0);
        for whole in source.text.split_inclusive('\n') {
            let (line, at) = (whole.trim_start_matches('\u{feff}').trim(), offset);
            offset += whole.len();
            if line.is_empty() || line.starts_with('#') || (place == Place::Outside && starts(line, "stk.")) {
                continue;
            }
            place = block.take(line, at, place, name)?;
            is_ended = place == Place::Outside;
        }
        if block.rows_are.key.is_empty() {
            return Err(source.whole(format!("no rows; wanted a keyword {name}Time...")));
        }
        if !is_ended {
            return Err(source.refuse(offset, "the end of the file", &format!("END {name}: the file is cut short")));
        }
        block.check_count(count)?;
        Ok(block)
    }

    /// Takes one line of the block of this name; returns where the next one is.
    fn take(&mut self, line: &'a str, offset: usize, place: Place, name: &str) -> Result<Place, HistoryError> {
        let (key, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let entry = Entry { key, value: value.trim(), offset };
        let is_of_boundaries = starts(entry.value, BOUNDARIES);
        let is_of_covariances = starts(entry.value, "Covariance");
        let is_of_rows = starts(entry.value, name) && starts(entry.value.get(name.len()..).unwrap_or_default(), "Time");
        if starts(key, "BEGIN") || starts(key, "END") {
            let wanted = || format!("one block, BEGIN {name}, with no other inside than BEGIN {BOUNDARIES}");
            return match (starts(key, "BEGIN"), place) {
                (true, Place::Outside) if starts(entry.value, name) => Ok(Place::Inside),
                (true, Place::Inside) if is_of_boundaries => Ok(Place::Boundaries),
                (false, Place::Boundaries) if is_of_boundaries => Ok(Place::Inside),
                (true, Place::Inside) if is_of_covariances => Ok(Place::Covariances),
                (false, Place::Covariances) if is_of_covariances => Ok(Place::Inside),
                (false, Place::Inside) if is_of_rows && !self.rows_are.key.is_empty() => Ok(Place::Inside),
                (false, Place::Inside | Place::Covariances) if starts(entry.value, name) => Ok(Place::Outside),
                _ => Err(self.source.refuse(offset, line, &wanted())),
            };
        }
        match place {
            Place::Outside => return Err(self.source.refuse(offset, line, &format!("BEGIN {name}"))),
            Place::Boundaries => {
                let seconds = line.parse().map_err(|_| self.source.refuse(offset, line, "seconds of a boundary"))?;
                self.boundaries_s.push(seconds);
            }
            Place::Covariances => {}
            Place::Inside if starts(key, "CovarianceTime") => return Ok(Place::Covariances),
            Place::Inside if !self.rows_are.key.is_empty() => self.rows.push(Row { text: Cow::Borrowed(line), offset }),
            Place::Inside if starts(key, name) && starts(key.get(name.len()..).unwrap_or_default(), "L") => {
                let wanted = format!("{name}Time...: positions and velocities in inertial axes, no geodetic ones");
                return Err(self.source.refuse(offset, line, &wanted));
            }
            Place::Inside if starts(key, name) && starts(key.get(name.len()..).unwrap_or_default(), "Time") => {
                self.rows_are = entry;
            }
            Place::Inside if self.find(key).is_some() => {
                return Err(self.source.refuse(offset, line, "each keyword once"));
            }
            Place::Inside => self.keys.push(entry),
        }
        Ok(place)
    }

    /// Returns the rows by segments: at a boundary one ends, and the next one begins with a row of the same time.
    pub(crate) fn segments<S: Copy>(&self, states: &[S], epoch: Tai, time_ns: fn(&S) -> i64) -> Vec<Vec<S>> {
        let boundaries_ns: Vec<i64> = self.boundaries_s.iter().map(|s| (epoch + Span::from_s(*s)).ns()).collect();
        let is_same = |a: &S, b: &S| time_ns(a) != time_ns(b) || !boundaries_ns.contains(&time_ns(a));
        states.chunk_by(is_same).map(<[S]>::to_vec).collect()
    }

    fn check_count(&self, count: &str) -> Result<(), HistoryError> {
        let Some(entry) = self.find(count) else { return Ok(()) };
        let is_right = entry.value.parse() == Ok(self.rows.len());
        let wanted = format!("{}, the number of rows that are there", self.rows.len());
        if is_right { Ok(()) } else { Err(self.refuse(entry, &wanted)) }
    }

    pub(crate) fn find(&self, key: &str) -> Option<&Entry<'a>> {
        self.keys.iter().find(|entry| entry.key.eq_ignore_ascii_case(key))
    }

    pub(crate) fn refuse(&self, entry: &Entry<'_>, wanted: &str) -> HistoryError {
        self.source.refuse(entry.offset, &format!("{} {}", entry.key, entry.value), wanted)
    }

    /// Reads the zero of the rows' seconds.
    pub(crate) fn epoch(&self) -> Result<Tai, HistoryError> {
        let entry = self.find("ScenarioEpoch").ok_or_else(|| self.source.whole("no ScenarioEpoch; wanted one"))?;
        read_stk_date(entry.value).ok_or_else(|| self.refuse(entry, "a date such as 1 Mar 2026 12:00:00.000 (UTCG)"))
    }

    /// Reads the axes; `key` names them.
    pub(crate) fn axes(&self, key: &str) -> Result<ReferenceAxes, HistoryError> {
        let entry = self.find(key).ok_or_else(|| self.source.whole(format!("no {key}; wanted ICRF or J2000")))?;
        ReferenceAxes::of_name(entry.value).ok_or_else(|| self.refuse(entry, "ICRF or J2000"))
    }

    /// Reads an optional whole number that a degree of interpolation is made of.
    pub(crate) fn degree(&self, key: &str) -> Result<Option<usize>, HistoryError> {
        let Some(entry) = self.find(key) else { return Ok(None) };
        let degree = entry.value.parse::<usize>().ok().filter(|degree| (1..=MOST_DEGREE).contains(degree));
        degree.map(Some).ok_or_else(|| self.refuse(entry, &format!("1 to {MOST_DEGREE}")))
    }

    /// Reads a row of a time and `N` numbers.
    pub(crate) fn numbers<const N: usize>(&self, row: &Row<'_>, epoch: Tai) -> Result<(i64, [f64; N]), HistoryError> {
        let mut words = row.text.split_whitespace().map(|word| (word, word.parse::<f64>().ok()));
        let mut next = |wanted: &str| {
            let (word, number) = words.next().unwrap_or(("too few numbers", None));
            let number = number.filter(|number| number.is_finite());
            number.ok_or_else(|| self.source.refuse(row.offset, word, wanted))
        };
        let wanted = format!("seconds and {N} finite numbers");
        let t_s = next(&wanted)?;
        let mut values = [0.0; N];
        for value in &mut values {
            *value = next(&wanted)?;
        }
        let t_ns = (epoch + Span::from_s(t_s)).ns();
        if words.next().is_some() || !COUNTED_NS.contains(&t_ns) {
            return Err(self.source.refuse(row.offset, &row.text, &wanted));
        }
        Ok((t_ns, values))
    }
}

const BOUNDARIES: &str = "SegmentBoundaryTimes";

/// Returns whether a line begins so, whatever its capitals.
fn starts(line: &str, begin: &str) -> bool {
    line.get(..begin.len()).is_some_and(|found| found.eq_ignore_ascii_case(begin))
}

/// Reads an attitude file (`.a`).
pub(crate) fn attitudes(source: &Source<'_>) -> Result<AttitudeHistory, HistoryError> {
    let block = Block::read(source, "Attitude", "NumberOfAttitudePoints")?;
    let (epoch, axes) = (block.epoch()?, block.axes("CoordinateAxes")?);
    let rows_are = block.rows_are.key.to_ascii_lowercase();
    let (is_scalar_first, has_rates) = match rows_are.as_str() {
        "attitudetimequaternions" => (false, false),
        "attitudetimequatscalarfirst" => (true, false),
        "attitudetimequatangvels" => (false, true),
        _ => {
            let wanted = "AttitudeTimeQuaternions, AttitudeTimeQuatScalarFirst or AttitudeTimeQuatAngVels: write the \
                          attitude as quaternions, angles and matrices are not read";
            return Err(block.refuse(&block.rows_are, wanted));
        }
    };
    let states = block.rows.iter().map(|row| {
        let (t_ns, [a, b, c, d, wx, wy, wz]) = if has_rates {
            block.numbers::<7>(row, epoch)?
        } else {
            let (t_ns, [a, b, c, d]) = block.numbers::<4>(row, epoch)?;
            (t_ns, [a, b, c, d, 0.0, 0.0, 0.0])
        };
        let given = if is_scalar_first { DQuat::from_xyzw(b, c, d, a) } else { DQuat::from_xyzw(a, b, c, d) };
        if (given.length() - 1.0).abs() > WRITTEN_NORM_TOLERANCE {
            return Err(source.refuse(row.offset, &row.text, "a quaternion whose norm is 1 within 0.001"));
        }
        let body_from_icrf = Rotation::from_quat(given.normalize().conjugate() * axes.rotation_from_icrf());
        let rate_rad_s = has_rates.then(|| DVec3::new(wx, wy, wz).map(f64::to_radians));
        Ok(AttitudeState { t_ns, body_from_icrf, rate_rad_s })
    });
    let states = states.collect::<Result<Vec<_>, HistoryError>>()?;
    let method = match (block.degree("InterpolationOrder")?, has_rates) {
        (Some(degree), _) if degree > 1 => AttitudeInterpolation::Lagrange(degree),
        (Some(_) | None, true) => AttitudeInterpolation::CubicHermite,
        (Some(_) | None, false) => AttitudeInterpolation::Slerp,
    };
    let unfit = |error: Unfit| source.whole(error.to_string());
    let segments = block.segments(&states, epoch, |state| state.t_ns).into_iter();
    let segments = segments.map(|states| AttitudeSegment::new(states, method, [None; 2])).collect::<Result<_, _>>();
    let mut history = AttitudeHistory::new("STK attitude", Times::Absolute, segments.map_err(unfit)?).map_err(unfit)?;
    history.notes.extend(axes.note().map(Into::into));
    Ok(history)
}

/// Reads an ephemeris file (`.e`).
pub(crate) fn orbit(source: &Source<'_>) -> Result<OrbitHistory, HistoryError> {
    let block = Block::read(source, "Ephemeris", "NumberOfEphemerisPoints")?;
    let (epoch, axes) = (block.epoch()?, block.axes("CoordinateSystem")?);
    if !block.rows_are.key.eq_ignore_ascii_case("EphemerisTimePosVel") {
        return Err(block.refuse(&block.rows_are, "EphemerisTimePosVel: positions with velocities"));
    }
    let centre = block.find("CentralBody").map(|entry| {
        let known = Centre::of_name(entry.value);
        known.ok_or_else(|| block.refuse(entry, "Earth, Moon or Sun"))
    });
    let centre = centre.transpose()?.unwrap_or(Centre::Earth);
    let km = match block.find("DistanceUnit").map(|entry| (entry, entry.value.to_ascii_lowercase())) {
        None => 1e-3,
        Some((entry, unit)) => match unit.as_str() {
            "meters" | "meter" | "m" => 1e-3,
            "kilometers" | "kilometer" | "km" => 1.0,
            _ => return Err(block.refuse(entry, "Meters or Kilometers")),
        },
    };
    let states = block.rows.iter().map(|row| {
        let (t_ns, [x, y, z, vx, vy, vz]) = block.numbers::<6>(row, epoch)?;
        let [position_km, velocity_km_s] = [DVec3::new(x, y, z), DVec3::new(vx, vy, vz)].map(|v| axes.to_icrf(v * km));
        Ok(OrbitState { t_ns, position_km, velocity_km_s })
    });
    let states = states.collect::<Result<Vec<_>, HistoryError>>()?;
    let unfit = |error: Unfit| source.whole(error.to_string());
    let method = method(&block)?;
    let segments = block.segments(&states, epoch, |state| state.t_ns).into_iter();
    let segments = segments.map(|states| OrbitSegment::new(states, method, [None; 2])).collect::<Result<_, _>>();
    let mut history = OrbitHistory::new("STK ephemeris", centre, segments.map_err(unfit)?).map_err(unfit)?;
    history.notes.extend(axes.note().map(Into::into));
    Ok(history)
}

/// Returns the interpolation that the file asks for; cubic where it leaves it open.
fn method(block: &Block<'_>) -> Result<OrbitInterpolation, HistoryError> {
    let samples_less_1 = block.degree("InterpolationSamplesM1")?.or(block.degree("InterpolationOrder")?);
    let Some(entry) = block.find("InterpolationMethod") else { return Ok(OrbitInterpolation::CUBIC) };
    match (entry.value.to_ascii_lowercase().as_str(), samples_less_1) {
        ("lagrange", Some(degree)) => Ok(OrbitInterpolation::Lagrange(degree)),
        ("lagrange", None) => Ok(OrbitInterpolation::Lagrange(5)),
        ("hermite", rows) if rows.unwrap_or(1) < MOST_NODES / 2 => {
            Ok(OrbitInterpolation::Hermite { rows: rows.unwrap_or(1) + 1 })
        }
        _ => {
            let wanted = format!("Lagrange, or Hermite with InterpolationSamplesM1 below {}", MOST_NODES / 2);
            Err(block.refuse(entry, &wanted))
        }
    }
}
