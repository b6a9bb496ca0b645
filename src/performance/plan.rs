//! A test plan: what is flown, with which tracker, and how numbers are said.

use crate::attitudes::Attitudes;
use crate::model_figures::ModelFigures;
use crate::mounting::MountingDrift;
use crate::poses::{CaseMotion, Sine};
use crate::record::{FalseLimit, Use};
use crate::settings::Settings;
use anyhow::{Context, Result, bail};
use base::input_file::{SETTINGS_BYTES, read_text};
use base::time::Tai;
use base::units::ARCSEC;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A test plan file, `configs/test_plans/ecss_star_tracker.toml` for one.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Its name.
    pub name: String,
    /// Camera file, relative to the plan.
    pub camera: PathBuf,
    /// Seed of everything.
    #[serde(default = "one")]
    pub seed: u64,
    /// Start of every case, UTC.
    #[serde(default = "usual_start")]
    pub start_utc: String,
    /// Frames per second, where a case says no other.
    #[serde(default = "usual_rate")]
    pub frame_rate_hz: f64,
    /// Of intervals.
    #[serde(default = "usual_confidence")]
    pub confidence: f64,
    /// Of performances.
    #[serde(default = "usual_probability")]
    pub probability: f64,
    /// Beyond it a solution is false, across the boresight, arcsec.
    #[serde(default = "usual_directional")]
    pub false_directional_arcsec: f64,
    /// The same about the boresight.
    #[serde(default = "usual_rotational")]
    pub false_rotational_arcsec: f64,
    /// Largest temporal noise per axis across the boresight that exclusion angles allow, arcsec.
    pub exclusion_noise_arcsec: Option<f64>,
    /// File of requirements, relative to the plan.
    pub requirements: Option<PathBuf>,
    /// Values that are changed in the run file of every case, as `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// The tracker under test.
    #[serde(default)]
    pub tracker: TrackerUnderTest,
    /// Cases to fly.
    #[serde(rename = "case")]
    pub cases: Vec<PlanCase>,
}

/// The tracker that measures the frames.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerUnderTest {
    /// Which kind.
    #[serde(default)]
    pub source: Source,
    /// Its name in the report.
    pub name: Option<String>,
    /// Most stars that the built-in tracker measures.
    #[serde(default = "usual_stars")]
    pub stars: usize,
    /// Milliseconds that the built-in tracker thinks.
    #[serde(default = "usual_delay")]
    pub delay_ms: f64,
    /// Milliseconds by which time tags of a tracker inside are late: a date error to be studied.
    #[serde(default)]
    pub tag_error_ms: f64,
    /// A program and its arguments: `{frames}` is the folder of images, `{log}` the log to write, `{camera}` the camera
    /// file.
    #[serde(default)]
    pub command: Vec<String>,
    /// Figures of the statistical tracker.
    pub model: Option<ModelFigures>,
}

impl Default for TrackerUnderTest {
    fn default() -> Self {
        let (stars, delay_ms) = (usual_stars(), usual_delay());
        Self {
            source: Source::BuiltIn,
            name: None,
            stars,
            delay_ms,
            tag_error_ms: 0.0,
            command: Vec::new(),
            model: None,
        }
    }
}

/// Kinds of trackers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The built-in one, which sees pixels only.
    #[default]
    BuiltIn,
    /// A program outside, which is given the folder of images.
    Program,
    /// A statistical one of given errors, which sees the truth.
    Model,
}

/// One entry of a plan: a case, or one for each value of a sweep.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanCase {
    /// Its name; a sweep adds its value.
    pub name: String,
    /// Purpose, which decides its metrics.
    #[serde(rename = "use")]
    pub purpose: Use,
    /// Where the sensor points.
    pub attitudes: Attitudes,
    /// Frames of each attitude.
    pub frames: u32,
    /// Frames per second, in place of the plan's.
    pub frame_rate_hz: Option<f64>,
    /// Rate about the sensor's axes from each attitude on, deg/s.
    #[serde(default)]
    pub rate_deg_s: [f64; 3],
    /// Acceleration along the same axis, deg/s^2.
    #[serde(default)]
    pub acceleration_deg_s2: [f64; 3],
    /// Amplitude of a sine of the line of sight about the sensor's axes, arcsec.
    #[serde(default)]
    pub sine_arcsec: [f64; 3],
    /// Its frequency.
    #[serde(default = "usual_sine")]
    pub sine_hz: f64,
    /// Drift of the mounting with the temperatures of an orbit.
    pub mounting_drift: Option<MountingDrift>,
    /// Values that are changed in the run file, as `KEY=VALUE`; `{value}` is that of the sweep.
    #[serde(default)]
    pub set: Vec<String>,
    /// Several cases that differ in one value.
    pub sweep: Option<Sweep>,
}

