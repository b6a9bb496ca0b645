//! Positions and velocities over time as a file has them, about one body, in ICRF axes.
//!
//! Between rows: a Hermite polynomial through positions and velocities (cubic, from two rows, unless the file wants a
//! higher degree), Lagrange polynomials, or the Chebyshev series of a SPICE kernel. Error of the cubic: `x'''' h^4 / 384`
//! in position. Outside of its segments an orbit is not available.

use crate::attitude_methods::{around, s_between};
use crate::findings::{self, Comparison, Floor, Names, Step, compare};
use crate::segments::{self, Unfit};
use crate::{chebyshev::ChebyshevSeries, newton::Newton};
use core::fmt;
use glam::DVec3;
use std::sync::Arc;

/// The origin of positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Centre {
    /// The Earth's centre.
    Earth,
    /// The Moon's centre.
    Moon,
    /// The Sun's centre.
    Sun,
    /// The solar-system barycentre.
    Barycentre,
}

/// Names in files, the one that is written first.
const CENTRES: [(&str, Centre); 8] = [
    ("EARTH", Centre::Earth),
    ("MOON", Centre::Moon),
    ("SUN", Centre::Sun),
    ("SOLAR SYSTEM BARYCENTER", Centre::Barycentre),
    ("SOLAR_SYSTEM_BARYCENTER", Centre::Barycentre),
    ("SSB", Centre::Barycentre),
    ("LUNA", Centre::Moon),
    ("SOL", Centre::Sun),
];
/// Speed of escape from the surface of the Sun (IAU 2015 Resolution B3).
const SUN_ESCAPE_KM_S: f64 = 617.6;
/// Centres as messages list them.
pub(crate) const WANTED_CENTRE: &str = "a centre of EARTH, MOON, SUN, SOLAR SYSTEM BARYCENTER";

impl Centre {
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        CENTRES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name.trim())).map(|(_, centre)| *centre)
    }

    /// Returns the fastest that anything moves about it at this distance: three times the speed of escape, and beyond its
    /// reach the speed of escape from the Sun's surface.
    fn fastest_km_s(self, distance_km: f64) -> f64 {
        let (gm_km3_s2, reach_km) = match self {
            Self::Earth => (3.986e5, 1.5e6),
            Self::Moon => (4.903e3, 6.6e4),
            Self::Sun => (1.327e11, f64::INFINITY),
            Self::Barycentre => (0.0, 0.0),
        };
        let escape_km_s = (2.0 * gm_km3_s2 / distance_km).sqrt();
        if distance_km < reach_km { 3.0 * escape_km_s } else { SUN_ESCAPE_KM_S }
    }

    /// Returns its name in CCSDS messages.
    pub fn name(self) -> &'static str {
        CENTRES.iter().find(|(_, centre)| *centre == self).map_or("EARTH", |(name, _)| name)
    }
}

/// One row of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitState {
    /// Nanoseconds of TAI since 1970.
    pub t_ns: i64,
    /// Position from the centre, ICRF axes.
    pub position_km: DVec3,
    /// Velocity with respect to the centre, ICRF axes.
    pub velocity_km_s: DVec3,
}

/// How an orbit goes between rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrbitInterpolation {
    /// A polynomial through positions and velocities of so many rows; its degree is twice as high less one.
    Hermite {
        /// Rows.
        rows: usize,
    },
    /// Polynomials of this degree through positions, and through velocities.
    Lagrange(usize),
    /// Series of a SPICE kernel, evaluated as it has them.
    Chebyshev,
}

impl fmt::Display for OrbitInterpolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hermite { rows } => write!(f, "Hermite of degree {} (positions and velocities)", 2 * rows - 1),
            Self::Lagrange(degree) => write!(f, "Lagrange of degree {degree}"),
            Self::Chebyshev => write!(f, "Chebyshev series, evaluated as the file has them"),
        }
    }
}

impl OrbitInterpolation {
    /// From two rows.
    pub const CUBIC: Self = Self::Hermite { rows: 2 };
}

