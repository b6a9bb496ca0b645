//! The part of the attitude's motion that the quadratic of a [`LosPath`](super::LosPath) cannot follow, added to its
//! polyline.
//!
//! Input: the estimated attitude over the exposure. Output: knots in the jitter track. Short exposures need none; a
//! long one under attitude control (a 1 s exposure, a 2 Hz limit cycle) has most of its motion here. The knots are
//! close enough that straight lines between them miss a residual of one or two lobes by less than the tolerance (a sine
//! of amplitude R over 1.5 periods in K segments misses by `R (3 pi / K)^2 / 8`; K = 4 sqrt(R / tolerance) gives 0.7
//! tolerances); `long_exposures_follow_a_limit_cycle` checks it.

use crate::attitude::los::{JitterPoint, JitterTrack, polyline_at};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use glam::DVec3;

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
