//! What a closed loop came to, over or under way, and what linear theory says it should have come to.

use crate::runtime::{RunParams, RunRecord};
use crate::wiring::assessment::Assessment;
use crate::wiring::faults::FaultLine;
use frames::sink::{SinkLine, SinkSummary};
use testbed::acs::linear::PointingLoop;
use testbed::acs::pointing_error::PointingNoise;
use testbed::estimator::{GyroNoise, MekfCounts};
use testbed::vehicle::Vehicle;

/// What stands after a run.
pub struct LoopOutcome {
    /// Counts, times and events of the stimulator.
    pub record: RunRecord,
    /// What each head's sink wrote.
    pub sinks: Vec<SinkSummary>,
    /// What each sink of each head did.
    pub sink_lines: Vec<SinkLine>,
    /// Telemetry summed up, invariants.
    pub assessment: Assessment,
    /// Every fault and what it hit.
    pub faults: Vec<FaultLine>,
    /// What became of the attitudes that the estimator was given.
    pub estimator: MekfCounts,
    /// Frames that came without a time tag and were not used.
    pub untagged: u64,
    /// What linear theory makes of the tracker's noise: rms error of the boresight's direction, rad.
    pub predicted_pointing_rad: Option<f64>,
    /// Simulated time since the first exposure, s; the scenario's duration when it ran to its end.
    pub simulated_s: f64,
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
    /// As in [`LoopOutcome`].
    pub estimator: MekfCounts,
    /// As in [`LoopOutcome`].
    pub untagged: u64,
    /// As in [`LoopOutcome`].
    pub predicted_pointing_rad: Option<f64>,
    /// As in [`LoopOutcome`].
    pub simulated_s: f64,
}

impl LoopOutcome {
    /// To be reported.
    #[must_use]
    pub fn view(&self) -> LoopView<'_> {
        LoopView {
            record: &self.record,
            frames_crc32: self.sinks.iter().map(|sink| sink.run_crc32).collect(),
            assessment: &self.assessment,
            faults: self.faults.clone(),
            estimator: self.estimator,
            untagged: self.untagged,
            predicted_pointing_rad: self.predicted_pointing_rad,
            simulated_s: self.simulated_s,
        }
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
