//! Frames sent to several sinks at once: passing them on, and the sinks without files.

use crate::{complaints, counting::allocations_in};
use frames::sink::shared_memory::SharedMemory;
use frames::sink::{BranchParams, Fan, NullSink, OnFull, SentFrame, Sink, TruthStar};

const FRAMES: u32 = 40;

/// Returns the allocations of sending frames into a fan, for any number of stars, in all threads.
pub(crate) fn complaints_of_sinks() -> Vec<String> {
    let directory = tempfile::tempdir().unwrap();
    let mut frame = SentFrame::with_capacity(64, 48, 500, "small".into());
    let ring = SharedMemory::create(directory.path().join("ring"), [64, 48], 3).unwrap();
    let mut wrong = Vec::new();
    let sinks: [Box<dyn Sink>; 2] = [Box::new(NullSink::new()), Box::new(ring)];
    let branch = |sink| BranchParams { place: "sink".into(), sink, buffers: 4 };
    let mut fan = Fan::start(sinks.map(branch), &frame, OnFull::Drop).unwrap();
    let mut send = |numbers: core::ops::Range<u32>| {
        for number in numbers {
            frame.meta.number = number;
            frame.truth.resize(number as usize * 7 % 500, TruthStar::NONE);
            fan.send(&frame).unwrap();
            // Let threads that wait for a frame reach their wait once.
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    };
    send(0..FRAMES);
    let found = allocations_in(|| send(FRAMES..2 * FRAMES));
    wrong.extend(complaints("several sinks", &found));
    assert_eq!(fan.finish().unwrap().frames, u64::from(2 * FRAMES));
    wrong
}
