//! `[[target]]`: point sources that move over the detector by a script, or fly about the Earth, and what becomes of stars
//! behind them.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::target_orbit::{OrbitSettings, check_brightness};
use plan::exposure::{TargetCurve, TargetPath};
use serde::Deserialize;
use sky::target::Brightness;

/// Most targets of a bench.
const TARGETS_MAX: usize = 256;
/// Furthest a target may stand from the detector's corner, px.
const FAR_PX: f64 = 1e5;

/// How much light a target sends.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetLight {
    /// As a star of this Gaia G magnitude and colour.
    Mag {
        /// G.
        mag: f64,
        /// BP-RP.
        bp_rp: f64,
    },
    /// Electrons of one whole exposure.
    Electrons(f64),
    /// As much as a still star has whose sum over the best window has this signal-to-noise ratio.
    Snr(f64),
    /// Sunlight, by where it flies.
    Reflected {
        /// How bright it is.
        brightness: Brightness,
        /// BP-RP.
        bp_rp: f64,
    },
}

/// Where a target goes.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetCourse {
    /// Over the detector, by a script.
    Script(TargetPath),
    /// About the Earth.
    Orbit(OrbitSettings),
}

/// One target, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetSettings {
    /// First seen, s after the first exposure.
    pub start_s: f64,
    /// Seen for, s; infinite: to the end.
    pub for_s: f64,
    /// Its way.
    pub course: TargetCourse,
    /// Its light.
    pub light: TargetLight,
}

/// What is seen where stars and targets overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overlap {
    /// Photons add.
    #[default]
    Add,
    /// In every pixel the brighter of the two, without the other's light: no physics, but the masks of some
    /// simulations do so.
    Brighter,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TargetKeys {
    start_s: Option<f64>,
    for_s: Option<f64>,
    position_px: Option<[f64; 2]>,
    velocity_px_s: Option<[f64; 2]>,
    acceleration_px_s2: Option<[f64; 2]>,
    turn_deg_s: Option<f64>,
    pub(super) mag: Option<f64>,
    pub(super) bp_rp: Option<f64>,
    electrons: Option<f64>,
    snr: Option<f64>,
    pub(super) orbit: Option<String>,
    pub(super) line1: Option<String>,
    pub(super) line2: Option<String>,
    pub(super) file: Option<String>,
    pub(super) norad_id: Option<i64>,
    pub(super) epoch_utc: Option<String>,
    pub(super) semi_major_axis_km: Option<f64>,
    pub(super) eccentricity: Option<f64>,
    pub(super) inclination_deg: Option<f64>,
    pub(super) raan_deg: Option<f64>,
    pub(super) argument_of_perigee_deg: Option<f64>,
    pub(super) mean_anomaly_deg: Option<f64>,
    pub(super) position_km: Option<[f64; 3]>,
    pub(super) velocity_km_s: Option<[f64; 3]>,
    pub(super) altitude_km: Option<f64>,
    pub(super) argument_of_latitude_deg: Option<f64>,
    pub(super) diameter_m: Option<f64>,
    pub(super) albedo: Option<f64>,
    pub(super) specular: Option<f64>,
    pub(super) mag_1000km: Option<f64>,
    pub(super) phase_mag_1000km: Option<Vec<[f64; 2]>>,
}

impl TargetKeys {
    /// Whether a key that not every target has was given.
    pub(super) fn is_given(&self, key: &str) -> bool {
        match key {
            "position_px" => self.position_px.is_some(),
            "velocity_px_s" => self.velocity_px_s.is_some(),
            "acceleration_px_s2" => self.acceleration_px_s2.is_some(),
            "turn_deg_s" => self.turn_deg_s.is_some(),
            "electrons" => self.electrons.is_some(),
            "snr" => self.snr.is_some(),
            "orbit" => self.orbit.is_some(),
            "line1" => self.line1.is_some(),
            "line2" => self.line2.is_some(),
            "file" => self.file.is_some(),
            "norad_id" => self.norad_id.is_some(),
            "epoch_utc" => self.epoch_utc.is_some(),
            "semi_major_axis_km" => self.semi_major_axis_km.is_some(),
            "eccentricity" => self.eccentricity.is_some(),
            "inclination_deg" => self.inclination_deg.is_some(),
            "raan_deg" => self.raan_deg.is_some(),
            "argument_of_perigee_deg" => self.argument_of_perigee_deg.is_some(),
            "mean_anomaly_deg" => self.mean_anomaly_deg.is_some(),
            "position_km" => self.position_km.is_some(),
            "velocity_km_s" => self.velocity_km_s.is_some(),
            "altitude_km" => self.altitude_km.is_some(),
            "argument_of_latitude_deg" => self.argument_of_latitude_deg.is_some(),
            "diameter_m" => self.diameter_m.is_some(),
            "albedo" => self.albedo.is_some(),
            "specular" => self.specular.is_some(),
            "mag_1000km" => self.mag_1000km.is_some(),
            "phase_mag_1000km" => self.phase_mag_1000km.is_some(),
            _ => false,
        }
    }
}

