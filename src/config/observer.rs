//! `[observer]`: where the sensor is, for parallax and aberration.

use crate::key::{Given, Section, section, taken};
use crate::key_type::{Any, Raw, Shape, Whole, Word};
use crate::named_files::{Kernels, refused};
use crate::{check::Checker, error::Result, plant::text_of};
use base::{time::Tai, units::DEG};
use histories::{OrbitHistory, read};
use sky::observer::check_states;
use sky::orbit::{CentralBody, KeplerElements, TleOrbit, USUAL_MOST_DAYS, is_elements};
use std::sync::Arc;

/// Place and motion of the sensor, checked.
#[derive(Debug, Clone, PartialEq)]
pub enum Observer {
    /// The centre of the Earth.
    Geocentre,
    /// A satellite by its two-line elements (form and checksums are right).
    Tle {
        /// First line, 69 characters.
        line1: String,
        /// Second line, 69 characters.
        line2: String,
        /// Furthest from their epoch that they are used, days.
        max_age_days: f64,
    },
    /// In an orbit.
    Orbit(OrbitSettings),
    /// On the states of a file.
    Table(Arc<OrbitHistory>),
}

/// An orbit of the sensor or of a target, checked as far as its form goes.
#[derive(Debug, Clone, PartialEq)]
pub enum OrbitSettings {
    /// Mean elements: the one set, or the object with the number.
    Mean {
        /// Lines, or an orbit mean-elements message.
        text: String,
        /// Catalog number.
        norad_id: Option<u64>,
        /// Furthest from their epoch that they are used, days.
        max_age_days: f64,
    },
    /// A circle about the Earth's centre.
    Circular {
        /// Height above the equatorial radius, km.
        altitude_km: f64,
        /// Inclination to the equator, deg.
        inclination_deg: f64,
        /// Right ascension of the ascending node, deg.
        raan_deg: f64,
        /// Angle from the node along the orbit at the first exposure, deg: one second after `timing.start_utc`.
        argument_of_latitude_deg: f64,
    },
    /// A conic about the Earth, the Moon or the Sun, ICRF axes.
    TwoBody {
        /// The central body.
        about: CentralBody,
        /// The instant of the state or elements; `None`: the start of the run.
        epoch: Option<Tai>,
        /// Where it is then.
        start: OrbitStart,
    },
}

/// State or elements of a conic at its epoch, in ICRF axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OrbitStart {
    /// Position and velocity from the central body.
    State {
        /// Position, km.
        position_km: [f64; 3],
        /// Velocity, km/s.
        velocity_km_s: [f64; 3],
    },
    /// Elements, angles from ICRF's equator.
    Elements(KeplerElements),
}

section! {
    /// Where the sensor is, for parallax and aberration.
    ObserverKeys at "observer" {
        /// The centre of the Earth, or an orbit by element lines, as a circle, as a conic, or by a file.
        kind: Word<Kind> = "geocentre", [
            ("geocentre", Kind::Geocentre), ("tle", Kind::Tle), ("circular_orbit", Kind::CircularOrbit),
            ("two_body", Kind::TwoBody), ("file", Kind::File),
        ], "file takes file; tle takes line1 and line2; circular_orbit takes altitude_km, inclination_deg, raan_deg, \
            argument_of_latitude_deg; two_body takes about, epoch, and position_km and velocity_km_s or \
            semi_major_axis_km and further elements";
        /// File of states or elements, for kind = "file": CCSDS OEM (KVN, XML), STK .e, a table, two-line elements, OMM
        /// (JSON, KVN, XML, CSV).
        file: String = Optional, "path";
        /// Text kernels (LSK) of a SPICE SPK file, relative to this file.
        kernels: Raw<Vec<String>> = Optional, Shape::list(Shape::Text("path"));
        /// Number of the target in a SPICE SPK file, where it has several.
        naif_id: Whole<i32> = Optional, -2_000_000_000..=2_000_000_000;
        /// Catalog number of one object of a file of elements, where it has several.
        norad_id: Whole<u64> = Optional, 1..=999_999_999;
        /// Days from their epoch beyond which elements are refused; check warns from 7 days on.
        max_age_days: f64 = USUAL_MOST_DAYS, PositiveUpTo(36_525.0);
        /// First line of an element set; copy both lines of the element set unchanged.
        line1: String = Optional, "text of 69 characters";
        /// Second line of an element set; copy both lines of the element set unchanged.
        line2: String = Optional, "text of 69 characters";
        /// Kilometres above the equatorial radius: 550 is a usual low orbit, 35786 is geostationary.
        altitude_km: f64 = 550.0, Within(100.0, 400_000.0);
        /// Degrees to the equator (of a conic to ICRF's); above 90 is retrograde.
        inclination_deg: f64 = Computed("97.6 of a circular orbit, 0 of a conic"), Within(0.0, 180.0);
        /// Right ascension of the ascending node, degrees.
        raan_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Degrees from the ascending node at the first exposure, of a circular orbit.
        argument_of_latitude_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// The body that a conic is about.
        about: Word<CentralBody> = "earth",
            [("earth", CentralBody::Earth), ("moon", CentralBody::Moon), ("sun", CentralBody::Sun)];
        /// The instant of the state or the elements of a conic, such as "2026-03-01T12:00:00Z", or "start".
        epoch: String = "start", "time or \"start\"";
        /// Position from the centre of the body, kilometres in ICRF axes.
        position_km: [f64; 3] = Optional, Finite, STATE;
        /// Velocity from the centre of the body, kilometres per second in ICRF axes.
        velocity_km_s: [f64; 3] = Optional, Finite, STATE;
        /// Kilometres, negative for a hyperbola; or give position_km and velocity_km_s.
        semi_major_axis_km: f64 = Optional, Within(-1e11, 1e11);
        /// Below 1 with a positive semi-major axis, above 1 with a negative one; a parabola is given by a state.
        eccentricity: f64 = 0.0, Within(0.0, 1e6);
        /// Degrees from the node to the nearest point.
        argument_of_periapsis_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Degrees at the epoch; on a hyperbola, mean motion times time from the nearest point.
        mean_anomaly_deg: f64 = 0.0, Within(-1e6, 1e6);
        /// The Sun bends the stars' light.
        light_deflection: bool = true, Any;
    }
}

