//! The attitude at any instant: interpolated inside the history, predicted beyond it, held when the stream stopped.
//!
//! Nothing falls back silently: [`PathOrigin`] states the method used, and blank or stop are explicit decisions.

use crate::attitude::predict::{AttitudeState, held_state, predict};
use crate::attitude::{error::AttitudeError, history::AttitudeHistory, interpolate::interpolate, los::PathOrigin};
use base::time::{Span, Tai};

/// Policy for a stopped stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StalePolicy {
    /// Continue from the last attitude while the rate decays.
    Hold,
    /// Show no stars.
    Blank,
    /// Send no frame.
    Drop,
    /// Stop the run.
    Stop,
}

/// Time limits for the use of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EstimateLimits {
    /// Age of the newest sample beyond which the policy applies.
    pub stale_after: Span,
    /// Policy beyond that age.
    pub policy: StalePolicy,
    /// Longest horizon over which the acceleration is used; the rate alone after that.
    pub max_horizon: Span,
    /// Time constant of the rate's decay while holding.
    pub rate_decay: Span,
}

impl Default for EstimateLimits {
    /// Returns 500 ms (five missed samples of a slow 10 Hz stream), no frame after that, acceleration for 200 ms, decay
    /// over 200 ms.
    fn default() -> Self {
        Self {
            stale_after: Span::from_ms(500),
            policy: StalePolicy::Drop,
            max_horizon: Span::from_ms(200),
            rate_decay: Span::from_ms(200),
        }
    }
}

/// The attitude at one instant and where it came from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatedAttitude {
    /// Attitude, rate, acceleration.
    pub state: AttitudeState,
    /// `Interpolated`, `Predicted` or `Held`.
    pub origin: PathOrigin,
    /// The instant minus the epoch of the newest sample used: negative when interpolated.
    pub horizon: Span,
    /// Time between the two samples used (zero when only one was).
    pub gap: Span,
}

/// Decision of the policy for one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// Show the attitude (which may be held).
    Show,
    /// Show no stars: the newest sample is this old.
    Blank {
        /// Age of the newest sample.
        age: Span,
    },
    /// Send no frame: the newest sample is this old.
    Drop {
        /// Age of the newest sample.
        age: Span,
    },
    /// Stop: the newest sample is this old.
    Stop {
        /// Age of the newest sample.
        age: Span,
    },
}

/// Applies the policy to an attitude at mid-exposure.
pub fn decide(estimated: &EstimatedAttitude, policy: StalePolicy) -> Decision {
    if estimated.origin != PathOrigin::Held {
        return Decision::Show;
    }
    match policy {
        StalePolicy::Hold => Decision::Show,
        StalePolicy::Blank => Decision::Blank { age: estimated.horizon },
        StalePolicy::Drop => Decision::Drop { age: estimated.horizon },
        StalePolicy::Stop => Decision::Stop { age: estimated.horizon },
    }
}

/// Returns the attitude at `at`. Beyond `stale_after` it is `Held` for every policy ([`decide`] applies the policy).
///
/// # Errors
/// When nothing was received yet, or when `at` is before everything the history contains.
pub fn state_at(
    history: &AttitudeHistory,
    at: Tai,
    limits: &EstimateLimits,
) -> Result<EstimatedAttitude, AttitudeError> {
    match history.around(at) {
        (Some(only), _) if only.at == at => {
            let origin = if history.newest().is_some_and(|newest| newest.at > at) {
                PathOrigin::Interpolated
            } else {
                PathOrigin::Predicted
            };
            Ok(EstimatedAttitude { state: only.into(), origin, horizon: Span::ZERO, gap: Span::ZERO })
        }
        (Some(earlier), Some(later)) => Ok(EstimatedAttitude {
            state: interpolate(earlier, later, at),
            origin: PathOrigin::Interpolated,
            horizon: at - later.at,
            gap: later.at - earlier.at,
        }),
        (Some(newest), None) => Ok(beyond(&newest.into(), at, limits)),
        (None, Some(oldest)) => Err(AttitudeError::BeforeHistory { at, oldest: oldest.at }),
        (None, None) => Err(AttitudeError::NoSamples { at }),
    }
}

