//! The link that spoils received packets, and loses sent packets while it is off the bus.
//!
//! On the virtual clock the order in which packets are spoilt, and so the random numbers, is that of their receive
//! times, however often the receiver looks.

use super::damage::{babble, cut_the_tail, flip_a_bit};
use super::{FaultControl, LinkFault, TimedLinkFault};
use crate::{Departure, Link, LinkCounters, LinkError, Packet, Stamped, WireFormat};
use base::clock::Clock;
use base::time::{Span, Tai};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::{collections::VecDeque, sync::Arc};

/// Most copies of one packet, however many faults double it.
const MOST_COPIES: u32 = 8;
/// Most packets that wait to be handed on; more are lost and counted.
const MOST_WAITING: usize = 65_536;

/// A link that spoils the packets that it receives.
pub struct FaultyLink {
    inner: Box<dyn Link>,
    clock: Arc<dyn Clock>,
    control: FaultControl,
    dice: StdRng,
    /// Form of babble.
    format: WireFormat,
    /// Faults that lose a share of the sent packets.
    sent_faults: Option<FaultControl>,
    /// Received and not yet handed on, in order of when they are due.
    waiting: VecDeque<Waiting>,
    overflows: u64,
    unsent: u64,
    /// Packets that were sent, and lost here or not; the number of the last one that was lost here.
    sent: u64,
    last_unsent: Option<u64>,
}

/// A stamp may be wrong on purpose: when a packet is handed on is kept beside it.
#[derive(Clone, Copy)]
struct Waiting {
    due: Tai,
    packet: Stamped<Packet>,
}

impl FaultyLink {
    /// Faults of `control` on top of `inner`; babble is classic CAN.
    pub fn new(inner: Box<dyn Link>, clock: Arc<dyn Clock>, control: FaultControl, seed: u64) -> Self {
        Self {
            inner,
            clock,
            control,
            dice: StdRng::seed_from_u64(seed),
            format: WireFormat::CanClassic,
            sent_faults: None,
            waiting: VecDeque::new(),
            overflows: 0,
            unsent: 0,
            sent: 0,
            last_unsent: None,
        }
    }

    /// Returns the same with babble of another wire.
    #[must_use]
    pub fn babbling_as(self, format: WireFormat) -> Self {
        Self { format, ..self }
    }

    /// Returns the same with faults of `control` on the way out: where the other end is outside this program, losses
    /// and silence on its side act on sent packets.
    #[must_use]
    pub fn losing_sent(self, control: FaultControl) -> Self {
        Self { sent_faults: Some(control), ..self }
    }

    /// Returns whether a packet that is sent now is lost on its way.
    fn loses_sent(&mut self, now: Tai) -> bool {
        let Self { sent_faults: Some(control), dice, .. } = self else { return false };
        let mut is_lost = false;
        for timed in control.lock().iter_mut().filter(|timed| timed.is_active(now)) {
            let hits = match timed.fault {
                LinkFault::Loss { share } => dice.random::<f64>() < share,
                LinkFault::Silence | LinkFault::Off => true,
                LinkFault::Delay { .. }
                | LinkFault::Duplicate { .. }
                | LinkFault::WrongBits { .. }
                | LinkFault::Reorder { .. }
                | LinkFault::Truncate { .. }
                | LinkFault::Babble { .. }
                | LinkFault::ClockStep { .. }
                | LinkFault::ClockDrift { .. } => false,
            };
            timed.hits += u64::from(hits);
            is_lost |= hits;
        }
        is_lost
    }

    /// Takes a packet in, after the babble that was there before it.
    fn admit(&mut self, packet: Stamped<Packet>) {
        self.babble_until(packet.at);
        self.spoil(packet);
    }

    fn babble_until(&mut self, until: Tai) {
        while let Some(packet) = self.next_babble(until) {
            self.spoil(packet);
        }
    }

    /// Returns the next packet of babble that is due by `until`.
    fn next_babble(&mut self, until: Tai) -> Option<Stamped<Packet>> {
        let Self { control, dice, format, .. } = self;
        loop {
            let mut timed = control.lock();
            let due = timed.iter_mut().filter_map(|fault| Some((fault.babble_due()?, fault)));
            let (at, fault) = due.min_by_key(|(at, _)| *at).filter(|(at, _)| *at <= until)?;
            fault.hits += 1;
            let LinkFault::Babble { id, bytes, .. } = fault.fault else { return None };
            if let Some(value) = babble(*format, id, bytes, dice) {
                return Some(Stamped { at, value });
            }
        }
    }

    fn babble_due(&self) -> Option<Tai> {
        self.control.lock().iter().filter_map(TimedLinkFault::babble_due).min()
    }

