//! `[[target]]`: point sources that move over the detector by a script, or fly about the Earth, and what becomes of
//! stars behind them.

use crate::key::{Section, section, taken};
use crate::key_type::{Numbers, Raw, Shape, Whole, Word};
use crate::target_orbit::{KINDS, Kind, USUAL_ALBEDO, check_brightness};
use crate::{check::Checker, document::Document, error::Result, observer::OrbitSettings};
use plan::exposure::{TargetCurve, TargetPath};
use sky::{orbit::USUAL_MOST_DAYS, target::Brightness};
use std::path::Path;

/// Most targets of a bench.
const TARGETS_MAX: usize = 256;
/// Furthest a target may be from the detector's corner, px.
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

/// Rule for pixels where stars and targets overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overlap {
    /// Photons add.
    #[default]
    Add,
    /// In every pixel the brighter of the two, without the other's light: no physics, but the masks of some
    /// simulations do so.
    Brighter,
}

section! {
    /// A point source that moves over the detector by a script, or flies about the Earth.
    TargetKeys at "target" {
        /// Seconds after the first exposure at which it is first seen.
        start_s: f64 = 0.0, Within(0.0, 1e7);
        /// How long it is seen.
        for_s: f64 = Optional, PositiveUpTo(1e7), "seconds; left out: to the end";
        /// Column and row where it is first seen, such as [100.0, 200.0].
        position_px: [f64; 2] = Optional, Within(-FAR_PX, FAR_PX);
        /// Pixels per second along columns and rows, such as [30.0, -10.0].
        velocity_px_s: [f64; 2] = Silent(Numbers([0.0; 2])), Within(-1e6, 1e6);
        /// Pixels per second squared, such as [0.0, 5.0].
        acceleration_px_s2: [f64; 2] = Optional, Within(-1e6, 1e6);
        /// Degrees per second by which the velocity turns, from x towards y.
        turn_deg_s: f64 = Optional, Within(-36_000.0, 36_000.0);
        /// Magnitude in Gaia G; of a target with orbit, wherever it is lit.
        mag: f64 = Optional, Within(-30.0, 40.0);
        /// Colour BP-RP, magnitudes.
        bp_rp: f64 = Computed("0, with orbit that of sunlight, 0.82"), Within(-0.5, 5.0);
        /// Electrons of one whole exposure, in all pixels together.
        electrons: f64 = Optional, PositiveUpTo(1e12);
        /// Signal-to-noise ratio of as much light in a still star, as starloop snr has it.
        snr: f64 = Optional, PositiveUpTo(1e6);
        /// How its orbit is given; without it, it moves by the script of position_px and so on.
        orbit: Word<Kind> = Optional, KINDS,
            "tle takes line1 and line2, or file; omm takes file; two_body elements; state_vector position_km and \
             velocity_km_s; circular altitude_km";
        /// First line of an element set; copy both lines of the element set unchanged, or name a file of them.
        line1: String = Optional, "text of 69 characters";
        /// Second line of an element set.
        line2: String = Optional, "text of 69 characters";
        /// File of element lines, or of orbit mean-elements messages in JSON, KVN, XML or CSV.
        file: String = Optional, "path";
        /// The catalog number of one object of the file.
        norad_id: Whole<u64> = Optional, 1..=999_999_999;
        /// Days from their epoch beyond which elements are refused; check warns from 7 days on.
        max_age_days: f64 = Silent(USUAL_MOST_DAYS), PositiveUpTo(36_525.0);
        /// Instant of the elements or the state, such as "2026-03-01T12:00:00Z".
        epoch_utc: String = Optional, "time";
        /// Kilometres from the centre: 6878 for a low orbit; negative for a hyperbola.
        semi_major_axis_km: f64 = Optional, Within(-1e7, 1e7);
        /// Eccentricity, 0 for a circle.
        eccentricity: f64 = 0.0, Within(0.0, 100.0);
        /// Degrees to the equator; above 90 is retrograde.
        inclination_deg: f64 = Computed("0, of a circular orbit 97.6"), Within(0.0, 180.0);
        /// Right ascension of the ascending node, degrees.
        raan_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Degrees from the ascending node to the perigee.
        argument_of_perigee_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Mean anomaly at the epoch, degrees.
        mean_anomaly_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Position.
        position_km: [f64; 3] = Optional, Within(-1e7, 1e7), STATE;
        /// Velocity in ICRF axes, kilometres per second.
        velocity_km_s: [f64; 3] = Optional, Within(-100.0, 100.0), STATE;
        /// Kilometres above the equatorial radius: 550 is a usual low orbit, 35786 is geostationary.
        altitude_km: f64 = Optional, Within(100.0, 4e5);
        /// Degrees from the ascending node, at the first exposure.
        argument_of_latitude_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Diameter of a sphere in the Sun's light, metres across.
        diameter_m: f64 = Optional, PositiveUpTo(1e7);
        /// Share of light that a sphere scatters.
        albedo: f64 = USUAL_ALBEDO, Within(0.0, 1.0);
        /// Share of light that a sphere mirrors.
        specular: f64 = 0.0, Within(0.0, 1.0);
        /// Magnitude in Gaia G at 1000 km and phase 90 deg.
        mag_1000km: f64 = Optional, Within(-30.0, 40.0);
        /// Pairs of phase angle, deg, and Gaia G at 1000 km, such as [[0, 3.0], [90, 4.2], [150, 6.0]].
        phase_mag_1000km: Raw<Vec<[f64; 2]>> = Optional, Shape::pairs();
    }
}

