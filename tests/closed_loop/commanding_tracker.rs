//! Tests the internal tracker's camera commands: windows around its stars, an exposure time by their signal.

use crate::pixels::scenario;
use config::{Plant, Scenario, TrackerCommands};
use frames::sink::{NullSink, SentFrame};
use run::wiring::{run_end::RunEnd, stepped::SteppedRun};
use testbed::acs::Mode;

/// Largest difference of the pointing on windows from that on whole frames, as a share of it.
const SAME_POINTING: f64 = 0.1;

/// Facts about one frame.
#[derive(Debug, Clone, Copy)]
struct Seen {
    at_s: f64,
    exposure_s: f64,
    windows: usize,
    window_share: f64,
}

/// Runs a scenario to its end; returns also the exposures of its first head.
fn fly(scenario: &Scenario) -> (RunEnd, Mode, Vec<Seen>) {
    let mut seen = Vec::new();
    let mut going = SteppedRun::new(scenario, |_| Box::new(NullSink::new())).unwrap();
    let zero = going.times().zero;
    let mut look = |_: usize, frame: &mut SentFrame, _: &run::runtime::RunRecord| {
        let (meta, size_px) = (&frame.meta, [frame.image.width(), frame.image.height()]);
        let window_share = meta.regions.pixels(size_px) as f64 / frame.image.pixels().len() as f64;
        let (at_s, windows) = ((meta.mid_exposure - zero).s(), meta.regions.as_slice().len());
        seen.push(Seen { at_s, exposure_s: meta.exposure_s, windows, window_share });
        true
    };
    going.run_to_end(&mut look).unwrap();
    let mode = going.with_vehicle(|vehicle| vehicle.mode()).unwrap();
    (going.end(None), mode, seen)
}

fn commanding(mut scenario: Scenario, commands: TrackerCommands) -> Scenario {
    let Plant::Vehicle(vehicle) = &mut scenario.plant else { panic!("a scenario with a spacecraft") };
    vehicle.tracker_commands = commands;
    scenario
}

fn with_stars(mut scenario: Scenario, stars: usize) -> Scenario {
    let Plant::Vehicle(vehicle) = &mut scenario.plant else { panic!("a scenario with a spacecraft") };
    vehicle.tracker_stars = stars;
    scenario
}

const WINDOWS: TrackerCommands = TrackerCommands { windows: true, exposure: false };
const EXPOSURE: TrackerCommands = TrackerCommands { windows: true, exposure: true };

/// Returns rms pointing errors: of the boresight, and about it.
fn pointing_arcsec(end: &RunEnd) -> [f64; 2] {
    let errors = end.assessment.pointing();
    [errors.boresight_arcsec.unwrap(), errors.roll_arcsec.unwrap()]
}

/// Returns the largest difference of these from others, as a share of them.
fn farthest(got: [f64; 2], wanted: [f64; 2]) -> f64 {
    let shares = got.iter().zip(wanted).map(|(got, wanted)| (got / wanted - 1.0).abs());
    shares.fold(0.0, f64::max)
}

/// Tests that the pointing on windows is that on whole frames.
#[test]
fn windows_alone_close_the_loop_with_the_pointing_of_whole_frames() {
    let acquisition = scenario("acquisition");
    let (whole, _, frames) = fly(&acquisition);
    assert!(frames.iter().all(|frame| frame.windows == 0), "control: no commands are sent");
    let (windows, mode, frames) = fly(&commanding(acquisition.clone(), WINDOWS));
    assert_eq!(mode, Mode::FinePointing);
    let last_whole_s = frames.iter().rev().find(|frame| frame.windows == 0).map_or(0.0, |frame| frame.at_s);
    let steady: Vec<&Seen> = frames.iter().filter(|frame| frame.at_s > 400.0).collect();
    let largest_share = steady.iter().map(|frame| frame.window_share).fold(0.0, f64::max);
    let [on_windows, on_whole] = [&windows, &whole].map(pointing_arcsec);
    println!(
        "pointing, boresight and roll: {on_windows:.3?} arcsec on windows, {on_whole:.3?} on whole frames; the last whole frame at {last_whole_s:.1} s, \
         windows have up to {:.1} % of the pixels",
        100.0 * largest_share
    );
    assert!(frames[0].windows == 0, "acquisition is on the whole image");
    assert!(steady.len() > 1500 && steady.iter().all(|frame| frame.windows > 8), "on windows alone");
    assert!(largest_share < 0.06, "{largest_share} of the pixels");
    assert!(farthest(on_windows, on_whole) < SAME_POINTING, "{on_windows:?} and {on_whole:?} arcsec");
    // Negative control: the comparison detects a tracker that measures fewer stars and therefore has a larger roll
    // error.
    let (few, _, _) = fly(&with_stars(commanding(acquisition, WINDOWS), 5));
    let few = pointing_arcsec(&few);
    assert!(farthest(few, on_whole) > SAME_POINTING, "control: {few:?} arcsec with five stars");
}

#[test]
fn the_exposure_follows_the_signal_of_the_stars() {
    /// Tolerance factor: the third-brightest star's highest pixel is within a quarter of its target; its pixel phase
    /// varies.
    const SAME_EXPOSURE: f64 = 1.6;
    let flown = |brighter: f64| {
        let mut small = commanding(scenario("campaign"), EXPOSURE);
        small.bench.timing.duration_s = 500.0;
        small.events.clear();
        small.bench.camera.radiometry.zero_magnitude_photons_per_s_m2 *= brighter;
        let (_, mode, frames) = fly(&small);
        let last = &frames[frames.len() - 200..];
        assert!(last.iter().all(|frame| frame.windows > 4), "tracking on windows");
        let mean_s = last.iter().map(|frame| frame.exposure_s).sum::<f64>() / last.len() as f64;
        let [least_s, most_s] = last.iter().fold([f64::INFINITY, 0.0], |[least, most], frame| {
            [least.min(frame.exposure_s), most.max(frame.exposure_s)]
        });
        println!("{brighter} times brighter: exposure {least_s:.4} to {most_s:.4} s, mean {mean_s:.4} s, {mode:?}");
        assert!(most_s / least_s < SAME_EXPOSURE, "it has settled: {least_s} to {most_s} s");
        mean_s
    };
    let [plain_s, bright_s] = [1.0, 4.0].map(flown);
    assert!((2.5..6.5).contains(&(plain_s / bright_s)), "a quarter of the time: {plain_s} s and {bright_s} s");
}
