//! Frames on their way from the sink to the stream: buffers made once that go round, and what both sides share.

use crate::network_camera::acquisition::Wanted;
use crate::network_camera::counters::Tally;
use crate::network_camera::gvsp::StreamSettings;
use crate::sink::{FrameMeta, SentFrame};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// One frame that waits to be sent.
#[derive(Debug)]
pub(super) struct Slot {
    /// The acquisition it was taken for.
    pub(super) generation: u64,
    pub(super) pixels: Vec<u16>,
    pub(super) meta: FrameMeta,
}

impl Slot {
    pub(super) fn with_capacity(pixels: usize) -> Self {
        Self { generation: 0, pixels: Vec::with_capacity(pixels), meta: FrameMeta::empty("".into()) }
    }

    /// Copies a frame; no allocation after the first of its size.
    pub(super) fn take_in(&mut self, frame: &SentFrame, generation: u64) {
        self.generation = generation;
        self.pixels.clear();
        self.pixels.extend_from_slice(frame.image.pixels());
        self.meta.clone_from(&frame.meta);
    }
}

/// What the threads and the sink share. The lock is held for a copy of a few words, and never by the sink.
#[derive(Debug)]
pub(super) struct Shared {
    settings: Mutex<StreamSettings>,
    generation: AtomicU64,
    ended: AtomicBool,
    pub(super) wanted: Arc<Wanted>,
    pub(super) tally: Arc<Tally>,
}

impl Shared {
    pub(super) fn new(settings: StreamSettings, wanted: Arc<Wanted>, tally: Arc<Tally>) -> Self {
        let generation = AtomicU64::new(settings.generation);
        Self { settings: Mutex::new(settings), generation, ended: AtomicBool::new(false), wanted, tally }
    }

    pub(super) fn settings(&self) -> StreamSettings {
        *self.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells new settings to the stream and the sink.
    pub(super) fn publish(&self, settings: StreamSettings) {
        *self.settings.lock().unwrap_or_else(PoisonError::into_inner) = settings;
        self.generation.store(settings.generation, Ordering::Release);
    }

    pub(super) fn generation(&self) -> u64 {
        self.generation.load(Ordering::Acquire)
    }

    pub(super) fn end(&self) {
        self.ended.store(true, Ordering::Release);
    }

    pub(super) fn is_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }
}
