//! Tests that the attitude rendered is the attitude sent, over every wire, and that runs repeat.

use crate::bench::{built_in, over, run, run_changed};
use base::axes::{Icrf, Rotation, Sensor};
use base::{time::Span, units::ARCSEC};
use config::JitterSource;
use firmware_protocol::can::IdMap;
use link::WireFormat;
use run::runtime::EventKind;

/// Tolerance: f32 quaternion on the wire 0.019 arcsec, interpolation of a 2 degree slew at 100 Hz < 0.001, time tag
/// rounding (1 us at 0.5 deg/s) 0.002.
const WIRE_ARCSEC: f64 = 0.03;

#[test]
fn the_attitude_rendered_is_the_attitude_sent() {
    let long = |wire| {
        let mut bench = over(wire, 4.0);
        bench.link.ids = IdMap::extended(0x18FF_0000, 5).unwrap();
        bench
    };
    let benches = [WireFormat::CanFd, WireFormat::CanClassic, WireFormat::Serial].map(|wire| over(wire, 4.0));
    for bench in benches.into_iter().chain([WireFormat::CanFd, WireFormat::CanClassic].map(long)) {
        let (wire, run) = (bench.link.wire, run(&bench));
        assert!(run.outcome.error.is_none(), "{wire:?}: {:?}", run.outcome.error.map(|e| e.to_string()));
        assert_eq!(run.frames.len(), 40, "{wire:?}");
        for frame in &run.frames {
            let truth = run.computer.truth(frame.meta.mid_exposure).unwrap();
            let rendered: Rotation<Sensor, Icrf> = Rotation::from_wxyz(frame.meta.attitude_wxyz, 1e-9).unwrap();
            let sent = Rotation::<Sensor, Icrf>::from_quat(truth.body_from_icrf.quat());
            let off_arcsec = sent.rotation_vector_to(&rendered).length() / ARCSEC;
            assert!(off_arcsec < WIRE_ARCSEC, "{wire:?}, frame {}: {off_arcsec} arcsec", frame.meta.number);
            assert!(frame.stars > 100, "{wire:?}: {} stars", frame.stars);
        }
        // Negative control: half a frame later the slew has moved on.
        let (first, last) =
            (&run.frames[20], run.computer.truth(run.frames[20].meta.mid_exposure + Span::from_ms(50)).unwrap());
        let rendered: Rotation<Sensor, Icrf> = Rotation::from_wxyz(first.meta.attitude_wxyz, 1e-9).unwrap();
        let later = Rotation::<Sensor, Icrf>::from_quat(last.body_from_icrf.quat());
        assert!(later.rotation_vector_to(&rendered).length() / ARCSEC > WIRE_ARCSEC, "a shift of 50 ms is seen");
    }
}

#[test]
fn frames_drawn_ahead_show_where_the_sensor_will_point() {
    let mut bench = over(WireFormat::CanFd, 6.0);
    let now = run(&bench);
    bench.timing.ahead_ms = 120.0;
    let ahead = run(&bench);
    assert!(ahead.outcome.error.is_none());
    assert_eq!(now.frames.len(), ahead.frames.len());
    for (frame, now) in ahead.frames.iter().zip(&now.frames) {
        assert_eq!(frame.meta.mid_exposure, now.meta.mid_exposure, "the same instant is shown");
        // Started 120 ms before the end of an exposure of 100 ms: 70 ms before its middle, and the newest sample is
        // older.
        let horizon = frame.meta.horizon;
        assert!(horizon >= Span::from_ms(70) && horizon < Span::from_ms(90), "{horizon:?}");
        assert!(now.meta.horizon <= Span::ZERO, "{:?}", now.meta.horizon);
        let truth = ahead.computer.truth(frame.meta.mid_exposure).unwrap();
        let rendered: Rotation<Sensor, Icrf> = Rotation::from_wxyz(frame.meta.attitude_wxyz, 1e-9).unwrap();
        let sent = Rotation::<Sensor, Icrf>::from_quat(truth.body_from_icrf.quat());
        let off_arcsec = sent.rotation_vector_to(&rendered).length() / ARCSEC;
        // Held for this long, an attitude would be 100 arcsec off in the middle of the slew.
        assert!(off_arcsec < 2.0, "frame {}: {off_arcsec} arcsec", frame.meta.number);
    }
    assert_eq!(ahead.outcome.record.ledger.count(EventKind::Predicted), ahead.frames.len() as u64, "and counted");
}

#[test]
fn the_flight_computer_receives_every_frame() {
    let run = run(&built_in(2.0));
    let received = &run.computer.received;
    // The run ends when the last frame has been read out: its messages have arrived by then.
    assert_eq!(received.exposures, 20, "EXPOSURE per frame");
    assert!(received.status_pages >= 38, "STATUS pages: {}", received.status_pages);
}

