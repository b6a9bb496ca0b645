//! Packets of a block -> the system, many in one call, at the stream's pace; some lost on purpose when that is asked for.

use crate::base::clock::Clock;
use crate::base::random::{key, philox};
use crate::network_camera::counters::Tally;
use crate::network_camera::gvsp::{Block, HEADER_BYTES, gone};
use crate::network_camera::pacing::Pace;
use core::ops::Range;
use rustix::io::Errno;
use rustix::net::addr::SocketAddrArg;
use rustix::net::{MMsgHdr, SendAncillaryBuffer, SendFlags, sendmmsg};
use std::io::IoSlice;
use std::net::{SocketAddrV4, UdpSocket};
use std::sync::Arc;

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

    /// Sends as many of the block's packets as make one batch; the number after the last that was sent or given up.
    pub(super) fn send(&mut self, to: SocketAddrV4, block: &Block, numbers: Range<u32>) -> u32 {
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
        self.send_all(to, &heads, &data, filled);
        next
    }

    /// Tells that a packet is no more.
    pub(super) fn send_gone(&mut self, to: SocketAddrV4, block: u16, number: u32) {
        self.pace.wait(&*self.clock, HEADER_BYTES, 1, 0);
        let mut heads = [[0; HEADER_BYTES]; BATCH];
        heads[0] = gone(block, number);
        self.send_all(to, &heads, &[&[]; BATCH], 1);
    }

    fn send_all(&self, to: SocketAddrV4, heads: &[[u8; HEADER_BYTES]; BATCH], data: &[&[u8]; BATCH], filled: usize) {
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
        let mut sent = 0;
        while sent < filled {
            let told = sendmmsg(&self.socket, &mut messages[sent..filled], SendFlags::empty());
            let bytes = |range: Range<usize>| -> usize { range.map(|at| HEADER_BYTES + data[at].len()).sum() };
            match told {
                Ok(more) if more > 0 => {
                    self.tally.packets.add(more as u64);
                    self.tally.bytes.add(bytes(sent..sent + more) as u64);
                    sent += more;
                }
                Err(Errno::INTR) => {}
                // The first of the rest was refused: it is lost, as on a wire; the client may ask for it again.
                Ok(_) | Err(_) => {
                    self.tally.packets_refused.one();
                    sent += 1;
                }
            }
        }
    }
}
