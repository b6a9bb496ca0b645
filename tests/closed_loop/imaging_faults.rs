//! Tests faults of optics, light and frames: every frame reports the faults it was made under, and shows them.

use crate::pixels::{fly_real, scenario};
use base::time::Span;
use config::{Action, Event, Scenario};
use frames::sink::{
    FaultFlags, FaultPixels, FrameFault, FrameMeta, ImageFault, SendingFault, SentFrame, Sink, SinkError, SinkSummary,
    TruthKind, TruthStar,
};
use run::{runtime::EventKind, wiring::run_end::RunEnd, wiring::stepped::SteppedRun};
use std::sync::{Arc, Mutex};
use testbed::acs::Mode;

/// Facts about a frame that are stored.
struct Seen {
    meta: FrameMeta,
    truth: Vec<TruthStar>,
    mean_dn: f64,
    largest_dn: u16,
}

/// A sink that stores the facts about its frames.
#[derive(Clone, Default)]
struct Keeper(Arc<Mutex<Vec<Seen>>>);

impl Sink for Keeper {
    fn name(&self) -> &'static str {
        "keeper"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let pixels = frame.image.pixels();
        let mean_dn = pixels.iter().map(|dn| f64::from(*dn)).sum::<f64>() / pixels.len() as f64;
        let largest_dn = pixels.iter().copied().max().unwrap_or(0);
        self.0.lock().unwrap().push(Seen { meta: frame.meta.clone(), truth: frame.truth.clone(), mean_dn, largest_dn });
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let frames = self.0.lock().unwrap().len() as u64;
        Ok(SinkSummary { sink: "keeper", frames, refused: 0, bytes: 0, run_crc32: 0, output: None })
    }
}

/// Flies a scenario; returns its frames, the mode at the end and the outcome.
fn fly(scenario: &Scenario) -> (Vec<Seen>, Mode, RunEnd) {
    let keeper = Keeper::default();
    let mut going = SteppedRun::new(scenario, |_| Box::new(keeper.clone())).unwrap();
    going.run_to_end(&mut |_, _, _| true).unwrap();
    let mode = going.with_vehicle(|vehicle| vehicle.mode()).unwrap();
    let outcome = going.end(None);
    let seen = core::mem::take(&mut *keeper.0.lock().unwrap());
    (seen, mode, outcome)
}

/// Start and end in seconds, name and number of every fault of the scenario, written by hand; frames are 0.5 s apart
/// and exposed for 0.1 s.
const FAULTS: [(f64, f64, &str, u16); 11] = [
    (150.0, 170.0, "false_stars", 1),
    (180.0, 200.0, "frame_bit_flip", 2),
    (210.0, 240.0, "stray_light_ramp", 3),
    (250.0, 270.0, "defocus_step", 4),
    (280.0, 300.0, "contamination", 5),
    (310.0, 325.0, "temperature_step", 6),
    (335.0, 350.0, "missing_stars", 7),
    (355.0, 365.0, "missing_bright_stars", 8),
    (375.0, 395.0, "saturation", 9),
    (405.0, 415.0, "hot_pixels", 10),
    (418.0, 428.0, "proton_storm", 11),
];