#[test]
fn a_run_repeats_bit_for_bit_and_follows_its_seed() {
    let (a, b) = (run(&built_in(1.0)), run(&built_in(1.0)));
    assert_eq!(a.frames, b.frames, "the same run twice");
    let mut bench = built_in(1.0);
    bench.seed += 1;
    let other = run(&bench);
    assert_eq!(a.frames.len(), other.frames.len());
    for (a, other) in a.frames.iter().zip(&other.frames) {
        assert_ne!(a.dn_sum, other.dn_sum, "another seed is another frame");
    }
}

#[test]
fn jitter_sent_as_samples_is_drawn_like_jitter_known_as_lines() {
    let mut bench = over(WireFormat::CanFd, 3.0);
    bench.flight_computer.jitter_source = JitterSource::Samples;
    let sampled = run(&bench);
    assert!(sampled.outcome.error.is_none());
    // A burst of 14 samples at 1 kHz is complete up to 14 ms after its first one, so the end of an exposure is held.
    let lines = run(&over(WireFormat::CanFd, 3.0));
    let mut still = over(WireFormat::CanFd, 3.0);
    still.flight_computer.jitter_lines.clear();
    let still = run(&still);
    let off = |a: &[crate::bench::Kept], b: &[crate::bench::Kept]| -> f64 {
        a.iter().zip(b).skip(5).map(|(a, b)| (a.dn_sum as f64 - b.dn_sum as f64).abs()).sum()
    };
    assert!(off(&sampled.frames, &lines.frames) < 0.5 * off(&still.frames, &lines.frames), "samples carry the jitter");
}

#[test]
fn stopped_stream_is_held_and_reported() {
    let bench = built_in(3.0);
    let stop = crate::bench::start(&bench) + Span::from_ms(2000);
    let run = run_changed(&bench, |computer| computer.faults.stop_stream_at = Some(stop), usize::MAX);
    assert!(run.outcome.error.is_none());
    let ledger = &run.outcome.record.ledger;
    assert!(ledger.count(EventKind::Predicted) > 0, "predicted while fresh");
    assert!(ledger.count(EventKind::AttitudeHeld) > 0, "then held");
    assert_eq!(run.frames.last().unwrap().meta.origin.name(), "held");
    assert_eq!(run.frames.len(), 30, "frames go on");
    let counted = ledger.count(EventKind::Predicted) + ledger.count(EventKind::AttitudeHeld);
    assert_eq!(counted, run.outcome.record.frames.extrapolated, "never silent");
}

/// Tests a stream that stops within an exposure whose middle is still interpolated: the extrapolated rest must be
/// reported.
#[test]
fn long_exposure_that_outlives_the_stream_is_partly_extrapolated() {
    let mut bench = built_in(4.0);
    bench.camera.exposure.exposure_s = 0.5;
    bench.timing.frame_rate_hz = 2.0;
    let whole = run(&bench);
    assert_eq!(whole.outcome.record.frames.partly_extrapolated, 0, "while the stream goes on");
    // Exposures start every 0.5 s from the first second on: the third one's middle is at 2.25 s.
    let stop = crate::bench::start(&bench) + Span::from_ms(2350);
    let stopped = run_changed(&bench, |computer| computer.faults.stop_stream_at = Some(stop), usize::MAX);
    let record = &stopped.outcome.record;
    assert_eq!((record.frames.partly_extrapolated, record.ledger.count(EventKind::PartlyExtrapolated)), (1, 1));
    let meta = &stopped.frames[2].meta;
    assert_eq!((meta.origin.name(), meta.is_partly_extrapolated), ("interpolated", true));
    assert!(meta.horizon <= Span::ZERO, "{:?}", meta.horizon);
    let outside_ms = meta.end_horizon.ms();
    assert!((150.0..=170.0).contains(&outside_ms), "{outside_ms} ms after the last sample");
    assert!(!stopped.frames[1].meta.is_partly_extrapolated, "the one before was complete");
    assert!(
        !stopped.frames[3].meta.is_partly_extrapolated,
        "the one after is predicted from its middle on, and says so"
    );
    assert_ne!(stopped.frames[3].meta.origin.name(), "interpolated");
}

/// Tests that the last rows of a rolling shutter, exposed after the frame's release, are always reported as
/// extrapolated.
#[test]
fn rolling_shutter_reports_its_extrapolated_last_rows() {
    for (line_us, frames) in [(0.0, 0), (10.0, 0), (100.0, 10)] {
        let mut bench = built_in(1.0);
        bench.camera.exposure.rolling_line_us = line_us;
        let run = run(&bench);
        let record = &run.outcome.record;
        assert_eq!(
            record.frames.partly_extrapolated, frames,
            "{line_us} us per line: half of 1024 of them after the end"
        );
        assert_eq!(record.ledger.count(EventKind::PartlyExtrapolated), frames);
    }
}
