//! The state that the control side, the stream and the sink share. The one lock is held for a copy of a few words, and
//! never by the sink.

use crate::network_camera::{acquisition::Wanted, counters::Tally, gvsp::StreamSettings, test_pattern::TestPattern};
use base::{drawn::PathOrigin, time::Tai};
use core::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, bounded};
use frames::sink::{FrameMeta, Loss, LossKind, SentFrame};
use std::sync::{Arc, Mutex, PoisonError};

/// Losses that are kept until the run asks for them; further ones are only counted.
const LOSSES_KEPT: usize = 4096;

/// Shared by reference from the start to the end of a camera.
#[derive(Debug)]
pub(super) struct Shared {
    settings: Mutex<StreamSettings>,
    acquisition: AtomicU32,
    /// The last acquisition whose receiver was found gone; 0 for none.
    gone: AtomicU32,
    /// When the stream must be over; the end of time while the sink is there.
    deadline_ns: AtomicI64,
    ended: AtomicBool,
    /// Temperature of the detector in the newest frame, degrees Celsius, by its bits.
    temperature_c: AtomicU64,
    losses: (Sender<Loss>, Receiver<Loss>),
    pub(super) wanted: Arc<Wanted>,
    pub(super) tally: Arc<Tally>,
}

impl Shared {
    pub(super) fn new() -> Self {
        Self {
            settings: Mutex::new(StreamSettings::NONE),
            acquisition: AtomicU32::new(StreamSettings::NONE.acquisition),
            gone: AtomicU32::new(0),
            deadline_ns: AtomicI64::new(i64::MAX),
            ended: AtomicBool::new(false),
            temperature_c: AtomicU64::new(0),
            losses: bounded(LOSSES_KEPT),
            wanted: Arc::default(),
            tally: Arc::default(),
        }
    }

    pub(super) fn settings(&self) -> StreamSettings {
        *self.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Publishes new settings to the stream. Frames are requested afterwards, so a frame that is taken finds its
    /// settings published.
    pub(super) fn publish(&self, settings: StreamSettings) {
        *self.settings.lock().unwrap_or_else(PoisonError::into_inner) = settings;
        self.acquisition.store(settings.acquisition, Ordering::Release);
    }

    /// Returns the acquisition of the settings.
    pub(super) fn acquisition(&self) -> u32 {
        self.acquisition.load(Ordering::Acquire)
    }

    /// Records that the receiver of an acquisition's stream is gone.
    pub(super) fn receiver_is_gone(&self, acquisition: u32) {
        if self.gone.swap(acquisition, Ordering::AcqRel) != acquisition {
            self.tally.receivers_gone.one();
        }
    }

    /// Returns the last acquisition whose receiver was found gone.
    pub(super) fn gone(&self) -> u32 {
        self.gone.load(Ordering::Acquire)
    }

    /// Counts a frame that the client does not receive, and keeps its number for the run.
    pub(super) fn lose(&self, kind: LossKind, frame: u32) {
        match kind {
            LossKind::Cut => self.tally.frames_cut.one(),
            LossKind::Refused => self.tally.frames_refused.one(),
            LossKind::Dropped | LossKind::TelemetryLost | LossKind::SinkLost => self.tally.frames_dropped.one(),
        }
        let _ = self.losses.0.try_send(Loss { kind, frame }); // counted already
    }

    /// Reports the losses since the last call.
    pub(super) fn take_losses(&self, announce: &mut dyn FnMut(Loss)) {
        self.losses.1.try_iter().for_each(announce);
    }

    /// Records that the sink has no more frames; those that wait may be sent until `deadline`.
    pub(super) fn hang_up(&self, deadline: Tai) {
        self.deadline_ns.store(deadline.ns(), Ordering::Release);
    }

    /// Returns true if the time for waiting frames is over.
    pub(super) fn is_overdue(&self, now: Tai) -> bool {
        now.ns() >= self.deadline_ns.load(Ordering::Acquire)
    }

    /// Records the temperature of the detector, degrees Celsius.
    pub(super) fn set_temperature_c(&self, temperature_c: f64) {
        self.temperature_c.store(temperature_c.to_bits(), Ordering::Relaxed);
    }

    /// Returns the temperature of the detector in the newest frame, degrees Celsius, by its bits.
    pub(super) fn temperature_bits(&self) -> u64 {
        self.temperature_c.load(Ordering::Relaxed)
    }

    /// Ends the control side.
    pub(super) fn end(&self) {
        self.ended.store(true, Ordering::Release);
    }

    pub(super) fn is_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }
}

// Frames on their way from the sink to the stream: buffers made once that go round.

/// One frame that waits to be sent.
#[derive(Debug)]
pub(super) struct Slot {
    /// The acquisition it was taken for.
    pub(super) acquisition: u32,
    pub(super) pixels: Vec<u16>,
    pub(super) meta: FrameMeta,
}

impl Slot {
    pub(super) fn with_capacity(pixels: usize) -> Self {
        Self { acquisition: 0, pixels: Vec::with_capacity(pixels), meta: FrameMeta::empty("".into()) }
    }

    /// Copies a frame; no allocation after the first of its size.
    pub(super) fn take_in(&mut self, frame: &SentFrame) {
        self.pixels.clear();
        self.pixels.extend_from_slice(frame.image.pixels());
        self.meta.clone_from(&frame.meta);
    }

    /// Replaces the image by a test pattern, and says so: the frame is not one of the sky.
    pub(super) fn show(&mut self, pattern: TestPattern, width_px: usize, dn_bits: u32) {
        pattern.draw(self.meta.number, width_px, dn_bits, &mut self.pixels);
        (self.meta.test_pattern, self.meta.origin) = (pattern.name(), PathOrigin::TestPattern);
    }
}
