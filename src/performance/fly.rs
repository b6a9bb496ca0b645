//! A case of a plan -> frames with their truth, and the log of the tracker under test.
//!
//! Every case is a run on the virtual clock whose plant is outside: this file is the plant. The same plan gives the
//! same frames. The built-in tracker sees pixels and time tags, and is lost in space again at each attitude; a program
//! outside gets the folder of images.

use crate::attitude_error::{attitude_error, turned};
use crate::case_folder::{CASE, CaseFile, LOG};
use crate::plan::{Plan, PlanCase, Source, folder_name};
use crate::provenance::FileHash;
use anyhow::{Context, Result, bail};
use base::axes::Rotation;
use base::time::{Span, Tai};
use config::{Camera, Document, Scenario, Setting};
use frames::sink::{Recorder, RecorderOptions, SentFrame, Sink, SinkError, SinkSummary};
use glam::{DQuat, DVec3};
use run::runtime::{PlantAttitude, PlantSample, RunRecord};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::stepped::SteppedRun;
use run::wiring::vehicle_parts::{exposed_light, tracker_params};
use stars::catalog::Catalog;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use testbed::tracker::{Exposed, GuideStars, Outcome, StarNoise, Tracker, TrackerParams, earth_beta};
use testbed::tracker_model::{ModelParams, NoiseMethod, TrackerModel};

/// From the edges of an exposure to the samples of attitude around it, at most, s.
const MARGIN_S: f64 = 0.02;
/// Fastest turn from one attitude to the next, rad/s: receivers take no faster one.
const FASTEST_RAD_S: f64 = 15.0;
/// Farthest that a frame may be from its attitude, rad: 0.2 arcsec.
const MOST_OFF_RAD: f64 = 1e-6;
/// Frames whose samples of attitude are handed over at once.
const FRAMES_AHEAD: usize = 5_000;

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

/// A tracker inside, made once for a plan.
struct Inside {
    eyes: InsideEyes,
    delay: Span,
    tag_error: Span,
}

enum InsideEyes {
    /// The built-in one, with its guide stars.
    Pixels(Box<TrackerParams>, Arc<GuideStars>),
    /// A statistical one, with the stars that its noise follows.
    Model(Box<ModelParams>, Option<StarNoise>),
}

