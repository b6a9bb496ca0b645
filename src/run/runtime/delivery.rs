//! Finished frames -> the sink thread and back: a fixed number of buffers that circulate.
//!
//! A frame that the sink fails on is counted, and the next one is sent: a run on the real clock never ends because of
//! its sinks. Losses of the sinks come back with the buffers, for the ledger. A sink that is busy for longer than all
//! buffers last costs slots; a [`frames::sink::Fan`] is only busy for as long as it takes to copy a frame. Tests:
//! `tests/closed_loop/sinks.rs`.

use crate::runtime::error::{Result, RunError};
use crate::runtime::hygiene::{Hygiene, Role};
use base::{clock::Clock, time::Tai};
use crossbeam_channel::{Receiver, Sender, bounded};
use frames::report::{FrameRecord, Stage};
use frames::sink::{Loss, LossKind, SentFrame, Sink, SinkError, SinkLine, SinkSummary, sink_lines};
use std::{collections::VecDeque, sync::Arc, thread::JoinHandle};

/// Frames in flight between the frame thread and the sink thread.
pub const BUFFERS: usize = 4;

/// A frame with its times.
pub struct FramePacket {
    /// The frame.
    pub frame: SentFrame,
    /// Its times: the frame thread starts the record, the sink thread completes it.
    pub record: FrameRecord,
    /// Earliest time at which it is sent (a deliberate delay).
    pub not_before: Option<Tai>,
    /// True when the sink took the frame.
    pub delivered: bool,
    /// Frames lost by sinks since the previous buffer came back; they include earlier frames.
    pub losses: Vec<Loss>,
}

/// Result of the sink thread.
struct Carried {
    frames: u64,
    refused: u64,
    failure: Option<SinkError>,
}

/// Counts and losses of all frames that were sent.
#[derive(Default)]
pub struct Delivered {
    /// Frames that the sink took.
    pub frames: u64,
    /// Frames that the sink failed on.
    pub refused: u64,
    /// Losses that no buffer has reported.
    pub losses: Vec<Loss>,
    /// Summary written by the sink; `None` when it could not finish.
    pub summary: Option<SinkSummary>,
    /// Result of each sink.
    pub lines: Vec<SinkLine>,
    /// Set when the thread was lost.
    pub error: Option<RunError>,
}

/// The sink thread and its queues.
pub struct Delivery {
    /// Queue to the sink thread; `None` when no more frames come.
    full: Option<Sender<FramePacket>>,
    empty: Receiver<FramePacket>,
    /// Buffers that have come back, oldest first.
    returned: VecDeque<FramePacket>,
    thread: JoinHandle<Delivered>,
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
    ) -> Result<Self> {
        let (full, to_send) = bounded::<FramePacket>(BUFFERS);
        let (sent, empty) = bounded::<FramePacket>(BUFFERS);
        for _ in 0..BUFFERS {
            let at = clock.now();
            let record = FrameRecord::released(0, [at; 3], [at; 2]);
            let frame_packet = FramePacket {
                frame: prototype.touched_copy(),
                record,
                not_before: None,
                delivered: false,
                losses: Vec::new(),
            };
            let _space_for_all = sent.try_send(frame_packet);
        }
        let (clock, hygiene) = (Arc::clone(clock), hygiene.map(Arc::clone));
        let thread = std::thread::Builder::new()
            .name("sink".into())
            .spawn(move || {
                if let Some(hygiene) = hygiene {
                    hygiene.enter(Role::Sink);
                }
                let carried = carry(&mut *sink, &*clock, &to_send, &sent);
                finish(&mut *sink, carried)
            })
            .map_err(|source| RunError::Thread { name: "sink", source })?;
        Ok(Self { full: Some(full), empty, returned: VecDeque::with_capacity(BUFFERS), thread })
    }

    /// Returns a free buffer, if one is available now. `visit` is called once for each buffer that has come back from
    /// the sink thread.
    pub fn take(&mut self, mut visit: impl FnMut(&FramePacket)) -> Option<FramePacket> {
        for frame_packet in self.empty.try_iter() {
            visit(&frame_packet);
            self.returned.push_back(frame_packet);
        }
        self.returned.pop_front()
    }

    /// Puts a frame into the queue; `now` is the current time.
    ///
    /// # Errors
    /// When the sink thread has ended.
    pub fn send(&self, mut frame_packet: FramePacket, now: Tai) -> Result<()> {
        frame_packet.record.submitted = Some(now);
        frame_packet.delivered = false;
        frame_packet.losses.clear();
        // The queue has as many places as there are buffers, so this never waits.
        let lost = || RunError::ThreadLost { name: "sink" };
        self.full.as_ref().ok_or_else(lost)?.send(frame_packet).map_err(|_| lost())
    }

    /// Closes the queue: the sink thread ends after it has sent the frames that wait. Several deliveries can end in
    /// parallel.
    pub fn hang_up(&mut self) {
        self.full = None;
    }

    /// Waits until everything is delivered. `visit` is called for the buffers that were not yet taken.
    pub fn finish(mut self, mut visit: impl FnMut(&FramePacket)) -> Delivered {
        self.hang_up();
        let joined = self.thread.join();
        self.empty.try_iter().for_each(|frame_packet| visit(&frame_packet));
        let lost = Some(RunError::ThreadLost { name: "sink" });
        joined.unwrap_or_else(|_panicked| Delivered { error: lost, ..Delivered::default() })
    }
}

