//! Rows of telemetry and frames as they come -> the results of a run, and whether its expectations and invariants are
//! met.
//!
//! Only sums are kept, so that a run of a hundred hours needs no more memory than one of a minute.

use crate::runtime::{EventKind, RunRecord};
use crate::wiring::invariants::Invariants;
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::{Expect, ExpectFrames};
use frames::report::{FrameEnd, RunLimits};
use frames::sink::crc32::Crc32;
use serde::Serialize;
use testbed::acs::{Mode, ModeEvent};
use testbed::vehicle::TelemetryRow;

/// Number of mode changes kept in full; further ones are only counted.
const MODE_EVENTS_KEPT: usize = 256;
/// Number of refused commands kept in words.
const REFUSALS_KEPT: usize = 32;

/// Mean square of a vector, by axes across and along the boresight.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Square {
    count: u64,
    across: f64,
    about: f64,
    largest: f64,
}

impl Square {
    /// Adds a rotation vector in axes whose z is the boresight.
    fn add(&mut self, v: glam::DVec3) {
        self.count += 1;
        self.across += v.x * v.x + v.y * v.y;
        self.about += v.z * v.z;
        self.largest = self.largest.max(v.truncate().length());
    }

    fn rms(&self, sum: f64) -> Option<f64> {
        (self.count > 0).then(|| (sum / self.count as f64).sqrt())
    }
}

/// Pointing or knowledge errors over the window, arcsec.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct WindowErrors {
    /// Rows in the window.
    pub rows: u64,
    /// Rms angle of the first head's boresight.
    pub boresight_arcsec: Option<f64>,
    /// Rms angle about the boresight.
    pub roll_arcsec: Option<f64>,
    /// Largest angle of the boresight.
    pub largest_boresight_arcsec: Option<f64>,
}

/// One mode change, for reports.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModeLine {
    /// Seconds after the first exposure.
    pub t_s: f64,
    /// Previous mode.
    pub from: &'static str,
    /// New mode.
    pub to: &'static str,
    /// Cause.
    pub cause: String,
}

/// One expectation and its result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// Name of the quantity that was checked.
    pub name: &'static str,
    /// Wanted value.
    pub wanted: String,
    /// Found value.
    pub got: String,
    /// True when it is met.
    pub passed: bool,
}

/// Sums over a run.
pub struct Assessment {
    expect: Expect,
    /// The time of the first exposure.
    pub zero: Tai,
    window_from: Tai,
    head_from_body: glam::DQuat,
    pointing: Square,
    knowledge: Square,
    telemetry_crc32: Crc32,
    rows: u64,
    first_fine: Option<Tai>,
    mode: Mode,
    mode_changes: u64,
    /// The mode changes so far (the first few).
    pub mode_lines: Vec<ModeLine>,
    last_boresight_rad: f64,
    /// Time at which pointing was last off target by more than the recovered angle.
    pub last_off: Tai,
    /// The smallest angle between the monitored boresight and the Sun, rad.
    pub least_sun_angle_rad: Option<f64>,
    solved_rows: u64,
    /// Sum of the tracker's variances in the window, and their count.
    tracker_variance: (f64, u64),
    /// Largest micro-vibration, rad, and the wheel speed at that time, rad/s.
    vibration: (f64, f64),
    /// The invariants so far.
    pub invariants: Invariants,
    refusals: Vec<String>,
    frames_held_to_truth: u64,
    /// The number of frames that could not be compared with the truth.
    pub frames_unchecked: u64,
    largest_rendered_rad: f64,
}

/// Returns the name of a mode in files.
pub fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Safe => "safe",
        Mode::RateDamping => "rate_damping",
        Mode::CoarsePointing => "coarse_pointing",
        Mode::FinePointing => "fine_pointing",
        Mode::Slew => "slew",
    }
}

impl Assessment {
    /// Returns an assessment of the last `expect.window_s` before `end`; `sensor_from_body` is the first head's
    /// mounting.
    pub fn new(expect: Expect, zero: Tai, end: Tai, sensor_from_body: glam::DQuat) -> Self {
        Self {
            zero,
            window_from: end - Span::from_s(expect.window_s),
            expect,
            head_from_body: sensor_from_body,
            pointing: Square::default(),
            knowledge: Square::default(),
            telemetry_crc32: Crc32::default(),
            rows: 0,
            first_fine: None,
            mode: Mode::RateDamping,
            mode_changes: 0,
            mode_lines: Vec::with_capacity(MODE_EVENTS_KEPT),
            last_boresight_rad: f64::INFINITY,
            last_off: zero,
            least_sun_angle_rad: None,
            solved_rows: 0,
            tracker_variance: (0.0, 0),
            vibration: (0.0, 0.0),
            invariants: Invariants::default(),
            refusals: Vec::new(),
            frames_held_to_truth: 0,
            frames_unchecked: 0,
            largest_rendered_rad: 0.0,
        }
    }

