//! When each stream is due, in the flight computer's own microseconds since boot; its clock, at a rate slightly off; and
//! jitter as the attitude control system causes it: lines, and how their samples are sent.

use base::time::{Span, Tai};
use base::units::ARCSEC;
use core::f64::consts::TAU;
use glam::DVec3;

/// Time after which the follow-up of a SYNC is due.
const FOLLOW_UP_DELAY: Span = Span::from_ms(2);

const US_PER_S: u64 = 1_000_000;
const SYNC_HZ: u32 = 10;
const HEARTBEAT_HZ: u32 = 1;

/// Periodic messages. Of streams due together the first leaves first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    Sync,
    FollowUp,
    Attitude,
    Jitter,
    Heartbeat,
}

/// Due at `offset + count * numerator / denominator`: periods need not be whole microseconds, and nothing accumulates.
#[derive(Debug, Clone, Copy)]
struct Timer {
    stream: Stream,
    offset_us: u64,
    numerator_us: u64,
    denominator: u64,
    count: u64,
}

/// Every stream's timer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Schedule {
    timers: [Timer; 5],
}

impl Timer {
    /// Returns the never due for 0 Hz.
    fn at_hz(stream: Stream, rate_hz: u32) -> Self {
        Self { stream, offset_us: 0, numerator_us: US_PER_S, denominator: u64::from(rate_hz), count: 0 }
    }

    fn delayed(mut self, offset_us: u64) -> Self {
        self.offset_us = offset_us;
        self
    }

    /// Returns the due with the last sample of each message.
    fn jitter(jitter: JitterStream) -> Self {
        let (samples, period_us) = (jitter.samples as u64, u64::from(jitter.period_us));
        Self {
            stream: Stream::Jitter,
            offset_us: samples.saturating_sub(1) * period_us,
            numerator_us: samples * period_us,
            denominator: u64::from(samples > 0),
            count: 0,
        }
    }

    fn due_us(&self) -> u64 {
        let since_offset = (self.count * self.numerator_us).checked_div(self.denominator);
        since_offset.map_or(u64::MAX, |us| self.offset_us + us)
    }

    /// Returns the first time not before `start_us`.
    fn starting(mut self, start_us: u64) -> Self {
        self.count = (start_us.saturating_sub(self.offset_us) * self.denominator).div_ceil(self.numerator_us.max(1));
        self
    }
}

impl Schedule {
    pub(super) fn new(start_us: u64, attitude_hz: u32, jitter: JitterStream) -> Self {
        let follow_up_us = FOLLOW_UP_DELAY.ns().unsigned_abs() / 1000;
        let timers = [
            Timer::at_hz(Stream::Sync, SYNC_HZ),
            Timer::at_hz(Stream::FollowUp, SYNC_HZ).delayed(follow_up_us),
            Timer::at_hz(Stream::Attitude, attitude_hz),
            Timer::jitter(jitter),
            Timer::at_hz(Stream::Heartbeat, HEARTBEAT_HZ),
        ];
        Self { timers: timers.map(|timer| timer.starting(start_us)) }
    }

    /// Returns the stream due next, when, and its message's number since boot.
    pub(super) fn next(&self) -> (Stream, u64, u64) {
        let timer = self.timers[self.next_index()];
        (timer.stream, timer.due_us(), timer.count)
    }

    /// Returns the stream as [`Self::next`] does, and moves it on.
    pub(super) fn take(&mut self) -> (Stream, u64, u64) {
        let next = self.next();
        self.timers[self.next_index()].count += 1;
        next
    }

    fn next_index(&self) -> usize {
        (1..self.timers.len()).fold(
            0,
            |best, i| {
                if self.timers[i].due_us() < self.timers[best].due_us() { i } else { best }
            },
        )
    }
}

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

/// Elapsed time since boot; on the wire its microseconds wrap at 2^32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RemoteClock {
    boot: Tai,
    drift: f64,
}

