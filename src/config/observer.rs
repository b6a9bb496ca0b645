//! `[observer]`: where the sensor is, for parallax and aberration.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::time::Tai;
use base::units::DEG;
use serde::Deserialize;
use sky::orbit::{CentralBody, KeplerElements};

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
    },
    /// A circular orbit about the Earth.
    CircularOrbit {
        /// Height above the equatorial radius, km.
        altitude_km: f64,
        /// Inclination to the equator, deg.
        inclination_deg: f64,
        /// Right ascension of the ascending node, deg.
        raan_deg: f64,
        /// Angle from the node along the orbit at the first exposure, deg: one second after `timing.start_utc`.
        argument_of_latitude_deg: f64,
    },
    /// A conic about the Earth, the Moon or the Sun.
    TwoBody {
        /// What it is about.
        about: CentralBody,
        /// The instant of the state or elements; `None`: the start of the run.
        epoch: Option<Tai>,
        /// Where it is then.
        start: OrbitStart,
    },
}

/// What fixes a conic at its epoch, in ICRF axes.
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

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObserverKeys {
    kind: Option<String>,
    line1: Option<String>,
    line2: Option<String>,
    altitude_km: Option<f64>,
    inclination_deg: Option<f64>,
    raan_deg: Option<f64>,
    argument_of_latitude_deg: Option<f64>,
    about: Option<String>,
    epoch: Option<String>,
    position_km: Option<[f64; 3]>,
    velocity_km_s: Option<[f64; 3]>,
    semi_major_axis_km: Option<f64>,
    eccentricity: Option<f64>,
    argument_of_periapsis_deg: Option<f64>,
    mean_anomaly_deg: Option<f64>,
    light_deflection: Option<bool>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Geocentre,
    Tle,
    CircularOrbit,
    TwoBody,
}

impl Observer {
    pub(super) fn check(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let kinds = [
            ("geocentre", Kind::Geocentre),
            ("tle", Kind::Tle),
            ("circular_orbit", Kind::CircularOrbit),
            ("two_body", Kind::TwoBody),
        ];
        let advice = "tle takes line1 and line2; circular_orbit takes altitude_km, inclination_deg, raan_deg, \
                      argument_of_latitude_deg; two_body takes about, epoch, and position_km and velocity_km_s or \
                      semi_major_axis_km and further elements";
        let kind = check.choice("observer.kind", keys.kind.as_deref(), &kinds, advice)?;
        keys.refuse_strangers(kind, check)?;
        match kind {
            Kind::Geocentre => Ok(Self::Geocentre),
            Kind::Tle => tle(keys, check),
            Kind::CircularOrbit => circular_orbit(keys, check),
            Kind::TwoBody => two_body(keys, check),
        }
    }
}

impl ObserverKeys {
    fn refuse_strangers(&self, kind: Kind, check: &Checker<'_>) -> Result<(), ConfigError> {
        for (key, is_given) in [("observer.line1", self.line1.is_some()), ("observer.line2", self.line2.is_some())] {
            check.unused(key, is_given && kind != Kind::Tle, "kind = \"tle\"")?;
        }
        for (key, given) in [
            ("observer.altitude_km", self.altitude_km),
            ("observer.argument_of_latitude_deg", self.argument_of_latitude_deg),
        ] {
            check.unused(key, given.is_some() && kind != Kind::CircularOrbit, "kind = \"circular_orbit\"")?;
        }
        for (key, given) in [("observer.inclination_deg", self.inclination_deg), ("observer.raan_deg", self.raan_deg)] {
            let has_plane = matches!(kind, Kind::CircularOrbit | Kind::TwoBody);
            check.unused(key, given.is_some() && !has_plane, "kind = \"circular_orbit\" or \"two_body\"")?;
        }
        let of_two_bodies = [
            ("observer.about", self.about.is_some()),
            ("observer.epoch", self.epoch.is_some()),
            ("observer.position_km", self.position_km.is_some()),
            ("observer.velocity_km_s", self.velocity_km_s.is_some()),
        ];
        let elements = self.own_elements().map(|(key, given)| (key, given.is_some()));
        for (key, is_given) in of_two_bodies.into_iter().chain(elements) {
            check.unused(key, is_given && kind != Kind::TwoBody, "kind = \"two_body\"")?;
        }
        Ok(())
    }

