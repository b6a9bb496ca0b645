//! The witness: holds every frame against the truth, every fault against its trace, and the loop against its recovery.
//!
//! Invariants, each a count of violations with words for the first few:
//! * a frame whose attitude was interpolated shows the true attitude (`RENDERED_ARCSEC` and the bus's timing);
//! * a frame that does not says so by its attitude's origin: predicted, held, none (no silent staleness). A delay on the
//!   bus cannot be told from an offset of a clock, so either widens the bound by its angle while it lasts and 5 s (delay)
//!   or 60 s (clock) more;
//! * every fault that had its time hit something;
//! * every frame scheduled went out, was dropped, or is on its way;
//! * after the last of overlapping faults the loop points again within the stated time.

use crate::runtime::RunRecord;
use crate::wiring::assessment::Assessment;
use crate::wiring::faults::FaultLine;
use base::axes::{Body, COMPUTED_NORM_TOLERANCE, Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::Scenario;
use frames::sink::FrameMeta;
use testbed::acs::ModeEvent;
use testbed::vehicle::TelemetryRow;

/// Attitude on the wire and interpolation between records: 0.03 arcsec, and room for the control's torque steps between
/// two records.
const RENDERED_ARCSEC: f64 = 0.5;
/// Error of the time correlation that an interpolated frame may have, s: with the body's rate it is an angle.
const CORRELATION_S: f64 = 50e-6;
/// Late packets and the estimate of the clock outlive a delay by this.
const DELAY_AFTERMATH: Span = Span::from_ms(5000);
/// Time marks of a clock that was wrong leave the correlation's window within this.
const CLOCK_AFTERMATH: Span = Span::from_ms(60_000);
/// Faults shorter than this need not meet a packet or frame.
const SHORTEST_FAULT_S: f64 = 1.0;

/// The witness of one run.
pub struct Witness {
    assessment: Assessment,
    heads: Vec<Rotation<Sensor, Body>>,
    /// Begin and end of faults, in order of their begin.
    faults: Vec<(Tai, Tai)>,
    /// Begin and end of delays on the bus, and how large they are.
    delays: Vec<(Tai, Tai, Span)>,
    recovery: Span,
    judged_faults: usize,
}

impl Witness {
    /// Returns a witness who has seen nothing.
    #[must_use]
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

    /// What has been summed up.
    #[must_use]
    pub fn assessment(&self) -> &Assessment {
        &self.assessment
    }

    /// A fault is going to act, or a slew to be made.
    pub fn expect_disturbance(&mut self, from: Tai, until: Tai) {
        self.faults.push((from, until));
        self.faults.sort();
    }

    /// Packets are going to be late by as much as `by`: the time marks with them, so that the correlation may err by it.
    pub fn expect_delay(&mut self, from: Tai, until: Tai, by: Span) {
        self.delays.push((from, until + DELAY_AFTERMATH, by));
    }

    /// The stimulator's clock is going to be off by as much as `by`, either way: it cannot be told from the flight
    /// computer's, so that the correlation may err by it until its marks are gone.
    pub fn expect_clock(&mut self, from: Tai, until: Tai, by: Span) {
        let by = Span::from_ns(by.ns().saturating_abs());
        self.delays.push((from, until + CLOCK_AFTERMATH, by));
    }

    fn delay_s(&self, at: Tai) -> f64 {
        let active = self.delays.iter().filter(|(from, until, _)| *from <= at && at < *until);
        active.map(|(_, _, by)| by.s()).sum()
    }

    /// A command was refused by the flight computer.
    pub fn refuse(&mut self, why: &str) {
        self.assessment.note_refusal(why);
    }

    /// Takes one row of telemetry in.
    pub fn take_row(&mut self, row: &TelemetryRow) {
        self.assessment.take_row(row);
        self.judge_recovery(row.at);
    }

    /// Takes a mode change in.
    pub fn take_mode(&mut self, event: &ModeEvent) {
        self.assessment.take_mode(event);
    }

    /// Holds one frame that went out against the true attitude (and rate, rad/s) at its mid-exposure.
    pub fn take_frame(&mut self, head: usize, meta: &FrameMeta, truth: Option<(Rotation<Body, Icrf>, f64)>) {
        // What a fault's flag says is the injector's word: only the stimulator's own excuses a frame.
        let is_reported = meta.origin != "interpolated";
        let (Some((body_from_icrf, rate_rad_s)), Some(mounting)) = (truth, self.heads.get(head)) else {
            return self.assessment.note_unchecked();
        };
        let Some(rendered) = Rotation::<Sensor, Icrf>::from_wxyz(meta.attitude_wxyz, COMPUTED_NORM_TOLERANCE) else {
            return self.assessment.violate(|| format!("frame {}: its attitude is no unit quaternion", meta.number));
        };
        let error_rad = (*mounting * body_from_icrf).rotation_vector_to(&rendered).length();
        if is_reported {
            return;
        }
        self.assessment.note_rendered(error_rad);
        let delay_s = self.delay_s(meta.mid_exposure);
        let bound_rad = RENDERED_ARCSEC * ARCSEC + rate_rad_s * (CORRELATION_S + delay_s);
        if error_rad > bound_rad {
            let (got, wanted) = (error_rad / ARCSEC, bound_rad / ARCSEC);
            self.assessment.violate(|| {
                format!(
                    "frame {} of head {head}: rendered {got:.3} arcsec from the truth (wanted {wanted:.3}) and nothing \
                     says so",
                    meta.number
                )
            });
        }
    }

    /// Judges what can only be judged at the end, when so many frames are still on their way.
    #[must_use]
    pub fn finish(mut self, record: &RunRecord, faults: &[FaultLine], now: Tai, on_the_way: u64) -> Assessment {
        let now_s = (now - self.assessment.zero()).s();
        for fault in faults {
            let lasted_s = now_s.min(fault.until_s) - fault.from_s;
            if fault.hits == 0 && lasted_s >= SHORTEST_FAULT_S {
                let (name, from_s) = (fault.name, fault.from_s);
                self.assessment.violate(|| format!("{name} from {from_s:.3} s: nothing was hit by it"));
            }
        }
        let frames = &record.frames;
        if frames.delivered + frames.dropped + on_the_way != frames.scheduled {
            self.assessment.violate(|| {
                format!(
                    "{} frames scheduled, but {} delivered, {} dropped and {on_the_way} on their way",
                    frames.scheduled, frames.delivered, frames.dropped
                )
            });
        }
        self.assessment
    }

    /// After the end of a fault, and before another begins, the loop must point again in time.
    fn judge_recovery(&mut self, now: Tai) {
        while let Some((_, until)) = self.faults.get(self.judged_faults).copied() {
            let deadline = until + self.recovery;
            if now < deadline {
                return;
            }
            self.judged_faults += 1;
            let is_disturbed_again = self.faults.iter().any(|(from, other)| *from < deadline && *other > until);
            if !is_disturbed_again && !self.assessment.is_on_target() {
                let after_s = (now - until).s();
                self.assessment.violate(|| format!("not on target {after_s:.1} s after the end of a fault"));
            }
        }
    }
}
