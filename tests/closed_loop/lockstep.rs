//! Tests an external plant in lockstep: frames show the samples, bit for bit the same in batches of any size; old or
//! bad samples are refused; the built-in tracker sees the frames.

use base::axes::{Body, Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::{Document, Scenario};
use frames::sink::crc32::pixel_crc32;
use frames::sink::{FrameMeta, NullSink, SentFrame, Sink};
use glam::DVec3;
use run::runtime::{PlantAttitude, PlantSample, TrackerOutput};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::{runtime::ledger::EventKind, wiring::stepped::SteppedRun};
use sky::observer::BarycentricState;
use std::{collections::BTreeMap, path::Path};
use testbed::tracker::Outcome;

/// Tolerance: between samples 10 ms apart a constant rate is interpolated to rounding.
const SHOWN_ARCSEC: f64 = 1e-3;
/// Rate of the turn, rad/s, body axes.
const RATE_RAD_S: DVec3 = DVec3::new(0.004, -0.006, 0.002);

fn document(extra: &str) -> Document {
    let text = format!(
        "camera = \"../cameras/small_tracker.toml\"\n[plant]\nkind = \"outside\"\n{extra}\n\
         [timing]\nduration_s = 1.2\nframe_rate_hz = 10.0\n[attitude]\nstale_policy = \"blank\"\n\
         [render]\nbackend = \"cpu\"\n"
    );
    Document::from_text(&text, &Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/benches/lockstep_test.toml"))
}

fn scenario(extra: &str) -> Scenario {
    Scenario::from_document(&document(extra)).unwrap()
}

/// Assembles a run whose plant is the caller.
fn assembled(scenario: &Scenario) -> SteppedRun {
    let mut sink = |_: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
    let options = RunOptions { is_controlled: true, ..RunOptions::stepped(Outputs::Made(&mut sink)) };
    SteppedRun::of(Run::assemble(scenario, options).unwrap()).unwrap()
}

/// Returns the attitude of a turn at a constant rate, `t_s` after the first exposure.
fn turned(t_s: f64) -> Rotation<Body, Icrf> {
    Rotation::from_rotation_vector(DVec3::new(0.3, -1.1, 0.4)).rotated_by(RATE_RAD_S * t_s)
}

fn sample(zero: Tai, t_s: f64) -> PlantSample {
    let (body_from_icrf, acceleration_rad_s2) = (turned(t_s), DVec3::ZERO);
    let attitude = Some(PlantAttitude { body_from_icrf, rate_rad_s: RATE_RAD_S, acceleration_rad_s2 });
    PlantSample { attitude, ..PlantSample::at(zero + Span::from_s(t_s)) }
}

/// Returns samples every 10 ms from before the first exposure to after the last.
fn samples(zero: Tai) -> Vec<PlantSample> {
    (-10..140).map(|step| sample(zero, 0.01 * f64::from(step))).collect()
}

/// Results of a run.
#[derive(Debug, Clone, PartialEq)]
struct Flight {
    frames: Vec<(u32, FrameMeta)>,
    trackers: Vec<Option<TrackerOutput>>,
    /// Places by frame and star.
    places_px: BTreeMap<(u32, u64), [f64; 2]>,
    refused: u64,
}

impl Flight {
    fn crc32(&self) -> Vec<u32> {
        self.frames.iter().map(|(crc32, _)| *crc32).collect()
    }
}

/// Feeds a run in batches of this size, a batch as soon as the previous one is used up, and steps it in odd lengths.
fn fly(scenario: &Scenario, batch: usize, edit: impl Fn(Vec<PlantSample>) -> Vec<PlantSample>) -> Flight {
    let mut run = assembled(scenario);
    let (zero, end) = (run.times().zero, run.times().end);
    let all = edit(samples(zero));
    let mut batches = all.chunks(batch).peekable();
    let mut flight = Flight { frames: Vec::new(), trackers: Vec::new(), places_px: BTreeMap::new(), refused: 0 };
    let mut steps = [0.0137, 0.1, 0.000_3, 0.051].iter().cycle();
    while run.now() < end && !run.is_finished() {
        let mut until = (run.now() + Span::from_s(*steps.next().unwrap())).min(end);
        // Samples are sent before their instants, as late as possible.
        while let Some(next) = batches.next_if(|next| next[0].at <= until) {
            run.take_plant(next).unwrap();
        }
        until = until.max(run.now());
        let mut keep = |_: usize, frame: &mut SentFrame, _: &run::runtime::RunRecord| {
            flight.frames.push((pixel_crc32(&frame.image), frame.meta.clone()));
            let number = frame.meta.number;
            flight.places_px.extend(frame.truth.iter().map(|star| ((number, star.id.into()), [star.x_px, star.y_px])));
            true
        };
        run.advance_to(until, &mut keep).unwrap();
        if scenario.trackers.is_some() {
            flight.trackers.push(run.tracker_output(0).unwrap());
        }
    }
    flight.trackers.dedup();
    flight.refused = run.record().ledger.count(EventKind::SampleRefused);
    flight
}

fn error_arcsec(meta: &FrameMeta, wanted: Rotation<Sensor, Icrf>) -> f64 {
    let rendered = Rotation::<Sensor, Icrf>::from_wxyz(meta.attitude_wxyz, 1e-9).unwrap();
    rendered.rotation_vector_to(&wanted).length() / ARCSEC
}

#[test]
fn frames_show_what_was_sent_bit_for_bit_in_batches_of_any_size() {
    let scenario = scenario("");
    let (zero, mounting) = (assembled(&scenario).times().zero, scenario.bench.sensor_from_body);
    let one = fly(&scenario, 1, |samples| samples);
    assert_eq!((one.frames.len(), one.refused), (12, 0));
    for (_, meta) in &one.frames {
        let t_s = (meta.mid_exposure - zero).s();
        assert_eq!(meta.origin.name(), "interpolated");
        let error = error_arcsec(meta, mounting * turned(t_s));
        assert!(error < SHOWN_ARCSEC, "frame {}: {error} arcsec", meta.number);
        let conjugated = error_arcsec(meta, mounting * turned(t_s).inverse_as_attitude());
        assert!(conjugated > 1e4, "control: the conjugated quaternion is {conjugated} arcsec off");
    }
    for batch in [7, 1000] {
        assert_eq!(fly(&scenario, batch, |samples| samples), one, "batches of {batch}");
    }
    let moved = fly(&scenario, 7, |mut samples| {
        let attitude = samples[60].attitude.as_mut().unwrap();
        attitude.body_from_icrf = attitude.body_from_icrf.rotated_by(DVec3::X * 20.0 * ARCSEC);
        samples
    });
    let changed = one.crc32().iter().zip(moved.crc32()).filter(|(one, other)| **one != *other).count();
    assert!((1..12).contains(&changed), "control: a sample that is moved changes its frame: {changed}");
}

/// The conjugate of an attitude, as a typical user error.
trait Conjugate {
    fn inverse_as_attitude(&self) -> Self;
}

impl Conjugate for Rotation<Body, Icrf> {
    fn inverse_as_attitude(&self) -> Self {
        Rotation::from_quat(self.quat().conjugate())
    }
}

#[test]
fn an_old_or_bad_list_is_refused_counted_and_changes_nothing() {
    let scenario = scenario("");
    let mut run = assembled(&scenario);
    let zero = run.times().zero;
    run.take_plant(&samples(zero)[..40]).unwrap();
    run.advance_to(zero + Span::from_ms(300), &mut |_, _, _| true).unwrap();
    let before = run.plant_waiting();
    for (list, part) in [
        (vec![sample(zero, 0.5), sample(zero, 0.3)], "sample 1 of 2 (t_s 0.3, it is 0.3 s now)"),
        (vec![sample(zero, 0.1)], "an old attitude is never shown as a new one"),
        (vec![sample(zero, 0.5), sample(zero, 0.5)], "of this instant already"),
        (vec![PlantSample::at(zero + Span::from_ms(500))], "neither attitude nor jitter"),
    ] {
        let error = run.take_plant(&list).unwrap_err().to_string();
        assert!(error.contains(part), "{part}: {error}");
        assert_eq!(run.plant_waiting(), before, "nothing of the list is kept");
    }
    assert_eq!(run.record().ledger.count(EventKind::SampleRefused), 2 + 1 + 2 + 1);
    let mut origins = Vec::new();
    run.run_to_end(&mut |_, frame, _| {
        origins.push(frame.meta.origin.name());
        true
    })
    .unwrap();
    assert_eq!(origins.first(), Some(&"interpolated"), "{origins:?}");
    assert_eq!(origins.last(), Some(&"held"), "a sender that stops shows, and is an event: {origins:?}");
    assert!(run.record().ledger.count(EventKind::Blank) > 0, "by the bench's policy");
}

#[test]
fn a_plant_outside_needs_whoever_steps_the_run() {
    let outside = scenario("");
    let mut sink = |_: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
    let refused = |options: RunOptions<'_>| Run::assemble(&outside, options).err().map(|error| error.to_string());
    let alone = refused(RunOptions::stepped(Outputs::Made(&mut sink))).unwrap();
    assert!(alone.contains("slcan_tcp") && alone.contains("or --control ADDRESS"), "{alone}");
    let alone = refused(RunOptions::real(Outputs::Made(&mut sink))).unwrap();
    assert!(alone.contains("or --control ADDRESS"), "{alone}");
    let controlled = RunOptions { is_controlled: true, ..RunOptions::real(Outputs::Made(&mut sink)) };
    assert_eq!(refused(controlled), None);
    let mut inside = Scenario::from_document(&Document::built_in("benches/loopback.toml").unwrap()).unwrap();
    inside.bench.camera = outside.bench.camera.clone();
    let mut run = assembled(&inside);
    let zero = run.times().zero;
    let error = run.take_plant(&[sample(zero, 0.1)]).unwrap_err().to_string();
    assert!(error.contains("plant.kind = \"outside\""), "{error}");
}

#[test]
fn the_built_in_tracker_finds_the_attitude_that_was_sent() {
    let tracked = scenario("[plant.tracker]\ndelay_ms = 30.0");
    let flight = fly(&tracked, 7, |samples| samples);
    assert_eq!(flight.trackers[0], None, "before the first frame");
    let outputs: Vec<TrackerOutput> = flight.trackers.iter().copied().flatten().collect();
    let (zero, mounting) = (assembled(&tracked).times().zero, tracked.bench.sensor_from_body);
    let solved = outputs.iter().filter_map(|output| match output.outcome {
        Outcome::Solved(solution) => Some((output, solution)),
        Outcome::NoSolution(_) => None,
    });
    let mut seen = 0;
    for (output, solution) in solved {
        let t_s = (output.mid_exposure - zero).s();
        assert!((t_s - (0.1 * f64::from(output.frame) + 0.05)).abs() < 1e-9, "frame {} at {t_s} s", output.frame);
        let error = solution.sensor_from_icrf.rotation_vector_to(&(mounting * turned(t_s))).length() / ARCSEC;
        assert!(error < 200.0, "frame {}: {error} arcsec of 283 in a pixel", output.frame);
        let late = solution.sensor_from_icrf.rotation_vector_to(&(mounting * turned(t_s + 0.1))).length() / ARCSEC;
        assert!(late > 100.0, "control: a frame later it is {late} arcsec");
        seen += 1;
    }
    assert!(seen >= 8, "{seen} of 12 frames have an attitude: {outputs:?}");
    assert_eq!(fly(&tracked, 1000, |samples| samples).frames, flight.frames);
    let blind = assembled(&scenario("")).tracker_output(0).unwrap_err().to_string();
    assert!(blind.contains("[plant.tracker]"), "control: {blind}");
}

/// Returns the mean distance between the places of the stars that both runs have, px.
fn moved_px(one: &Flight, other: &Flight) -> f64 {
    let both = |(key, a): (&(u32, u64), &[f64; 2])| {
        other.places_px.get(key).map(|b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]))
    };
    let distances: Vec<f64> = one.places_px.iter().filter_map(both).collect();
    assert!(distances.len() > 100 && distances.len() * 10 > one.places_px.len() * 9, "{} stars", distances.len());
    distances.iter().sum::<f64>() / distances.len() as f64
}

