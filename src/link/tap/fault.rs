//! A link on which things go wrong on purpose: loss, silence, delay, duplication, wrong bits; seeded, timed, counted.
//!
//! Packets are spoilt where they are received, by their receive time, in order of the faults. Deterministic: what becomes
//! of a packet depends on the seed and on the packets before it only. Limits: a delayed packet is delivered when the
//! receiver next looks; on a real CAN bus wrong bits are repaired by the controllers, so wrong bits stand for what gets
//! past them. Tests: `fault_tests`.

use crate::base::clock::Clock;
use crate::base::time::{Span, Tai};
use crate::link::{Departure, Link, LinkCounters, LinkError, Packet, SerialChunk, Stamped};
use firmware_protocol::can::CanFrame;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most copies of one packet, however many faults double it.
const MOST_COPIES: u32 = 8;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LinkFault {
    /// A share of the packets is lost.
    Loss {
        /// 0 to 1.
        share: f64,
    },
    /// Nothing arrives.
    Silence,
    /// Everything arrives later.
    Delay {
        /// Constant part.
        by: Span,
        /// Added at random, uniform from 0 to this: packets may overtake each other.
        jitter: Span,
    },
    /// A share of the packets arrives twice.
    Duplicate {
        /// 0 to 1.
        share: f64,
    },
    /// One bit is wrong in a share of the packets.
    WrongBits {
        /// 0 to 1.
        share: f64,
    },
}

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedLinkFault {
    /// Begin.
    pub from: Tai,
    /// End, exclusive.
    pub until: Tai,
    /// What goes wrong.
    pub fault: LinkFault,
    /// Packets hit so far.
    pub hits: u64,
}

/// The list of faults, shared by a link and whoever commands it.
#[derive(Debug, Clone, Default)]
pub struct FaultControl {
    timed: Arc<Mutex<Vec<TimedLinkFault>>>,
}

impl FaultControl {
    fn lock(&self) -> MutexGuard<'_, Vec<TimedLinkFault>> {
        self.timed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a fault; the number under which [`Self::timed`] lists it.
    pub fn add(&self, from: Tai, until: Tai, fault: LinkFault) -> usize {
        let mut timed = self.lock();
        timed.push(TimedLinkFault { from, until, fault, hits: 0 });
        timed.len() - 1
    }

    /// Every fault, in the order in which they were added, with its hits.
    #[must_use]
    pub fn timed(&self) -> Vec<TimedLinkFault> {
        self.lock().clone()
    }
}

/// A link that spoils what it receives.
pub struct FaultyLink {
    inner: Box<dyn Link>,
    clock: Arc<dyn Clock>,
    control: FaultControl,
    dice: StdRng,
    /// Received and not yet handed on, by time of arrival.
    waiting: VecDeque<Stamped<Packet>>,
}

impl FaultyLink {
    /// Faults of `control` on top of `inner`.
    #[must_use]
    pub fn new(inner: Box<dyn Link>, clock: Arc<dyn Clock>, control: FaultControl, seed: u64) -> Self {
        Self { inner, clock, control, dice: StdRng::seed_from_u64(seed), waiting: VecDeque::new() }
    }

    /// What becomes of one packet: none, one or two of it, perhaps later or with a wrong bit.
    fn spoil(&mut self, mut packet: Stamped<Packet>) {
        let mut copies = 1;
        let Self { control, dice, .. } = self;
        let arrived = packet.at;
        for timed in control.lock().iter_mut().filter(|timed| timed.from <= arrived && arrived < timed.until) {
            let hit = match timed.fault {
                LinkFault::Silence => true,
                LinkFault::Loss { share } | LinkFault::Duplicate { share } | LinkFault::WrongBits { share } => {
                    dice.random::<f64>() < share
                }
                LinkFault::Delay { .. } => true,
            };
            if !hit {
                continue;
            }
            timed.hits += 1;
            match timed.fault {
                LinkFault::Silence | LinkFault::Loss { .. } => copies = 0,
                LinkFault::Delay { by, jitter } => {
                    packet.at = packet.at + by + Span::from_s(jitter.s() * dice.random::<f64>());
                }
                LinkFault::Duplicate { .. } => copies = (copies * 2).min(MOST_COPIES),
                LinkFault::WrongBits { .. } => flip_a_bit(&mut packet.value, dice),
            }
        }
        let place = self.waiting.partition_point(|earlier| earlier.at <= packet.at);
        (0..copies).for_each(|_| self.waiting.insert(place, packet));
    }

    fn due_by(&mut self, now: Tai) -> Option<Stamped<Packet>> {
        let is_due = self.waiting.front().is_some_and(|first| first.at <= now);
        if is_due { self.waiting.pop_front() } else { None }
    }
}

fn flip_a_bit(packet: &mut Packet, dice: &mut StdRng) {
    let flip = |bytes: &mut [u8], dice: &mut StdRng| {
        if !bytes.is_empty() {
            let bit = dice.random_range(0..8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    };
    match packet {
        Packet::Can(frame) => {
            let mut bytes = frame.data().to_vec();
            flip(&mut bytes, dice);
            let make = if frame.is_fd() { CanFrame::fd } else { CanFrame::classic };
            *frame = make(frame.id(), &bytes).unwrap_or(*frame);
        }
        Packet::Serial(chunk) => {
            let mut bytes = chunk.as_slice().to_vec();
            flip(&mut bytes, dice);
            *chunk = SerialChunk::new(&bytes).unwrap_or(*chunk);
        }
    }
}

impl Link for FaultyLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        loop {
            let now = self.clock.now();
            if let Some(packet) = self.due_by(now) {
                return Ok(Some(packet));
            }
            let wake = self.waiting.front().map_or(until, |first| first.at.min(until));
            match self.inner.receive(wake)? {
                Some(packet) => self.spoil(packet),
                None if self.clock.is_real() && self.clock.now() < until => {}
                None => return Ok(self.due_by(self.clock.now())),
            }
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        self.inner.send(packet)
    }

    fn counters(&self) -> LinkCounters {
        self.inner.counters()
    }

    fn departure(&mut self, sent: u64) -> Departure {
        self.inner.departure(sent)
    }
}
