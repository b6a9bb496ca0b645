//! Compares the rates of a stream with its own attitudes: a wrong unit, sign or axis shows within seconds.
//!
//! In: accepted attitudes in the order of their arrival. Out: true for each window of [`WINDOW`] in which they
//! contradict each other. In a step from one attitude to the next the body turns by the mean of both rates times the
//! time between; what is left of the turn is the step's residual. Residuals of noise cancel each other from step to
//! step, those of a wrong unit, sign or axis add up. A window contradicts when, without its largest residual,
//!
//! * their sum is more than [`FLOOR_RAD`], a quarter of the turn, and half of how much the rates change in the steps; and
//! * it is more than half of the sum of their lengths: they have one direction.
//!
//! So one jump of the attitude (a new target, a repaired estimate) does not count, nor does noise of 30 arcsec on
//! attitudes at 100 Hz, a gyro's bias of 50 deg/h, an acceleration, or times that jitter by a step. Radians per second
//! taken for degrees are found from 0.03 deg/s on, a wrong sign from 0.01 deg/s on. Steps of more than [`STEP_MOST`] are
//! not judged. Allocates nothing. Tests: below.
//!
//! Notices a sender whose clock gains or loses more than a clock does: a simulator that does not keep real time.
//!
//! In: tags with their arrivals. Out: the change of the delay in a window, where it is the third one in a row in which the delay
//! has changed the same way by more than [`WAY`] and the largest drift. Of a window the least delay counts, so messages
//! that wait in a queue change nothing; a step of the clock is one window. A silence of two windows begins again. Allocates
//! nothing. Tests: below.

use base::time::{Span, Tai};
use glam::DVec3;
use plan::attitude::AttitudeSample;

/// Time over which residuals are added.
pub(super) const WINDOW: Span = Span::from_ms(1000);
/// Longest time between two attitudes that are compared.
const STEP_MOST: Span = Span::from_ms(500);
/// Fewest steps of a window that is judged.
const STEPS_LEAST: u32 = 4;
/// Residual of a window that is never a contradiction, rad: 60 arcsec.
const FLOOR_RAD: f64 = 60.0 * core::f64::consts::PI / 648_000.0;
/// Share of the turn that the residual may have.
const OF_TURN: f64 = 0.25;
/// Share of the changes of the rate, times the steps, that the residual may have.
const OF_CHANGE: f64 = 0.5;
/// Share of the lengths of all residuals that their sum has when they have one direction.
const ONE_DIRECTION: f64 = 0.5;

/// The residuals of a window so far, body axes, rad.
#[derive(Debug, Clone, Copy)]
struct Sums {
    since: Tai,
    steps: u32,
    residual: DVec3,
    lengths: f64,
    largest: DVec3,
    turn: f64,
    change: f64,
}

impl Sums {
    const fn from(since: Tai) -> Self {
        let none = DVec3::ZERO;
        Self { since, steps: 0, residual: none, lengths: 0.0, largest: none, turn: 0.0, change: 0.0 }
    }

    fn add(&mut self, from: &AttitudeSample, to: &AttitudeSample) {
        let step_s = (to.at - from.at).s();
        let by_rates = 0.5 * (from.rate_rad_s + to.rate_rad_s) * step_s;
        let turned = from.body_from_icrf.rotation_vector_to(&to.body_from_icrf);
        let residual = turned - by_rates;
        self.steps += 1;
        self.residual += residual;
        self.lengths += residual.length();
        if residual.length_squared() > self.largest.length_squared() {
            self.largest = residual;
        }
        self.turn += turned.length().max(by_rates.length());
        self.change += (to.rate_rad_s - from.rate_rad_s).length() * step_s;
    }

    fn contradict(&self) -> bool {
        let rest = (self.residual - self.largest).length();
        let lengths = self.lengths - self.largest.length();
        self.steps >= STEPS_LEAST
            && rest > FLOOR_RAD + OF_TURN * self.turn + OF_CHANGE * self.change
            && rest > ONE_DIRECTION * lengths
    }
}

/// The newest attitude of a stream, and the window under way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RateCheck {
    newest: Option<AttitudeSample>,
    sums: Option<Sums>,
}

impl RateCheck {
    /// Takes the next attitude with a rate; returns true when a window has ended in which rates and attitudes
    /// contradict each other. Attitudes that are older than the newest one are left out.
    pub(super) fn contradicts(&mut self, sample: &AttitudeSample) -> bool {
        let Some(newest) = self.newest.filter(|newest| sample.at - newest.at <= STEP_MOST) else {
            *self = Self { newest: Some(*sample), sums: None };
            return false;
        };
        if sample.at <= newest.at {
            return false;
        }
        let mut sums = self.sums.unwrap_or(Sums::from(newest.at));
        sums.add(&newest, sample);
        let is_full = sample.at - sums.since >= WINDOW;
        *self = Self { newest: Some(*sample), sums: (!is_full).then_some(sums) };
        is_full && sums.contradict()
    }

