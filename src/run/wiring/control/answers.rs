//! Answers to each request: times in seconds after the first exposure, angles in deg or rad as named.
//!
//! [`answer`] is the one table of requests, for both clocks; [`Controlled`] is what it needs of a run. Answers of one
//! clock only are in `stepped` and `steered`.
//!
//! Files that a control client requests: below the run's output folder, and never over an existing one.
//!
//! Each part of the path is opened from the one before without following links, and the file is created, not opened: so
//! neither `..`, nor a link, nor a file that appears meanwhile leads elsewhere. Tests: below.

use crate::runtime::{Ledger, exposing::Exposing};
use crate::wiring::control::protocol::{PROTOCOL_VERSION, REQUESTS, Request, StepBy};
use crate::wiring::{assessment::mode_name, control::samples::SampleList, error::LoopError, far_side::FarSide};
use base::axes::{Body, Icrf, Rotation, Sensor, ra_dec_roll};
use base::time::{Span, Tai};
use config::{Event, Scenario};
use frames::report::RunNumbers;
use rustix::fs::{AtFlags, Mode, OFlags, open, openat, unlinkat};
use serde_json::{Map, Value, json};
use std::io::{BufWriter, Write};
use std::path::{Component, Path};
use std::{ffi::OsStr, fs::File, io, os::fd::OwnedFd};
use testbed::tracker::{Mode as TrackerMode, Outcome, Solution};
use testbed::vehicle::{HeadReport, Vehicle};

/// The instants of a run under way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instants {
    pub(super) zero: Tai,
    pub(super) now: Tai,
    pub(super) end: Tai,
}

impl Instants {
    /// Returns seconds after the first exposure.
    pub(super) fn s(&self, at: Tai) -> f64 {
        (at - self.zero).s()
    }

    pub(super) fn now_s(&self) -> f64 {
        self.s(self.now)
    }

    /// Returns the time of a request, which may name none: then it is now.
    pub(super) fn at(&self, at_s: Option<f64>) -> Tai {
        at_s.map_or(self.now, |at_s| self.zero + Span::from_s(at_s))
    }
}

/// An answer, or why there is none.
pub(super) type Answer<T = Value> = Result<T, Refusal>;

/// A run as its client sees it, on either clock.
pub(super) trait Controlled {
    /// Name of its clock.
    const CLOCK: &'static str;

    /// Returns the scenario of the run.
    fn scenario(&self) -> &Scenario;

    /// Returns true when a client that has been silent for `waited` is not waited for any longer.
    fn is_over(&self, waited: Span) -> bool;

    /// Returns true when the session ends although its client goes on.
    fn is_interrupted(&self) -> bool {
        false
    }

    /// Returns true when the session may end without `finish` as with it.
    fn is_whole(&self) -> bool {
        false
    }

    /// Waits until the run has begun.
    fn await_begin(&self) {}

    /// Returns the instants of the run.
    fn instants(&self) -> Answer<Instants>;

    /// Returns instants and counts so far, and whether the run has ended.
    fn so_far(&self) -> Answer<(Instants, RunNumbers, bool)>;

    /// Acts on the far end of the cable, between two of its steps.
    fn on_far_side<T: Send + 'static>(&mut self, act: impl FnOnce(&mut FarSide) -> T + Send + 'static) -> Answer<T>;

    /// Acts on the exposures of a head, between two of its slots.
    fn on_exposing<T: Send + 'static>(
        &mut self,
        head: usize,
        act: impl FnOnce(&mut Exposing, &mut Ledger) -> T + Send + 'static,
    ) -> Answer<T>;

    /// Adds an event; returns when it begins, s.
    fn inject(&mut self, event: &Event) -> Answer<f64>;

    /// Fires a trigger.
    fn fire(&mut self, number: u16, at: Option<Tai>) -> Answer<()>;

    /// Queues samples of an external plant.
    fn take_samples(&mut self, samples: &SampleList) -> Answer;

    /// Counts a list of samples that could not be read.
    fn note_bad_samples(&mut self) -> Answer<()>;

    /// Returns the newest frame of a head.
    fn frame(&self, head: usize, path: Option<&str>, pixels: bool) -> Answer;

    /// Returns the attitude that frames are drawn with according to an external plant; `None` where the true one is
    /// known here.
    fn received_truth(&self, _at_s: Option<f64>) -> Option<Answer> {
        None
    }

    /// Advances the clock.
    fn step(&mut self, _by: StepBy) -> Answer {
        Err(refuse("the real clock cannot be held: ask for state, or run with --clock virtual to step"))
    }

    /// Returns the output of a head's built-in tracker for the newest frame that it has processed.
    fn tracker(&self, _head: usize) -> Answer {
        Err(refuse("the real clock goes on meanwhile: ask for estimate, or run with --clock virtual"))
    }

    /// Returns the report so far.
    fn summary(&mut self) -> Answer {
        Err(refuse("the report is made when the run ends: ask for state, or send finish"))
    }
}

