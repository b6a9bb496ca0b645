//! Trials of the loop: one run, sines in its record, margins and rejection, pointing error.
//!
//! One closed loop over pixels, at rest on its target: injection -> telemetry.
//!
//! The spacecraft starts at its target attitude, at rest. Test torques start after [`QUIET_S`]; samples before a
//! trial's window are transient. The wheels run without friction: a wheel that passes zero speed gives a pulse (60
//! arcsec for the small satellite) that no linear theory contains and that would come at an unrelated time.
//! Deterministic: the scenario and the injection decide every bit.

use crate::study::point::{
    ACTUATION_DELAY, CROSSOVER, DELAY_MARGIN, JITTER, LARGEST_ERROR, PHASE_MARGIN, POINTING_ERROR, REJECTION,
    StudyPoint, TAG, TAG_ERROR, TRACKER_DELAY,
};
use crate::study::theory::{LoopOnPaper, noise_of, phase_margin_rad, taken_over};
use crate::study::{Study, rounded_to};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use config::{Action, Backend, Event, Pointing, Scenario};
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

// Amplitude and phase of sine waves in a record, by correlation under a Hann window.
//
// In: equally spaced samples that cover the record once. Out: a phasor `X` with `x(t) = Re(X exp(i w t))`. Tones at
// multiples of one over the record's length, two or more multiples apart and above zero, do not disturb each other,
// nor does a constant; slow drift falls off with the cube of the distance (Harris, "On the use of windows for harmonic
// analysis with the discrete Fourier transform", Proc. IEEE 66 (1978)). Test: `tests`.

/// Returns the phasor at `frequency_hz` of `samples` taken every `period_s` from `first_s` on.
pub fn phasor(samples: impl ExactSizeIterator<Item = f64>, first_s: f64, period_s: f64, frequency_hz: f64) -> Complex {
    let count = samples.len() as f64;
    let mut sum = Complex::real(0.0);
    for (k, sample) in samples.enumerate() {
        let place = k as f64;
        let hann = 0.5 - 0.5 * (TAU * place / count).cos();
        sum = sum + Complex::unit(-TAU * frequency_hz * (first_s + place * period_s)) * (hann * sample);
    }
    // The window's mean is one half, and a sine has half its amplitude at each of two frequencies.
    sum * (4.0 / count)
}

/// Returns the value at `x` of points by ascending `x`, with straight lines between and beyond them; `None` for fewer
/// than two.
pub fn read_at(points: &[[f64; 2]], x: f64) -> Option<f64> {
    let last = points.len().checked_sub(2)?;
    let k = points.iter().skip(1).position(|point| x < point[0]).unwrap_or(last).min(last);
    let ([x0, y0], [x1, y1]) = (points[k], points[k + 1]);
    Some(y0 + (y1 - y0) * (x - x0) / (x1 - x0))
}

// Phase margin against latency, jitter rejection against frequency: sines about two axes, measured on the true
// attitude.

/// Tolerance of a phase margin, deg. Pointing noise of 0.55 arcsec rms about an axis, within about 0.1 Hz, is 0.3
/// arcsec in the amplitude of a tone over a record of 120 s: 0.5 % of `TONE_RAD`, or 0.3 deg; three sigmas.
pub const PHASE_MARGIN_DEG: f64 = 1.0;
/// Tolerance of the crossover, as a share: the same noise is 0.4 % of frequency where the gain falls as `w^-1.2`; three
/// sigmas, and 0.1 % for the reduction of the inertia by flexible modes and free rotors.
pub const CROSSOVER_SHARE: f64 = 0.015;
/// Tolerance of jitter rejection below the bandwidth, as a share: 0.75 % of noise in tones of `JITTER_RAD` over a
/// record of 120 s; four sigmas, because there are dozens of points.
pub const REJECTION_SHARE: f64 = 0.03;

/// Amplitude of a tone in the true attitude according to theory: small relative to the 600 arcsec that end fine
/// pointing, large relative to the noise.
const TONE_RAD: f64 = 60.0 * ARCSEC;
/// The same for jitter.
const JITTER_RAD: f64 = 40.0 * ARCSEC;
/// Largest amplitude of a tone's rate, rad/s: above it the wheels reach their torque limit.
const RATE_RAD_S: f64 = 60.0 * ARCSEC;
/// Tones for the margin: multiples of the record's frequency, and their axes; the middle one is the crossover.
const MARGIN_TONES: [(u32, usize); 3] = [(8, 0), (10, 1), (12, 0)];

/// A latency, and whether the loop knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Latency {
    /// From control step to torque.
    Actuation(f64),
    /// From last pixel to attitude.
    Tracker(f64),
}

