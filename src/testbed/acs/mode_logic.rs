//! Modes and what moves the spacecraft from one to another, as one table.
//!
//! Input: what is known at a step. Output: at most one typed event per step. A row fires when its condition has held
//! at every step for its dwell time; enter and leave thresholds differ (hysteresis). Rows are tried in order. Tests:
//! `mode_tests.rs`.

use base::time::{Span, Tai};

/// Mode of the control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Sun-pointing with coarse Sun sensor and gyro; leaves on command only.
    Safe,
    /// Stops the body's turning; needs the gyro only.
    RateDamping,
    /// Points with wide bandwidth limits and little accuracy asked.
    CoarsePointing,
    /// Points with the fine loop.
    FinePointing,
    /// Follows a planned turn.
    Slew,
}

/// Why a mode changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// By command.
    Commanded,
    /// The body hardly turns and the attitude is known.
    RateLow,
    /// The body turns too fast.
    RateHigh,
    /// The body hardly turns, but no attitude came.
    NoAttitude,
    /// No attitude for too long.
    AttitudeLost,
    /// The target is so far off that a planned turn is needed, and the body hardly turns.
    FarFromTarget,
    /// Error, rate error and the estimate's sigma are small.
    Settled,
    /// The error grew.
    ErrorLarge,
    /// The estimate's sigma grew.
    SigmaLarge,
    /// The planned turn is over, but the error is not small yet.
    SlewOver,
}

/// One change of mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModeEvent {
    /// When.
    pub at: Tai,
    /// From.
    pub from: Mode,
    /// To.
    pub to: Mode,
    /// Why.
    pub cause: Cause,
}

/// Limits and dwell times of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// Below this rate the body is stopped, rad/s.
    pub rate_low_rad_s: f64,
    /// Above this rate pointing is given up, rad/s; above the slew rate.
    pub rate_high_rad_s: f64,
    /// How long a rate must be low, or high.
    pub rate_dwell: Span,
    /// Fine pointing begins below this error, rad.
    pub fine_enter_rad: f64,
    /// And below this rate error, rad/s.
    pub fine_enter_rate_rad_s: f64,
    /// And below this sigma of the attitude, rad.
    pub fine_enter_sigma_rad: f64,
    /// For so long.
    pub fine_enter_dwell: Span,
    /// Fine pointing ends above this error, rad; above the entry.
    pub fine_leave_rad: f64,
    /// Or above this sigma, rad; above the entry.
    pub fine_leave_sigma_rad: f64,
    /// For so long.
    pub fine_leave_dwell: Span,
    /// Above this error a planned turn is made, rad; above the end of fine pointing.
    pub slew_above_rad: f64,
    /// After so long without attitude fine pointing and slews fall back to coarse pointing.
    pub coarse_without_attitude: Span,
    /// After so long without attitude coarse pointing falls back to safe mode (counted in that mode).
    pub safe_without_attitude: Span,
    /// How long a slew may take to settle.
    pub slew_settle: Span,
}

/// Inputs of the mode logic at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Situation {
    /// Rate of the body, rad/s.
    pub rate_rad_s: f64,
    /// Rate less the reference's rate, rad/s.
    pub rate_error_rad_s: f64,
    /// Angle between attitude and reference, rad; `None`: no attitude.
    pub error_rad: Option<f64>,
    /// Sigma of the attitude, rad.
    pub sigma_rad: f64,
    /// The planned turn is over.
    pub slew_over: bool,
}

impl Situation {
    fn known(&self) -> bool {
        self.error_rad.is_some()
    }

    fn settled(&self, t: &Thresholds) -> bool {
        self.error_rad.is_some_and(|error| error < t.fine_enter_rad)
            && self.rate_error_rad_s < t.fine_enter_rate_rad_s
            && self.sigma_rad < t.fine_enter_sigma_rad
    }

    fn far_and_stopped(&self, t: &Thresholds) -> bool {
        self.rate_rad_s < t.rate_low_rad_s && self.further_than(t.slew_above_rad)
    }

