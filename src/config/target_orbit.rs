//! `[[target]] orbit = ...`: targets on the sky, by where they fly about the Earth and how they shine.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::target::TargetKeys;
use base::time::Tai;
use base::units::DEG;
use sky::orbit::KeplerElements;
use sky::target::{Brightness, MOST_PHASE_POINTS, PhaseCurve, SUN_BP_RP};

/// Largest size of a file of elements, bytes: a whole catalog.
const LARGEST_FILE: usize = 64 << 20;
/// Reflectance of a target nobody knows: a usual mean of spacecraft and debris.
const USUAL_ALBEDO: f64 = 0.175;

/// Where a target flies, checked as far as its form goes.
#[derive(Debug, Clone, PartialEq)]
pub enum OrbitSettings {
    /// Two-line elements: the one pair of lines, or the object with the number.
    Tle {
        /// Lines.
        text: String,
        /// Catalog number.
        norad_id: Option<u64>,
    },
    /// An orbit mean-elements message in JSON.
    Omm {
        /// JSON.
        text: String,
        /// Catalog number.
        norad_id: Option<u64>,
    },
    /// Elements of a conic about the Earth's centre, ICRF axes.
    TwoBody {
        /// When they hold.
        epoch: Tai,
        /// They.
        elements: KeplerElements,
    },
    /// A state from the geocentre, ICRF axes.
    StateVector {
        /// When it holds.
        epoch: Tai,
        /// Position, km.
        position_km: [f64; 3],
        /// Velocity, km/s.
        velocity_km_s: [f64; 3],
    },
    /// A circle about the Earth's centre.
    Circular {
        /// Height above the equatorial radius, km.
        altitude_km: f64,
        /// Inclination to the equator, deg.
        inclination_deg: f64,
        /// Right ascension of the ascending node, deg.
        raan_deg: f64,
        /// Angle from the node along the orbit at the first exposure, deg.
        argument_of_latitude_deg: f64,
    },
}

/// Kinds of `orbit`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Tle,
    Omm,
    TwoBody,
    StateVector,
    Circular,
}

const KINDS: [(&str, Kind); 5] = [
    ("tle", Kind::Tle),
    ("omm", Kind::Omm),
    ("two_body", Kind::TwoBody),
    ("state_vector", Kind::StateVector),
    ("circular", Kind::Circular),
];

/// Keys of orbits, with the kinds they belong to.
const ORBIT_KEYS: [(&str, &[Kind]); 16] = [
    ("line1", &[Kind::Tle]),
    ("line2", &[Kind::Tle]),
    ("file", &[Kind::Tle, Kind::Omm]),
    ("norad_id", &[Kind::Tle, Kind::Omm]),
    ("epoch_utc", &[Kind::TwoBody, Kind::StateVector]),
    ("semi_major_axis_km", &[Kind::TwoBody]),
    ("eccentricity", &[Kind::TwoBody]),
    ("argument_of_perigee_deg", &[Kind::TwoBody]),
    ("mean_anomaly_deg", &[Kind::TwoBody]),
    ("position_km", &[Kind::StateVector]),
    ("velocity_km_s", &[Kind::StateVector]),
    ("altitude_km", &[Kind::Circular]),
    ("argument_of_latitude_deg", &[Kind::Circular]),
    ("inclination_deg", &[Kind::TwoBody, Kind::Circular]),
    ("raan_deg", &[Kind::TwoBody, Kind::Circular]),
    ("orbit", &[Kind::Tle, Kind::Omm, Kind::TwoBody, Kind::StateVector, Kind::Circular]),
];
/// Keys of targets by script.
const SCRIPT_KEYS: [&str; 6] = ["position_px", "velocity_px_s", "acceleration_px_s2", "turn_deg_s", "electrons", "snr"];
/// Keys of light that only targets on the sky have.
const LIGHT_KEYS: [&str; 5] = ["diameter_m", "albedo", "specular", "mag_1000km", "phase_mag_1000km"];

/// A target's keys with the name of its table.
struct Keys<'a, 'd> {
    keys: &'a TargetKeys,
    place: usize,
    check: &'a mut Checker<'d>,
}

