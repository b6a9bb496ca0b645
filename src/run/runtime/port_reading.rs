//! Counters of a port, across threads: the link's thread publishes them, the frame thread reads them and adds ledger
//! events.
//!
//! In: a port. Out: a [`PortReading`], and events where a count has risen. Each value is exact; values of one reading
//! may be a packet apart. No lock, no allocation. Tests: below.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use base::time::{Span, Tai};
use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use firmware_protocol::Reject;
use frames::report::{NAMES_MAX, OF_OTHER_NODES, PortCounts};
use link::plain::{PlainReject, RefusedMessage};
use link::{LinkCounters, Port};
use std::sync::OnceLock;

/// Reasons to refuse input.
pub const REASONS: usize = Reject::ALL.len();
/// Reasons to refuse plain messages.
pub const PLAIN_REASONS: usize = PlainReject::ALL.len();
const COUNTS: usize = 16;

/// One count of a reading.
#[derive(Debug, Clone, Copy)]
struct Count {
    /// Name in reports.
    name: &'static str,
    /// True when it is reported even if zero.
    is_always_reported: bool,
    place: fn(&mut PortReading) -> &mut u64,
}

/// All counts: the single list that is published and reported.
const ALL: [Count; COUNTS] = [
    always("packets_received", |reading| &mut reading.counters.received),
    always("packets_sent", |reading| &mut reading.counters.sent),
    always("packets_overflowed", |reading| &mut reading.counters.overflows),
    always("queue_overflowed", |reading| &mut reading.queue_overflows),
    sometimes("send_queue_overflowed", |reading| &mut reading.send_overflows),
    sometimes("packets_unsent", |reading| &mut reading.counters.unsent),
    sometimes("bus_errors", |reading| &mut reading.counters.errors),
    sometimes("bus_off", |reading| &mut reading.counters.bus_off),
    sometimes("bus_restarted", |reading| &mut reading.counters.restarted),
    sometimes("packets_unstamped", |reading| &mut reading.counters.unstamped),
    sometimes("link_lost", |reading| &mut reading.counters.lost),
    sometimes("link_regained", |reading| &mut reading.counters.regained),
    sometimes("connections_failed", |reading| &mut reading.counters.unreached),
    sometimes("connections_refused", |reading| &mut reading.counters.refused),
    sometimes("packets_foreign", |reading| &mut reading.counters.foreign),
    sometimes("packets_oversize", |reading| &mut reading.counters.oversize),
];

// A counter that is added to a link must be added above.
const _: () = assert!(size_of::<LinkCounters>() == (COUNTS - 2) * size_of::<u64>());
// A watcher of the run has fields for all of them.
const _: () = assert!(COUNTS < NAMES_MAX && REASONS + PLAIN_REASONS <= NAMES_MAX);

const fn always(name: &'static str, place: fn(&mut PortReading) -> &mut u64) -> Count {
    Count { name, is_always_reported: true, place }
}

const fn sometimes(name: &'static str, place: fn(&mut PortReading) -> &mut u64) -> Count {
    Count { name, is_always_reported: false, place }
}

/// Counters of a port so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PortReading {
    /// Packet counts and link events.
    pub counters: LinkCounters,
    /// Rejections, by the reason's code.
    pub rejects: [u32; REASONS],
    /// Rejections of plain messages, by the reason's place.
    pub plain_rejects: [u32; PLAIN_REASONS],
    /// The first plain message that was refused.
    pub first_refused: Option<RefusedMessage>,
    /// Messages lost between the receiving thread and the frame thread.
    pub queue_overflows: u64,
    /// Messages to the flight computer lost between the frame thread and the sending thread.
    pub send_overflows: u64,
}

impl PortReading {
    /// Reads the counters of a port.
    pub fn of(port: &Port, queue_overflows: u64) -> Self {
        let mut rejects = [0; REASONS];
        for (count, (_, counted)) in rejects.iter_mut().zip(port.rejects().iter()) {
            *count = counted;
        }
        let mut plain_rejects = [0; PLAIN_REASONS];
        for (count, (_, counted)) in plain_rejects.iter_mut().zip(port.plain_rejects().iter()) {
            *count = counted;
        }
        let (counters, first_refused) = (port.counters(), port.first_refused());
        Self { counters, rejects, plain_rejects, first_refused, queue_overflows, send_overflows: 0 }
    }

    /// Returns the rejections of several ports together.
    pub fn rejects_of_all(readings: &[Self]) -> [u32; REASONS] {
        core::array::from_fn(|i| readings.iter().fold(0_u32, |sum, reading| sum.saturating_add(reading.rejects[i])))
    }

