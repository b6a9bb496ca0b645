//! A test plan: what is flown, with which tracker, and how numbers are said.

use crate::log_form::{Axes, LogForm, Roll};
use crate::metric::{Settings, refuse_all};
use crate::poses::{CaseMotion, MountingDrift, Sine};
use crate::record::{FalseLimit, Use};
use crate::{attitudes::Attitudes, model_figures::ModelFigures, provenance::Paperwork};
use anyhow::{Context, Result, anyhow, bail};
use base::input_file::{SETTINGS_BYTES, read_text};
use base::{time::Tai, units::ARCSEC};
use config::{Document, FileKind, check_keys};
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
    pub confidence: Option<f64>,
    /// Of performances.
    pub probability: Option<f64>,
    /// Beyond it a solution is false, across the boresight, arcsec.
    pub false_directional_arcsec: Option<f64>,
    /// The same about the boresight.
    pub false_rotational_arcsec: Option<f64>,
    /// Largest temporal noise per axis across the boresight that exclusion angles allow, arcsec.
    pub exclusion_noise_arcsec: Option<f64>,
    /// File of requirements, relative to the plan.
    pub requirements: Option<PathBuf>,
    /// Values that are changed in the run file of every case, as `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Unit, author and date for the report.
    #[serde(default)]
    pub document: Paperwork,
    /// The tracker under test.
    #[serde(default)]
    pub tracker: TrackerUnderTest,
    /// Cases to fly.
    #[serde(rename = "case")]
    pub cases: Vec<PlanCase>,
}

/// The tracker that measures the frames.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerUnderTest {
    /// Which kind.
    pub source: Source,
    /// Its name in the report.
    pub name: Option<String>,
    /// Most stars that the built-in tracker measures.
    pub stars: usize,
    /// Milliseconds that the built-in tracker thinks.
    pub delay_ms: f64,
    /// Milliseconds by which time tags of a tracker inside are late: a date error to be studied.
    pub tag_error_ms: f64,
    /// A program and its arguments: `{frames}` is the folder of images, `{log}` the log to write, `{camera}` the camera
    /// file.
    pub command: Vec<String>,
    /// Convention of the roll in the log of a program outside.
    pub roll: Option<Roll>,
    /// From the axes of a program outside to the sensor's.
    pub axes: Option<Axes>,
    /// Figures of the statistical tracker.
    pub model: Option<ModelFigures>,
}

