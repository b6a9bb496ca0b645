//! Sensitivity of the loop over pixels to latency and jitter, compared with linear theory.
//!
//! In: a scenario (its camera, bus, spacecraft and control; durations and injections are the study's). Out: points with
//! values measured on the true attitude, theoretical values and whether they agree ([`StudyPoint`]), a table, CSV and
//! charts. Every point is a separate run of [`run::wiring::stepped::SteppedRun`] on the CPU, so points run in parallel
//! and the result does not depend on their number.
//!
//! Assumptions: theory is one rigid axis with small angles ([`theory`]); flexible modes lie well above the bandwidth.
//! Tour: [`theory`] (expected values), [`trial`] (one run; sines in a record, margins and rejection, pointing error, time
//! tags, beyond the margin), [`point`] (charts, table). Tests: `tests`, `tests/closed_loop/study.rs`.

use base::refused::Refused;

pub mod point;
#[cfg(test)]
mod tests;
pub mod theory;
pub mod trial;

pub use point::{Agreement, StudyPoint};
pub use trial::{POINTING_SHARE, TAG_SHARE};

use crate::chart::File;
use config::{Scenario, StartTime};
use core::f64::consts::TAU;
use core::sync::atomic::{AtomicUsize, Ordering};
use rayon::prelude::*;
use run::wiring::{error::LoopError, vehicle_parts::vehicle_params};
use testbed::vehicle::VehicleParams;
use theory::LoopOnPaper;
use trial::{Injection, Latency, at_rest};

/// Factor on the delay margin at which the loop must lose the target.
const BEYOND: f64 = 1.25;

/// Scope of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Effort {
    /// Actuation delays for phase margin and error, as shares of the delay margin.
    pub shares: Vec<f64>,
    /// Tracker delays for the error, s.
    pub tracker_delays_s: Vec<f64>,
    /// Tracker delay at which the phase margin is also measured, s.
    pub margin_tracker_delay_s: f64,
    /// Jitter frequencies as multiples of the crossover, one run per group.
    pub jitter: Vec<Vec<f64>>,
    /// Time tag errors, s.
    pub tag_errors_s: Vec<f64>,
    /// Length of the records of a margin, in units of ten periods of the crossover.
    pub repeats: u32,
    /// Length of the record of a pointing error, s.
    pub noise_s: f64,
    /// Seeds per pointing error.
    pub seeds: u64,
}

impl Effort {
    /// Returns the full scope, for charts.
    pub fn full() -> Self {
        Self {
            shares: vec![0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
            tracker_delays_s: vec![0.05, 0.25, 0.5, 1.0, 1.5],
            margin_tracker_delay_s: 1.5,
            jitter: vec![
                vec![0.04, 0.08, 0.12, 0.16],
                vec![0.1, 0.2, 0.3, 0.4],
                vec![0.25, 0.5, 0.75, 1.0],
                vec![0.6, 0.9, 1.2, 1.6],
                vec![1.4, 2.0, 2.8, 4.0],
                vec![3.4, 5.0, 7.0, 14.0],
                vec![8.0, 10.0, 12.0, 20.0],
            ],
            tag_errors_s: vec![-0.1, 0.02, 0.05],
            repeats: 2,
            noise_s: 1000.0,
            seeds: 3,
        }
    }

    /// Returns a scope of less than half a minute on two cores.
    pub fn quick() -> Self {
        Self {
            shares: vec![0.0, 0.4, 0.8],
            tracker_delays_s: vec![1.0],
            margin_tracker_delay_s: 1.0,
            jitter: vec![vec![0.2, 0.4, 0.6, 0.8], vec![0.9, 1.8, 3.6]],
            tag_errors_s: vec![0.05],
            repeats: 1,
            noise_s: 600.0,
            seeds: 1,
        }
    }
}

/// A study: a scenario and its theoretical loop.
#[derive(Debug, Clone)]
pub struct Study {
    scenario: Scenario,
    effort: Effort,
    vehicle: VehicleParams,
    /// The theoretical loop.
    pub paper: LoopOnPaper,
    crossover_rad_s: f64,
    control_period_s: f64,
    step_s: f64,
    frame_period_s: f64,
    frame_latency_s: f64,
}

/// Results of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Studied {
    /// Every point.
    pub points: Vec<StudyPoint>,
    /// Table and charts.
    pub files: Vec<File>,
    /// The table for a terminal.
    pub summary: String,
}

impl Studied {
    /// Returns true when no point was outside its tolerance.
    pub fn is_met(&self) -> bool {
        self.points.iter().all(|point| point.verdict != Agreement::NotMet)
    }
}

/// One part of the work.
#[derive(Debug, Clone, PartialEq)]
enum Part {
    Margin(Latency),
    Rejection(Vec<f64>),
    Error(Latency),
    Tag(f64),
    Beyond(f64),
}