#[test]
fn every_frame_names_its_faults_and_shows_them() {
    let scenario = scenario("imaging_faults");
    let (seen, mode, outcome) = fly(&scenario);
    assert_eq!(outcome.assessment.violations().1, Vec::<String>::new());
    assert_eq!((mode, seen.len()), (Mode::FinePointing, 960));
    for seen in &seen {
        // The exposure's end decides.
        let end_s = 0.5 * f64::from(seen.meta.number) + 0.1;
        let active = seen.meta.active.named().iter().map(|fault| (fault.name, fault.number)).collect::<Vec<_>>();
        let wanted = FAULTS.iter().filter(|(from_s, until_s, ..)| *from_s <= end_s && end_s < *until_s);
        let wanted: Vec<_> = wanted.map(|(_, _, name, number)| (*name, *number)).collect();
        // Numbers are those of the run's list, in which faults that wait for a trigger come first.
        assert_eq!(active, wanted, "frame {} that ends at {end_s} s", seen.meta.number);
        assert_eq!(seen.meta.faults.is_empty(), wanted.is_empty(), "frame {}", seen.meta.number);
    }
    let at = |s: f64| &seen[(2.0 * s) as usize];
    check_light(&at);
    check_sources(&at);
    let faults: Vec<_> = outcome.faults.iter().map(|fault| (fault.name, fault.hits)).collect();
    let frames =
        |name: &str| seen.iter().filter(|seen| seen.meta.active.named().iter().any(|f| f.name == name)).count();
    assert_eq!(faults.len(), FAULTS.len());
    assert!(faults.iter().all(|(name, hits)| *hits == frames(name) as u64 && *hits > 0), "{faults:?}");
    let count = |kind| outcome.record.ledger.count(kind);
    assert_eq!((count(EventKind::Fault), count(EventKind::FaultOver)), (11, 11), "begin and end of each");
}

/// Checks that the stray light, dark current, flood and defocus are in the pixels.
fn check_light<'a>(at: &impl Fn(f64) -> &'a Seen) {
    let quiet = at(205.0).mean_dn;
    let gain = 25.1;
    // Half of the ramp: 5e4 e-/s for 0.1 s, through the PRNU's mean of one.
    let half = at(225.0);
    assert!((half.meta.active.named()[0].amount.value / 5.0e4 - 1.0).abs() < 0.01, "{}", half.meta.active);
    let rise_dn = half.mean_dn - quiet;
    let wanted_dn = half.meta.active.named()[0].amount.value * 0.1 / gain;
    assert!((rise_dn / wanted_dn - 1.0).abs() < 0.01, "{rise_dn} DN for {wanted_dn}");
    // Eight times 190 e-/s: seven of them are additional. The mean of 65536 pixels is known to 0.01 DN.
    let warm_dn = at(315.0).mean_dn - at(305.0).mean_dn;
    assert!((warm_dn - 7.0 * 190.0 * 0.1 / gain).abs() < 0.1, "{warm_dn} DN warmer");
    assert!(at(380.0).mean_dn > 4050.0, "flooded: {}", at(380.0).mean_dn);
    let [sharp_dn, wide_dn] = [245.0, 260.0].map(|s| f64::from(at(s).largest_dn) - 100.0);
    // The brightest star fills its pixel when it is sharp.
    assert!(wide_dn < 0.8 * sharp_dn, "wider spots: {wide_dn} DN for {sharp_dn}");
    // The same light, plus the light that sharp stars lose above the converter's range: of each at most one pixel's.
    let gained_dn = at(260.0).mean_dn - at(245.0).mean_dn;
    let unshown_e: f64 = at(245.0).truth.iter().map(|star| (star.electrons - 3995.0 * gain).max(0.0)).sum();
    let unshown_dn = unshown_e / gain / 65_536.0;
    assert!((-0.05..unshown_dn + 0.05).contains(&gained_dn), "{gained_dn} DN more, of at most {unshown_dn}");
    // Forty of 65536 pixels with 5000 e- more.
    let leak_dn = at(410.0).mean_dn - at(403.0).mean_dn;
    assert!((leak_dn - 40.0 * 5e3 / gain / 65_536.0).abs() < 0.05, "{leak_dn} DN of hot pixels");
    assert!((at(416.0).mean_dn - at(403.0).mean_dn).abs() < 0.05, "and none afterwards");
    // Each of 20 bits contributes 2048 DN, either way.
    assert!(at(190.0).largest_dn >= 2048 && at(190.0).mean_dn - quiet > 0.2, "{}", at(190.0).mean_dn - quiet);
}

