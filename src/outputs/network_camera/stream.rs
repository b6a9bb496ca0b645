//! The stream's thread: frames that wait -> packets, and packets that a client asks for again.
//!
//! A frame is turned into the wanted format in a kept block, its slot goes back at once, and its packets leave at the
//! stream's pace. Between two batches, and between frames at once, one batch of the packets that clients ask for may
//! go; one frame allows at most [`RESENT_PER_SENT`] times its own packets, answers that a packet is gone included, so
//! that a client cannot starve the next frame by asking.
//!
//! When the sink hangs up, waiting frames are sent and requests are answered until none come, or until the deadline
//! that the sink set: a client cannot delay the end of a run. Every frame and every packet that was requested again is
//! counted once, by its outcome.

use crate::network_camera::gvsp::{Block, StreamSettings, next_id};
use crate::network_camera::pixel_format::{PixelFormat, append_regions};
use crate::network_camera::shared::{Shared, Slot};
use crate::network_camera::{chunk, gvcp::Resend, packets::Outlet, test_pattern::TestPattern};
use base::time::Span;
use crossbeam_channel::{Receiver, RecvError, Select, Sender, TryRecvError};
use frames::sink::LossKind;
use std::{net::SocketAddrV4, sync::Arc, time::Duration};

/// Packets sent again for one frame, at most, in packets of that frame.
const RESENT_PER_SENT: u64 = 2;
/// Packets of one request that are answered as gone; a client needs only the first.
const GONE_MAX: u64 = 16;
/// How often the end is looked for while it is quiet.
const LOOK: Duration = Duration::from_millis(50);
/// Silence after the last frame in which packets may still be asked for.
const QUIET: Span = Span::from_ms(200);

/// The parts that one stream needs.
pub(super) struct Stream {
    pub(super) shared: Arc<Shared>,
    pub(super) frames: Receiver<Slot>,
    pub(super) free: Sender<Slot>,
    pub(super) asks: Receiver<Resend>,
    pub(super) outlet: Outlet,
    pub(super) kept: Kept,
    pub(super) width_px: usize,
    pub(super) dn_bits: u32,
    /// The rest of one request that is being carried out.
    pub(super) pending: Option<Resend>,
}

/// Blocks that can be sent again, newest last. All buffers are made at the start.
pub(super) struct Kept {
    blocks: Vec<Block>,
    newest: usize,
    last_id: u16,
    /// Where the newest block went: block numbers begin again with another place only.
    destination: Option<SocketAddrV4>,
    acquisition: u32,
    allowance: u64,
}

impl Kept {
    /// Returns storage for so many frames of a sensor, in any format, with chunks.
    pub(super) fn new(frames: usize, pixels: usize, settings: StreamSettings) -> Self {
        let bytes = PixelFormat::Mono16.bytes(pixels) + chunk::added_bytes();
        let blocks = (0..frames).map(|_| Block::with_capacity(bytes, settings)).collect();
        Self { blocks, newest: 0, last_id: 0, destination: None, acquisition: 0, allowance: 0 }
    }

    /// Takes the place of the oldest block for the next frame. Block numbers begin again when the stream goes to another
    /// place, and not with each acquisition: a receiver that keeps its stream takes lower numbers for blocks that are late.
    fn begin(&mut self, settings: StreamSettings) -> &mut Block {
        if self.acquisition != settings.acquisition {
            self.acquisition = settings.acquisition;
            self.blocks.iter_mut().for_each(|block| block.id = 0);
        }
        if self.destination != settings.destination {
            (self.destination, self.last_id) = (settings.destination, 0);
        }
        self.last_id = next_id(self.last_id);
        self.newest = (self.newest + 1) % self.blocks.len().max(1);
        let block = &mut self.blocks[self.newest];
        block.settings = settings;
        block.payload.clear();
        block
    }

    /// Returns the block of a number, when it is of this acquisition and still there.
    fn find(&self, id: u16, acquisition: u32) -> Option<&Block> {
        let is_of_now = id != 0 && self.acquisition == acquisition;
        self.blocks.iter().find(|block| is_of_now && block.id == id)
    }
}

impl Stream {
    /// Runs until the sink hangs up and its frames are out, or until the control side is gone.
    pub(super) fn run(mut self) {
        loop {
            match self.frames.try_recv() {
                Ok(slot) => self.send_frame(slot),
                Err(TryRecvError::Disconnected) => break,
                Err(TryRecvError::Empty) => match self.serve() {
                    Ok(true) => {}
                    Ok(false) => self.wait(),
                    Err(RecvError) => break,
                },
            }
        }
        self.linger();
        self.count_what_is_left();
    }

