//! The motion of a case, and of a mounting that drifts with temperature.
//!
//! The motion of a case -> where the sensor points in each of its frames, and the samples of attitude that a run takes.

use crate::record::turned;
use anyhow::{Result, bail};
use base::time::{Span, Tai};
use base::{axes::Rotation, units::ARCSEC};
use core::f64::consts::{PI, TAU};
use glam::{DQuat, DVec3};
use run::runtime::{PlantAttitude, PlantSample};
use serde::{Deserialize, Serialize};

/// From the edges of an exposure to the samples of attitude around it, at most, s.
pub(crate) const MARGIN_S: f64 = 0.02;
/// Samples of attitude of an exposure with a sine.
const SINE_SAMPLES: u32 = 33;

/// A sine of the line of sight about one axis of the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sine {
    /// Amplitude, a turn about the sensor's axes, rad.
    pub(crate) turn_rad: DVec3,
    /// Frequency, Hz.
    pub(crate) hz: f64,
}

/// The motion of a case.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct CaseMotion {
    /// Rate from each attitude on, sensor axes.
    pub(crate) rate_rad_s: DVec3,
    /// Acceleration along the same axis.
    pub(crate) acceleration_rad_s2: DVec3,
    /// Sine about each attitude, from the start of the case on; without rate and acceleration.
    pub(crate) sine: Option<Sine>,
    /// Drift of the mounting from the start of the case on.
    pub(crate) drift: Option<MountingDrift>,
}

/// The attitude at the start of a frame's period, and its motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pose {
    attitude: DQuat,
    rate_rad_s: DVec3,
    acceleration_rad_s2: DVec3,
    /// With its phase at the start of the frame's period, rad.
    sine: Option<(Sine, f64)>,
}

/// Returns the poses of all frames: at each attitude the motion starts from the beginning.
pub(crate) fn poses(attitudes: &[DQuat], frames: u32, period: Span, motion: &CaseMotion) -> Vec<Pose> {
    let CaseMotion { rate_rad_s: rate, acceleration_rad_s2: acceleration, .. } = *motion;
    let of_frame = |attitude: DQuat, group: usize, number: u32| {
        let t_s = f64::from(number) * period.s();
        let case_s = period.s() * (group as f64 * f64::from(frames) + f64::from(number));
        let attitude = turned(attitude, rate * t_s + acceleration * (0.5 * t_s * t_s));
        let attitude = motion.drift.map_or(attitude, |drift| drift.sensor(attitude, case_s));
        let sine = motion.sine.map(|sine| (sine, TAU * sine.hz * case_s));
        Pose { attitude, rate_rad_s: rate + acceleration * t_s, acceleration_rad_s2: acceleration, sine }
    };
    let groups = attitudes.iter().enumerate();
    groups.flat_map(|(group, attitude)| (0..frames).map(move |number| of_frame(*attitude, group, number))).collect()
}

/// Returns the time from an exposure's edges to the samples around it.
pub(crate) fn margin_s(period: Span, exposure_s: f64) -> f64 {
    MARGIN_S.min(0.2 * (period.s() - exposure_s).max(0.0))
}

/// Returns the instant up to which a run may go before it gets the samples of a frame that begins at `next`: after all of
/// the frame before, and before the first of these.
pub(crate) fn before_samples(next: Tai, period: Span, exposure_s: f64) -> Tai {
    next - Span::from_s(2.0 * margin_s(period, exposure_s))
}

impl Pose {
    /// Returns the attitude a time after the start of the exposure.
    pub(crate) fn at(&self, t_s: f64) -> DQuat {
        let steady = self.rate_rad_s * t_s + self.acceleration_rad_s2 * (0.5 * t_s * t_s);
        let turn =
            self.sine.map_or(steady, |(sine, phase)| steady + sine.turn_rad * (phase + TAU * sine.hz * t_s).sin());
        turned(self.attitude, turn)
    }

    /// Returns the mean attitude over an exposure with a sine; `None` without one, where the middle is near enough.
    pub(crate) fn mean(&self, exposure_s: f64) -> Option<DQuat> {
        let (sine, phase) = self.sine?;
        let angle = TAU * sine.hz * exposure_s;
        let mean = if angle == 0.0 { phase.sin() } else { (phase.cos() - (phase + angle).cos()) / angle };
        Some(turned(self.attitude, sine.turn_rad * mean))
    }