/// Checks that false, missing and dimmed stars are in the truth.
fn check_sources<'a>(at: &impl Fn(f64) -> &'a Seen) {
    let kinds = |seen: &Seen, kind| seen.truth.iter().filter(|row| row.kind == kind).count();
    let (before, with) = (at(145.0), at(160.0));
    assert_eq!((kinds(before, TruthKind::FalseStar), kinds(with, TruthKind::FalseStar)), (0, 30));
    assert!(with.meta.faults.contains(FaultFlags::FALSE_STARS));
    // 100 per cm2 and s from all sides on 3.4 cm2 for 0.1 s: 17 on average.
    let tracks = kinds(at(423.0), TruthKind::ProtonTrack);
    assert!((3..=40).contains(&tracks) && kinds(at(430.0), TruthKind::ProtonTrack) == 0, "{tracks} tracks");
    let stars = kinds(before, TruthKind::Star);
    assert!(stars.abs_diff(kinds(with, TruthKind::Star)) <= 2, "the others are where they were");
    let brightest = |seen: &Seen| {
        let mut rows: Vec<_> = seen.truth.iter().filter(|row| row.kind == TruthKind::Star).collect();
        rows.sort_by(|a, b| b.electrons.total_cmp(&a.electrons));
        rows.iter().map(|row| (row.id, row.electrons)).collect::<Vec<_>>()
    };
    let all = brightest(at(330.0));
    let missing = brightest(at(360.0));
    assert!(all[..5].iter().all(|(id, _)| missing.iter().all(|(other, _)| other != id)), "the five are gone");
    assert_eq!(missing[0].0, all[5].0, "and the sixth is not");
    let fewer = brightest(at(340.0)).len() as f64 / all.len() as f64;
    assert!((0.6..0.95).contains(&fewer), "{fewer} of the stars are left");
    // A quarter of the time: 0.9 - 0.25 * 0.5.
    let dirty = at(285.0);
    let share = dirty.meta.active.named()[0].amount.value;
    assert!((share - 0.775).abs() < 0.005, "{share}");
    let of = |seen: &Seen| brightest(seen).into_iter().find(|(id, _)| *id == all[0].0).unwrap().1;
    assert!((of(dirty) / of(at(275.0)) / share - 1.0).abs() < 1e-6, "{}", of(dirty) / of(at(275.0)));
}

fn event(at_s: f64, for_s: f64, fault: FrameFault) -> Event {
    let action = Action::Frame { head: None, fault };
    Event { at: Span::from_s(at_s), on_trigger: None, lasts: Span::from_s(for_s), action }
}

#[test]
fn fault_waiting_for_a_trigger_does_not_start_without_it() {
    let mut scenario = scenario("imaging_faults");
    scenario.bench.timing.duration_s = 20.0;
    scenario.events = vec![Event { on_trigger: Some(4), ..event(1.0, 3.0, FrameFault::Image(ImageFault::Blank)) }];
    let (seen, _, outcome) = fly(&scenario);
    assert!(seen.iter().all(|seen| seen.meta.active.count() == 0));
    assert!(outcome.faults[0].from_s.is_infinite() && outcome.faults[0].hits == 0, "{:?}", outcome.faults);
    assert_eq!(outcome.assessment.violations().1, Vec::<String>::new(), "a fault that never came need not hit");
    // Fired twice during the run: each acts one second later.
    let keeper = Keeper::default();
    let mut going = SteppedRun::new(&scenario, |_| Box::new(keeper.clone())).unwrap();
    let zero = going.times().zero;
    for at_s in [3.0, 12.0] {
        going.advance_to(zero + Span::from_s(at_s), &mut |_, _, _| true).unwrap();
        let fire =
            Event { action: Action::Trigger { number: 4 }, ..event(at_s, 0.0, FrameFault::Image(ImageFault::Blank)) };
        going.inject(&Event { lasts: Span::ZERO, ..fire }).unwrap();
    }
    going.run_to_end(&mut |_, _, _| true).unwrap();
    let outcome = going.end(None);
    let seen = core::mem::take(&mut *keeper.0.lock().unwrap());
    let hit: Vec<u32> = seen.iter().filter(|s| s.meta.active.count() == 1).map(|s| s.meta.number).collect();
    assert_eq!(hit, [8, 9, 10, 11, 12, 13, 26, 27, 28, 29, 30, 31], "from 4 and from 13 s, for 3 s");
    let count = |kind| outcome.record.ledger.count(kind);
    assert_eq!((count(EventKind::Fault), count(EventKind::FaultOver)), (2, 2));
}

