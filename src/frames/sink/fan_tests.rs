//! Several sinks at once: a slow, a failing and a broken sink lose their own frames, and cost the others nothing.
//!
//! A slow sink is one that waits for the test: no time is measured.

use crate::sink::{
    Fan, Loss, LossKind, NullSink, OnFull, Recorder, RecorderOptions, SentFrame, Sink, SinkError, SinkLine, SinkSummary,
};
use crate::sink::{branch::BranchParams, compliance::check_sink, sample::sample_frame};
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::{Receiver, Sender, bounded, unbounded};
use std::sync::Arc;

/// Takes a frame when the test lets it; says when it has begun with one.
struct Gated {
    inner: NullSink,
    begun: Sender<u32>,
    go_on: Receiver<()>,
}

/// Fails on frames with a number in the list, breaks down at another.
#[derive(Default)]
struct Frail {
    inner: NullSink,
    fails_on: Vec<u32>,
    breaks_at: Option<u32>,
}

impl Sink for Gated {
    fn name(&self) -> &'static str {
        "gated"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.begun.send(frame.meta.number).unwrap();
        let _ = self.go_on.recv(); // a closed channel lets it go on as well
        self.inner.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.inner.finish()
    }
}

impl Sink for Frail {
    fn name(&self) -> &'static str {
        "frail"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let number = frame.meta.number;
        assert_ne!(Some(number), self.breaks_at, "as the test wants it");
        if self.fails_on.contains(&number) {
            let source = std::io::ErrorKind::StorageFull.into();
            return Err(SinkError::Write { path: format!("frame_{number}").into(), source });
        }
        self.inner.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.inner.finish()
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        vec![("words", 7)]
    }
}

/// Takes every frame and never ends.
struct BlocksAtEnd(NullSink);

impl Sink for BlocksAtEnd {
    fn name(&self) -> &'static str {
        "blocks_at_end"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.0.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let (_no_one, never) = bounded::<()>(0);
        let _ = never.recv_timeout(std::time::Duration::from_secs(3600)); // as good as never
        self.0.finish()
    }
}

/// Takes every frame, and reports a frame before as lost: the sixth with the seventh, the last when it is finished.
struct LosesLater {
    inner: NullSink,
    lost: Vec<u32>,
}

impl Sink for LosesLater {
    fn name(&self) -> &'static str {
        "loses_later"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        if frame.meta.number == 7 {
            self.lost.push(6);
        }
        self.inner.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.lost.push(9);
        self.inner.finish()
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.lost.drain(..).for_each(|frame| announce(Loss { kind: LossKind::Cut, frame }));
    }
}

/// Lets a gate go once, when its sink has come to it.
fn let_go_soon(gate: Sender<()>) {
    let go = move || gate.send(()).is_ok();
    let _ = std::thread::Builder::new().name("gate".into()).spawn(go).unwrap(); // it ends by itself
}

fn fan(sinks: Vec<Box<dyn Sink>>, buffers: usize, on_full: OnFull) -> Fan {
    base::patience::be_short();
    let named = (0..).zip(sinks).map(|(i, sink)| BranchParams { place: format!("sink {i}"), sink, buffers });
    Fan::start(named, &sample_frame(0), on_full).unwrap()
}

/// Returns frames taken, dropped, refused.
fn counts(line: &SinkLine) -> [u64; 3] {
    [line.frames, line.dropped, line.refused]
}

/// Returns the losses since the last call: kind, and the numbers of the frames.
fn losses(fan: &mut Fan) -> Vec<(LossKind, u32)> {
    let mut all = Vec::new();
    fan.take_losses(&mut |Loss { kind, frame }| all.push((kind, frame)));
    all
}

fn gate() -> (Gated, Receiver<u32>, Sender<()>) {
    let ((begun, has_begun), (let_go, go_on)) = (unbounded(), bounded(0));
    (Gated { inner: NullSink::new(), begun, go_on }, has_begun, let_go)
}

#[test]
fn a_fan_complies_whether_it_waits_or_not() {
    for on_full in [OnFull::Wait, OnFull::Drop] {
        check_sink(|| Box::new(fan(vec![Box::new(NullSink::new()), Box::new(NullSink::new())], 4, on_full))).unwrap();
    }
}

#[test]
fn a_slow_sink_loses_frames_and_the_others_none() {
    let (gated, has_begun, let_go) = gate();
    let mut fan = fan(vec![Box::new(gated), Box::new(NullSink::new())], 3, OnFull::Drop);
    fan.send(&sample_frame(0)).unwrap();
    assert_eq!(has_begun.recv(), Ok(0), "the slow one is busy with the first");
    for number in 1..10 {
        fan.send(&sample_frame(number)).unwrap();
        // The quick one keeps up: it is given the time, as a frame's period would.
        while fan.lag(1) > 0 {
            std::thread::yield_now();
        }
    }
    let dropped: Vec<_> = (3..10).map(|number| (LossKind::Dropped, number)).collect();
    assert_eq!(losses(&mut fan), dropped, "three buffers: one in work, two waiting");
    assert_eq!(losses(&mut fan), [], "each is reported once");
    drop(let_go);
    let summary = fan.finish().unwrap();
    assert_eq!((summary.frames, summary.refused), (10, 0), "handed to the sinks");
    let lines = fan.lines();
    assert_eq!([counts(&lines[0]), counts(&lines[1])], [[3, 7, 0], [10, 0, 0]]);
    assert_eq!(lines[1].run_crc32, Some(summary.run_crc32), "all frames");
    assert_ne!(lines[0].run_crc32, Some(summary.run_crc32), "and not all");
    assert!(!lines[0].has_failed(), "slow is not a failure");
}