/// Values of one thing.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Its name with unit, such as `rate_deg_s`.
    pub key: String,
    /// Multiplied by the value, if it is not only put in the place of `{value}`.
    #[serde(default)]
    pub scales: Scales,
    /// The values.
    pub values: Vec<f64>,
}

/// Quantity that a sweep's value multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scales {
    /// Nothing.
    #[default]
    Nothing,
    /// The rate.
    Rate,
    /// The acceleration.
    Acceleration,
    /// The frequency of the sine.
    Frequency,
}

fn one() -> u64 {
    1
}

fn usual_start() -> String {
    "2026-03-01T00:00:00Z".into()
}

fn usual_rate() -> f64 {
    5.0
}

fn usual_sine() -> f64 {
    1.0
}

fn usual_stars() -> usize {
    40
}

fn usual_delay() -> f64 {
    50.0
}

fn usual_confidence() -> f64 {
    Settings::default().confidence
}

fn usual_probability() -> f64 {
    Settings::default().probability
}

fn usual_directional() -> f64 {
    Settings::default().false_limit.directional_arcsec
}

fn usual_rotational() -> f64 {
    Settings::default().false_limit.rotational_arcsec
}

/// Largest amplitude of a sine of the line of sight.
const MOST_SINE_ARCSEC: f64 = 3600.0;
/// Nearest that twice a sine's frequency may be to a multiple of the frame rate, in frame rates.
const NEAREST_FOLD: f64 = 0.01;
/// Largest drift of a mounting.
const MOST_DRIFT_ARCSEC: f64 = 3600.0;
/// Most frames of a plan.
const MOST_FRAMES: u64 = 10_000_000;

impl Plan {
    /// Reads a plan.
    ///
    /// # Errors
    /// With the file, what was got and what was wanted.
    pub fn read(path: &Path) -> Result<Self> {
        let file = path.display().to_string();
        let text = read_text(path, SETTINGS_BYTES).with_context(|| file.clone())?;
        Self::parse(&text).with_context(|| file)
    }

    /// Reads a plan's text.
    ///
    /// # Errors
    /// With what was got and what was wanted.
    pub fn parse(text: &str) -> Result<Self> {
        let plan: Self = toml::from_str(text)?;
        plan.check()?;
        Ok(plan)
    }

