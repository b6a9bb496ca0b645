//! The line of sight during one exposure: the output of `attitude` and input of `exposure`.
//!
//! *Residual.* The part of the attitude's motion that the quadratic of a [`LosPath`] cannot follow, added to its
//! polyline.
//!
//! Input: the estimated attitude over the exposure. Output: knots in the jitter track. Short exposures need none; a
//! long one under attitude control (a 1 s exposure, a 2 Hz limit cycle) has most of its motion here. The knots are
//! close enough that straight lines between them miss a residual of one or two lobes by less than the tolerance (a sine
//! of amplitude R over 1.5 periods in K segments misses by `R (3 pi / K)^2 / 8`; K = 4 sqrt(R / tolerance) gives 0.7
//! tolerances); `long_exposures_follow_a_limit_cycle` checks it.

use base::axes::{Icrf, Rotation, Sensor};
pub use base::drawn::PathOrigin;
use base::sines::sines_of_turns;
use base::time::{Span, Tai};
use base::units::ARCSEC;
use glam::DVec3;

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

/// Motion on top of the smooth quadratic: spectral lines plus a polyline through samples (received jitter, and the part
/// of the attitude's own motion that a quadratic cannot follow).
#[derive(Debug, Clone, PartialEq)]
pub struct JitterTrack {
    /// Spectral lines.
    pub lines: Vec<JitterLine>,
    /// Instant to which the lines' phases refer.
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
    /// Origin of the attitude.
    pub origin: PathOrigin,
    /// Mid-exposure minus the epoch of the newest sample used (negative when interpolated).
    pub horizon: Span,
}

impl LosPath {
    /// Copies `from` into the existing buffers.
    pub fn copy_from(&mut self, from: &Self) {
        let mut jitter = core::mem::replace(&mut self.jitter, JitterTrack::none());
        jitter.lines.clone_from(&from.jitter.lines);
        jitter.points.clone_from(&from.jitter.points);
        jitter.lines_epoch = from.jitter.lines_epoch;
        *self = Self { jitter, ..*from };
    }
}

impl JitterTrack {
    /// Returns a track without jitter.
    pub fn none() -> Self {
        Self { lines: Vec::new(), lines_epoch: Tai::from_ns(0), points: Vec::new() }
    }

    /// Returns true without jitter to integrate.
    pub fn is_still(&self) -> bool {
        self.lines.is_empty() && self.points.is_empty()
    }

    /// Returns the highest frequency, Hz, of the lines that are not negligible (0 without lines): quadrature must
    /// resolve it.
    pub fn highest_line_hz(&self) -> f64 {
        let moving = self.lines.iter().filter(|line| line.amplitude_rad.abs().max_element() > NEGLIGIBLE_RAD);
        moving.fold(0.0, |highest, line| line.frequency_hz.max(highest))
    }

    /// Returns the rotation vector of the sensor axes at `at`, sensor axes, rad.
    pub fn rotation_at(&self, at: Tai) -> DVec3 {
        let t_s = (at - self.lines_epoch).s();
        let turns = |line: &JitterLine| line.frequency_hz * t_s + line.phase_rad * (1.0 / core::f64::consts::TAU);
        let mut sum = DVec3::ZERO;
        let groups = self.lines.chunks_exact(LANES);
        for line in groups.remainder() {
            sum += line.amplitude_rad * sines_of_turns([turns(line)])[0];
        }
        for group in groups {
            let sines = sines_of_turns::<LANES>(core::array::from_fn(|i| turns(&group[i])));
            for (line, sine) in group.iter().zip(sines) {
                sum += line.amplitude_rad * sine;
            }
        }
        sum + polyline_at(&self.points, at)
    }
}

