//! Remote ticks -> TAI.
//!
//! *The relation.* The flight computer has one clock, counted since its boot. TIME messages carry it as SCET (whole
//! seconds + 24-bit fraction); attitude messages carry `t_us`: the low 32 bits of the same clock in whole
//! microseconds (`firmware_protocol::ticks`). Two-step SYNC + TIME_FUP gives marks (remote time of SYNC's transmission,
//! local time of its reception).
//!
//! *Estimator.* `local - remote` is a line, the clocks' offset and drift, plus the link's delay; delays only add. The
//! lower convex hull of a window's marks finds the line under them (`hull`), and a Kalman filter of offset and drift
//! carries it from window to window and weighs it (`kalman`, `line`). The error of the hull follows from how close the
//! delays come to their floor, which is learnt (`line`), so the estimate knows its own deviations. One-way data cannot
//! see the constant part of the delay: it is calibrated, or measured by pulses per second (`pps`).
//!
//! *Errors*, measured by `tests/physics/time_correlation.rs` with queueing of 20 us on average and 10 % of the marks up
//! to 5 ms late: 99 % of them below 1 us at 10 marks per second.
//!
//! *Doubt* (`marks`). A mark earlier than the line allows (a damaged one) is used only when two more agree with it: the
//! line then restarts there and keeps its drift. The line follows marks that all lie above it for 4 s and 16 marks
//! (`line`): the link has become slower, or the clock was set back a little. A step beyond the limit restarts: at once
//! when the difference shrinks or remote time runs backwards, after three marks when it grows. The line before the step
//! is kept for eight marks: when a mark fits it again, the step was damage and is undone.

mod hull;
mod kalman;
mod line;
mod marks;
mod pps;
#[cfg(test)]
mod tests;

pub use kalman::ClockEstimate;
pub use pps::ObservedPps;

use base::time::{Span, Tai};
use firmware_protocol::ticks::{ticks_diff, wrapped};
use line::{Line, LineParams, Mark};
use marks::{Doubts, Verdict};
use pps::Pulses;

/// Number of marks after a step in which it may turn out to have been damage.
const MARKS_OF_DOUBT: u32 = 8;

/// Limits for the use of marks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RemoteClockLimits {
    /// Length of a hull's window.
    pub window: Span,
    /// Calibrated constant delay from transmission to the receive stamp.
    pub constant_delay: Span,
    /// A difference further than this from the line is a late message or a step.
    pub step: Span,
    /// Steepest line that counts as a clock's drift (1e-6 is 1 ppm).
    pub most_drift: f64,
    /// Random walk of the remote clock's frequency: its Allan deviation at 1 s.
    pub allan_1s: f64,
    /// One sigma of the stamps of pulses per second.
    pub pps_sigma: Span,
}

impl Default for RemoteClockLimits {
    /// Returns windows of 30 s, no constant delay, steps from 250 ms, drifts to 200 ppm that wander by 5e-9 in a second
    /// (a quartz in a box whose temperature changes), pulses stamped to 1 us.
    fn default() -> Self {
        Self {
            window: Span::from_ms(30_000),
            constant_delay: Span::ZERO,
            step: Span::from_ms(250),
            most_drift: 200e-6,
            allan_1s: 5e-9,
            pps_sigma: Span::from_ns(1000),
        }
    }
}

/// Result for a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// Used.
    Used,
    /// Left out: too late.
    Late,
    /// Left out for now: earlier than physically possible, and fewer than two others agree.
    Outlier,
    /// The remote clock stepped, or a presumed step was withdrawn: the line is another one from this mark on.
    Restarted,
}

/// The bus's constant delay as measured by pulses per second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeasuredDelay {
    /// Time from SYNC's transmission to its receive stamp, without queueing.
    pub delay: Span,
    /// One sigma.
    pub sigma: Span,
}

