//! One camera head on the bench clock: its engine, its buffers, and its output in each slot.
//!
//! In: a slot that has been released. Out: a frame on its way to the head's sink, or the reason why there is none, and
//! the record of the slot. The frame thread takes the heads in turn; each has its own sink thread. Tests: as for
//! `real_time`.
//!
//! Inputs of a run on the bench clock: its environment, its sources, and the form of orders.
//!
//! Parts that the camera heads of a run on the bench clock share: clock, receiver, receiving threads and answers; and how the results
//! of a sink thread are recorded.

use crate::runtime::delivery::{Delivery, FramePacket};
use crate::runtime::error::{Result, RunError};
use crate::runtime::link_thread::{LinkThreads, TriggerChip};
use crate::runtime::reply::{Reply, ReportedFrame};
use crate::runtime::{
    frame_faults::Fate as Spoiling, head::Head, hygiene::Hygiene, ledger::EventKind, plant_queue::PlantSample,
    port_reading::PortReading, receiver::Receiver, record::RunRecord, slot::Slot,
};
use base::clock::Clock;
use base::time::{Span, Tai};
use config::DeadlinePolicy;
use core::{convert::Infallible, sync::atomic::AtomicBool};
use crossbeam_channel::Receiver as Queue;
use frames::report::{Fate, FrameEnd, FrameRecord, MissCause, RunLimits, Stage, StageTimes};
use frames::sink::{FaultFlags, FrameMeta, SentFrame};
use link::{Port, Stamped, gateway::DroppedFrames, pps::Pps};
use plan::attitude::PathOrigin;
use std::sync::Arc;

mod late_frames;

use late_frames::drop_slot;
pub(super) use late_frames::end_of;

/// One head as the frame thread uses it.
pub(super) struct RealHead<'a> {
    /// Number of the head, from 0.
    pub(super) number: usize,
    pub(super) head: &'a mut Head,
    pub(super) delivery: Delivery,
    /// Commanded effects on the frame that is being made.
    spoiling: Spoiling,
    spare: Option<FramePacket>,
    previous: SentFrame,
    has_previous: bool,
}

impl<'a> RealHead<'a> {
    /// Returns a head whose engine is warm; starts its sink thread.
    pub(super) fn start(
        number: usize,
        head: &'a mut Head,
        prototype: SentFrame,
        setting: &Setting<'_>,
    ) -> Result<Self> {
        let delivery = Delivery::start(head.take_sink(), &prototype, setting.clock, setting.hygiene)?;
        let (spoiling, spare) = (Spoiling::SEND, None);
        Ok(Self { number, head, delivery, spoiling, spare, previous: prototype, has_previous: false })
    }

    /// Draws the frame of a slot and sends it, or handles the slot as missed.
    pub(super) fn take_slot(
        &mut self,
        slot: Slot,
        mut timed: FrameRecord,
        shared: &mut Shared<'_>,
        record: &mut RunRecord,
        progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
    ) -> Result<()> {
        let spare = self.spare.take().or_else(|| self.delivery.take(|back| take_back(record, back)));
        let Some(mut frame_packet) = spare else {
            // A slot that started too late to be drawn, as after a pause of the whole program, is not missed because of
            // the sink.
            let (kind, cause) = if self.is_over(slot, timed.woken) {
                (EventKind::Dropped, timed.cause_of_late_start())
            } else {
                (EventKind::SinkBusy, MissCause::SinkBusy)
            };
            drop_slot(slot, &mut timed, kind, cause, record);
            return Ok(());
        };
        if self.is_over(slot, timed.woken) {
            // Earlier work took so long that this slot is over: do not draw it.
            frame_packet.frame.meta.lateness = timed.lateness;
            timed.cause = Some(timed.cause_of_late_start());
            frame_packet.record = timed;
            return self.deliver_late(frame_packet, slot, shared, record);
        }
        timed.load = self.head.engine.pace.load();
        let Some(times) = self.draw(slot, &mut frame_packet.frame, shared, record)? else {
            self.leave_out(frame_packet, timed, shared, record);
            return Ok(());
        };
        let finished = shared.clock.now();
        frame_packet.frame.meta.lateness = finished - slot.due;
        self.head.engine.learn_load(drawn(&times), finished, slot, &mut record.ledger);
        record.count_rendered(&frame_packet.frame, &times);
        self.finish_record(&mut timed, &times, &frame_packet.frame.meta, finished, record);
        frame_packet.record = timed;
        progress(self.number, &frame_packet.frame, record);
        if self.spoiling.is_dropped {
            self.withhold(frame_packet, shared, record);
            return Ok(());
        }
        self.deliver(frame_packet, slot, shared, record)
    }

