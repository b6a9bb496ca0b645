//! When each stream is due, in the flight computer's own microseconds since boot.

use super::JitterStream;
use base::time::Span;

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