/// Flies the cases of a plan.
pub struct Flight<'a> {
    plan: &'a Plan,
    camera_path: PathBuf,
    plan_folder: PathBuf,
    out: PathBuf,
    pixel_rad: f64,
    inside: Option<Inside>,
    /// Images are kept after the program outside has seen them.
    pub keeps_images: bool,
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
        // Its attitude comes after the readout and its own time.
        let delay = Span::from_s(camera.exposure.readout_s + plan.tracker.delay_ms * 1e-3);
        let tag_error = Span::from_s(plan.tracker.tag_error_ms * 1e-3);
        let eyes = match (plan.tracker.source, &plan.tracker.model) {
            (Source::BuiltIn, _) => {
                let params = tracker_params(&camera, plan.tracker.stars);
                let guide = Arc::new(GuideStars::new(&Catalog::built_in()?, &params, plan.start()?)?);
                Some(InsideEyes::Pixels(Box::new(params), guide))
            }
            (Source::Model, Some(figures)) => {
                let field_rad = pixel_rad * f64::from(camera.detector.width_px);
                let params = figures.params(field_rad, pixel_rad);
                let stars = match params.noise_method {
                    NoiseMethod::Even => None,
                    NoiseMethod::Stars => {
                        let tracker = tracker_params(&camera, params.stars as usize);
                        let guide = Arc::new(GuideStars::new(&Catalog::built_in()?, &tracker, plan.start()?)?);
                        Some(StarNoise::new(&tracker, guide, &exposed_light(&camera, &tracker)))
                    }
                };
                Some(InsideEyes::Model(Box::new(params), stars))
            }
            (Source::Model, None) | (Source::Program, _) => None,
        };
        let inside = eyes.map(|eyes| Inside { eyes, delay, tag_error });
        let [camera_path, plan_folder] =
            [camera_path.as_path(), plan_folder].map(|path| std::path::absolute(path).unwrap_or_else(|_| path.into()));
        Ok(Self { plan, camera_path, plan_folder, out: out.into(), pixel_rad, inside, keeps_images: false })
    }

    /// Flies one case.
    ///
    /// # Errors
    /// With what could not be done.
    pub fn fly(&self, case: &PlanCase, (name, value): (&str, Option<f64>), number: u64) -> Result<Flown> {
        let folder = self.out.join(folder_name(name));
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let attitudes =
            case.attitudes.list(self.plan.seed.wrapping_add(number), self.pixel_rad, self.plan.start()?, value)?;
        let frames = attitudes.len() as u64 * u64::from(case.frames);
        let frames_in_run = u32::try_from(frames).context("frames of a case")?;
        let rate_hz = case.frame_rate_hz.unwrap_or(self.plan.frame_rate_hz);
        let text = self.run_file(name, rate_hz, frames_in_run, number);
        let scenario = self.scenario(&text, &folder, case, value)?;
        self.describe(&folder, case, name, value)?;
        let log = folder.join(LOG);
        let is_seen_outside = self.plan.tracker.source == Source::Program;
        let options = RecorderOptions { fits: is_seen_outside, truth: false, png_every: 0, ser: false };
        let recorder = Recorder::create(&folder, options)?;
        let written = self.draw(&scenario, recorder, (case, value), &attitudes)?;
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

    fn scenario(&self, text: &str, folder: &Path, case: &PlanCase, value: Option<f64>) -> Result<Scenario> {
        let path = folder.join("run.toml");
        let changed = self.plan.set.iter().cloned().chain(case.settings(value));
        let settings = changed.map(|text| Setting::parse(&text)).collect::<Result<Vec<_>, _>>()?;
        let remarks = self.plan.set.iter().cloned().chain(case.settings(value)).fold(String::new(), |mut all, set| {
            let _ = writeln!(all, "# --set '{set}'"); // writing to a string does not fail
            all
        });
        std::fs::write(&path, format!("{remarks}{text}")).with_context(|| path.display().to_string())?;
        Ok(Scenario::from_document(&Document::from_text(text, &path).with_settings(settings))?)
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
        let file = CaseFile { name: name.into(), purpose: case.purpose, conditions, frames_per_attitude: case.frames };
        let path = folder.join(CASE);
        std::fs::write(&path, serde_json::to_string_pretty(&file)?).with_context(|| path.display().to_string())
    }

    /// Draws all frames; returns the log of the built-in tracker.
    fn draw(
        &self,
        scenario: &Scenario,
        recorder: Recorder,
        (case, value): (&PlanCase, Option<f64>),
        attitudes: &[DQuat],
    ) -> Result<Option<String>> {
        let mut made = Some(recorder);
        let mut sink = |_: usize| match made.take() {
            Some(recorder) => Box::new(recorder) as Box<dyn Sink>,
            None => Box::new(Unused),
        };
        let options = RunOptions::stepped(Outputs::Made(&mut sink));
        let mut run = SteppedRun::of(Run::assemble(scenario, RunOptions { is_controlled: true, ..options })?)?;
        let noise_seed = scenario.bench.noise_seed();
        let mut log = self.inside.as_ref().map(|inside| TrackerLog::new(inside, case.frames, (noise_seed, run.zero())));
        let (zero, period, motion) = (run.zero(), run.frame_period(), case.motion(value));
        let exposure_s = scenario.bench.camera.exposure.exposure_s;
        let poses: Vec<Pose> = poses(attitudes, case.frames, period, motion);
        check_jumps(attitudes, period, exposure_s)?;
        let mut failure = None;
        for (part, some) in poses.chunks(FRAMES_AHEAD).enumerate() {
            let first = part * FRAMES_AHEAD;
            let start = |number: usize| zero + Span::from_ns(period.ns() * (first + number) as i64);
            let samples: Vec<PlantSample> =
                some.iter().enumerate().flat_map(|(i, pose)| pose.samples(start(i), exposure_s, period)).collect();
            run.take_plant(&samples)?;
            let until = if first + some.len() == poses.len() { run.end_at() } else { start(some.len()) };
            let mut on_frame = |_: usize, frame: &mut SentFrame, _: &RunRecord| {
                let taken =
                    check_attitude(frame, &poses).and_then(|()| log.as_mut().map_or(Ok(()), |log| log.take(frame)));
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

    fn ask_program(&self, folder: &Path, log: &Path) -> Result<()> {
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.into()).display().to_string();
        let places =
            [("{frames}", absolute(folder)), ("{log}", absolute(log)), ("{camera}", absolute(&self.camera_path))];
        let word = |word: &String| places.iter().fold(word.clone(), |word, (name, path)| word.replace(name, path));
        let mut words = self.plan.tracker.command.iter().map(word);
        let program = words.next().context("tracker.command: got nothing, wanted a program")?;
        let mut command = Command::new(&program);
        command.args(words).current_dir(&self.plan_folder);
        let status = command.status().with_context(|| format!("tracker.command: cannot start {program}"))?;
        if !status.success() {
            bail!("tracker.command: {program} ended with {status}; wanted 0");
        }
        if !log.exists() {
            bail!("tracker.command: {program} wrote no {}", log.display());
        }
        Ok(())
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
fn check_attitude(frame: &SentFrame, poses: &[Pose]) -> Result<()> {
    let Some(pose) = poses.get(frame.meta.number as usize) else { return Ok(()) };
    let half_s = 0.5 * frame.meta.exposure_s;
    let wanted = turned(pose.attitude, pose.rate_rad_s * half_s + pose.acceleration_rad_s2 * (0.5 * half_s * half_s));
    let [w, x, y, z] = frame.meta.attitude_wxyz;
    let off_rad = attitude_error(DQuat::from_xyzw(x, y, z, w), wanted).length();
    // Not so (also where it is not a number): held, stale or predicted.
    let is_there = off_rad < MOST_OFF_RAD;
    if !is_there {
        bail!("frame {}: drawn {off_rad:.3e} rad off its attitude ({})", frame.meta.number, frame.meta.origin);
    }
    Ok(())
}

fn margin_s(period: Span, exposure_s: f64) -> f64 {
    MARGIN_S.min(0.2 * (period.s() - exposure_s).max(0.0))
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
        if path.extension().is_some_and(|ending| ending == "fits") {
            std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}

/// The attitude at the start of a frame's period, and its motion.
#[derive(Debug, Clone, Copy)]
struct Pose {
    attitude: DQuat,
    rate_rad_s: DVec3,
    acceleration_rad_s2: DVec3,
}

/// The poses of all frames: at each attitude the motion begins afresh.
fn poses(attitudes: &[DQuat], frames: u32, period: Span, [rate, acceleration]: [DVec3; 2]) -> Vec<Pose> {
    let of_frame = |attitude: DQuat, number: u32| {
        let t_s = f64::from(number) * period.s();
        let attitude = turned(attitude, rate * t_s + acceleration * (0.5 * t_s * t_s));
        Pose { attitude, rate_rad_s: rate + acceleration * t_s, acceleration_rad_s2: acceleration }
    };
    attitudes.iter().flat_map(|attitude| (0..frames).map(move |number| of_frame(*attitude, number))).collect()
}

impl Pose {
    /// Samples around an exposure that begins at `start`, where the pose is.
    fn samples(&self, start: Tai, exposure_s: f64, period: Span) -> impl Iterator<Item = PlantSample> + use<> {
        let margin_s = margin_s(period, exposure_s);
        let pose = *self;
        [-margin_s, 0.5 * exposure_s, exposure_s + margin_s].into_iter().map(move |t_s| {
            let turn = pose.rate_rad_s * t_s + pose.acceleration_rad_s2 * (0.5 * t_s * t_s);
            let attitude = PlantAttitude {
                body_from_icrf: Rotation::from_quat(turned(pose.attitude, turn)),
                rate_rad_s: pose.rate_rad_s + pose.acceleration_rad_s2 * t_s,
                acceleration_rad_s2: pose.acceleration_rad_s2,
            };
            PlantSample { attitude: Some(attitude), ..PlantSample::at(start + Span::from_s(t_s)) }
        })
    }
}

/// A tracker inside and its log.
struct TrackerLog {
    eyes: Eyes,
    delay: Span,
    tag_error: Span,
    frames_per_attitude: u32,
    last_group: Option<u32>,
    text: String,
}

enum Eyes {
    Pixels(Box<Tracker>),
    Model(Box<TrackerModel>),
}

impl TrackerLog {
    fn new(inside: &Inside, frames_per_attitude: u32, (seed, start): (u64, Tai)) -> Self {
        let eyes = match &inside.eyes {
            InsideEyes::Pixels(params, guide) => Eyes::Pixels(Box::new(Tracker::new(**params, Arc::clone(guide)))),
            InsideEyes::Model(params, stars) => {
                Eyes::Model(Box::new(TrackerModel::new(**params, stars.clone(), seed, start)))
            }
        };
        let text = "frame,tai_ns,q_w,q_x,q_y,q_z,latency_ms,stars,why\n".to_owned();
        Self { eyes, delay: inside.delay, tag_error: inside.tag_error, frames_per_attitude, last_group: None, text }
    }

    fn take(&mut self, frame: &SentFrame) -> Result<()> {
        let meta = &frame.meta;
        let group = meta.number / self.frames_per_attitude;
        let begins = self.last_group != Some(group);
        self.last_group = Some(group);
        let outcome = match &mut self.eyes {
            Eyes::Pixels(tracker) => {
                if begins {
                    tracker.forget();
                }
                tracker.expose(&Exposed { exposure_s: meta.exposure_s, regions: meta.regions });
                tracker.measure(&frame.image, meta.mid_exposure, earth_beta(meta.mid_exposure), None)
            }
            Eyes::Model(model) => {
                if begins {
                    model.forget();
                }
                let [w, x, y, z] = meta.attitude_wxyz;
                let rate_rad_s = DVec3::from_array(meta.rate_deg_s.map(f64::to_radians));
                let truth = Rotation::from_quat(DQuat::from_xyzw(x, y, z, w));
                model.measure(meta.number, meta.mid_exposure, &truth, rate_rad_s)
            }
        };
        match outcome {
            Outcome::Solved(solution) => {
                let [w, x, y, z] = solution.sensor_from_icrf.wxyz();
                let latency_ms = (0.5 * meta.exposure_s) * 1e3 + self.delay.ms() - self.tag_error.ms();
                let (number, at_ns, stars) = (meta.number, (solution.at + self.tag_error).ns(), solution.stars);
                writeln!(self.text, "{number},{at_ns},{w:.15},{x:.15},{y:.15},{z:.15},{latency_ms},{stars},")?;
            }
            Outcome::NoSolution(reason) => {
                writeln!(self.text, "{},{},,,,,,,{reason}", meta.number, meta.mid_exposure.ns())?;
            }
        }
        Ok(())
    }
}
