//! Results of a run, finished or in progress, and their expected values by linear theory.

use crate::runtime::receiver::Receiver;
use crate::runtime::{EventKind, Head, PortReading, RunParams, RunRecord};
use crate::wiring::verdict::{CutShort, Facts, Promise, verdict};
use crate::wiring::{assessment::Assessment, error::LoopError, faults::FaultLine, run_clock::RunTimes};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use frames::report::{AnswerRow, EventLine, FrameAccount, GatewayRow, HygieneLine, Losses, RunSummary, RunVerdict};
use frames::sink::{SinkLine, SinkSummary};
use testbed::acs::{linear::PointingLoop, pointing_error::PointingNoise};
use testbed::estimator::{GyroNoise, MekfCounts};
use testbed::vehicle::Vehicle;

/// Counts of a run's spacecraft, and their expected values by linear theory.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Flown {
    /// Counts of the attitudes that the estimator received.
    pub estimator: MekfCounts,
    /// Frames without a time tag, which were not used.
    pub untagged: u64,
    /// Expected rms error of the boresight's direction by linear theory from the tracker's noise, rad.
    pub predicted_pointing_rad: Option<f64>,
}

impl Flown {
    /// Returns the counts of a vehicle so far; `params` are those of the first head.
    pub(super) fn of(vehicle: Option<&Vehicle>, assessment: &Assessment, params: &RunParams) -> Self {
        let untagged = |vehicle: &Vehicle| vehicle.heads.reports().map(|report| report.untagged).sum();
        Self {
            estimator: vehicle.map(|vehicle| vehicle.estimator.counts).unwrap_or_default(),
            untagged: vehicle.map_or(0, untagged),
            predicted_pointing_rad: predicted_pointing_rad(vehicle, assessment, params),
        }
    }

    /// Returns [`Self::predicted_pointing_rad`] in arcsec.
    pub fn predicted_pointing_arcsec(&self) -> Option<f64> {
        self.predicted_pointing_rad.map(|rad| rad / ARCSEC)
    }
}

/// Results of a run that has ended, well or not, and its parts.
pub struct RunEnd {
    /// Its instants.
    pub times: RunTimes,
    /// Its heads; at least one.
    pub heads: Vec<Head>,
    /// Their receiver.
    pub receiver: Receiver,
    /// Counts, times and events of the stimulator.
    pub record: RunRecord,
    /// Counters of each port.
    pub ports: Vec<PortReading>,
    /// Summary written by each head's sink; `None` when it could not finish.
    pub summaries: Vec<Option<SinkSummary>>,
    /// Result of each sink of each head, failures included.
    pub sink_lines: Vec<SinkLine>,
    /// Counters of the gateways.
    pub gateways: Vec<GatewayRow>,
    /// Answers of each star tracker outside.
    pub answers: Vec<AnswerRow>,
    /// Losses of a run that reached its end.
    pub losses: Losses,
    /// Requests of threads to the operating system, and their results.
    pub hygiene: Vec<HygieneLine>,
    /// Telemetry summed up, expectations, invariants.
    pub assessment: Assessment,
    /// Every fault with its hits.
    pub faults: Vec<FaultLine>,
    /// Counts of the spacecraft; all zero when none is flown.
    pub flown: Flown,
    /// Time since the first exposure, s; the run's duration when it ran to its end.
    pub simulated_s: f64,
    /// Promise of its bench.
    pub promise: Promise,
    /// It came to its own end: a signal after that interrupts nothing.
    pub was_over: bool,
    /// How it ended before its last frame, other than by an error.
    pub cut_short: Option<CutShort>,
    /// Why the run ended early, if it did.
    pub error: Option<LoopError>,
}

/// Results of a run seen from outside, finished or in progress.
pub struct LoopView<'a> {
    /// Counts, times and events of the stimulator.
    pub record: &'a RunRecord,
    /// Frames by their ends.
    pub account: FrameAccount,
    /// The verdict so far.
    pub verdict: RunVerdict,
    /// CRC-32 over each head's frames.
    pub frames_crc32: Vec<u32>,
    /// Telemetry summed up, invariants.
    pub assessment: &'a Assessment,
    /// Every fault with its hits.
    pub faults: Vec<FaultLine>,
    /// See [`RunEnd`].
    pub flown: Flown,
    /// See [`RunEnd`].
    pub simulated_s: f64,
}

