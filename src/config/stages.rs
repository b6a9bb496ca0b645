//! `[attitude]`, `[accuracy]`, `[render]`: how the stimulator does its work.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::accuracy::AccuracyBudget;
use base::time::Span;
use plan::attitude::{EstimateLimits, HistoryLimits, RemoteClockLimits, StalePolicy};
use plan::exposure::MethodChoice;
use serde::Deserialize;

/// Seconds of samples kept beyond the exposure and the oldest tag.
const HISTORY_MARGIN_S: f64 = 1.0;

/// Parameters of `plan::attitude`, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeSettings {
    /// Prediction and the policy for a stopped stream.
    pub estimate: EstimateLimits,
    /// The history of attitudes; its capacity covers the exposure and the oldest tag at the attitude rate.
    pub history: HistoryLimits,
    /// The history of received jitter, likewise.
    pub jitter_history: HistoryLimits,
    /// Jitter points further than this outside an exposure are not used for it.
    pub jitter_max_gap: Span,
    /// A frame may wait so long for jitter samples that are under way.
    pub jitter_wait: Span,
    /// What is shown on the real clock when the stream has stopped; `estimate` has that of the virtual clock.
    pub policy_on_real_clock: StalePolicy,
    /// Time correlation.
    pub clock: RemoteClockLimits,
}

/// Which implementation renders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// The GPU when there is one, else the CPU.
    Auto,
    /// The GPU, or an error.
    Gpu,
    /// The CPU.
    Cpu,
    /// The slow one that is right.
    Reference,
}