    /// Adds one row.
    pub fn take_row(&mut self, row: &TelemetryRow) {
        self.telemetry_crc32.update(&row.bytes());
        self.rows += 1;
        self.mode = row.mode;
        let sensor = self.head_from_body * row.pointing_error_rad;
        self.last_boresight_rad = sensor.truncate().length();
        if self.last_boresight_rad > self.expect.recovered_arcsec * ARCSEC {
            self.last_off = row.at;
        }
        if row.vibration_rad > self.vibration.0 {
            self.vibration = (row.vibration_rad, row.wheel_speed_rad_s);
        }
        self.solved_rows += u64::from(row.heads_solved > 0);
        self.least_sun_angle_rad = match (self.least_sun_angle_rad, row.sun_angle_rad) {
            (Some(least), Some(angle)) => Some(f64::min(least, angle)),
            (least, angle) => least.or(angle),
        };
        if row.at >= self.window_from {
            self.pointing.add(sensor);
            if let Some(sigma) = row.tracker_sigma_rad {
                self.tracker_variance = (self.tracker_variance.0 + sigma * sigma, self.tracker_variance.1 + 1);
            }
            if let Some(error) = row.knowledge_error_rad {
                self.knowledge.add(self.head_from_body * error);
            }
        }
    }

    /// Adds a mode change.
    pub fn take_mode(&mut self, event: &ModeEvent) {
        self.mode_changes += 1;
        if event.to == Mode::FinePointing {
            self.first_fine = self.first_fine.or(Some(event.at));
        }
        if self.mode_lines.len() < MODE_EVENTS_KEPT {
            self.mode_lines.push(ModeLine {
                t_s: (event.at - self.zero).s(),
                from: mode_name(event.from),
                to: mode_name(event.to),
                cause: format!("{:?}", event.cause),
            });
        }
    }

    /// Records the distance from the truth of a frame that claims to show it.
    pub fn note_rendered(&mut self, error_rad: f64) {
        self.frames_held_to_truth += 1;
        self.largest_rendered_rad = self.largest_rendered_rad.max(error_rad);
    }

    /// Records a frame whose truth is no longer available because it went out seconds late.
    pub fn note_unchecked(&mut self) {
        self.frames_unchecked += 1;
    }

    /// Returns the first expectation or invariant that is not met, in words.
    pub fn first_failure(&self, predicted_arcsec: Option<f64>, record: &RunRecord) -> Option<String> {
        let failed = self.verdicts(predicted_arcsec, record).into_iter().find(|verdict| !verdict.passed);
        let failed = failed.map(|verdict| format!("{}: wanted {}, got {}", verdict.name, verdict.wanted, verdict.got));
        failed.or_else(|| self.violations().1.first().cloned())
    }

    /// Returns the number of frames compared with the truth, and the largest distance from it, arcsec.
    pub fn rendered(&self) -> (u64, f64) {
        (self.frames_held_to_truth, self.largest_rendered_rad / ARCSEC)
    }

    /// Records a command that the flight computer refused.
    pub fn note_refusal(&mut self, why: &str) {
        if self.refusals.len() < REFUSALS_KEPT {
            self.refusals.push(why.into());
        }
    }

    /// Returns the commands that the flight computer refused.
    pub fn refusals(&self) -> &[String] {
        &self.refusals
    }

    /// Returns the violated invariants so far: their number, and the first few in words.
    pub fn violations(&self) -> (u64, &[String]) {
        self.invariants.violations()
    }

    /// Returns the CRC-32 over every row's bytes.
    pub fn telemetry_crc32(&self) -> u32 {
        self.telemetry_crc32.value()
    }

    /// Returns the number of rows so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Returns the share of rows in which a head supplied an attitude.
    pub fn tracker_availability(&self) -> f64 {
        self.solved_rows as f64 / self.rows.max(1) as f64
    }

    /// Returns the noise-equivalent angle across the boresight in the window according to the tracker's own covariance,
    /// rad.
    pub fn nea_rad(&self) -> Option<f64> {
        let (sum, count) = self.tracker_variance;
        (count > 0).then(|| (sum / count as f64).sqrt())
    }

    /// Returns the largest micro-vibration, arcsec, and the wheel speed at that time, in revolutions per second;
    /// `None` without vibration.
    pub fn vibration(&self) -> Option<(f64, f64)> {
        let (vibration_rad, speed_rad_s) = self.vibration;
        (vibration_rad > 0.0).then(|| (vibration_rad / ARCSEC, speed_rad_s / core::f64::consts::TAU))
    }

    /// Returns the time from the first exposure to fine pointing, s.
    pub fn fine_after_s(&self) -> Option<f64> {
        self.first_fine.map(|at| (at - self.zero).s())
    }

    /// Returns the pointing errors in the window: from the true attitude to the target's.
    pub fn pointing(&self) -> WindowErrors {
        window(&self.pointing)
    }