/// Rows that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct OrbitSegment {
    states: Arc<[OrbitState]>,
    method: OrbitInterpolation,
    usable_ns: [i64; 2],
    /// Those of [`OrbitInterpolation::Chebyshev`].
    series: Option<Arc<ChebyshevSeries>>,
}

/// One object's orbit over time.
#[derive(Debug, Clone, PartialEq)]
pub struct OrbitHistory {
    /// Name of the format, for people.
    pub format: String,
    /// Name of the object, where the file has one.
    pub name: Option<String>,
    /// Centre from which positions are measured.
    pub centre: Centre,
    /// Approximations and peculiarities, one sentence each.
    pub notes: Vec<String>,
    /// Doubts about its contents, one sentence each.
    pub warnings: Vec<String>,
    segments: Vec<OrbitSegment>,
    /// Why these velocities cannot be those of these positions, or of anything.
    contradiction: Option<String>,
}

/// Velocities have two digits, positions decimetres.
const FLOOR: Floor = Floor { part: 0.01, value: 1e-4, most: f64::INFINITY };
const NAMES: Names = Names { derivatives: "velocities", values: "positions", unit: "km/s", unit_is: 1.0 };

fn too_few(rows: usize) -> Unfit {
    Unfit::of_all(format!("a segment has {rows} rows; wanted two at least"))
}

impl OrbitSegment {
    pub(crate) fn new(
        states: Vec<OrbitState>,
        method: OrbitInterpolation,
        usable_ns: [Option<i64>; 2],
    ) -> Result<Self, Unfit> {
        let ([first, .., last], true) = (states.as_slice(), states.len() > 1) else {
            return Err(too_few(states.len()));
        };
        let usable = segments::usable([first.t_ns, last.t_ns], usable_ns);
        if let Some(place) = states.windows(2).position(|pair| pair[0].t_ns >= pair[1].t_ns) {
            return Err(Unfit::not_rising(place + 2));
        }
        let usable_ns = usable.ok_or(Unfit::NotUsable)?;
        Ok(Self { states: states.into(), method, usable_ns, series: None })
    }

    /// Returns the segment of a series; its rows are the beginnings of the records, and the end.
    #[cfg(feature = "spice")]
    pub(crate) fn of_series(series: ChebyshevSeries, usable_ns: [Option<i64>; 2]) -> Result<Self, Unfit> {
        let state = |t_ns| {
            let [position_km, velocity_km_s] = series.at(t_ns);
            OrbitState { t_ns, position_km, velocity_km_s }
        };
        let states = series.ends_ns().map(state).collect();
        let segment = Self::new(states, OrbitInterpolation::Chebyshev, usable_ns)?;
        Ok(Self { series: Some(Arc::new(series)), ..segment })
    }

    /// Compares the velocities of the rows with the differences of their positions; `None` for a series.
    fn comparison(&self) -> Option<Comparison> {
        if self.series.is_some() {
            return None;
        }
        let step = |pair: &[OrbitState]| {
            let s = s_between(pair[0].t_ns, pair[1].t_ns);
            let stated = [pair[0].velocity_km_s, pair[1].velocity_km_s];
            let beside = (pair[1].position_km - pair[0].position_km) / s - (stated[0] + stated[1]) / 2.0;
            Step { s, stated, beside }
        };
        compare(&self.states.windows(2).map(step).collect::<Vec<_>>(), FLOOR)
    }

    /// Returns its rows, by rising time.
    pub fn states(&self) -> &[OrbitState] {
        &self.states
    }

    /// Returns how it is interpolated.
    pub fn method(&self) -> OrbitInterpolation {
        self.method
    }