/// The remote clock, estimated from its time messages.
#[derive(Debug, Clone)]
pub struct RemoteClock {
    limits: RemoteClockLimits,
    line: Line,
    /// The line before the last step, and the number of marks for which it is kept.
    former: Line,
    former_marks: u32,
    doubts: Doubts,
    pulses: Pulses,
    delay: Option<MeasuredDelay>,
    estimate: Option<ClockEstimate>,
    /// Number of pairs of SYNC and TIME_FUP that were used since the start.
    pub pairs: u64,
    /// Number of pairs that were left out because they were too late.
    pub late: u64,
    /// Number of pairs that were left out because they were earlier than physically possible and no others
    /// agreed.
    pub outliers: u64,
    /// How often the line was shifted by less than a step because marks agreed that the delay has changed.
    pub shifts: u64,
    /// How often the remote clock was found to have stepped, or a step was withdrawn.
    pub steps: u64,
}

impl RemoteClock {
    /// Returns a clock without data; all memory is allocated here.
    pub fn new(limits: RemoteClockLimits) -> Self {
        let walk = walk(&limits);
        let most_rate_ns_per_s = limits.most_drift * 1e9;
        let line = Line::new(LineParams { window_s: limits.window.s(), walk, most_rate_ns_per_s });
        Self {
            former: line.clone(),
            former_marks: 0,
            doubts: Doubts::new(),
            pulses: Pulses::new(limits.pps_sigma.ns() as f64, walk, 0.25 * most_rate_ns_per_s),
            delay: None,
            estimate: None,
            pairs: 0,
            late: 0,
            outliers: 0,
            shifts: 0,
            steps: 0,
            limits,
            line,
        }
    }

    /// Adds one mark: remote time of SYNC's transmission (ns, from TIME_FUP's SCET), local time of its reception.
    pub fn observe(&mut self, sync_scet_ns: i64, local: Tai) -> Observed {
        let mark = Mark { remote_ns: sync_scet_ns, difference_ns: local.ns().saturating_sub(sync_scet_ns) };
        let outcome = self.take(mark);
        match outcome {
            Observed::Used | Observed::Restarted => {
                self.pairs += 1;
                self.estimate = Some(self.conclude());
            }
            Observed::Late => self.late += 1,
            Observed::Outlier => self.outliers += 1,
        }
        outcome
    }

    fn take(&mut self, mark: Mark) -> Observed {
        if self.estimate.is_none() {
            self.line.begin(mark);
            return Observed::Used;
        }
        if self.former_marks > 0 && marks::belongs_rather(&mark, &self.former, &self.line, self.limits.step.ns() as f64)
        {
            return self.undo_step(mark);
        }
        match self.doubts.judge(&self.line, &mark, self.limits.step.ns() as f64) {
            Verdict::Late => return Observed::Late,
            Verdict::Outlier => return Observed::Outlier,
            Verdict::Stepped => return self.step(mark),
            Verdict::Fell => self.fall(mark),
            Verdict::Fits => {
                let gate_ns = marks::gate_ns(&self.line, &mark);
                self.shifts += u64::from(self.line.take(mark, gate_ns));
            }
        }
        self.former_marks = self.former_marks.saturating_sub(1);
        Observed::Used
    }

    fn step(&mut self, mark: Mark) -> Observed {
        core::mem::swap(&mut self.line, &mut self.former);
        self.line.begin_after(&self.former, mark);
        self.former_marks = MARKS_OF_DOUBT;
        self.after_step()
    }

    fn undo_step(&mut self, mark: Mark) -> Observed {
        core::mem::swap(&mut self.line, &mut self.former);
        self.former_marks = 0;
        let gate_ns = marks::gate_ns(&self.line, &mark);
        self.line.take(mark, gate_ns);
        self.after_step()
    }

    fn after_step(&mut self) -> Observed {
        self.doubts.clear();
        self.pulses.clear();
        self.steps += 1;
        Observed::Restarted
    }

    fn fall(&mut self, mark: Mark) {
        let agreeing = self.doubts.agreeing(&self.line, &mark);
        // The line changes while the iterator reads it: copy a few marks to the stack.
        let mut marks = [mark; 17];
        let count = agreeing.zip(&mut marks).map(|(outlier, place)| *place = outlier).count();
        self.line.begin_shifted(marks.into_iter().take(count).chain([mark]));
        self.doubts.clear();
        self.shifts += 1;
    }

