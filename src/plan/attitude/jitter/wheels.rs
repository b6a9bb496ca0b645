//! Wheel speeds and a table of harmonics -> the lines of one exposure.
//!
//! Input: speeds of four wheels at instants (10 Hz), and harmonics `amplitude (|speed| / 1000 rpm)^exponent
//! sin(harmonic angle + phase)` (force in proportion to the square of the speed, at multiples of it: Masterson, Miller
//! and Grogan, "Development and validation of reaction wheel disturbance models", Journal of Sound and Vibration 249,
//! 2002). Output: one line per harmonic, with its phase at mid-exposure.
//!
//! *Speed* is linear between messages and held before the first and after the last. The *angle* is its integral, 0 at
//! the first message; the trapezoid of a linear speed is exact.
//!
//! *Frozen speed.* During one exposure a harmonic has the frequency and the amplitude of mid-exposure. With the speed
//! changing by `a` it errs by at most `harmonic a T^2 / 8` rad of phase at the exposure's ends, times the amplitude,
//! and by `exponent a T / (2 speed)` of the amplitude; [`WheelHarmonics::frozen_bound_rad`] sums both over the table.
//! `tests/physics/bus_jitter.rs` has both sides of the bound.
//!
//! *Phases* ([`moved`]) refer to one instant and are moved to another. They are kept in turns of f64. A line of 100 Hz
//! has turned 1e11 times since 1970; f64 would resolve 1e-5 turns of these. Whole hertz times whole seconds are whole
//! turns and are removed first, so the resolution is 1e-7 turns after 30 years.

use crate::attitude::error::{HistoryReject, JitterReject};
use crate::attitude::los::JitterLine;
use base::time::{Span, Tai};
use base::units::NS_PER_S;
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use std::collections::VecDeque;

/// Number of wheels whose speeds are sent.
pub const WHEELS: usize = 4;
/// Largest number of harmonics.
pub const HARMONICS_MAX: usize = 64;
/// Speed at which amplitudes are given, rad/s: 1000 rpm.
const NOMINAL_RAD_S: f64 = 1000.0 * TAU / 60.0;
/// Messages kept: 25 s at 10 Hz.
const SPEEDS_MAX: usize = 256;

/// One disturbance whose frequency is a multiple of a wheel's speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelHarmonic {
    /// Wheel, 0 to 3.
    pub wheel: usize,
    /// Multiple of the wheel's speed, above zero.
    pub harmonic: f64,
    /// Rotation vector amplitude at 1000 rpm, sensor axes, rad.
    pub amplitude_rad: DVec3,
    /// Exponent of `|speed| / 1000 rpm` in the amplitude, not negative.
    pub exponent: f64,
    /// Phase at wheel angle 0, rad.
    pub phase_rad: f64,
}

/// Speeds at one instant, and the angles they have led to.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Speeds {
    at: Tai,
    rad_s: [f64; WHEELS],
    /// Turns since the first message: harmonics need not be whole, so none can be dropped. f64 keeps 1e-6 after years.
    turns: [f64; WHEELS],
}

/// The table, and the speeds so far.
#[derive(Debug, Clone)]
pub(super) struct WheelHarmonics {
    table: Vec<WheelHarmonic>,
    speeds: VecDeque<Speeds>,
}

impl Speeds {
    /// Returns the speed and angle of a wheel at an instant, when its speed changes by `slope` per second from here.
    fn after(&self, wheel: usize, slope_rad_s2: f64, at: Tai) -> (f64, f64) {
        let t_s = (at - self.at).s();
        let rad = self.rad_s[wheel] * t_s + 0.5 * slope_rad_s2 * t_s * t_s;
        (self.rad_s[wheel] + slope_rad_s2 * t_s, self.turns[wheel] + rad / TAU)
    }

    fn slope_to(&self, next: &Self, wheel: usize) -> f64 {
        (next.rad_s[wheel] - self.rad_s[wheel]) / (next.at - self.at).s()
    }
}