/// Reason why a request is not executed.
pub(super) enum Refusal {
    /// Something is wrong with the request; the session goes on.
    Request(String),
    /// The loop failed.
    Loop(LoopError),
}

impl From<String> for Refusal {
    fn from(why: String) -> Self {
        Self::Request(why)
    }
}

impl From<LoopError> for Refusal {
    fn from(error: LoopError) -> Self {
        Self::Request(error.to_string())
    }
}

fn refuse(why: &str) -> Refusal {
    Refusal::Request(why.into())
}

/// Answers one request.
pub(super) fn answer(request: Request, run: &mut impl Controlled) -> Answer {
    match request {
        Request::Hello { .. } => hello(run),
        Request::State => state(run),
        Request::Step(by) => run.step(by),
        Request::Inject(keys) => inject(&keys, run),
        Request::Trigger { number, at_s } => trigger(number, at_s, run),
        Request::Truth { at_s } => truth(at_s, run),
        Request::Estimate => {
            let (mounting, instants) = (run.scenario().bench.sensor_from_body, run.instants()?);
            run.on_far_side(move |far| estimate(far.vehicle(), mounting, &instants))
        }
        Request::Frame { head, path, pixels } => run.frame(head, path.as_deref(), pixels),
        Request::React(reaction) => {
            let Instants { zero, now, .. } = run.instants()?;
            Ok(run.on_far_side(move |far| {
                let vehicle = far.vehicle_mut().ok_or_else(|| LoopError::NothingFlown.to_string())?;
                reaction.act(vehicle, zero, now)
            })??)
        }
        Request::Tracker { head } => run.tracker(head),
        Request::Camera(camera) => {
            let Instants { zero, now, .. } = run.instants()?;
            Ok(run.on_exposing(camera.head, move |exposing, ledger| camera.act(exposing, ledger, zero, now))??)
        }
        Request::BadSamples(why) => run.note_bad_samples().and(Err(Refusal::Request(why))),
        Request::Plant(samples) => run.take_samples(&samples),
        Request::Summary => run.summary(),
        Request::Finish => Ok(Value::Null),
    }
}

/// Returns the answer to hello: scenario, protocol and clock of the run.
pub(super) fn hello<R: Controlled>(run: &R) -> Answer {
    run.await_begin();
    let (scenario, instants) = (run.scenario(), run.instants()?);
    let (camera, timing) = (&scenario.bench.camera, &scenario.bench.timing);
    let sensor_px = [camera.detector.width_px, camera.detector.height_px].map(|side| side as usize);
    let [width, height] = camera.detector.params.spatial.output(sensor_px).size_px;
    Ok(json!({
        "protocol": PROTOCOL_VERSION,
        "scenario": scenario.name,
        "clock": R::CLOCK,
        "seed": scenario.bench.seed,
        "zero_utc": instants.zero.to_rfc3339(),
        "now_s": instants.now_s(),
        "duration_s": instants.s(instants.end),
        "frames": timing.frames(),
        "frame_rate_hz": timing.frame_rate_hz,
        "camera": camera.name,
        "width": width,
        "height": height,
        "heads": scenario.bench.head_count(),
        "requests": REQUESTS.map(|(name, _)| name),
    }))
}

/// Returns counts so far, and the mode of the flight computer if a spacecraft is flown.
fn state(run: &mut impl Controlled) -> Answer {
    let (instants, numbers, is_finished) = run.so_far()?;
    // A run on the real clock that is over has no far end any more.
    let mode = match run.on_far_side(|far| far.vehicle().map(Vehicle::mode)) {
        Err(why) if !is_finished => return Err(why),
        mode => mode.ok().flatten(),
    };
    let frames = numbers.frames;
    let events: Map<String, Value> = numbers
        .events
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| (name.into(), count.into()))
        .collect();
    Ok(json!({
        "now_s": instants.now_s(),
        "finished": is_finished,
        "verdict": numbers.word,
        "mode": mode.map(mode_name),
        "frames": {
            "scheduled": frames.scheduled,
            "rendered": frames.rendered,
            "delivered": frames.delivered,
            "late": frames.late,
            "held": frames.held,
            "dropped": frames.dropped,
            "blank": frames.blank,
        },
        "events": events,
    }))
}

fn inject(keys: &Map<String, Value>, run: &mut impl Controlled) -> Answer {
    let now_s = run.instants()?.now_s();
    let frame_period = Span::from_s(1.0 / run.scenario().bench.timing.frame_rate_hz);
    let event = Event::from_json(keys, now_s, frame_period).map_err(|error| error.to_string())?;
    let from_s = run.inject(&event)?;
    Ok(json!({ "event": event.action.word(), "from_s": from_s, "for_s": event.lasts.s() }))
}

