//! Notices a sender whose clock gains or loses more than a clock does: a simulator that does not keep real time.
//!
//! In: tags with their arrivals. Out: the change of the delay in a window, where it is the third one in a row in which the delay
//! has changed the same way by more than [`WAY`] and the largest drift. Of a window the least delay counts, so messages
//! that wait in a queue change nothing; a step of the clock is one window. A silence of two windows begins again. Allocates
//! nothing. Tests: below.

use base::time::{Span, Tai};

/// Length of a window.
const WINDOW: Span = Span::from_ms(2000);
/// Windows in a row that are reported.
const WINDOWS: i32 = 3;
/// Change of the least delay, beside drift, up to which a clock is taken for one.
const WAY: Span = Span::from_ms(5);

/// The window under way, and what is known of those before.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TagRate {
    since: Option<Tai>,
    least_ns: i64,
    before_ns: Option<i64>,
    /// Windows in a row with changes of one sign, with that sign.
    in_a_row: i32,
}

impl TagRate {
    /// Takes the next tag. Returns by how much the delay has changed in a window, when the clock runs off.
    pub(super) fn take(&mut self, tag_ns: i64, arrived: Tai, most_drift: f64) -> Option<Span> {
        let delay_ns = arrived.ns().saturating_sub(tag_ns);
        let is_near = |since: &Tai| (arrived - *since).ns() < 2 * WINDOW.ns();
        let Some(since) = self.since.filter(is_near) else {
            *self = Self { since: Some(arrived), least_ns: delay_ns, ..Self::default() };
            return None;
        };
        if arrived - since < WINDOW {
            self.least_ns = self.least_ns.min(delay_ns);
            return None;
        }
        let change_ns = self.before_ns.map_or(0, |before_ns| self.least_ns.saturating_sub(before_ns));
        let allowed_ns = WAY.ns() as f64 + most_drift * WINDOW.ns() as f64;
        let sign = match change_ns as f64 {
            change if change > allowed_ns => 1,
            change if change < -allowed_ns => -1,
            _ => 0,
        };
        self.in_a_row = if sign != 0 && self.in_a_row.signum() == sign { self.in_a_row + sign } else { sign };
        (self.since, self.before_ns, self.least_ns) = (Some(arrived), Some(self.least_ns), delay_ns);
        if self.in_a_row.abs() < WINDOWS {
            return None;
        }
        self.in_a_row = 0;
        Some(Span::from_ns(change_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Returns how often 20 s of tags at 100 Hz are reported, of a clock that is off by so many parts in a million;
    /// `late_ms` is the delay of a message.
    fn reported(ppm: i64, late_ms: impl Fn(i64) -> i64) -> usize {
        let mut rate = TagRate::default();
        let is_reported = |i: &i64| {
            let sent_ns = 10 * MS * i - MS * late_ms(*i);
            let arrived = Tai::from_ns(1_000_000 * MS + 10 * MS * i);
            rate.take(sent_ns + sent_ns / 1_000_000 * ppm, arrived, 200e-6).is_some()
        };
        (0..2000).filter(is_reported).count()
    }

    #[test]
    fn a_clock_that_runs_off_is_reported_and_one_that_drifts_waits_or_steps_is_not() {
        for ppm in [-70_000, -30_000, -5_000, 5_000, 30_000] {
            assert_eq!(reported(ppm, |_| 1), 2, "{ppm} ppm");
        }
        for ppm in [-200, 0, 200] {
            assert_eq!(reported(ppm, |_| 1), 0, "{ppm} ppm: a clock's drift");
            assert_eq!(reported(ppm, |i| 1 + i % 70), 0, "{ppm} ppm: messages that wait");
        }
        assert_eq!(reported(0, |i| if i < 1000 { 1 } else { 60_000 }), 0, "a step");
    }
}