impl OrbitSettings {
    /// The orbit of target `place`.
    pub(super) fn check(keys: &TargetKeys, place: usize, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let advice = "tle takes line1 and line2, or file; omm takes file; two_body elements; state_vector position_km and \
                      velocity_km_s; circular altitude_km";
        let kind = check.choice(&format!("target[{place}].orbit"), keys.orbit.as_deref(), &KINDS, advice)?;
        let mut keys = Keys { keys, place, check };
        keys.refuse_strangers(kind)?;
        match kind {
            Kind::Tle => keys.tle(),
            Kind::Omm => keys.omm(),
            Kind::TwoBody => keys.two_body(),
            Kind::StateVector => keys.state_vector(),
            Kind::Circular => keys.circular(),
        }
    }

    /// Refuses what only orbits have, of a target by script.
    pub(super) fn check_none(keys: &TargetKeys, place: usize, check: &Checker<'_>) -> Result<(), ConfigError> {
        for key in ORBIT_KEYS.iter().map(|(key, _)| *key).chain(LIGHT_KEYS) {
            check.unused(&format!("target[{place}].{key}"), keys.is_given(key), "a target with orbit")?;
        }
        Ok(())
    }
}

/// What makes target `place` bright, and its colour.
pub(super) fn check_brightness(
    keys: &TargetKeys,
    place: usize,
    check: &mut Checker<'_>,
) -> Result<(Brightness, f64), ConfigError> {
    let key = |name: &str| format!("target[{place}].{name}");
    if keys.diameter_m.is_none() {
        for name in ["albedo", "specular"] {
            check.unused(&key(name), keys.is_given(name), "diameter_m")?;
        }
    }
    let bp_rp =
        check.number(&key("bp_rp"), keys.bp_rp, SUN_BP_RP, Rule::Within(-0.5, 5.0), "BP-RP: sunlight's is 0.82")?;
    let mag = Rule::Within(-30.0, 40.0);
    let brightness = match (keys.diameter_m, keys.mag_1000km, &keys.phase_mag_1000km, keys.mag) {
        (Some(diameter_m), None, None, None) => {
            let advice = "metres across";
            let diameter_m = check.meets(&key("diameter_m"), diameter_m, Rule::PositiveUpTo(1e7), advice)?;
            let share = Rule::Within(0.0, 1.0);
            let diffuse = check.number(&key("albedo"), keys.albedo, USUAL_ALBEDO, share, "share of light scattered")?;
            let specular = check.number(&key("specular"), keys.specular, 0.0, share, "share of light mirrored")?;
            if diffuse + specular <= 0.0 || diffuse + specular > 1.0 {
                let wanted = "together with specular more than 0, up to 1";
                return Err(check.invalid(
                    &key("albedo"),
                    diffuse,
                    wanted,
                    "what is neither scattered nor mirrored is lost",
                ));
            }
            Brightness::Sphere { diameter_m, diffuse, specular }
        }
        (None, Some(told), None, None) => {
            let advice = "Gaia G at 1000 km and phase 90 deg";
            Brightness::AtThousandKm(check.meets(&key("mag_1000km"), told, mag, advice)?)
        }
        (None, None, Some(points), None) => Brightness::Table(phase_curve(&key("phase_mag_1000km"), points, check)?),
        (None, None, None, Some(told)) => {
            Brightness::Constant(check.meets(&key("mag"), told, mag, "Gaia G wherever it is lit")?)
        }
        (diameter, at, table, constant) => {
            let given = [diameter, at, constant].iter().flatten().count() + usize::from(table.is_some());
            let wanted = "one of diameter_m, mag_1000km, phase_mag_1000km and mag";
            return Err(check.invalid(&key("mag"), format!("{given} of them"), wanted, "such as diameter_m = 1.0"));
        }
    };
    Ok((brightness, bp_rp))
}

