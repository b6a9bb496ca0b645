//! Tests camera commands of the flight computer over the bus: the light follows exposure and gain, triggers start
//! exposures at their instants, and an impossible command is answered with its reason.

use crate::bench::{built_in, fly_head, start};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use config::Bench;
use firmware_protocol::can::IdMap;
use firmware_protocol::message::{ALL_HEADS, CameraKind, CameraPage, CameraSetting, Refusal};
use frames::sink::{FrameMeta, NullSink};
use link::{Port, simulated::simulated_pair};
use run::runtime::{EventKind, FrameEngine, Head, RunOutcome};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::Arc;
use testbed::flight_computer::{CameraAnswers, FlightComputer, Received};

/// Background at the camera's own exposure time, share of full scale: stars are negligible relative to it.
const BACKGROUND_SHARE: f64 = 0.1;
/// Relative accuracy with which light follows the settings.
const PROPORTION: f64 = 0.01;
/// Time from a step of the flight computer, over the bus, to the arrival.
const ON_THE_WAY: Span = Span::from_ms(15);
/// Accuracy of an instant of the far clock after some seconds of time marks.
const CLOCK: Span = Span::from_ns(100_000);

/// A message of the flight computer.
#[derive(Clone, Copy)]
enum Said {
    Set(CameraKind, u8, u32),
    /// A trigger at once, or at a time after the start, s.
    Trigger(Option<f64>),
}

struct Frame {
    meta: FrameMeta,
    /// Mean above the black level, DN.
    light_dn: f64,
    /// Sum of all pixels, each weighted by its place.
    sum: u64,
}

struct Flown {
    start: Tai,
    outcome: RunOutcome,
    frames: Vec<Frame>,
    answers: CameraAnswers,
    received: Received,
}

/// Returns a bench with uniform light.
fn bright(seconds: f64) -> Bench {
    let mut bench = built_in(seconds);
    let full_e = bench.camera.detector.params.full_well_e;
    bench.camera.background.uniform_e_per_s = BACKGROUND_SHARE * full_e / bench.camera.exposure.exposure_s;
    bench
}

fn kept(frame: &frames::sink::SentFrame) -> Frame {
    let pixels = frame.image.pixels();
    let total: u64 = pixels.iter().map(|dn| u64::from(*dn)).sum();
    let sum = pixels.iter().enumerate().map(|(i, dn)| (i as u64 + 1) * u64::from(*dn)).sum();
    let light_dn = total as f64 / pixels.len() as f64 - frame.meta.black_level_dn;
    Frame { meta: frame.meta.clone(), light_dn, sum }
}

fn fly(bench: &Bench, said: &[(f64, Said)]) -> Flown {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut receiver = Receiver::new(params.attitude.clone()).unwrap();
    let mut head = Head::new(FrameEngine::new(params).unwrap(), Box::new(NullSink::new()));
    let clock = Arc::new(Virtual::new(start));
    let shared: Arc<dyn Clock> = clock.clone();
    let (bus, format) = bench_parts::bus(bench);
    let ids = IdMap::new(0, 0).unwrap();
    let (near, far) = simulated_pair(bus, &shared);
    let (mut near, mut far) = (Port::new(Box::new(near), format, ids), Port::new(Box::new(far), format, ids));
    let mut computer = FlightComputer::new(bench_parts::flight_computer(bench, start));
    let (mut left, mut frames) = (said.iter().peekable(), Vec::new());
    let outcome = fly_head(
        &mut head,
        &mut receiver,
        &mut near,
        &clock,
        &mut |now| {
            while let Some((_, said)) = left.next_if(|(s, _)| start + Span::from_s(*s) <= now) {
                match *said {
                    Said::Set(kind, head, value) => {
                        computer.set_camera(CameraSetting { kind: kind.number(), head, value }, now).unwrap();
                    }
                    Said::Trigger(at_s) => {
                        computer.trigger_camera(0, at_s.map(|s| start + Span::from_s(s)), now).unwrap();
                    }
                }
            }
            computer.step(now, &mut far)?;
            Ok(computer.next_due())
        },
        &mut |frame, _| {
            frames.push(kept(frame));
            true
        },
    );
    assert!(outcome.error.is_none(), "{:?}", outcome.error.map(|error| error.to_string()));
    Flown { start, outcome, frames, answers: computer.camera_answers(), received: computer.received }
}

/// Returns the light of the middle one of the frames with these settings.
fn light_dn(flown: &Flown, exposure_s: f64, gain_db: f64) -> f64 {
    let has = |frame: &&Frame| {
        (frame.meta.exposure_s - exposure_s).abs() < 1e-9 && (frame.meta.gain_db - gain_db).abs() < 1e-9
    };
    let found: Vec<f64> = flown.frames.iter().filter(has).map(|frame| frame.light_dn).collect();
    assert!(found.len() > 1, "{} frames of {exposure_s} s and {gain_db} dB", found.len());
    found[found.len() / 2]
}

fn us(seconds: f64) -> u32 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a fraction of a second")]
    {
        (seconds * 1e6).round() as u32
    }
}