impl WheelHarmonics {
    pub(super) fn new() -> Self {
        Self { table: Vec::with_capacity(HARMONICS_MAX), speeds: VecDeque::with_capacity(SPEEDS_MAX) }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.table.is_empty() || self.speeds.is_empty()
    }

    pub(super) fn set_table(&mut self, table: &[WheelHarmonic]) -> Result<(), JitterReject> {
        if table.len() > HARMONICS_MAX {
            return Err(JitterReject::TooMany { got: table.len(), most: HARMONICS_MAX });
        }
        let is_legal = |row: &WheelHarmonic| {
            let numbers = [row.harmonic, row.exponent, row.phase_rad];
            row.wheel < WHEELS
                && numbers.iter().all(|number| number.is_finite())
                && row.amplitude_rad.is_finite()
                && row.harmonic > 0.0
                && row.exponent >= 0.0
        };
        if let Some(row) = table.iter().position(|row| !is_legal(row)) {
            return Err(JitterReject::Illegal { row });
        }
        self.table.clear();
        self.table.extend_from_slice(table);
        Ok(())
    }

    /// Accepts the speeds at an instant later than those before.
    pub(super) fn set_speeds(&mut self, rad_s: [f64; WHEELS], at: Tai) -> Result<(), HistoryReject> {
        if !rad_s.iter().all(|speed| speed.is_finite()) {
            return Err(HistoryReject::NotFinite);
        }
        let mut turns = [0.0; WHEELS];
        if let Some(last) = self.speeds.back() {
            if at <= last.at {
                return Err(if at == last.at { HistoryReject::DuplicateEpoch } else { HistoryReject::Stale });
            }
            let t_s = (at - last.at).s();
            turns =
                core::array::from_fn(|wheel| last.turns[wheel] + 0.5 * (last.rad_s[wheel] + rad_s[wheel]) * t_s / TAU);
        }
        if self.speeds.len() >= SPEEDS_MAX {
            self.speeds.pop_front();
        }
        self.speeds.push_back(Speeds { at, rad_s, turns });
        Ok(())
    }

    /// Returns the speed (rad/s) and angle (turns) of a wheel.
    fn state_at(&self, wheel: usize, at: Tai) -> Option<(f64, f64)> {
        let after = self.speeds.partition_point(|speeds| speeds.at <= at);
        let before = after.checked_sub(1).and_then(|place| self.speeds.get(place));
        match (before, self.speeds.get(after)) {
            (Some(a), Some(b)) => Some(a.after(wheel, a.slope_to(b, wheel), at)),
            (Some(only), None) | (None, Some(only)) => Some(only.after(wheel, 0.0, at)),
            (None, None) => None,
        }
    }

    /// Adds the lines of an exposure; their phases refer to `mid_exposure`.
    pub(super) fn add_lines(&self, mid_exposure: Tai, lines: &mut Vec<JitterLine>) {
        let line = |row: &WheelHarmonic| {
            let (speed_rad_s, turns) = self.state_at(row.wheel, mid_exposure)?;
            let amplitude_rad = amplitude(row, speed_rad_s);
            let phase_rad = TAU * (row.harmonic * turns).fract() + row.phase_rad;
            Some(forward(row.harmonic * speed_rad_s / TAU, amplitude_rad, phase_rad))
        };
        lines.extend(self.table.iter().filter_map(line));
    }

    /// Returns the largest error of constant speeds at the ends of an exposure, sensor axes, rad.
    pub(super) fn frozen_bound_rad(&self, from: Tai, until: Tai) -> DVec3 {
        let exposure_s = (until - from).s();
        let middle = from + Span::from_s(0.5 * exposure_s);
        let error = |row: &WheelHarmonic| {
            let speed_rad_s = self.state_at(row.wheel, middle).map_or(0.0, |state| state.0.abs());
            let slope_rad_s2 = self.steepest_rad_s2(row.wheel, from, until);
            let phase = row.harmonic * slope_rad_s2 * exposure_s * exposure_s / 8.0;
            let changed_rad_s = 0.5 * slope_rad_s2 * exposure_s;
            let largest = amplitude(row, speed_rad_s + changed_rad_s).abs();
            let least = amplitude(row, (speed_rad_s - changed_rad_s).max(0.0)).abs();
            let present = amplitude(row, speed_rad_s).abs();
            present * phase.min(2.0) + (largest - present).max(present - least)
        };
        self.table.iter().map(error).sum()
    }

