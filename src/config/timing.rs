//! `[timing]`: frames, duration, the simulated start.

use crate::key::{Given, Section, section, taken};
use crate::{check::Checker, error::Result, key_type::Word};
use base::time::{Span, Tai};
use plan::exposure::Degradation;

/// Treatment of a frame that is not ready when it is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadlinePolicy {
    /// The previous image is sent again in its place.
    Hold,
    /// No frame is sent.
    Drop,
    /// The frame is sent late.
    Late,
}

/// When frames that would not be ready in time are drawn at a degraded level, one level at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Degrade {
    /// On the real clock only: there alone does drawing take time.
    OnRealClock,
    /// On the virtual clock too, by the built-in costs: the same frames on every machine.
    Always,
    /// Never: frames are late instead.
    Never,
}

impl Degrade {
    /// Returns whether it applies to a run on the real (or else the virtual) clock.
    pub fn applies(self, on_real_clock: bool) -> bool {
        match self {
            Self::OnRealClock => on_real_clock,
            Self::Always => true,
            Self::Never => false,
        }
    }
}

/// Sky time at which the run begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartTime {
    /// A given instant.
    At(Tai),
    /// The clock's own time (not repeatable).
    Now,
    /// The time of the plant's first message.
    Plant,
}

/// Timing of a run, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Length of the run, s.
    pub duration_s: f64,
    /// How long before their exposures end frames are begun, ms.
    pub ahead_ms: f64,
    /// Late frames.
    pub deadline_policy: DeadlinePolicy,
    /// Frames that would be late.
    pub degrade: Degrade,
    /// The last level of degradation that may be taken.
    pub degrade_to: Degradation,
    /// Sky time at the start.
    pub start: StartTime,
    /// By how much exposures begin after the whole frame periods of the run.
    pub phase: Span,
}

section! {
    /// Frames, duration and the simulated start.
    TimingKeys at "timing" {
        /// Frames per second, such as 10.0.
        frame_rate_hz: f64 = 10.0, PositiveUpTo(10_000.0);
        /// Length of the run in seconds.
        duration_s: f64 = 10.0, PositiveUpTo(1e7);
        /// How long before their exposures end frames are begun: 0 for a sensor that reads out when it has exposed; for
        /// a display without calibration: exposure, drawing and its latency.
        ahead_ms: f64 = 0.0, Within(0.0, 500.0);
        /// Late frames: drop leaves a gap, hold repeats the last frame, late sends it when it is ready.
        deadline_policy: Word<DeadlinePolicy> = "drop",
            [("drop", DeadlinePolicy::Drop), ("hold", DeadlinePolicy::Hold), ("late", DeadlinePolicy::Late)];
        /// Real_clock degrades frames that would be late, always does so on the virtual clock too.
        degrade: Word<Degrade> = "real_clock",
            [("real_clock", Degrade::OnRealClock), ("always", Degrade::Always), ("never", Degrade::Never)];
        /// The last step that is taken: motion-out and bright-stars-only give frames that no sensor would see.
        degrade_to: Word<Degradation> = DEGRADATIONS[0].name(), DEGRADATIONS.map(|degradation| (degradation.name(), degradation));
        /// When the clock starts, 1 s before the first exposure: RFC 3339, "now" (the machine's time), which no run
        /// repeats, or "plant" (the first message of 42, on the virtual clock).
        start_utc: String = "2026-03-01T00:00:00Z", "time, \"now\" or \"plant\"";
        /// Milliseconds after the run's first exposure at which this head begins its own.
        phase_ms: f64 = Silent(0.0), Within(0.0, PHASE_MAX_MS);
    }
}

/// Steps of degradation that a file may name.
const DEGRADATIONS: [Degradation; 5] = [
    Degradation::Budget10,
    Degradation::FaintStarsOut,
    Degradation::Budget3,
    Degradation::MotionOut,
    Degradation::BrightStarsOnly,
];
/// Later starts of exposures than this are a mistake, ms.
pub(super) const PHASE_MAX_MS: f64 = 60_000.0;

impl Timing {
    /// Checks the keys. `exposure_s` is the camera's; `None` where a frame is one refresh of a calibrated display.
    pub(super) fn check(keys: &TimingKeys, exposure_s: Option<f64>, check: &mut Checker<'_>) -> Result<Self> {
        let frame_rate_hz = check_frame_rate(keys.frame_rate_hz(), exposure_s, check)?;
        taken!(check, keys => duration_s, deadline_policy, degrade, degrade_to);
        if exposure_s.is_none() {
            let owner = "a run that is not drawn for a calibrated display, whose refresh and latency say how early \
                         frames are begun";
            keys.refuse(&["ahead_ms"], owner, check)?;
        }
        let ahead_ms = keys.ahead_ms().check(check)?;
        let start = start(keys, check)?;
        let phase = keys.phase_ms().ms(check)?;
        Ok(Self { frame_rate_hz, duration_s, ahead_ms, deadline_policy, degrade, degrade_to, start, phase })
    }

    /// Returns frames in the run (at least one).
    pub fn frames(&self) -> u64 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: 0 to 1e11")]
        let frames = (self.duration_s * self.frame_rate_hz + 1e-9).floor() as u64;
        frames.max(1)
    }
}

/// Reads a frame rate; refuses one at which an exposure would not end before the next begins.
pub(super) fn check_frame_rate(given: Given<'_, f64>, exposure_s: Option<f64>, check: &mut Checker<'_>) -> Result<f64> {
    let key = given.key();
    let frame_rate_hz = given.check(check)?;
    let longer = exposure_s.filter(|exposure_s| exposure_s * frame_rate_hz > 1.0 + f64::EPSILON);
    let Some(exposure_s) = longer else { return Ok(frame_rate_hz) };
    let wanted = format!("at most {:.6} (one exposure of {exposure_s} s per frame)", 1.0 / exposure_s);
    let advice = "lower the frame rate, or shorten exposure.exposure_s of the camera";
    Err(check.invalid(&key, frame_rate_hz, wanted, advice))
}

fn start(keys: &TimingKeys, check: &mut Checker<'_>) -> Result<StartTime> {
    let text = keys.start_utc().check(check)?;
    if text.trim() == "now" {
        return Ok(StartTime::Now);
    }
    if text.trim() == "plant" {
        return Ok(StartTime::Plant);
    }
    Tai::from_rfc3339(&text).map(StartTime::At).map_err(|error| {
        keys.start_utc().advised(error.to_string()).invalid(
            format!("\"{text}\""),
            "RFC 3339, \"now\" or \"plant\"",
            check,
        )
    })
}