    /// Returns the knowledge errors in the window: from the true attitude to the estimated one.
    pub fn knowledge(&self) -> WindowErrors {
        window(&self.knowledge)
    }

    /// Returns true when the last row was on target.
    pub fn is_on_target(&self) -> bool {
        self.last_boresight_rad <= self.expect.recovered_arcsec * ARCSEC
    }

    /// Returns the results of the expectations. `predicted_arcsec` is the boresight's rms error according to linear
    /// theory.
    pub fn verdicts(&self, predicted_arcsec: Option<f64>, record: &RunRecord) -> Vec<Verdict> {
        let expect = &self.expect;
        let mut verdicts = Vec::new();
        let mut at_most = |name, limit: Option<f64>, got: Option<f64>, unit: &str| {
            if let Some(limit) = limit {
                let wanted = format!("at most {limit} {unit}");
                let reported = got.map_or_else(|| "never".into(), |got| format!("{got:.3} {unit}"));
                verdicts.push(Verdict { name, wanted, got: reported, passed: got.is_some_and(|got| got <= limit) });
            }
        };
        let pointing = self.pointing().boresight_arcsec;
        at_most("fine pointing reached after", expect.fine_pointing_within_s, self.fine_after_s(), "s");
        at_most("rms pointing error", expect.pointing_arcsec.filter(|_| !expect.diverges), pointing, "arcsec");
        let knowledge = self.knowledge().boresight_arcsec;
        at_most("rms knowledge error", expect.knowledge_arcsec, knowledge, "arcsec");
        let ratio = pointing.zip(predicted_arcsec).map(|(got, predicted)| got / predicted);
        at_most("pointing error over the linear prediction", expect.pointing_over_predicted, ratio, "times");
        if !self.refusals.is_empty() && !expect.allows_refusals {
            let got = self.refusals.join("; ");
            verdicts.push(Verdict { name: "commands", wanted: "all taken".into(), got, passed: false });
        }
        if expect.diverges {
            let limit = expect.pointing_arcsec.unwrap_or(expect.recovered_arcsec);
            verdicts.push(Verdict {
                name: "the control fails, as it must here",
                wanted: format!("rms pointing error above {limit} arcsec"),
                got: pointing.map_or_else(|| "none".into(), |got| format!("{got:.3} arcsec")),
                passed: pointing.is_some_and(|got| got > limit),
            });
        }
        if let Some(least) = expect.least_sun_angle_deg {
            let got = self.least_sun_angle_rad.map(f64::to_degrees);
            verdicts.push(Verdict {
                name: "smallest angle to the Sun",
                wanted: format!("at least {least} deg"),
                got: got.map_or_else(|| "no boresight is kept from it".into(), |got| format!("{got:.3} deg")),
                passed: got.is_some_and(|got| got >= least),
            });
        }
        if let Some(mode) = expect.final_mode {
            let got = mode_name(self.mode);
            verdicts.push(Verdict {
                name: "mode at the end",
                wanted: mode.into(),
                got: got.into(),
                passed: got == mode,
            });
        }
        verdicts.extend(frame_verdicts(&expect.frames, record));
        verdicts
    }
}

/// Returns the results of the expectations about frames.
fn frame_verdicts(expect: &ExpectFrames, record: &RunRecord) -> impl Iterator<Item = Verdict> {
    let (frames, fired) = (record.frames, record.ledger.count(EventKind::TriggerFired));
    let RunLimits { late, dropped, blank, blank_at_start, .. } = expect.limits;
    let at_start = blank_at_start.map_or(0, |_| record.account.of(FrameEnd::BlankAtStart).count);
    let at_most = |name, limit: Option<u32>, got: u64| {
        let verdict = |limit: u32| {
            let (wanted, passed) = (format!("at most {limit}"), got <= u64::from(limit));
            Verdict { name, wanted, got: got.to_string(), passed }
        };
        limit.map(verdict)
    };
    let triggers = expect.triggers_at_least.map(|least| {
        let (wanted, passed) = (format!("at least {least}"), fired >= u64::from(least));
        Verdict { name: "triggers fired", wanted, got: fired.to_string(), passed }
    });
    let counted = [
        at_most("late frames", late, frames.late),
        at_most("dropped frames", dropped, frames.dropped),
        at_most("blank frames", blank, frames.blank.saturating_sub(at_start)),
        triggers,
    ];
    counted.into_iter().flatten()
}

fn window(square: &Square) -> WindowErrors {
    let arcsec = |rad: f64| rad / ARCSEC;
    WindowErrors {
        rows: square.count,
        boresight_arcsec: square.rms(square.across).map(arcsec),
        roll_arcsec: square.rms(square.about).map(arcsec),
        largest_boresight_arcsec: (square.count > 0).then(|| arcsec(square.largest)),
    }
}