    /// Forgets everything: the next attitude belongs to another clock.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

/// Length of a window.
const TAG_WINDOW: Span = Span::from_ms(2000);
/// Windows in a row that are reported.
const WINDOWS: i32 = 3;
/// Change of the least delay, beside drift, up to which a clock is taken for one.
const WAY: Span = Span::from_ms(5);

/// The window under way, and what is known of those before.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TagRate {
    since: Option<Tai>,
    least_ns: i64,
    before_ns: Option<i64>,
    /// Windows in a row with changes of one sign, with that sign.
    in_a_row: i32,
}

impl TagRate {
    /// Takes the next tag. Returns by how much the delay has changed in a window, when the clock runs off.
    pub(super) fn take(&mut self, tag_ns: i64, arrived: Tai, most_drift: f64) -> Option<Span> {
        let delay_ns = arrived.ns().saturating_sub(tag_ns);
        let is_near = |since: &Tai| (arrived - *since).ns() < 2 * TAG_WINDOW.ns();
        let Some(since) = self.since.filter(is_near) else {
            *self = Self { since: Some(arrived), least_ns: delay_ns, ..Self::default() };
            return None;
        };
        if arrived - since < TAG_WINDOW {
            self.least_ns = self.least_ns.min(delay_ns);
            return None;
        }
        let change_ns = self.before_ns.map_or(0, |before_ns| self.least_ns.saturating_sub(before_ns));
        let allowed_ns = WAY.ns() as f64 + most_drift * TAG_WINDOW.ns() as f64;
        let sign = match change_ns as f64 {
            change if change > allowed_ns => 1,
            change if change < -allowed_ns => -1,
            _ => 0,
        };
        self.in_a_row = if sign != 0 && self.in_a_row.signum() == sign { self.in_a_row + sign } else { sign };
        (self.since, self.before_ns, self.least_ns) = (Some(arrived), Some(self.least_ns), delay_ns);
        if self.in_a_row.abs() < WINDOWS {
            return None;
        }
        self.in_a_row = 0;
        Some(Span::from_ns(change_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::{Body, Icrf, Rotation};
    use base::units::ARCSEC;
    use core::f64::consts::PI;

    const DEG: f64 = PI / 180.0;
    const SECONDS: u32 = 10;

    /// Returns how many of ten windows contradict, at 100 Hz: `rate` of the body, then what the stream says of it.
    fn windows(
        rate_rad_s: impl Fn(f64) -> DVec3,
        seen: impl Fn(usize, Rotation<Body, Icrf>, DVec3) -> (Rotation<Body, Icrf>, DVec3),
    ) -> u32 {
        let (mut check, mut attitude, mut found) = (RateCheck::default(), Rotation::IDENTITY, 0);
        for i in 0..=100 * SECONDS as usize {
            let t_s = 0.01 * i as f64;
            let (body_from_icrf, rate_rad_s_said) = seen(i, attitude, rate_rad_s(t_s));
            let sample = AttitudeSample {
                at: Tai::from_ns(10_000_000 * i as i64),
                seq: 0,
                body_from_icrf,
                rate_rad_s: rate_rad_s_said,
                acceleration_rad_s2: DVec3::ZERO,
            };
            found += u32::from(check.contradicts(&sample));
            for part in 0..10 {
                attitude = attitude.rotated_by(rate_rad_s(t_s + 0.001 * (f64::from(part) + 0.5)) * 0.001);
            }
        }
        found
    }

    fn steady(deg_s: f64) -> impl Fn(f64) -> DVec3 {
        move |_| DVec3::new(0.6, 0.0, 0.8) * deg_s * DEG
    }

    /// Returns noise of one standard deviation in each axis, the same in each run.
    fn noise(i: usize) -> DVec3 {
        let one = |axis: u64| {
            let mut x = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(axis << 32);
            let mut sum = 0.0;
            for _ in 0..12 {
                x ^= x << 13;
                x ^= x >> 7;
                x ^= x << 17;
                sum += (x >> 11) as f64 / (1_u64 << 53) as f64;
            }
            sum - 6.0
        };
        DVec3::new(one(1), one(2), one(3))
    }

    #[test]
    fn wrong_unit_sign_axis_and_sense_are_found_in_every_window() {
        for deg_s in [0.05, 0.5, 8.0] {
            let rate = steady(deg_s);
            assert_eq!(windows(&rate, |_, q, w| (q, w / DEG)), SECONDS, "degrees taken for radians, {deg_s} deg/s");
            assert_eq!(windows(&rate, |_, q, w| (q, w * DEG)), SECONDS, "radians taken for degrees, {deg_s} deg/s");
            assert_eq!(windows(&rate, |_, q, w| (q, -w)), SECONDS, "sign, {deg_s} deg/s");
            assert_eq!(windows(&rate, |_, q, w| (q, DVec3::new(w.z, w.x, w.y))), SECONDS, "axes, {deg_s} deg/s");
            assert_eq!(windows(&rate, |_, q, w| (q, q.inverse().apply(w) * DVec3::NEG_ONE)), SECONDS, "{deg_s} deg/s");
            assert_eq!(windows(&rate, |_, q, w| (q, w)), 0, "control, {deg_s} deg/s");
        }
        assert_eq!(windows(steady(0.5), |_, q, _| (q, DVec3::ZERO)), SECONDS, "no rate at all");
    }

    #[test]
    fn small_contradictions_are_below_the_limit() {
        assert_eq!(windows(steady(0.01), |_, q, w| (q, w * DEG)), 0, "36 arcsec/s");
        assert_eq!(windows(steady(0.03), |_, q, w| (q, w * DEG)), SECONDS, "108 arcsec/s");
        assert_eq!(windows(steady(1.0), |_, q, w| (q, 1.2 * w)), 0, "a scale that is 20 % wrong");
        assert_eq!(windows(steady(1.0), |_, q, w| (q, 1.5 * w)), SECONDS, "a scale that is 50 % wrong");
    }

    #[test]
    fn noise_bias_acceleration_jumps_and_late_times_are_no_contradiction() {
        let noisy =
            |i, q: Rotation<Body, Icrf>, w| (q.rotated_by(noise(i) * 30.0 * ARCSEC), w + noise(i + 7_000) * 0.02 * DEG);
        let bias = DVec3::new(0.0, 50.0 * DEG / 3600.0, 0.0);
        for deg_s in [0.0, 0.06, 2.0] {
            assert_eq!(windows(steady(deg_s), noisy), 0, "noise at {deg_s} deg/s");
            assert_eq!(windows(steady(deg_s), |_, q, w| (q, w + bias)), 0, "bias at {deg_s} deg/s");
            let jump = |i: usize, q: Rotation<Body, Icrf>, w| {
                let turned = DVec3::X * (i / 150) as f64 * 20.0 * DEG;
                (q.rotated_by(turned), Rotation::<Body, Body>::from_rotation_vector(turned).apply(w))
            };
            assert_eq!(windows(steady(deg_s), jump), 0, "jumps at {deg_s} deg/s");
        }
        let slew =
            |t_s: f64| DVec3::Y * DEG * if t_s % 4.0 < 2.0 { 1.5 * (t_s % 4.0) } else { 6.0 - 1.5 * (t_s % 4.0) };
        assert_eq!(windows(slew, |_, q, w| (q, w)), 0, "1.5 deg/s^2, up and down");
        let shaking = |t_s: f64| DVec3::Z * DEG * (2.0 * PI * 3.0 * t_s).sin();
        assert_eq!(windows(shaking, |_, q, w| (q, w)), 0, "3 Hz");
        let late = |i: usize, q: Rotation<Body, Icrf>, w: DVec3| (q.rotated_by(-w * 0.009 * (i % 2) as f64), w);
        assert_eq!(windows(steady(1.0), late), 0, "every other time is 9 of 10 ms wrong");
    }

    #[test]
    fn gaps_and_repeated_times_are_not_judged() {
        let sample = |ms: i64, turned: f64| AttitudeSample {
            at: Tai::from_ns(1_000_000 * ms),
            seq: 0,
            body_from_icrf: Rotation::from_rotation_vector(DVec3::X * turned),
            rate_rad_s: DVec3::ZERO,
            acceleration_rad_s2: DVec3::ZERO,
        };
        let mut check = RateCheck::default();
        for i in 0..30 {
            assert!(!check.contradicts(&sample(600 * i, 0.1 * i as f64)), "steps of 0.6 s");
            assert!(!check.contradicts(&sample(600 * i, 0.0)), "the same instant again");
        }
        check.clear();
        let found = (0..30).filter(|i| check.contradicts(&sample(200 * i, 0.1 * *i as f64))).count();
        assert!(found >= 4, "control: steps of 0.2 s, {found} windows");
    }
}

#[cfg(test)]
mod tag_rate_tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Returns how often 20 s of tags at 100 Hz are reported, of a clock that is off by so many parts in a million;
    /// `late_ms` is the delay of a message.
    fn reported(ppm: i64, late_ms: impl Fn(i64) -> i64) -> usize {
        let mut rate = TagRate::default();
        let is_reported = |i: &i64| {
            let sent_ns = 10 * MS * i - MS * late_ms(*i);
            let arrived = Tai::from_ns(1_000_000 * MS + 10 * MS * i);
            rate.take(sent_ns + sent_ns / 1_000_000 * ppm, arrived, 200e-6).is_some()
        };
        (0..2000).filter(is_reported).count()
    }

    #[test]
    fn a_clock_that_runs_off_is_reported_and_one_that_drifts_waits_or_steps_is_not() {
        for ppm in [-70_000, -30_000, -5_000, 5_000, 30_000] {
            assert_eq!(reported(ppm, |_| 1), 2, "{ppm} ppm");
        }
        for ppm in [-200, 0, 200] {
            assert_eq!(reported(ppm, |_| 1), 0, "{ppm} ppm: a clock's drift");
            assert_eq!(reported(ppm, |i| 1 + i % 70), 0, "{ppm} ppm: messages that wait");
        }
        assert_eq!(reported(0, |i| if i < 1000 { 1 } else { 60_000 }), 0, "a step");
    }
}
