//! Observers of a run besides its sinks: capture and live view; the same on both clocks.

use crate::wiring::{live_tap::LiveTap, replay::Recording, run_end::RunEnd};
use base::time::Tai;

/// The taps of one run.
pub(super) struct Taps {
    pub(super) recording: Option<Recording>,
    pub(super) live: Option<LiveTap>,
}

impl Taps {
    /// Ends the taps, at `now`; their losses are losses of the run.
    pub(super) fn finish(self, end: &mut RunEnd, now: Tai) {
        if let Some(recording) = self.recording {
            let lost = end.ports.iter().map(|port| port.queue_overflows).sum();
            let missing = match recording.finish(lost) {
                Ok(session) => session.doubts(),
                Err(error) => vec![error.to_string()],
            };
            missing.iter().for_each(|what| end.losses.note_capture(what));
        }
        let Some(live) = self.live else { return };
        // After a failure the last numbers are not published: a failed run must not look like a finished one.
        if end.error.is_none() {
            let frames = end.heads.iter().map(|head| u64::from(head.engine.params().frames)).sum();
            live.numbers().send_last(&end.record.numbers(Some(frames)));
        }
        if !live.finish() {
            end.note_lost_thread("live view", now);
        }
    }
}