    fn attitude_at(&self, t_s: f64) -> PlantAttitude {
        let mut attitude = PlantAttitude {
            body_from_icrf: Rotation::from_quat(self.at(t_s)),
            rate_rad_s: self.rate_rad_s + self.acceleration_rad_s2 * t_s,
            acceleration_rad_s2: self.acceleration_rad_s2,
        };
        if let Some((sine, phase)) = self.sine {
            let rad_s = TAU * sine.hz;
            let (sin, cos) = (phase + rad_s * t_s).sin_cos();
            attitude.rate_rad_s += sine.turn_rad * (rad_s * cos);
            attitude.acceleration_rad_s2 -= sine.turn_rad * (rad_s * rad_s * sin);
        }
        attitude
    }

    /// Returns samples around an exposure that begins at `start`, where the pose is.
    pub(crate) fn samples(
        &self,
        start: Tai,
        exposure_s: f64,
        period: Span,
    ) -> impl Iterator<Item = PlantSample> + use<> {
        let margin_s = margin_s(period, exposure_s);
        let pose = *self;
        let times: Vec<f64> = if pose.sine.is_some() {
            let step_s = (exposure_s + 2.0 * margin_s) / f64::from(SINE_SAMPLES - 1);
            (0..SINE_SAMPLES).map(|number| f64::from(number) * step_s - margin_s).collect()
        } else {
            vec![-margin_s, 0.5 * exposure_s, exposure_s + margin_s]
        };
        times.into_iter().map(move |t_s| PlantSample {
            attitude: Some(pose.attitude_at(t_s)),
            ..PlantSample::at(start + Span::from_s(t_s))
        })
    }
}

// A mounting that drifts with the temperature of an orbit: the sensor turns away from the axes that it is aligned to.
//
// The drift is `d sin^2(pi t / P)` about the sensor's axes: nothing at the start, where the orbit leaves the shadow, `d`
// half a period later. Frames are drawn at the sensor's own attitude; the truth that a tracker is compared with is
// that of the axes it is aligned to. Tests: below; `thermo_elastic` recovers it.

/// A drift of the mounting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountingDrift {
    /// Largest turn of the sensor, about its axes, arcsec.
    pub arcsec: [f64; 3],
    /// From one start of the drift to the next, s: the period of the orbit.
    pub period_s: f64,
}

/// Largest drift of a mounting.
const MOST_DRIFT_ARCSEC: f64 = 3600.0;

impl MountingDrift {
    /// Refuses a drift that no mounting has.
    ///
    /// # Errors
    /// With the drift and its limits.
    pub fn check(&self) -> Result<()> {
        let is_good =
            self.arcsec.iter().all(|angle| angle.abs() <= MOST_DRIFT_ARCSEC) && (1.0..=1e9).contains(&self.period_s);
        if is_good {
            return Ok(());
        }
        bail!(
            "mounting_drift: got arcsec {:?} and period_s {}, wanted arcsec up to {MOST_DRIFT_ARCSEC} and period_s from 1 to 1e9",
            self.arcsec,
            self.period_s
        )
    }

    /// Returns the turn of the sensor a time after the first exposure, rad.
    pub fn turn_rad(&self, t_s: f64) -> DVec3 {
        let sine = (PI * t_s / self.period_s).sin();
        DVec3::from_array(self.arcsec) * (ARCSEC * sine * sine)
    }

    /// Returns the attitude of the sensor from that of the axes it is aligned to.
    pub fn sensor(&self, aligned: DQuat, t_s: f64) -> DQuat {
        turned(aligned, self.turn_rad(t_s))
    }

    /// Returns the attitude of the axes that the sensor is aligned to from its own.
    pub fn aligned(&self, sensor: DQuat, t_s: f64) -> DQuat {
        turned(sensor, -self.turn_rad(t_s))
    }
}

#[cfg(test)]
mod poses_tests {
    use super::*;
    use crate::record::attitude_error;