    /// Adds an edge of the remote clock's pulse per second, stamped locally.
    pub fn observe_pps(&mut self, local: Tai) -> ObservedPps {
        let Some(estimate) = self.estimate else {
            return ObservedPps::NoTimeYet;
        };
        let observed = self.pulses.observe(local, estimate.to_remote_ns(local));
        if observed == ObservedPps::Used {
            self.delay = self.compared().or(self.delay);
            self.estimate = Some(self.conclude());
        }
        observed
    }

    /// Returns the bus's delay, once pulses have measured it.
    pub fn measured_delay(&self) -> Option<MeasuredDelay> {
        self.delay
    }

    /// Returns the height of the marks' line above that of the pulses, at the newest mark.
    fn compared(&self) -> Option<MeasuredDelay> {
        let at_ns = self.line.newest().remote_ns;
        let (marks, pulses) = (self.line.at(at_ns), self.pulses.at(at_ns)?);
        let (base_ns, rest_ns) = marks.offset();
        let variance = marks.offset_sigma_ns().powi(2) + pulses.offset_sigma_ns().powi(2);
        Some(MeasuredDelay {
            delay: Span::from_s((pulses.above_ns(base_ns) + rest_ns) * 1e-9),
            sigma: Span::from_s(variance.sqrt() * 1e-9),
        })
    }

    fn conclude(&self) -> ClockEstimate {
        let at_ns = self.line.newest().remote_ns;
        let (state, delay) = match self.pulses.at(at_ns) {
            Some(pulses) => (pulses, Span::ZERO),
            None => (self.line.at(at_ns), self.delay.map_or(self.limits.constant_delay, |measured| measured.delay)),
        };
        let (smallest_ns, largest_ns, pairs) = self.line.seen();
        ClockEstimate {
            offset: Span::from_ns(state.offset().0.saturating_sub(delay.ns())),
            reference_remote_ns: at_ns,
            // For instants centuries apart the filter itself may leave the limit.
            drift: (state.rate_ns_per_s * 1e-9).clamp(-self.limits.most_drift, self.limits.most_drift),
            offset_sigma: Span::from_s(state.offset_sigma_ns() * 1e-9),
            drift_sigma: state.rate_sigma_ns_per_s() * 1e-9,
            drift_walk_per_s: 3.0 * self.limits.allan_1s * self.limits.allan_1s,
            residual: Span::from_s(self.line.residual_ns * 1e-9),
            spread: Span::from_ns(largest_ns.saturating_sub(smallest_ns)),
            pairs,
        }
    }

    /// Returns the present estimate; `None` before the first mark.
    pub fn estimate(&self) -> Option<ClockEstimate> {
        self.estimate
    }

    /// Returns the instant of a tick count that was taken within 35.8 minutes of `near` (the receive time); `None`
    /// before the first mark. Resolution 1 us (ticks are whole microseconds, rounded down).
    pub fn to_tai(&self, t_us: u32, near: Tai) -> Option<Tai> {
        let estimate = self.estimate()?;
        let near_us = estimate.to_remote_ns(near).div_euclid(1000);
        Some(estimate.to_tai(unwrapped_us(t_us, near_us).saturating_mul(1000)))
    }
}

/// Returns the random walk of the rate, (ns/s)^2/s.
fn walk(limits: &RemoteClockLimits) -> f64 {
    3.0 * (limits.allan_1s * 1e9).powi(2)
}

/// Returns the count of microseconds nearest to `near_us` whose low 32 bits are `t_us`.
pub(super) fn unwrapped_us(t_us: u32, near_us: i64) -> i64 {
    near_us.saturating_add(i64::from(ticks_diff(t_us, wrapped(near_us))))
}

#[cfg(test)]
mod tick_tests {
    use super::*;
    use firmware_protocol::ticks::WRAP_US;

    #[test]
    fn the_nearest_count_is_meant_on_both_sides_of_half_a_wrap() {
        let half = WRAP_US / 2;
        assert_eq!(unwrapped_us(0, half - 1), 0);
        assert_eq!(unwrapped_us(0, half), 0);
        assert_eq!(unwrapped_us(0, half + 1), WRAP_US);
    }
}
