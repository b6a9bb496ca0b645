//! The line of sight of a frame: composed from the receiver's histories, with what is said of it.
//!
//! In: a slot, the receiver. Out: the line of sight, what the image shows (`Shown`), how the frame ends if it goes out
//! on time, the bound of its error, events. Tests: `tests/closed_loop/{attitude,budget,late_jitter}.rs`.

use crate::runtime::error::{Result, RunError};
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::{describe::PathFacts, receiver::Receiver, slot::Slot};
use base::axes::Rotation;
use base::time::{Span, Tai};
use frames::report::FrameEnd;
use glam::DVec3;
use plan::attitude::{
    AttitudeMethod, EstimateLimits, LosPath, MotionScale, PathOrigin, PathOutcome, PathReport, compose,
};

/// Content of the image of a slot.
pub(super) enum Shown {
    Stars,
    Dark,
    Nothing,
}

/// The line of sight of the latest frame.
pub struct Pointing {
    /// Largest motion that the body may make, as far as it is in the attitude records, if known: with it the error of
    /// every frame's attitude has a bound.
    pub motion: Option<MotionScale>,
    /// The bound of the frame's pointing error, rad, by the attitude method that made it; `None` when the motion is
    /// unknown or the method has no bound (held, or predicted beyond the acceleration's horizon).
    pub bound_rad: Option<f64>,
    /// End of the frame if it goes out on time.
    pub end_on_time: FrameEnd,
    /// True once a frame has shown an attitude.
    has_been_lit: bool,
    /// Facts about the line of sight.
    pub(super) path: PathFacts,
}

impl Pointing {
    pub(super) fn new() -> Self {
        let (path, end_on_time) = (PathFacts::default(), FrameEnd::OnTime);
        Self { motion: None, bound_rad: None, end_on_time, has_been_lit: false, path }
    }

    /// Composes the line of sight of a slot of a head, whose rows are exposed one after another within `rows_s`; returns
    /// what the image shows.
    pub(super) fn compose(
        &mut self,
        (head, slot): (usize, Slot),
        [exposure_s, rows_s]: [f64; 2],
        receiver: &Receiver,
        los: &mut LosPath,
        ledger: &mut Ledger,
    ) -> Result<Shown> {
        let (limits, mounting) = (&receiver.params.settings.estimate, receiver.mountings.of(head));
        let mut note = |kind, span| ledger.note(Event::new(kind, slot.release, Some(slot.number), span));
        self.path = PathFacts::default();
        if !receiver.session.is_rendering() {
            note(EventKind::NotRunning, Span::ZERO);
            (self.bound_rad, self.end_on_time) = (None, receiver.session.end_while_dark());
            show_nothing(los, slot.exposure_start, exposure_s);
            return Ok(Shown::Dark);
        }
        let outcome = compose(
            &receiver.attitudes.history,
            &mounting.jitter,
            mounting.sensor_from_body,
            slot.exposure_start - Span::from_s(0.5 * rows_s),
            exposure_s + rows_s,
            limits,
            los,
        );
        los.exposure_start = slot.exposure_start;
        los.exposure_s = exposure_s;
        self.bound_rad = match (&outcome, &self.motion) {
            (Ok(PathOutcome::Show(report)), Some(motion)) => bound_rad(los.origin, report, motion, limits),
            _ => None,
        };
        self.end_on_time = match (&outcome, los.origin) {
            (Ok(PathOutcome::Show(_)), PathOrigin::Held) => FrameEnd::AttitudeHeld,
            (Ok(PathOutcome::Show(_)), _) => FrameEnd::OnTime,
            (Ok(_), _) => FrameEnd::Blank,
            (Err(_forgotten), _) if self.has_been_lit => FrameEnd::Blank,
            (Err(_nothing_received_yet), _) => FrameEnd::BlankAtStart,
        };
        self.has_been_lit |= outcome.is_ok();
        match outcome {
            Ok(PathOutcome::Show(report)) => {
                match los.origin {
                    PathOrigin::Held => {
                        let age = receiver.attitudes.age_at(slot.release).unwrap_or(Span::ZERO);
                        note(EventKind::AttitudeHeld, age);
                    }
                    PathOrigin::Predicted => note(EventKind::Predicted, report.horizon),
                    PathOrigin::Interpolated | PathOrigin::Commanded | PathOrigin::Absent | PathOrigin::TestPattern => {
                    }
                }
                self.path = PathFacts::of(&report, los.origin);
                self.path.note(slot, ledger);
                Ok(Shown::Stars)
            }
            Ok(PathOutcome::Blank { age }) => {
                note(EventKind::Blank, age);
                Ok(Shown::Dark)
            }
            Ok(PathOutcome::Drop { age }) => {
                note(EventKind::AttitudeMissing, age);
                Ok(Shown::Nothing)
            }
            Ok(PathOutcome::Stop { age }) => {
                note(EventKind::AttitudeStopped, age);
                Err(RunError::AttitudeStopped { age })
            }
            Err(_nothing_received_yet) => {
                note(EventKind::NoAttitude, Span::ZERO);
                show_nothing(los, slot.exposure_start, exposure_s);
                Ok(Shown::Dark)
            }
        }
    }
}

/// Sets a static placeholder line of sight.
fn show_nothing(los: &mut LosPath, exposure_start: Tai, exposure_s: f64) {
    los.mid_sensor_from_icrf = Rotation::IDENTITY;
    los.exposure_start = exposure_start;
    los.exposure_s = exposure_s;
    los.rate_rad_s = DVec3::ZERO;
    los.acceleration_rad_s2 = DVec3::ZERO;
    los.jitter.lines.clear();
    los.jitter.points.clear();
    los.origin = PathOrigin::Absent;
    los.horizon = Span::ZERO;
}

/// Returns the bound of the error at mid-exposure, rad, if the method that was used has one.
fn bound_rad(origin: PathOrigin, report: &PathReport, motion: &MotionScale, limits: &EstimateLimits) -> Option<f64> {
    let bound_rad = if origin == PathOrigin::Interpolated {
        AttitudeMethod::Interpolation.bound_rad(motion, report.gap.s())
    } else if origin == PathOrigin::Predicted && report.horizon <= limits.max_horizon {
        AttitudeMethod::ConstantAcceleration.bound_rad(motion, report.horizon.s())
    } else {
        return None;
    };
    // A bound of half a turn means: outside the method's domain.
    (bound_rad < core::f64::consts::PI).then_some(bound_rad)
}