/// Amplitude below which lines need no nodes of their own, rad (1e-5 arcsec): a table full of them is 2e-3 arcsec.
const NEGLIGIBLE_RAD: f64 = 5e-11;
/// Number of lines whose sines are computed together: a loop over an array of this length becomes vector instructions.
const LANES: usize = 4;

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
    /// Returns a static line of sight, as commanded by the user.
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

    /// Returns the instant in the middle of the exposure.
    pub fn mid_exposure(&self) -> Tai {
        self.exposure_start + Span::from_s(0.5 * self.exposure_s)
    }

    /// Returns the smooth rotation vector away from mid-exposure, `t_s` seconds from mid-exposure, sensor axes, rad:
    /// `w t + a t^2 / 2` (error: commutation `|w x a| t^3 / 12`, and the jerk).
    pub fn smooth_rotation_rad(&self, t_s: f64) -> DVec3 {
        self.rate_rad_s * t_s + self.acceleration_rad_s2 * (0.5 * t_s * t_s)
    }

    /// Returns the jitter rotation vector `t_s` seconds from mid-exposure, sensor axes, rad.
    pub fn jitter_rotation_rad(&self, t_s: f64) -> DVec3 {
        self.jitter.rotation_at(self.mid_exposure() + Span::from_s(t_s))
    }
}

/// Largest number of knots added to one exposure.
pub(super) const KNOTS_MAX: usize = 129;
/// Number of probes for the size of the residual: six per lobe of a cubic or quartic one.
const PROBES: i32 = 24;
/// Residual below which no knots are added: a tenth of the default line-of-sight budget.
pub(super) const RESIDUAL_TOLERANCE_RAD: f64 = 0.01 * ARCSEC;

/// Returns the largest residual, rad, among equally spaced probes from `from` to `until`.
pub(super) fn largest_rad(from: Tai, until: Tai, residual_at: impl Fn(Tai) -> DVec3) -> f64 {
    let probe_s = (until - from).s() / f64::from(PROBES);
    let probe = |i: i32| residual_at(from + Span::from_s(probe_s * f64::from(i))).length();
    (0..=PROBES).map(probe).fold(0.0, f64::max)
}

/// Adds the residual to the track's polyline: at the track's own points, and at as many knots as `largest_rad` needs.
pub(super) fn add_knots(
    track: &mut JitterTrack,
    from: Tai,
    until: Tai,
    largest_rad: f64,
    residual_at: impl Fn(Tai) -> DVec3,
) {
    let segments = segments_for(largest_rad);
    let received = track.points.len();
    for i in 0..=segments {
        let at = from + Span::from_s((until - from).s() * i as f64 / segments as f64);
        let jitter_rad = polyline_at(&track.points[..received], at);
        track.points.push(JitterPoint { at, rotation_rad: jitter_rad + residual_at(at) });
    }
    for point in &mut track.points[..received] {
        point.rotation_rad += residual_at(point.at.clamp(from, until));
    }
    track.points.sort_unstable_by_key(|point| point.at);
    track.points.dedup_by_key(|point| point.at);
}

fn segments_for(largest_rad: f64) -> usize {
    let wanted = 4.0 * (largest_rad / RESIDUAL_TOLERANCE_RAD).sqrt();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 8..=128 first")]
    let segments = wanted.ceil().clamp(8.0, (KNOTS_MAX - 1) as f64) as usize;
    segments
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    #[test]
    fn lines_add_up_with_their_phases() {
        let line = |frequency_hz, phase_rad| JitterLine { frequency_hz, amplitude_rad: DVec3::X, phase_rad };
        let lines_epoch = Tai::from_ns(1_000);
        let track = JitterTrack { lines: vec![line(2.0, 0.5), line(31.0, -2.0)], lines_epoch, points: Vec::new() };
        for t_s in [-1.0, 0.0, 0.123, 40.0] {
            let wanted = (TAU * 2.0 * t_s + 0.5_f64).sin() + (TAU * 31.0 * t_s - 2.0_f64).sin();
            let found = track.rotation_at(lines_epoch + Span::from_s(t_s)).x;
            assert!((found - wanted).abs() < 1e-11, "{found} for {wanted} at {t_s} s");
        }
        assert!((track.highest_line_hz() - 31.0).abs() < 1e-12);
    }
}