    /// Waits until a frame or a request comes, or the sink or the control side is gone.
    fn wait(&self) {
        let mut select = Select::new();
        select.recv(&self.frames);
        select.recv(&self.asks);
        let _ = select.ready(); // the caller looks at both
    }

    /// Packets of the last frame may be missing.
    fn linger(&mut self) {
        let mut served = self.outlet.now();
        while self.kept.last_id != 0 && self.shared.settings().destination.is_some() {
            let now = self.outlet.now();
            if self.shared.is_overdue(now) || now - served > QUIET {
                return;
            }
            match self.serve() {
                Ok(true) => served = now,
                Ok(false) => self.pending = self.asks.recv_timeout(LOOK).ok(),
                Err(RecvError) => return,
            }
        }
    }

    fn count_what_is_left(&mut self) {
        let tally = &self.shared.tally;
        self.frames.try_iter().for_each(|slot| self.shared.lose(LossKind::Cut, slot.meta.number));
        let asks = self.pending.take().into_iter().chain(self.asks.try_iter());
        tally.resends_refused.add(asks.map(|resend| resend.packets()).sum());
    }

    fn send_frame(&mut self, mut slot: Slot) {
        let settings = self.shared.settings();
        let is_gone = self.shared.gone() == settings.acquisition;
        let is_of_now =
            slot.acquisition == settings.acquisition && !is_gone && !self.shared.is_overdue(self.outlet.now());
        let destination = settings.destination.filter(|_| is_of_now);
        if destination.is_some() {
            self.write_block(&mut slot, settings);
        }
        let number = slot.meta.number;
        // Before its packets leave: the sink may want it.
        let _ = self.free.try_send(slot); // the queue has space for all buffers
        match destination.map_or(Some(LossKind::Cut), |to| self.send_block(to)) {
            Some(kind) => self.shared.lose(kind, number),
            None => self.shared.tally.frames_sent.one(),
        }
    }

    fn write_block(&mut self, slot: &mut Slot, settings: StreamSettings) {
        let (width_px, dn_bits) = (self.width_px, self.dn_bits);
        if settings.pattern != TestPattern::Off {
            slot.show(settings.pattern, width_px, dn_bits);
            self.shared.tally.frames_of_a_pattern.one();
        }
        let block = self.kept.begin(settings);
        let regions = settings.regions.as_slice();
        append_regions(settings.format, dn_bits, &slot.pixels, width_px, regions, &mut block.payload);
        if settings.with_chunks {
            chunk::append_chunks(&slot.meta, block.payload.len(), &mut block.payload);
        }
        let time_ns = u64::try_from(slot.meta.mid_exposure.ns()).unwrap_or_default();
        let id = self.kept.last_id;
        self.kept.blocks[self.kept.newest].seal(id, time_ns);
    }

    /// Sends the newest block; returns the kind of its loss if it did not get out whole.
    fn send_block(&mut self, to: SocketAddrV4) -> Option<LossKind> {
        let packets = self.kept.blocks[self.kept.newest].packets();
        let acquisition = self.kept.acquisition;
        self.kept.allowance = RESENT_PER_SENT * u64::from(packets);
        let (mut next, mut refused) = (0, 0);
        while next < packets {
            if self.shared.acquisition() != acquisition || self.shared.is_overdue(self.outlet.now()) {
                return Some(LossKind::Cut);
            }
            let sent = self.outlet.send(to, &self.kept.blocks[self.kept.newest], next..packets);
            (next, refused) = (sent.next, refused + sent.refused);
            if sent.is_gone {
                self.shared.receiver_is_gone(acquisition);
                return Some(LossKind::Cut);
            }
            let _ = self.serve(); // an error means that the control side is gone
        }
        (refused > 0).then_some(LossKind::Refused)
    }

    /// Serves one batch of the requests; false when none waits. `Err` when the control side is gone.
    fn serve(&mut self) -> Result<bool, RecvError> {
        let ask = match self.pending.take() {
            Some(ask) => ask,
            None => match self.asks.try_recv() {
                Ok(ask) => ask,
                Err(TryRecvError::Empty) => return Ok(false),
                Err(TryRecvError::Disconnected) => return Err(RecvError),
            },
        };
        self.pending = self.resend(ask);
        Ok(true)
    }