/// Checks all targets of a bench.
pub(super) fn check_targets(keys: &[TargetKeys], check: &mut Checker<'_>) -> Result<Vec<TargetSettings>, ConfigError> {
    if keys.len() > TARGETS_MAX {
        let wanted = format!("at most {TARGETS_MAX}");
        return Err(check.invalid("target", keys.len(), wanted, "each is drawn node by node: leave some out"));
    }
    keys.iter().enumerate().map(|(place, keys)| TargetSettings::check(keys, place, check)).collect()
}

/// Checks `target_overlap`.
pub(super) fn check_overlap(given: Option<&str>, check: &mut Checker<'_>) -> Result<Overlap, ConfigError> {
    let words = [("add", Overlap::Add), ("brighter", Overlap::Brighter)];
    let advice = "add: photons of stars and targets add up; brighter: each pixel shows the brighter of the two only";
    check.choice("target_overlap", given, &words, advice)
}

impl TargetSettings {
    fn check(keys: &TargetKeys, place: usize, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let key = |name: &str| format!("target[{place}].{name}");
        let after = "seconds after the first exposure";
        let start_s = check.number(&key("start_s"), keys.start_s, 0.0, Rule::Within(0.0, 1e7), after)?;
        let for_s = match keys.for_s {
            None => f64::INFINITY,
            Some(for_s) => {
                check.meets(&key("for_s"), for_s, Rule::PositiveUpTo(1e7), "seconds; left out: to the end")?
            }
        };
        let (course, light) = if keys.orbit.is_some() {
            let course = TargetCourse::Orbit(OrbitSettings::check(keys, place, check)?);
            let (brightness, bp_rp) = check_brightness(keys, place, check)?;
            (course, TargetLight::Reflected { brightness, bp_rp })
        } else {
            OrbitSettings::check_none(keys, place, check)?;
            (TargetCourse::Script(Self::path(keys, place, check)?), Self::light(keys, place, check)?)
        };
        Ok(Self { start_s, for_s, course, light })
    }

    fn path(keys: &TargetKeys, place: usize, check: &Checker<'_>) -> Result<TargetPath, ConfigError> {
        let key = |name: &str| format!("target[{place}].{name}");
        let pair = |name: &str, given: [f64; 2], most: f64, advice: &str| {
            for number in given {
                check.meets(&key(name), number, Rule::Within(-most, most), advice)?;
            }
            Ok(given)
        };
        let where_first = "column and row where it is first seen, such as [100.0, 200.0]";
        let wanted = "two numbers, px";
        let missing = || check.invalid(&key("position_px"), "missing", wanted, where_first);
        let position_px = pair("position_px", keys.position_px.ok_or_else(missing)?, FAR_PX, where_first)?;
        let velocity = "pixels per second along columns and rows, such as [30.0, -10.0]";
        let velocity_px_s = pair("velocity_px_s", keys.velocity_px_s.unwrap_or_default(), 1e6, velocity)?;
        let curve = match (keys.acceleration_px_s2, keys.turn_deg_s) {
            (None, None) => TargetCurve::Straight,
            (Some(_), Some(_)) => {
                let wanted = "not given beside turn_deg_s";
                let advice = "a target either accelerates or flies an arc: give one of them";
                return Err(check.invalid(&key("acceleration_px_s2"), "given", wanted, advice));
            }
            (Some(acceleration), None) => {
                let advice = "pixels per second squared, such as [0.0, 5.0]";
                TargetCurve::Accelerating(pair("acceleration_px_s2", acceleration, 1e6, advice)?)
            }
            (None, Some(turn_deg_s)) => {
                let advice = "degrees per second by which the velocity turns, from x towards y";
                let turn = check.meets(&key("turn_deg_s"), turn_deg_s, Rule::Within(-36_000.0, 36_000.0), advice)?;
                TargetCurve::Arc(turn.to_radians())
            }
        };
        Ok(TargetPath { position_px, velocity_px_s, curve })
    }