    fn check(&self) -> Result<()> {
        let range = |name: &str, got: f64, low: f64, high: f64| -> Result<()> {
            let is_good = (low..=high).contains(&got);
            if is_good { Ok(()) } else { bail!("{name}: got {got}, wanted {low} to {high}") }
        };
        range("confidence", self.confidence, 0.5, 0.999_999)?;
        range("probability", self.probability, 0.5, 0.999_999)?;
        range("frame_rate_hz", self.frame_rate_hz, 0.001, 1000.0)?;
        range("false_directional_arcsec", self.false_directional_arcsec, 1e-3, 648_000.0)?;
        range("false_rotational_arcsec", self.false_rotational_arcsec, 1e-3, 648_000.0)?;
        if let Some(noise_arcsec) = self.exclusion_noise_arcsec {
            range("exclusion_noise_arcsec", noise_arcsec, 1e-6, 648_000.0)?;
        }
        range("tracker.tag_error_ms", self.tracker.tag_error_ms, -1000.0, 1000.0)?;
        range("tracker.delay_ms", self.tracker.delay_ms, 0.0, 10_000.0)?;
        let has_program = !self.tracker.command.is_empty();
        if (self.tracker.source == Source::Program) != has_program {
            bail!("tracker: wanted command with source = \"program\", and only with it");
        }
        if (self.tracker.source == Source::Model) != self.tracker.model.is_some() {
            bail!("tracker: wanted [tracker.model] with source = \"model\", and only with it");
        }
        if let Some(model) = &self.tracker.model {
            model.check()?;
        }
        if self.cases.is_empty() {
            bail!("got no [[case]], wanted one at least");
        }
        for case in &self.cases {
            case.check(self.frame_rate_hz).with_context(|| format!("case \"{}\"", case.name))?;
        }
        let mut names: Vec<String> =
            self.cases.iter().flat_map(PlanCase::each).map(|(name, _)| folder_name(&name)).collect();
        names.sort();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            bail!("two cases have the folder {}; wanted names that differ", pair[0]);
        }
        Ok(())
    }

    /// Returns the start of every case.
    ///
    /// # Errors
    /// When it is not a time.
    pub fn start(&self) -> Result<Tai> {
        Tai::from_rfc3339(&self.start_utc).context("start_utc")
    }

    /// Returns what numbers are said with.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let (directional_arcsec, rotational_arcsec) = (self.false_directional_arcsec, self.false_rotational_arcsec);
        let false_limit = FalseLimit { directional_arcsec, rotational_arcsec };
        let exclusion_noise_arcsec = self.exclusion_noise_arcsec;
        Settings { confidence: self.confidence, probability: self.probability, false_limit, exclusion_noise_arcsec }
    }
}

impl PlanCase {
    fn check(&self, plan_rate_hz: f64) -> Result<()> {
        if folder_name(&self.name).trim_matches(['_', '.']).is_empty() {
            bail!("name: got \"{}\", wanted letters or digits", self.name);
        }
        if self.frames == 0 || u64::from(self.frames) > MOST_FRAMES {
            bail!("frames: got {}, wanted 1 to {MOST_FRAMES}", self.frames);
        }
        let vectors = [self.rate_deg_s, self.acceleration_deg_s2].map(glam::DVec3::from_array);
        if vectors.iter().any(|vector| !(vector.is_finite() && vector.length() < 100.0)) {
            bail!("rate_deg_s, acceleration_deg_s2: wanted finite numbers below 100");
        }
        let [rate, acceleration] = vectors;
        if rate.cross(acceleration).length() > 1e-9 * rate.length() * acceleration.length() {
            bail!("acceleration_deg_s2: wanted one along the axis of rate_deg_s");
        }
        self.check_sine(self.frame_rate_hz.unwrap_or(plan_rate_hz))?;
        self.check_drift()?;
        match &self.sweep {
            Some(sweep) if sweep.values.is_empty() || sweep.values.iter().any(|value| !value.is_finite()) => {
                bail!("sweep.values: wanted finite numbers")
            }
            None if self.set.iter().any(|set| set.contains(VALUE)) => bail!("set: got {VALUE} without a sweep"),
            Some(_) | None => Ok(()),
        }
    }

    fn check_sine(&self, rate_hz: f64) -> Result<()> {
        let amplitude = glam::DVec3::from_array(self.sine_arcsec);
        let is_good = amplitude.is_finite() && amplitude.length() <= MOST_SINE_ARCSEC;
        if !is_good {
            bail!("sine_arcsec: got {:?}, wanted up to {MOST_SINE_ARCSEC} arcsec", self.sine_arcsec);
        }
        if (self.purpose == Use::Bandwidth) != (amplitude.length() > 0.0) {
            bail!("sine_arcsec: wanted one with use = \"bandwidth\", and only with it");
        }
        let others = [self.rate_deg_s, self.acceleration_deg_s2].map(glam::DVec3::from_array);
        if amplitude.length() > 0.0 && others.iter().any(|vector| vector.length() > 0.0) {
            bail!("sine_arcsec: wanted no rate_deg_s and no acceleration_deg_s2 beside it");
        }
        for (_, value) in self.each() {
            let Some(Sine { hz, .. }) = self.sine(value) else { continue };
            let is_good = (1e-3..=1e3).contains(&hz);
            if !is_good {
                bail!("sine_hz: got {hz} with the sweep, wanted 0.001 to 1000");
            }
            let folds = 2.0 * hz / rate_hz;
            if (folds - folds.round()).abs() < NEAREST_FOLD {
                bail!("sine_hz: got {hz} at {rate_hz} frames per second, wanted no multiple of half of that rate");
            }
        }
        Ok(())
    }