    /// Returns one batch of the packets; the rest of them.
    fn resend(&mut self, resend: Resend) -> Option<Resend> {
        let (tally, settings) = (&self.shared.tally, self.shared.settings());
        let Some(to) = settings.destination else {
            tally.resends_refused.add(resend.packets());
            return None;
        };
        let Some(block) = self.kept.find(resend.block, settings.acquisition) else {
            let reported = resend.packets().min(GONE_MAX).min(self.kept.allowance);
            let count = if reported == 0 { &tally.resends_refused } else { &tally.resends_gone };
            count.add(resend.packets());
            self.kept.allowance -= reported;
            self.outlet.send_gone(to, resend.block, resend.first, reported as usize);
            return None;
        };
        let end = block.packets().min(resend.last.saturating_add(1)).max(resend.first);
        let there = u64::from(end - resend.first);
        if there == 0 || there > self.kept.allowance {
            tally.resends_refused.add(resend.packets());
            return None;
        }
        tally.resends_refused.add(resend.packets() - there);
        let next = self.outlet.send(to, block, resend.first..end).next;
        let served = u64::from(next - resend.first);
        tally.resends_served.add(served);
        self.kept.allowance -= served;
        (next < end).then_some(Resend { first: next, last: end - 1, ..resend })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network_camera::gvsp::tests::{SETTINGS, one_region};
    use base::clock::{Clock, Virtual};
    use base::time::Tai;
    use frames::sink::sample::sample_frame;
    use std::net::{Ipv4Addr, UdpSocket};

    const START: Tai = Tai::from_ns(1_000_000_000);
    const FRAMES: u64 = 3;

    /// Returns the counts of a stream of three frames to `to`, from a sink that hangs up with so much time left; no
    /// client sends requests.
    fn counts_of(to: SocketAddrV4, time_left: Span) -> [u64; 4] {
        let clock = Arc::new(Virtual::new(START));
        let shared = Arc::new(Shared::new());
        let destination = Some(to);
        let settings = StreamSettings { destination, regions: one_region([0, 0, 31, 17]), ..SETTINGS };
        shared.publish(settings);
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let (full, frames) = crossbeam_channel::bounded(8);
        let (free, _given_back) = crossbeam_channel::bounded(8);
        let (_, asks) = crossbeam_channel::bounded(8);
        for number in 1..=u32::try_from(FRAMES).unwrap() {
            let mut slot = Slot::with_capacity(31 * 17);
            slot.take_in(&sample_frame(number));
            slot.acquisition = settings.acquisition;
            full.send(slot).unwrap();
        }
        drop(full);
        shared.hang_up(clock.now() + time_left);
        // One frame takes 10 ms of the clock.
        let outlet = Outlet::new(Arc::new(socket), clock, 8.8e5, None, Arc::clone(&shared.tally));
        let kept = Kept::new(2, 31 * 17, settings);
        let reported = Arc::clone(&shared);
        Stream { shared, frames, free, asks, outlet, kept, width_px: 31, dn_bits: 16, pending: None }.run();
        let counters = reported.tally.read();
        [counters.frames_sent, counters.frames_refused, counters.frames_cut, counters.packets_refused]
    }

    #[test]
    fn blocks_go_on_in_the_next_acquisition_and_begin_again_at_another_place() {
        let place = |port| Some(SocketAddrV4::new(Ipv4Addr::LOCALHOST, port));
        let mut kept = Kept::new(2, 4, SETTINGS);
        let mut next = |acquisition, port| {
            kept.begin(StreamSettings { acquisition, destination: place(port), ..SETTINGS });
            kept.last_id
        };
        assert_eq!([next(1, 9), next(1, 9), next(3, 9), next(3, 9)], [1, 2, 3, 4]);
        assert_eq!([next(5, 10), next(7, 10)], [1, 2], "control: another stream");
    }

    #[test]
    fn waiting_frames_are_sent_until_the_deadline_and_counted_after_it() {
        let receiver = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let to = SocketAddrV4::new(Ipv4Addr::LOCALHOST, receiver.local_addr().unwrap().port());
        assert_eq!(counts_of(to, Span::from_ms(1_000)), [FRAMES, 0, 0, 0]);
        assert_eq!(counts_of(to, Span::ZERO), [0, 0, FRAMES, 0]);
        let [sent, 0, cut, 0] = counts_of(to, Span::from_ms(15)) else { panic!("nothing was refused") };
        assert!(sent > 0 && cut > 0 && sent + cut == FRAMES, "{sent} sent, {cut} cut");
    }

    #[test]
    fn a_frame_whose_packets_the_system_refuses_is_not_reported_as_sent() {
        // The system sends to all only from sockets that asked for it.
        let to_all = SocketAddrV4::new(Ipv4Addr::BROADCAST, 9);
        let [sent, refused, cut, packets] = counts_of(to_all, Span::from_ms(1_000));
        assert_eq!([sent, refused, cut], [0, FRAMES, 0]);
        assert_eq!(packets, FRAMES * 4, "leader, two of payload, trailer");
    }
}
