//! Tests jitter samples that arrive late: the error of frames without them, and that every such frame reports it.
//!
//! The flight computer's own jitter stream is off; a sender of this file sends the same jitter with a delay. The truth
//! is a run in which the stimulator has the jitter as a line.

use crate::bench::{self, Flight, over, start};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::{Bench, Camera, JitterSource};
use frames::sink::{SentFrame, Sink, SinkError, SinkSummary, TruthStar};
use link::{Port, WireFormat};
use run::runtime::{EventKind, RunRecord};
use std::sync::{Arc, Mutex};
use std::{collections::BTreeMap, path::Path};
use testbed::flight_computer::{FlightComputer, FlightComputerParams, JitterLineParams, JitterStream};

use firmware_protocol::Message;
use firmware_protocol::message::{JitterBurst, JitterPair};

/// A slow line with the amplitude at which a lost sample has the largest effect.
const LINE: JitterLineParams =
    JitterLineParams { frequency_hz: 0.4, amplitude_arcsec: [80.0, 0.0, 0.0], phase_rad: 0.3 };
/// The small tracker's pixel: 20 degrees over 256 px.
const ARCSEC_PER_PX: f64 = 281.0;
/// Tolerance of frames with all their samples: rounding on the wire (0.02 arcsec) and of places.
const COMPLETE_ARCSEC: f64 = 0.1;
/// Frames at the start, before the clock and the stream are known.
const SETTLING: usize = 3;

/// One frame: its stars' places by number, and its report about jitter.
struct Shot {
    places: BTreeMap<u32, [f64; 2]>,
    missing: Span,
}

/// Stores the places of the stars.
struct Album(Arc<Mutex<Vec<Shot>>>);

impl Sink for Album {
    fn name(&self) -> &'static str {
        "album"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let place = |star: &TruthStar| (star.id, [star.x_px, star.y_px]);
        let shot = Shot { places: frame.truth.iter().map(place).collect(), missing: frame.meta.jitter_missing };
        self.0.lock().unwrap().push(shot);
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        Ok(SinkSummary { sink: "album", frames: 0, refused: 0, bytes: 0, run_crc32: 0, output: None })
    }
}

/// Sends the jitter with a delay after its samples' epochs.
struct LateSender {
    wire: WireFormat,
    delay: Span,
    boot: Tai,
    sent: i64,
}

impl LateSender {
    fn samples(&self) -> i64 {
        if self.wire == WireFormat::CanClassic { 2 } else { 14 }
    }

    /// Returns when the next message is sent: when its last sample is as old as the delay.
    fn next_due(&self) -> Tai {
        self.boot + Span::from_ms(self.samples() * (self.sent + 1) - 1) + self.delay
    }

    fn send_due(&mut self, now: Tai, computer: &FlightComputer, port: &mut Port) {
        while self.next_due() <= now {
            let first_ms = self.samples() * self.sent;
            let sample = |i: i64| {
                let body_rad = computer.jitter_truth(self.boot + Span::from_ms(first_ms + i));
                [(body_rad.x / ARCSEC) as f32, (body_rad.y / ARCSEC) as f32]
            };
            let samples: Vec<[f32; 2]> = (0..self.samples()).map(sample).collect();
            let message = if self.wire == WireFormat::CanClassic {
                let slot = u8::try_from(first_ms / 2 % 256).unwrap();
                Message::JitterPair(JitterPair { slot, samples_arcsec: [samples[0], samples[1]] })
            } else {
                let (t_us, seq) = (u32::try_from(1000 * first_ms).unwrap(), u8::try_from(self.sent % 256).unwrap());
                Message::Jitter(JitterBurst::new(t_us, 1000, seq, &samples).unwrap())
            };
            port.send(&message).unwrap();
            self.sent += 1;
        }
    }
}

/// Results of a run: its frames, its record, and the samples that came after their frame.
struct Flown {
    shots: Vec<Shot>,
    record: RunRecord,
    late_samples: u64,
}

/// Flies the bench with jitter that has this delay; `None`: the stimulator has it as a line.
fn fly(bench: &Bench, delay: Option<Span>) -> Flown {
    let shots = Arc::new(Mutex::new(Vec::new()));
    let mut sender = delay.map(|delay| LateSender { wire: bench.link.wire, delay, boot: start(bench), sent: 0 });
    let sink = Box::new(Album(Arc::clone(&shots)));
    let silent = |computer: &mut FlightComputerParams| computer.jitter = JitterStream::OFF;
    let Flight { outcome, receiver, .. } = bench::fly(bench, silent, sink, &mut |now, computer, far| {
        let sender = sender.as_mut()?;
        sender.send_due(now, computer, far);
        Some(sender.next_due())
    });
    assert!(outcome.error.is_none(), "{:?}", outcome.error.map(|error| error.to_string()));
    let shots = core::mem::take(&mut *shots.lock().unwrap());
    Flown { shots, record: outcome.record, late_samples: receiver.mountings.of(0).late_jitter }
}

