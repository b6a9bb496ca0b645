//! The content of one item: attitude, instant, motion, faults and targets, from its number alone.
//!
//! In: a description, the number of an item, the camera of its shard. Out: a [`Recipe`] with everything that is drawn,
//! checked as the files of a run are. Tests: below, and `studio`.

use crate::distribution::{Draws, Purpose, drawn, drawn_table, number_of};
use crate::spec::{FaultDraw, MOST_OF_AN_ENTRY, MotionKeys, Spec, TargetDraw};
use anyhow::{Context, Result, bail};
use base::axes::{Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use batch::still::still_fault_of;
use config::TargetSettings;
use frames::sink::FrameFault;
use glam::DVec3;
use plan::attitude::LosPath;
use plan::exposure::{Motion, PixelPath, PixelPoint};
use serde_json::Map;
use toml::{Table, Value};

/// Positions of a drawn jitter where the description gives no number.
const USUAL_POSITIONS: u32 = 16;

/// Everything that is drawn for one item.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// Its number.
    pub item: u32,
    /// The middle of the exposure.
    pub at: Tai,
    /// Attitude then.
    pub sensor_from_icrf: Rotation<Sensor, Icrf>,
    /// Rate of the sensor, sensor axes, deg/s.
    pub rate_deg_s: DVec3,
    /// Standard deviation of the jitter about each axis across the boresight, arcsec.
    pub jitter_arcsec: f64,
    /// Positions of the image within the exposure, px.
    pub path: Option<PixelPath>,
    /// Faults, as the keys of events and checked.
    pub faults: Vec<(Map<String, serde_json::Value>, FrameFault)>,
    /// Targets that move over the detector.
    pub targets: Vec<TargetSettings>,
}

impl Recipe {
    /// Draws the recipe of an item for a camera with pixels of this angle.
    ///
    /// # Errors
    /// When a drawn value cannot be used, with its key.
    pub fn new(spec: &Spec, item: u32, ifov_arcsec: f64) -> Result<Self> {
        let draws = |purpose| Draws::new(spec.seed, item, purpose);
        let (sensor_from_icrf, given_rate) = spec.attitudes.of_item(item, &mut draws(Purpose::Attitude));
        let [from, to] = spec.span;
        let at = from + Span::from_s(draws(Purpose::Time).between(0.0, (to - from).s()));
        let rate_deg_s = rate(&spec.motion, given_rate, &mut draws(Purpose::Rate)).context("motion")?;
        let mut jitter = draws(Purpose::Jitter);
        let jitter_arcsec = jitter_rms(&spec.motion, &mut jitter).context("motion")?;
        let positions = spec.motion.jitter_positions.unwrap_or(USUAL_POSITIONS);
        let path =
            (jitter_arcsec > 0.0).then(|| path(jitter_arcsec / ifov_arcsec, positions, &mut jitter)).transpose()?;
        let mut of_faults = draws(Purpose::Faults);
        let faults = spec.faults.iter().enumerate();
        let faults =
            faults.map(|(number, fault)| one_fault(fault, &mut of_faults).with_context(|| format!("fault[{number}]")));
        let mut of_targets = draws(Purpose::Targets);
        let targets = spec.targets.iter().enumerate();
        let targets = targets
            .map(|(number, target)| some_targets(target, &mut of_targets).with_context(|| format!("target[{number}]")));
        Ok(Self {
            item,
            at,
            sensor_from_icrf,
            rate_deg_s,
            jitter_arcsec,
            path,
            faults: faults.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect(),
            targets: targets.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect(),
        })
    }

    /// Returns the mean displacement of the image by the jitter, px.
    pub fn mean_jitter_px(&self) -> [f64; 2] {
        let points = self.path.as_ref().map_or(&[][..], PixelPath::points);
        let sum = points.iter().fold([0.0; 2], |[x, y], point| [x + point.dx_px, y + point.dy_px]);
        sum.map(|sum| sum / points.len().max(1) as f64)
    }

    /// Returns the motion of the image during an exposure of this length.
    pub fn motion(&self, exposure_s: f64) -> Motion {
        let start = self.at - Span::from_s(0.5 * exposure_s);
        let mut los = LosPath::commanded(self.sensor_from_icrf, start, exposure_s);
        los.rate_rad_s = self.rate_deg_s * 1_f64.to_radians();
        Motion { los, image_path: self.path.clone() }
    }
}

fn rate(motion: &MotionKeys, given: Option<DVec3>, draws: &mut Draws) -> Result<DVec3> {
    let Some(value) = &motion.rate_deg_s else {
        return Ok(given.map_or(DVec3::ZERO, |rate_rad_s| rate_rad_s * 1_f64.to_degrees()));
    };
    let value = drawn(value, draws)?;
    let rate_deg_s = match (value.as_array(), number_of(&value)) {
        (None, Some(norm)) => norm * draws.direction(),
        (Some(list), _) => {
            let axes: Vec<f64> = list.iter().filter_map(number_of).collect();
            let [x, y, z] = axes[..] else { bail!("rate_deg_s: got {value}, wanted three numbers") };
            DVec3::new(x, y, z)
        }
        (None, None) => bail!("rate_deg_s: got {value}, wanted a number or three"),
    };
    MotionKeys::check_rate(rate_deg_s.length())?;
    Ok(rate_deg_s)
}

