//! Phase margin against latency, jitter rejection against frequency: sines about two axes, measured on the true
//! attitude.

use super::point::{
    ACTUATION_DELAY, CROSSOVER, DELAY_MARGIN, JITTER, PHASE_MARGIN, REJECTION, StudyPoint, TRACKER_DELAY,
};
use super::theory::{LoopOnPaper, phase_margin_rad};
use super::tone::read_at;
use super::trial::{Injection, Tone, measured_sensitivity, settling_s};
use super::{Study, rounded_to};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use core::f64::consts::TAU;
use run::wiring::error::LoopError;
use testbed::acs::filter::Complex;

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
