//! Finished frames -> the sink thread and back: a fixed number of buffers that go round.

use crate::base::clock::Clock;
use crate::base::time::Tai;
use crate::report::{FrameRecord, Stage};
use crate::runtime::error::RunError;
use crate::runtime::hygiene::{Hygiene, Role};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary, TruthStar};
use crossbeam_channel::{Receiver, Sender, bounded};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Frames in flight between the frame thread and the sink thread.
pub const BUFFERS: usize = 4;

/// A frame with its times.
pub struct Parcel {
    /// The frame.
    pub frame: SentFrame,
    /// Its times: the frame thread begins them, the sink thread completes them.
    pub record: FrameRecord,
    /// Held back until then, on purpose.
    pub not_before: Option<Tai>,
    delivered: bool,
}

/// What the sink thread did.
#[derive(Default)]
struct Carried {
    frames: u64,
    lost: u64,
    failure: Option<SinkError>,
}

/// What became of the frames that were sent.
pub struct Delivered {
    /// Frames the sink took.
    pub frames: u64,
    /// Frames it did not take: the one it failed on, and those behind it.
    pub lost: u64,
    /// What the sink wrote; `None` when it could not finish.
    pub summary: Option<SinkSummary>,
    /// The sink's first failure.
    pub error: Option<RunError>,
}

/// The sink thread and its queues.
pub struct Delivery {
    full: Sender<Parcel>,
    empty: Receiver<Parcel>,
    thread: JoinHandle<(Result<SinkSummary, SinkError>, Carried)>,
}

impl Delivery {
    /// Starts the sink thread; `prototype` is copied into every buffer, and all their memory is touched.
    ///
    /// # Errors
    /// When the thread cannot be started.
    pub fn start(
        mut sink: Box<dyn Sink>,
        prototype: &SentFrame,
        clock: &Arc<dyn Clock>,
        hygiene: Option<&Arc<Hygiene>>,
    ) -> Result<Self, RunError> {
        let (full, to_send) = bounded::<Parcel>(BUFFERS);
        let (sent, empty) = bounded::<Parcel>(BUFFERS);
        for _ in 0..BUFFERS {
            let at = clock.now();
            let record = FrameRecord::released(0, [at; 3], [at; 2]);
            let parcel = Parcel { frame: touched_copy(prototype), record, not_before: None, delivered: false };
            let _room_for_all = sent.try_send(parcel);
        }
        let (clock, hygiene) = (Arc::clone(clock), hygiene.map(Arc::clone));
        let thread = std::thread::Builder::new()
            .name("sink".into())
            .spawn(move || {
                if let Some(hygiene) = hygiene {
                    hygiene.enter(Role::Sink);
                }
                let carried = carry(&mut *sink, &*clock, &to_send, &sent);
                (sink.finish(), carried)
            })
            .map_err(|source| RunError::Thread { name: "sink", source })?;
        Ok(Self { full, empty, thread })
    }

    /// A free buffer, if there is one now. `visit` sees the times of a frame that was delivered in it.
    pub fn take(&self, mut visit: impl FnMut(&FrameRecord)) -> Option<Parcel> {
        let parcel = self.empty.try_recv().ok()?;
        if parcel.delivered {
            visit(&parcel.record);
        }
        Some(parcel)
    }

    /// Puts a frame into the queue; `now` is when.
    ///
    /// # Errors
    /// When the sink thread has ended.
    pub fn send(&self, mut parcel: Parcel, now: Tai) -> Result<(), RunError> {
        parcel.record.submitted = Some(now);
        parcel.delivered = false;
        // There are as many places as buffers: this waits for nothing.
        self.full.send(parcel).map_err(|_| RunError::ThreadLost { name: "sink" })
    }

    /// Waits until everything is delivered. `visit` sees the times of the frames not yet seen.
    pub fn finish(self, mut visit: impl FnMut(&FrameRecord)) -> Delivered {
        drop(self.full);
        let joined = self.thread.join();
        for parcel in self.empty.try_iter().filter(|parcel| parcel.delivered) {
            visit(&parcel.record);
        }
        let Ok((finished, carried)) = joined else {
            return Delivered { frames: 0, lost: 0, summary: None, error: Some(RunError::ThreadLost { name: "sink" }) };
        };
        let (summary, finishing) = match finished {
            Ok(summary) => (Some(summary), None),
            Err(error) => (None, Some(error)),
        };
        let error = carried.failure.or(finishing).map(RunError::from);
        Delivered { frames: carried.frames, lost: carried.lost, summary, error }
    }
}

/// A copy with the same room for stars, every page of it written to.
fn touched_copy(prototype: &SentFrame) -> SentFrame {
    let mut copy = prototype.clone();
    copy.truth.resize(prototype.truth.capacity(), TruthStar::NONE);
    copy.truth.clear();
    copy
}

/// The sink thread: sends until the queue closes or the sink fails.
fn carry(sink: &mut dyn Sink, clock: &dyn Clock, to_send: &Receiver<Parcel>, sent: &Sender<Parcel>) -> Carried {
    let mut carried = Carried::default();
    for mut parcel in to_send {
        if let Some(at) = parcel.not_before.take() {
            clock.sleep_until(at);
        }
        let taken = clock.now();
        if let Err(error) = sink.send(&parcel.frame) {
            // The frame thread notices when its queue is closed; what is in it by then is lost with this one.
            carried.lost = 1 + to_send.try_iter().count() as u64;
            carried.failure = Some(error);
            return carried;
        }
        carried.frames += 1;
        let delivered = clock.now();
        let record = &mut parcel.record;
        record.times.set(Stage::Queue, taken - record.submitted.unwrap_or(taken));
        record.times.set(Stage::Sink, delivered - taken);
        record.times.set(Stage::ReleaseToDelivered, delivered - record.release);
        record.delivered = Some(delivered);
        parcel.delivered = true;
        let _frame_thread_has_ended = sent.send(parcel);
    }
    carried
}
