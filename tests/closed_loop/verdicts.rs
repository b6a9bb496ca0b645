//! Tests the verdict of a run: each promised frame is counted once, and what is missing has a reason and a word.

use config::{Document, Scenario};
use frames::report::{FrameEnd, RunVerdict, RunWord};
use frames::sink::{NullSink, Sink};
use run::wiring::{run_end::RunEnd, stepped::SteppedRun};

/// Frames of the bench below.
const FRAMES: u64 = 20;

/// Returns a run of ten seconds at 2 Hz with further lines, whose frames are blank when the attitudes stop.
fn bench(lines: &str) -> Scenario {
    bench_with("blank", lines)
}

fn bench_with(stale_policy: &str, lines: &str) -> Scenario {
    let text = format!(
        "name = \"verdicts\"\n[timing]\nframe_rate_hz = 2.0\nduration_s = 10.0\n\
         [attitude]\nstale_after_ms = 500.0\nstale_policy = \"{stale_policy}\"\nmax_horizon_ms = 200.0\n{lines}"
    );
    let camera = Document::built_in("cameras/small_tracker.toml").unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("camera.toml"), camera.text()).unwrap();
    let path = folder.path().join("bench.toml");
    std::fs::write(&path, text.replacen("[timing]", "camera = \"camera.toml\"\n[timing]", 1)).unwrap();
    Scenario::load(&path).unwrap()
}

fn start(scenario: &Scenario) -> SteppedRun {
    SteppedRun::new(scenario, |_| Box::new(NullSink::new()) as Box<dyn Sink>).unwrap()
}

fn flown(scenario: &Scenario) -> RunEnd {
    let mut going = start(scenario);
    going.run_to_end(&mut |_, _, _| true).unwrap();
    going.end(None)
}

fn fly(lines: &str) -> (RunEnd, RunVerdict) {
    let end = flown(&bench(lines));
    let verdict = end.verdict();
    (end, verdict)
}

/// Cuts the attitudes off for two seconds.
const SILENCE: &str = "[[event]]\nat_s = 4.0\nfor_s = 2.0\ndo = \"bus_loss\"\nshare = 1.0\n";

#[test]
fn whole_run_is_ok_and_all_its_frames_are_on_time() {
    let (end, verdict) = fly("");
    assert_eq!((verdict.word, verdict.reasons_line()), (RunWord::Ok, String::new()));
    let account = end.account();
    assert_eq!((account.of(FrameEnd::OnTime).count, account.scheduled()), (FRAMES, FRAMES));
    let summary = end.summary();
    assert_eq!((summary.verdict, summary.frames.scheduled), (verdict, FRAMES), "the summary has the same");
}

#[test]
fn blank_frames_are_a_reason_until_the_bench_allows_them() {
    let (end, verdict) = fly(SILENCE);
    let blank = end.account().of(FrameEnd::Blank).count;
    assert!(blank >= 3, "{blank} frames in two seconds without attitudes");
    assert_eq!(verdict.word, RunWord::Incomplete);
    assert!(verdict.reasons[0].text.starts_with(&format!("{blank} blank: no new attitude from 4.")), "{verdict:?}");
    assert_eq!(end.account().scheduled(), FRAMES, "they add up");

    let (_, allowed) = fly(&format!("{SILENCE}[expect]\nblank_frames_at_most = {blank}\n"));
    assert_eq!(allowed.word, RunWord::Ok, "{allowed:?}");
    assert_eq!(allowed.limits_used.len(), 1);
    let (_, refused) = fly(&format!("{SILENCE}[expect]\nblank_frames_at_most = {}\n", blank - 1));
    assert_eq!(refused.word, RunWord::Failed, "control: a stated limit that is not kept is not met");
}

#[test]
fn commanded_losses_are_counted_and_are_no_reason() {
    let (end, verdict) = fly("[[event]]\nat_s = 2.0\nfor_frames = 3\ndo = \"frame_drop\"\n");
    let account = end.account();
    assert_eq!((verdict.word, account.of(FrameEnd::Commanded).count), (RunWord::Ok, 3), "{verdict:?}");
    assert_eq!((account.of(FrameEnd::OnTime).count, account.scheduled()), (FRAMES - 3, FRAMES));
}

#[test]
fn held_attitude_is_a_reason() {
    let end = flown(&bench_with("hold", SILENCE));
    assert!(end.account().of(FrameEnd::AttitudeHeld).count >= 3);
    assert_eq!(end.verdict().word, RunWord::Incomplete);
}

#[test]
fn run_that_its_client_ends_delivers_what_is_drawn_and_misses_nothing() {
    let mut going = start(&bench(""));
    let zero = going.times().zero;
    // The exposure of a frame is over, its readout is not.
    going.advance_to(zero + base::time::Span::from_ms(3_110), &mut |_, _, _| true).unwrap();
    let drawn = going.record().frames.rendered;
    assert_eq!(drawn, going.record().frames.delivered + 1, "one is on the way");
    going.finish_early(&mut |_, _, _| true).unwrap();
    let end = going.end(None);
    assert_eq!(end.record.frames.delivered, drawn, "and goes out");
    let account = end.account();
    assert_eq!(account.of(FrameEnd::Commanded).count, FRAMES - drawn);
    assert_eq!((end.verdict().word, account.scheduled()), (RunWord::Ok, FRAMES));
}

#[test]
fn run_that_is_stopped_is_incomplete() {
    let mut going = start(&bench(""));
    going.run_to_end(&mut |_, frame, _| frame.meta.number < 6).unwrap();
    let mut end = going.end(None);
    end.cut_short = Some(run::wiring::verdict::CutShort::Interrupted);
    let verdict = end.verdict();
    assert_eq!((verdict.word, end.account().scheduled()), (RunWord::Incomplete, FRAMES));
    assert_eq!(end.account().of(FrameEnd::NotExposed).count, FRAMES - 7, "{verdict:?}");
}

#[test]
fn word_so_far_is_that_of_the_end() {
    let scenario = bench(SILENCE);
    let mut going = start(&scenario);
    let mut words = Vec::new();
    going
        .run_to_end(&mut |_, _, record| {
            words.push(record.numbers(None).word);
            true
        })
        .unwrap();
    assert_eq!((words[0], words.last().copied()), (RunWord::Ok, Some(RunWord::Incomplete)));
    assert!(words.is_sorted(), "a word never gets better");
}
