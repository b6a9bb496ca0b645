//! `[[target]] orbit = ...`: targets on the sky, by where they fly about the Earth and how they shine.

use crate::key::{Given, Section, taken};
use crate::observer::{OrbitSettings, OrbitStart};
use crate::{check::Checker, error::Result, key_type::Raw, target::TargetKeys};
use base::{time::Tai, units::DEG};
use histories::read::packed;
use sky::orbit::{CentralBody, KeplerElements};
use sky::target::{Brightness, MOST_PHASE_POINTS, PhaseCurve, SUN_BP_RP};

/// Largest size of a file of elements, bytes: a whole catalog.
const LARGEST_FILE: usize = 64 << 20;
/// Reflectance assumed for a target: a usual mean of spacecraft and debris.
pub(super) const USUAL_ALBEDO: f64 = 0.175;

/// Kinds of `orbit`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Tle,
    Omm,
    TwoBody,
    StateVector,
    Circular,
}

/// Every kind by its word.
pub(super) const KINDS: [(&str, Kind); 5] = [
    ("tle", Kind::Tle),
    ("omm", Kind::Omm),
    ("two_body", Kind::TwoBody),
    ("state_vector", Kind::StateVector),
    ("circular", Kind::Circular),
];

/// Keys of orbits, with the kinds they belong to.
const ORBIT_KEYS: [(&str, &[Kind]); 17] = [
    ("line1", &[Kind::Tle]),
    ("line2", &[Kind::Tle]),
    ("file", &[Kind::Tle, Kind::Omm]),
    ("norad_id", &[Kind::Tle, Kind::Omm]),
    ("max_age_days", &[Kind::Tle, Kind::Omm]),
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

impl OrbitSettings {
    /// Returns the orbit of a target.
    pub(super) fn check(keys: &TargetKeys, check: &mut Checker<'_>) -> Result<Self> {
        let kind = keys.orbit().check(check)?;
        for (name, kinds) in ORBIT_KEYS.iter().filter(|(_, kinds)| !kinds.contains(&kind)) {
            let words: Vec<_> = KINDS.iter().filter(|(_, kind)| kinds.contains(kind)).map(|(word, _)| *word).collect();
            keys.refuse(&[name], &format!("orbit = \"{}\"", words.join("\" or \"")), check)?;
        }
        keys.refuse(&SCRIPT_KEYS, "a target without orbit", check)?;
        match kind {
            Kind::Tle => keys.tle(check),
            Kind::Omm => keys.omm(check),
            Kind::TwoBody => keys.two_body(check),
            Kind::StateVector => keys.state_vector(check),
            Kind::Circular => keys.circular(check),
        }
    }

    /// Refuses what only orbits have, of a target by script.
    pub(super) fn check_none(keys: &TargetKeys, check: &Checker<'_>) -> Result<()> {
        keys.refuse(&ORBIT_KEYS.map(|(key, _)| key), "a target with orbit", check)?;
        keys.refuse(&LIGHT_KEYS, "a target with orbit", check)
    }
}

/// Returns the brightness of a target and its colour.
pub(super) fn check_brightness(keys: &TargetKeys, check: &mut Checker<'_>) -> Result<(Brightness, f64)> {
    if !keys.diameter_m().is_given() {
        keys.refuse(&["albedo", "specular"], "diameter_m", check)?;
    }
    let bp_rp = keys.bp_rp().or(SUN_BP_RP).advised("BP-RP: sunlight's is 0.82").check(check)?;
    let curve = keys.phase_mag_1000km();
    let given = [keys.diameter_m().is_given(), keys.mag_1000km().is_given(), curve.is_given(), keys.mag().is_given()];
    let given = given.into_iter().filter(|given| *given).count();
    if given != 1 {
        let wanted = "one of diameter_m, mag_1000km, phase_mag_1000km and mag";
        let mag = keys.mag().advised("such as diameter_m = 1.0");
        return Err(mag.invalid(format!("{given} of them"), wanted, check));
    }
    let brightness = if let Some(diameter_m) = keys.diameter_m().optional(check)? {
        taken!(check, keys => albedo, specular);
        if albedo + specular <= 0.0 || albedo + specular > 1.0 {
            let given = keys.albedo().advised("what is neither scattered nor mirrored is lost");
            return Err(given.invalid(albedo, "together with specular more than 0, up to 1", check));
        }
        Brightness::Sphere { diameter_m, diffuse: albedo, specular }
    } else if let Some(mag) = keys.mag_1000km().optional(check)? {
        Brightness::AtThousandKm(mag)
    } else if let Some(points) = curve.raw() {
        Brightness::Table(phase_curve(&curve, points, check)?)
    } else {
        Brightness::Constant(keys.mag().advised("Gaia G wherever it is lit").check(check)?)
    };
    Ok((brightness, bp_rp))
}

fn phase_curve(given: &Given<'_, Raw<Vec<[f64; 2]>>>, points: &[[f64; 2]], check: &Checker<'_>) -> Result<PhaseCurve> {
    let is_sound = |[phase, mag]: &[f64; 2]| (0.0..=180.0).contains(phase) && (-30.0..=40.0).contains(mag);
    let ascends = points.windows(2).all(|pair| pair[0][0] < pair[1][0]);
    if points.is_empty() || points.len() > MOST_PHASE_POINTS || !ascends || !points.iter().all(is_sound) {
        let wanted = format!("1 to {MOST_PHASE_POINTS} pairs, phases ascending from 0 to 180, magnitudes -30 to 40");
        return Err(given.invalid(format!("{points:?}"), wanted, check));
    }
    Ok(PhaseCurve { points: points.iter().map(|[phase, mag]| [phase * DEG, *mag]).collect() })
}

/// Returns the text of a file of elements.
fn text_of(file: &Given<'_, String>, path: &str, check: &Checker<'_>) -> Result<String> {
    let bytes = check.document.bytes_of(&file.key(), path)?;
    if bytes.len() > LARGEST_FILE {
        let (got, wanted) = (format!("{} bytes", bytes.len()), format!("at most {LARGEST_FILE} bytes"));
        return Err(check.invalid(&file.key(), got, wanted, "name a file of fewer objects"));
    }
    let advice = "two-line elements, or an OMM";
    if let Some(why) = packed(&bytes) {
        return Err(check.invalid(&file.key(), format!("{path}: {why}"), "text", advice));
    }
    let is_no_text = |_bytes| check.invalid(&file.key(), format!("{path}, which is not UTF-8"), "text", advice);
    String::from_utf8(bytes).map_err(is_no_text)
}

impl TargetKeys {
    fn tle(&self, check: &mut Checker<'_>) -> Result<OrbitSettings> {
        let text = match (self.line1().raw(), self.line2().raw(), self.file().raw()) {
            (Some(line1), Some(line2), None) => {
                self.refuse(&["norad_id"], "a file", check)?;
                format!("{line1}\n{line2}")
            }
            (None, None, Some(path)) => text_of(&self.file(), path, check)?,
            _ => return Err(self.line1().missing("line1 and line2, or file", check)),
        };
        self.mean(text, check)
    }

    fn omm(&self, check: &mut Checker<'_>) -> Result<OrbitSettings> {
        let path = self.file().raw().ok_or_else(|| self.file().missing("a file in JSON, KVN, XML or CSV", check))?;
        let text = text_of(&self.file(), path, check)?;
        self.mean(text, check)
    }

    fn mean(&self, text: String, check: &mut Checker<'_>) -> Result<OrbitSettings> {
        let norad_id = self.norad_id().optional(check)?;
        Ok(OrbitSettings::Mean { text, norad_id, max_age_days: self.max_age_days().check(check)? })
    }

    fn epoch(&self, check: &Checker<'_>) -> Result<Tai> {
        let wanted = "an instant such as \"2026-03-01T12:00:00Z\"";
        let given = self.epoch_utc();
        let text = given.raw().ok_or_else(|| given.missing(wanted, check))?;
        Tai::from_rfc3339(text)
            .map_err(|error| check.invalid(&given.key(), format!("\"{text}\""), wanted, &error.to_string()))
    }

    fn two_body(&self, check: &mut Checker<'_>) -> Result<OrbitSettings> {
        let epoch = self.epoch(check)?;
        taken!(check, self => semi_major_axis_km, eccentricity);
        let inclination_rad = self.inclination_deg().or(0.0).check(check)? * DEG;
        taken!(check, self => raan_deg, argument_of_perigee_deg, mean_anomaly_deg);
        let elements = KeplerElements {
            semi_major_axis_km,
            eccentricity,
            inclination_rad,
            raan_rad: raan_deg * DEG,
            argument_of_periapsis_rad: argument_of_perigee_deg * DEG,
            mean_anomaly_rad: mean_anomaly_deg * DEG,
        };
        let start = OrbitStart::Elements(elements);
        Ok(OrbitSettings::TwoBody { about: CentralBody::Earth, epoch: Some(epoch), start })
    }

    fn state_vector(&self, check: &Checker<'_>) -> Result<OrbitSettings> {
        let epoch = self.epoch(check)?;
        let triple = |given: Given<'_, [f64; 3]>, most: f64| {
            let wanted = format!("three numbers, each within {most} of 0");
            match given.raw() {
                Some(numbers) if numbers.iter().all(|number| number.abs() <= most) => Ok(*numbers),
                Some(numbers) => Err(given.invalid(format!("{numbers:?}"), wanted, check)),
                None => Err(given.missing(wanted, check)),
            }
        };
        let position_km = triple(self.position_km(), 1e7)?;
        let start = OrbitStart::State { position_km, velocity_km_s: triple(self.velocity_km_s(), 100.0)? };
        Ok(OrbitSettings::TwoBody { about: CentralBody::Earth, epoch: Some(epoch), start })
    }

    fn circular(&self, check: &mut Checker<'_>) -> Result<OrbitSettings> {
        let altitude_km = self.altitude_km().check(check)?;
        let inclination_deg = self.inclination_deg().or(97.6).check(check)?;
        taken!(check, self => raan_deg, argument_of_latitude_deg);
        Ok(OrbitSettings::Circular { altitude_km, inclination_deg, raan_deg, argument_of_latitude_deg })
    }
}