fn phase_curve(key: &str, points: &[[f64; 2]], check: &Checker<'_>) -> Result<PhaseCurve, ConfigError> {
    let advice = "pairs of phase angle, deg, and Gaia G at 1000 km, such as [[0, 3.0], [90, 4.2], [150, 6.0]]";
    let is_sound = |[phase, mag]: &[f64; 2]| (0.0..=180.0).contains(phase) && (-30.0..=40.0).contains(mag);
    let ascends = points.windows(2).all(|pair| pair[0][0] < pair[1][0]);
    if points.is_empty() || points.len() > MOST_PHASE_POINTS || !ascends || !points.iter().all(is_sound) {
        let wanted = format!("1 to {MOST_PHASE_POINTS} pairs, phases ascending from 0 to 180, magnitudes -30 to 40");
        return Err(check.invalid(key, format!("{points:?}"), wanted, advice));
    }
    Ok(PhaseCurve { points: points.iter().map(|[phase, mag]| [phase * DEG, *mag]).collect() })
}

impl Keys<'_, '_> {
    fn key(&self, name: &str) -> String {
        format!("target[{}].{name}", self.place)
    }

    fn refuse_strangers(&self, kind: Kind) -> Result<(), ConfigError> {
        for (name, kinds) in ORBIT_KEYS {
            let is_strange = self.keys.is_given(name) && !kinds.contains(&kind);
            let words: Vec<_> = KINDS.iter().filter(|(_, kind)| kinds.contains(kind)).map(|(word, _)| *word).collect();
            self.check.unused(&self.key(name), is_strange, &format!("orbit = \"{}\"", words.join("\" or \"")))?;
        }
        for name in SCRIPT_KEYS {
            self.check.unused(&self.key(name), self.keys.is_given(name), "a target without orbit")?;
        }
        Ok(())
    }

    fn number(
        &mut self,
        name: &str,
        given: Option<f64>,
        default: f64,
        rule: Rule,
        advice: &str,
    ) -> Result<f64, ConfigError> {
        let key = self.key(name);
        self.check.number(&key, given, default, rule, advice)
    }

    fn norad_id(&self) -> Result<Option<u64>, ConfigError> {
        let Some(number) = self.keys.norad_id else { return Ok(None) };
        let advice = "the catalog number of one object of the file";
        let wanted = "a whole number, 1 to 999999999";
        let found = u64::try_from(number).ok().filter(|id| (1..=999_999_999).contains(id));
        found.map(Some).ok_or_else(|| self.check.invalid(&self.key("norad_id"), number, wanted, advice))
    }

    /// Text of the file of elements.
    fn file(&self, path: &str) -> Result<String, ConfigError> {
        let key = self.key("file");
        let bytes = self.check.document.bytes_of(&key, path)?;
        if bytes.len() > LARGEST_FILE {
            let wanted = format!("at most {LARGEST_FILE} bytes");
            return Err(self.check.invalid(
                &key,
                format!("{} bytes", bytes.len()),
                wanted,
                "name a file of fewer objects",
            ));
        }
        String::from_utf8(bytes).map_err(|error| self.check.invalid(&key, error, "text", "two-line elements, or JSON"))
    }

    fn tle(&mut self) -> Result<OrbitSettings, ConfigError> {
        let TargetKeys { line1, line2, file, norad_id, .. } = self.keys;
        let text = match (line1, line2, file) {
            (Some(line1), Some(line2), None) => {
                self.check.unused(&self.key("norad_id"), norad_id.is_some(), "a file")?;
                format!("{line1}\n{line2}")
            }
            (None, None, Some(path)) => self.file(path)?,
            _ => {
                let advice = "copy both lines of the element set unchanged, or name a file of them";
                return Err(self.check.invalid(&self.key("line1"), "missing", "line1 and line2, or file", advice));
            }
        };
        Ok(OrbitSettings::Tle { text, norad_id: self.norad_id()? })
    }

    fn omm(&mut self) -> Result<OrbitSettings, ConfigError> {
        let Some(path) = &self.keys.file else {
            let advice = "orbit mean-elements messages, an object or a list of them";
            return Err(self.check.invalid(&self.key("file"), "missing", "a file in JSON", advice));
        };
        Ok(OrbitSettings::Omm { text: self.file(path)?, norad_id: self.norad_id()? })
    }

