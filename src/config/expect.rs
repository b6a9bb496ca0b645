//! `[expect]`: what must come true for a run to have passed.

use crate::check::{Checker, Rule};
use crate::error::Result;
use crate::key::{Section, section, taken};
use crate::key_type::{Any, Whole, Word};
use core::ops::RangeInclusive;
use frames::report::RunLimits;

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
    /// Expectations of the frames, with or without a vehicle.
    pub frames: ExpectFrames,
}

/// Expectations of the frames of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExpectFrames {
    /// Most frames that may be late, missing, blank or held, and losses of links.
    pub limits: RunLimits,
    /// Fewest triggers that are fired.
    pub triggers_at_least: Option<u32>,
}

section! {
    /// Conditions that must be met for a run to pass.
    ExpectKeys at "expect" {
        /// Fine pointing is reached within so many seconds after the first exposure.
        fine_pointing_within_s: f64 = Optional, Positive;
        /// Seconds at the end of the run that are judged.
        window_s: f64 = Computed("a quarter of the run"), Positive;
        /// Largest rms pointing error of the first head's boresight in the window, arcseconds rms.
        pointing_arcsec: f64 = Optional, Positive;
        /// Largest rms error of the estimated attitude in the window, arcseconds rms.
        knowledge_arcsec: f64 = Optional, Positive;
        /// Largest ratio of the rms pointing error to what theory predicts from the tracker's noise, such as 1.5.
        pointing_over_predicted: f64 = Optional, Positive;
        /// Seconds after the end of a fault within which the loop points again.
        recovery_s: f64 = 120.0, Positive;
        /// Arcseconds off target that count as pointing again.
        recovered_arcsec: f64 = 120.0, Positive;
        /// The kept boresight never comes nearer to the Sun than so many degrees.
        least_sun_angle_deg: f64 = Optional, Positive;
        /// The flight computer's mode when the run ends.
        final_mode: Word<Option<&'static str>> = "any", [
            ("any", None), ("fine_pointing", Some("fine_pointing")), ("coarse_pointing", Some("coarse_pointing")),
            ("rate_damping", Some("rate_damping")), ("slew", Some("slew")), ("safe", Some("safe")),
        ];
        /// The control must fail: at the end it points nowhere near its target.
        diverges: bool = Silent(false), Any;
        /// Most late frames of all heads together. Without this limit and those below, a run with any such frame is not ok.
        late_frames_at_most: Whole = Optional, COUNT;
        /// Most dropped frames of all heads together, those that a fault drops included.
        dropped_frames_at_most: Whole = Optional, COUNT;
        /// Most blank frames of all heads together; with blank_frames_at_start_at_most, without those at the start.
        blank_frames_at_most: Whole = Optional, COUNT;
        /// Most frames that are blank at the start, before the first attitude or RUN comes.
        blank_frames_at_start_at_most: Whole = Optional, COUNT;
        /// Most frames that show a held attitude: no new one came in time.
        held_attitude_frames_at_most: Whole = Optional, COUNT;
        /// Most frames that are never exposed, such as when a client slows the camera down or it waits for triggers.
        not_exposed_frames_at_most: Whole = Optional, COUNT;
        /// Most frames without a part of their jitter samples.
        jitter_missing_frames_at_most: Whole = Optional, COUNT;
        /// Most losses of a link, such as an unplugged adapter.
        links_lost_at_most: Whole = Optional, COUNT;
        /// Most times that packets are lost on a link, in a full queue or unsent.
        packets_lost_at_most: Whole = Optional, COUNT;
        /// Most answers of star trackers outside that come after their late_after_ms.
        late_answers_at_most: Whole = Optional, COUNT;
        /// Most frames that star trackers outside do not answer.
        missing_answers_at_most: Whole = Optional, COUNT;
        /// Fewest triggers that are fired.
        triggers_at_least: Whole = Optional, COUNT;
    }
}

const COUNT: RangeInclusive<i64> = 0..=u32::MAX as i64;

/// Keys that need a vehicle.
const OF_VEHICLE: [&str; 10] = [
    "fine_pointing_within_s",
    "window_s",
    "pointing_arcsec",
    "knowledge_arcsec",
    "pointing_over_predicted",
    "recovery_s",
    "recovered_arcsec",
    "least_sun_angle_deg",
    "final_mode",
    "diverges",
];

impl ExpectFrames {
    fn check(keys: &ExpectKeys, check: &Checker<'_>) -> Result<Self> {
        Ok(Self {
            limits: RunLimits {
                late: keys.late_frames_at_most().optional(check)?,
                dropped: keys.dropped_frames_at_most().optional(check)?,
                blank_at_start: keys.blank_frames_at_start_at_most().optional(check)?,
                blank: keys.blank_frames_at_most().optional(check)?,
                attitude_held: keys.held_attitude_frames_at_most().optional(check)?,
                not_exposed: keys.not_exposed_frames_at_most().optional(check)?,
                links_lost: keys.links_lost_at_most().optional(check)?,
                packets_lost: keys.packets_lost_at_most().optional(check)?,
                jitter_missing: keys.jitter_missing_frames_at_most().optional(check)?,
                answers_late: keys.late_answers_at_most().optional(check)?,
                answers_missing: keys.missing_answers_at_most().optional(check)?,
            },
            triggers_at_least: keys.triggers_at_least().optional(check)?,
        })
    }
}

impl Expect {
    /// Checks what is expected of a run of this duration, in which a vehicle `is_flown` or not.
    pub(super) fn check(keys: &ExpectKeys, duration_s: f64, is_flown: bool, check: &mut Checker<'_>) -> Result<Self> {
        let frames = ExpectFrames::check(keys, check)?;
        if !is_flown {
            keys.refuse(&OF_VEHICLE, "a run with a spacecraft, whose pointing it judges", check)?;
            let document = check.document;
            let expect = Self::check_flown(keys, duration_s, frames, &mut Checker::new(document))?;
            return Ok(expect);
        }
        Self::check_flown(keys, duration_s, frames, check)
    }

    fn check_flown(keys: &ExpectKeys, duration_s: f64, frames: ExpectFrames, check: &mut Checker<'_>) -> Result<Self> {
        let final_mode = keys.final_mode().check(check)?;
        let judged = format!("seconds at the end of the run that are judged, and the run lasts {duration_s} s");
        let window = keys.window_s().or(0.25 * duration_s).within(Rule::PositiveUpTo(duration_s)).advised(judged);
        let window_s = window.check(check)?;
        let mut within = keys.fine_pointing_within_s();
        if !check.document.has_settings() {
            // A setting may cut a run short.
            let reached = format!("seconds after the first exposure, and the run lasts {duration_s} s");
            within = within.within(Rule::PositiveUpTo(duration_s)).advised(reached);
        }
        taken!(check, keys => recovery_s, recovered_arcsec, diverges);
        Ok(Self {
            fine_pointing_within_s: within.optional(check)?,
            window_s,
            pointing_arcsec: keys.pointing_arcsec().optional(check)?,
            knowledge_arcsec: keys.knowledge_arcsec().optional(check)?,
            pointing_over_predicted: keys.pointing_over_predicted().optional(check)?,
            recovery_s,
            recovered_arcsec,
            least_sun_angle_deg: keys.least_sun_angle_deg().optional(check)?,
            final_mode,
            allows_refusals: false,
            diverges,
            frames,
        })
    }
}