const STATE: &str = "position_km and velocity_km_s go together, both from the centre of observer.about";
/// Elements that no other kind has.
const OWN_ELEMENTS: [&str; 4] = ["semi_major_axis_km", "eccentricity", "argument_of_periapsis_deg", "mean_anomaly_deg"];

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Geocentre,
    Tle,
    CircularOrbit,
    TwoBody,
    File,
}

impl Observer {
    pub(super) fn check(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Self> {
        let kind = keys.kind().check(check)?;
        keys.refuse_strangers(kind, check)?;
        match kind {
            Kind::Geocentre => Ok(Self::Geocentre),
            Kind::Tle => tle(keys, check),
            Kind::CircularOrbit => circular_orbit(keys, check),
            Kind::TwoBody => two_body(keys, check),
            Kind::File => file(keys, check),
        }
    }
}

impl ObserverKeys {
    fn refuse_strangers(&self, kind: Kind, check: &Checker<'_>) -> Result<()> {
        if kind != Kind::File {
            self.refuse(&["file", "kernels", "naif_id", "norad_id"], "kind = \"file\"", check)?;
        }
        if !matches!(kind, Kind::File | Kind::Tle) {
            self.refuse(&["max_age_days"], "kind = \"file\" or \"tle\"", check)?;
        }
        if kind != Kind::Tle {
            self.refuse(&["line1", "line2"], "kind = \"tle\"", check)?;
        }
        if kind != Kind::CircularOrbit {
            self.refuse(&["altitude_km", "argument_of_latitude_deg"], "kind = \"circular_orbit\"", check)?;
        }
        if !matches!(kind, Kind::CircularOrbit | Kind::TwoBody) {
            let owner = "kind = \"circular_orbit\" or \"two_body\"";
            self.refuse(&["inclination_deg", "raan_deg"], owner, check)?;
        }
        if kind != Kind::TwoBody {
            self.refuse(&["about", "epoch", "position_km", "velocity_km_s"], "kind = \"two_body\"", check)?;
            self.refuse(&OWN_ELEMENTS, "kind = \"two_body\"", check)?;
        }
        Ok(())
    }
}

fn file(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Observer> {
    let given = keys.file();
    let kernels = Kernels { file: keys.file(), texts: keys.kernels(), naif_id: keys.naif_id() };
    if let Some(history) = kernels.orbit(check)? {
        return states(keys, history, check);
    }
    let (text, path) = text_of(&given, check)?;
    if is_elements(&text) {
        let (norad_id, max_age_days) = (keys.norad_id().optional(check)?, keys.max_age_days().check(check)?);
        let wanted = "two element lines, or an OMM, of one object";
        let read = TleOrbit::read(&text, norad_id, Tai::from_ns(0));
        read.map_err(|error| given.invalid(format!("{path}: {error}"), wanted, check))?;
        return Ok(Observer::Orbit(OrbitSettings::Mean { text, norad_id, max_age_days }));
    }
    let history = read::orbit(&path, &text).map_err(|error| refused(&given, &error, check))?;
    states(keys, history, check)
}

/// Returns an orbit by its states, after a check of each.
fn states(keys: &ObserverKeys, history: OrbitHistory, check: &Checker<'_>) -> Result<Observer> {
    keys.refuse(&["norad_id", "max_age_days"], "a file of elements", check)?;
    let wanted = "states of an orbit, in km and km/s from the centre that the file names";
    check_states(&history)
        .map_err(|(at, error)| keys.file().invalid(format!("a file with a state at {at}: {error}"), wanted, check))?;
    Ok(Observer::Table(Arc::new(history)))
}

fn two_body(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Observer> {
    let about = keys.about().check(check)?;
    let epoch = epoch(keys, check)?;
    let is_state = keys.position_km().is_given() || keys.velocity_km_s().is_given();
    let start = if is_state { state(keys, check)? } else { OrbitStart::Elements(elements(keys, check)?) };
    Ok(Observer::Orbit(OrbitSettings::TwoBody { about, epoch, start }))
}

fn epoch(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Option<Tai>> {
    let text = keys.epoch().check(check)?;
    if text == "start" {
        return Ok(None);
    }
    let wanted = "an RFC 3339 time, or \"start\" for the first exposure";
    Tai::from_rfc3339(&text).map(Some).map_err(|_| keys.epoch().invalid(format!("\"{text}\""), wanted, check))
}

fn state(keys: &ObserverKeys, check: &Checker<'_>) -> Result<OrbitStart> {
    let owner = "an orbit by elements: leave out position_km and velocity_km_s, or this";
    keys.refuse(&OWN_ELEMENTS, owner, check)?;
    keys.refuse(&["inclination_deg", "raan_deg"], owner, check)?;
    let vector = |vector: Given<'_, [f64; 3]>| {
        let wanted = "three finite numbers: x, y, z in ICRF axes";
        let given = *vector.raw().ok_or_else(|| vector.missing(wanted, check))?;
        let is_finite = given.iter().all(|x| x.is_finite());
        if is_finite { Ok(given) } else { Err(vector.invalid(format!("{given:?}"), wanted, check)) }
    };
    let position_km = vector(keys.position_km())?;
    Ok(OrbitStart::State { position_km, velocity_km_s: vector(keys.velocity_km_s())? })
}

fn elements(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<KeplerElements> {
    let semi_major_axis_km = keys.semi_major_axis_km().check(check)?;
    let inclination = keys.inclination_deg().or(0.0).advised("degrees to ICRF's equator");
    let inclination_rad = inclination.check(check)? * DEG;
    taken!(check, keys => raan_deg, argument_of_periapsis_deg, mean_anomaly_deg, eccentricity);
    if semi_major_axis_km * (1.0 - eccentricity) <= 0.0 {
        let is_ellipse = semi_major_axis_km > 0.0;
        let wanted = if is_ellipse { "below 1 with this axis" } else { "above 1 with this axis" };
        return Err(keys.eccentricity().invalid(eccentricity, wanted, check));
    }
    Ok(KeplerElements {
        semi_major_axis_km,
        eccentricity,
        inclination_rad,
        raan_rad: raan_deg * DEG,
        argument_of_periapsis_rad: argument_of_periapsis_deg * DEG,
        mean_anomaly_rad: mean_anomaly_deg * DEG,
    })
}

fn circular_orbit(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Observer> {
    let altitude_km = keys.altitude_km().check(check)?;
    let inclination_deg = keys.inclination_deg().or(97.6).check(check)?;
    taken!(check, keys => raan_deg, argument_of_latitude_deg);
    Ok(Observer::Orbit(OrbitSettings::Circular { altitude_km, inclination_deg, raan_deg, argument_of_latitude_deg }))
}

fn tle(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Observer> {
    let line = |given: Given<'_, String>, number: char| {
        let wanted = format!("69 characters that begin with \"{number} \" and end with their checksum");
        let text = given.raw().ok_or_else(|| given.missing(&wanted, check))?.trim_end();
        let is_line = is_tle_line(text, number);
        if is_line { Ok(text.to_owned()) } else { Err(given.invalid(format!("\"{text}\""), wanted, check)) }
    };
    let (line1, line2) = (line(keys.line1(), '1')?, line(keys.line2(), '2')?);
    if line1.get(2..7) != line2.get(2..7) {
        let given = keys.line2().advised("both lines must be of one satellite (columns 3 to 7)");
        return Err(given.invalid(format!("\"{line2}\""), "the catalogue number of line1", check));
    }
    Ok(Observer::Tle { line1, line2, max_age_days: keys.max_age_days().check(check)? })
}

/// Returns whether a text has the form of every element line: length, line number, and the checksum modulo 10 (digits
/// count themselves, `-` one).
fn is_tle_line(text: &str, number: char) -> bool {
    if text.len() != 69 || !text.is_ascii() || !text.starts_with(number) || !text[1..].starts_with(' ') {
        return false;
    }
    let value = |c: char| c.to_digit(10).unwrap_or(u32::from(c == '-'));
    let sum: u32 = text[..68].chars().map(value).sum();
    text.chars().next_back().and_then(|c| c.to_digit(10)) == Some(sum % 10)
}

#[cfg(test)]
#[path = "observer_tests.rs"]
mod tests;