    fn epoch(&self) -> Result<Tai, ConfigError> {
        let key = self.key("epoch_utc");
        let wanted = "an instant such as \"2026-03-01T12:00:00Z\"";
        let Some(text) = &self.keys.epoch_utc else {
            return Err(self.check.invalid(&key, "missing", wanted, "when the target is in this state"));
        };
        Tai::from_rfc3339(text)
            .map_err(|error| self.check.invalid(&key, format!("\"{text}\""), wanted, &error.to_string()))
    }

    fn two_body(&mut self) -> Result<OrbitSettings, ConfigError> {
        let (keys, epoch) = (self.keys, self.epoch()?);
        let advice = "kilometres from the centre: 6878 for a low orbit; negative for a hyperbola";
        let key = self.key("semi_major_axis_km");
        let semi_major_axis_km = self.check.required(&key, keys.semi_major_axis_km, Rule::Within(-1e7, 1e7), advice)?;
        let eccentricity = Rule::Within(0.0, 100.0);
        let turn = Rule::Within(-360.0, 360.0);
        let elements = KeplerElements {
            semi_major_axis_km,
            eccentricity: self.number("eccentricity", keys.eccentricity, 0.0, eccentricity, "0 for a circle")?,
            inclination_rad: self.inclination_deg(0.0)? * DEG,
            raan_rad: self.number("raan_deg", keys.raan_deg, 0.0, turn, "degrees")? * DEG,
            argument_of_periapsis_rad: self.number(
                "argument_of_perigee_deg",
                keys.argument_of_perigee_deg,
                0.0,
                turn,
                "degrees from the ascending node",
            )? * DEG,
            mean_anomaly_rad: self.number("mean_anomaly_deg", keys.mean_anomaly_deg, 0.0, turn, "degrees")? * DEG,
        };
        Ok(OrbitSettings::TwoBody { epoch, elements })
    }

    fn inclination_deg(&mut self, default: f64) -> Result<f64, ConfigError> {
        let advice = "degrees to the equator; above 90 is retrograde";
        self.number("inclination_deg", self.keys.inclination_deg, default, Rule::Within(0.0, 180.0), advice)
    }

    fn state_vector(&mut self) -> Result<OrbitSettings, ConfigError> {
        let epoch = self.epoch()?;
        let triple = |name: &str, given: Option<[f64; 3]>, most: f64| {
            let wanted = format!("three numbers, each within {most} of 0");
            let advice = "from the geocentre in ICRF axes, km and km/s";
            match given {
                Some(numbers) if numbers.iter().all(|number| number.abs() <= most) => Ok(numbers),
                Some(numbers) => Err(self.check.invalid(&self.key(name), format!("{numbers:?}"), wanted, advice)),
                None => Err(self.check.invalid(&self.key(name), "missing", wanted, advice)),
            }
        };
        let position_km = triple("position_km", self.keys.position_km, 1e7)?;
        let velocity_km_s = triple("velocity_km_s", self.keys.velocity_km_s, 100.0)?;
        Ok(OrbitSettings::StateVector { epoch, position_km, velocity_km_s })
    }

    fn circular(&mut self) -> Result<OrbitSettings, ConfigError> {
        let keys = self.keys;
        let turn = Rule::Within(-360.0, 360.0);
        let advice = "kilometres above the equatorial radius: 550 is a usual low orbit, 35786 is geostationary";
        let altitude =
            self.check.required(&self.key("altitude_km"), keys.altitude_km, Rule::Within(100.0, 4e5), advice)?;
        Ok(OrbitSettings::Circular {
            altitude_km: altitude,
            inclination_deg: self.inclination_deg(97.6)?,
            raan_deg: self.number("raan_deg", keys.raan_deg, 0.0, turn, "degrees")?,
            argument_of_latitude_deg: self.number(
                "argument_of_latitude_deg",
                keys.argument_of_latitude_deg,
                0.0,
                turn,
                "degrees from the ascending node, at the first exposure",
            )?,
        })
    }
}
