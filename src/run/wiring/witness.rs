//! The witness: checks every frame against the truth, every fault for a trace, and the loop for its recovery.
//!
//! Invariants, each a count of violations with words for the first few:
//! * a frame with an interpolated attitude shows the true attitude (`RENDERED_ARCSEC` and the bus's timing);
//! * any other frame reports its attitude's origin: predicted, held, none (no silent staleness). A delay on the bus and
//!   an offset of a clock are indistinguishable, so either widens the bound by its angle for its duration and 5 s
//!   (delay) or 60 s (clock) more;
//! * every fault that was active long enough hit something;
//! * every frame scheduled went out or was dropped;
//! * after the last of overlapping faults the loop points again within the stated time.

use crate::runtime::RunRecord;
use crate::wiring::{assessment::Assessment, faults::FaultLine, invariants::Invariant};
use base::axes::{Body, COMPUTED_NORM_TOLERANCE, Icrf, Rotation, Sensor};
use base::drawn::PathOrigin;
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::Scenario;
use frames::sink::FrameMeta;
use testbed::{acs::ModeEvent, vehicle::TelemetryRow};

/// Error of the attitude on the wire and of interpolation between records, 0.03 arcsec, with a margin for the control's
/// torque steps between two records.
const RENDERED_ARCSEC: f64 = 0.5;
/// Error of the time correlation that an interpolated frame may have, s: times the body's rate it is an angle.
const CORRELATION_S: f64 = 50e-6;
/// Time by which late packets and the error of the clock's estimate outlast a delay.
const DELAY_AFTERMATH: Span = Span::from_ms(5000);
/// Time within which marks of a wrong clock leave the correlation's window.
const CLOCK_AFTERMATH: Span = Span::from_ms(60_000);
/// Shorter faults may miss all packets and frames.
const SHORTEST_FAULT_S: f64 = 1.0;

/// The witness of one run.
pub struct Witness {
    /// The sums so far.
    pub assessment: Assessment,
    heads: Vec<Rotation<Sensor, Body>>,
    /// Start and end of faults, in order of their start.
    faults: Vec<(Tai, Tai)>,
    /// Start, end and size of delays on the bus.
    delays: Vec<(Tai, Tai, Span)>,
    recovery: Span,
    judged_faults: usize,
}

impl Witness {
    /// Returns a witness without observations.
    pub fn new(scenario: &Scenario, heads: Vec<Rotation<Sensor, Body>>, zero: Tai, end: Tai) -> Self {
        let head = scenario.bench.sensor_from_body;
        Self {
            assessment: Assessment::new(scenario.expect, zero, end, head.quat()),
            heads,
            faults: Vec::new(),
            delays: Vec::new(),
            recovery: Span::from_s(scenario.expect.recovery_s),
            judged_faults: 0,
        }
    }

    /// Announces that a fault will act or a slew will be made.
    pub fn expect_disturbance(&mut self, from: Tai, until: Tai) {
        self.faults.push((from, until));
        self.faults.sort();
    }

    /// Announces that packets will be late by up to `by`, with their time marks, so that the correlation may err by it.
    pub fn expect_delay(&mut self, from: Tai, until: Tai, by: Span) {
        self.delays.push((from, until + DELAY_AFTERMATH, by));
    }

    /// Announces that the stimulator's clock will be off by up to `by`, either way: the receiver cannot separate this
    /// from an error of the flight computer's clock, so the correlation may err by it until its marks are gone.
    pub fn expect_clock(&mut self, from: Tai, until: Tai, by: Span) {
        let by = Span::from_ns(by.ns().saturating_abs());
        self.delays.push((from, until + CLOCK_AFTERMATH, by));
    }

    fn delay_s(&self, at: Tai) -> f64 {
        let active = self.delays.iter().filter(|(from, until, _)| *from <= at && at < *until);
        active.map(|(_, _, by)| by.s()).sum()
    }