#[test]
fn light_follows_the_exposure_and_the_gain_that_the_bus_commands() {
    let bench = bright(4.0);
    let own_s = bench.camera.exposure.exposure_s;
    let half = us(own_s / 2.0);
    let flown = fly(
        &bench,
        &[
            (1.75, Said::Set(CameraKind::Exposure, 0, half)),
            (2.35, Said::Set(CameraKind::Gain, ALL_HEADS, 600)),
            (2.95, Said::Set(CameraKind::Report, 0, 1)),
        ],
    );
    assert_eq!(flown.answers, CameraAnswers { set: 3, ..CameraAnswers::default() });
    assert_eq!(flown.outcome.record.ledger.count(EventKind::CameraCommand), 2, "a report is nothing of the camera's");
    let (own, halved) = (light_dn(&flown, own_s, 0.0), light_dn(&flown, f64::from(half) * 1e-6, 0.0));
    let amplified = light_dn(&flown, f64::from(half) * 1e-6, 6.0);
    let near = |got: f64, wanted: f64| (got / wanted - 1.0).abs() < PROPORTION;
    assert!(near(halved / own, f64::from(half) * 1e-6 / own_s), "{own} DN, then {halved} DN");
    assert!(near(amplified / halved, 10.0_f64.powf(6.0 / 20.0)), "{halved} DN, then {amplified} DN");
    assert!(!near(halved / own, 1.0) && !near(amplified / halved, 1.0), "negative control: they differ");
    // CAMERA_STATUS: three pages for each frame after the request, and none before.
    let after = flown.frames.iter().filter(|frame| frame.meta.mid_exposure > flown.start + Span::from_s(2.95));
    let pages = 3 * after.count() as u64;
    assert!(flown.received.camera_pages.abs_diff(pages) <= 3, "{} for {pages}", flown.received.camera_pages);
    let last = flown.received.last_camera.unwrap().value;
    assert_eq!((last.head, last.page), (0, CameraPage::Trigger { delay_us: 0 }));
    // Negative control: without commands these effects are absent, and the frames before the first command are the
    // same bits.
    let quiet = fly(&bench, &[]);
    assert_eq!((quiet.answers, quiet.received.camera_pages), (CameraAnswers::default(), 0));
    let is_before = |frame: &&Frame| frame.meta.mid_exposure < flown.start + Span::from_s(1.7);
    let sums = |flown: &Flown| flown.frames.iter().filter(is_before).map(|frame| frame.sum).collect::<Vec<_>>();
    assert!(sums(&quiet).len() > 3 && sums(&quiet) == sums(&flown));
    assert!(quiet.frames.iter().all(|frame| near(frame.light_dn, own)));
}

#[test]
fn trigger_on_the_bus_starts_an_exposure_at_its_instant() {
    let said = [
        (1.75, Said::Set(CameraKind::Triggered, 0, 1)),
        (2.65, Said::Trigger(None)),
        (2.80, Said::Trigger(Some(3.02))),
    ];
    let flown = fly(&bright(4.0), &said);
    assert_eq!(flown.answers, CameraAnswers { set: 1, triggered: 2, ..CameraAnswers::default() });
    let late = flown.frames.iter().filter(|frame| frame.meta.mid_exposure > flown.start + Span::from_s(2.1));
    let starts: Vec<(&str, Span)> = late
        .map(|frame| {
            let half = Span::from_s(frame.meta.exposure_s / 2.0);
            (frame.meta.started_by, frame.meta.mid_exposure - half - flown.start)
        })
        .collect();
    let [("bus", at_once), ("bus", dated)] = starts[..] else { panic!("{starts:?}") };
    assert!(at_once >= Span::from_s(2.65) && at_once <= Span::from_s(2.65) + ON_THE_WAY, "{at_once:?}");
    assert!((dated.ns() - Span::from_s(3.02).ns()).abs() < CLOCK.ns(), "{dated:?}");
    // Negative control: without the second trigger there is one exposure fewer.
    let one = fly(&bright(4.0), &said[..2]);
    assert_eq!(one.frames.len() + 1, flown.frames.len());
}

#[test]
fn impossible_camera_command_is_answered_with_its_reason_and_changes_nothing() {
    let bench = bright(3.0);
    let wrong = [
        (Said::Set(CameraKind::Exposure, 0, u32::MAX), Refusal::CameraRange),
        (Said::Set(CameraKind::Gain, 0, 100_000), Refusal::CameraRange),
        (Said::Set(CameraKind::Exposure, 1, 20_000), Refusal::UnknownHead),
    ];
    let quiet = fly(&bench, &[]);
    for (said, reason) in wrong {
        let flown = fly(&bench, &[(1.75, said)]);
        let wanted = CameraAnswers { refused: 1, last_refusal: Some(reason), ..CameraAnswers::default() };
        assert_eq!(flown.answers, wanted);
        let count = |kind| flown.outcome.record.ledger.count(kind);
        assert_eq!((count(EventKind::CameraRefused), count(EventKind::CameraCommand)), (1, 0));
        let sums = |flown: &Flown| flown.frames.iter().map(|frame| frame.sum).collect::<Vec<_>>();
        assert_eq!(sums(&flown), sums(&quiet));
    }
    // Negative control: a value within the range is accepted, and its frames differ.
    let taken = fly(&bench, &[(1.75, Said::Set(CameraKind::Exposure, 0, 20_000))]);
    assert_eq!(taken.answers, CameraAnswers { set: 1, ..CameraAnswers::default() });
    assert_ne!(taken.frames.last().unwrap().sum, quiet.frames.last().unwrap().sum);
}