    /// Returns each reason to refuse a message with its count.
    pub fn rejects(&self) -> impl Iterator<Item = (Reject, u32)> + '_ {
        Reject::ALL.into_iter().zip(self.rejects).filter(|(reason, _)| *reason != Reject::UnknownId)
    }

    /// Returns the number of messages of other nodes: nothing is wrong with them.
    pub fn of_other_nodes(&self) -> u64 {
        let counts = Reject::ALL.into_iter().zip(self.rejects);
        counts.filter(|(reason, _)| *reason == Reject::UnknownId).map(|(_, count)| u64::from(count)).sum()
    }

    /// Returns each reason to refuse plain messages with its count.
    pub fn plain_rejects(&self) -> impl Iterator<Item = (PlainReject, u32)> + '_ {
        PlainReject::ALL.into_iter().zip(self.plain_rejects)
    }

    /// Returns the number of messages that a plain link refused: another layout, another sender, or too long.
    fn refused(&self) -> u64 {
        let rejects = self.plain_rejects.iter().map(|count| u64::from(*count)).sum::<u64>();
        rejects + self.counters.foreign + self.counters.oversize
    }

    /// Returns true when the port is a client over TCP that was never connected.
    pub fn is_unreached(&self) -> bool {
        let LinkCounters { unreached, received, sent, lost, .. } = self.counters;
        unreached > 0 && received + sent + lost == 0
    }

    /// Returns how tries to connect failed and their number, in words that follow the address; `None` where none did.
    pub fn failed_tries(&self) -> Option<String> {
        let LinkCounters { unreached: tries, refused, .. } = self.counters;
        match refused {
            _ if tries == 0 => None,
            0 => Some(format!("cannot be reached (tries: {tries})")),
            _ if refused == tries => Some(format!("refused the connection (tries: {tries})")),
            _ => Some(format!(
                "refused the connection (tries: {refused}), and could not be reached (tries: {})",
                tries - refused
            )),
        }
    }

    /// Returns the number of messages that were refused, for whatever reason; those of other nodes are not.
    pub fn refused_messages(&self) -> u64 {
        self.refused() + self.rejects().map(|(_, count)| u64::from(count)).sum::<u64>()
    }

    /// Returns names and counts for a report; most only when they are not zero.
    pub fn reported(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let named = ALL.into_iter().zip(self.counts());
        let reported = named.filter(|(count, value)| count.is_always_reported || *value > 0);
        let others = Some((OF_OTHER_NODES, self.of_other_nodes())).filter(|(_, count)| *count > 0);
        reported.map(|(count, value)| (count.name, value)).chain(others)
    }

    /// Returns all counts with their names, zeros included except those of plain messages.
    pub fn named(&self) -> PortCounts {
        PortCounts {
            counters: {
                let others = (OF_OTHER_NODES, self.of_other_nodes());
                ALL.into_iter().map(|count| count.name).zip(self.counts()).chain([others]).collect()
            },
            rejects: {
                let plain = self.plain_rejects().filter(|(_, count)| *count > 0);
                let plain = plain.map(|(reason, count)| (reason.name(), u64::from(count)));
                self.rejects().map(|(reason, count)| (reason.name(), u64::from(count))).chain(plain).collect()
            },
        }
    }

    fn counts(mut self) -> [u64; COUNTS] {
        ALL.map(|count| *(count.place)(&mut self))
    }

    /// Adds ledger events for changes of the link since `earlier`.
    pub fn announce(&self, earlier: &Self, at: Tai, ledger: &mut Ledger) {
        let (now, then) = (&self.counters, &earlier.counters);
        let risen = [
            (EventKind::LinkLost, now.lost, then.lost),
            (EventKind::LinkRegained, now.regained, then.regained),
            // Once: tries follow each other until somebody listens.
            (EventKind::LinkUnreached, now.unreached.min(1), then.unreached.min(1)),
            (EventKind::BusOff, now.bus_off, then.bus_off),
            (EventKind::LinkErrors, now.errors, then.errors),
            (EventKind::LinkOverflow, now.overflows + now.unsent, then.overflows + then.unsent),
            (EventKind::QueueOverflow, self.queue_overflows, earlier.queue_overflows),
            (EventKind::LinkOverflow, self.send_overflows, earlier.send_overflows),
            (EventKind::InputRefused, self.refused(), earlier.refused()),
        ];
        for (kind, _, _) in risen.into_iter().filter(|(_, now, then)| now > then) {
            ledger.note(Event::new(kind, at, None, Span::ZERO));
        }
    }
}

/// A reading that one thread writes and others read.
#[derive(Debug, Default)]
pub struct SharedReading {
    counts: [AtomicU64; COUNTS],
    rejects: [AtomicU32; REASONS],
    plain_rejects: [AtomicU32; PLAIN_REASONS],
    first_refused: OnceLock<RefusedMessage>,
}

impl SharedReading {
    /// Publishes a reading.
    pub fn publish(&self, reading: &PortReading) {
        for (shared, count) in self.counts.iter().zip(reading.counts()) {
            shared.store(count, Ordering::Relaxed);
        }
        let rejects = self.rejects.iter().chain(&self.plain_rejects);
        for (shared, count) in rejects.zip(reading.rejects.into_iter().chain(reading.plain_rejects)) {
            shared.store(count, Ordering::Relaxed);
        }
        if let Some(first) = reading.first_refused.filter(|_| self.first_refused.get().is_none()) {
            let _ = self.first_refused.set(first); // the first one is kept
        }
    }

