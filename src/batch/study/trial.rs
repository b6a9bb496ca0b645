//! One closed loop over pixels, at rest on its target: injection -> telemetry.
//!
//! The spacecraft starts at its target attitude, at rest. Test torques start after [`QUIET_S`]; samples before a
//! trial's window are transient. The wheels run without friction: a wheel that passes zero speed gives a pulse (60
//! arcsec for the small satellite) that no linear theory contains and that would come at an unrelated time.
//! Deterministic: the scenario and the injection decide every bit.

use super::{theory::LoopOnPaper, tone::phasor};
use base::time::Span;
use config::{Backend, Scenario};
use core::f64::consts::TAU;
use frames::sink::NullSink;
use glam::DVec3;
use run::wiring::{error::LoopError, stepped::SteppedRun};
use std::sync::{Arc, Mutex, PoisonError};
use testbed::{acs::Mode, acs::filter::Complex, spacecraft::TestTorque, vehicle::TelemetryRow};

/// First attitude, mode changes and the first correction of the gyro's bias take less than this, s.
pub const QUIET_S: f64 = 30.0;
/// Ramp of test torques, s.
const RAMP_S: f64 = 30.0;

/// A sine injected about one body axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Body axis: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Frequency, Hz; a multiple of one over the record.
    pub frequency_hz: f64,
    /// Amplitude of a free body's turn, rad.
    pub amplitude_rad: f64,
}

/// Injected delays, errors and tones.
#[derive(Debug, Clone, PartialEq)]
pub struct Injection {
    /// Delay from a control step to its torque.
    pub actuation_delay: Span,
    /// Delay from the last pixel to the tracker's attitude; `None`: the scenario's.
    pub tracker_delay: Option<Span>,
    /// Error of the time tags.
    pub tag_error: Span,
    /// Sines.
    pub tones: Vec<Tone>,
    /// Added to the scenario's seed.
    pub seed: u64,
}

impl Injection {
    /// No injection.
    pub const NONE: Self =
        Self { actuation_delay: Span::ZERO, tracker_delay: None, tag_error: Span::ZERO, tones: Vec::new(), seed: 0 };
}

/// One row of a trial, in body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the spacecraft's start, s.
    pub t_s: f64,
    /// Rotation from the target to the true attitude, rad.
    pub error_rad: DVec3,
    /// Rotation from the true to the estimated attitude, rad; zero without an estimate.
    pub knowledge_rad: DVec3,
    /// True rate, rad/s.
    pub rate_rad_s: DVec3,
    /// True when the control was in fine pointing.
    pub is_fine: bool,
}

/// Results of a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Every control step from the start.
    pub samples: Vec<Sample>,
    /// Noise-equivalent angle across the boresight by the tracker's own covariance, rad; `None`: no attitudes.
    pub nea_rad: Option<f64>,
}

/// Returns a scenario at rest on its target for `duration_s`, evaluated in its last `window_s`.
pub fn at_rest(scenario: &Scenario, duration_s: f64, window_s: f64, injection: &Injection) -> Scenario {
    let mut scenario = scenario.clone();
    scenario.bench.timing.duration_s = duration_s;
    scenario.bench.render.backend = Backend::Cpu;
    scenario.bench.sinks.clear();
    scenario.bench.seed = scenario.bench.seed.wrapping_add(injection.seed);
    scenario.events.clear();
    scenario.expect.window_s = window_s;
    let Some(vehicle) = scenario.vehicle_mut() else { return scenario };
    vehicle.initial = Some(vehicle.target);
    vehicle.initial_rate_rad_s = DVec3::ZERO;
    vehicle.telemetry_every = 1;
    vehicle.actuation_delay = injection.actuation_delay;
    vehicle.tracker_delay = injection.tracker_delay.unwrap_or(vehicle.tracker_delay);
    vehicle.tag_error = injection.tag_error;
    for wheel in &mut vehicle.spacecraft.params.wheels {
        (wheel.viscous_n_m_s, wheel.coulomb_n_m) = (0.0, 0.0);
    }
    let inertia = vehicle.spacecraft.params.inertia_kg_m2;
    let torque = |tone: &Tone| {
        let mut acceleration = DVec3::ZERO;
        acceleration[tone.axis] = tone.amplitude_rad * (TAU * tone.frequency_hz).powi(2);
        TestTorque {
            amplitude_n_m: inertia * acceleration,
            frequency_hz: tone.frequency_hz,
            begins_s: QUIET_S,
            ramp_s: RAMP_S,
        }
    };
    vehicle.test_torques = injection.tones.iter().map(torque).collect();
    scenario
}

