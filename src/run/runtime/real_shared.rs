//! Parts that the camera heads of a run on the bench clock share: clock, receiver, receiving threads and answers; and how the results
//! of a sink thread are recorded.

use crate::runtime::reply::{Reply, ReportedFrame};
use crate::runtime::{
    delivery::FramePacket, link_thread::LinkThreads, port_reading::PortReading, receiver::Receiver, record::RunRecord,
};
use base::{clock::Clock, time::Tai};
use core::convert::Infallible;
use frames::sink::FrameMeta;

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
