//! A case of a plan -> frames with their truth, and the log of the tracker under test.
//!
//! Every case is a run on the virtual clock whose plant is outside: this file is the plant. The same plan gives the
//! same frames. The built-in tracker sees pixels and time tags, and is lost in space again at each attitude; a program
//! outside gets the folder of images.

use crate::attitudes::{BrightBodies, Circumstances};
use crate::case_folder::{CASE, CaseFile, LOG};
use crate::images::{ImageForm, LinearScale, WithImages};
use crate::log::read_log;
use crate::plan::{Plan, PlanCase, Source, folder_name};
use crate::poses::{MARGIN_S, Pose, before_samples, margin_s, poses};
use crate::tracker_inside::{Inside, TrackerLog};
use crate::{metric::refuse_all, noise::SINE, provenance::FileHash, record::attitude_error};
use anyhow::{Context, Result, bail};
use base::time::Span;
use config::{Camera, Document, Scenario, Setting};
use frames::sink::{Recorder, RecorderOptions, SentFrame, Sink, SinkError, SinkSummary};
use glam::DQuat;
use run::runtime::{PlantSample, RunRecord};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::stepped::SteppedRun;
use std::path::{Path, PathBuf};
use std::{collections::BTreeMap, fmt::Write as _, process::Command};

/// Fastest turn from one attitude to the next, rad/s: receivers take no faster one.
const FASTEST_RAD_S: f64 = 15.0;
/// Farthest that a frame may be from its attitude, rad: 0.2 arcsec.
const MOST_OFF_RAD: f64 = 1e-6;
/// Frames whose samples of attitude are handed over at once.
const FRAMES_AHEAD: usize = 2_000;

/// A flown case.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    /// Its folder, below that of the plan.
    pub folder: String,
    /// Its run file.
    pub run_file: FileHash,
    /// Frames.
    pub frames: u64,
}

/// Flies the cases of a plan.
pub struct Flight<'a> {
    plan: &'a Plan,
    camera_path: PathBuf,
    /// The camera's name.
    pub camera_name: String,
    plan_folder: PathBuf,
    out: PathBuf,
    pixel_rad: f64,
    inside: Option<Inside>,
    /// Images are kept after the program outside has seen them.
    pub keeps_images: bool,
    /// Images that a program outside gets beside FITS.
    pub images: Option<ImageForm>,
    usual_scale: LinearScale,
}

/// All that a case is flown with.
struct Prepared {
    text: String,
    scenario: Scenario,
    bodies: Option<BrightBodies>,
    attitudes: Vec<DQuat>,
    frames: u64,
}

impl<'a> Flight<'a> {
    /// Makes ready to fly a plan that is in `plan_folder`, into the folder `out`.
    ///
    /// # Errors
    /// When the camera cannot be read, or the tracker cannot be made for it.
    pub fn new(plan: &'a Plan, plan_folder: &Path, out: &Path) -> Result<Self> {
        let camera_path = plan_folder.join(&plan.camera);
        let camera = Camera::from_document(&Document::open(&camera_path)?)?;
        let pixel_rad = camera.detector.pixel_pitch_um * 1e-3 / camera.optics.focal_length_mm;
        let inside = Inside::of_plan(plan, &camera, pixel_rad)?;
        // A plan that is named without a folder is in the working directory.
        let plan_folder = if plan_folder == Path::new("") { Path::new(".") } else { plan_folder };
        let [camera_path, plan_folder] =
            [camera_path.as_path(), plan_folder].map(|path| std::path::absolute(path).unwrap_or_else(|_| path.into()));
        let usual_scale = LinearScale::of_camera(&camera);
        let camera_name = camera.name;
        Ok(Self {
            plan,
            camera_path,
            camera_name,
            plan_folder,
            out: out.into(),
            pixel_rad,
            inside,
            keeps_images: false,
            images: None,
            usual_scale,
        })
    }

    /// Asks for images beside FITS, on the camera's usual scale where the form says none.
    ///
    /// # Errors
    /// When no program outside would see them.
    pub fn give_images(&mut self, form: ImageForm) -> Result<()> {
        if self.plan.tracker.source != Source::Program {
            bail!("--images: wanted a program under test: tracker.command of the plan, or --tracker-command");
        }
        self.images = Some(form.settled(self.usual_scale));
        Ok(())
    }

