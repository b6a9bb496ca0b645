//! Positions and velocities over time as a file has them, about one body, in ICRF axes.
//!
//! Between rows: a Hermite polynomial through positions and velocities (cubic, from two rows, unless the file wants a
//! higher degree), or Lagrange polynomials. Error of the cubic: `x'''' h^4 / 384` in position. Outside of its segments
//! an orbit is not available.

use crate::attitude_methods::{around, s_between};
use crate::newton::Newton;
use crate::segments;
use core::fmt;
use glam::DVec3;

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
/// Centres as messages list them.
pub(crate) const WANTED_CENTRE: &str = "a centre of EARTH, MOON, SUN, SOLAR SYSTEM BARYCENTER";

impl Centre {
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        CENTRES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name.trim())).map(|(_, centre)| *centre)
    }

    /// Returns its name in CCSDS messages.
    #[must_use]
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
}

impl fmt::Display for OrbitInterpolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hermite { rows } => write!(f, "Hermite of degree {} (positions and velocities)", 2 * rows - 1),
            Self::Lagrange(degree) => write!(f, "Lagrange of degree {degree}"),
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
    states: Vec<OrbitState>,
    method: OrbitInterpolation,
    usable_ns: [i64; 2],
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
    segments: Vec<OrbitSegment>,
}

/// Why rows make no orbit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum UnfitOrbit {
    #[error("a segment has {rows} rows; wanted two at least")]
    TooFew { rows: usize },
    #[error("row {row} is not after the one before it; wanted rising times: sort the rows, remove repeated ones")]
    NotRising { row: usize },
    #[error("segment {segment} begins before the one before it ends; wanted usable times that do not overlap")]
    Overlap { segment: usize },
    #[error("the usable interval has no row of the segment; wanted one that lies within its rows")]
    NotUsable,
}

impl OrbitSegment {
    pub(crate) fn new(
        states: Vec<OrbitState>,
        method: OrbitInterpolation,
        usable_ns: [Option<i64>; 2],
    ) -> Result<Self, UnfitOrbit> {
        let ([first, .., last], true) = (states.as_slice(), states.len() > 1) else {
            return Err(UnfitOrbit::TooFew { rows: states.len() });
        };
        let usable = segments::usable([first.t_ns, last.t_ns], usable_ns);
        if let Some(place) = states.windows(2).position(|pair| pair[0].t_ns >= pair[1].t_ns) {
            return Err(UnfitOrbit::NotRising { row: place + 2 });
        }
        let usable_ns = usable.ok_or(UnfitOrbit::NotUsable)?;
        Ok(Self { states, method, usable_ns })
    }

    /// Returns its rows, by rising time.
    #[must_use]
    pub fn states(&self) -> &[OrbitState] {
        &self.states
    }

    /// Returns how it is interpolated.
    #[must_use]
    pub fn method(&self) -> OrbitInterpolation {
        self.method
    }

    fn at(&self, t_ns: i64) -> OrbitState {
        let after = self.states.partition_point(|state| state.t_ns <= t_ns);
        let place = after.clamp(1, self.states.len() - 1) - 1;
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
        let missed = |first: usize| {
            let kept: Vec<OrbitState> = self.states.iter().skip(first).step_by(2).copied().collect();
            let last_ns = kept.last().map_or(i64::MIN, |state| state.t_ns);
            let kept = Self { states: kept, method: self.method, usable_ns: self.usable_ns };
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
        [missed(0), missed(1)].into_iter().flatten().reduce(larger)
    }
}

fn larger(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

impl OrbitHistory {
    pub(crate) fn new(format: &str, centre: Centre, segments: Vec<OrbitSegment>) -> Result<Self, UnfitOrbit> {
        if segments.is_empty() {
            return Err(UnfitOrbit::TooFew { rows: 0 });
        }
        if let Some(segment) = segments::overlapping(&segments, |segment| segment.usable_ns) {
            return Err(UnfitOrbit::Overlap { segment });
        }
        Ok(Self { format: format.into(), name: None, centre, notes: Vec::new(), segments })
    }

    /// Returns an orbit of computed states; `None` where there are fewer than two, or their times do not rise.
    #[must_use]
    pub fn of_states(centre: Centre, states: Vec<OrbitState>) -> Option<Self> {
        let segment = OrbitSegment::new(states, OrbitInterpolation::CUBIC, [None; 2]).ok()?;
        Self::new("states", centre, vec![segment]).ok()
    }

    /// Returns its segments, by rising time.
    #[must_use]
    pub fn segments(&self) -> &[OrbitSegment] {
        &self.segments
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.segments.iter().map(|segment| segment.states.len()).sum()
    }

    /// Returns the first and the last usable instant, ns of TAI.
    #[must_use]
    pub fn span_ns(&self) -> [i64; 2] {
        [self.segments[0].usable_ns[0], self.segments[self.segments.len() - 1].usable_ns[1]]
    }

    /// Returns the state at an instant; `None` where the file has none. Does not allocate.
    #[must_use]
    pub fn at_ns(&self, t_ns: i64) -> Option<OrbitState> {
        segments::containing(&self.segments, t_ns, |segment| segment.usable_ns).map(|segment| segment.at(t_ns))
    }

    /// Returns the largest error of the interpolation, km and km/s, as the file itself shows it: every second row is
    /// left out and interpolated from the others, over steps twice as long. Between rows it is less: a sixteenth in
    /// position with cubics where the motion is smooth. `None` with fewer than three rows in each segment.
    #[must_use]
    pub fn interpolation_error(&self) -> Option<[f64; 2]> {
        self.segments.iter().filter_map(OrbitSegment::left_out_error).reduce(larger)
    }
}