impl Default for TrackerUnderTest {
    fn default() -> Self {
        Self {
            source: Source::BuiltIn,
            name: None,
            stars: 40,
            delay_ms: 50.0,
            tag_error_ms: 0.0,
            command: Vec::new(),
            roll: None,
            axes: None,
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

/// Largest amplitude of a sine of the line of sight.
const MOST_SINE_ARCSEC: f64 = 3600.0;
/// Nearest that twice a sine's frequency may be to a multiple of the frame rate, in frame rates.
const NEAREST_FOLD: f64 = 0.01;

impl Plan {
    /// Reads a plan, and what its keys say together that cannot be.
    ///
    /// # Errors
    /// With every key that cannot be read, is missing or out of range.
    pub fn read(path: &Path) -> Result<(Self, Vec<anyhow::Error>)> {
        let text = read_text(path, SETTINGS_BYTES).with_context(|| path.display().to_string())?;
        Self::parse(&text, path)
    }

    /// Reads a plan's text; `path` is what errors call it. Keys that contradict each other are returned beside the plan: a
    /// flight may find more.
    ///
    /// # Errors
    /// With every key that cannot be read, is missing or out of range.
    pub fn parse(text: &str, path: &Path) -> Result<(Self, Vec<anyhow::Error>)> {
        let checked = check_keys(FileKind::TestPlan, &Document::from_text(text, path));
        let read: Result<Self, _> = toml::from_str(text);
        match (checked, read) {
            (Ok(()), Ok(plan)) => {
                let errors = plan.errors();
                Ok((plan, errors))
            }
            (Ok(()), Err(error)) => Err(error).with_context(|| path.display().to_string()),
            (Err(error), Err(_)) => Err(error.into()),
            (Err(error), Ok(plan)) => {
                let errors: Vec<anyhow::Error> = core::iter::once(error.into()).chain(plan.errors()).collect();
                Err(refuse_all(&errors).err().unwrap_or_else(|| anyhow!("refused")))
            }
        }
    }

    /// Returns what keys say together that cannot be.
    fn errors(&self) -> Vec<anyhow::Error> {
        let mut errors = Vec::new();
        let mut note = |checked: Result<()>| errors.extend(checked.err());
        note(self.start().map(drop));
        note(check_effects(&self.set));
        for checked in self.tracker.checks() {
            note(checked);
        }
        for case in &self.cases {
            let checks = case.checks(self.frame_rate_hz).into_iter();
            checks.for_each(|checked| note(checked.with_context(|| format!("case \"{}\"", case.name))));
        }
        let mut names: Vec<String> = self.named_cases().into_iter().map(|(name, _)| folder_name(&name)).collect();
        names.sort();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            note(Err(anyhow!("two cases have the folder {}; wanted names that differ", pair[0])));
        }
        errors
    }

    /// Returns every case with its name and the value of its sweep.
    pub fn each(&self) -> impl Iterator<Item = (&PlanCase, (String, Option<f64>))> {
        self.cases.iter().flat_map(|case| case.each().into_iter().map(move |each| (case, each)))
    }

    /// Returns names and purposes of all cases.
    pub fn named_cases(&self) -> Vec<(String, Use)> {
        self.each().map(|(case, (name, _))| (name, case.purpose)).collect()
    }

    /// Returns the tracker's name in the report.
    pub fn tracker_name(&self) -> String {
        let file_name = |word: &String| Path::new(word).file_name().map(|name| name.to_string_lossy().into_owned());
        self.tracker.name.clone().unwrap_or_else(|| match self.tracker.source {
            Source::BuiltIn => "built-in tracker".to_owned(),
            Source::Model => "statistical tracker".to_owned(),
            Source::Program => {
                // The program and, of an interpreter, its script: no folders, placeholders or options.
                let words = self.tracker.command.iter().filter(|word| !word.starts_with(['{', '-']));
                words.filter_map(file_name).take(2).collect::<Vec<_>>().join(" ")
            }
        })
    }

    /// Returns the start of every case.
    ///
    /// # Errors
    /// When it is not a time.
    pub fn start(&self) -> Result<Tai> {
        Tai::from_rfc3339(&self.start_utc).context("start_utc")
    }

    /// Returns what numbers are said with.
    pub fn settings(&self) -> Settings {
        let usual = Settings::default();
        let FalseLimit { directional_arcsec, rotational_arcsec } = usual.false_limit;
        Settings {
            confidence: self.confidence.unwrap_or(usual.confidence),
            probability: self.probability.unwrap_or(usual.probability),
            false_limit: FalseLimit {
                directional_arcsec: self.false_directional_arcsec.unwrap_or(directional_arcsec),
                rotational_arcsec: self.false_rotational_arcsec.unwrap_or(rotational_arcsec),
            },
            exclusion_noise_arcsec: self.exclusion_noise_arcsec,
        }
    }
}

impl TrackerUnderTest {
    /// Returns what is stated about its logs.
    pub fn log_form(&self) -> LogForm {
        LogForm { roll: self.roll, axes: self.axes, is_unturned: false }
    }

    fn checks(&self) -> Vec<Result<()>> {
        let (is_program, is_model) = (self.source == Source::Program, self.source == Source::Model);
        let wanted =
            |is_good: bool, words: &'static str| if is_good { Ok(()) } else { Err(anyhow!("tracker: {words}")) };
        vec![
            wanted(is_program != self.command.is_empty(), "wanted command with source = \"program\", and only with it"),
            wanted(
                is_program || self.log_form() == LogForm::default(),
                "wanted roll and axes with source = \"program\" only",
            ),
            wanted(
                is_model == self.model.is_some(),
                "wanted [tracker.model] with source = \"model\", and only with it",
            ),
            self.model.as_ref().map_or(Ok(()), ModelFigures::check),
        ]
    }
}

/// Parts of a run file that no frame of a case depends on, and what is so instead.
const IDLE: [(&str, &str); 11] = [
    ("sink", TO_THE_TRACKER),
    ("extra_sink", TO_THE_TRACKER),
    ("extra_head", "no extra head: a case has one head, whose frames go to the tracker"),
    ("tracker_out", "no tracker_out: the log of a case is the tracker's"),
    ("name", "no name: a case is called as the plan calls it"),
    ("expect", "no expect: requirements of a plan are in its file `requirements`"),
    ("link", NO_BUS),
    ("extra_link", NO_BUS),
    ("session", NO_BUS),
    ("trigger_line", "no trigger line: a case is flown on the virtual clock"),
    ("budget", "no budget: a case is flown on the virtual clock, on which no frame is late"),
];
const TO_THE_TRACKER: &str = "no sink: the frames of a case go to the tracker, to a program as FITS files (--images adds \
                              PNGs, --keep-images keeps them)";
const NO_BUS: &str = "no bus: the attitudes of a case come from the plan";

/// Refuses values that would have no effect on what flies.
fn check_effects(settings: &[String]) -> Result<()> {
    let words = |set: &String| {
        let part = set.trim_start().split(['.', '[', '=', ' ']).next()?;
        IDLE.iter().find(|(idle, _)| *idle == part).map(|(_, words)| *words)
    };
    match settings.iter().find_map(|set| Some((set, words(set)?))) {
        None => Ok(()),
        Some((set, words)) => bail!("set: got \"{set}\", wanted {words}"),
    }
}

impl PlanCase {
    fn checks(&self, plan_rate_hz: f64) -> Vec<Result<()>> {
        vec![
            self.check_name(),
            self.check_motion(),
            self.check_sine(self.frame_rate_hz.unwrap_or(plan_rate_hz)),
            self.mounting_drift.map_or(Ok(()), |drift| drift.check()),
            self.check_sweep(),
            check_effects(&self.set),
        ]
    }

    fn check_name(&self) -> Result<()> {
        if folder_name(&self.name).trim_matches(['_', '.']).is_empty() {
            bail!("name: got \"{}\", wanted letters or digits", self.name);
        }
        Ok(())
    }

    fn check_motion(&self) -> Result<()> {
        let vectors = [self.rate_deg_s, self.acceleration_deg_s2].map(glam::DVec3::from_array);
        if vectors.iter().any(|vector| !(vector.is_finite() && vector.length() < 100.0)) {
            bail!("rate_deg_s, acceleration_deg_s2: wanted finite numbers below 100");
        }
        let [rate, acceleration] = vectors;
        if rate.cross(acceleration).length() > 1e-9 * rate.length() * acceleration.length() {
            bail!("acceleration_deg_s2: wanted one along the axis of rate_deg_s");
        }
        Ok(())
    }

    fn check_sweep(&self) -> Result<()> {
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

    /// Returns names and values of the cases of this entry.
    pub fn each(&self) -> Vec<(String, Option<f64>)> {
        match &self.sweep {
            None => vec![(self.name.clone(), None)],
            Some(sweep) => sweep.values.iter().map(|value| (format!("{} {value}", self.name), Some(*value))).collect(),
        }
    }

    /// Returns rate and acceleration with the sweep's value, rad/s and rad/s^2.
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
    pub(crate) fn sine(&self, value: Option<f64>) -> Option<Sine> {
        let scales = self.sweep.as_ref().map_or(Scales::Nothing, |sweep| sweep.scales);
        let factor = value.filter(|_| scales == Scales::Frequency).unwrap_or(1.0);
        let turn_rad = glam::DVec3::from_array(self.sine_arcsec) * ARCSEC;
        (turn_rad.length() > 0.0).then_some(Sine { turn_rad, hz: self.sine_hz * factor })
    }

    /// Returns all motion of the sensor with the sweep's value.
    pub(crate) fn whole_motion(&self, value: Option<f64>) -> CaseMotion {
        let [rate_rad_s, acceleration_rad_s2] = self.motion(value);
        CaseMotion { rate_rad_s, acceleration_rad_s2, sine: self.sine(value), drift: self.mounting_drift }
    }

    /// Returns the changed values of a run file, with the sweep's value in its place.
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
pub fn folder_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || "-.".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGIN: &str = "name = \"x\"\ncamera = \"c.toml\"\n";
    const CASE: &str = "[[case]]\nname = \"slew\"\nuse = \"slew\"\nframes = 3\n\
                        attitudes = { kind = \"fixed\", ra_deg = 1, dec_deg = 2 }\nrate_deg_s = [0, 1, 0]\n";

    fn parse(text: &str) -> Result<Plan> {
        let (plan, errors) = Plan::parse(text, Path::new("plan.toml"))?;
        refuse_all(&errors).map(|()| plan)
    }

    #[test]
    fn a_sweep_is_a_case_for_each_value() {
        let sweep = "set = [\"a.b={value}\"]\nsweep = { key = \"rate_deg_s\", scales = \"rate\", values = [0.5, 2] }\n";
        let plan = parse(&format!("{BEGIN}{CASE}{sweep}")).unwrap();
        let case = &plan.cases[0];
        let names: Vec<_> = case.each();
        assert_eq!(names, [("slew 0.5".to_owned(), Some(0.5)), ("slew 2".to_owned(), Some(2.0))]);
        assert!((case.motion(Some(2.0))[0].y - 2_f64.to_radians()).abs() < 1e-15);
        assert_eq!(case.settings(Some(2.0)), ["a.b=2.0"]);
    }

    #[test]
    fn plans_that_cannot_be_flown_are_refused() {
        let refused = |text: &str| format!("{:#}", parse(text).unwrap_err());
        assert!(refused(BEGIN).contains("case"));
        assert!(refused(&format!("{BEGIN}{CASE}{CASE}")).contains("names that differ"));
        for name in ["..", ".", "./.", "...", "_._"] {
            let case = CASE.replacen("\"slew\"", &format!("\"{name}\""), 1);
            assert!(refused(&format!("{BEGIN}{case}")).contains("wanted letters or digits"), "{name}");
        }
        assert!(parse(&format!("{BEGIN}{}", CASE.replacen("\"slew\"", "\"..a\"", 1))).is_ok(), "control");
        assert!(refused(&format!("{BEGIN}confidence = 2\n{CASE}")).contains("confidence is 2"));
        assert!(refused(&format!("{BEGIN}exclusion_noise_arcsec = 0\n{CASE}")).contains("exclusion_noise_arcsec"));
        assert!(refused(&format!("{BEGIN}{CASE}set = [\"a={{value}}\"]\n")).contains("without a sweep"));
        assert!(refused(&format!("{BEGIN}{CASE}acceleration_deg_s2 = [1, 0, 0]\n")).contains("along the axis"));
        assert!(refused(&format!("{BEGIN}{CASE}[tracker]\nsource = \"program\"\n")).contains("command"));
        let axes = "[tracker]\nroll = \"tetra3\"\naxes = \"-y -z x\"\n";
        assert!(refused(&format!("{BEGIN}{CASE}{axes}")).contains("roll and axes with source"));
        let program = format!("{BEGIN}{CASE}{axes}source = \"program\"\ncommand = [\"a\"]\n");
        assert_eq!(parse(&program).unwrap().tracker.roll, Some(Roll::North), "control");
        assert!(refused(&program.replace("-y -z x", "x y -z")).contains("right-handed"));
        assert!(refused(&program.replace("tetra3", "tetra")).contains("cedar-solve"));
        let png = format!("{BEGIN}set = [\"sink.png_every=1\"]\n{CASE}");
        assert!(refused(&png).contains("got \"sink.png_every=1\", wanted no sink"), "{}", refused(&png));
        let set = |key: &str| format!("{BEGIN}{CASE}set = [\"{key}\"]\n");
        for (part, words) in IDLE {
            for key in [format!("{part}.x=1"), format!("{part}[0].x=1"), format!("{part} = 1")] {
                assert!(refused(&set(&key)).contains(&format!("got \"{key}\", wanted {words}")), "{key}");
            }
            assert!(parse(&set(&format!("{part}s.x=1"))).is_ok(), "control: another key that begins so");
        }
        assert!(parse(&set("camera.exposure.exposure_s=0.1")).is_ok(), "control");
        assert!(refused(&format!("{BEGIN}{CASE}sine_arcsec = [9, 0, 0]\n")).contains("bandwidth"));
        let sine = CASE.replace("use = \"slew\"", "use = \"bandwidth\"");
        assert!(refused(&format!("{BEGIN}{sine}")).contains("sine_arcsec: wanted one"));
        assert!(refused(&format!("{BEGIN}{sine}sine_arcsec = [9, 0, 0]\n")).contains("no rate_deg_s"));
        let sine = sine.replace("rate_deg_s = [0, 1, 0]", "sine_arcsec = [9, 0, 0]");
        assert!(refused(&format!("{BEGIN}{sine}sine_hz = 7.5\n")).contains("multiple of half"));
        assert!(refused(&format!("{BEGIN}{sine}sine_hz = -1\n")).contains("sine_hz is -1"));
        let drift = "mounting_drift = { arcsec = [1, 2, 3], period_s = 0 }\n";
        assert!(refused(&format!("{BEGIN}{CASE}{drift}")).contains("period_s"));
    }

    #[test]
    fn everything_that_is_wrong_is_said_at_once() {
        let text = format!(
            "{BEGIN}confidence = 2\nstart_utc = \"soon\"\n{}[tracker]\ndelay_ms = -1\n",
            CASE.replace("= 3", "= 0")
        );
        let refused = format!("{:#}", parse(&text).unwrap_err());
        for wanted in ["plan.toml:3: confidence is 2", "start_utc", "case[0].frames is 0", "tracker.delay_ms is -1"] {
            assert!(refused.contains(wanted), "{wanted}: {refused}");
        }
        assert_eq!(refused.lines().count(), 4, "{refused}");
    }

    #[test]
    fn a_program_is_named_without_folders_and_placeholders() {
        let name = |keys: &str| {
            let plan = parse(&format!("{BEGIN}{CASE}[tracker]\nsource = \"program\"\n{keys}\n")).unwrap();
            plan.tracker_name()
        };
        let command = "command = [\"/usr/bin/python3\", \"-u\", \"/lab/my.py\", \"{frames}\", \"{log}\"]\n";
        assert_eq!(name(command), "python3 my.py");
        assert_eq!(name(&format!("name = \"ST-20\"\n{command}")), "ST-20");
    }

    #[test]
    fn a_sweep_may_be_of_the_sines_frequency() {
        let case = CASE.replace("use = \"slew\"", "use = \"bandwidth\"");
        let case = case.replace("rate_deg_s = [0, 1, 0]", "sine_arcsec = [30, 40, 0]");
        let sweep = "sweep = { key = \"sine_hz\", scales = \"frequency\", values = [0.7, 2.3] }\n";
        let plan = parse(&format!("{BEGIN}{case}{sweep}")).unwrap();
        let sine = plan.cases[0].sine(Some(2.3)).unwrap();
        assert!((sine.hz - 2.3).abs() < 1e-12 && (sine.turn_rad.length() - 50.0 * ARCSEC).abs() < 1e-15);
        assert!(parse(&format!("{BEGIN}{CASE}")).unwrap().cases[0].sine(None).is_none());
    }
}