impl Latency {
    fn label(self) -> (&'static str, f64) {
        match self {
            Self::Actuation(s) => (ACTUATION_DELAY, s * 1e3),
            Self::Tracker(s) => (TRACKER_DELAY, s * 1e3),
        }
    }

    /// Returns the theory's loop with this latency: a tracker with true time tags costs no phase.
    pub(super) fn on_paper(self, paper: &LoopOnPaper) -> LoopOnPaper {
        match self {
            Self::Actuation(s) => paper.with_delay(s),
            Self::Tracker(_) => *paper,
        }
    }

    pub(super) fn injected(self) -> Injection {
        match self {
            Self::Actuation(s) => Injection { actuation_delay: Span::from_s(s), ..Injection::NONE },
            Self::Tracker(s) => Injection { tracker_delay: Some(Span::from_s(s)), ..Injection::NONE },
        }
    }

    pub(super) fn varied(self) -> (&'static str, f64) {
        self.label()
    }
}

/// Measures the phase margin and crossover with this latency.
pub(super) fn margin(study: &Study, latency: Latency) -> Result<Vec<StudyPoint>, LoopError> {
    let paper = latency.on_paper(&study.paper);
    let (Some(crossover), Some(wanted)) = (paper.crossover_rad_s(), paper.phase_margin_rad()) else {
        return Ok(Vec::new());
    };
    let middle = f64::from(MARGIN_TONES[1].0);
    let base_s = rounded_to(study.control_period_s, middle * TAU / crossover);
    let tone = |(multiple, axis): (u32, usize)| tone(&paper, f64::from(multiple) / base_s, axis, TONE_RAD);
    let injection = Injection { tones: MARGIN_TONES.map(tone).to_vec(), ..latency.injected() };
    let record_s = base_s * f64::from(study.effort.repeats);
    let found = measured_sensitivity(&study.scenario, &injection, settling_s(&paper), record_s)?;
    let read = found.and_then(|found| margin_of(&injection.tones, &found));
    let (w, margin) = read.unwrap_or((f64::NAN, f64::NAN));
    let margin = [margin / DEG, wanted / DEG];
    let crossover = [w / TAU, crossover / TAU];
    Ok(vec![
        StudyPoint::judged(PHASE_MARGIN, latency.label(), margin, PHASE_MARGIN_DEG),
        StudyPoint::judged(CROSSOVER, latency.label(), crossover, CROSSOVER_SHARE * crossover[1]),
    ])
}

/// Returns crossover, rad/s, and phase margin, rad, from `S` at tones by ascending frequency: gain and phase are
/// straight lines over the logarithm of the frequency.
pub fn margin_of(tones: &[Tone], sensitivity: &[Complex]) -> Option<(f64, f64)> {
    let open = |s: &Complex| Complex::ONE / *s - Complex::ONE;
    let line = |of: fn(Complex) -> f64| -> Vec<[f64; 2]> {
        let point = |(tone, s): (&Tone, &Complex)| [of(open(s)), (TAU * tone.frequency_hz).ln()];
        tones.iter().zip(sensitivity).map(point).collect()
    };
    // Ascending -ln|L| is ascending frequency.
    let by_gain = line(|open| -open.modulus().ln());
    let ln_w = read_at(&by_gain, 0.0)?;
    let by_frequency: Vec<[f64; 2]> = line(phase_margin_rad).iter().map(|[margin, ln_w]| [*ln_w, *margin]).collect();
    Some((ln_w.exp(), read_at(&by_frequency, ln_w)?))
}