fn beyond(newest: &AttitudeState, at: Tai, limits: &EstimateLimits) -> EstimatedAttitude {
    let horizon = at - newest.at;
    let (state, origin) = if horizon <= limits.stale_after {
        (predict(newest, at, limits.max_horizon), PathOrigin::Predicted)
    } else {
        let last = predict(newest, newest.at + limits.stale_after, limits.max_horizon);
        (held_state(&last, at, limits.rate_decay), PathOrigin::Held)
    };
    EstimatedAttitude { state, origin, horizon, gap: Span::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{history::AttitudeSample, ring::HistoryLimits};
    use base::axes::Rotation;
    use glam::DVec3;

    /// Largest difference of two estimates 1 ns apart on a motion of 0.05 rad/s: 5e-11 rad, and rounding.
    const CONTINUITY_RAD: f64 = 1e-10;

    fn ms(t_ms: i64) -> Tai {
        Tai::from_ns(t_ms * 1_000_000)
    }

    /// Returns a constant spin sampled every 10 ms from 0 to 100 ms.
    fn spinning() -> AttitudeHistory {
        let mut history = AttitudeHistory::new(HistoryLimits::default());
        let rate_rad_s = DVec3::new(0.0, 0.03, 0.04);
        for i in 0..=10_u8 {
            let at = ms(10 * i64::from(i));
            let body_from_icrf = Rotation::from_rotation_vector(rate_rad_s * (0.01 * f64::from(i)));
            let sample = AttitudeSample { at, seq: i, body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO };
            history.insert(sample, at).expect("in order");
        }
        history
    }

    fn estimate(at: Tai) -> EstimatedAttitude {
        state_at(&spinning(), at, &EstimateLimits::default()).expect("inside or after the history")
    }

    #[test]
    fn origin_and_horizon_say_what_was_done() {
        let reported = |at| (estimate(at).origin, estimate(at).horizon.ns() / 1_000_000);
        assert_eq!(reported(ms(45)), (PathOrigin::Interpolated, -5));
        assert_eq!(reported(ms(50)), (PathOrigin::Interpolated, 0));
        assert_eq!(reported(ms(100)), (PathOrigin::Predicted, 0));
        assert_eq!(reported(ms(150)), (PathOrigin::Predicted, 50));
        assert_eq!(reported(ms(600)), (PathOrigin::Predicted, 500));
        assert_eq!(reported(ms(601)), (PathOrigin::Held, 501));
        assert_eq!(estimate(ms(45)).gap, Span::from_ms(10));
    }

    #[test]
    fn attitude_is_continuous_across_every_border() {
        for border in [ms(50), ms(100), ms(300), ms(600)] {
            let [a, b] = [border, border + Span::from_ns(1)].map(|at| estimate(at).state.body_from_icrf);
            let step = a.rotation_vector_to(&b).length();
            assert!(step < CONTINUITY_RAD, "{step} rad at {} ms", border.ns() / 1_000_000);
        }
    }

    #[test]
    fn blank_drop_and_stop_are_decided_only_when_stale() {
        let (fresh, stale) = (estimate(ms(400)), estimate(ms(700)));
        for policy in [StalePolicy::Hold, StalePolicy::Blank, StalePolicy::Drop, StalePolicy::Stop] {
            assert_eq!(decide(&fresh, policy), Decision::Show, "{policy:?}");
        }
        assert_eq!(decide(&stale, StalePolicy::Hold), Decision::Show);
        assert_eq!(decide(&stale, StalePolicy::Blank), Decision::Blank { age: Span::from_ms(600) });
        assert_eq!(decide(&stale, StalePolicy::Drop), Decision::Drop { age: Span::from_ms(600) });
        assert_eq!(decide(&stale, StalePolicy::Stop), Decision::Stop { age: Span::from_ms(600) });
    }

    #[test]
    fn no_samples_and_too_early_are_errors() {
        let empty = AttitudeHistory::new(HistoryLimits::default());
        let limits = EstimateLimits::default();
        assert_eq!(state_at(&empty, ms(1), &limits), Err(AttitudeError::NoSamples { at: ms(1) }));
        let early = state_at(&spinning(), ms(-1), &limits);
        assert_eq!(early, Err(AttitudeError::BeforeHistory { at: ms(-1), oldest: ms(0) }));
    }

    #[test]
    fn a_gap_of_100_ms_is_bridged_and_reported() {
        let mut history = AttitudeHistory::new(HistoryLimits::default());
        let full = spinning();
        let ends = [full.oldest().expect("held"), full.newest().expect("held")];
        for end in ends {
            history.insert(*end, end.at).expect("in order");
        }
        let bridged = state_at(&history, ms(50), &EstimateLimits::default()).expect("inside");
        assert_eq!(bridged.gap, Span::from_ms(100));
        let error = bridged.state.body_from_icrf.rotation_vector_to(&estimate(ms(50)).state.body_from_icrf).length();
        assert!(error < 1e-14, "a constant spin needs no samples between: {error} rad");
    }
}
