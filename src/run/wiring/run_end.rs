//! What a run came to, over or under way, and what linear theory says it should have come to.

use crate::runtime::{EventKind, PortReading, RunError, RunParams, RunRecord, note_lost_reader, sink_rows};
use crate::wiring::assessment::Assessment;
use crate::wiring::error::LoopError;
use crate::wiring::faults::FaultLine;
use crate::wiring::heads::RunHead;
use crate::wiring::run_times::RunTimes;
use base::time::{Span, Tai};
use frames::report::{GatewayRow, HygieneLine, Losses, RunSummary};
use frames::sink::{SinkLine, SinkSummary};
use testbed::acs::linear::PointingLoop;
use testbed::acs::pointing_error::PointingNoise;
use testbed::estimator::{GyroNoise, MekfCounts};
use testbed::vehicle::Vehicle;

/// A run that has ended, well or not, and everything it ran with.
pub struct RunEnd {
    /// Its instants.
    pub times: RunTimes,
    /// Its heads; at least one.
    pub heads: Vec<RunHead>,
    /// Counts, times and events of the stimulator.
    pub record: RunRecord,
    /// What each port counted.
    pub ports: Vec<PortReading>,
    /// What each head's sink wrote; `None` when it could not finish.
    pub summaries: Vec<Option<SinkSummary>>,
    /// What each sink of each head did, failures included.
    pub sink_lines: Vec<SinkLine>,
    /// What gateways did.
    pub gateways: Vec<GatewayRow>,
    /// What is lost although the run reached its end.
    pub losses: Losses,
    /// What threads asked of the system, and got.
    pub hygiene: Vec<HygieneLine>,
    /// Telemetry summed up, expectations, invariants.
    pub assessment: Assessment,
    /// Every fault and what it hit.
    pub faults: Vec<FaultLine>,
    /// What became of the attitudes that the estimator was given.
    pub estimator: MekfCounts,
    /// Frames that came without a time tag and were not used.
    pub untagged: u64,
    /// What linear theory makes of the tracker's noise: rms error of the boresight's direction, rad.
    pub predicted_pointing_rad: Option<f64>,
    /// Time since the first exposure, s; the run's duration when it ran to its end.
    pub simulated_s: f64,
    /// Why the run ended early, if it did.
    pub error: Option<LoopError>,
}

/// A run seen from outside, over or under way.
pub struct LoopView<'a> {
    /// Counts, times and events of the stimulator.
    pub record: &'a RunRecord,
    /// CRC-32 over each head's frames.
    pub frames_crc32: Vec<u32>,
    /// Telemetry summed up, invariants.
    pub assessment: &'a Assessment,
    /// Every fault and what it hit.
    pub faults: Vec<FaultLine>,
    /// As in [`RunEnd`].
    pub estimator: MekfCounts,
    /// As in [`RunEnd`].
    pub untagged: u64,
    /// As in [`RunEnd`].
    pub predicted_pointing_rad: Option<f64>,
    /// As in [`RunEnd`].
    pub simulated_s: f64,
}

impl RunEnd {
    /// To be reported.
    #[must_use]
    pub fn view(&self) -> LoopView<'_> {
        LoopView {
            record: &self.record,
            frames_crc32: self.summaries.iter().map(|sink| sink.as_ref().map_or(0, |sink| sink.run_crc32)).collect(),
            assessment: &self.assessment,
            faults: self.faults.clone(),
            estimator: self.estimator,
            untagged: self.untagged,
            predicted_pointing_rad: self.predicted_pointing_rad,
            simulated_s: self.simulated_s,
        }
    }

    /// Returns counts, times and events; names of bench and clock and the wall time are the caller's to fill in.
    #[must_use]
    pub fn summary(&self) -> RunSummary {
        let first = &self.heads[0];
        let shown = self.heads.iter().position(|head| head.is_shown).unwrap_or(0);
        let sink = self.summaries.get(shown).and_then(Option::as_ref);
        let mut summary = self.record.summary(&first.engine, &first.receiver, &self.ports, sink);
        summary.sinks = sink_rows(&self.sink_lines);
        summary.losses = self.losses.clone();
        summary.gateways.clone_from(&self.gateways);
        summary
    }

    /// Notes a thread that had ended before the run did, which was seen at `at`.
    pub fn note_lost_thread(&mut self, name: &'static str, at: Tai) {
        let event = crate::runtime::ledger::Event::new(EventKind::ThreadLost, at, None, Span::ZERO);
        self.record.ledger.note(crate::runtime::ledger::Event { what: name, ..event });
        self.losses.note_thread(name);
    }

    /// Whether expectations and invariants hold.
    #[must_use]
    pub fn holds(&self) -> bool {
        let predicted = self.predicted_pointing_rad.map(|rad| rad / base::units::ARCSEC);
        let verdicts = self.assessment.verdicts(predicted, &self.record);
        self.assessment.violations().0 == 0 && verdicts.iter().all(|verdict| verdict.passed)
    }
}

/// What was lost: frames that a sink dropped or refused, sinks that broke down, the reader of stars.
pub(super) fn losses(lines: &[SinkLine], record: &RunRecord) -> Losses {
    let mut losses = Losses::of_sinks(&sink_rows(lines));
    note_lost_reader(&mut losses, &record.ledger);
    losses
}

/// Keeps the first error.
pub(super) fn keep_first(error: &mut Option<LoopError>, next: Option<RunError>) {
    if let (None, Some(next)) = (&error, next) {
        *error = Some(next.into());
    }
}

/// What became of the estimator's attitudes, and frames without a time tag.
pub(super) fn vehicle_counts(vehicle: Option<&Vehicle>) -> (MekfCounts, u64) {
    let untagged = |vehicle: &Vehicle| vehicle.head_reports().map(|report| report.untagged).sum();
    (vehicle.map(Vehicle::estimator_counts).unwrap_or_default(), vehicle.map_or(0, untagged))
}

/// Rms error of the boresight's direction (two axes) in fine pointing, as linear theory has it from the tracker's noise;
/// `None` when nothing is flown or no attitude fell into the window.
pub(super) fn predicted_pointing_rad(
    vehicle: Option<&Vehicle>,
    assessment: &Assessment,
    params: &RunParams,
) -> Option<f64> {
    let (vehicle, nea_rad) = (vehicle?.params(), assessment.nea_rad()?);
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