    fn at(&self, t_ns: i64) -> OrbitState {
        let after = self.states.partition_point(|state| state.t_ns <= t_ns);
        let place = after.clamp(1, self.states.len() - 1) - 1;
        if let Some(series) = &self.series {
            let [position_km, velocity_km_s] = series.at(t_ns);
            return OrbitState { t_ns, position_km, velocity_km_s };
        }
        let (position_km, velocity_km_s) = match self.method {
            OrbitInterpolation::Hermite { rows } => {
                let nodes = around(&self.states, place, rows);
                let zero_ns = nodes[0].t_ns;
                let newton = Newton::through_with_derivatives(nodes.iter().map(|state| {
                    let t_s = s_between(zero_ns, state.t_ns);
                    (t_s, state.position_km.to_array(), state.velocity_km_s.to_array())
                }));
                let [position, velocity, _] = newton.at(s_between(zero_ns, t_ns));
                (position, velocity)
            }
            OrbitInterpolation::Chebyshev => (self.states[place].position_km.to_array(), [0.0; 3]),
            OrbitInterpolation::Lagrange(degree) => {
                let nodes = around(&self.states, place, degree + 1);
                let zero_ns = nodes[0].t_ns;
                let of = |part: fn(&OrbitState) -> DVec3| {
                    let nodes = nodes.iter().map(|state| (s_between(zero_ns, state.t_ns), part(state).to_array()));
                    Newton::through(nodes).at(s_between(zero_ns, t_ns))[0]
                };
                (of(|state| state.position_km), of(|state| state.velocity_km_s))
            }
        };
        let [position_km, velocity_km_s] = [position_km, velocity_km_s].map(DVec3::from_array);
        OrbitState { t_ns, position_km, velocity_km_s }
    }

    fn left_out_error(&self) -> Option<[f64; 2]> {
        if self.series.is_some() {
            return Some([0.0; 2]);
        }
        let has_slopes = matches!(self.method, OrbitInterpolation::Hermite { .. });
        let by_velocities =
            self.comparison().map(|Comparison { errors: [km, km_s], .. }| [km * f64::from(has_slopes), km_s]);
        let by_velocities = by_velocities.filter(|[_, km_s]| *km_s > 0.0);
        let missed = |first: usize| {
            let kept: Vec<OrbitState> = self.states.iter().skip(first).step_by(2).copied().collect();
            let last_ns = kept.last().map_or(i64::MIN, |state| state.t_ns);
            let kept = Self { states: kept.into(), method: self.method, usable_ns: self.usable_ns, series: None };
            let inside = self.states.windows(2).skip(first).step_by(2);
            let errors = inside.filter(move |pair| pair[1].t_ns < last_ns).map(move |pair| {
                let got = kept.at(pair[1].t_ns);
                let position_km = (got.position_km - pair[1].position_km).length();
                let velocity_km_s = (got.velocity_km_s - pair[1].velocity_km_s).length();
                // In the middle between two rows the error of a cubic's velocity is zero; elsewhere a fifth of this.
                let slope_km_s = position_km / s_between(pair[0].t_ns, pair[1].t_ns);
                [position_km, velocity_km_s.max(slope_km_s)]
            });
            errors.reduce(larger)
        };
        [missed(0), missed(1), by_velocities].into_iter().flatten().reduce(larger)
    }
}

impl OrbitSegment {
    /// Returns why a row moves faster than anything about this centre.
    fn too_fast(&self, centre: Centre, number: usize) -> Option<String> {
        let is_too_fast = |state: &OrbitState| {
            // A comparison that is false for numbers that overflow.
            let is_possible = state.velocity_km_s.length() <= centre.fastest_km_s(state.position_km.length());
            !is_possible
        };
        let place = self.states.iter().position(is_too_fast)?;
        let state = self.states[place];
        let (distance_km, km_s) = (state.position_km.length(), state.velocity_km_s.length());
        Some(format!(
            "row {} of segment {number} is {distance_km:.6e} km from the centre of {} at {km_s:.6e} km/s; wanted at most {:.1} km/s \
             there: check the units, kilometres and kilometres per second",
            place + 1,
            centre.name(),
            centre.fastest_km_s(distance_km)
        ))
    }
}