/// Tests that frames behind a late one wait for it, as on the real clock: a recorder refuses frames out of order.
#[test]
fn no_frame_overtakes_a_late_one() {
    let mut scenario = scenario("imaging_faults");
    scenario.bench.timing.duration_s = 10.0;
    // Frames are 0.5 s apart: the last late one comes after the next two would have gone out.
    scenario.events = vec![event(3.0, 2.0, FrameFault::Sending(SendingFault::Late(Span::from_ms(1_200))))];
    let (seen, _, outcome) = fly(&scenario);
    let numbers: Vec<u32> = seen.iter().map(|seen| seen.meta.number).collect();
    assert_eq!(numbers, (0..20).collect::<Vec<_>>(), "in their order");
    let late = seen.iter().filter(|seen| seen.meta.faults.contains(FaultFlags::FRAME_LATE)).count();
    assert_eq!((late, outcome.faults[0].hits), (4, 4), "control: only the frames of the fault are marked");
}

#[test]
fn a_pixel_beyond_the_detector_is_refused_with_its_size() {
    let mut scenario = scenario("imaging_faults");
    let pixels = FaultPixels { at: Some([256, 3]), random: 0 };
    scenario.events = vec![event(1.0, 3.0, FrameFault::Image(ImageFault::FalseStars { pixels, mag: 3.0 }))];
    let Err(error) = SteppedRun::new(&scenario, |_| Box::new(Keeper::default())) else { panic!("refused") };
    let error = error.to_string();
    assert!(error.contains("false_stars") && error.contains("256 x 256"), "{error}");
}

#[test]
fn frames_are_spoilt_on_the_real_clock_too() {
    let mut scenario = scenario("imaging_faults");
    scenario.bench.timing.duration_s = 4.0;
    let pixels = FaultPixels { at: Some([7, 8]), random: 0 };
    scenario.events = vec![
        event(0.9, 0.5, FrameFault::Sending(SendingFault::Drop)),
        event(1.4, 1.0, FrameFault::Image(ImageFault::Saturation { full_wells: 3.0 })),
        event(2.4, 0.5, FrameFault::Sending(SendingFault::Late(Span::from_ms(40)))),
        event(2.9, 0.5, FrameFault::Image(ImageFault::FalseStars { pixels, mag: 2.0 })),
    ];
    let keeper = Keeper::default();
    let mut sink = |_| Box::new(keeper.clone()) as Box<dyn Sink>;
    let outcome = fly_real(&scenario, &mut sink, Box::new(|_| {}), &mut |_, _, _| {});
    let seen = core::mem::take(&mut *keeper.0.lock().unwrap());
    let by_number = |number: u32| seen.iter().find(|seen| seen.meta.number == number);
    // A busy machine may hold or lose frames, and reports it: only frames that came in time are checked.
    let own = |number: u32| by_number(number).filter(|s| !s.meta.faults.contains(FaultFlags::FRAME_DUPLICATE));
    assert!(own(2).is_none(), "withheld: its exposure ends at 1.1 s");
    for number in [3, 4] {
        if let Some(flooded) = own(number) {
            assert!(flooded.mean_dn > 4050.0 && flooded.meta.faults.contains(FaultFlags::SATURATION));
        }
    }
    if let Some(late) = own(5) {
        assert!(late.meta.faults.contains(FaultFlags::FRAME_LATE), "{}", late.meta.faults);
    }
    if let Some(with) = own(6) {
        assert_eq!(with.meta.active.to_string(), "false_stars#4=2 mag");
    }
    let hits: Vec<_> = outcome.faults.iter().map(|fault| (fault.name, fault.hits)).collect();
    println!("{hits:?}, {} frames came", seen.len());
    let frames = &outcome.record.frames;
    assert_eq!(frames.delivered + frames.dropped, frames.scheduled, "{frames:?}");
}
