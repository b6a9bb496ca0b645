//! States of an observer that come from outside, one by one -> its state at any instant near them.
//!
//! | where the instant is | method | bound |
//! |---|---|---|
//! | between two states at most [`GAP`] apart | cubic Hermite | position `h^4 / 384` and velocity `h^3 sqrt(3) / 216` times the largest fourth derivative of the position |
//! | elsewhere | two-body motion from the nearest state (a straight line at the barycentre) | table in [`crate::orbit::TwoBodyOrbit`]: below 1 m/s in 60 s, 500 km above the Earth |
//!
//! In a low orbit the fourth derivative is 1e-8 km/s^4: states 60 s apart are 0.4 m and 0.02 m/s off, 0.01 mas of
//! aberration. Tests: below, on both sides of [`GAP`] and of [`FAR`].

use crate::orbit::{CentralBody, TwoBodyOrbit};
use crate::state::BarycentricState;
use base::refused::Refused;
use base::time::{Span, Tai};
use glam::DVec3;
use std::collections::VecDeque;

/// States further apart than this are not joined by a cubic.
pub const GAP: Span = Span::from_ms(60_000);
/// An instant further than this from every state is counted as predicted.
pub const FAR: Span = Span::from_ms(60_000);
/// States kept: 10 s of 100 Hz.
const KEPT: usize = 1024;

/// States of an observer that came from outside, by rising time.
#[derive(Debug, Clone)]
pub struct FollowedStates {
    about: Option<CentralBody>,
    states: VecDeque<(Tai, BarycentricState)>,
}

impl FollowedStates {
    /// Returns the states of an observer about a body, none yet; `None` is the barycentre.
    pub fn new(about: Option<CentralBody>) -> Self {
        Self { about, states: VecDeque::with_capacity(KEPT) }
    }

    /// Takes in the state at an instant; one of the same instant is replaced, and the oldest leaves when there are too
    /// many.
    ///
    /// # Errors
    /// When a number is not finite, too large, or below the surface of the body.
    pub fn take(&mut self, at: Tai, state: BarycentricState) -> Result<(), Refused> {
        self.check(at, &state)?;
        let place = self.states.partition_point(|(epoch, _)| *epoch < at);
        if let Some(known) = self.states.get_mut(place).filter(|(epoch, _)| *epoch == at) {
            known.1 = state;
            return Ok(());
        }
        let is_full = self.states.len() >= KEPT;
        if is_full && place == 0 {
            return Ok(());
        }
        if is_full {
            self.states.pop_front();
        }
        self.states.insert(place - usize::from(is_full), (at, state));
        Ok(())
    }

    fn check(&self, at: Tai, state: &BarycentricState) -> Result<(), Refused> {
        let Some(about) = self.about else {
            let got = state.position_km.length() + state.velocity_km_s.length();
            let (parameter, wanted) = ("position_km and velocity_km_s", "finite numbers");
            return if got.is_finite() {
                Ok(())
            } else {
                Err(Refused(format!("two-body orbit: {parameter} wanted {wanted}, got {got}")))
            };
        };
        check_state(about, at, *state)
    }

    /// Returns the state at an instant, relative to the body; `None` while no state has come. Does not allocate.
    ///
    /// # Errors
    /// When the motion leads below the surface of the body.
    pub fn at(&self, at: Tai) -> Result<Option<BarycentricState>, Refused> {
        let after = self.states.partition_point(|(epoch, _)| *epoch <= at);
        let before = after.checked_sub(1).and_then(|place| self.states.get(place));
        let state = match (before, self.states.get(after)) {
            (Some(earlier), Some(later)) if later.0 - earlier.0 <= GAP => hermite(*earlier, *later, at),
            (Some(earlier), Some(later)) => {
                let nearer = if at - earlier.0 <= later.0 - at { earlier } else { later };
                self.moved(*nearer, at)?
            }
            (Some(only), None) | (None, Some(only)) => self.moved(*only, at)?,
            (None, None) => return Ok(None),
        };
        self.about.map_or(Ok(state), |about| above_surface(about, at, state)).map(Some)
    }