/// Rendering, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Render {
    /// Which implementation.
    pub backend: Backend,
    /// Which method.
    pub method: MethodChoice,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AttitudeKeys {
    stale_after_ms: Option<f64>,
    stale_policy: Option<String>,
    max_horizon_ms: Option<f64>,
    rate_decay_ms: Option<f64>,
    jitter_wait_ms: Option<f64>,
    max_age_ms: Option<f64>,
    max_lead_ms: Option<f64>,
    pub(super) link_delay_us: Option<f64>,
    clock_window_s: Option<f64>,
    clock_step_ms: Option<f64>,
    clock_max_drift_ppm: Option<f64>,
    clock_allan_1s: Option<f64>,
    pps_sigma_us: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AccuracyKeys {
    centroid_px: Option<f64>,
    flux_rel: Option<f64>,
    pixel_sigma: Option<f64>,
    los_arcsec: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RenderKeys {
    backend: Option<String>,
    method: Option<String>,
}

impl AttitudeSettings {
    /// `attitude_hz`, `jitter_hz` and `exposure_s` size the histories.
    pub(super) fn check(
        keys: &AttitudeKeys,
        attitude_hz: f64,
        jitter_hz: f64,
        exposure_s: f64,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let [policy, policy_on_real_clock] = stale_policies(keys, check)?;
        let mut ms = |key: &str, given, default, advice| {
            let rule = Rule::Within(0.0, 3_600_000.0);
            check.number(&format!("attitude.{key}"), given, default, rule, advice).map(|ms| Span::from_s(ms * 1e-3))
        };
        let period_ms = 1000.0 / attitude_hz;
        let stale = "milliseconds without a new attitude after which stale_policy applies, such as 500";
        let stale_after = ms("stale_after_ms", keys.stale_after_ms, 500_f64.max(5.0 * period_ms), stale)?;
        let horizon = "milliseconds over which the angular acceleration is used to predict, such as 200";
        let max_horizon = ms("max_horizon_ms", keys.max_horizon_ms, 200.0, horizon)?;
        let wait = "milliseconds that a frame may wait for jitter samples that are under way, such as 20";
        let jitter_wait = ms("jitter_wait_ms", keys.jitter_wait_ms, 20.0, wait)?;
        let decay = "time constant in milliseconds with which a held rate decays; 0 stops at once";
        let rate_decay = ms("rate_decay_ms", keys.rate_decay_ms, 200.0, decay)?;
        let age = "oldest time tag accepted, milliseconds before its arrival, such as 1000";
        let max_age = ms("max_age_ms", keys.max_age_ms, 1000.0, age)?;
        let lead = "latest time tag accepted, milliseconds after its arrival, such as 100";
        let max_lead = ms("max_lead_ms", keys.max_lead_ms, 100.0, lead)?;
        if stale_after.ms() <= period_ms {
            let wanted = format!("more than {period_ms} (one period of flight_computer.attitude_hz)");
            let advice = "a limit of several periods rides over a lost message";
            return Err(check.invalid("attitude.stale_after_ms", stale_after.ms(), wanted, advice));
        }
        let clock = check_clock(keys, check)?;
        let limits = |rate_hz: f64| HistoryLimits {
            capacity: capacity(rate_hz, exposure_s + max_age.s() + HISTORY_MARGIN_S),
            max_age,
            max_lead,
        };
        Ok(Self {
            estimate: EstimateLimits { stale_after, policy, max_horizon, rate_decay },
            history: limits(attitude_hz),
            jitter_history: limits(jitter_hz),
            jitter_max_gap: Span::from_ms(100),
            jitter_wait,
            policy_on_real_clock,
            clock,
        })
    }
}

/// Returns what is shown when the stream has stopped, on the virtual clock and on the real one. Without the key a simulated run
/// goes on from the last attitude, while one with hardware sends no frame: a tracker must not see a sky that stands still.
fn stale_policies(keys: &AttitudeKeys, check: &mut Checker<'_>) -> Result<[StalePolicy; 2], ConfigError> {
    let policies = [
        ("drop", StalePolicy::Drop),
        ("hold", StalePolicy::Hold),
        ("blank", StalePolicy::Blank),
        ("stop", StalePolicy::Stop),
    ];
    let advice = "drop sends no frame, hold goes on from the last attitude, blank shows no stars, stop ends the run; without \
                  the key: drop on the real clock, hold on the virtual one";
    let policy = check.choice("attitude.stale_policy", keys.stale_policy.as_deref(), &policies, advice)?;
    Ok(if keys.stale_policy.is_some() { [policy; 2] } else { [StalePolicy::Hold, StalePolicy::Drop] })
}

/// Time correlation: what the link and the remote clock are like.
fn check_clock(keys: &AttitudeKeys, check: &mut Checker<'_>) -> Result<RemoteClockLimits, ConfigError> {
    let usual = RemoteClockLimits::default();
    let mut number = |key: &str, given, default, rule, advice| {
        check.number(&format!("attitude.{key}"), given, default, rule, advice)
    };
    let delay = "calibrated microseconds from transmission to the receive stamp; 0 when unknown";
    let delay_us = number("link_delay_us", keys.link_delay_us, 0.0, Rule::Within(-1e6, 1e6), delay)?;
    let window = "seconds of time marks that offset and drift are drawn from, such as 30";
    let window_s = number("clock_window_s", keys.clock_window_s, usual.window.s(), Rule::Within(2.0, 600.0), window)?;
    let step = "milliseconds by which a time mark must be off to be a step of a clock, such as 250";
    let step_ms = number("clock_step_ms", keys.clock_step_ms, usual.step.ms(), Rule::Within(1.0, 60_000.0), step)?;
    let drift = "parts per million that a clock may be off, such as 200; more is no clock's drift";
    let most_ppm = usual.most_drift * 1e6;
    let most_ppm =
        number("clock_max_drift_ppm", keys.clock_max_drift_ppm, most_ppm, Rule::Within(1.0, 10_000.0), drift)?;
    let allan = "Allan deviation of the flight computer's oscillator at 1 s, such as 5e-9";
    let allan_1s = number("clock_allan_1s", keys.clock_allan_1s, usual.allan_1s, Rule::Within(1e-13, 1e-5), allan)?;
    let pps = "microseconds, one sigma, of the stamps of pulses per second, such as 1";
    let pps_us = usual.pps_sigma.s() * 1e6;
    let pps_us = number("pps_sigma_us", keys.pps_sigma_us, pps_us, Rule::Within(1e-3, 1000.0), pps)?;
    Ok(RemoteClockLimits {
        window: Span::from_s(window_s),
        constant_delay: Span::from_s(delay_us * 1e-6),
        step: Span::from_s(step_ms * 1e-3),
        most_drift: most_ppm * 1e-6,
        allan_1s,
        pps_sigma: Span::from_s(pps_us * 1e-6),
    })
}

/// Samples at a rate over a time, 64 at least; the rates and times are checked, so 10^6 is a limit on memory only.
fn capacity(rate_hz: f64, time_s: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped first")]
    let capacity = (rate_hz * time_s).ceil().clamp(64.0, 1e6) as usize;
    capacity
}

pub(super) fn check_accuracy(keys: &AccuracyKeys, check: &mut Checker<'_>) -> Result<AccuracyBudget, ConfigError> {
    let usual = AccuracyBudget::default();
    let mut bound = |key: &str, given, default, advice| {
        check.number(&format!("accuracy.{key}"), given, default, Rule::Positive, advice)
    };
    Ok(AccuracyBudget {
        centroid_px: bound("centroid_px", keys.centroid_px, usual.centroid_px, "pixels, such as 0.002")?,
        flux_rel: bound("flux_rel", keys.flux_rel, usual.flux_rel, "a fraction, such as 0.001")?,
        pixel_sigma: bound("pixel_sigma", keys.pixel_sigma, usual.pixel_sigma, "of the pixel's noise, such as 0.1")?,
        los_arcsec: bound("los_arcsec", keys.los_arcsec, usual.los_arcsec, "arcseconds, such as 0.1")?,
    })
}

impl Render {
    pub(super) fn check(keys: &RenderKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let backends =
            [("auto", Backend::Auto), ("gpu", Backend::Gpu), ("cpu", Backend::Cpu), ("reference", Backend::Reference)];
        let advice = "auto is right for most benches";
        Ok(Self {
            backend: check.choice("render.backend", keys.backend.as_deref(), &backends, advice)?,
            method: check_method(keys.method.as_deref(), check)?,
        })
    }
}

fn check_method(given: Option<&str>, check: &mut Checker<'_>) -> Result<MethodChoice, ConfigError> {
    let word = check.given_or("render.method", given.map(str::to_owned), "auto".to_owned());
    word.parse().map_err(|_| {
        let wanted = "auto, static, gauss-legendre, effective-psf or samples, with :N for a number of nodes";
        check.invalid("render.method", format!("\"{word}\""), wanted, "auto is right for most benches")
    })
}