/// Fires a trigger; the events in the report show whether the stimulator accepts it.
fn trigger(number: u16, at_s: Option<f64>, run: &mut impl Controlled) -> Answer {
    let instants = run.instants()?;
    run.fire(number, at_s.map(|_| instants.at(at_s)))?;
    Ok(json!({ "number": number, "at_s": at_s.unwrap_or_else(|| instants.now_s()) }))
}

/// Returns the attitude of the first head: the true one where it is known here.
fn truth(at_s: Option<f64>, run: &mut impl Controlled) -> Answer {
    if let Some(received) = run.received_truth(at_s) {
        return received;
    }
    let (mounting, instants) = (run.scenario().bench.sensor_from_body, run.instants()?);
    Ok(run.on_far_side(move |far| true_attitude(at_s, far.vehicle(), mounting, &instants))??)
}

/// Returns an attitude that a tracker has found.
pub(super) fn solved(solution: &Solution) -> Value {
    let mut answer = attitude(&solution.sensor_from_icrf);
    answer["stars"] = solution.stars.into();
    answer["residual_rms_px"] = solution.residual_rms_px.into();
    answer["found_by"] = match solution.mode {
        TrackerMode::LostInSpace => "lost_in_space".into(),
        TrackerMode::Tracking => "tracking".into(),
    };
    answer
}

/// Returns the true attitude of the first head, at most two seconds ago.
fn true_attitude(
    at_s: Option<f64>,
    vehicle: Option<&Vehicle>,
    mounting: Rotation<Sensor, Body>,
    instants: &Instants,
) -> Result<Value, String> {
    let vehicle = vehicle.ok_or("nothing is flown inside: its truth is with whoever flies it")?;
    let flown = vehicle.plant.flown_until().min(instants.now);
    let at = at_s.map_or(flown, |at_s| instants.zero + Span::from_s(at_s));
    if at > instants.now {
        let (asked, now_s) = (instants.s(at), instants.now_s());
        return Err(format!("at_s is {asked} s; wanted a time not after now, which is {now_s} s"));
    }
    let truth = vehicle.plant.flown_truth(at).map_err(|_| {
        let (asked, last) = (instants.s(at), instants.s(flown));
        format!("at_s is {asked}; wanted a time from {} to {last}: the last two seconds", last - 2.0)
    })?;
    let mut answer = attitude(&(mounting * truth.body_from_icrf));
    answer["at_s"] = instants.s(at).into();
    answer["body_rate_rad_s"] = truth.rate_rad_s.to_array().to_vec().into();
    answer["wheel_speeds_rad_s"] = vehicle.plant.wheel_speeds_rad_s().to_vec().into();
    Ok(answer)
}

/// Returns the estimate of the internal flight computer; an empty answer without one.
fn estimate(vehicle: Option<&Vehicle>, mounting: Rotation<Sensor, Body>, instants: &Instants) -> Value {
    let Some(vehicle) = vehicle else { return json!({}) };
    let heads: Vec<Value> = vehicle.heads.reports().map(|report| head(report, instants)).collect();
    let estimate = vehicle.estimate().map(|estimate| attitude(&(mounting * estimate)));
    json!({
        "at_s": instants.s(vehicle.estimate_at()),
        "estimate": estimate,
        "sigma_rad": vehicle.estimator.sigma_rad().to_array(),
        "mode": mode_name(vehicle.mode()),
        "heads": heads,
    })
}

/// Returns the last report of a tracker.
fn head(report: &HeadReport, instants: &Instants) -> Value {
    let mut answer = match report.last {
        None => json!({ "outcome": "no_frame_yet" }),
        Some(Outcome::NoSolution(reason)) => json!({ "outcome": "no_attitude", "reason": reason.to_string() }),
        Some(Outcome::Solved(solution)) => {
            let mut answer = solved(&solution);
            answer["outcome"] = "attitude".into();
            answer["at_s"] = instants.s(solution.at).into();
            answer
        }
    };
    answer["untagged_frames"] = report.untagged.into();
    answer["ignored_frames"] = report.ignored.into();
    answer
}

pub(super) fn attitude(sensor_from_icrf: &Rotation<Sensor, Icrf>) -> Value {
    let [ra_deg, dec_deg, roll_deg] = ra_dec_roll(sensor_from_icrf).map(f64::to_degrees);
    json!({
        "sensor_from_icrf": sensor_from_icrf.wxyz(),
        "ra_deg": ra_deg,
        "dec_deg": dec_deg,
        "roll_deg": roll_deg,
    })
}

