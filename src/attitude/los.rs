//! The line of sight during one exposure: what `attitude` hands to `exposure`.

use crate::base::axes::{Icrf, Rotation, Sensor};
use crate::base::time::{Span, Tai};
use glam::DVec3;

/// Where the attitude of an exposure came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathOrigin {
    /// Between two received samples.
    Interpolated,
    /// Beyond the last received sample, by its rate and acceleration.
    Predicted,
    /// The stream stopped: last attitude held by policy.
    Held,
    /// Given by the user (`render`), not by a bus.
    Commanded,
    /// Nothing received yet: no attitude at all.
    Absent,
}

/// One line of a jitter spectrum: `amplitude_rad * sin(2 pi frequency_hz t + phase_rad)` with t in seconds TAI
/// since the track's `lines_epoch`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterLine {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Rotation vector amplitude, sensor axes, rad.
    pub amplitude_rad: DVec3,
    /// Phase at the epoch, rad.
    pub phase_rad: f64,
}

/// One sample of measured or received jitter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterPoint {
    /// Instant of the sample.
    pub at: Tai,
    /// Rotation vector of the sensor axes away from the smooth attitude, sensor axes, rad.
    pub rotation_rad: DVec3,
}

/// Motion on top of the smooth quadratic: spectral lines plus a polyline through samples (received jitter, and what
/// of the attitude's own motion a quadratic cannot follow).
#[derive(Debug, Clone, PartialEq)]
pub struct JitterTrack {
    /// Spectral lines.
    pub lines: Vec<JitterLine>,
    /// Instant at which the lines' phases hold.
    pub lines_epoch: Tai,
    /// Samples in time order, linear between them, held beyond both ends. Empty: none.
    pub points: Vec<JitterPoint>,
}

/// Line of sight of one exposure: smooth motion about mid-exposure, and jitter.
#[derive(Debug, Clone, PartialEq)]
pub struct LosPath {
    /// First instant of the exposure.
    pub exposure_start: Tai,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Attitude at mid-exposure without jitter.
    pub mid_sensor_from_icrf: Rotation<Sensor, Icrf>,
    /// Rate at mid-exposure, sensor axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Acceleration, sensor axes, rad/s^2.
    pub acceleration_rad_s2: DVec3,
    /// Jitter during the exposure.
    pub jitter: JitterTrack,
    /// How the attitude was had.
    pub origin: PathOrigin,
    /// Mid-exposure minus the epoch of the newest sample used (negative when interpolated).
    pub horizon: Span,
}

impl JitterTrack {
    /// No jitter.
    #[must_use]
    pub fn none() -> Self {
        Self { lines: Vec::new(), lines_epoch: Tai::from_ns(0), points: Vec::new() }
    }

    /// No jitter, and room for so many lines and received points, and for the knots of a long exposure.
    #[must_use]
    pub fn with_capacity(lines: usize, points: usize) -> Self {
        let points = Vec::with_capacity(points + super::residual::KNOTS_MAX);
        Self { lines: Vec::with_capacity(lines), lines_epoch: Tai::from_ns(0), points }
    }

    /// True when there is nothing to integrate.
    #[must_use]
    pub fn is_still(&self) -> bool {
        self.lines.is_empty() && self.points.is_empty()
    }

    /// Highest line frequency, Hz (0 without lines).
    #[must_use]
    pub fn highest_line_hz(&self) -> f64 {
        self.lines.iter().fold(0.0, |highest, line| line.frequency_hz.max(highest))
    }

    /// Rotation vector of the sensor axes at `at`, sensor axes, rad.
    #[must_use]
    pub fn rotation_at(&self, at: Tai) -> DVec3 {
        let t_s = (at - self.lines_epoch).s();
        let lines = self.lines.iter().fold(DVec3::ZERO, |sum, line| {
            // Whole turns go first: f64 keeps 1e-16 of one turn, not of a million.
            let turns = (line.frequency_hz * t_s).fract();
            sum + line.amplitude_rad * (core::f64::consts::TAU * turns + line.phase_rad).sin()
        });
        lines + polyline_at(&self.points, at)
    }
}

pub(super) fn polyline_at(points: &[JitterPoint], at: Tai) -> DVec3 {
    let after = points.partition_point(|point| point.at <= at);
    match (after.checked_sub(1).and_then(|i| points.get(i)), points.get(after)) {
        (Some(a), Some(b)) => {
            let share = (at - a.at).s() / (b.at - a.at).s();
            a.rotation_rad.lerp(b.rotation_rad, share)
        }
        (Some(only), None) | (None, Some(only)) => only.rotation_rad,
        (None, None) => DVec3::ZERO,
    }
}

impl LosPath {
    /// A line of sight that stands still, as the user commanded it.
    #[must_use]
    pub fn commanded(sensor_from_icrf: Rotation<Sensor, Icrf>, exposure_start: Tai, exposure_s: f64) -> Self {
        Self {
            exposure_start,
            exposure_s,
            mid_sensor_from_icrf: sensor_from_icrf,
            rate_rad_s: DVec3::ZERO,
            acceleration_rad_s2: DVec3::ZERO,
            jitter: JitterTrack::none(),
            origin: PathOrigin::Commanded,
            horizon: Span::ZERO,
        }
    }

    /// The instant in the middle of the exposure.
    #[must_use]
    pub fn mid_exposure(&self) -> Tai {
        self.exposure_start + Span::from_s(0.5 * self.exposure_s)
    }

    /// Smooth rotation vector away from mid-exposure, `t_s` seconds from mid-exposure, sensor axes, rad:
    /// `w t + a t^2 / 2` (error: commutation `|w x a| t^3 / 12`, and the jerk).
    #[must_use]
    pub fn smooth_rotation_rad(&self, t_s: f64) -> DVec3 {
        self.rate_rad_s * t_s + self.acceleration_rad_s2 * (0.5 * t_s * t_s)
    }

    /// Jitter rotation vector `t_s` seconds from mid-exposure, sensor axes, rad.
    #[must_use]
    pub fn jitter_rotation_rad(&self, t_s: f64) -> DVec3 {
        self.jitter.rotation_at(self.mid_exposure() + Span::from_s(t_s))
    }
}