    /// Returns the latest published reading.
    pub fn read(&self) -> PortReading {
        let rejects = self.rejects.each_ref().map(|count| count.load(Ordering::Relaxed));
        let plain_rejects = self.plain_rejects.each_ref().map(|count| count.load(Ordering::Relaxed));
        let first_refused = self.first_refused.get().copied();
        let mut reading = PortReading { rejects, plain_rejects, first_refused, ..PortReading::default() };
        for (count, shared) in ALL.iter().zip(&self.counts) {
            *(count.place)(&mut reading) = shared.load(Ordering::Relaxed);
        }
        reading
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use link::plain::{Encoding, PlainCodec, PlainLayout};

    fn reading() -> PortReading {
        let counters = LinkCounters {
            received: 1,
            sent: 2,
            overflows: 3,
            unsent: 4,
            errors: 5,
            bus_off: 6,
            lost: 7,
            unreached: 17,
            refused: 19,
            regained: 8,
            restarted: 11,
            unstamped: 12,
            foreign: 14,
            oversize: 15,
        };
        let mut rejects = [0; REASONS];
        rejects[Reject::BadCrc as usize] = 9;
        rejects[Reject::UnknownId as usize] = 18;
        let mut plain_rejects = [0; PLAIN_REASONS];
        plain_rejects[PlainReject::Json as usize] = 16;
        let mut codec = PlainCodec::new(PlainLayout { encoding: Encoding::Json, ..PlainLayout::default() });
        assert!(codec.read(b"SC[0].svb").is_none(), "not JSON");
        let first_refused = codec.first_refused();
        PortReading { counters, rejects, plain_rejects, first_refused, queue_overflows: 10, send_overflows: 13 }
    }

    #[test]
    fn every_value_crosses() {
        let shared = SharedReading::default();
        assert_eq!(shared.read(), PortReading::default());
        shared.publish(&reading());
        assert_eq!(shared.read(), reading());
    }

    #[test]
    fn reports_have_what_is_not_zero_and_a_few_counts_always() {
        let reported: Vec<_> = PortReading::default().reported().collect();
        let always = ["packets_received", "packets_sent", "packets_overflowed", "queue_overflowed"];
        assert_eq!(reported, always.map(|name| (name, 0)));
        let reported: Vec<_> = reading().reported().map(|(_, count)| count).collect();
        // Each of the sixteen appears once, and the messages of other nodes; 9 and 16 are counts of rejections.
        assert_eq!(reported, [1, 2, 3, 10, 13, 4, 5, 6, 11, 12, 7, 8, 17, 19, 14, 15, 18]);
        assert_eq!(reading().refused_messages(), 9 + 16 + 14 + 15, "without those of other nodes");
        let named = reading().named();
        assert!(named.counters.iter().map(|(_, count)| count).eq(reported), "the same with all names");
        let refused: Vec<_> = named.rejects.iter().filter(|(_, count)| *count > 0).collect();
        let wanted = vec![("BadCrc", 9), ("plain_not_json", 16)];
        assert_eq!((refused, named.rejects.iter().count()), (wanted, REASONS));
    }

    #[test]
    fn failed_tries_are_refused_or_not_answered() {
        let of = |unreached, refused, received| {
            let counters = LinkCounters { unreached, refused, received, ..LinkCounters::default() };
            let reading = PortReading { counters, ..PortReading::default() };
            (reading.failed_tries().unwrap_or_default(), reading.is_unreached())
        };
        assert_eq!(of(5, 5, 0), ("refused the connection (tries: 5)".into(), true));
        assert_eq!(of(5, 0, 0), ("cannot be reached (tries: 5)".into(), true));
        let both = "refused the connection (tries: 2), and could not be reached (tries: 3)";
        assert_eq!((of(5, 2, 0), of(5, 2, 1)), ((both.into(), true), (both.into(), false)), "connected at last");
        assert_eq!(of(0, 0, 0), (String::new(), false), "control: another kind of link");
    }

    #[test]
    fn only_what_has_risen_is_reported() {
        let mut ledger = Ledger::default();
        reading().announce(&reading(), Tai::from_ns(0), &mut ledger);
        assert!(EventKind::ALL.iter().all(|kind| ledger.count(*kind) == 0), "nothing has happened");
        let mut later = reading();
        later.counters.bus_off += 1;
        later.counters.received += 100;
        later.announce(&reading(), Tai::from_ns(0), &mut ledger);
        assert_eq!((ledger.count(EventKind::BusOff), ledger.count(EventKind::LinkLost)), (1, 0));
        assert_eq!(ledger.count(EventKind::InputRefused), 0);
        later.plain_rejects[0] += 1;
        later.announce(&reading(), Tai::from_ns(0), &mut ledger);
        assert_eq!(ledger.count(EventKind::InputRefused), 1);
    }
}