    fn light(keys: &TargetKeys, place: usize, check: &Checker<'_>) -> Result<TargetLight, ConfigError> {
        let key = |name: &str| format!("target[{place}].{name}");
        if keys.mag.is_none() {
            check.unused(&key("bp_rp"), keys.bp_rp.is_some(), "mag")?;
        }
        match (keys.mag, keys.electrons, keys.snr) {
            (Some(mag), None, None) => {
                let mag = check.meets(&key("mag"), mag, Rule::Within(-30.0, 40.0), "Gaia G magnitude")?;
                let colour = "BP-RP, magnitudes; left out: 0";
                let bp_rp = check.meets(&key("bp_rp"), keys.bp_rp.unwrap_or(0.0), Rule::Within(-0.5, 5.0), colour)?;
                Ok(TargetLight::Mag { mag, bp_rp })
            }
            (None, None, Some(snr)) => {
                let advice = "signal-to-noise ratio of as much light in a still star, as starloop snr has it";
                check.meets(&key("snr"), snr, Rule::PositiveUpTo(1e6), advice).map(TargetLight::Snr)
            }
            (None, Some(electrons), None) => {
                let advice = "electrons of one whole exposure, in all pixels together";
                check.meets(&key("electrons"), electrons, Rule::PositiveUpTo(1e12), advice).map(TargetLight::Electrons)
            }
            _ => {
                let given = [keys.mag, keys.electrons, keys.snr].iter().flatten().count();
                let advice = "how bright it is: such as mag = 6.0, or electrons = 5000.0, or snr = 8.0";
                Err(check.invalid(&key("mag"), format!("{given} of them"), "one of mag, electrons and snr", advice))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use std::path::Path;

    fn checked(lines: &str) -> Result<TargetSettings, String> {
        let document = Document::from_text(lines, Path::new("lab/target.toml"));
        let keys: TargetKeys = document.read_as().map_err(|error| error.to_string())?;
        TargetSettings::check(&keys, 0, &mut Checker::new(&document)).map_err(|error| error.to_string())
    }

    #[test]
    fn each_kind_of_path_and_light_is_taken() {
        let curve = |settings: &TargetSettings| match &settings.course {
            TargetCourse::Script(path) => Some(path.curve),
            TargetCourse::Orbit(_) => None,
        };
        let straight = checked("position_px = [1.0, 2.0]\nvelocity_px_s = [3.0, 4.0]\nmag = 6.0\n").unwrap();
        assert_eq!(curve(&straight), Some(TargetCurve::Straight));
        assert_eq!(straight.light, TargetLight::Mag { mag: 6.0, bp_rp: 0.0 });
        assert!(straight.for_s.is_infinite() && straight.start_s <= 0.0);
        let arc = checked("position_px = [1.0, 2.0]\nturn_deg_s = 180.0\nelectrons = 1e4\nfor_s = 2.0\n").unwrap();
        assert_eq!(curve(&arc), Some(TargetCurve::Arc(core::f64::consts::PI)));
        assert_eq!((arc.light, arc.for_s), (TargetLight::Electrons(1e4), 2.0));
        let fast =
            checked("position_px = [1.0, 2.0]\nacceleration_px_s2 = [0.0, 5.0]\nmag = 1.0\nbp_rp = 1.5\n").unwrap();
        assert_eq!(curve(&fast), Some(TargetCurve::Accelerating([0.0, 5.0])));
        assert_eq!(fast.light, TargetLight::Mag { mag: 1.0, bp_rp: 1.5 });
    }

    #[test]
    fn what_contradicts_itself_is_refused_with_advice() {
        for (lines, wanted) in [
            ("mag = 6.0\n", "target[0].position_px is missing"),
            ("position_px = [1.0, 2.0]\n", "one of mag, electrons and snr"),
            ("position_px = [1.0, 2.0]\nmag = 6.0\nelectrons = 5.0\n", "2 of them"),
            ("position_px = [1.0, 2.0]\nsnr = 0.0\n", "target[0].snr"),
            ("position_px = [1.0, 2.0]\nelectrons = 5.0\nbp_rp = 1.0\n", "target[0].bp_rp is given"),
            ("position_px = [1.0, 2.0]\nmag = 6.0\nturn_deg_s = 1.0\nacceleration_px_s2 = [1.0, 0.0]\n", "turn_deg_s"),
            ("position_px = [1e9, 2.0]\nmag = 6.0\n", "target[0].position_px"),
            ("position_px = [1.0, 2.0]\nelectrons = 0.0\n", "target[0].electrons"),
            ("position_px = [1.0, 2.0]\nmag = 6.0\nfor_s = 0.0\n", "target[0].for_s"),
        ] {
            let error = checked(lines).unwrap_err();
            assert!(error.contains(wanted), "{lines}: {error}");
        }
    }

    const LINES: &str = "orbit = \"tle\"\nline1 = \"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\"\n\
                         line2 = \"2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\"\n";
    const STATE: &str = "orbit = \"state_vector\"\nepoch_utc = \"2026-03-01T00:00:00Z\"\n\
                         position_km = [7000.0, 0.0, 0.0]\nvelocity_km_s = [0.0, 7.5, 0.0]\n";

    #[test]
    fn each_kind_of_orbit_and_brightness_is_taken() {
        let two_body = "orbit = \"two_body\"\nepoch_utc = \"2026-03-01T00:00:00Z\"\nsemi_major_axis_km = 7000.0\n";
        let circular = "orbit = \"circular\"\naltitude_km = 500.0\n";
        for (orbit, light) in [
            (LINES, "diameter_m = 1.0\n"),
            (STATE, "mag_1000km = 4.0\nbp_rp = 1.0\n"),
            (two_body, "phase_mag_1000km = [[0.0, 3.0], [120.0, 6.0]]\n"),
            (circular, "mag = 7.0\nstart_s = 3.0\n"),
        ] {
            let settings = checked(&format!("{orbit}{light}")).unwrap();
            assert!(matches!(settings.course, TargetCourse::Orbit(_)), "{settings:?}");
            assert!(matches!(settings.light, TargetLight::Reflected { .. }), "{settings:?}");
        }
        let sphere = checked(&format!("{LINES}diameter_m = 2.0\nalbedo = 0.3\nspecular = 0.1\n")).unwrap();
        let brightness = Brightness::Sphere { diameter_m: 2.0, diffuse: 0.3, specular: 0.1 };
        assert_eq!(sphere.light, TargetLight::Reflected { brightness, bp_rp: 0.82 });
    }

    #[test]
    fn what_no_orbit_is_is_refused_with_advice() {
        for (lines, wanted) in [
            ("orbit = \"tel\"\n".to_owned(), "wanted one of \"tle\", \"omm\""),
            ("orbit = \"tle\"\nmag = 1.0\n".to_owned(), "line1 and line2, or file"),
            (format!("{LINES}altitude_km = 500.0\nmag = 1.0\n"), "it belongs to orbit = \"circular\""),
            (format!("{LINES}position_px = [1.0, 2.0]\nmag = 1.0\n"), "a target without orbit"),
            (format!("{LINES}snr = 5.0\n"), "a target without orbit"),
            (format!("{LINES}norad_id = 5\nmag = 1.0\n"), "target[0].norad_id"),
            (LINES.to_owned(), "0 of them"),
            (format!("{LINES}mag = 1.0\nmag_1000km = 4.0\n"), "2 of them"),
            (format!("{LINES}mag = 1.0\nalbedo = 0.1\n"), "target[0].albedo"),
            (format!("{LINES}diameter_m = 1.0\nalbedo = 0.7\nspecular = 0.7\n"), "together with specular"),
            (format!("{LINES}phase_mag_1000km = [[90.0, 4.0], [20.0, 3.0]]\n"), "ascending"),
            (STATE.replace("7.5", "7500.0") + "mag = 1.0\n", "target[0].velocity_km_s"),
            (STATE.replace("2026-03-01T00:00:00Z", "yesterday") + "mag = 1.0\n", "target[0].epoch_utc"),
            ("orbit = \"omm\"\nmag = 1.0\n".to_owned(), "a file in JSON"),
            ("orbit = \"omm\"\nfile = \"nowhere.json\"\nmag = 1.0\n".to_owned(), "nowhere.json"),
            ("position_px = [1.0, 2.0]\nmag = 6.0\nraan_deg = 3.0\n".to_owned(), "a target with orbit"),
        ] {
            let error = checked(&lines).unwrap_err();
            assert!(error.contains(wanted), "{lines}: {error}");
        }
    }
}
