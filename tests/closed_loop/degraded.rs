//! Tests degradation: a frame that would not be drawn in time is degraded, and all reports state this.

use crate::bench::{Kept, built_in, over, run, start};
use base::time::Span;
use config::{Bench, Degrade, Psf};
use frames::sink::fits::read_image;
use frames::sink::frame_log::{path_in, read_frame_log};
use frames::sink::{Recorder, RecorderOptions, SentFrame, Sink};
use link::WireFormat;
use plan::exposure::Degradation;
use run::runtime::{EventKind, FrameEngine};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::{collections::BTreeMap, fs::File};

/// Readout time: minus the detector's time it is shorter than the drawing time of a frame's stars inside the accuracy
/// budget.
const SHORT_S: f64 = 4.1e-3;
/// Readout time shorter than that of the detector alone, s.
const IMPOSSIBLE_S: f64 = 1e-3;
const FRAMES: u64 = 10;
/// Number of stars that are always drawn.
const LEAST_STARS: usize = 32;

/// Returns a bench with all stars of the catalog, and hardly time for any.
fn without_time(readout_s: f64, degrade: Degrade) -> Bench {
    let mut bench = over(WireFormat::CanFd, 1.0);
    bench.camera.radiometry.limiting_mag = Some(12.0);
    bench.camera.exposure.readout_s = readout_s;
    bench.timing.degrade = degrade;
    bench.timing.degrade_to = Degradation::BrightStarsOnly;
    bench
}

fn by_degradation(frames: &[Kept]) -> BTreeMap<String, u64> {
    let mut counts = BTreeMap::new();
    for frame in frames.iter().filter(|frame| frame.meta.degradation != Degradation::Full) {
        *counts.entry(frame.meta.degradation.name().to_owned()).or_insert(0) += 1;
    }
    counts
}

#[test]
fn a_frame_without_time_is_degraded_counted_and_reported() {
    for readout_s in [SHORT_S, IMPOSSIBLE_S] {
        let bench = without_time(readout_s, Degrade::Always);
        let run = run(&bench);
        assert!(run.outcome.error.is_none());
        let record = &run.outcome.record;
        assert_eq!(record.ledger.count(EventKind::Degraded), FRAMES, "an event for every frame");
        let events: Vec<_> = record.ledger.last().filter(|event| event.kind == EventKind::Degraded).collect();
        for frame in &run.frames {
            let event = events.iter().find(|event| event.frame == Some(frame.meta.number)).unwrap();
            assert_eq!(event.degradation, frame.meta.degradation, "the event names the frame's degradation");
            assert!(event.degradation > Degradation::Full && event.span > Span::ZERO, "{event:?}");
        }
        let params = bench_parts::run_params(&bench, start(&bench)).unwrap();
        let engine = FrameEngine::new(params.clone()).unwrap();
        let summary = record.summary(&engine, &Receiver::new(params.attitude).unwrap(), &[], None);
        assert_eq!(summary.degraded, by_degradation(&run.frames), "the summary counts what the frames say");
        assert_eq!(summary.degraded.values().sum::<u64>(), FRAMES);
    }
}

#[test]
fn when_even_the_detector_has_no_time_the_brightest_stars_stay_and_the_rest_is_accounted_for() {
    let [whole, short, impossible] =
        [(SHORT_S, Degrade::Never), (SHORT_S, Degrade::Always), (IMPOSSIBLE_S, Degrade::Always)]
            .map(|(readout_s, degrade)| run(&without_time(readout_s, degrade)).frames);
    for ((whole, short), impossible) in whole.iter().zip(&short).zip(&impossible) {
        assert!(
            short.meta.degradation < impossible.meta.degradation || short.stars >= impossible.stars,
            "less time gives up more"
        );
        assert_eq!((impossible.stars, impossible.meta.degradation), (LEAST_STARS, Degradation::BrightStarsOnly));
        let all = |frame: &Kept| frame.stars + frame.meta.left_out_stars;
        assert_eq!(all(impossible), all(whole), "every star is drawn or counted");
        assert!(impossible.meta.left_out_e > whole.meta.left_out_e, "and its light");
    }
}