    /// Checks the wanted cases without flying them and without writing anything.
    ///
    /// # Errors
    /// With all that is wrong with any of them.
    pub fn check(&self, is_wanted: &dyn Fn(&str) -> bool) -> Result<()> {
        let mut errors: Vec<anyhow::Error> = self.check_program().err().into_iter().collect();
        let cases = (1_u64..).zip(self.plan.each());
        for (number, (case, (name, value))) in cases.filter(|(_, (_, (name, _)))| is_wanted(name)) {
            let prepared = self.prepare(case, (&name, value), number);
            errors.extend(prepared.err().map(|error| error.context(format!("case \"{name}\""))));
        }
        refuse_all(&errors)
    }

    /// Flies one case. What an earlier flight that did not end has left of it is replaced.
    ///
    /// # Errors
    /// With what could not be done.
    pub fn fly(&self, case: &PlanCase, (name, value): (&str, Option<f64>), number: u64) -> Result<Flown> {
        let Prepared { text, scenario, bodies, attitudes, frames } = self.prepare(case, (name, value), number)?;
        let folder = self.out.join(folder_name(name));
        if folder.join(CASE).exists() {
            std::fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        self.keep_run_file(&text, &folder, case, value)?;
        self.describe(&folder, case, name, value)?;
        let log = folder.join(LOG);
        let is_seen_outside = self.plan.tracker.source == Source::Program;
        let options = RecorderOptions { fits: is_seen_outside, truth: false, png_every: 0, ser: false };
        let recorder = Recorder::create(&folder, options)?;
        let sink: Box<dyn Sink> = match self.images {
            Some(form) => Box::new(WithImages::new(recorder, &folder, form)),
            None => Box::new(recorder),
        };
        let written = self.draw(&scenario, sink, (case, value), (&attitudes, bodies.as_ref()))?;
        if let Some(written) = written {
            std::fs::write(&log, written).with_context(|| log.display().to_string())?;
        }
        if is_seen_outside {
            self.ask_program(&folder, &log)?;
            if !self.keeps_images {
                remove_images(&folder)?;
            }
        }
        let run_file = FileHash::of_text(&format!("{}/run.toml", folder_name(name)), &text);
        Ok(Flown { folder: folder_name(name), run_file, frames })
    }

    /// Returns all that a case is flown with, checked.
    fn prepare(&self, case: &PlanCase, (name, value): (&str, Option<f64>), number: u64) -> Result<Prepared> {
        let frames = u64::from(case.attitudes.count()) * u64::from(case.frames);
        let frames_in_run = u32::try_from(frames).context("frames of a case")?;
        let rate_hz = case.frame_rate_hz.unwrap_or(self.plan.frame_rate_hz);
        let text = self.run_file(name, rate_hz, frames_in_run, number);
        let scenario = self.scenario((name, &text), case, value)?;
        let bodies = self.bodies(&scenario, case, f64::from(case.frames) / rate_hz)?;
        let attitudes = case.attitudes.list(&Circumstances {
            seed: self.plan.seed.wrapping_add(number),
            pixel_rad: self.pixel_rad,
            at: self.plan.start()?,
            value,
            bodies: bodies.as_ref(),
        })?;
        let period = Span::from_s(1.0 / scenario.bench.timing.frame_rate_hz);
        check_jumps(&attitudes, period, scenario.bench.camera.exposure.exposure_s)?;
        Ok(Prepared { text, scenario, bodies, attitudes, frames })
    }

    /// Moon and Earth of a case that is about them, or whose tracker is blinded by the Earth.
    fn bodies(&self, scenario: &Scenario, case: &PlanCase, each_s: f64) -> Result<Option<BrightBodies>> {
        let is_needed =
            case.attitudes.is_about_moon_or_earth() || self.inside.as_ref().is_some_and(Inside::looks_for_earth);
        is_needed.then(|| BrightBodies::of_run(scenario, each_s)).transpose()
    }

    /// The run file of a case.
    fn run_file(&self, name: &str, rate_hz: f64, frames: u32, number: u64) -> String {
        let duration_s = f64::from(frames) / rate_hz;
        let quoted = |text: &str| toml::Value::String(text.into()).to_string();
        let camera = quoted(&self.camera_path.display().to_string());
        let noise_seed = self.plan.seed.wrapping_mul(1_000_003).wrapping_add(number) & i64::MAX.cast_unsigned();
        format!(
            "name = {}\ncamera = {camera}\nseed = {}\nnoise_seed = {noise_seed}\n\n[plant]\nkind = \"outside\"\n\n[timing]\n\
             frame_rate_hz = {rate_hz:?}\nduration_s = {duration_s:?}\nstart_utc = {}\n\n[attitude]\nstale_policy = \"blank\"\n\n\
             [render]\nbackend = \"cpu\"\n",
            quoted(name),
            self.plan.seed,
            quoted(&self.plan.start_utc),
        )
    }

    /// Values that are changed in the run file of a case.
    fn changed(&self, case: &PlanCase, value: Option<f64>) -> impl Iterator<Item = String> {
        self.plan.set.iter().cloned().chain(case.settings(value))
    }

    fn scenario(&self, (name, text): (&str, &str), case: &PlanCase, value: Option<f64>) -> Result<Scenario> {
        let settings = self.changed(case, value).map(|text| Setting::parse(&text)).collect::<Result<Vec<_>, _>>()?;
        let document = Document::from_text(text, &self.out.join(folder_name(name)).join("run.toml"));
        Ok(Scenario::from_document(&document.with_settings(settings))?)
    }

    fn keep_run_file(&self, text: &str, folder: &Path, case: &PlanCase, value: Option<f64>) -> Result<()> {
        let remarks = self.changed(case, value).fold(String::new(), |mut all, set| {
            let _ = writeln!(all, "# --set '{set}'"); // writing to a string does not fail
            all
        });
        let path = folder.join("run.toml");
        std::fs::write(&path, format!("{remarks}{text}")).with_context(|| path.display().to_string())
    }

    fn describe(&self, folder: &Path, case: &PlanCase, name: &str, value: Option<f64>) -> Result<()> {
        let [rate, acceleration] = case.motion(value);
        let mut conditions = BTreeMap::new();
        conditions.insert("frame_rate_hz".into(), case.frame_rate_hz.unwrap_or(self.plan.frame_rate_hz));
        conditions.insert("total_rate_deg_s".into(), rate.length().to_degrees());
        conditions.insert("total_acceleration_deg_s2".into(), acceleration.length().to_degrees());
        if let (Some(sweep), Some(value)) = (&case.sweep, value) {
            conditions.insert(sweep.key.clone(), value);
        }
        if let (Some(key), Some(angle)) = (case.attitudes.angle_key(), value) {
            conditions.insert(key.into(), angle);
        }
        if let Some(sine) = case.sine(value) {
            conditions.insert(SINE.into(), sine.hz);
        }
        let file = CaseFile {
            name: name.into(),
            purpose: case.purpose,
            conditions,
            frames_per_attitude: case.frames,
            mounting_drift: case.mounting_drift,
        };
        let path = folder.join(CASE);
        std::fs::write(&path, serde_json::to_string_pretty(&file)?).with_context(|| path.display().to_string())
    }

    /// Draws all frames; returns the log of the built-in tracker.
    fn draw(
        &self,
        scenario: &Scenario,
        to_tracker: Box<dyn Sink>,
        (case, value): (&PlanCase, Option<f64>),
        (attitudes, bodies): (&[DQuat], Option<&BrightBodies>),
    ) -> Result<Option<String>> {
        let mut made = Some(to_tracker);
        let mut sink = |_: usize| made.take().unwrap_or_else(|| Box::new(Unused));
        let options = RunOptions::stepped(Outputs::Made(&mut sink));
        let mut run = SteppedRun::of(Run::assemble(scenario, RunOptions { is_controlled: true, ..options })?)?;
        let noise_seed = scenario.bench.noise_seed();
        let (start, camera) = ((noise_seed, run.times().zero), &scenario.bench.camera);
        let mut log = self.inside.as_ref().map(|inside| TrackerLog::new(inside, case.frames, start, (camera, bodies)));
        let (zero, period) = (run.times().zero, Span::from_s(1.0 / scenario.bench.timing.frame_rate_hz));
        let exposure_s = scenario.bench.camera.exposure.exposure_s;
        let poses: Vec<Pose> = poses(attitudes, case.frames, period, &case.whole_motion(value));
        let mut failure = None;
        for (part, some) in poses.chunks(FRAMES_AHEAD).enumerate() {
            let first = part * FRAMES_AHEAD;
            let start = |number: usize| zero + Span::from_ns(period.ns() * (first + number) as i64);
            let samples: Vec<PlantSample> =
                some.iter().enumerate().flat_map(|(i, pose)| pose.samples(start(i), exposure_s, period)).collect();
            run.take_plant(&samples)?;
            let next = before_samples(start(some.len()), period, exposure_s);
            let until = if first + some.len() == poses.len() { run.times().end } else { next };
            let mut on_frame = |_: usize, frame: &mut SentFrame, _: &RunRecord| {
                let pose = poses.get(frame.meta.number as usize);
                let taken =
                    check_attitude(frame, pose).and_then(|()| log.as_mut().map_or(Ok(()), |log| log.take(frame, pose)));
                failure = failure.take().or(taken.err());
                failure.is_none()
            };
            run.advance_to(until, &mut on_frame)?;
            if first + some.len() == poses.len() && !run.is_finished() {
                run.run_to_end(&mut on_frame)?;
            }
        }
        let end = run.end(None);
        if let Some(error) = failure {
            return Err(error);
        }
        if let Some(error) = end.error {
            return Err(error.into());
        }
        Ok(log.map(|log| log.text))
    }

    /// Refuses a program that is not there.
    fn check_program(&self) -> Result<()> {
        let Some(program) = self.plan.tracker.command.first() else { return Ok(()) };
        let folders = std::env::var_os("PATH").unwrap_or_default();
        let is_there = if program.contains('/') {
            self.plan_folder.join(program).exists()
        } else {
            std::env::split_paths(&folders).any(|folder| folder.join(program).exists())
        };
        if is_there {
            return Ok(());
        }
        bail!(
            "tracker.command: cannot find the program {program}; wanted one on the PATH, or a path relative to {}",
            self.plan_folder.display()
        )
    }

    fn ask_program(&self, folder: &Path, log: &Path) -> Result<()> {
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.into()).display().to_string();
        let places =
            [("{frames}", absolute(folder)), ("{log}", absolute(log)), ("{camera}", absolute(&self.camera_path))];
        let word = |word: &String| places.iter().fold(word.clone(), |word, (name, path)| word.replace(name, path));
        let mut words = self.plan.tracker.command.iter().map(word);
        let program = words.next().context("tracker.command: got nothing, wanted a program")?;
        let mut command = Command::new(&program);
        command.args(words).current_dir(&self.plan_folder);
        let in_folder = || format!("tracker.command: cannot start {program} in {}", self.plan_folder.display());
        let status = command.status().with_context(in_folder)?;
        if !status.success() {
            bail!("tracker.command: {program} ended with {status}; wanted 0");
        }
        if !log.exists() {
            bail!("tracker.command: {program} wrote no {}", log.display());
        }
        // A log that cannot be read ends the flight at its first case.
        read_log(log, &self.plan.tracker.log_form()).map(drop)
    }
}