fn bench(wire: WireFormat, source: JitterSource) -> Bench {
    let mut bench = over(wire, 2.0);
    bench.camera = Camera::load(Path::new("configs/cameras/small_tracker.toml")).unwrap();
    // Ample time: a frame waits half of it at most.
    bench.camera.exposure.readout_s = 0.1;
    bench.flight_computer.jitter_lines = vec![LINE];
    bench.flight_computer.jitter_source = source;
    bench
}

/// Returns the largest displacement of any star between two frames, arcsec.
fn error_arcsec(frame: &Shot, truth: &Shot) -> f64 {
    let off = |(id, a): (&u32, &[f64; 2])| truth.places.get(id).map(|b| (a[0] - b[0]).hypot(a[1] - b[1]));
    let off_px: Vec<f64> = frame.places.iter().filter_map(off).collect();
    assert!(off_px.len() > 20, "{} stars in both", off_px.len());
    off_px.into_iter().fold(0.0, f64::max) * ARCSEC_PER_PX
}

/// Checks that frames without all their samples report it, and returns the largest error.
fn checked(wire: WireFormat, delay_ms: i64, truth: &[Shot]) -> f64 {
    let flown = fly(&bench(wire, JitterSource::Samples), Some(Span::from_ms(delay_ms)));
    assert_eq!(flown.shots.len(), truth.len());
    let flagged = flown.shots.iter().filter(|shot| shot.missing > Span::ZERO).count() as u64;
    let ledger = &flown.record.ledger;
    assert_eq!(
        flown.record.frames.jitter_missing, flagged,
        "{wire:?}, {delay_ms} ms: the summary counts what frames say"
    );
    assert_eq!(ledger.count(EventKind::JitterMissing), flagged, "{wire:?}, {delay_ms} ms: and so does the ledger");
    let mut worst = 0.0_f64;
    for (number, (shot, truth)) in flown.shots.iter().zip(truth).enumerate().skip(SETTLING) {
        let error = error_arcsec(shot, truth);
        let is_flagged = shot.missing > Span::ZERO;
        assert!(is_flagged || error < COMPLETE_ARCSEC, "{wire:?}, {delay_ms} ms, frame {number}: {error} and silent");
        worst = worst.max(error);
    }
    let share = flagged as f64 / flown.shots.len() as f64;
    println!("{wire:?}, {delay_ms} ms late: {worst:.3} arcsec at worst, {:.0} % flagged", 100.0 * share);
    // Pairs of classic CAN that are 20 ms late come while the frame still waits for them, all but the last.
    let (least_share, least_samples) = match (wire, delay_ms) {
        (WireFormat::CanClassic, 20) => (0.5, 10),
        _ => (0.8, 100),
    };
    let late = flown.late_samples;
    if delay_ms == 0 {
        assert_eq!((flagged, late), (0, 0), "{wire:?}: all came in time");
    } else {
        assert!(share > least_share && late > least_samples, "{wire:?}, {delay_ms} ms: {share}, {late}");
    }
    worst
}

#[test]
fn frames_without_jitter_samples_report_it_and_others_do_not() {
    for wire in [WireFormat::CanFd, WireFormat::CanClassic] {
        let truth = fly(&bench(wire, JitterSource::Lines), None);
        assert_eq!(truth.record.ledger.count(EventKind::JitterMissing), 0, "no stream of samples, nothing missing");
        let errors = [0, 20, 60, 200].map(|delay_ms| checked(wire, delay_ms, &truth.shots));
        assert!(errors[0] < COMPLETE_ARCSEC, "{wire:?}: {errors:?}");
        assert!(errors[2] > 10.0 * COMPLETE_ARCSEC && errors[3] > 20.0, "lateness matters: {wire:?}, {errors:?}");
    }
}

/// Tests that frames wait: a burst of 14 ms is complete only after the exposure's end, and every frame would lack
/// samples.
#[test]
fn frames_wait_for_samples_that_are_under_way() {
    let mut impatient = bench(WireFormat::CanFd, JitterSource::Samples);
    impatient.attitude.jitter_wait = Span::ZERO;
    let flown = fly(&impatient, Some(Span::ZERO));
    assert!(flown.record.frames.jitter_missing > 15, "{:?}", flown.record.frames);
    let patient = fly(&bench(WireFormat::CanFd, JitterSource::Samples), Some(Span::ZERO));
    assert_eq!(patient.record.frames.jitter_missing, 0);
}
