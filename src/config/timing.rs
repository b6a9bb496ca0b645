//! `[timing]`: frames, duration, the simulated start.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::time::{Span, Tai};
use plan::exposure::Rung;
use serde::Deserialize;

const DEFAULT_START_UTC: &str = "2026-03-01T00:00:00Z";

/// What happens to a frame that is not ready when it is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadlinePolicy {
    /// The last frame is sent again.
    Hold,
    /// No frame is sent.
    Drop,
    /// The frame is sent late.
    Late,
}

/// When frames that would not be ready in time are degraded, rung by rung.
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
    /// Whether it applies to a run on the real (or else the virtual) clock.
    #[must_use]
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
    pub degrade_to: Rung,
    /// Sky time at the start.
    pub start: StartTime,
    /// By how much exposures begin after the whole frame periods of the run.
    pub phase: Span,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TimingKeys {
    frame_rate_hz: Option<f64>,
    duration_s: Option<f64>,
    ahead_ms: Option<f64>,
    deadline_policy: Option<String>,
    degrade: Option<String>,
    degrade_to: Option<String>,
    start_utc: Option<String>,
    phase_ms: Option<f64>,
}

/// Later starts of exposures than this are a mistake, ms.
const PHASE_MAX_MS: f64 = 60_000.0;

impl Timing {
    /// `exposure_s`: of the camera; `None` where a frame is one refresh of a calibrated display.
    pub(super) fn check(
        keys: &TimingKeys,
        exposure_s: Option<f64>,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let frame_rate_hz = check.given_or("timing.frame_rate_hz", keys.frame_rate_hz, 10.0);
        check_frame_rate("timing.frame_rate_hz", frame_rate_hz, exposure_s, check)?;
        let length = "length of the run in seconds";
        let duration_s = check.number("timing.duration_s", keys.duration_s, 10.0, Rule::PositiveUpTo(1e7), length)?;
        let policies = [("drop", DeadlinePolicy::Drop), ("hold", DeadlinePolicy::Hold), ("late", DeadlinePolicy::Late)];
        let advice = "drop leaves a gap, hold repeats the last frame, late sends it when it is ready";
        let deadline_policy =
            check.choice("timing.deadline_policy", keys.deadline_policy.as_deref(), &policies, advice)?;
        let degrades = [("real_clock", Degrade::OnRealClock), ("always", Degrade::Always), ("never", Degrade::Never)];
        let advice = "real_clock degrades frames that would be late, always does so on the virtual clock too";
        let degrade = check.choice("timing.degrade", keys.degrade.as_deref(), &degrades, advice)?;
        let degrade_to = degrade_to(keys, check)?;
        check.unused(
            "timing.ahead_ms",
            keys.ahead_ms.is_some() && exposure_s.is_none(),
            "a run that is not drawn for a calibrated display, whose refresh and latency say how early frames are begun",
        )?;
        let advice = "0 for a sensor that reads out when it has exposed; for a display without calibration: exposure, drawing and \
             its latency";
        let ahead_ms = check.number("timing.ahead_ms", keys.ahead_ms, 0.0, Rule::Within(0.0, 500.0), advice)?;
        let start = start(keys, check)?;
        let phase = phase("timing.phase_ms", keys.phase_ms, check)?;
        Ok(Self { frame_rate_hz, duration_s, ahead_ms, deadline_policy, degrade, degrade_to, start, phase })
    }

    /// Frames in the run (at least one).
    #[must_use]
    pub fn frames(&self) -> u64 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: 0 to 1e11")]
        let frames = (self.duration_s * self.frame_rate_hz + 1e-9).floor() as u64;
        frames.max(1)
    }
}

/// Refuses a frame rate that is none, or at which an exposure would not end before the next begins.
pub(super) fn check_frame_rate(
    key: &str,
    frame_rate_hz: f64,
    exposure_s: Option<f64>,
    check: &Checker<'_>,
) -> Result<(), ConfigError> {
    check.meets(key, frame_rate_hz, Rule::PositiveUpTo(10_000.0), "frames per second, such as 10.0")?;
    let longer = exposure_s.filter(|exposure_s| exposure_s * frame_rate_hz > 1.0 + f64::EPSILON);
    let Some(exposure_s) = longer else { return Ok(()) };
    let wanted = format!("at most {:.6} (one exposure of {exposure_s} s per frame)", 1.0 / exposure_s);
    let advice = "lower the frame rate, or shorten exposure.exposure_s of the camera";
    Err(check.invalid(key, frame_rate_hz, wanted, advice))
}

/// Returns by how much exposures begin after the whole frame periods of the run; 0 when nothing is given.
pub(super) fn phase(key: &str, given: Option<f64>, check: &Checker<'_>) -> Result<Span, ConfigError> {
    let Some(phase_ms) = given else { return Ok(Span::ZERO) };
    let advice = "milliseconds after the run's first exposure at which this head begins its own";
    Ok(Span::from_s(1e-3 * check.meets(key, phase_ms, Rule::Within(0.0, PHASE_MAX_MS), advice)?))
}

/// Returns the last level of degradation: by default the last one whose frames still show motion and every star that can be seen.
fn degrade_to(keys: &TimingKeys, check: &mut Checker<'_>) -> Result<Rung, ConfigError> {
    let rungs = [Rung::Budget10, Rung::FaintStarsOut, Rung::Budget3, Rung::MotionOut, Rung::BrightStarsOnly];
    let advice = "the last step that is taken: motion-out and bright-stars-only give frames that no sensor would see";
    check.choice("timing.degrade_to", keys.degrade_to.as_deref(), &rungs.map(|rung| (rung.name(), rung)), advice)
}

fn start(keys: &TimingKeys, check: &mut Checker<'_>) -> Result<StartTime, ConfigError> {
    let text = check.given_or("timing.start_utc", keys.start_utc.clone(), DEFAULT_START_UTC.into());
    if text.trim() == "now" {
        return Ok(StartTime::Now);
    }
    let refuse = |error: base::time::TimeError| {
        check.invalid("timing.start_utc", format!("\"{text}\""), "RFC 3339 or \"now\"", &error.to_string())
    };
    Tai::from_rfc3339(&text).map(StartTime::At).map_err(refuse)
}