    fn check_drift(&self) -> Result<()> {
        let Some(drift) = &self.mounting_drift else { return Ok(()) };
        let is_good =
            drift.arcsec.iter().all(|angle| angle.abs() <= MOST_DRIFT_ARCSEC) && (1.0..=1e9).contains(&drift.period_s);
        if is_good {
            return Ok(());
        }
        bail!("mounting_drift: got {drift:?}, wanted arcsec up to {MOST_DRIFT_ARCSEC} and period_s from 1 to 1e9")
    }

    /// Returns names and values of the cases of this entry.
    #[must_use]
    pub fn each(&self) -> Vec<(String, Option<f64>)> {
        match &self.sweep {
            None => vec![(self.name.clone(), None)],
            Some(sweep) => sweep.values.iter().map(|value| (format!("{} {value}", self.name), Some(*value))).collect(),
        }
    }

    /// Returns rate and acceleration with the sweep's value, rad/s and rad/s^2.
    #[must_use]
    pub fn motion(&self, value: Option<f64>) -> [glam::DVec3; 2] {
        let scales = self.sweep.as_ref().map_or(Scales::Nothing, |sweep| sweep.scales);
        let factor = |of: Scales| value.filter(|_| scales == of).unwrap_or(1.0);
        let radians = |vector: [f64; 3], factor: f64| glam::DVec3::from_array(vector.map(f64::to_radians)) * factor;
        [
            radians(self.rate_deg_s, factor(Scales::Rate)),
            radians(self.acceleration_deg_s2, factor(Scales::Acceleration)),
        ]
    }

    /// Returns the sine of the line of sight with the sweep's value; `None` without one.
    #[must_use]
    pub(crate) fn sine(&self, value: Option<f64>) -> Option<Sine> {
        let scales = self.sweep.as_ref().map_or(Scales::Nothing, |sweep| sweep.scales);
        let factor = value.filter(|_| scales == Scales::Frequency).unwrap_or(1.0);
        let turn_rad = glam::DVec3::from_array(self.sine_arcsec) * ARCSEC;
        (turn_rad.length() > 0.0).then_some(Sine { turn_rad, hz: self.sine_hz * factor })
    }

    /// Returns all motion of the sensor with the sweep's value.
    #[must_use]
    pub(crate) fn whole_motion(&self, value: Option<f64>) -> CaseMotion {
        let [rate_rad_s, acceleration_rad_s2] = self.motion(value);
        CaseMotion { rate_rad_s, acceleration_rad_s2, sine: self.sine(value), drift: self.mounting_drift }
    }

    /// Returns the changed values of a run file, with the sweep's value in its place.
    #[must_use]
    pub fn settings(&self, value: Option<f64>) -> Vec<String> {
        let with_value =
            |text: &String| value.map_or_else(|| text.clone(), |value| text.replace(VALUE, &toml_number(value)));
        self.set.iter().map(with_value).collect()
    }
}

/// Placeholder of a sweep's value.
const VALUE: &str = "{value}";

/// A number that TOML reads as one with a fraction.
fn toml_number(value: f64) -> String {
    let text = value.to_string();
    if text.contains(['.', 'e', 'E']) { text } else { format!("{text}.0") }
}