#[test]
fn jitter_and_observer_move_the_stars_as_much_as_they_say() {
    let scenario = scenario("");
    let still = fly(&scenario, 7, |samples| samples);
    let pixel_arcsec = 283.0;
    let jitter = |angle_arcsec: f64| {
        fly(&scenario, 7, move |mut samples| {
            samples.iter_mut().for_each(|sample| sample.jitter_rad = Some(DVec3::X * angle_arcsec * ARCSEC));
            samples
        })
    };
    assert!(moved_px(&still, &jitter(0.0)) < 1e-9, "control: jitter of no size");
    let jittered_px = moved_px(&still, &jitter(0.5 * pixel_arcsec));
    assert!((jittered_px - 0.5).abs() < 0.03, "{jittered_px} px for half a pixel about x");
    // Between two observers 15 km/s apart there are 10 arcsec of aberration at right angles.
    let observer = |speed_km_s: f64| {
        fly(&scenario, 7, move |mut samples| {
            let velocity_km_s = DVec3::Y * speed_km_s;
            let first = samples[0].at;
            for sample in &mut samples {
                let position_km = DVec3::X * 7000.0 + velocity_km_s * (sample.at - first).s();
                sample.observer = Some(BarycentricState { position_km, velocity_km_s });
            }
            samples
        })
    };
    let boresight = scenario.bench.sensor_from_body * turned(0.5);
    let along = boresight.inverse().apply(DVec3::Z);
    let sine = (DVec3::Y - along * along.dot(DVec3::Y)).length();
    let wanted_px = 15.0 / 299_792.458 * sine / (pixel_arcsec * ARCSEC);
    let (slow, fast) = (observer(-7.5), observer(7.5));
    let aberrated_px = moved_px(&slow, &fast);
    assert!((aberrated_px / wanted_px - 1.0).abs() < 0.1, "{aberrated_px} px, wanted {wanted_px}");
    assert_eq!(moved_px(&slow, &observer(-7.5)), 0.0, "control: the same states");
    assert_eq!((slow.refused, fast.refused), (0, 0));
}
