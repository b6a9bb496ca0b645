//! Lines whose phases refer to one instant -> the same lines with phases at another.
//!
//! Phases are kept in turns of f64. A line of 100 Hz has turned 1e11 times since 1970; f64 would resolve 1e-5 turns of
//! these. Whole hertz times whole seconds are whole turns and are removed first, so the resolution is 1e-7 turns after
//! 30 years.

use crate::attitude::los::JitterLine;
use base::{time::Span, units::NS_PER_S};
use core::f64::consts::{PI, TAU};
use glam::DVec3;

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
