//! Late frames: a slot that is taken too late, and a frame that is finished after it was due.
//!
//! The policy of the bench (`timing.deadline_policy`) decides: a late frame goes out late, is replaced by the one before, or is
//! dropped. Each is an event and an end of the slot in the account.

use super::{RealHead, Shared};
use crate::runtime::delivery::FramePacket;
use crate::runtime::error::Result;
use crate::runtime::{ledger::EventKind, record::RunRecord, slot::Slot};
use base::time::{Span, Tai};
use config::DeadlinePolicy;
use frames::report::{Fate, FrameEnd, FrameRecord, MissCause};
use frames::sink::FaultFlags;

impl RealHead<'_> {
    /// Returns true when it is too late to draw a slot: it is past due, and under `late` by more than a frame.
    pub(super) fn is_over(&self, slot: Slot, now: Tai) -> bool {
        let params = &self.head.engine.params;
        let grace = if params.deadline_policy == DeadlinePolicy::Late { params.frame_period } else { Span::ZERO };
        now > slot.due + grace
    }

    /// Sends a finished frame, or applies the policy to a late one.
    pub(super) fn deliver(
        &mut self,
        mut frame_packet: FramePacket,
        slot: Slot,
        shared: &mut Shared<'_>,
        record: &mut RunRecord,
    ) -> Result<()> {
        let policy = self.head.engine.params.deadline_policy;
        let lateness = frame_packet.frame.meta.lateness;
        if lateness > Span::ZERO && policy != DeadlinePolicy::Late {
            return self.deliver_late(frame_packet, slot, shared, record);
        }
        frame_packet.record.fate = Fate::Sent;
        if lateness > Span::ZERO {
            record.frames.late += 1;
            record.note(EventKind::Late, slot.due + lateness, slot.number, lateness);
            frame_packet.record.fate = Fate::Late;
        }
        let end = end_of(self.head.engine.pointing.end_on_time, self.spoiling.delay, lateness);
        record.account.add(end, slot.exposure_start);
        self.spoil_and_send(frame_packet, shared, record)
    }

    /// Handles a slot whose own frame does not go out: resends the previous frame under `hold`, else sends nothing.
    pub(super) fn deliver_late(
        &mut self,
        mut frame_packet: FramePacket,
        slot: Slot,
        shared: &mut Shared<'_>,
        record: &mut RunRecord,
    ) -> Result<()> {
        let lateness = frame_packet.frame.meta.lateness;
        let at = slot.due + lateness;
        record.frames.late += 1;
        if self.head.engine.params.deadline_policy == DeadlinePolicy::Hold && self.has_previous {
            record.frames.held += 1;
            record.account.add(FrameEnd::Late, slot.exposure_start);
            record.note(EventKind::Held, at, slot.number, lateness);
            frame_packet.frame.copy_from(&self.previous);
            frame_packet.frame.meta.number = slot.number;
            frame_packet.frame.meta.lateness = lateness;
            frame_packet.frame.meta.faults |= FaultFlags::FRAME_DUPLICATE;
            frame_packet.record.fate = Fate::Held;
            shared.announce(self.number, &frame_packet.frame.meta, self.head.engine.pointing.bound_rad);
            return self.send(frame_packet, Span::ZERO, shared.clock.now(), record);
        }
        let cause = frame_packet.record.cause.unwrap_or(MissCause::FramesBefore);
        drop_slot(slot, &mut frame_packet.record, EventKind::Dropped, cause, record);
        self.spare = Some(frame_packet);
        Ok(())
    }
}

/// Records a slot for which nothing goes out.
pub(super) fn drop_slot(
    slot: Slot,
    timed: &mut FrameRecord,
    kind: EventKind,
    cause: MissCause,
    record: &mut RunRecord,
) {
    record.frames.dropped += 1;
    record.account.add(FrameEnd::Dropped, slot.exposure_start);
    record.note(kind, slot.due + timed.lateness, slot.number, timed.lateness);
    timed.fate = Fate::Dropped;
    timed.cause = timed.cause.or(Some(cause));
    record.ring.push(*timed);
}

/// Returns the end of a frame that goes out; a commanded delay does not make it late.
pub(in crate::runtime) fn end_of(on_time: FrameEnd, commanded_delay: Span, lateness: Span) -> FrameEnd {
    if matches!(on_time, FrameEnd::OnTime | FrameEnd::AttitudeHeld) && lateness > Span::ZERO {
        FrameEnd::Late
    } else if on_time == FrameEnd::OnTime && commanded_delay > Span::ZERO {
        FrameEnd::Commanded
    } else {
        on_time
    }
}
