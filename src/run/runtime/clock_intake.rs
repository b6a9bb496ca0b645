//! Readings of the sender's clock -> its correlation with ours.
//!
//! In: SYNC with its follow-up, pulses per second, tags of plain messages. Out: marks that the correlation has used, and
//! whether the clock has stepped at one. What follows the clock is the receiver's matter. Allocates nothing after the
//! start. Tests: `receiver_tests`, `plain_intake_tests`.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::rate_check::TagRate;
use base::time::{Span, Tai};
use firmware_protocol::message::{Sync, TimeFollowUp};
use link::plain::PlainTime;
use plan::attitude::{ClockEstimate, Observed, ObservedPps, RemoteClock, RemoteClockLimits};

/// Number of ports whose time marks and messages are counted separately.
pub const PORTS_MAX: usize = 8;

/// Results of the pulses per second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PulseCounts {
    /// Pulses used as whole seconds of the flight computer's clock.
    pub used: u64,
    /// Pulses refused: before the first mark, or too far from a whole second.
    pub refused: u64,
}

/// The sender's clock.
pub struct ClockIntake {
    /// The time correlation.
    pub remote: RemoteClock,
    /// The counts of pulses per second so far.
    pub pulses: PulseCounts,
    limits: RemoteClockLimits,
    /// The last SYNC of each port that has not been reported.
    syncs: [Option<(u8, Tai)>; PORTS_MAX],
    /// Times of the last plain message and of the newest one, by their sender's clock.
    plain_tags: Option<(i64, i64)>,
    tag_rate: TagRate,
}

/// A reading of the sender's clock, and the estimate before it if the clock has stepped.
pub(super) struct Mark {
    pub(super) remote_ns: i64,
    pub(super) at: Tai,
    pub(super) stepped_from: Option<ClockEstimate>,
}

impl ClockIntake {
    pub(super) fn new(limits: RemoteClockLimits) -> Self {
        Self {
            remote: RemoteClock::new(limits),
            pulses: PulseCounts::default(),
            limits,
            syncs: [None; PORTS_MAX],
            plain_tags: None,
            tag_rate: TagRate::default(),
        }
    }

    /// Keeps a SYNC until its follow-up arrives.
    pub(super) fn take_sync(&mut self, port: usize, sync: &Sync, at: Tai) {
        self.syncs[port] = Some((sync.counter, at));
    }

    /// Uses the reading of the SYNC that it follows; `None` without that one.
    pub(super) fn take_follow_up(&mut self, port: usize, follow_up: &TimeFollowUp) -> Option<Mark> {
        let (_, at) = self.syncs[port].take_if(|(counter, _)| *counter == follow_up.counter)?;
        Some(self.observe(i64::try_from(follow_up.scet.ns()).unwrap_or(i64::MAX), at).1)
    }

    /// Accepts a pulse at a whole second of the flight computer's clock.
    pub(super) fn take_pulse(&mut self, at: Tai) {
        match self.remote.observe_pps(at) {
            ObservedPps::Used => self.pulses.used += 1,
            ObservedPps::Odd | ObservedPps::Ambiguous | ObservedPps::NoTimeYet => self.pulses.refused += 1,
        }
    }

    /// Returns true when the sender's clock shows the same reading as before.
    pub(super) fn is_repeated(&self, time: PlainTime) -> bool {
        match time {
            PlainTime::Arrival => false,
            PlainTime::Tag(tag_ns) => self.plain_tags.is_some_and(|(last_ns, _)| last_ns == tag_ns),
        }
    }

    /// Uses a tag as a mark of the sender's clock, which is read when the message is sent. A tag slightly older than
    /// the newest one belongs to a message that was overtaken, and is not used: the clock did not step back.
    pub(super) fn take_tag(&mut self, tag_ns: i64, arrived: Tai, ledger: &mut Ledger) -> Option<Mark> {
        let newest_ns = self.plain_tags.map_or(tag_ns, |(_, newest_ns)| newest_ns);
        let behind = Span::from_ns(newest_ns.saturating_sub(tag_ns));
        if behind > Span::ZERO && behind < self.limits.step {
            self.plain_tags = Some((tag_ns, newest_ns));
            return None;
        }
        self.plain_tags = Some((tag_ns, tag_ns));
        if let Some(change) = self.tag_rate.take(tag_ns, arrived, self.limits.most_drift) {
            ledger.note(Event::new(EventKind::ClockRunsOff, arrived, None, change));
        }
        let (observed, mark) = self.observe(tag_ns, arrived);
        matches!(observed, Observed::Used | Observed::Restarted).then_some(mark)
    }

    fn observe(&mut self, remote_ns: i64, at: Tai) -> (Observed, Mark) {
        let before = self.remote.estimate();
        let observed = self.remote.observe(remote_ns, at);
        let stepped_from = before.filter(|_| observed == Observed::Restarted);
        (observed, Mark { remote_ns, at, stepped_from })
    }
}