/// Flies a scenario to its end.
///
/// # Errors
/// When the loop cannot be made or fails.
pub fn fly(scenario: &Scenario) -> Result<Trace, LoopError> {
    let mut going = SteppedRun::new(scenario, |_| Box::new(NullSink::new()))?;
    let start = going.now();
    let got = Arc::new(Mutex::new(Vec::new()));
    let reported = Arc::clone(&got);
    going.on_row(Box::new(move |row: &TelemetryRow| {
        let sample = Sample {
            t_s: (row.at - start).s(),
            error_rad: -row.pointing_error_rad,
            knowledge_rad: row.knowledge_error_rad.unwrap_or(DVec3::ZERO),
            rate_rad_s: row.rate_rad_s,
            is_fine: row.mode == Mode::FinePointing,
        };
        reported.lock().unwrap_or_else(PoisonError::into_inner).push(sample);
    }));
    going.run_to_end(&mut |_, _, _| true)?;
    let outcome = going.end(None);
    if let Some(error) = outcome.error {
        return Err(error);
    }
    let samples = core::mem::take(&mut *got.lock().unwrap_or_else(PoisonError::into_inner));
    Ok(Trace { samples, nea_rad: outcome.assessment.nea_rad() })
}

impl Trace {
    /// Returns the last `count` samples, if there are as many and all were in fine pointing.
    pub fn last(&self, count: usize) -> Option<&[Sample]> {
        let first = self.samples.len().checked_sub(count)?;
        let last = &self.samples[first..];
        last.iter().all(|sample| sample.is_fine).then_some(last)
    }
}

/// Returns the response of a loop to sines: `S` at each tone, measured on the true attitude; `None` when the loop left
/// fine pointing.
///
/// The torque `J a sin(w t)` would turn a free body by `-a sin(w t) / w^2`; the measured turn divided by that is `S`,
/// with every delay, hold, estimator and actuator in the loop, and then `L = 1 / S - 1`.
///
/// # Errors
/// When the loop cannot be made or fails.
pub fn measured_sensitivity(
    scenario: &Scenario,
    injection: &Injection,
    settle_s: f64,
    record_s: f64,
) -> Result<Option<Vec<Complex>>, LoopError> {
    let period_s = scenario.vehicle().ok_or(LoopError::NothingFlown)?.spacecraft.control.period.s();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands")]
    let count = (record_s / period_s).round() as usize;
    let duration_s = QUIET_S + settle_s + record_s;
    let trace = fly(&at_rest(scenario, duration_s, record_s, injection))?;
    let Some(samples) = trace.last(count) else { return Ok(None) };
    let first_s = samples.first().map_or(0.0, |sample| sample.t_s) - QUIET_S;
    let sensitivity = |tone: &Tone| {
        let found =
            phasor(samples.iter().map(|sample| sample.error_rad[tone.axis]), first_s, period_s, tone.frequency_hz);
        // -a sin(w t) is the real part of i a exp(i w t).
        found / Complex::imaginary(tone.amplitude_rad)
    };
    Ok(Some(injection.tones.iter().map(sensitivity).collect()))
}

/// Returns the settling time of the loop, s: its resonance decays by 5 nepers. Damping ratio about half the phase
/// margin, at the crossover.
pub fn settling_s(paper: &LoopOnPaper) -> f64 {
    const NEPERS: f64 = 5.0;
    let decay = |(w, margin): (f64, f64)| 0.5 * margin.max(0.05) * w;
    let slowest = paper.crossover_rad_s().zip(paper.phase_margin_rad()).map_or(0.05, decay);
    RAMP_S + (NEPERS / slowest).max(60.0)
}