    /// Records a command that the flight computer refused.
    pub fn refuse(&mut self, why: &str) {
        self.assessment.note_refusal(why);
    }

    /// Adds one row of telemetry.
    pub fn take_row(&mut self, row: &TelemetryRow) {
        self.assessment.take_row(row);
        self.judge_recovery(row.at);
    }

    /// Adds a mode change.
    pub fn take_mode(&mut self, event: &ModeEvent) {
        self.assessment.take_mode(event);
    }

    /// Compares one frame that went out with the true attitude (and rate, rad/s) at its mid-exposure.
    pub fn take_frame(&mut self, head: usize, meta: &FrameMeta, truth: Option<(Rotation<Body, Icrf>, f64)>) {
        // A fault's flag comes from the injector: only the stimulator's own report excuses a frame.
        let is_reported = meta.origin != PathOrigin::Interpolated;
        let (Some((body_from_icrf, rate_rad_s)), Some(mounting)) = (truth, self.heads.get(head)) else {
            return self.assessment.note_unchecked();
        };
        let rendered = Rotation::<Sensor, Icrf>::from_wxyz(meta.attitude_wxyz, COMPUTED_NORM_TOLERANCE);
        self.assessment.invariants.check(Invariant::UnitAttitudes, rendered.is_some(), || {
            format!("frame {}: its attitude is not a unit quaternion", meta.number)
        });
        let Some(rendered) = rendered else { return };
        let error_rad = (*mounting * body_from_icrf).rotation_vector_to(&rendered).length();
        if is_reported {
            return;
        }
        self.assessment.note_rendered(error_rad);
        let delay_s = self.delay_s(meta.mid_exposure);
        let bound_rad = RENDERED_ARCSEC * ARCSEC + rate_rad_s * (CORRELATION_S + delay_s);
        let (got, wanted) = (error_rad / ARCSEC, bound_rad / ARCSEC);
        self.assessment.invariants.check(Invariant::FramesShowTheTruth, error_rad <= bound_rad, || {
            format!(
                "frame {} of head {head}: rendered {got:.3} arcsec from the truth (wanted {wanted:.3}) and nothing says so",
                meta.number
            )
        });
    }

    /// Checks the invariants that need the end of the run.
    pub fn finish(mut self, record: &RunRecord, faults: &[FaultLine], now: Tai) -> Assessment {
        let now_s = (now - self.assessment.zero).s();
        for fault in faults {
            let lasted_s = now_s.min(fault.until_s) - fault.from_s;
            if lasted_s >= SHORTEST_FAULT_S || fault.hits > 0 {
                let (name, from_s) = (fault.name, fault.from_s);
                let what = || format!("{name} from {from_s:.3} s: nothing was hit by it");
                self.assessment.invariants.check(Invariant::FaultsHit, fault.hits > 0, what);
            }
        }
        let frames = &record.frames;
        let is_whole = frames.delivered + frames.dropped == frames.scheduled;
        self.assessment.invariants.check(Invariant::FramesAreCounted, is_whole, || {
            format!(
                "{} frames scheduled, but {} delivered and {} dropped",
                frames.scheduled, frames.delivered, frames.dropped
            )
        });
        self.assessment
    }

    /// Checks that the loop points again in time after the end of a fault, unless another one starts.
    fn judge_recovery(&mut self, now: Tai) {
        while let Some((_, until)) = self.faults.get(self.judged_faults).copied() {
            let deadline = until + self.recovery;
            if now < deadline {
                return;
            }
            self.judged_faults += 1;
            let is_disturbed_again = self.faults.iter().any(|(from, other)| *from < deadline && *other > until);
            if !is_disturbed_again {
                let (is_on_target, after_s) = (self.assessment.is_on_target(), (now - until).s());
                let what = || format!("not on target {after_s:.1} s after the end of a fault");
                self.assessment.invariants.check(Invariant::RecoversFromFaults, is_on_target, what);
            }
        }
    }
}