    /// Draws under the faults of the slot.
    fn draw(
        &mut self,
        slot: Slot,
        frame: &mut SentFrame,
        shared: &mut Shared<'_>,
        record: &mut RunRecord,
    ) -> Result<Option<StageTimes>> {
        let exposed = self.head.draw(slot, shared.receiver, &mut record.ledger, frame);
        if matches!(exposed, Err(RunError::AttitudeStopped { .. })) && self.number == 0 {
            shared.announce_stop(slot.release);
        }
        Ok(exposed?.map(|(spoiling, times)| {
            self.spoiling = spoiling;
            times
        }))
    }

    /// Sends nothing for a slot without an attitude, and reports this to the flight computer.
    fn leave_out(
        &mut self,
        frame_packet: FramePacket,
        mut timed: FrameRecord,
        shared: &Shared<'_>,
        record: &mut RunRecord,
    ) {
        if self.number == 0 {
            shared.announce_stop(shared.clock.now());
        }
        record.frames.dropped += 1;
        record.account.add(FrameEnd::Dropped, timed.exposure_start);
        (timed.fate, timed.cause) = (Fate::Dropped, Some(MissCause::AwaitingAttitude));
        record.ring.push(timed);
        self.spare = Some(frame_packet);
    }

    /// Records how a frame was made, and why it was missed if it was.
    fn finish_record(
        &self,
        timed: &mut FrameRecord,
        times: &StageTimes,
        meta: &FrameMeta,
        finished: Tai,
        record: &RunRecord,
    ) {
        timed.times.merge(times);
        timed.finished = Some(finished);
        timed.lateness = meta.lateness;
        (timed.degradation, timed.method) = (meta.degradation.name(), meta.method.name());
        timed.origin = meta.origin.name();
        timed.horizon = meta.horizon;
        (timed.end_horizon, timed.jitter_missing) = (meta.end_horizon, meta.jitter_missing);
        timed.pointing_bound_rad = self.head.engine.pointing.bound_rad;
        timed.cause = if meta.faults.contains(FaultFlags::BLANK) {
            Some(MissCause::AwaitingAttitude)
        } else {
            (timed.lateness > Span::ZERO).then(|| timed.cause_of_lateness(&record.stages))
        };
    }

    /// Drops a frame on purpose: the flight computer gets its report, but the sinks do not get the frame.
    fn withhold(&mut self, mut frame_packet: FramePacket, shared: &mut Shared<'_>, record: &mut RunRecord) {
        shared.announce(self.number, &frame_packet.frame.meta, self.head.engine.pointing.bound_rad);
        self.head.faults.spoil(&self.spoiling, &mut frame_packet.frame);
        record.frames.dropped += 1;
        record.account.add(FrameEnd::Commanded, frame_packet.record.exposure_start);
        frame_packet.record.fate = Fate::Dropped;
        record.ring.push(frame_packet.record);
        self.spare = Some(frame_packet);
    }

    /// Reports the contents of a frame to the flight computer, damages it if commanded, and sends it.
    fn spoil_and_send(
        &mut self,
        mut frame_packet: FramePacket,
        shared: &mut Shared<'_>,
        record: &mut RunRecord,
    ) -> Result<()> {
        // The stimulator reports its own data before its frame is damaged.
        shared.announce(self.number, &frame_packet.frame.meta, self.head.engine.pointing.bound_rad);
        self.head.faults.spoil(&self.spoiling, &mut frame_packet.frame);
        if self.head.engine.params.deadline_policy == DeadlinePolicy::Hold {
            // A repeated frame equals the frame that went out, including its metadata.
            self.previous.copy_from(&frame_packet.frame);
            self.has_previous = true;
        }
        self.send(frame_packet, self.spoiling.delay, shared.clock.now(), record)
    }