    /// Returns true when an instant is further than [`FAR`] from every state.
    pub fn is_far(&self, at: Tai) -> bool {
        let after = self.states.partition_point(|(epoch, _)| *epoch <= at);
        let nearest = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let off = nearest.filter_map(|place| self.states.get(place)).map(|(epoch, _)| (at - *epoch).ns().abs()).min();
        off.is_some_and(|off_ns| off_ns > FAR.ns())
    }

    /// Returns a state moved to another instant: on a conic about the body, or on a straight line at the barycentre.
    fn moved(&self, from: (Tai, BarycentricState), at: Tai) -> Result<BarycentricState, Refused> {
        let (epoch, state) = from;
        if epoch == at {
            return Ok(state);
        }
        let Some(about) = self.about else {
            let position_km = state.position_km + state.velocity_km_s * (at - epoch).s();
            return Ok(BarycentricState { position_km, ..state });
        };
        let orbit = TwoBodyOrbit::from_state(epoch, state.position_km, state.velocity_km_s, about.gm_km3_s2())?;
        Ok(orbit.state(at))
    }
}

/// Returns the state at an instant on the cubic through two states (Stoer and Bulirsch, Introduction to Numerical
/// Analysis, section 2.1.5).
fn hermite(earlier: (Tai, BarycentricState), later: (Tai, BarycentricState), at: Tai) -> BarycentricState {
    let (step_s, since_s) = ((later.0 - earlier.0).s(), (at - earlier.0).s());
    let x = since_s / step_s;
    let (a, b) = (earlier.1, later.1);
    let turned: DVec3 = b.position_km - a.position_km;
    let (va, vb) = (a.velocity_km_s * step_s, b.velocity_km_s * step_s);
    let (second, third) = (3.0 * turned - 2.0 * va - vb, va + vb - 2.0 * turned);
    BarycentricState {
        position_km: a.position_km + x * (va + x * (second + x * third)),
        velocity_km_s: (va + x * (2.0 * second + 3.0 * x * third)) / step_s,
    }
}

/// Refuses a state that no orbit about the body has: not finite, faster than anything that passes the body, or below its
/// surface.
pub(crate) fn check_state(about: CentralBody, at: Tai, state: BarycentricState) -> Result<(), Refused> {
    above_surface(about, at, state)?;
    TwoBodyOrbit::from_state(at, state.position_km, state.velocity_km_s, about.gm_km3_s2())?;
    let (speed_km_s, most_km_s) = (state.velocity_km_s.length(), about.fastest_km_s());
    if speed_km_s > most_km_s {
        return Err(Refused(format!(
            "the orbit about {about} has {speed_km_s:.1} km/s at {at}: wanted at most {most_km_s} km/s; check units"
        )));
    }
    Ok(())
}