fn larger(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

impl OrbitHistory {
    pub(crate) fn new(format: &str, centre: Centre, segments: Vec<OrbitSegment>) -> Result<Self, Unfit> {
        if segments.is_empty() {
            return Err(too_few(0));
        }
        segments::check_overlap(&segments, |segment| segment.usable_ns)?;
        let mut history = Self {
            format: format.into(),
            name: None,
            centre,
            notes: Vec::new(),
            warnings: Vec::new(),
            segments,
            contradiction: None,
        };
        history.compare_velocities();
        history.warnings.extend(findings::early_utc(history.span_ns()[0]));
        Ok(history)
    }

    /// Returns an orbit of these segments; an instant that several of them have is that of the last one in the file.
    #[cfg(feature = "spice")]
    pub(crate) fn layered(format: &str, centre: Centre, segments: &[OrbitSegment]) -> Result<Self, Unfit> {
        let intervals: Vec<segments::Interval> = segments.iter().map(|segment| segment.usable_ns).collect();
        let parts = segments::later_wins(&intervals).into_iter();
        let part =
            |(place, usable_ns): (usize, segments::Interval)| OrbitSegment { usable_ns, ..segments[place].clone() };
        Self::new(format, centre, parts.map(part).collect())
    }

    /// Notes velocities that nothing has, and those that contradict the positions.
    fn compare_velocities(&mut self) {
        let mut doubts = Vec::new();
        for (segment, number) in self.segments.iter().zip(1..) {
            self.contradiction = self.contradiction.take().or_else(|| segment.too_fast(self.centre, number));
            let Some((found, words)) =
                segment.comparison().and_then(|found| Some((found, found.words(number, NAMES)?)))
            else {
                continue;
            };
            if found.is_of_most() {
                let wanted = "wanted the velocities of these positions: check their units, their sign, and that their axes do \
                              not turn";
                self.contradiction.get_or_insert_with(|| format!("{words}; {wanted}"));
            }
            doubts.push(words);
        }
        self.warnings.extend(findings::first_of(doubts));
    }

    /// Returns why these states are none of anything that moves.
    pub(crate) fn contradiction(&self) -> Option<&str> {
        self.contradiction.as_deref()
    }

    /// Notes gaps between rows that are otherwise evenly spaced.
    pub(crate) fn find_gaps(&mut self) {
        let times_ns = self.segments.iter().map(|segment| segment.states.iter().map(|state| state.t_ns));
        self.warnings.extend(findings::gaps_of_segments(times_ns));
    }

    /// Returns an orbit of computed states; `None` where there are fewer than two, or their times do not rise.
    pub fn of_states(centre: Centre, states: Vec<OrbitState>) -> Option<Self> {
        let segment = OrbitSegment::new(states, OrbitInterpolation::CUBIC, [None; 2]).ok()?;
        Self::new("states", centre, vec![segment]).ok()
    }

    /// Returns its segments, by rising time.
    pub fn segments(&self) -> &[OrbitSegment] {
        &self.segments
    }

    /// Returns the number of rows at which it may be used.
    pub fn rows(&self) -> usize {
        let usable = |segment: &OrbitSegment| {
            let [from, until] = segment.usable_ns;
            segment.states.iter().filter(|state| (from..=until).contains(&state.t_ns)).count()
        };
        self.segments.iter().map(usable).sum()
    }

    /// Returns the first and the last usable instant, ns of TAI.
    pub fn span_ns(&self) -> [i64; 2] {
        [self.segments[0].usable_ns[0], self.segments[self.segments.len() - 1].usable_ns[1]]
    }

    /// Returns the state at an instant; `None` where the file has none. Does not allocate.
    pub fn at_ns(&self, t_ns: i64) -> Option<OrbitState> {
        segments::containing(&self.segments, t_ns, |segment| segment.usable_ns).map(|segment| segment.at(t_ns))
    }

    /// Returns the largest error of the interpolation, km and km/s, as the file itself shows it: every second row is
    /// left out and interpolated from the others, over steps twice as long. Between rows it is less: a sixteenth in
    /// position with cubics where the motion is smooth. Where velocities contradict the positions, it is what this makes of
    /// them, if that is more. Zero for the series of a kernel. `None` with fewer than three rows in each segment.
    pub fn interpolation_error(&self) -> Option<[f64; 2]> {
        self.segments.iter().filter_map(OrbitSegment::left_out_error).reduce(larger)
    }
}