const STATE: &str = "from the geocentre in ICRF axes, km and km/s";

/// Checks all targets of a bench.
pub(super) fn check_targets(keys: &[TargetKeys], check: &mut Checker<'_>) -> Result<Vec<TargetSettings>> {
    if keys.len() > TARGETS_MAX {
        let wanted = format!("at most {TARGETS_MAX}");
        return Err(check.invalid("target", keys.len(), wanted, "each is drawn node by node: leave some out"));
    }
    keys.iter().enumerate().map(|(place, keys)| TargetSettings::check(keys, place, check)).collect()
}

/// Refuses a target that is first seen when the run is over.
pub(super) fn check_seen(targets: &[TargetSettings], duration_s: f64, check: &Checker<'_>) -> Result<()> {
    let is_late = |target: &TargetSettings| target.start_s >= duration_s;
    // A setting may cut a run short.
    let Some(place) = targets.iter().position(is_late).filter(|_| !check.document.has_settings()) else {
        return Ok(());
    };
    let wanted = format!("a time before the run ends, at {duration_s} s");
    Err(check.invalid(&format!("target[{place}].start_s"), targets[place].start_s, wanted, "it would never be seen"))
}

impl TargetSettings {
    /// Checks one target that comes from outside a file, with the keys of `[[target]]`.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn from_json(keys: &serde_json::Map<String, serde_json::Value>) -> Result<Self> {
        let document = Document::of_json(keys, Path::new("target"))?;
        Self::check(&document.read_as::<TargetKeys>()?, 0, &mut Checker::new(&document))
    }

    fn check(keys: &TargetKeys, place: usize, check: &mut Checker<'_>) -> Result<Self> {
        let keys = &keys.at(&format!("target[{place}]"));
        let start_s = keys.start_s().check(check)?;
        let for_s = keys.for_s().optional(check)?.unwrap_or(f64::INFINITY);
        let (course, light) = if keys.orbit().is_given() {
            let course = TargetCourse::Orbit(OrbitSettings::check(keys, check)?);
            let (brightness, bp_rp) = check_brightness(keys, check)?;
            (course, TargetLight::Reflected { brightness, bp_rp })
        } else {
            OrbitSettings::check_none(keys, check)?;
            (TargetCourse::Script(Self::path(keys, check)?), Self::light(keys, check)?)
        };
        Ok(Self { start_s, for_s, course, light })
    }

    fn path(keys: &TargetKeys, check: &mut Checker<'_>) -> Result<TargetPath> {
        if !keys.position_px().is_given() {
            return Err(keys.position_px().missing("two numbers, px", check));
        }
        taken!(check, keys => position_px, velocity_px_s);
        if keys.acceleration_px_s2().is_given() && keys.turn_deg_s().is_given() {
            let advice = "a target either accelerates or flies an arc: give one of them";
            let given = keys.acceleration_px_s2().advised(advice);
            return Err(given.invalid("given", "not given beside turn_deg_s", check));
        }
        let accelerating = keys.acceleration_px_s2().optional(check)?.map(TargetCurve::Accelerating);
        let arc = keys.turn_deg_s().optional(check)?.map(|turn| TargetCurve::Arc(turn.to_radians()));
        Ok(TargetPath { position_px, velocity_px_s, curve: accelerating.or(arc).unwrap_or(TargetCurve::Straight) })
    }

    fn light(keys: &TargetKeys, check: &mut Checker<'_>) -> Result<TargetLight> {
        if !keys.mag().is_given() {
            keys.refuse(&["bp_rp"], "mag", check)?;
        }
        let given = [keys.mag(), keys.electrons(), keys.snr()].iter().filter(|key| key.is_given()).count();
        if given != 1 {
            let advice = "how bright it is: such as mag = 6.0, or electrons = 5000.0, or snr = 8.0";
            let wanted = "one of mag, electrons and snr";
            let got = if given == 0 { "missing" } else { "given beside another one" };
            return Err(keys.mag().advised(advice).invalid(got, wanted, check));
        }
        if let Some(snr) = keys.snr().optional(check)? {
            return Ok(TargetLight::Snr(snr));
        }
        if let Some(electrons) = keys.electrons().optional(check)? {
            return Ok(TargetLight::Electrons(electrons));
        }
        let mag = keys.mag().check(check)?;
        let bp_rp = keys.bp_rp().or_silently(0.0).advised("BP-RP, magnitudes; left out: 0").check(check)?;
        Ok(TargetLight::Mag { mag, bp_rp })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn contradictions_are_refused_with_advice() {
        for (lines, wanted) in [
            ("mag = 6.0\n", "target[0].position_px is missing"),
            ("position_px = [1.0, 2.0]\n", "one of mag, electrons and snr"),
            ("position_px = [1.0, 2.0]\nmag = 6.0\nelectrons = 5.0\n", "target[0].mag is given beside another one"),
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
    fn impossible_orbits_are_refused_with_advice() {
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
