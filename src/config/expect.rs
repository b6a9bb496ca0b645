//! `[expect]`: what must come true for a run to have passed.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use serde::Deserialize;

/// Expectations, checked. What is `None` is not expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expect {
    /// Fine pointing is reached within this, s after the first exposure.
    pub fine_pointing_within_s: Option<f64>,
    /// The last so many seconds are judged.
    pub window_s: f64,
    /// Largest rms pointing error of the first head's boresight in the window, arcsec.
    pub pointing_arcsec: Option<f64>,
    /// Largest rms error of the estimated attitude in the window, arcsec.
    pub knowledge_arcsec: Option<f64>,
    /// Largest ratio of the rms pointing error to what linear theory predicts from the tracker's noise.
    pub pointing_over_predicted: Option<f64>,
    /// After the last fault has ended the loop points again within this, s.
    pub recovery_s: f64,
    /// Pointing again means an error below this, arcsec.
    pub recovered_arcsec: f64,
    /// The kept boresight never comes nearer to the Sun than this, deg.
    pub least_sun_angle_deg: Option<f64>,
    /// Mode at the end.
    pub final_mode: Option<&'static str>,
    /// Commands may be refused: they come at random.
    pub allows_refusals: bool,
    /// The control must fail: at the end it points nowhere near its target.
    pub diverges: bool,
    /// What is expected of the frames, with or without a vehicle.
    pub frames: ExpectFrames,
}

/// What is expected of the frames of a run; `None`: anything.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExpectFrames {
    /// Most frames that are late.
    pub late_at_most: Option<u32>,
    /// Most frames that are dropped.
    pub dropped_at_most: Option<u32>,
    /// Most frames that are blank.
    pub blank_at_most: Option<u32>,
    /// Fewest triggers that are fired.
    pub triggers_at_least: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ExpectKeys {
    fine_pointing_within_s: Option<f64>,
    window_s: Option<f64>,
    pointing_arcsec: Option<f64>,
    knowledge_arcsec: Option<f64>,
    pointing_over_predicted: Option<f64>,
    recovery_s: Option<f64>,
    recovered_arcsec: Option<f64>,
    least_sun_angle_deg: Option<f64>,
    final_mode: Option<String>,
    diverges: Option<bool>,
    late_frames_at_most: Option<i64>,
    dropped_frames_at_most: Option<i64>,
    blank_frames_at_most: Option<i64>,
    triggers_at_least: Option<i64>,
}

impl ExpectKeys {
    /// Keys that need a vehicle, and whether they are given.
    fn of_vehicle(&self) -> [(&'static str, bool); 10] {
        [
            ("fine_pointing_within_s", self.fine_pointing_within_s.is_some()),
            ("window_s", self.window_s.is_some()),
            ("pointing_arcsec", self.pointing_arcsec.is_some()),
            ("knowledge_arcsec", self.knowledge_arcsec.is_some()),
            ("pointing_over_predicted", self.pointing_over_predicted.is_some()),
            ("recovery_s", self.recovery_s.is_some()),
            ("recovered_arcsec", self.recovered_arcsec.is_some()),
            ("least_sun_angle_deg", self.least_sun_angle_deg.is_some()),
            ("final_mode", self.final_mode.is_some()),
            ("diverges", self.diverges.is_some()),
        ]
    }
}

impl ExpectFrames {
    fn check(keys: &ExpectKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let mut count = |name: &str, given: Option<i64>, advice: &str| {
            let key = format!("expect.{name}");
            given.map(|_| check.whole(&key, given, None, 0..=u32::MAX, advice)).transpose()
        };
        Ok(Self {
            late_at_most: count("late_frames_at_most", keys.late_frames_at_most, "frames of all heads together")?,
            dropped_at_most: count(
                "dropped_frames_at_most",
                keys.dropped_frames_at_most,
                "frames of all heads together, those that a fault drops included",
            )?,
            blank_at_most: count("blank_frames_at_most", keys.blank_frames_at_most, "frames of all heads together")?,
            triggers_at_least: count("triggers_at_least", keys.triggers_at_least, "triggers that were fired")?,
        })
    }
}

impl Expect {
    /// Checks what is expected of a run of this duration, in which a vehicle `is_flown` or not.
    pub(super) fn check(
        keys: &ExpectKeys,
        duration_s: f64,
        is_flown: bool,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let frames = ExpectFrames::check(keys, check)?;
        if !is_flown {
            for (name, is_given) in keys.of_vehicle() {
                check.unused(
                    &format!("expect.{name}"),
                    is_given,
                    "a run with a spacecraft, whose pointing it judges",
                )?;
            }
            let document = check.document;
            let expect = Self::check_flown(keys, duration_s, frames, &mut Checker::new(document))?;
            return Ok(expect);
        }
        Self::check_flown(keys, duration_s, frames, check)
    }

    fn check_flown(
        keys: &ExpectKeys,
        duration_s: f64,
        frames: ExpectFrames,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let modes = [
            ("any", None),
            ("fine_pointing", Some("fine_pointing")),
            ("coarse_pointing", Some("coarse_pointing")),
            ("rate_damping", Some("rate_damping")),
            ("slew", Some("slew")),
            ("safe", Some("safe")),
        ];
        let advice = "the flight computer's mode when the run ends";
        let final_mode = check.choice("expect.final_mode", keys.final_mode.as_deref(), &modes, advice)?;
        let window_s = window_s(keys.window_s, duration_s, check)?;
        let again = "seconds after the end of a fault";
        let recovery_s = check.number("expect.recovery_s", keys.recovery_s, 120.0, Rule::Positive, again)?;
        let near = "arcseconds off target that count as pointing again";
        let recovered_arcsec =
            check.number("expect.recovered_arcsec", keys.recovered_arcsec, 120.0, Rule::Positive, near)?;
        let positive = |name: &str, given: Option<f64>, advice: &str| {
            given.map(|value| check.meets(&format!("expect.{name}"), value, Rule::Positive, advice)).transpose()
        };
        Ok(Self {
            fine_pointing_within_s: positive("fine_pointing_within_s", keys.fine_pointing_within_s, "seconds")?,
            window_s,
            pointing_arcsec: positive("pointing_arcsec", keys.pointing_arcsec, "arcseconds rms")?,
            knowledge_arcsec: positive("knowledge_arcsec", keys.knowledge_arcsec, "arcseconds rms")?,
            pointing_over_predicted: positive("pointing_over_predicted", keys.pointing_over_predicted, "such as 1.5")?,
            recovery_s,
            recovered_arcsec,
            least_sun_angle_deg: positive("least_sun_angle_deg", keys.least_sun_angle_deg, "degrees")?,
            final_mode,
            allows_refusals: false,
            diverges: keys.diverges.unwrap_or(false),
            frames,
        })
    }
}

/// The judged end of the run: at most the whole of it, by default its last quarter.
fn window_s(given: Option<f64>, duration_s: f64, check: &mut Checker<'_>) -> Result<f64, ConfigError> {
    let advice = format!("seconds at the end of the run that are judged, and the run lasts {duration_s} s");
    check.number("expect.window_s", given, 0.25 * duration_s, Rule::PositiveUpTo(duration_s), &advice)
}