/// Runs the sink thread: sends frames until the queue closes.
fn carry(
    sink: &mut dyn Sink,
    clock: &dyn Clock,
    to_send: &Receiver<FramePacket>,
    sent: &Sender<FramePacket>,
) -> Carried {
    let mut carried = Carried { frames: 0, refused: 0, failure: None };
    for mut frame_packet in to_send {
        if let Some(at) = frame_packet.not_before.take() {
            clock.sleep_until(at);
        }
        let taken = clock.now();
        let outcome = sink.send(&frame_packet.frame);
        sink.take_losses(&mut |loss| frame_packet.losses.push(loss));
        match outcome {
            Ok(()) => {
                carried.frames += 1;
                complete(&mut frame_packet, taken, clock.now());
            }
            Err(error) => {
                carried.refused += 1;
                frame_packet.losses.push(Loss { kind: LossKind::Refused, frame: frame_packet.frame.meta.number });
                carried.failure.get_or_insert(error);
            }
        }
        let _frame_thread_has_ended = sent.send(frame_packet);
    }
    carried
}

/// Records when a frame was taken and delivered.
fn complete(frame_packet: &mut FramePacket, taken: Tai, delivered: Tai) {
    let record = &mut frame_packet.record;
    record.times.set(Stage::Queue, taken - record.submitted.unwrap_or(taken));
    record.times.set(Stage::Sink, delivered - taken);
    record.times.set(Stage::ReleaseToDelivered, delivered - record.release);
    record.delivered = Some(delivered);
    frame_packet.delivered = true;
}

/// Finishes the sink; a failure here is reported in its line.
fn finish(sink: &mut dyn Sink, carried: Carried) -> Delivered {
    let Carried { frames, refused, mut failure } = carried;
    let finished = sink.finish();
    let mut losses = Vec::new();
    sink.take_losses(&mut |loss| losses.push(loss));
    let summary = match finished {
        Ok(summary) => Some(summary),
        Err(error) => {
            failure.get_or_insert(error);
            None
        }
    };
    let mut lines = sink_lines(sink, summary.as_ref());
    if let (Some(error), [line]) = (failure, lines.as_mut_slice()) {
        line.first_error.get_or_insert_with(|| error.to_string());
        (line.frames, line.refused) = (frames, refused);
    }
    Delivered { frames, refused, losses, summary, lines, error: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::clock::Monotonic;
    use frames::sink::{NullSink, sample::sample_frame};

    #[test]
    fn every_buffer_that_has_come_back_is_seen_at_once_and_only_once() {
        let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
        let mut delivery = Delivery::start(Box::new(NullSink::new()), &sample_frame(0), &clock, None).unwrap();
        for _ in 0..3 {
            let frame_packet =
                delivery.take(|frame_packet| assert!(!frame_packet.delivered, "nothing has been sent")).unwrap();
            delivery.send(frame_packet, clock.now()).unwrap();
            while delivery.empty.is_empty() {
                std::thread::yield_now();
            }
            let mut seen = 0;
            let frame_packet = delivery.take(|frame_packet| seen += u32::from(frame_packet.delivered)).unwrap();
            assert_eq!(seen, 1, "also when other buffers are free");
            delivery.returned.push_front(frame_packet);
        }
        let delivered = delivery.finish(|frame_packet| assert!(!frame_packet.delivered, "all were seen"));
        assert_eq!(delivered.frames, 3);
    }
}