    #[test]
    fn a_sine_goes_on_over_frames_and_its_mean_is_that_of_the_exposure() {
        let (hz, turn_rad) = (3.1, DVec3::new(3e-4, 4e-4, 0.0));
        let still = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.86).normalize();
        let motion = CaseMotion { sine: Some(Sine { turn_rad, hz }), ..CaseMotion::default() };
        let all = poses(&[still], 5, Span::from_s(0.2), &motion);
        for (number, pose) in all.iter().enumerate() {
            let sine = |t_s: f64| turn_rad * (TAU * hz * (0.2 * number as f64 + t_s)).sin();
            assert!((attitude_error(pose.at(0.05), still) - sine(0.05)).length() < 1e-14);
            // Written afresh: the mean of many points.
            let points = (0..2000).map(|i| sine(0.1 * (f64::from(i) + 0.5) / 2000.0)).sum::<DVec3>() / 2000.0;
            assert!((attitude_error(pose.mean(0.1).unwrap(), still) - points).length() < 1e-9);
            let (slope, step) = (pose.attitude_at(0.03).rate_rad_s, 1e-5);
            let wanted = (sine(0.03 + step) - sine(0.03 - step)) / (2.0 * step);
            assert!((slope - wanted).length() < 1e-9, "{slope} {wanted}");
        }
        let without = poses(&[still], 1, Span::from_s(0.2), &CaseMotion::default());
        assert!(without[0].mean(0.1).is_none());
        let samples = |pose: &Pose| pose.samples(Tai::from_ns(0), 0.1, Span::from_s(0.2)).count();
        assert_eq!([samples(&without[0]), samples(&all[0])], [3, 33]);
    }

    #[test]
    fn a_run_stops_between_the_samples_of_two_frames() {
        for (period_s, exposure_s) in [(0.5, 0.1), (0.2, 0.1), (0.11, 0.1), (10.0, 0.1)] {
            let (period, zero) = (Span::from_s(period_s), Tai::from_ns(0));
            let all = poses(&[DQuat::IDENTITY], 2, period, &CaseMotion::default());
            let times = |number: usize| -> Vec<Tai> {
                let start = zero + Span::from_s(period_s * number as f64);
                all[number].samples(start, exposure_s, period).map(|sample| sample.at).collect()
            };
            let stop = before_samples(zero + period, period, exposure_s);
            assert!(times(0).iter().all(|at| *at < stop), "{period_s}");
            assert!(times(1).iter().all(|at| *at > stop), "{period_s}");
        }
    }

    #[test]
    fn a_mounting_drifts_with_the_time_of_the_case_not_of_the_attitude() {
        let drift = MountingDrift { arcsec: [20.0, 0.0, 0.0], period_s: 40.0 };
        let motion = CaseMotion { drift: Some(drift), ..CaseMotion::default() };
        let all = poses(&[DQuat::IDENTITY; 10], 2, Span::from_s(1.0), &motion);
        for (number, pose) in all.iter().enumerate() {
            let turn = attitude_error(pose.at(0.0), DQuat::IDENTITY);
            assert!((turn - drift.turn_rad(number as f64)).length() < 1e-12, "{number}");
        }
    }
}

#[cfg(test)]
mod mounting_tests {
    use super::*;
    use crate::record::attitude_error;

    #[test]
    fn the_drift_is_largest_after_half_a_period_and_comes_off_again() {
        let drift = MountingDrift { arcsec: [20.0, -10.0, 60.0], period_s: 5400.0 };
        let largest = DVec3::new(20.0, -10.0, 60.0) * ARCSEC;
        assert!((drift.turn_rad(2700.0) - largest).length() < 1e-15);
        assert!((drift.turn_rad(1350.0) - 0.5 * largest).length() < 1e-15 && drift.turn_rad(0.0) == DVec3::ZERO);
        let aligned = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.86).normalize();
        let sensor = drift.sensor(aligned, 2700.0);
        assert!((attitude_error(sensor, aligned) - largest).length() < 1e-15);
        assert!(attitude_error(drift.aligned(sensor, 2700.0), aligned).length() < 1e-15);
    }
}