    fn further_than(&self, limit_rad: f64) -> bool {
        self.error_rad.is_some_and(|error| error > limit_rad)
    }
}

/// One row of the table.
struct Transition {
    from: Mode,
    to: Mode,
    cause: Cause,
    when: fn(&Situation, &Thresholds) -> bool,
    dwell: fn(&Thresholds) -> Span,
}

const ROWS: usize = 15;

macro_rules! row {
    ($from:ident => $to:ident, $cause:ident, $when:expr, $dwell:ident) => {
        Transition { from: Mode::$from, to: Mode::$to, cause: Cause::$cause, when: $when, dwell: |t| t.$dwell }
    };
}

/// Every transition that is not a command.
const TABLE: [Transition; ROWS] = [
    row!(RateDamping => CoarsePointing, RateLow, |s, t| s.rate_rad_s < t.rate_low_rad_s && s.known(), rate_dwell),
    row!(RateDamping => Safe, NoAttitude, |s, t| s.rate_rad_s < t.rate_low_rad_s && !s.known(), safe_without_attitude),
    row!(CoarsePointing => RateDamping, RateHigh, |s, t| s.rate_rad_s > t.rate_high_rad_s, rate_dwell),
    row!(FinePointing => RateDamping, RateHigh, |s, t| s.rate_rad_s > t.rate_high_rad_s, rate_dwell),
    row!(Slew => RateDamping, RateHigh, |s, t| s.rate_rad_s > t.rate_high_rad_s, rate_dwell),
    row!(CoarsePointing => Safe, AttitudeLost, |s, _| !s.known(), safe_without_attitude),
    row!(FinePointing => CoarsePointing, AttitudeLost, |s, _| !s.known(), coarse_without_attitude),
    row!(Slew => CoarsePointing, AttitudeLost, |s, _| !s.known(), coarse_without_attitude),
    row!(CoarsePointing => Slew, FarFromTarget, |s, t| s.far_and_stopped(t), fine_leave_dwell),
    row!(CoarsePointing => FinePointing, Settled, |s, t| s.settled(t), fine_enter_dwell),
    row!(FinePointing => CoarsePointing, ErrorLarge, |s, t| s.further_than(t.fine_leave_rad), fine_leave_dwell),
    row!(FinePointing => CoarsePointing, SigmaLarge, |s, t| s.sigma_rad > t.fine_leave_sigma_rad, fine_leave_dwell),
    row!(Slew => CoarsePointing, ErrorLarge, |s, t| s.further_than(t.slew_above_rad), fine_leave_dwell),
    row!(Slew => FinePointing, Settled, |s, t| s.slew_over && s.settled(t), fine_enter_dwell),
    row!(Slew => CoarsePointing, SlewOver, |s, _| s.slew_over, slew_settle),
];

/// The mode and how long each row's condition has held.
#[derive(Debug, Clone, Copy)]
pub struct ModeLogic {
    /// The mode.
    pub mode: Mode,
    since: [Option<Tai>; ROWS],
    thresholds: Thresholds,
}

impl ModeLogic {
    /// Begins in `mode`.
    pub fn new(mode: Mode, thresholds: Thresholds) -> Self {
        Self { mode, since: [None; ROWS], thresholds }
    }

    /// Returns one step; the event when the mode changes.
    pub fn step(&mut self, at: Tai, situation: &Situation) -> Option<ModeEvent> {
        let mut fires = None;
        for (row, since) in TABLE.iter().zip(&mut self.since) {
            if row.from != self.mode || !(row.when)(situation, &self.thresholds) {
                *since = None;
                continue;
            }
            let begun = *since.get_or_insert(at);
            if fires.is_none() && at - begun >= (row.dwell)(&self.thresholds) {
                fires = Some(row);
            }
        }
        fires.map(|row| self.change(at, row.to, row.cause))
    }

    /// Changes the mode now.
    pub fn change(&mut self, at: Tai, to: Mode, cause: Cause) -> ModeEvent {
        let event = ModeEvent { at, from: self.mode, to, cause };
        self.mode = to;
        self.since = [None; ROWS];
        event
    }
}
