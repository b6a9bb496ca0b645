//! Motions in closed form: slews and sinusoids about axes fixed in the body, one after the other, and the error of an
//! attitude method that sees perfect samples of them.

use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use core::f64::consts::TAU;
use glam::DVec3;
use plan::attitude::{AttitudeHistory, AttitudeMethod, AttitudeSample, HistoryLimits, MotionScale, Sinusoid, state_by};

/// Starts over one period of a sinusoid: the worst phase is missed by 0.1 %.
const STARTS: u32 = 64;

/// A turn about an axis fixed in the body: a cubic in time, and a sinusoid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turn {
    pub(crate) axis: DVec3,
    /// Rate, acceleration, jerk.
    pub(crate) cubic: [f64; 3],
    pub(crate) hz: f64,
    pub(crate) amplitude_rad: f64,
    pub(crate) phase_rad: f64,
}

/// Turns one after the other.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    pub(crate) initial: Rotation<Body, Icrf>,
    pub(crate) turns: Vec<Turn>,
}

impl Turn {
    pub(crate) fn slew(axis: DVec3, cubic: [f64; 3]) -> Self {
        Self { axis, cubic, hz: 0.0, amplitude_rad: 0.0, phase_rad: 0.0 }
    }

    pub(crate) fn jitter(axis: DVec3, hz: f64, amplitude_rad: f64, phase_rad: f64) -> Self {
        Self { axis, cubic: [0.0; 3], hz, amplitude_rad, phase_rad }
    }

    /// Returns the angle and its two derivatives.
    fn angle(&self, t: f64) -> [f64; 3] {
        let ([w, a, j], v) = (self.cubic, TAU * self.hz);
        let (sin, cos) = (v * t + self.phase_rad).sin_cos();
        [
            w * t + a * t * t / 2.0 + j * t * t * t / 6.0 + self.amplitude_rad * sin,
            w + a * t + j * t * t / 2.0 + self.amplitude_rad * v * cos,
            a + j * t - self.amplitude_rad * v * v * sin,
        ]
    }
}

pub(crate) fn epoch(t: f64) -> Tai {
    Tai::from_ns(1_000_000_000_000) + Span::from_s(t)
}

impl Motion {
    pub(crate) fn new(turns: Vec<Turn>) -> Self {
        Self { initial: Rotation::from_rotation_vector(DVec3::new(0.7, -0.2, 1.3)), turns }
    }

    /// Returns attitude, rate and acceleration at `at`.
    pub(crate) fn sample(&self, at: Tai, seq: u8) -> AttitudeSample {
        let t = (at - epoch(0.0)).s();
        let (mut q, mut rate, mut acceleration) = (self.initial, DVec3::ZERO, DVec3::ZERO);
        for turn in &self.turns {
            let [angle, angle_rate, angle_acceleration] = turn.angle(t);
            let axes = Rotation::<Body, Body>::from_rotation_vector(turn.axis * angle);
            let seen = axes.apply(rate);
            acceleration =
                axes.apply(acceleration) + turn.axis * angle_acceleration - (turn.axis * angle_rate).cross(seen);
            rate = seen + turn.axis * angle_rate;
            q = q.rotated_by(turn.axis * angle);
        }
        AttitudeSample { at, seq, body_from_icrf: q, rate_rad_s: rate, acceleration_rad_s2: acceleration }
    }

    /// Magnitudes over the first `until` seconds. One slew: the cubics of several would couple.
    pub(crate) fn scale(&self, until: f64) -> MotionScale {
        let mut scale = MotionScale::default();
        for turn in &self.turns {
            let [w, a, j] = turn.cubic.map(f64::abs);
            scale.rate_rad_s += w + a * until + j * until * until / 2.0;
            scale.acceleration_rad_s2 += a + j * until;
            scale.jerk_rad_s3 += j;
            if turn.amplitude_rad > 0.0 {
                scale.sinusoids.push(Sinusoid { frequency_hz: turn.hz, amplitude_rad: turn.amplitude_rad });
            }
        }
        scale
    }

    /// Returns samples at `start` and `span` later; the second sign of a quaternion is `sign`.
    pub(crate) fn history(&self, start: f64, span: f64, sign: f64) -> AttitudeHistory {
        let mut history = AttitudeHistory::new(HistoryLimits::default());
        for (seq, at, sign) in [(0, epoch(start), 1.0), (1, epoch(start) + Span::from_s(span), sign)] {
            let sample = self.sample(at, seq);
            let body_from_icrf = Rotation::from_quat(sample.body_from_icrf.quat() * sign);
            history.insert(AttitudeSample { body_from_icrf, ..sample }, at).unwrap();
        }
        history
    }

    /// Returns the error of `method` for samples at `start`: `span` later, or the worst of seven places between two
    /// samples.
    pub(crate) fn error_rad(&self, method: AttitudeMethod, start: f64, span: f64) -> f64 {
        let interpolates = method == AttitudeMethod::Interpolation;
        let history = self.history(start, if interpolates { span } else { span + 1.0 }, 1.0);
        let places = if interpolates { 1..8 } else { 8..9 };
        let error = |place: i32| {
            let at = epoch(start) + Span::from_s(span * f64::from(place) / 8.0);
            let got = state_by(method, &history, at).unwrap().body_from_icrf;
            self.sample(at, 0).body_from_icrf.rotation_vector_to(&got).length()
        };
        places.map(error).fold(0.0, f64::max)
    }

    /// Returns the worst start within one period of `hz`.
    pub(crate) fn worst_error_rad(&self, method: AttitudeMethod, hz: f64, span: f64) -> f64 {
        let starts = (0..STARTS).map(|k| f64::from(k) / f64::from(STARTS) / hz);
        starts.map(|start| self.error_rad(method, start, span)).fold(0.0, f64::max)
    }
}