#[test]
fn losses_that_a_sink_reports_later_come_through_with_their_own_numbers() {
    for on_full in [OnFull::Wait, OnFull::Drop] {
        let mut fan = fan(vec![Box::new(LosesLater { inner: NullSink::new(), lost: Vec::new() })], 16, on_full);
        for number in 0..10 {
            fan.send(&sample_frame(number)).unwrap();
        }
        fan.finish().unwrap();
        assert_eq!(losses(&mut fan), [(LossKind::Cut, 6), (LossKind::Cut, 9)], "{on_full:?}");
        assert_eq!(counts(&fan.lines()[0]), [10, 0, 0], "it took them all");
    }
}

#[test]
fn sink_that_blocks_at_the_end_is_given_up_and_the_others_finish() {
    let (gated, _begun, _never_opened) = gate();
    let mut fan = fan(vec![Box::new(gated), Box::new(NullSink::new())], 3, OnFull::Drop);
    for number in 0..5 {
        fan.send(&sample_frame(number)).unwrap();
        while fan.lag(1) > 0 {
            std::thread::yield_now();
        }
    }
    let summary = fan.finish().unwrap();
    assert_eq!(summary.frames, 5, "handed to the sinks");
    let lines = fan.lines();
    assert_eq!([counts(&lines[0]), counts(&lines[1])], [[0, 5, 0], [5, 0, 0]]);
    assert!(lines[0].is_lost && !lines[1].is_lost);
    let error = lines[0].first_error.as_deref().unwrap();
    assert!(error.contains("gated") && error.contains("given up"), "{error}");
    assert_eq!(losses(&mut fan).last(), Some(&(LossKind::SinkLost, 4)));
}

#[test]
fn where_it_waits_a_sink_that_blocks_in_send_is_given_up_and_the_others_go_on() {
    let (gated, _begun, let_go) = gate();
    let mut fan = fan(vec![Box::new(gated), Box::new(NullSink::new())], 1, OnFull::Wait);
    for number in 0..4 {
        if number == 0 {
            let_go_soon(let_go.clone());
        }
        fan.send(&sample_frame(number)).unwrap();
    }
    assert_eq!(fan.finish().unwrap().frames, 4, "handed to the sinks");
    let lines = fan.lines();
    assert_eq!([counts(&lines[0]), counts(&lines[1])], [[1, 3, 0], [4, 0, 0]]);
    assert!(lines[0].is_lost && !lines[1].is_lost);
    assert!(lines[0].first_error.as_ref().unwrap().contains("given up"), "{:?}", lines[0]);
    let lost = [(LossKind::SinkLost, 1), (LossKind::Dropped, 2), (LossKind::Dropped, 3)];
    assert_eq!(losses(&mut fan), lost);
}

#[test]
fn where_it_waits_a_sink_that_blocks_at_its_end_is_given_up_and_the_run_is_whole() {
    let mut fan = fan(vec![Box::new(BlocksAtEnd(NullSink::new())), Box::new(NullSink::new())], 1, OnFull::Wait);
    (0..3).for_each(|number| fan.send(&sample_frame(number)).unwrap());
    assert_eq!(fan.finish().unwrap().frames, 3);
    let lines = fan.lines();
    assert_eq!([counts(&lines[0]), counts(&lines[1])], [[3, 0, 0], [3, 0, 0]]);
    assert!(lines[0].is_lost && !lines[1].is_lost);
}

#[test]
fn slow_sink_that_finishes_frames_at_the_end_is_waited_for() {
    let (gated, begun, go_on) = gate();
    let mut fan = fan(vec![Box::new(gated)], 4, OnFull::Drop);
    (0..4).for_each(|number| fan.send(&sample_frame(number)).unwrap());
    // Together they take longer than the patience, one by one they do not.
    let one_by_one = move || {
        for _ in begun {
            std::thread::sleep(std::time::Duration::from_millis(400));
            let _ = go_on.send(()); // the sink may not wait yet, or no longer
        }
    };
    let opens = std::thread::Builder::new().name("gate".into()).spawn(one_by_one).unwrap();
    fan.finish().unwrap();
    assert_eq!(counts(&fan.lines()[0]), [4, 0, 0]);
    drop(fan);
    opens.join().unwrap();
}

