//! `[[target]]`: point sources that move over the detector by a script, and what becomes of stars behind them.

use crate::config::check::{Checker, Rule};
use crate::config::error::ConfigError;
use crate::exposure::{TargetCurve, TargetPath};
use serde::Deserialize;

/// Most targets of a bench.
const TARGETS_MAX: usize = 256;
/// Furthest a target may stand from the detector's corner, px.
const FAR_PX: f64 = 1e5;

/// How much light a target sends.
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

/// One target, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetSettings {
    /// First seen, s after the first exposure.
    pub start_s: f64,
    /// Seen for, s; infinite: to the end.
    pub for_s: f64,
    /// Its way.
    pub path: TargetPath,
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
    mag: Option<f64>,
    bp_rp: Option<f64>,
    electrons: Option<f64>,
    snr: Option<f64>,
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
        let path = Self::path(keys, place, check)?;
        Ok(Self { start_s, for_s, path, light: Self::light(keys, place, check)? })
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
    use crate::config::document::Document;
    use std::path::Path;

    fn checked(lines: &str) -> Result<TargetSettings, String> {
        let document = Document::from_text(lines, Path::new("lab/target.toml"));
        let keys: TargetKeys = document.read_as().map_err(|error| error.to_string())?;
        TargetSettings::check(&keys, 0, &mut Checker::new(&document)).map_err(|error| error.to_string())
    }

    #[test]
    fn each_kind_of_path_and_light_is_taken() {
        let straight = checked("position_px = [1.0, 2.0]\nvelocity_px_s = [3.0, 4.0]\nmag = 6.0\n").unwrap();
        assert_eq!(straight.path.curve, TargetCurve::Straight);
        assert_eq!(straight.light, TargetLight::Mag { mag: 6.0, bp_rp: 0.0 });
        assert!(straight.for_s.is_infinite() && straight.start_s <= 0.0);
        let arc = checked("position_px = [1.0, 2.0]\nturn_deg_s = 180.0\nelectrons = 1e4\nfor_s = 2.0\n").unwrap();
        assert_eq!(arc.path.curve, TargetCurve::Arc(core::f64::consts::PI));
        assert_eq!((arc.light, arc.for_s), (TargetLight::Electrons(1e4), 2.0));
        let fast =
            checked("position_px = [1.0, 2.0]\nacceleration_px_s2 = [0.0, 5.0]\nmag = 1.0\nbp_rp = 1.5\n").unwrap();
        assert_eq!(fast.path.curve, TargetCurve::Accelerating([0.0, 5.0]));
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
}