/// Returns the name of a case's folder.
#[must_use]
pub fn folder_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || "-.".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGIN: &str = "name = \"x\"\ncamera = \"c.toml\"\n";
    const CASE: &str = "[[case]]\nname = \"slew\"\nuse = \"slew\"\nframes = 3\n\
                        attitudes = { kind = \"fixed\", ra_deg = 1, dec_deg = 2 }\nrate_deg_s = [0, 1, 0]\n";

    #[test]
    fn a_sweep_is_a_case_for_each_value() {
        let sweep = "set = [\"a.b={value}\"]\nsweep = { key = \"rate_deg_s\", scales = \"rate\", values = [0.5, 2] }\n";
        let plan = Plan::parse(&format!("{BEGIN}{CASE}{sweep}")).unwrap();
        let case = &plan.cases[0];
        let names: Vec<_> = case.each();
        assert_eq!(names, [("slew 0.5".to_owned(), Some(0.5)), ("slew 2".to_owned(), Some(2.0))]);
        assert!((case.motion(Some(2.0))[0].y - 2_f64.to_radians()).abs() < 1e-15);
        assert_eq!(case.settings(Some(2.0)), ["a.b=2.0"]);
    }

    #[test]
    fn plans_that_cannot_be_flown_are_refused() {
        let refused = |text: &str| format!("{:#}", Plan::parse(text).unwrap_err());
        assert!(refused(BEGIN).contains("case"));
        assert!(refused(&format!("{BEGIN}{CASE}{CASE}")).contains("names that differ"));
        for name in ["..", ".", "./.", "...", "_._"] {
            let case = CASE.replacen("\"slew\"", &format!("\"{name}\""), 1);
            assert!(refused(&format!("{BEGIN}{case}")).contains("wanted letters or digits"), "{name}");
        }
        assert!(Plan::parse(&format!("{BEGIN}{}", CASE.replacen("\"slew\"", "\"..a\"", 1))).is_ok(), "control");
        assert!(refused(&format!("{BEGIN}confidence = 2\n{CASE}")).contains("confidence: got 2"));
        assert!(refused(&format!("{BEGIN}exclusion_noise_arcsec = 0\n{CASE}")).contains("exclusion_noise_arcsec"));
        assert!(refused(&format!("{BEGIN}{CASE}set = [\"a={{value}}\"]\n")).contains("without a sweep"));
        assert!(refused(&format!("{BEGIN}{CASE}acceleration_deg_s2 = [1, 0, 0]\n")).contains("along the axis"));
        assert!(refused(&format!("{BEGIN}{CASE}[tracker]\nsource = \"program\"\n")).contains("command"));
        assert!(refused(&format!("{BEGIN}{CASE}sine_arcsec = [9, 0, 0]\n")).contains("bandwidth"));
        let sine = CASE.replace("use = \"slew\"", "use = \"bandwidth\"");
        assert!(refused(&format!("{BEGIN}{sine}")).contains("sine_arcsec: wanted one"));
        assert!(refused(&format!("{BEGIN}{sine}sine_arcsec = [9, 0, 0]\n")).contains("no rate_deg_s"));
        let sine = sine.replace("rate_deg_s = [0, 1, 0]", "sine_arcsec = [9, 0, 0]");
        assert!(refused(&format!("{BEGIN}{sine}sine_hz = 7.5\n")).contains("multiple of half"));
        assert!(refused(&format!("{BEGIN}{sine}sine_hz = -1\n")).contains("got -1"));
        let drift = "mounting_drift = { arcsec = [1, 2, 3], period_s = 0 }\n";
        assert!(refused(&format!("{BEGIN}{CASE}{drift}")).contains("period_s"));
    }

    #[test]
    fn a_sweep_may_be_of_the_sines_frequency() {
        let case = CASE.replace("use = \"slew\"", "use = \"bandwidth\"");
        let case = case.replace("rate_deg_s = [0, 1, 0]", "sine_arcsec = [30, 40, 0]");
        let sweep = "sweep = { key = \"sine_hz\", scales = \"frequency\", values = [0.7, 2.3] }\n";
        let plan = Plan::parse(&format!("{BEGIN}{case}{sweep}")).unwrap();
        let sine = plan.cases[0].sine(Some(2.3)).unwrap();
        assert!((sine.hz - 2.3).abs() < 1e-12 && (sine.turn_rad.length() - 50.0 * ARCSEC).abs() < 1e-15);
        assert!(Plan::parse(&format!("{BEGIN}{CASE}")).unwrap().cases[0].sine(None).is_none());
    }
}