#[test]
fn a_sink_that_fails_gets_the_next_frame_and_its_first_error_is_kept() {
    for on_full in [OnFull::Drop, OnFull::Wait] {
        let frail = Frail { fails_on: vec![2, 4], ..Frail::default() };
        let mut fan = fan(vec![Box::new(NullSink::new()), Box::new(frail)], 8, on_full);
        let refused = (0..6).filter(|number| fan.send(&sample_frame(*number)).is_err()).count();
        assert_eq!(refused, if on_full == OnFull::Wait { 2 } else { 0 }, "{on_full:?}: reported at once, or counted");
        fan.finish().unwrap();
        assert_eq!(losses(&mut fan), [(LossKind::Refused, 2), (LossKind::Refused, 4)], "each with its own number");
        let lines = fan.lines();
        assert_eq!([counts(&lines[0]), counts(&lines[1])], [[6, 0, 0], [4, 0, 2]], "{on_full:?}");
        let first = lines[1].first_error.as_deref().unwrap();
        assert!(first.contains("frame_2") && first.contains("freeing space"), "{first}");
        assert_eq!(lines[1].counts, [("words", 7)]);
        assert!(lines[1].has_failed() && !lines[0].has_failed());
    }
}

#[test]
fn a_sink_that_breaks_down_is_counted_as_lost_and_the_rest_goes_on() {
    let broken = Frail { breaks_at: Some(3), ..Frail::default() };
    let mut fan = fan(vec![Box::new(broken), Box::new(NullSink::new())], 8, OnFull::Drop);
    (0..8).for_each(|number| fan.send(&sample_frame(number)).unwrap());
    fan.finish().unwrap();
    let lines = fan.lines();
    assert_eq!([counts(&lines[0]), counts(&lines[1])], [[3, 5, 0], [8, 0, 0]]);
    assert!(lines[0].is_lost && lines[0].first_error.as_ref().unwrap().contains("as the test wants it"));
    let dropped = (3..8).map(|number| (LossKind::Dropped, number));
    let lost: Vec<_> = core::iter::once((LossKind::SinkLost, 3)).chain(dropped).collect();
    assert_eq!(losses(&mut fan), lost);
}

#[test]
fn where_it_waits_a_broken_sink_is_an_error_of_the_frame() {
    let broken = Frail { breaks_at: Some(1), ..Frail::default() };
    let mut fan = fan(vec![Box::new(broken), Box::new(NullSink::new())], 8, OnFull::Wait);
    fan.send(&sample_frame(0)).unwrap();
    for number in 1..3 {
        let error = fan.send(&sample_frame(number)).unwrap_err();
        assert!(matches!(error, SinkError::Lost { sink: "frail" }), "{error}");
    }
}

#[test]
fn where_it_waits_nothing_is_ever_dropped() {
    let directory = tempfile::tempdir().unwrap();
    let options = RecorderOptions { ser: true, ..RecorderOptions::default() };
    let recorder = Recorder::create(directory.path(), options).unwrap();
    let mut fan = fan(vec![Box::new(recorder), Box::new(NullSink::new())], 1, OnFull::Wait);
    (0..20).for_each(|number| fan.send(&sample_frame(number)).unwrap());
    let summary = fan.finish().unwrap();
    assert_eq!(summary.output.as_deref(), Some(directory.path()));
    for line in fan.lines() {
        assert_eq!((counts(&line), line.run_crc32), ([20, 0, 0], Some(summary.run_crc32)), "{}", line.kind);
    }
}

/// Says when it is gone, whole or broken.
struct Leaving {
    inner: Frail,
    is_gone: Arc<AtomicBool>,
    is_finished: Arc<AtomicBool>,
}

impl Sink for Leaving {
    fn name(&self) -> &'static str {
        "leaving"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.inner.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.is_finished.store(true, Ordering::Relaxed);
        self.inner.finish()
    }
}

impl Drop for Leaving {
    fn drop(&mut self) {
        // Long enough for a fan that does not wait to be gone before.
        std::thread::sleep(std::time::Duration::from_millis(20));
        self.is_gone.store(true, Ordering::Relaxed);
    }
}

#[test]
fn nothing_of_a_sink_outlives_a_fan_that_is_dropped() {
    for (breaks_at, frames) in [(None, 0), (None, 3), (Some(1), 3)] {
        let (is_gone, is_finished) = (Arc::<AtomicBool>::default(), Arc::<AtomicBool>::default());
        let inner = Frail { breaks_at, ..Frail::default() };
        let leaving = Leaving { inner, is_gone: Arc::clone(&is_gone), is_finished: Arc::clone(&is_finished) };
        let mut fan = fan(vec![Box::new(leaving), Box::new(NullSink::new())], 4, OnFull::Drop);
        (0..frames).for_each(|number| fan.send(&sample_frame(number)).unwrap());
        drop(fan);
        assert!(is_gone.load(Ordering::Relaxed), "after {frames} frames");
        assert_eq!(is_finished.load(Ordering::Relaxed), breaks_at.is_none(), "what it took is brought out");
    }
}