impl RemoteClock {
    /// Returns a clock that reads zero at `boot` and runs fast by `drift_ppm`.
    pub fn new(boot: Tai, drift_ppm: f64) -> Self {
        Self { boot, drift: drift_ppm * 1e-6 }
    }

    /// Returns nanoseconds since boot; zero before it.
    pub fn elapsed_ns(&self, at: Tai) -> u64 {
        let true_span = at - self.boot;
        let read = true_span + Span::from_s(true_span.s() * self.drift);
        u64::try_from(read.ns()).unwrap_or(0)
    }

    /// Returns the whole microseconds since boot, not wrapped.
    pub fn elapsed_us(&self, at: Tai) -> u64 {
        self.elapsed_ns(at) / 1000
    }

    /// Returns the instant at which the clock reads `us` microseconds.
    pub fn at_us(&self, us: u64) -> Tai {
        let read = Span::from_ns(i64::try_from(us.saturating_mul(1000)).unwrap_or(i64::MAX));
        self.boot + read + Span::from_s(-read.s() * self.drift / (1.0 + self.drift))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(schedule: &mut Schedule, n: usize) -> Vec<(Stream, u64, u64)> {
        (0..n).map(|_| schedule.take()).collect()
    }

    #[test]
    fn streams_come_in_the_order_of_their_times() {
        let mut schedule = Schedule::new(0, 100, JitterStream::bursts(1000));
        let wanted = [
            (Stream::Sync, 0, 0),
            (Stream::Attitude, 0, 0),
            (Stream::Heartbeat, 0, 0),
            (Stream::FollowUp, 2000, 0),
            (Stream::Attitude, 10_000, 1),
            (Stream::Jitter, 13_000, 0),
            (Stream::Attitude, 20_000, 2),
            (Stream::Jitter, 27_000, 1),
        ];
        assert_eq!(first(&mut schedule, wanted.len()), wanted);
    }

    #[test]
    fn a_period_of_no_whole_microseconds_does_not_drift() {
        let mut schedule = Schedule::new(0, 3, JitterStream::OFF);
        let attitude: Vec<_> =
            first(&mut schedule, 100).into_iter().filter(|due| due.0 == Stream::Attitude).map(|due| due.1).collect();
        assert_eq!(attitude[..4], [0, 333_333, 666_666, 1_000_000]);
    }

    #[test]
    fn a_late_start_begins_with_the_first_due_after_it() {
        let schedule = Schedule::new(5_000_001, 3, JitterStream::bursts(1000));
        for timer in schedule.timers {
            let mut earlier = timer;
            earlier.count -= 1;
            assert!(timer.due_us() >= 5_000_001 && earlier.due_us() < 5_000_001, "{timer:?}");
        }
    }

    #[test]
    fn silent_streams_are_never_due() {
        let mut schedule = Schedule::new(0, 0, JitterStream::OFF);
        assert!(first(&mut schedule, 50).iter().all(|due| !matches!(due.0, Stream::Attitude | Stream::Jitter)));
    }
}

#[cfg(test)]
mod jitter_tests {
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

#[cfg(test)]
mod remote_clock_tests {
    use super::*;

    #[test]
    fn reading_and_instant_are_inverse() {
        let boot = Tai::from_ns(1_700_000_000_000_000_000);
        for drift_ppm in [0.0, 20.0, -35.5] {
            let clock = RemoteClock::new(boot, drift_ppm);
            for us in [0, 1, 999_999, 5_000_000_000, 86_400_000_000] {
                let back_ns = clock.elapsed_ns(clock.at_us(us));
                assert!(back_ns.abs_diff(us * 1000) <= 1, "{back_ns} ns for {us} us at {drift_ppm} ppm");
            }
        }
        assert_eq!(RemoteClock::new(boot, 0.0).elapsed_ns(boot - Span::from_ms(1)), 0);
    }

    #[test]
    fn a_fast_clock_is_ahead() {
        let clock = RemoteClock::new(Tai::from_ns(0), 20.0);
        assert_eq!(clock.elapsed_us(Tai::from_ns(1_000_000_000_000)), 1_000_020_000);
    }
}
