//! `[attitude]`, `[accuracy]`, `[render]`: how the stimulator does its work.

use crate::key::{section, taken};
use crate::{check::Checker, error::Result, key_type::Word};
use base::{accuracy::AccuracyBudget, time::Span};
use frames::camera_control::longest_exposure_s;
use plan::attitude::{EstimateLimits, HistoryLimits, RemoteClockLimits, StalePolicy};
use plan::exposure::MethodChoice;

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
    /// Frames shown on the real clock when the stream has stopped; `estimate` has the policy of the virtual clock.
    pub policy_on_real_clock: StalePolicy,
    /// Time correlation.
    pub clock: RemoteClockLimits,
}

/// Which implementation renders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// A hardware GPU when there is one, else the CPU.
    Auto,
    /// The GPU (software Vulkan counts), or an error.
    Gpu,
    /// The CPU.
    Cpu,
    /// The f64 reference.
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

section! {
    /// History, prediction and time correlation of attitudes.
    AttitudeKeys at "attitude" {
        /// Milliseconds without a new attitude after which stale_policy applies, such as 500.
        stale_after_ms: f64 = Computed("500, or five periods of flight_computer.attitude_hz"), Within(0.0, MOST_MS);
        /// Drop sends no frame, hold goes on from the last attitude, blank shows no stars, stop ends the run; without
        /// the key: drop on the real clock, hold on the virtual one.
        stale_policy: Word<StalePolicy> = "drop", [
            ("drop", StalePolicy::Drop), ("hold", StalePolicy::Hold),
            ("blank", StalePolicy::Blank), ("stop", StalePolicy::Stop),
        ];
        /// Milliseconds over which the angular acceleration is used to predict, such as 200.
        max_horizon_ms: f64 = 200.0, Within(0.0, MOST_MS);
        /// Milliseconds that a frame may wait for jitter samples that are under way, such as 20.
        jitter_wait_ms: f64 = 20.0, Within(0.0, MOST_MS);
        /// Time constant in milliseconds with which a held rate decays; 0 stops at once.
        rate_decay_ms: f64 = 200.0, Within(0.0, MOST_MS);
        /// Oldest time tag accepted, milliseconds before its arrival, such as 1000.
        max_age_ms: f64 = 1000.0, Within(0.0, MOST_MS);
        /// Latest time tag accepted, milliseconds after its arrival, such as 100.
        max_lead_ms: f64 = 100.0, Within(0.0, MOST_MS);
        /// Calibrated microseconds from transmission to the receive stamp; 0 when unknown.
        link_delay_us: f64 = 0.0, Within(-1e6, 1e6);
        /// Seconds of time marks that offset and drift are drawn from, such as 30.
        clock_window_s: f64 = RemoteClockLimits::default().window.s(), Within(2.0, 600.0);
        /// Milliseconds by which a time mark must be off to be a step of a clock, such as 250.
        clock_step_ms: f64 = RemoteClockLimits::default().step.ms(), Within(1.0, 60_000.0);
        /// Parts per million that a clock may be off, such as 200; larger drifts are refused as outliers.
        clock_max_drift_ppm: f64 = RemoteClockLimits::default().most_drift * 1e6, Within(1.0, 10_000.0);
        /// Allan deviation of the flight computer's oscillator at 1 s, such as 5e-9.
        clock_allan_1s: f64 = RemoteClockLimits::default().allan_1s, Within(1e-13, 1e-5), ALLAN;
        /// Microseconds, one sigma, of the stamps of pulses per second, such as 1.
        pps_sigma_us: f64 = RemoteClockLimits::default().pps_sigma.s() * 1e6, Within(1e-3, 1000.0);
    }

    /// How wrong a frame may be.
    AccuracyKeys at "accuracy" {
        /// Pixels, such as 0.002: error of a star's place.
        centroid_px: f64 = AccuracyBudget::default().centroid_px, Positive;
        /// A fraction, such as 0.001: error of a star's flux.
        flux_rel: f64 = AccuracyBudget::default().flux_rel, Positive;
        /// Error of a pixel, a share of the pixel's noise, such as 0.1.
        pixel_sigma: f64 = AccuracyBudget::default().pixel_sigma, Positive;
        /// Arcseconds, such as 0.1: error of the line of sight.
        los_arcsec: f64 = AccuracyBudget::default().los_arcsec, Positive;
    }

    /// How frames are drawn.
    RenderKeys at "render" {
        /// The implementation that draws; auto, a GPU when there is one, is right for most benches.
        backend: Word<Backend> = "auto", [
            ("auto", Backend::Auto), ("gpu", Backend::Gpu), ("cpu", Backend::Cpu), ("reference", Backend::Reference),
        ];
        /// How motion is drawn: auto, static, gauss-legendre, effective-psf or samples, with :N for a number of nodes.
        method: String = "auto", "text", "auto is right for most benches";
    }
}

