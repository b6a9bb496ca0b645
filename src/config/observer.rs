//! `[observer]`: where the sensor is, for parallax and aberration.

use crate::config::check::{Checker, Rule};
use crate::config::error::ConfigError;
use serde::Deserialize;

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
        /// Angle from the node along the orbit at the start of the run, deg.
        argument_of_latitude_deg: f64,
    },
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
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Geocentre,
    Tle,
    CircularOrbit,
}

impl Observer {
    pub(super) fn check(keys: &ObserverKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let kinds = [("geocentre", Kind::Geocentre), ("tle", Kind::Tle), ("circular_orbit", Kind::CircularOrbit)];
        let advice = "tle takes line1 and line2; circular_orbit takes altitude_km, inclination_deg, raan_deg, \
                      argument_of_latitude_deg";
        let kind = check.choice("observer.kind", keys.kind.as_deref(), &kinds, advice)?;
        keys.refuse_strangers(kind, check)?;
        match kind {
            Kind::Geocentre => Ok(Self::Geocentre),
            Kind::Tle => tle(keys, check),
            Kind::CircularOrbit => circular_orbit(keys, check),
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
            ("observer.inclination_deg", self.inclination_deg),
            ("observer.raan_deg", self.raan_deg),
            ("observer.argument_of_latitude_deg", self.argument_of_latitude_deg),
        ] {
            check.unused(key, given.is_some() && kind != Kind::CircularOrbit, "kind = \"circular_orbit\"")?;
        }
        Ok(())
    }
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