    /// Delivers one packet with the faults: not at all, once or several times, perhaps later, damaged or with another
    /// stamp.
    fn spoil(&mut self, packet: Stamped<Packet>) {
        let mut spoilt = Spoilt { copies: 1, later: Span::ZERO, stamp_off: Span::ZERO, value: packet.value };
        let Self { control, dice, .. } = self;
        for timed in control.lock().iter_mut().filter(|timed| timed.is_active(packet.at)) {
            if spoilt.hit(timed, packet.at, dice) {
                timed.hits += 1;
            }
        }
        let due = packet.at + spoilt.later;
        let packet = Stamped { at: due + spoilt.stamp_off, value: spoilt.value };
        let place = self.waiting.partition_point(|earlier| earlier.due <= due);
        for _ in 0..spoilt.copies {
            if self.waiting.len() >= MOST_WAITING {
                self.overflows += 1;
            } else {
                self.waiting.insert(place, Waiting { due, packet });
            }
        }
    }

    /// Takes in everything that has arrived by `now`, without waiting.
    fn take_in(&mut self, now: Tai) -> Result<(), LinkError> {
        while let Some(packet) = self.inner.receive(now)? {
            self.admit(packet);
        }
        self.babble_until(now);
        Ok(())
    }

    fn due_by(&mut self, now: Tai) -> Option<Stamped<Packet>> {
        let is_due = self.waiting.front().is_some_and(|first| first.due <= now);
        if is_due { self.waiting.pop_front().map(|first| first.packet) } else { None }
    }
}

/// A packet while faults act on it.
struct Spoilt {
    copies: u32,
    later: Span,
    stamp_off: Span,
    value: Packet,
}

impl Spoilt {
    /// Lets a fault act on a packet that arrived at `arrived`; false when it did nothing to it.
    fn hit(&mut self, timed: &TimedLinkFault, arrived: Tai, dice: &mut StdRng) -> bool {
        let is_hit = match timed.fault {
            LinkFault::Loss { share }
            | LinkFault::Duplicate { share }
            | LinkFault::WrongBits { share }
            | LinkFault::Reorder { share, .. }
            | LinkFault::Truncate { share } => dice.random::<f64>() < share,
            LinkFault::Babble { .. } => false,
            LinkFault::Silence
            | LinkFault::Delay { .. }
            | LinkFault::ClockStep { .. }
            | LinkFault::ClockDrift { .. }
            | LinkFault::Off => true,
        };
        if !is_hit {
            return false;
        }
        match timed.fault {
            LinkFault::Silence | LinkFault::Off | LinkFault::Loss { .. } => self.copies = 0,
            LinkFault::Delay { by, jitter } => {
                self.later = self.later + by + Span::from_s(jitter.s() * dice.random::<f64>());
            }
            LinkFault::Reorder { by, .. } => self.later = self.later + by,
            LinkFault::Duplicate { .. } => self.copies = (self.copies * 2).min(MOST_COPIES),
            LinkFault::WrongBits { .. } => flip_a_bit(&mut self.value, dice),
            LinkFault::Truncate { .. } => return cut_the_tail(&mut self.value, dice),
            LinkFault::ClockStep { by } => self.stamp_off = self.stamp_off + by,
            LinkFault::ClockDrift { ppm } => {
                self.stamp_off = self.stamp_off + Span::from_s((arrived - timed.from).s() * ppm * 1e-6);
            }
            LinkFault::Babble { .. } => {}
        }
        true
    }
}

impl Link for FaultyLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        loop {
            let now = self.clock.now();
            self.take_in(now)?;
            let packet = self.due_by(now);
            if packet.is_some() || !self.clock.is_real() || now >= until {
                return Ok(packet);
            }
            let due = self.waiting.front().map(|first| first.due);
            let wake = due.into_iter().chain(self.babble_due()).min().map_or(until, |due| due.min(until));
            if let Some(packet) = self.inner.receive(wake)? {
                self.admit(packet);
            }
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let now = self.clock.now();
        let is_off = |timed: &&mut TimedLinkFault| timed.fault == LinkFault::Off && timed.is_active(now);
        let off = self.control.lock().iter_mut().find(is_off).map(|off| off.hits += 1);
        if off.is_some() || self.loses_sent(now) {
            self.unsent += 1;
            self.last_unsent = Some(self.sent);
            self.sent += 1;
            return Ok(now);
        }
        let leaves = self.inner.send(packet)?;
        self.sent += 1;
        Ok(leaves)
    }

    /// Returns the departure; it is right for packets sent after the last packet that was lost here, and for that
    /// packet.
    fn departure(&mut self, sent: u64) -> Departure {
        if self.last_unsent.is_some_and(|lost| sent <= lost) {
            return Departure::Never;
        }
        self.inner.departure(sent - self.unsent)
    }

    fn counters(&self) -> LinkCounters {
        let inner = self.inner.counters();
        let now = self.clock.now();
        let offs =
            self.control.lock().iter().filter(|timed| timed.fault == LinkFault::Off && timed.from <= now).count();
        LinkCounters {
            overflows: inner.overflows + self.overflows,
            unsent: inner.unsent + self.unsent,
            bus_off: inner.bus_off + offs as u64,
            ..inner
        }
    }
}
