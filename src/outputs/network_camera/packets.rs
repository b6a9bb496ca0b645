//! Packets of a block -> the system, many in one call, at the stream's pace; some lost on purpose when that is asked
//! for.

use crate::network_camera::gvsp::{Block, HEADER_BYTES, gone};
use crate::network_camera::{counters::Tally, interface, params::PACKET_BYTES_MAX};
use base::clock::Clock;
use base::random::{key, philox};
use base::time::{Span, Tai};
use core::ops::Range;
use rustix::net::{MMsgHdr, SendAncillaryBuffer, SendFlags, sendmmsg};
use rustix::{io::Errno, net::addr::SocketAddrArg};
use std::net::{SocketAddrV4, UdpSocket};
use std::{io::IoSlice, sync::Arc};

/// Most packets in one call.
pub(super) const BATCH: usize = 32;

/// Loses one packet in so many, by a fixed sequence of random numbers.
#[derive(Debug, Clone, Copy)]
struct Loss {
    one_in: u32,
    packets: u32,
}

impl Loss {
    fn takes(&mut self) -> bool {
        self.packets = self.packets.wrapping_add(1);
        let [random, ..] = philox([self.packets, 0, 0, 0], key(0));
        random % self.one_in == 0
    }
}

/// Result of one call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sent {
    /// The number after the last packet that was sent or given up.
    pub(super) next: u32,
    /// Packets that the system refused.
    pub(super) refused: u64,
    /// The receiver's machine answered that it has no such port, or cannot be reached.
    pub(super) is_gone: bool,
}

/// Where packets leave.
pub(super) struct Outlet {
    socket: Arc<UdpSocket>,
    clock: Arc<dyn Clock>,
    pace: Pace,
    loss: Option<Loss>,
    tally: Arc<Tally>,
}

impl Outlet {
    pub(super) fn new(
        socket: Arc<UdpSocket>,
        clock: Arc<dyn Clock>,
        rate_bit_s: f64,
        lose_one_in: Option<u32>,
        tally: Arc<Tally>,
    ) -> Self {
        let pace = Pace::new(rate_bit_s, clock.now());
        let loss = lose_one_in.map(|one_in| Loss { one_in: one_in.max(1), packets: 0 });
        Self { socket, clock, pace, loss, tally }
    }

    /// Returns the time on the clock of the pace.
    pub(super) fn now(&self) -> Tai {
        self.clock.now()
    }

    /// Sends as many of the block's packets as make one batch.
    pub(super) fn send(&mut self, to: SocketAddrV4, block: &Block, numbers: Range<u32>) -> Sent {
        let settings = &block.settings;
        let most = self.pace.batch(settings.packet_bytes, settings.delay_ns, BATCH);
        let mut heads = [[0; HEADER_BYTES]; BATCH];
        let mut data: [&[u8]; BATCH] = [&[]; BATCH];
        let (mut filled, mut bytes, mut next) = (0, 0, numbers.start);
        for number in numbers.take(most) {
            let Some((head, packet)) = block.packet(number) else { break };
            next = number + 1;
            if self.loss.as_mut().is_some_and(Loss::takes) {
                self.tally.packets_lost_on_purpose.one();
                continue;
            }
            (heads[filled], data[filled]) = (head, packet);
            bytes += HEADER_BYTES + packet.len();
            filled += 1;
        }
        self.pace.wait(&*self.clock, bytes, filled, settings.delay_ns);
        let (refused, is_gone) = self.send_all(to, &heads, &data, filled);
        Sent { next, refused, is_gone }
    }

    /// Answers that so many packets from `first` on are not available any more, one batch of them at most.
    pub(super) fn send_gone(&mut self, to: SocketAddrV4, block: u16, first: u32, packets: usize) {
        let filled = packets.min(BATCH);
        let mut heads = [[0; HEADER_BYTES]; BATCH];
        heads[..filled].iter_mut().zip(first..).for_each(|(head, number)| *head = gone(block, number));
        self.pace.wait(&*self.clock, filled * HEADER_BYTES, filled, 0);
        self.send_all(to, &heads, &[&[]; BATCH], filled);
    }

