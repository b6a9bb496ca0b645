//! Jitter as the attitude control system causes it: lines, and how their samples are sent.

use base::units::ARCSEC;
use core::f64::consts::TAU;
use glam::DVec3;

/// One line: `amplitude * sin(2 pi frequency t + phase)`, t from boot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterLineParams {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude of the rotation vector about each body axis, arcsec.
    pub amplitude_arcsec: [f64; 3],
    /// Phase at boot, rad.
    pub phase_rad: f64,
}

/// How jitter samples are sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JitterStream {
    /// Samples in one message; 0: none is sent.
    pub(super) samples: usize,
    /// Time between samples, us.
    pub(super) period_us: u16,
}

impl JitterStream {
    /// Samples in one JITTER_FD.
    pub(super) const BURST_SAMPLES: usize = firmware_protocol::message::JITTER_BURST_MAX;
    /// Not sent: the stimulator has the lines as parameters.
    pub const OFF: Self = Self { samples: 0, period_us: 1000 };
    /// 1 kHz, two samples a message: the form for classic CAN.
    pub const PAIRS: Self = Self { samples: 2, period_us: 1000 };

    /// Bursts of 14 samples, for CAN FD and serial; the period is rounded down to whole microseconds. Off for 0 Hz and
    /// for periods that 16 bits of microseconds do not hold (below 16 Hz).
    pub fn bursts(sample_hz: u32) -> Self {
        let period_us = 1_000_000_u32.checked_div(sample_hz).and_then(|period_us| u16::try_from(period_us).ok());
        match period_us {
            Some(period_us) if period_us > 0 => Self { samples: Self::BURST_SAMPLES, period_us },
            _ => Self::OFF,
        }
    }
}

impl JitterLineParams {
    /// Returns the rotation vector `t_s` after boot, body axes, rad.
    pub fn rotation_rad(&self, t_s: f64) -> DVec3 {
        let turns = (self.frequency_hz * t_s).fract();
        DVec3::from_array(self.amplitude_arcsec) * (ARCSEC * (TAU * turns + self.phase_rad).sin())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_swings_about_each_axis_by_its_amplitude() {
        let line = JitterLineParams { frequency_hz: 2.0, amplitude_arcsec: [1.0, -2.0, 0.0], phase_rad: 0.0 };
        let quarter = line.rotation_rad(0.125) / ARCSEC;
        assert!((quarter - DVec3::new(1.0, -2.0, 0.0)).length() < 1e-12, "{quarter}");
        assert!(line.rotation_rad(1e6).length() < 1e-15, "whole turns");
    }

    #[test]
    fn periods_that_do_not_fit_are_off() {
        assert_eq!(JitterStream::bursts(1000).period_us, 1000);
        assert_eq!(JitterStream::bursts(0), JitterStream::OFF);
        assert_eq!(JitterStream::bursts(15), JitterStream::OFF);
        assert_eq!(JitterStream::bursts(2_000_000), JitterStream::OFF);
    }
}
