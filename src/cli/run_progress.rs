//! Progress of a run: the progress line and the live view's numbers.

use base::clock::Stopwatch;
use crossbeam_channel::Sender;
use frames::{report::Progress, sink::SentFrame};
use outputs::live::Numbers;
use run::runtime::RunRecord;

/// Returns what hands the monitor a frame's progress, with where the first head points; an update is dropped while the
/// monitor is busy. Allocates nothing.
pub(super) fn sender(
    updates: Sender<Progress>,
    numbers: Option<Numbers>,
    frames: u64,
) -> impl FnMut(usize, &SentFrame, &RunRecord) {
    let mut since_first: Option<Stopwatch> = None;
    // Every head counts, the first one shows where it points.
    let mut first_head = None;
    move |head, frame, record| {
        if head == 0 {
            let meta = &frame.meta;
            first_head = Some(([meta.ra_deg, meta.dec_deg, meta.roll_deg], frame.truth.len(), meta.method.name()));
        }
        let Some(([ra_deg, dec_deg, roll_deg], stars, method)) = first_head else { return };
        let elapsed_s = since_first.get_or_insert_with(Stopwatch::start).elapsed().s();
        let done = record.frames.rendered;
        let update = Progress {
            frame: done,
            frames: Some(frames),
            fps: done.saturating_sub(1) as f64 / f64::max(elapsed_s, 1e-3),
            p99_ms: record.p99_ms(),
            late: record.frames.late,
            dropped: record.frames.dropped,
            ra_deg,
            dec_deg,
            roll_deg,
            stars,
            method,
        };
        let _monitor_is_busy = updates.try_send(update);
        if let Some(numbers) = &numbers {
            numbers.announce(&record.numbers(Some(frames)));
        }
    }
}