/// Returns a state about a body, unless it is below its surface.
pub(crate) fn above_surface(about: CentralBody, at: Tai, state: BarycentricState) -> Result<BarycentricState, Refused> {
    let (distance_km, surface_km) = (state.position_km.length(), about.surface_km());
    if distance_km < surface_km {
        return Err(Refused(format!(
            "the orbit about {about} is {distance_km:.1} km from its centre at {at}: wanted {surface_km} km or more; check epoch and units"
        )));
    }
    Ok(state)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADIUS_KM: f64 = 6_878.0;

    fn zero() -> Tai {
        Tai::from_rfc3339("2026-03-01T12:00:00Z").expect("a valid instant")
    }

    /// Returns a circular orbit, by its formula.
    fn circle(t_s: f64) -> BarycentricState {
        let rate = (CentralBody::Earth.gm_km3_s2() / RADIUS_KM.powi(3)).sqrt();
        let (sin, cos) = (rate * t_s).sin_cos();
        BarycentricState {
            position_km: RADIUS_KM * DVec3::new(cos, sin, 0.0),
            velocity_km_s: RADIUS_KM * rate * DVec3::new(-sin, cos, 0.0),
        }
    }

    fn every(step_s: f64) -> FollowedStates {
        let mut states = FollowedStates::new(Some(CentralBody::Earth));
        for k in 0..10 {
            let t_s = step_s * f64::from(k);
            states.take(zero() + Span::from_s(t_s), circle(t_s)).expect("a state of an orbit");
        }
        states
    }

    /// Returns the largest errors over the states' middle, km and km/s.
    fn errors(states: &FollowedStates, until_s: f64) -> (f64, f64) {
        let mut worst = (0.0_f64, 0.0_f64);
        for k in 0..1000 {
            let t_s = until_s * f64::from(k) / 1000.0;
            let off = states.at(zero() + Span::from_s(t_s)).unwrap().unwrap() - circle(t_s);
            worst = (worst.0.max(off.position_km.length()), worst.1.max(off.velocity_km_s.length()));
        }
        worst
    }

    #[test]
    fn between_states_the_error_is_below_its_bound_and_near_it() {
        for step_s in [1.0_f64, 20.0, 60.0] {
            let fourth = CentralBody::Earth.gm_km3_s2().powi(2) / RADIUS_KM.powi(5);
            let bound_km = step_s.powi(4) / 384.0 * fourth + 1e-8;
            let bound_km_s = step_s.powi(3) * 3_f64.sqrt() / 216.0 * fourth + 1e-10;
            let (km, km_s) = errors(&every(step_s), 9.0 * step_s);
            assert!(km <= 1.01 * bound_km && km_s <= 1.2 * bound_km_s, "{step_s} s: {km} {km_s}");
            assert!(step_s < 20.0 || km > 0.5 * bound_km, "{step_s} s: the bound {bound_km} is far above {km}");
        }
    }

    #[test]
    fn beyond_the_gap_states_are_moved_on_their_conic() {
        // A cubic over 61 s would be 0.4 m off; two-body motion is exact for a circle.
        let (km, _) = errors(&every(61.0), 9.0 * 61.0);
        assert!(km < 1e-7, "{km}");
        let joined = errors(&every(60.0), 540.0).0;
        assert!(joined > 1e-5, "the cubic has an error: {joined}");
    }

    #[test]
    fn far_from_every_state_is_said_to_be_far() {
        let states = every(1.0);
        let at = |t_s: f64| zero() + Span::from_s(t_s);
        assert!(!states.is_far(at(69.0)) && states.is_far(at(69.1)) && states.is_far(at(-60.1)));
        assert!(!FollowedStates::new(None).is_far(at(0.0)), "without states nothing is predicted");
        let off = states.at(at(1000.0)).unwrap().unwrap() - circle(1000.0);
        assert!(off.position_km.length() < 1e-6, "{off:?}");
    }

    #[test]
    fn states_that_no_orbit_has_are_refused() {
        let mut states = FollowedStates::new(Some(CentralBody::Earth));
        let good = circle(0.0);
        let below = BarycentricState { position_km: 0.5 * good.position_km, ..good };
        let no_number = BarycentricState { velocity_km_s: DVec3::NAN, ..good };
        assert!(states.take(zero(), below).is_err() && states.take(zero(), no_number).is_err());
        assert_eq!(states.at(zero()).unwrap(), None);
        states.take(zero(), good).expect("a state of an orbit");
        assert_eq!(states.at(zero()).unwrap(), Some(good));
    }

    #[test]
    fn late_states_go_to_their_place_and_the_oldest_leaves() {
        let mut states = FollowedStates::new(None);
        let state = |x: f64| BarycentricState { position_km: DVec3::X * x, velocity_km_s: DVec3::ZERO };
        let at = |k: usize| zero() + Span::from_ms(i64::try_from(k).unwrap() * 70_000);
        for k in (0..KEPT).filter(|k| *k != 5).chain([5, KEPT, 5]) {
            states.take(at(k), state(k as f64)).expect("finite");
        }
        assert_eq!(states.states.len(), KEPT);
        assert_eq!(states.states.front().map(|(epoch, _)| *epoch), Some(at(1)));
        assert_eq!(states.at(at(5)).unwrap(), Some(state(5.0)));
        states.take(at(0), state(9.0)).expect("finite");
        assert_eq!(states.states.front().map(|(epoch, _)| *epoch), Some(at(1)), "older than all that is kept");
    }
}