/// An hour: no limit of attitudes is longer.
const MOST_MS: f64 = 3_600_000.0;
const ALLAN: &str = "Allan deviation of the flight computer's oscillator at 1 s, such as 5e-9";

impl AttitudeSettings {
    /// Checks the keys; `attitude_hz`, `jitter_hz` and `exposure_s` size the histories.
    pub(super) fn check(
        keys: &AttitudeKeys,
        attitude_hz: f64,
        jitter_hz: f64,
        exposure_s: f64,
        check: &mut Checker<'_>,
    ) -> Result<Self> {
        let [policy, policy_on_real_clock] = stale_policies(keys, check)?;
        let period_ms = 1000.0 / attitude_hz;
        let stale_after = keys.stale_after_ms().or(500_f64.max(5.0 * period_ms)).ms(check)?;
        let max_horizon = keys.max_horizon_ms().ms(check)?;
        let jitter_wait = keys.jitter_wait_ms().ms(check)?;
        let rate_decay = keys.rate_decay_ms().ms(check)?;
        let (max_age, max_lead) = (keys.max_age_ms().ms(check)?, keys.max_lead_ms().ms(check)?);
        if stale_after.ms() <= period_ms {
            let wanted = format!("more than {period_ms} (one period of flight_computer.attitude_hz)");
            let advice = "a limit of several periods rides over a lost message";
            return Err(keys.stale_after_ms().advised(advice).invalid(stale_after.ms(), wanted, check));
        }
        let clock = check_clock(keys, check)?;
        let limits = |rate_hz: f64| HistoryLimits {
            capacity: capacity(rate_hz, longest_exposure_s(exposure_s) + max_age.s() + HISTORY_MARGIN_S),
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

/// Returns the policy for a stream that has stopped, on the virtual clock and on the real one. Without the key a
/// simulated run goes on from the last attitude; one with hardware sends no frame, so that a tracker never sees a
/// frozen sky.
fn stale_policies(keys: &AttitudeKeys, check: &mut Checker<'_>) -> Result<[StalePolicy; 2]> {
    let policy = keys.stale_policy().check(check)?;
    Ok(if keys.stale_policy().is_given() { [policy; 2] } else { [StalePolicy::Hold, StalePolicy::Drop] })
}

/// Returns the time correlation: what the link and the remote clock are like.
fn check_clock(keys: &AttitudeKeys, check: &mut Checker<'_>) -> Result<RemoteClockLimits> {
    let constant_delay = Span::from_s(keys.link_delay_us().check(check)? * 1e-6);
    let window = Span::from_s(keys.clock_window_s().check(check)?);
    let step = keys.clock_step_ms().ms(check)?;
    let most_drift = keys.clock_max_drift_ppm().check(check)? * 1e-6;
    let allan_1s = keys.clock_allan_1s().check(check)?;
    let pps_sigma = Span::from_s(keys.pps_sigma_us().check(check)? * 1e-6);
    Ok(RemoteClockLimits { window, constant_delay, step, most_drift, allan_1s, pps_sigma })
}

/// Returns samples at a rate over a time, 64 at least; the rates and times are checked, so 10^6 is a limit on memory
/// only.
fn capacity(rate_hz: f64, time_s: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped first")]
    let capacity = (rate_hz * time_s).ceil().clamp(64.0, 1e6) as usize;
    capacity
}

pub(super) fn check_accuracy(keys: &AccuracyKeys, check: &mut Checker<'_>) -> Result<AccuracyBudget> {
    taken!(check, keys => centroid_px, flux_rel, pixel_sigma, los_arcsec);
    Ok(AccuracyBudget { centroid_px, flux_rel, pixel_sigma, los_arcsec })
}

impl Render {
    pub(super) fn check(keys: &RenderKeys, check: &mut Checker<'_>) -> Result<Self> {
        taken!(check, keys => backend, method);
        let wanted = "auto, static, gauss-legendre, effective-psf or samples, with :N for a number of nodes";
        let method = method.parse().map_err(|_| keys.method().invalid(format!("\"{method}\""), wanted, check))?;
        Ok(Self { backend, method })
    }
}