/// Tests that a frame without motion, or without visible stars, is drawn only if the user selects that level by name.
#[test]
fn default_degradation_ends_before_unphysical_frames() {
    let mut bench = without_time(IMPOSSIBLE_S, Degrade::Always);
    bench.timing.degrade_to = built_in(1.0).timing.degrade_to;
    let run = run(&bench);
    assert_eq!(by_degradation(&run.frames), BTreeMap::from([(Degradation::Budget10.name().to_owned(), FRAMES)]));
    assert!(run.frames.iter().all(|frame| frame.stars > 10 * LEAST_STARS), "visible stars are there");
}

#[test]
fn without_the_key_the_virtual_clock_never_degrades() {
    for degrade in [Degrade::OnRealClock, Degrade::Never] {
        let run = run(&without_time(IMPOSSIBLE_S, degrade));
        assert_eq!(run.outcome.record.ledger.count(EventKind::Degraded), 0, "{degrade:?}");
        assert!(by_degradation(&run.frames).is_empty(), "{degrade:?}");
    }
    let roomy = run(&Bench { timing: without_time(IMPOSSIBLE_S, Degrade::Always).timing, ..built_in(1.0) });
    assert_eq!(
        roomy.outcome.record.ledger.count(EventKind::Degraded),
        0,
        "sufficient time causes no degradation either"
    );
}

#[test]
fn degraded_runs_repeat_bit_for_bit() {
    let [a, b] = [(); 2].map(|()| run(&without_time(IMPOSSIBLE_S, Degrade::Always)).frames);
    assert_eq!(a, b);
    let whole = run(&without_time(IMPOSSIBLE_S, Degrade::Never)).frames;
    assert!(a.iter().zip(&whole).all(|(a, whole)| a.dn_sum != whole.dn_sum), "the comparison can fail");
}

#[test]
fn files_contain_the_degradation_of_the_frame() {
    let frames = run(&without_time(IMPOSSIBLE_S, Degrade::Always)).frames;
    let folder = tempfile::tempdir().unwrap();
    let directory = folder.path().join("recording");
    let options = RecorderOptions::default();
    let mut recorder = Recorder::create(&directory, options).unwrap();
    for kept in &frames {
        let mut frame = SentFrame::with_capacity(8, 8, 0, kept.meta.camera.clone());
        frame.meta = kept.meta.clone();
        recorder.send(&frame).unwrap();
    }
    recorder.finish().unwrap();
    #[derive(serde::Deserialize)]
    struct Row {
        #[serde(rename = "rung")]
        degradation: String,
        left_out_stars: usize,
        left_out_e: f64,
    }
    let rows: Vec<Row> = read_frame_log(File::open(path_in(&directory)).unwrap()).unwrap();
    assert_eq!(rows.len(), frames.len());
    for (row, Kept { meta, .. }) in rows.iter().zip(&frames) {
        assert_eq!(
            (row.degradation.as_str(), row.left_out_stars),
            (meta.degradation.name(), meta.left_out_stars),
            "frames.csv"
        );
        assert_eq!(row.left_out_e.to_bits(), meta.left_out_e.to_bits(), "frames.csv");
        let file = File::open(directory.join(format!("frame_{:06}.fits", meta.number))).unwrap();
        let header = read_image(file).unwrap().header;
        assert_eq!(header.text("RUNG").as_deref(), Some(meta.degradation.name()), "FITS");
        assert_eq!(header.integer("NLEFTOUT"), i128::try_from(meta.left_out_stars).ok(), "FITS");
        assert_eq!(header.real("LEFTOUTE"), Some(meta.left_out_e), "FITS");
    }
}

#[test]
fn light_that_is_missing_is_over_the_budget_in_every_frame() {
    let events = |sigma_px: f64| {
        let mut bench = over(WireFormat::CanFd, 0.5);
        bench.camera.psf = Psf::Gaussian { sigma_px };
        let run = run(&bench);
        assert!(run.outcome.error.is_none());
        (run.outcome.record.ledger.count(EventKind::OverBudget), run.frames.len() as u64)
    };
    let (over, frames) = events(20.0);
    assert_eq!(over, frames, "3 % of the light of a PSF this wide lies beyond its footprint");
    assert_eq!(events(0.8).0, 0, "control: a narrow one loses nothing");
}