    /// Hands packets to the system. Returns how many it refused, and whether the receiver is gone.
    fn send_all(
        &self,
        to: SocketAddrV4,
        heads: &[[u8; HEADER_BYTES]; BATCH],
        data: &[&[u8]; BATCH],
        filled: usize,
    ) -> (u64, bool) {
        let receiver = to;
        let to = to.as_any();
        let slices: [[IoSlice<'_>; 2]; BATCH] =
            core::array::from_fn(|at| [IoSlice::new(&heads[at]), IoSlice::new(data[at])]);
        let mut no_control: [SendAncillaryBuffer<'_, '_, '_>; BATCH] =
            core::array::from_fn(|_| SendAncillaryBuffer::default());
        let mut at = 0;
        let mut messages = no_control.each_mut().map(|control| {
            at += 1;
            MMsgHdr::new_with_addr(&to, &slices[at - 1], control)
        });
        let (mut sent, mut refused, mut is_gone) = (0, 0, false);
        let mut stale_errors = 0;
        while sent < filled {
            let reported = sendmmsg(&self.socket, &mut messages[sent..filled], SendFlags::empty());
            let bytes = |range: Range<usize>| -> usize { range.map(|at| HEADER_BYTES + data[at].len()).sum() };
            match reported {
                Ok(more) if more > 0 => {
                    self.tally.packets.add(more as u64);
                    self.tally.bytes.add(bytes(sent..sent + more) as u64);
                    sent += more;
                }
                Err(Errno::INTR) => {}
                // An answer of the network to an earlier packet: this one was not sent yet.
                Err(error) if is_unreachable(error) && stale_errors < STALE_ERRORS_MAX => {
                    stale_errors += 1;
                    if interface::take_answers(&self.socket, receiver) {
                        is_gone = true;
                        refused += (filled - sent) as u64;
                        sent = filled;
                    }
                }
                // A refused packet is lost, as on a wire; the client may ask for it again. The first of the rest was
                // refused, or, when no space came in time, all of them: it is not waited for each.
                reported => {
                    let lost = if reported == Err(Errno::AGAIN) { filled - sent } else { 1 };
                    refused += lost as u64;
                    sent += lost;
                }
            }
        }
        self.tally.packets_refused.add(refused);
        (refused, is_gone)
    }
}

/// Errors of earlier receivers that one batch steps over.
const STALE_ERRORS_MAX: u32 = 8;

/// Returns true for errors by which the system reports an ICMP answer to an earlier packet.
fn is_unreachable(error: Errno) -> bool {
    matches!(error, Errno::CONNREFUSED | Errno::HOSTUNREACH | Errno::NETUNREACH | Errno::ACCESS | Errno::NOPROTOOPT)
}

/// Time that test packets may run ahead of the rate: clients try sizes one after another.
const TESTS_AHEAD: Span = Span::from_ms(100);

/// Where test packets leave: at once, so that none comes after the answer to its command, and no faster than the
/// stream.
pub(super) struct TestOutlet {
    socket: Arc<UdpSocket>,
    ns_per_byte: f64,
    /// When all that was sent would be over at the rate.
    paid_until: Tai,
    zeros: Box<[u8]>,
    tally: Arc<Tally>,
}

impl TestOutlet {
    pub(super) fn new(socket: Arc<UdpSocket>, rate_bit_s: f64, now: Tai, tally: Arc<Tally>) -> Self {
        let zeros = vec![0; PACKET_BYTES_MAX as usize].into();
        Self { socket, ns_per_byte: 8e9 / rate_bit_s, paid_until: now, zeros, tally }
    }

    /// Sends zeros, to be measured by the client; refuses when there were too many before.
    pub(super) fn send(&mut self, to: SocketAddrV4, bytes: usize, now: Tai) {
        if self.paid_until - now > TESTS_AHEAD {
            return self.tally.test_packets_refused.one();
        }
        self.paid_until = self.paid_until.max(now) + Span::from_s(self.ns_per_byte * 1e-9 * bytes as f64);
        let Ok(sent) = self.socket.send_to(&self.zeros[..bytes.min(self.zeros.len())], to) else {
            return self.tally.packets_refused.one();
        };
        self.tally.test_packets.one();
        self.tally.packets.one();
        self.tally.bytes.add(sent as u64);
    }
}

// When packets may leave: a stated rate and the client's own pause between packets.
//
// A receiver's buffer holds a few hundred packets; a frame sent at once overruns it. Packets leave in small batches,
// each followed by the time that it takes at the rate. After a late wake-up the lost time is caught up, but no more
// than [`CATCH_UP`], so that the pace never turns into a burst. Test: the average rate on a clock that does not
// advance between batches, and one that oversleeps.

/// Time that may be caught up.
const CATCH_UP: Span = Span::from_ns(500_000);
/// Duration of a batch: shorter ones cost wake-ups, longer ones are bursts.
const BATCH_TIME: Span = Span::from_ns(200_000);

/// The pace of one stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pace {
    ns_per_byte: f64,
    next: Tai,
}

impl Pace {
    /// Returns a pace of so many bits a second.
    pub(super) fn new(rate_bit_s: f64, now: Tai) -> Self {
        Self { ns_per_byte: 8e9 / rate_bit_s, next: now }
    }

    /// Returns packets of one batch, 1 to `most`.
    pub(super) fn batch(&self, packet_bytes: usize, delay_ns: u32, most: usize) -> usize {
        let packet_ns = self.packet_ns(packet_bytes, delay_ns);
        let fit = (BATCH_TIME.ns() as f64 / packet_ns.max(1.0)).floor();
        (1..most).find(|count| (*count + 1) as f64 > fit).unwrap_or(most)
    }

    fn packet_ns(&self, bytes: usize, delay_ns: u32) -> f64 {
        self.ns_per_byte * bytes as f64 + f64::from(delay_ns)
    }

    /// Waits until the next batch may leave, and books its time.
    pub(super) fn wait(&mut self, clock: &dyn Clock, bytes: usize, packets: usize, delay_ns: u32) {
        let now = clock.now();
        if self.next > now {
            clock.sleep_until(self.next);
        }
        let taken_ns = self.ns_per_byte * bytes as f64 + f64::from(delay_ns) * packets as f64;
        self.next = self.next.max(now - CATCH_UP) + Span::from_s(taken_ns * 1e-9);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    #[test]
    fn test_packets_keep_the_rate() {
        let socket = || UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let receiver = socket();
        let to = SocketAddrV4::new(Ipv4Addr::LOCALHOST, receiver.local_addr().unwrap().port());
        let (start, tally) = (Tai::from_ns(1_000_000_000), Arc::new(Tally::default()));
        // 1000 bytes take 10 ms: ten at once make 100 ms, and one more may still go.
        let mut outlet = TestOutlet::new(Arc::new(socket()), 8e5, start, Arc::clone(&tally));
        (0..20).for_each(|_| outlet.send(to, 1_000, start));
        assert_eq!((tally.test_packets.read(), tally.test_packets_refused.read()), (11, 9));
        (0..20).for_each(|_| outlet.send(to, 1_000, start + Span::from_ms(50)));
        assert_eq!((tally.test_packets.read(), tally.test_packets_refused.read()), (16, 24));
        assert_eq!(tally.bytes.read(), 16_000);
    }
}

#[cfg(test)]
mod pacing_tests {
    use super::*;
    use base::clock::Virtual;

    const START: Tai = Tai::from_ns(1_000_000_000);

    /// A clock whose every sleep is longer by so much.
    struct Sleepy(Virtual, Span);

    impl Clock for Sleepy {
        fn now(&self) -> Tai {
            self.0.now()
        }
        fn sleep_until(&self, at: Tai) {
            self.0.sleep_until(at + self.1);
        }
        fn is_real(&self) -> bool {
            false
        }
    }

    /// Returns seconds that 10 MB take in batches of 10 packets.
    fn duration_s(delay_ns: u32, oversleep: Span) -> f64 {
        let clock = Sleepy(Virtual::new(START), oversleep);
        let mut pace = Pace::new(8e8, START);
        for _ in 0..1000 {
            pace.wait(&clock, 10_000, 10, delay_ns);
        }
        (clock.now() - START).s()
    }

    #[test]
    fn the_rate_is_kept_on_average_and_the_pause_is_added() {
        assert!((duration_s(0, Span::ZERO) - 0.0999).abs() < 1e-6, "100 us for each batch but the last");
        assert!((duration_s(5_000, Span::ZERO) - 0.14985).abs() < 1e-6, "and 50 us of pause");
        assert!((duration_s(0, Span::from_ns(60_000)) - 0.0999).abs() < 2e-4, "short oversleeping is caught up");
        // Of each 2 ms that are slept too long 0.5 ms are caught up: six batches in 2 ms instead of twenty.
        assert!((0.3..0.4).contains(&duration_s(0, Span::from_ms(2))), "long oversleeping is not");
    }

    #[test]
    fn batches_take_about_their_time() {
        let pace = Pace::new(8e8, START);
        assert_eq!(pace.batch(1_500, 0, 32), 13, "15 us each");
        assert_eq!(pace.batch(9_000, 0, 32), 2);
        assert_eq!(pace.batch(65_000, 0, 32), 1);
        assert_eq!(pace.batch(1_500, 1_000_000, 32), 1);
        assert_eq!(pace.batch(100, 0, 32), 32);
    }
}