    fn steepest_rad_s2(&self, wheel: usize, from: Tai, until: Tai) -> f64 {
        let first = self.speeds.partition_point(|speeds| speeds.at <= from).saturating_sub(1);
        let pairs = self.speeds.iter().skip(first).zip(self.speeds.iter().skip(first + 1));
        pairs.take_while(|(a, _)| a.at <= until).map(|(a, b)| a.slope_to(b, wheel).abs()).fold(0.0, f64::max)
    }
}

fn amplitude(row: &WheelHarmonic, speed_rad_s: f64) -> DVec3 {
    row.amplitude_rad * libm::pow(speed_rad_s.abs() / NOMINAL_RAD_S, row.exponent)
}

/// Returns the turns of a frequency over a span without whole turns: in (-1, 1).
pub(super) fn turns(frequency_hz: f64, span: Span) -> f64 {
    let (whole_s, rest_ns) = (span.ns().div_euclid(NS_PER_S), span.ns().rem_euclid(NS_PER_S));
    let whole_turns = (frequency_hz.fract() * whole_s as f64).fract();
    (whole_turns + frequency_hz * Span::from_ns(rest_ns).s()).fract()
}

/// Returns the line with its phase at an instant that is `later` than its own.
pub(super) fn moved(line: &JitterLine, later: Span) -> JitterLine {
    JitterLine { phase_rad: line.phase_rad + TAU * turns(line.frequency_hz, later), ..*line }
}

/// Returns `amplitude sin(2 pi f t + phase)`, in which the frequency may be negative, as a line of non-negative
/// frequency.
pub(super) fn forward(frequency_hz: f64, amplitude_rad: DVec3, phase_rad: f64) -> JitterLine {
    if frequency_hz < 0.0 {
        JitterLine { frequency_hz: -frequency_hz, amplitude_rad, phase_rad: PI - phase_rad }
    } else {
        JitterLine { frequency_hz, amplitude_rad, phase_rad }
    }
}

