//! Finished frames -> the sink thread and back: a fixed number of buffers that go round.

use crate::base::clock::Stopwatch;
use crate::base::time::Span;
use crate::report::{Stage, StageTimes};
use crate::runtime::error::RunError;
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};
use crossbeam_channel::{Receiver, Sender, bounded};
use std::thread::JoinHandle;

/// Frames in flight between the frame thread and the sink thread.
pub const BUFFERS: usize = 4;

/// A frame with the times measured on its way.
pub struct Parcel {
    /// The frame.
    pub frame: SentFrame,
    /// From release to the queue.
    pub since_release: Span,
    /// Measured by the sink thread.
    pub times: StageTimes,
    watch: Stopwatch,
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
    /// Starts the sink thread; `prototype` is copied into every buffer.
    ///
    /// # Errors
    /// When the thread cannot be started.
    pub fn start(mut sink: Box<dyn Sink>, prototype: &SentFrame) -> Result<Self, RunError> {
        let (full, to_send) = bounded::<Parcel>(BUFFERS);
        let (sent, empty) = bounded::<Parcel>(BUFFERS);
        for _ in 0..BUFFERS {
            let parcel = Parcel {
                frame: prototype.clone(),
                since_release: Span::ZERO,
                times: StageTimes::default(),
                watch: Stopwatch::start(),
                delivered: false,
            };
            let _room_for_all = sent.try_send(parcel);
        }
        let thread = std::thread::Builder::new()
            .name("sink".into())
            .spawn(move || {
                let carried = carry(&mut *sink, &to_send, &sent);
                (sink.finish(), carried)
            })
            .map_err(|source| RunError::Thread { name: "sink", source })?;
        Ok(Self { full, empty, thread })
    }

    /// A free buffer, if there is one now. `visit` sees the times of a frame that was delivered in it.
    pub fn take(&self, mut visit: impl FnMut(&StageTimes)) -> Option<Parcel> {
        let parcel = self.empty.try_recv().ok()?;
        if parcel.delivered {
            visit(&parcel.times);
        }
        Some(parcel)
    }

    /// Puts a frame into the queue; `since_release` is the time it has taken so far.
    ///
    /// # Errors
    /// When the sink thread has ended.
    pub fn send(&self, mut parcel: Parcel, since_release: Span) -> Result<(), RunError> {
        parcel.since_release = since_release;
        parcel.times = StageTimes::default();
        parcel.watch = Stopwatch::start();
        // There are as many places as buffers: this waits for nothing.
        self.full.send(parcel).map_err(|_| RunError::ThreadLost { name: "sink" })
    }

    /// Waits until everything is delivered. `visit` sees the times of the frames not yet seen.
    pub fn finish(self, mut visit: impl FnMut(&StageTimes)) -> Delivered {
        drop(self.full);
        let joined = self.thread.join();
        for parcel in self.empty.try_iter().filter(|parcel| parcel.delivered) {
            visit(&parcel.times);
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

/// The sink thread: sends until the queue closes or the sink fails.
fn carry(sink: &mut dyn Sink, to_send: &Receiver<Parcel>, sent: &Sender<Parcel>) -> Carried {
    let mut carried = Carried::default();
    for mut parcel in to_send {
        let queue = parcel.watch.lap();
        if let Err(error) = sink.send(&parcel.frame) {
            // The frame thread notices when its queue is closed; what is in it by then is lost with this one.
            carried.lost = 1 + to_send.try_iter().count() as u64;
            carried.failure = Some(error);
            return carried;
        }
        carried.frames += 1;
        let sending = parcel.watch.lap();
        parcel.times.set(Stage::Queue, queue);
        parcel.times.set(Stage::Sink, sending);
        parcel.times.set(Stage::ReleaseToDelivered, parcel.since_release + queue + sending);
        parcel.delivered = true;
        let _frame_thread_has_ended = sent.send(parcel);
    }
    carried
}
