//! The stream's thread: frames that wait -> packets, and packets that a client asks for again.
//!
//! A frame is turned into the wanted format in a kept block, its slot goes back at once, and its packets leave at the
//! stream's pace. Between two batches one batch of packets asked for again may go; one frame pays for at most
//! [`RESENT_PER_SENT`] times its own packets, so that a client cannot starve the next frame by asking.

use crate::network_camera::chunk;
use crate::network_camera::gvcp::Resend;
use crate::network_camera::gvsp::{Block, StreamSettings, next_id};
use crate::network_camera::packets::Outlet;
use crate::network_camera::pixel_format::{PixelFormat, append_region};
use crate::network_camera::slots::{Shared, Slot};
use crossbeam_channel::{Receiver, Sender, TryRecvError, select};
use std::net::SocketAddrV4;
use std::sync::Arc;
use std::time::Duration;

/// Packets sent again for one frame, at most, in packets of that frame.
const RESENT_PER_SENT: u64 = 2;
/// Packets of one request that are told to be gone; a client needs only the first.
const GONE_MAX: u32 = 16;
/// How often a thread that waits looks whether it is over.
const LOOK: Duration = Duration::from_millis(50);
/// Looks after the last frame in which packets may still be asked for.
const LOOKS_AFTER_END: u32 = 4;

/// The parts that one stream needs.
pub(super) struct Stream {
    pub(super) shared: Arc<Shared>,
    pub(super) frames: Receiver<Slot>,
    pub(super) free: Sender<Slot>,
    pub(super) resends: Receiver<Resend>,
    pub(super) outlet: Outlet,
    pub(super) kept: Kept,
    pub(super) width_px: usize,
    pub(super) dn_bits: u32,
}

/// Blocks that can be sent again, newest last. All buffers are made at the start.
pub(super) struct Kept {
    blocks: Vec<Block>,
    newest: usize,
    last_id: u16,
    generation: u64,
    allowance: u64,
    /// What is being sent again: packets left of one request.
    pending: Option<Resend>,
}

impl Kept {
    /// Room for so many frames of a sensor, in any format, with chunks.
    pub(super) fn new(frames: usize, pixels: usize, settings: StreamSettings) -> Self {
        let bytes = PixelFormat::Mono16.bytes(pixels) + chunk::added_bytes();
        let blocks = (0..frames).map(|_| Block::with_capacity(bytes, settings)).collect();
        Self { blocks, newest: 0, last_id: 0, generation: 0, allowance: 0, pending: None }
    }

    /// Takes the place of the oldest block for the next frame; block numbers begin again with each acquisition.
    fn begin(&mut self, settings: StreamSettings) -> &mut Block {
        if self.generation != settings.generation {
            (self.generation, self.last_id) = (settings.generation, 0);
            self.blocks.iter_mut().for_each(|block| block.id = 0);
            self.pending = None;
        }
        self.last_id = next_id(self.last_id);
        self.newest = (self.newest + 1) % self.blocks.len().max(1);
        let block = &mut self.blocks[self.newest];
        block.settings = settings;
        block.payload.clear();
        block
    }
}

impl Stream {
    /// Until the sink hangs up and all its frames are out.
    pub(super) fn run(mut self) {
        loop {
            select! {
                recv(self.frames) -> slot => match slot {
                    Ok(slot) => self.send_frame(slot),
                    Err(_) => break,
                },
                recv(self.resends) -> resend => {
                    if let Ok(resend) = resend {
                        self.resend_whole(resend);
                    }
                }
                default(LOOK) => {}
            }
        }
        for _ in 0..LOOKS_AFTER_END {
            if self.shared.settings().destination.is_none() || self.kept.last_id == 0 {
                break;
            }
            while let Ok(resend) = self.resends.recv_timeout(LOOK) {
                self.resend_whole(resend);
            }
        }
    }

    fn send_frame(&mut self, slot: Slot) {
        let settings = self.shared.settings();
        let destination = settings.destination.filter(|_| slot.generation == settings.generation);
        if let Some(to) = destination {
            self.write_block(&slot, settings);
            let _there_is_room_for_all = self.free.try_send(slot);
            self.send_block(to);
        } else {
            self.shared.tally.frames_cut.one();
            let _there_is_room_for_all = self.free.try_send(slot);
        }
    }

    fn write_block(&mut self, slot: &Slot, settings: StreamSettings) {
        let (width_px, dn_bits) = (self.width_px, self.dn_bits);
        let block = self.kept.begin(settings);
        let region = settings.region_px.map(|side| side as usize);
        append_region(settings.format, dn_bits, &slot.pixels, width_px, region, &mut block.payload);
        if settings.with_chunks {
            chunk::append_chunks(&slot.meta, block.payload.len(), &mut block.payload);
        }
        let time_ns = u64::try_from(slot.meta.mid_exposure.ns()).unwrap_or_default();
        let id = self.kept.last_id;
        self.kept.blocks[self.kept.newest].seal(id, time_ns);
    }

    fn send_block(&mut self, to: SocketAddrV4) {
        let packets = self.kept.blocks[self.kept.newest].packets();
        let generation = self.kept.generation;
        self.kept.allowance = RESENT_PER_SENT * u64::from(packets);
        let mut next = 0;
        while next < packets {
            if self.shared.generation() != generation {
                self.shared.tally.frames_cut.one();
                return;
            }
            next = self.outlet.send(to, &self.kept.blocks[self.kept.newest], next..packets);
            self.resend_batch(to);
        }
        self.shared.tally.frames_sent.one();
    }

    /// One batch of what was asked for again.
    fn resend_batch(&mut self, to: SocketAddrV4) {
        if self.kept.pending.is_none() {
            match self.resends.try_recv() {
                Ok(resend) => self.kept.pending = Some(resend),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return,
            }
        }
        let Some(resend) = self.kept.pending.take() else { return };
        let tally = &self.shared.tally;
        let found = self.kept.blocks.iter().find(|block| block.id == resend.block && resend.block != 0);
        let Some(block) = found else {
            let asked = u64::from(resend.last - resend.first) + 1;
            tally.resends_asked.add(asked);
            tally.resends_gone.add(asked);
            for number in (resend.first..=resend.last).take(GONE_MAX as usize) {
                self.outlet.send_gone(to, resend.block, number);
            }
            return;
        };
        let end = block.packets().min(resend.last.saturating_add(1));
        let left = u64::from(end.saturating_sub(resend.first));
        if left > self.kept.allowance {
            tally.resends_asked.add(left);
            tally.resends_refused.add(left);
            return;
        }
        if left == 0 {
            return;
        }
        let next = self.outlet.send(to, block, resend.first..end);
        let served = u64::from(next - resend.first);
        tally.resends_asked.add(served);
        tally.resends_served.add(served);
        self.kept.allowance -= served;
        self.kept.pending = (next < end).then_some(Resend { first: next, ..resend });
    }

    /// Between frames: all of one request.
    fn resend_whole(&mut self, resend: Resend) {
        let Some(to) = self.shared.settings().destination else { return };
        self.kept.pending = Some(resend);
        while self.kept.pending.is_some() && self.frames.is_empty() {
            self.resend_batch(to);
        }
    }
}