/// Refuses attitudes that the sensor cannot turn to between two frames: the frames after would show another one.
fn check_jumps(attitudes: &[DQuat], period: Span, exposure_s: f64) -> Result<()> {
    let turns = attitudes.windows(2).map(|pair| attitude_error(pair[1], pair[0]).length());
    let largest_rad = turns.fold(0.0, f64::max);
    let least_s = largest_rad / FASTEST_RAD_S;
    let between_s = period.s() - exposure_s - 2.0 * margin_s(period, exposure_s);
    if between_s < least_s {
        let most_hz = 1.0 / (exposure_s + 2.0 * MARGIN_S + least_s);
        bail!(
            "frame_rate_hz: got {:.4}, wanted at most {most_hz:.2}: the sensor turns by {:.1} deg from one attitude to the next",
            1.0 / period.s(),
            largest_rad.to_degrees()
        );
    }
    Ok(())
}

/// Refuses a frame that was not drawn at its attitude.
fn check_attitude(frame: &SentFrame, pose: Option<&Pose>) -> Result<()> {
    let Some(pose) = pose else { return Ok(()) };
    let wanted = pose.at(0.5 * frame.meta.exposure_s);
    let [w, x, y, z] = frame.meta.attitude_wxyz;
    let off_rad = attitude_error(DQuat::from_xyzw(x, y, z, w), wanted).length();
    // Not so (also where it is not a number): held, stale or predicted.
    let is_there = off_rad < MOST_OFF_RAD;
    if !is_there {
        bail!("frame {}: drawn {off_rad:.3e} rad off its attitude ({})", frame.meta.number, frame.meta.origin.name());
    }
    Ok(())
}

/// A place for frames of heads that a plan has not.
struct Unused;

impl Sink for Unused {
    fn name(&self) -> &'static str {
        "unused"
    }

    fn send(&mut self, _frame: &SentFrame) -> Result<(), SinkError> {
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        Ok(SinkSummary { sink: "unused", frames: 0, refused: 0, bytes: 0, run_crc32: 0, output: None })
    }
}

fn remove_images(folder: &Path) -> Result<()> {
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == "fits" || ending == "png") {
            std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}