impl Study {
    /// Returns a study of a scenario.
    ///
    /// # Errors
    /// When its control has no crossover.
    pub fn new(scenario: &Scenario, effort: Effort) -> Result<Self, Refused> {
        let still = at_rest(scenario, 1.0, 1.0, &Injection::NONE);
        let at = match still.bench.timing.start {
            StartTime::At(at) => at,
            StartTime::Now | StartTime::Plant => base::time::Tai::from_ns(0),
        };
        let vehicle = vehicle_params(
            &still,
            still.vehicle().ok_or_else(|| {
                Refused("got a run without a spacecraft; wanted one whose control can be studied".to_owned())
            })?,
            at,
        );
        let paper = LoopOnPaper::of(&vehicle);
        let exposure = &scenario.bench.camera.exposure;
        Ok(Self {
            crossover_rad_s: paper.crossover_rad_s().ok_or_else(|| {
                Refused(
                    "the control's gain is one at no frequency: wanted a fine pointing loop within its control period"
                        .to_owned(),
                )
            })?,
            control_period_s: vehicle.acs.control_period.s(),
            step_s: vehicle.spacecraft.step.s(),
            frame_period_s: 1.0 / scenario.bench.timing.frame_rate_hz,
            frame_latency_s: 0.5 * exposure.exposure_s + exposure.readout_s,
            scenario: scenario.clone(),
            effort,
            vehicle,
            paper,
        })
    }

    /// Returns the highest frequency at which theory is checked, the crossover, Hz.
    pub fn bandwidth_hz(&self) -> f64 {
        self.crossover_rad_s / TAU
    }

    /// Measures everything; calls `announce` after every part with the number done, the number of all, and its name.
    ///
    /// # Errors
    /// When a run fails.
    pub fn run(&self, announce: &(dyn Fn(usize, usize, &str) + Sync)) -> Result<Studied, Refused> {
        let parts = self.parts();
        let done = AtomicUsize::new(0);
        let measure = |part: &Part| {
            let name = part.name();
            let points = self.measure(part).map_err(|why| Refused(format!("{name}: {why}")))?;
            announce(done.fetch_add(1, Ordering::Relaxed) + 1, parts.len(), &name);
            Ok(points)
        };
        let found: Result<Vec<Vec<StudyPoint>>, Refused> = parts.par_iter().map(measure).collect();
        let mut points = found?.concat();
        points.extend(trial::delay_margin(self, &points));
        Ok(Studied { files: point::files(self, &points)?, summary: point::table(&points), points })
    }

    /// Returns the parts of the work, longest first.
    fn parts(&self) -> Vec<Part> {
        let effort = &self.effort;
        let margin_s = self.paper.delay_margin_s().unwrap_or(0.0);
        let delays: Vec<Latency> =
            effort.shares.iter().map(|share| Latency::Actuation(rounded_to(self.step_s, share * margin_s))).collect();
        let late = effort.tracker_delays_s.iter().map(|s| Latency::Tracker(*s));
        let in_hz = |group: &Vec<f64>| Part::Rejection(group.iter().map(|share| share * self.bandwidth_hz()).collect());
        let mut parts: Vec<Part> = delays.iter().copied().chain(late).map(Part::Error).collect();
        parts.extend(effort.jitter.iter().map(in_hz));
        parts.extend(delays.iter().copied().map(Part::Margin));
        parts.push(Part::Margin(Latency::Tracker(effort.margin_tracker_delay_s)));
        parts.push(Part::Beyond(BEYOND));
        parts.extend(effort.tag_errors_s.iter().copied().map(Part::Tag));
        parts
    }

    fn measure(&self, part: &Part) -> Result<Vec<StudyPoint>, LoopError> {
        match part {
            Part::Margin(latency) => trial::margin(self, *latency),
            Part::Rejection(frequencies_hz) => trial::rejection(self, frequencies_hz),
            Part::Error(latency) => trial::pointing_error(self, *latency),
            Part::Tag(tag_s) => trial::tag_error(self, *tag_s),
            Part::Beyond(times) => trial::beyond(self, *times),
        }
    }

    /// Returns the mounting of the first head.
    fn head(&self) -> glam::DQuat {
        self.scenario.bench.sensor_from_body.quat()
    }

    fn slew_acceleration_rad_s2(&self) -> f64 {
        self.vehicle.acs.slew.largest_acceleration_rad_s2
    }
}

impl Part {
    fn name(&self) -> String {
        let of = |latency: &Latency| {
            let (varied, value) = latency.varied();
            format!("{varied} {value:.0}")
        };
        match self {
            Self::Margin(latency) => format!("phase margin, {}", of(latency)),
            Self::Rejection(hz) => format!("jitter from {:.4} Hz", hz.first().copied().unwrap_or(0.0)),
            Self::Error(latency) => format!("pointing error, {}", of(latency)),
            Self::Tag(tag_s) => format!("time tags wrong by {:.0} ms", tag_s * 1e3),
            Self::Beyond(times) => format!("delay of {times} times the margin"),
        }
    }
}

/// Returns the nearest multiple of `unit`.
pub(crate) fn rounded_to(unit: f64, value: f64) -> f64 {
    (value / unit).round() * unit
}