/// Returns the delay margin, s, by a straight line through phase margins, rad, over delays, s: the slope is the
/// crossover.
pub fn delay_margin_s(points: &[[f64; 2]]) -> Option<f64> {
    let count = points.len() as f64;
    let mean = |k: usize| points.iter().map(|point| point[k]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let slope = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>()
        / points.iter().map(|p| (p[0] - x).powi(2)).sum::<f64>();
    let zero_s = x - y / slope;
    zero_s.is_finite().then_some(zero_s)
}

/// Returns the delay margin extrapolated from the measured phase margins.
pub(super) fn delay_margin(study: &Study, points: &[StudyPoint]) -> Option<StudyPoint> {
    let of_actuation = |point: &&StudyPoint| point.kind == PHASE_MARGIN && point.varied == ACTUATION_DELAY;
    let line: Vec<[f64; 2]> =
        points.iter().filter(of_actuation).map(|point| [point.value * 1e-3, point.measured * DEG]).collect();
    let wanted_ms = study.paper.delay_margin_s()? * 1e3;
    let found_ms = delay_margin_s(&line)? * 1e3;
    // Sum of the tolerances of the phase margin and the crossover.
    let share = PHASE_MARGIN_DEG * DEG / study.paper.phase_margin_rad()? + CROSSOVER_SHARE;
    Some(StudyPoint::judged(DELAY_MARGIN, (ACTUATION_DELAY, 0.0), [found_ms, wanted_ms], share * wanted_ms))
}

/// Measures jitter rejection at some frequencies (Hz, ascending) in one run; those above the bandwidth are only
/// reported.
pub(super) fn rejection(study: &Study, frequencies_hz: &[f64]) -> Result<Vec<StudyPoint>, LoopError> {
    let Some(lowest) = frequencies_hz.first() else { return Ok(Vec::new()) };
    let base_s = rounded_to(study.control_period_s, 1.0 / lowest);
    let record_s = base_s * f64::from(study.effort.repeats).max((100.0 / base_s).ceil()).max(3.0);
    let bandwidth_hz = study.bandwidth_hz();
    let tones: Vec<Tone> = frequencies_hz
        .iter()
        .enumerate()
        .map(|(k, hz)| tone(&study.paper, (hz * record_s).round() / record_s, k % 2, JITTER_RAD))
        .collect();
    let injection = Injection { tones, ..Injection::NONE };
    let found = measured_sensitivity(&study.scenario, &injection, settling_s(&study.paper), record_s)?;
    let point = |(k, tone): (usize, &Tone)| {
        let measured = found.as_ref().map_or(f64::NAN, |found| found[k].modulus());
        let predicted = study.paper.sensitivity(TAU * tone.frequency_hz).modulus();
        let allowed = REJECTION_SHARE * predicted;
        let point = StudyPoint::judged(REJECTION, (JITTER, tone.frequency_hz), [measured, predicted], allowed);
        if tone.frequency_hz > bandwidth_hz { point.reported() } else { point }
    };
    Ok(injection.tones.iter().enumerate().map(point).collect())
}

/// Returns a tone that would appear with this amplitude, or less if its rate would be too large.
fn tone(paper: &LoopOnPaper, frequency_hz: f64, axis: usize, shown_rad: f64) -> Tone {
    let w = TAU * frequency_hz;
    let left = paper.sensitivity(w).modulus();
    Tone { axis, frequency_hz, amplitude_rad: shown_rad.min(RATE_RAD_S / w) / left }
}

// Pointing error at rest against latency, and the effect of wrong time tags in a turn.

/// Tolerance of a pointing error, as a share: two axes of noise within about 0.05 Hz over one record of 600 s are 120
/// independent values, whose rms scatters by 6.5 %; three sigmas. Points share their seeds, and so their scatter.
pub const POINTING_SHARE: f64 = 0.2;
/// Tolerance of the estimate's lag in a turn, as a share: noise of the tracker (1 arcsec over a window of 20 s)
/// relative to 14 arcsec for 20 ms.
pub const TAG_SHARE: f64 = 0.05;

/// Time until the gyro's bias is known to the steady state, s.
const BIAS_SETTLING_S: f64 = 170.0;
/// Rate of the turn, rad/s: 0.25 pixels of 283 arcsec in an exposure of 0.1 s.
const TURN_RAD_S: f64 = 0.2 * DEG;
/// The turn, deg.
const TURN_DEG: f64 = 25.0;
/// Start of the turn, s after the first exposure.
const TURN_AT_S: f64 = 60.0;
/// Window at the end of the constant rate that is evaluated, s.
const TURN_WINDOW_S: f64 = 20.0;
/// Time in which a loop beyond its margin must have lost its target, s.
const LOSING_S: f64 = 400.0;

/// Measures the rms of the boresight's direction with this latency, all seeds together.
pub(super) fn pointing_error(study: &Study, latency: Latency) -> Result<Vec<StudyPoint>, LoopError> {
    let window_s = rounded_to(study.control_period_s, study.effort.noise_s);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands")]
    let count = (window_s / study.control_period_s).round() as usize;
    let head = study.head();
    let (mut variance, mut nea_square) = (0.0, 0.0);
    for seed in 0..study.effort.seeds {
        let injection = Injection { seed, ..latency.injected() };
        let trace = fly(&at_rest(&study.scenario, QUIET_S + BIAS_SETTLING_S + window_s, window_s, &injection))?;
        variance += trace.last(count).map_or(f64::NAN, |samples| variance_across(samples, head));
        nea_square += trace.nea_rad.unwrap_or(f64::NAN).powi(2);
    }
    let seeds = study.effort.seeds as f64;
    let measured = (variance / seeds).sqrt();
    let mut vehicle = study.vehicle.clone();
    if let Latency::Tracker(s) = latency {
        vehicle.heads.iter_mut().for_each(|head| head.delay = Span::from_s(s));
    }
    let noise = noise_of(&vehicle, (nea_square / seeds).sqrt(), study.frame_period_s, study.frame_latency_s);
    let predicted = core::f64::consts::SQRT_2 * latency.on_paper(&study.paper).pointing_sigma_rad(&noise);
    let got = [measured / ARCSEC, predicted / ARCSEC];
    Ok(vec![StudyPoint::judged(POINTING_ERROR, latency.varied(), got, POINTING_SHARE * got[1])])
}

/// Returns the variance of the boresight's direction about its mean, two axes together, rad^2.
fn variance_across(samples: &[Sample], head: glam::DQuat) -> f64 {
    let count = samples.len() as f64;
    let seen = || samples.iter().map(|sample| (head * sample.error_rad).truncate());
    let mean = seen().sum::<glam::DVec2>() / count;
    seen().map(|error| (error - mean).length_squared()).sum::<f64>() / count
}

/// Measures the lag of the estimate in a steady turn caused by wrong time tags. The same turn with true tags is
/// subtracted, which removes the gyro's errors.
pub(super) fn tag_error(study: &Study, tag_s: f64) -> Result<Vec<StudyPoint>, LoopError> {
    let wrong = turning(study, tag_s)?;
    let right = turning(study, 0.0)?;
    let fastest = right.samples.iter().map(|sample| sample.rate_rad_s.length()).fold(0.0, f64::max);
    let is_steady = |sample: &&Sample| sample.rate_rad_s.length() > 0.995 * fastest;
    let end_s = right.samples.iter().rfind(is_steady).map_or(0.0, |sample| sample.t_s);
    let in_window = |sample: &Sample| sample.t_s > end_s - TURN_WINDOW_S && sample.t_s <= end_s;
    let (mut behind, mut rate, mut count) = (0.0, DVec3::ZERO, 0.0);
    for (wrong, right) in wrong.samples.iter().zip(&right.samples).filter(|(_, right)| in_window(right)) {
        let along = right.rate_rad_s.normalize_or_zero();
        behind -= (wrong.knowledge_rad - right.knowledge_rad).dot(along);
        rate += right.rate_rad_s;
        count += 1.0;
    }
    let nea_rad = right.nea_rad.unwrap_or(f64::NAN);
    let noise = noise_of(&study.vehicle, nea_rad, study.frame_period_s, study.frame_latency_s);
    let begun_s = end_s - TURN_AT_S - 0.5 * (TURN_WINDOW_S + TURN_RAD_S / study.slew_acceleration_rad_s2());
    let predicted = (rate / count).length() * tag_s * taken_over(&noise, begun_s);
    let got = [behind / count / ARCSEC, predicted / ARCSEC];
    Ok(vec![StudyPoint::judged(TAG_ERROR, (TAG, tag_s * 1e3), got, TAG_SHARE * got[1].abs())])
}

fn turning(study: &Study, tag_s: f64) -> Result<Trace, LoopError> {
    let injection = Injection { tag_error: Span::from_s(tag_s), ..Injection::NONE };
    let duration_s = TURN_AT_S + TURN_DEG * DEG / TURN_RAD_S;
    let mut scenario = at_rest(&study.scenario, duration_s, duration_s - TURN_AT_S, &injection);
    let vehicle = scenario.vehicle_mut().ok_or(LoopError::NothingFlown)?;
    vehicle.spacecraft.control.slew_rate_rad_s = TURN_RAD_S;
    let up = if vehicle.target.dec_deg > 0.0 { -TURN_DEG } else { TURN_DEG };
    let target = Pointing { dec_deg: vehicle.target.dec_deg + up, ..vehicle.target };
    scenario.events.push(Event {
        at: Span::from_s(TURN_AT_S),
        on_trigger: None,
        lasts: Span::ZERO,
        action: Action::Slew(target),
    });
    fly(&scenario)
}

/// Flies with a delay beyond the margin: the loop must leave fine pointing, which it does above a stated error.
pub(super) fn beyond(study: &Study, times_margin: f64) -> Result<Vec<StudyPoint>, LoopError> {
    let Some(margin_s) = study.paper.delay_margin_s() else { return Ok(Vec::new()) };
    let latency = Latency::Actuation(rounded_to(study.step_s, times_margin * margin_s));
    let trace = fly(&at_rest(&study.scenario, LOSING_S, LOSING_S, &latency.injected()))?;
    let largest = trace.samples.iter().map(|sample| (study.head() * sample.error_rad).truncate().length());
    let got = [largest.fold(0.0, f64::max), study.vehicle.acs.thresholds.fine_leave_rad].map(|rad| rad / ARCSEC);
    // The value is a limit that must be exceeded.
    let allowed = if got[0] > got[1] { f64::INFINITY } else { 0.0 };
    Ok(vec![StudyPoint::judged(LARGEST_ERROR, latency.varied(), got, allowed)])
}