    /// Sends a frame `now`, or `delay` after it is due if a delay is given.
    fn send(&mut self, mut frame_packet: FramePacket, delay: Span, now: Tai, record: &mut RunRecord) -> Result<()> {
        frame_packet.not_before = (delay > Span::ZERO).then(|| frame_packet.record.due + delay);
        record.count_outgoing(&frame_packet.frame.meta);
        let meta = &frame_packet.frame.meta;
        // A held image keeps the time of its own exposure: latency refers to the visible image.
        frame_packet.record.mid_exposure = meta.mid_exposure;
        frame_packet.record.commanded = (meta.origin != PathOrigin::Absent).then(|| meta.mid_exposure - meta.horizon);
        if let Some(finished) = frame_packet.record.finished {
            frame_packet.record.times.set(Stage::Handover, now - finished);
        }
        record.ring.push(frame_packet.record);
        self.delivery.send(frame_packet, now)
    }
}

/// Returns the time of drawing and detector together, on CPU or GPU.
fn drawn(times: &StageTimes) -> Span {
    let stages = [Stage::Upload, Stage::Render, Stage::Detector, Stage::Readback];
    stages.into_iter().filter_map(|stage| times.get(stage)).fold(Span::ZERO, |sum, time| sum + time)
}

/// Environment of a run on the bench clock.
pub struct Setting<'a> {
    /// The bench clock.
    pub clock: &'a Arc<dyn Clock>,
    /// Set to true when the run is to end.
    pub stop: &'a Arc<AtomicBool>,
    /// Requests to the operating system; `None`: no requests.
    pub hygiene: Option<&'a Arc<Hygiene>>,
    /// Number of frames whose times are kept individually.
    pub ring_frames: usize,
    /// Limits of `[expect]`.
    pub limits: RunLimits,
    /// Orders for the frame thread, which executes them between two slots; `None`: no orders.
    pub orders: Option<&'a Queue<FrameOrder>>,
}

/// An order that the frame thread executes before the slot that is released at the given instant, with all heads and their
/// receiver. It may take long and allocate: frames that it delays are counted as late.
pub type FrameOrder = Box<dyn FnOnce(&mut [&mut Head], &mut Receiver, &mut RunRecord, Tai) + Send>;

/// Sources of a run on the bench clock: everything that brings input.
pub struct Sources {
    /// Ports of the bench; frames are reported on the first one.
    pub ports: Vec<Port>,
    /// Pulses of the flight computer's clock.
    pub pulses: Option<Pps>,
    /// Samples that an external program sends over the control socket; `None` without them.
    pub samples: Option<Queue<Stamped<PlantSample>>>,
    /// Chips with lines that trigger cameras.
    pub chips: Vec<TriggerChip>,
    /// Frames that clients of the bus's gateways lose.
    pub dropped: DroppedFrames,
}

impl From<Port> for Sources {
    fn from(port: Port) -> Self {
        Self { ports: vec![port], pulses: None, samples: None, chips: Vec::new(), dropped: DroppedFrames::default() }
    }
}

/// State shared by all heads.
pub(super) struct Shared<'a> {
    pub(super) clock: &'a dyn Clock,
    pub(super) link_thread: &'a LinkThreads,
    /// Readings of each port at the previous frame.
    pub(super) readings: Vec<PortReading>,
    /// Number of lost edges of trigger lines at the previous frame.
    pub(super) lost_edges: u64,
    /// Times the numbers of a trigger line went back before the last look.
    pub(super) line_restarts: u64,
    /// Frames that clients of gateways lost, and the number of them that the ledger has.
    pub(super) dropped: DroppedFrames,
    pub(super) dropped_noted: u64,
    pub(super) reply: Reply,
    pub(super) receiver: &'a mut Receiver,
}

impl Shared<'_> {
    /// Reports a frame of a head to the flight computer.
    pub(super) fn announce(&mut self, head: usize, meta: &FrameMeta, pointing_bound_rad: Option<f64>) {
        let (now, rejects) = (self.clock.now(), PortReading::rejects_of_all(&self.readings));
        let reported = ReportedFrame { meta, pointing_bound_rad, rejects: &rejects, now };
        let Ok(()) = self.reply.report(head, &reported, self.receiver, |message| {
            self.link_thread.send(0, message);
            Ok::<(), Infallible>(())
        });
    }

    /// Reports that no frame goes out because the stream of attitudes has stopped.
    pub(super) fn announce_stop(&self, at: Tai) {
        self.link_thread.send(0, self.reply.stopped(self.receiver, at));
    }
}

/// Records the sink thread's results for a frame whose buffer comes back.
pub(super) fn take_back(record: &mut RunRecord, frame_packet: &FramePacket) {
    if frame_packet.delivered {
        record.complete(&frame_packet.record);
    }
    record.note_losses(&frame_packet.losses, frame_packet.record.due);
}