pub(super) fn is_finite(line: &JitterLine) -> bool {
    line.frequency_hz.is_finite() && line.amplitude_rad.is_finite() && line.phase_rad.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(t_ms: i64) -> Tai {
        Tai::from_ns(t_ms * 1_000_000)
    }

    fn row() -> WheelHarmonic {
        WheelHarmonic { wheel: 1, harmonic: 2.5, amplitude_rad: DVec3::X * 1e-6, exponent: 2.0, phase_rad: 0.3 }
    }

    #[test]
    fn angles_are_the_integral_of_linear_speeds() {
        let mut wheels = WheelHarmonics::new();
        for (t_ms, speed) in [(0, 10.0), (100, 20.0), (300, -20.0)] {
            wheels.set_speeds([0.0, speed, 0.0, 0.0], ms(t_ms)).expect("rising");
        }
        let state = |t_ms| wheels.state_at(1, ms(t_ms)).expect("speeds");
        // By hand: 1.5 rad after 0.1 s; the wheel stops at 0.2 s after 1 rad more, and is back there at 0.3 s.
        let close = |(speed, turns): (f64, f64), wanted_speed: f64, wanted_rad: f64| {
            (speed - wanted_speed).abs() < 1e-9 && (turns * TAU - wanted_rad).abs() < 1e-9
        };
        assert!(close(state(50), 15.0, 0.625), "{:?}", state(50));
        assert!(close(state(100), 20.0, 1.5), "{:?}", state(100));
        assert!(close(state(200), 0.0, 2.5), "{:?}", state(200));
        assert!(close(state(300), -20.0, 1.5), "{:?}", state(300));
        assert!(close(state(400), -20.0, -0.5), "held after the last: {:?}", state(400));
        assert!(close(state(-100), 10.0, -1.0), "and before the first: {:?}", state(-100));
    }

    #[test]
    fn amplitudes_go_with_the_power_of_the_speed() {
        let mut wheels = WheelHarmonics::new();
        wheels.set_table(&[row()]).expect("legal");
        wheels.set_speeds([0.0, -2.0 * NOMINAL_RAD_S, 0.0, 0.0], ms(0)).expect("finite");
        let mut lines = Vec::new();
        wheels.add_lines(ms(0), &mut lines);
        assert!((lines[0].amplitude_rad.x - 4e-6).abs() < 1e-18, "{lines:?}");
        assert!((lines[0].frequency_hz - 2.5 * 2000.0 / 60.0).abs() < 1e-9, "never negative: {lines:?}");
        assert_eq!(wheels.frozen_bound_rad(ms(0), ms(100)), DVec3::ZERO, "constant speed");
    }

    #[test]
    fn illegal_rows_and_old_speeds_are_refused() {
        let mut wheels = WheelHarmonics::new();
        for broken in [
            WheelHarmonic { wheel: 4, ..row() },
            WheelHarmonic { harmonic: 0.0, ..row() },
            WheelHarmonic { exponent: -1.0, ..row() },
            WheelHarmonic { phase_rad: f64::NAN, ..row() },
        ] {
            assert_eq!(wheels.set_table(&[row(), broken]), Err(JitterReject::Illegal { row: 1 }));
        }
        assert_eq!(wheels.set_table(&[row(); 65]), Err(JitterReject::TooMany { got: 65, most: 64 }));
        assert_eq!(wheels.set_speeds([0.0; 4], ms(10)), Ok(()));
        assert_eq!(wheels.set_speeds([0.0; 4], ms(10)), Err(HistoryReject::DuplicateEpoch));
        assert_eq!(wheels.set_speeds([0.0; 4], ms(9)), Err(HistoryReject::Stale));
        assert_eq!(wheels.set_speeds([f64::INFINITY; 4], ms(11)), Err(HistoryReject::NotFinite));
    }

    #[test]
    fn speeds_have_a_bounded_memory() {
        let mut wheels = WheelHarmonics::new();
        let space = wheels.speeds.capacity();
        for i in 0..2000 {
            wheels.set_speeds([1.0; 4], ms(i)).expect("rising");
        }
        assert_eq!(wheels.speeds.capacity(), space);
        let (_, turns) = wheels.state_at(0, ms(1999)).expect("speeds");
        assert!((turns * TAU - 1.999).abs() < 1e-9, "{turns}");
    }
}

#[cfg(test)]
mod lines_tests {
    use super::*;

    #[test]
    fn turns_survive_decades() {
        // 123.25 Hz over 10^9 s and a quarter: 123.25e9 turns are whole, 30.8125 are not.
        let span = Span::from_ns(1_000_000_000_250_000_000);
        assert!((turns(123.25, span) - 0.8125).abs() < 1e-9, "{}", turns(123.25, span));
        let back = turns(123.25, Span::from_ns(-250_000_000));
        assert!((back.rem_euclid(1.0) - 0.1875).abs() < 1e-9, "{back}");
    }

    #[test]
    fn backward_line_equals_a_forward_line() {
        let (amplitude, phase, t_s) = (DVec3::new(1.0, -2.0, 0.5), 0.7, 0.013);
        let line = forward(-40.0, amplitude, phase);
        assert!(line.frequency_hz > 0.0);
        let direct = amplitude * (TAU * -40.0 * t_s + phase).sin();
        let forwards = line.amplitude_rad * (TAU * line.frequency_hz * t_s + line.phase_rad).sin();
        assert!((direct - forwards).length() < 1e-12, "{direct} {forwards}");
    }
}