/// Writes a new file below `folder` with `write`; returns its size in bytes. The file is removed if it cannot be
/// written.
pub(super) fn write_below(
    folder: Option<&Path>,
    relative: &str,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, String> {
    let folder = folder.ok_or_else(|| {
        format!("path is \"{relative}\", but this run has no output folder: start it with --out DIR, or leave path out")
    })?;
    let refuse = |why: &str| format!("path is \"{relative}\"; {why} (the output folder is {})", folder.display());
    let names = names(relative).ok_or_else(|| refuse("wanted a path relative to the output folder, without \"..\""))?;
    let (name, parents) = names.split_last().ok_or_else(|| refuse("wanted the name of a file"))?;
    let mut parent = open(folder, OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())
        .map_err(|error| refuse(&format!("the output folder cannot be opened: {error}")))?;
    for part in parents {
        let flags = OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let next = openat(&parent, *part, flags, Mode::empty());
        let why = |error| format!("wanted \"{}\" to be a folder, and no link: {error}", part.display());
        parent = next.map_err(|error| refuse(&why(error)))?;
    }
    let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let made = openat(&parent, *name, flags, Mode::from_raw_mode(0o644));
    let made =
        made.map_err(|error| refuse(&format!("wanted a file that can be made and does not exist yet: {error}")))?;
    written(made, write).map_err(|error| {
        let _it_may_be_gone_already = unlinkat(&parent, *name, AtFlags::empty());
        refuse(&format!("it cannot be written: {error}"))
    })
}

/// Returns the parts of a relative path; `None` if it leads upwards or starts at the root.
fn names(relative: &str) -> Option<Vec<&OsStr>> {
    let parts = Path::new(relative).components().filter(|part| *part != Component::CurDir);
    parts.map(|part| if let Component::Normal(name) = part { Some(name) } else { None }).collect()
}

fn written(made: OwnedFd, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<u64> {
    let mut out = BufWriter::new(File::from(made));
    write(&mut out)?;
    out.flush()?;
    Ok(out.get_ref().metadata()?.len())
}

#[cfg(test)]
mod output_tests {
    use super::*;
    use std::fs;

    fn write(folder: &Path, relative: &str) -> Result<u64, String> {
        write_below(Some(folder), relative, |out| out.write_all(b"frame"))
    }

    #[test]
    fn a_new_file_below_the_folder_is_written() {
        let base = tempfile::tempdir().unwrap();
        fs::create_dir(base.path().join("sub")).unwrap();
        for path in ["a.fits", "sub/b.fits", "./sub/c.fits"] {
            assert_eq!(write(base.path(), path), Ok(5), "{path}");
            assert_eq!(fs::read(base.path().join(path)).unwrap(), b"frame");
        }
    }

    #[test]
    fn path_outside_the_folder_is_refused() {
        let base = tempfile::tempdir().unwrap();
        let (out, elsewhere) = (base.path().join("out"), base.path().join("elsewhere"));
        fs::create_dir(&out).unwrap();
        fs::create_dir(&elsewhere).unwrap();
        std::os::unix::fs::symlink(&elsewhere, out.join("link")).unwrap();
        std::os::unix::fs::symlink(elsewhere.join("planted"), out.join("dangling")).unwrap();
        let absolute = elsewhere.join("a").display().to_string();
        for (path, part) in [
            ("../elsewhere/a", "without \"..\""),
            ("sub/../../elsewhere/a", "without \"..\""),
            (absolute.as_str(), "relative to the output folder"),
            ("link/a", "no link"),
            ("dangling", "does not exist yet"),
            (".", "the name of a file"),
            ("no/folder", "to be a folder"),
        ] {
            let error = write(&out, path).unwrap_err();
            assert!(error.contains(part) && error.contains(path), "{path}: {error}");
        }
        assert_eq!(fs::read_dir(&elsewhere).unwrap().count(), 0, "nothing was written elsewhere");
    }

    #[test]
    fn an_existing_file_is_kept_and_one_that_cannot_be_written_is_removed() {
        let base = tempfile::tempdir().unwrap();
        fs::write(base.path().join("mine"), "precious").unwrap();
        assert!(write(base.path(), "mine").unwrap_err().contains("does not exist yet"));
        assert_eq!(fs::read(base.path().join("mine")).unwrap(), b"precious");
        let full = write_below(Some(base.path()), "half", |_| Err(io::ErrorKind::StorageFull.into()));
        assert!(full.unwrap_err().contains("cannot be written"));
        assert!(!base.path().join("half").exists());
    }

    #[test]
    fn a_run_without_an_output_folder_writes_nothing() {
        let error = write_below(None, "a.fits", |_| Ok(())).unwrap_err();
        assert!(error.contains("--out DIR"), "{error}");
    }
}