    /// Elements that no other kind has.
    fn own_elements(&self) -> [(&'static str, Option<f64>); 4] {
        [
            ("observer.semi_major_axis_km", self.semi_major_axis_km),
            ("observer.eccentricity", self.eccentricity),
            ("observer.argument_of_periapsis_deg", self.argument_of_periapsis_deg),
            ("observer.mean_anomaly_deg", self.mean_anomaly_deg),
        ]
    }

    /// Whether the Sun bends the stars' light.
    pub(super) fn light_deflection(&self, check: &mut Checker<'_>) -> bool {
        check.given_or("observer.light_deflection", self.light_deflection, true)
    }
}

fn two_body(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Observer, ConfigError> {
    let bodies = [("earth", CentralBody::Earth), ("moon", CentralBody::Moon), ("sun", CentralBody::Sun)];
    let about = check.choice("observer.about", keys.about.as_deref(), &bodies, "the body that the orbit is about")?;
    let epoch = epoch(keys.epoch.as_deref(), check)?;
    let start = if keys.position_km.is_some() || keys.velocity_km_s.is_some() {
        state(keys, check)?
    } else {
        OrbitStart::Elements(elements(keys, check)?)
    };
    Ok(Observer::TwoBody { about, epoch, start })
}

fn epoch(given: Option<&str>, check: &mut Checker<'_>) -> Result<Option<Tai>, ConfigError> {
    const START: &str = "start";
    let text = check.given_or("observer.epoch", given.map(str::to_owned), START.to_owned());
    if text == START {
        return Ok(None);
    }
    let advice = "the instant of the state or the elements, such as \"2026-03-01T12:00:00Z\"";
    let wanted = "an RFC 3339 time, or \"start\" for the first exposure";
    let refuse = |_| check.invalid("observer.epoch", format!("\"{text}\""), wanted, advice);
    Tai::from_rfc3339(&text).map(Some).map_err(refuse)
}

fn state(keys: &ObserverKeys, check: &Checker<'_>) -> Result<OrbitStart, ConfigError> {
    let others = [("observer.inclination_deg", keys.inclination_deg), ("observer.raan_deg", keys.raan_deg)];
    for (key, given) in keys.own_elements().into_iter().chain(others) {
        check.unused(key, given.is_some(), "an orbit by elements: leave out position_km and velocity_km_s, or this")?;
    }
    let vector = |key: &str, given: Option<[f64; 3]>| {
        let wanted = "three finite numbers: x, y, z in ICRF axes";
        let advice = "position_km and velocity_km_s go together, both from the centre of observer.about";
        let given = given.ok_or_else(|| check.invalid(key, "missing", wanted, advice))?;
        let is_finite = given.iter().all(|x| x.is_finite());
        if is_finite { Ok(given) } else { Err(check.invalid(key, format!("{given:?}"), wanted, advice)) }
    };
    let position_km = vector("observer.position_km", keys.position_km)?;
    let velocity_km_s = vector("observer.velocity_km_s", keys.velocity_km_s)?;
    Ok(OrbitStart::State { position_km, velocity_km_s })
}

fn elements(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<KeplerElements, ConfigError> {
    let axis_km = check.required(
        "observer.semi_major_axis_km",
        keys.semi_major_axis_km,
        Rule::Within(-1e11, 1e11),
        "kilometres, negative for a hyperbola; or give position_km and velocity_km_s",
    )?;
    let mut angle_rad = |key: &str, given, rule, advice| {
        check.number(&format!("observer.{key}"), given, 0.0, rule, advice).map(|degrees| degrees * DEG)
    };
    let turn = Rule::Within(-360.0, 360.0);
    let inclination_rad =
        angle_rad("inclination_deg", keys.inclination_deg, Rule::Within(0.0, 180.0), "degrees to ICRF's equator")?;
    let raan_rad = angle_rad("raan_deg", keys.raan_deg, turn, "degrees")?;
    let argument_of_periapsis_rad =
        angle_rad("argument_of_periapsis_deg", keys.argument_of_periapsis_deg, turn, "degrees from the node")?;
    let advice = "degrees at the epoch; on a hyperbola, mean motion times time from the nearest point";
    let mean_anomaly_rad = angle_rad("mean_anomaly_deg", keys.mean_anomaly_deg, Rule::Within(-1e6, 1e6), advice)?;
    let advice = "below 1 with a positive semi-major axis, above 1 with a negative one; a parabola is given by a state";
    let eccentricity = check.number("observer.eccentricity", keys.eccentricity, 0.0, Rule::Within(0.0, 1e6), advice)?;
    if axis_km * (1.0 - eccentricity) <= 0.0 {
        let wanted = if axis_km > 0.0 { "below 1 with this axis" } else { "above 1 with this axis" };
        return Err(check.invalid("observer.eccentricity", eccentricity, wanted, advice));
    }
    Ok(KeplerElements {
        semi_major_axis_km: axis_km,
        eccentricity,
        inclination_rad,
        raan_rad,
        argument_of_periapsis_rad,
        mean_anomaly_rad,
    })
}

fn circular_orbit(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Observer, ConfigError> {
    let mut number = |key: &str, given, default, rule, advice| {
        check.number(&format!("observer.{key}"), given, default, rule, advice)
    };
    let angle = Rule::Within(-360.0, 360.0);
    Ok(Observer::CircularOrbit {
        altitude_km: number(
            "altitude_km",
            keys.altitude_km,
            550.0,
            Rule::Within(100.0, 400_000.0),
            "kilometres above the equatorial radius: 550 is a usual low orbit, 35786 is geostationary",
        )?,
        inclination_deg: number(
            "inclination_deg",
            keys.inclination_deg,
            97.6,
            Rule::Within(0.0, 180.0),
            "degrees to the equator; above 90 is retrograde",
        )?,
        raan_deg: number("raan_deg", keys.raan_deg, 0.0, angle, "degrees")?,
        argument_of_latitude_deg: number(
            "argument_of_latitude_deg",
            keys.argument_of_latitude_deg,
            0.0,
            angle,
            "degrees from the ascending node",
        )?,
    })
}

fn tle(keys: &ObserverKeys, check: &Checker<'_>) -> Result<Observer, ConfigError> {
    let line = |key: &str, given: &Option<String>, number: char| {
        let wanted = format!("69 characters that begin with \"{number} \" and end with their checksum");
        let text = given.as_deref().unwrap_or("missing").trim_end();
        if is_tle_line(text, number) {
            Ok(text.to_owned())
        } else {
            let advice = "copy both lines of the element set unchanged";
            Err(check.invalid(key, format!("\"{text}\""), wanted, advice))
        }
    };
    let line1 = line("observer.line1", &keys.line1, '1')?;
    let line2 = line("observer.line2", &keys.line2, '2')?;
    if line1.get(2..7) != line2.get(2..7) {
        let advice = "both lines must be of one satellite (columns 3 to 7)";
        let got = format!("\"{line2}\"");
        return Err(check.invalid("observer.line2", got, "the catalogue number of line1", advice));
    }
    Ok(Observer::Tle { line1, line2 })
}

/// The form every element line has: length, line number, and the checksum modulo 10 (digits count themselves, `-` one).
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