impl RunEnd {
    /// Returns the results for a report.
    pub fn view(&self) -> LoopView<'_> {
        LoopView {
            record: &self.record,
            account: self.account(),
            verdict: self.verdict(),
            frames_crc32: self.summaries.iter().map(|sink| sink.as_ref().map_or(0, |sink| sink.run_crc32)).collect(),
            assessment: &self.assessment,
            faults: self.faults.clone(),
            flown: self.flown,
            simulated_s: self.simulated_s,
        }
    }

    /// Returns counts, times and events; names of bench and clock and the wall time are filled in by the caller.
    pub fn summary(&self) -> RunSummary {
        let first = &self.heads[0];
        let shown = self.heads.iter().position(|head| head.is_shown).unwrap_or(0);
        let sink = self.summaries.get(shown).and_then(Option::as_ref);
        let mut summary = self.record.summary(&first.engine, &self.receiver, &self.ports, sink);
        (summary.verdict, summary.account) = (self.verdict(), self.account());
        summary.frames.scheduled = summary.account.scheduled();
        summary.sinks = self.sink_lines.clone();
        summary.losses = self.losses.clone();
        summary.gateways.clone_from(&self.gateways);
        summary.answers.clone_from(&self.answers);
        let failed: Vec<String> = self.promise.failed_tries(&self.ports).map(|(words, _)| words).collect();
        let is_unreached = |event: &&mut EventLine| event.kind == EventKind::LinkUnreached.name();
        summary.last_events.iter_mut().filter(is_unreached).for_each(|event| event.detail = failed.join("; "));
        summary
    }

    /// Returns the end of each frame that the bench promised.
    pub fn account(&self) -> FrameAccount {
        self.promise.account(&self.record, self.cut_short)
    }

    /// Returns the verdict: one word, and every reason for it.
    pub fn verdict(&self) -> RunVerdict {
        let error = self.error.as_ref().map(ToString::to_string);
        let facts = Facts {
            record: &self.record,
            heads: &self.heads,
            receiver: &self.receiver,
            ports: &self.ports,
            losses: &self.losses,
            zero: self.times.zero,
            cut_short: self.cut_short,
            failure: error.or_else(|| self.first_failure()),
        };
        verdict(&self.promise, &facts)
    }

    /// Returns the first expectation or invariant that is not met, in words.
    fn first_failure(&self) -> Option<String> {
        self.assessment.first_failure(self.flown.predicted_pointing_arcsec(), &self.record)
    }

    /// Records a thread that ended before the run did; `at` is when this was noticed.
    pub fn note_lost_thread(&mut self, name: &'static str, at: Tai) {
        let event = crate::runtime::ledger::Event::new(EventKind::ThreadLost, at, None, Span::ZERO);
        self.record.ledger.note(crate::runtime::ledger::Event { what: name, ..event });
        self.losses.note_thread(name);
    }

    /// Returns true when expectations and invariants are met.
    pub fn holds(&self) -> bool {
        self.first_failure().is_none()
    }
}

/// Returns the expected rms error of the boresight's direction (two axes) in fine pointing by linear theory from the
/// tracker's noise; `None` when nothing is flown or no attitude fell into the window.
fn predicted_pointing_rad(vehicle: Option<&Vehicle>, assessment: &Assessment, params: &RunParams) -> Option<f64> {
    let (vehicle, nea_rad) = (&vehicle?.params, assessment.nea_rad()?);
    let latency_s = 0.5 * params.camera.exposure_s + params.camera.readout_s;
    let pointing = PointingLoop {
        gains: vehicle.acs.fine,
        delay_s: vehicle.actuation_delay.s(),
        control_period_s: vehicle.acs.control_period.s(),
        filter: vehicle.acs.filter,
        inertia_ratio: 1.0,
    };
    let gyro = GyroNoise {
        arw_rad_sqrt_s: vehicle.gyro.angle_random_walk_rad_sqrt_s,
        rrw_rad_s_sqrt_s: vehicle.gyro.rate_random_walk_rad_s_sqrt_s,
    };
    let heads = vehicle.heads.len().max(1) as f64;
    let delay_s = vehicle.heads.first().map_or(0.0, |head| head.delay.s());
    let noise = PointingNoise {
        nea_rad: nea_rad / heads.sqrt(),
        tracker_period_s: params.frame_period.s(),
        latency_s: latency_s + delay_s,
        gyro,
    };
    Some(core::f64::consts::SQRT_2 * pointing.pointing_error(&noise).pointing_sigma_rad)
}