fn jitter_rms(motion: &MotionKeys, draws: &mut Draws) -> Result<f64> {
    let Some(value) = &motion.jitter_arcsec else { return Ok(0.0) };
    let value = drawn(value, draws)?;
    let rms = number_of(&value).filter(|rms| (0.0..=1e5).contains(rms));
    rms.with_context(|| format!("jitter_arcsec: got {value}, wanted 0 to 100000"))
}

/// Returns independent normal positions of the same weight.
fn path(rms_px: f64, positions: u32, draws: &mut Draws) -> Result<PixelPath> {
    let mut along = || rms_px * draws.normal();
    let points = (0..positions).map(|_| PixelPoint { t_s: 0.0, dx_px: along(), dy_px: along(), roll_rad: 0.0 });
    Ok(PixelPath::samples(points.collect())?)
}

fn one_fault(fault: &FaultDraw, draws: &mut Draws) -> Result<Option<(Map<String, serde_json::Value>, FrameFault)>> {
    let has_it = draws.unit() < fault.probability;
    let keys = json_of(&drawn_table(&fault.keys, draws)?)?;
    // Its numbers are drawn for every item, so that the faults after it do not depend on it.
    if has_it { Ok(Some((keys.clone(), still_fault_of(keys)?))) } else { Ok(None) }
}

fn some_targets(target: &TargetDraw, draws: &mut Draws) -> Result<Vec<TargetSettings>> {
    let count = drawn(&target.count, draws)?;
    let whole = count.as_integer().filter(|count| (0..=MOST_OF_AN_ENTRY).contains(count));
    let whole = whole.with_context(|| format!("count: got {count}, wanted 0 to {MOST_OF_AN_ENTRY}"))?;
    (0..whole).map(|_| Ok(TargetSettings::from_json(&json_of(&drawn_table(&target.keys, draws)?)?)?)).collect()
}

/// Returns the keys of a table as JSON, which is how keys from outside a file are checked.
fn json_of(table: &Table) -> Result<Map<String, serde_json::Value>> {
    let value = serde_json::to_value(Value::Table(table.clone()))?;
    Ok(value.as_object().cloned().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const REST: &str = "[time]\nfrom_utc = \"2026-01-01\"\nto_utc = \"2026-07-01\"\n\
                        [motion]\nrate_deg_s = { uniform = [0, 2] }\njitter_arcsec = { uniform = [0, 30] }\n\
                        [[fault]]\nprobability = 0.5\ndo = \"stray_light\"\ne_per_s = { log_uniform = [10, 1000] }\n\
                        [[target]]\ncount = { integer = [0, 3] }\nmag = { uniform = [4, 9] }\n\
                        position_px = [{ uniform = [0, 255] }, { uniform = [0, 255] }]\n";

    fn spec(rest: &str) -> Spec {
        Spec::parse(&format!("name = \"x\"\ncamera = \"cameras/small_tracker.toml\"\n{rest}"), Path::new(".")).unwrap()
    }

    #[test]
    fn items_follow_from_their_number_alone() {
        let spec = spec(REST);
        let all: Vec<Recipe> = (0..200).map(|item| Recipe::new(&spec, item, 60.0).unwrap()).collect();
        assert_eq!(all[7], Recipe::new(&spec, 7, 60.0).unwrap());
        assert_ne!(all[7].sensor_from_icrf, all[8].sensor_from_icrf);
        let with_fault = all.iter().filter(|recipe| !recipe.faults.is_empty()).count();
        assert!(with_fault.abs_diff(100) < 36, "half of them: {with_fault}");
        assert!((0..=3).all(|count| all.iter().any(|recipe| recipe.targets.len() == count)));
        assert!(all.iter().all(|recipe| recipe.at >= spec.span[0] && recipe.at <= spec.span[1]));
    }

    #[test]
    fn jitter_has_its_standard_deviation() {
        let spec = spec("[motion]\njitter_arcsec = 12\njitter_positions = 4096\n");
        let recipe = Recipe::new(&spec, 0, 60.0).unwrap();
        let points = recipe.path.as_ref().unwrap().points();
        let count = points.len() as f64;
        let variance: f64 = points.iter().map(|point| point.dx_px * point.dx_px).sum::<f64>() / count;
        assert!(recipe.mean_jitter_px().iter().all(|mean| mean.abs() < 5.0 * 0.2 / count.sqrt()));
        // 12 arcsec are 0.2 px; five standard errors.
        assert!((variance.sqrt() / 0.2 - 1.0).abs() < 5.0 / (2.0 * count).sqrt(), "{}", variance.sqrt());
    }

    #[test]
    fn drawn_values_are_checked_as_those_of_files() {
        let refused = |rest: &str| format!("{:#}", Recipe::new(&spec(rest), 0, 60.0).unwrap_err());
        assert!(refused("[motion]\nrate_deg_s = { uniform = [2000, 3000] }\n").contains("wanted at most 1000"));
        assert!(refused("[motion]\njitter_arcsec = \"much\"\n").contains("motion: jitter_arcsec"));
        assert!(refused("[[fault]]\ndo = \"frame_late\"\n").contains("fault[0]"));
        assert!(refused("[[fault]]\ndo = \"stray_light\"\n").contains("e_per_s"));
        assert!(refused("[[target]]\nmag = 5\n").contains("target[0]"));
        assert!(refused("[[target]]\ncount = { integer = [100, 100] }\nmag = 5\n").contains("count: got 100"));
    }
}
