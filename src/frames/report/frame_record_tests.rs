use super::*;

/// Returns medians of 1 ms for every stage but the drawing, which takes 20 ms.
fn usual() -> StageHistograms {
    let mut usual = StageHistograms::default();
    for stage in Stage::OF_A_FRAME {
        let ms = if stage == Stage::Render { 20 } else { 1 };
        (0..5).for_each(|_| usual.record_stage(stage, Span::from_ms(ms)));
    }
    usual
}

/// Returns a frame whose stages took their usual times, except one.
fn record(stage: Stage, ms: i64, lateness_ms: i64) -> FrameRecord {
    let mut record = sample_record(1);
    for usual in [Stage::Wake, Stage::Receive, Stage::Attitude, Stage::Sky, Stage::Plan, Stage::Detector] {
        record.times.set(usual, Span::from_ms(1));
    }
    record.times.set(Stage::Render, Span::from_ms(20));
    record.times.set(stage, Span::from_ms(ms));
    record.lateness = Span::from_ms(lateness_ms);
    record
}

#[test]
fn the_cause_is_the_stage_that_took_longest_beyond_its_median() {
    for stage in [Stage::Receive, Stage::Attitude, Stage::Sky, Stage::Plan, Stage::Detector, Stage::Render] {
        let ms = if stage == Stage::Render { 35 } else { 15 };
        assert_eq!(record(stage, ms, 10).cause_of_lateness(&usual()), MissCause::Stage(stage));
    }
}

#[test]
fn when_every_frame_is_late_the_longest_stage_is_to_blame() {
    let usual_times = record(Stage::Render, 20, 5);
    assert_eq!(usual_times.cause_of_lateness(&usual()), MissCause::Stage(Stage::Render));
    let noise = record(Stage::Sky, 2, 5);
    assert_eq!(noise.cause_of_lateness(&usual()), MissCause::Stage(Stage::Render), "1 ms does not explain 5 ms");
}

#[test]
fn a_late_start_is_the_systems_or_that_of_the_frames_before() {
    let asleep = record(Stage::Wake, 30, 10);
    assert_eq!(asleep.cause_of_lateness(&usual()), MissCause::ReleasedLate);
    let busy = FrameRecord { asked: asleep.release + Span::from_ms(29), ..asleep };
    assert_eq!(busy.cause_of_lateness(&usual()), MissCause::FramesBefore);
}

#[test]
fn causes_have_places_and_names_of_their_own() {
    let names: std::collections::BTreeSet<_> = MissCause::all().map(MissCause::name).collect();
    assert_eq!(names.len(), MissCause::COUNT);
    assert!(MissCause::all().enumerate().all(|(i, cause)| cause.index() == i));
}
