//! Wheel speeds -> the small rotation of the body that the smooth motion leaves out, sampled every millisecond.
//!
//! Each harmonic `h` of a wheel at speed `W` is a torque `U W^2` turning at `n = h W` in the plane across the spin
//! axis. The response is linear: the rigid part `-J^-1 T / n^2` (its amplitude `U / h^2` does not depend on the speed),
//! and free modes as damped oscillators. While speeds are constant an oscillator is its steady
//! response to every harmonic plus a free decay, both exact; when speeds change, the decay takes up the difference. So
//! a wheel that runs through a resonance shows the true transient, and no sampling period is too long for a frequency.
//!
//! Output: rotation vector, rad, body axes, to be added with `Rotation::rotated_by`. Limits: small angles; the torque's
//! own derivative by the spin-up is left out (slow against `n`); speeds between calls enter as their mean.
//!
//! `tests/micro_vibration.rs`: frequency response against elimination by hand, transient against a Runge-Kutta
//! integration, the sweep's amplification, sampling-independence.
//!
//! The steady response to a torque `U W^2 (e1 cos phi + e2 sin phi)` turning at `n` is, with `F = -U W^2 (g . e1 - i g . e2)`,
//! ```text
//! p = Re(P e^(i phi))     P = F / (o^2 - n^2 + 2 i z o n)     theta = -U / h^2 J^-1 (e1 cos phi + e2 sin phi) - sum g p
//! ```
//!
//! Cantilever modes and inertia give the modes of the body floating free. With `D` the couplings as columns, `eta` and the body's rotation about rest obey (Hughes (1986), chapter 6)
//! ```text
//! J theta'' + D eta'' = T          eta'' + C eta' + L eta = -D' theta''
//! (1 - D' J^-1 D) eta'' + C eta' + L eta = -D' J^-1 T
//! ```
//! The symmetric pair `(1 - D' J^-1 D, L)` is diagonalised by `eta = F p`:
//! ```text
//! p'' + 2 z o p' + o^2 p = -g . T       theta = J^-1 (T twice integrated) - sum g p       g = J^-1 D F
//! ```
//! `J` has the rotors free about their axes. `Differs:` of `F' C F` the diagonal is kept; with one mode that is exact,
//! with several it leaves out terms of the order of the damping ratio. `tests/flexible.rs` and
//! `tests/micro_vibration.rs` hold frequencies and responses to theory.

use crate::spacecraft::check::{STEP_SMALLEST, check, within};
use crate::spacecraft::params::{MODES_MAX, SpacecraftParams};
use crate::spacecraft::{KEPT, entries_kept};
use crate::{spacecraft::equations::outer, spacecraft::history::History};
use base::refused::Refused;
use base::time::{Span, Tai};
use core::f64::consts::TAU;
use glam::{DMat3, DVec2, DVec3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Longest sampling period: ten samples are kept.
const PERIOD_LARGEST: Span = Span::from_ns(KEPT.ns() / 10);
/// Points of the interpolation between samples: a cubic.
const INTERPOLATION_POINTS: u64 = 4;

/// Micro-vibration of one spacecraft.
#[derive(Debug)]
pub struct MicroVibration {
    start: Tai,
    period: Span,
    wheels: Vec<Wheel>,
    pub(super) lines: Vec<Line>,
    oscillators: Vec<Oscillator>,
    samples: History<DVec3>,
}

#[derive(Debug)]
struct Wheel {
    /// Speed as last reported, rad/s.
    reported_rad_s: f64,
    /// Mean of the last two, rad/s: what the lines run at.
    speed_rad_s: f64,
}

impl MicroVibration {
    /// Simulates the spacecraft `params` from `start` on, sampled every `period`; wheels at their initial speeds for
    /// long. `seed` draws the phases.
    ///
    /// # Errors
    /// When the parameters are not physical, a mode has no damping (or is overdamped once free), or the period will not
    /// do.
    pub fn new(params: &SpacecraftParams, start: Tai, period: Span, seed: u64) -> Result<Self, Refused> {
        check(params)?;
        if period < STEP_SMALLEST || period > PERIOD_LARGEST {
            return Err(Refused(format!(
                "micro-vibration period: {} s, wanted at least {} s and at most {} s",
                period.s(),
                STEP_SMALLEST.s(),
                PERIOD_LARGEST.s()
            )));
        }
        let modes = free_modes(params);
        for (index, mode) in modes.iter().enumerate() {
            let is_oscillating = mode.damping > 0.0 && mode.damping < 1.0;
            let wanted = "more than 0 and below 1";
            within("free mode", index, "damping", mode.damping, wanted, is_oscillating)?;
        }
        let wheel = |speed| Wheel { reported_rad_s: speed, speed_rad_s: speed };
        let mut new = Self {
            start,
            period,
            wheels: params.wheels.iter().map(|params| wheel(params.initial_speed_rad_s)).collect(),
            lines: lines(params, seed),
            oscillators: modes.into_iter().map(|mode| Oscillator::new(mode, period.s())).collect(),
            samples: History::new(entries_kept(period)),
        };
        new.respond();
        new.samples.push(new.rotation());
        Ok(new)
    }

    /// Takes all samples up to `at`, when the wheels have these speeds (rad/s; those not given keep theirs). From the
    /// last call to this one the speeds are taken at their mean, so the phase is their integral by the trapezoid rule.
    pub fn advance_to(&mut self, at: Tai, wheel_speeds_rad_s: &[f64]) {
        if self.time() + self.period > at {
            return;
        }
        for (wheel, reported) in self.wheels.iter_mut().zip(wheel_speeds_rad_s) {
            wheel.speed_rad_s = 0.5 * (wheel.reported_rad_s + reported);
            wheel.reported_rad_s = *reported;
        }
        self.take_up(1.0);
        self.respond();
        self.take_up(-1.0);
        while self.time() + self.period <= at {
            self.advance_one_sample();
        }
    }

    /// Returns when the last sample was taken.
    pub fn time(&self) -> Tai {
        self.instant(self.samples.next() - 1)
    }

    /// Returns the rotation vector, rad, body axes, at `at`: the sample of that instant, or a cubic through the four
    /// about it. The cubic errs by 0.4 % of a line at a tenth of the sampling frequency, and by the fourth power below.
    ///
    /// # Errors
    /// When `at` is not kept: about two seconds are.
    pub fn sample(&self, at: Tai) -> Result<DVec3, Refused> {
        let (oldest, next) = (self.samples.oldest(), self.samples.next());
        let outside = Refused(format!(
            "no truth kept for {at}: kept are {first} to {last}",
            first = self.instant(oldest),
            last = self.time()
        ));
        if at < self.instant(oldest) || at > self.time() {
            return Err(outside);
        }
        let since_ns = (at - self.start).ns();
        let number = since_ns.div_euclid(self.period.ns()).unsigned_abs();
        if self.instant(number) == at {
            return self.samples.get(number).copied().ok_or(outside);
        }
        let count = INTERPOLATION_POINTS.min(next - oldest);
        let first = number.saturating_sub(1).clamp(oldest, next - count);
        let place = (at - self.instant(first)).s() / self.period.s();
        let mut sum = DVec3::ZERO;
        for point in 0..count {
            let sample = self.samples.get(first + point).ok_or(outside.clone())?;
            sum += *sample * lagrange(point, count, place);
        }
        Ok(sum)
    }

    /// Frequencies of the modes of the body floating free, Hz: where a wheel's harmonic resonates.
    #[cfg(test)]
    pub fn free_frequencies_hz(&self) -> impl Iterator<Item = f64> {
        self.oscillators.iter().map(|oscillator| oscillator.mode.frequency_rad_s / TAU)
    }

    #[allow(clippy::cast_possible_wrap, reason = "2^63 samples are not lived to see")]
    fn instant(&self, number: u64) -> Tai {
        self.start + Span::from_ns((number as i64).saturating_mul(self.period.ns()))
    }

    fn advance_one_sample(&mut self) {
        for line in &mut self.lines {
            line.advance();
        }
        for oscillator in &mut self.oscillators {
            oscillator.advance();
        }
        self.samples.push(self.rotation());
    }

    fn rotation(&self) -> DVec3 {
        let steady: DVec3 = self.lines.iter().map(Line::rotation).sum();
        let decay: DVec3 = self.oscillators.iter().map(Oscillator::rotation).sum();
        steady + decay
    }

    /// Adds `sign` times the present steady responses to the decays.
    fn take_up(&mut self, sign: f64) {
        for line in &self.lines {
            for (m, oscillator) in self.oscillators.iter_mut().enumerate() {
                oscillator.decay += line.modal_motion(m) * sign;
            }
        }
    }

    /// Computes the steady responses at the present speeds.
    fn respond(&mut self) {
        for line in &mut self.lines {
            line.respond(self.wheels[line.wheel].speed_rad_s, self.period.s(), &self.oscillators);
        }
    }
}

/// Returns the weight of `point` of `count` points at 0, 1, 2, ... for the value at `place`.
fn lagrange(point: u64, count: u64, place: f64) -> f64 {
    let others = (0..count).filter(|other| *other != point);
    others.map(|other| (place - other as f64) / (point as f64 - other as f64)).product()
}

/// One harmonic of one wheel.
#[derive(Debug)]
pub(super) struct Line {
    /// Index of the wheel.
    pub(super) wheel: usize,
    multiple: f64,
    torque_n_m_s2: f64,
    /// Two axes across the spin axis; the torque turns from the first to the second.
    across: [DVec3; 2],
    /// Rigid response to the cosine and to the sine, rad.
    rigid: [DVec3; 2],
    /// Cosine and sine of the torque's phase.
    phase: DVec2,
    /// Turn of the phase in one sample, as cosine and sine.
    turn: DVec2,
    frequency_rad_s: f64,
    /// Whole steady response of the body to the cosine and to the sine, rad.
    response: [DVec3; 2],
    /// `P` of every mode: real and imaginary part.
    modal: [DVec2; MODES_MAX],
}

/// One free mode and the transient part of its motion.
#[derive(Debug)]
pub(super) struct Oscillator {
    pub(super) mode: FreeMode,
    /// Modal coordinate and its rate, of the free decay.
    pub(super) decay: DVec2,
    /// Exact transition of the decay over one sample: rows.
    transition: [DVec2; 2],
}

/// Returns all harmonics of all wheels, phases drawn from `seed`.
pub(super) fn lines(params: &SpacecraftParams, seed: u64) -> Vec<Line> {
    let mut generator = StdRng::seed_from_u64(seed);
    let inverse = free_inertia(params).inverse();
    let mut lines = Vec::new();
    for (wheel, wheel_params) in params.wheels.iter().enumerate() {
        let axis = wheel_params.axis_body.normalize_or_zero();
        let first = axis.any_orthonormal_vector();
        let across = [first, axis.cross(first)];
        for harmonic in &wheel_params.imbalance {
            let turns: f64 = generator.random();
            let static_rad = harmonic.torque_n_m_s2 / (harmonic.multiple * harmonic.multiple);
            lines.push(Line {
                wheel,
                multiple: harmonic.multiple,
                torque_n_m_s2: harmonic.torque_n_m_s2,
                across,
                rigid: across.map(|e| inverse * e * -static_rad),
                phase: DVec2::from_angle(TAU * turns),
                turn: DVec2::X,
                frequency_rad_s: 0.0,
                response: [DVec3::ZERO; 2],
                modal: [DVec2::ZERO; MODES_MAX],
            });
        }
    }
    lines
}

impl Line {
    /// Computes the steady response at a wheel speed.
    pub(super) fn respond(&mut self, speed_rad_s: f64, period_s: f64, oscillators: &[Oscillator]) {
        self.frequency_rad_s = self.multiple * speed_rad_s;
        self.turn = DVec2::from_angle(self.frequency_rad_s * period_s);
        // Thousands of turns have left the length a few ulp off; one step of Newton's method.
        self.phase *= 1.5 - 0.5 * self.phase.length_squared();
        self.response = self.rigid;
        let torque_n_m = self.torque_n_m_s2 * speed_rad_s * speed_rad_s;
        for (modal, oscillator) in self.modal.iter_mut().zip(oscillators) {
            let mode = &oscillator.mode;
            let force = DVec2::new(-mode.shape.dot(self.across[0]), mode.shape.dot(self.across[1])) * torque_n_m;
            let (o, n) = (mode.frequency_rad_s, self.frequency_rad_s);
            let impedance = DVec2::new((o - n) * (o + n), 2.0 * mode.damping * o * n);
            // A complex quotient: times the conjugate, over the square.
            *modal = DVec2::new(impedance.x, -impedance.y).rotate(force) / impedance.length_squared();
            self.response[0] -= mode.shape * modal.x;
            self.response[1] += mode.shape * modal.y;
        }
    }

    pub(super) fn advance(&mut self) {
        self.phase = self.turn.rotate(self.phase);
    }

    /// Returns the steady rotation of the body, rad.
    pub(super) fn rotation(&self) -> DVec3 {
        self.response[0] * self.phase.x + self.response[1] * self.phase.y
    }

    /// Returns the unit vector of the torque now: for the oracle of the tests.
    #[cfg(test)]
    pub(super) fn torque_direction(&self) -> DVec3 {
        self.across[0] * self.phase.x + self.across[1] * self.phase.y
    }

    /// Returns the steady motion of mode `m`: coordinate and rate.
    pub(super) fn modal_motion(&self, m: usize) -> DVec2 {
        let now = self.phase.rotate(self.modal[m]);
        DVec2::new(now.x, -self.frequency_rad_s * now.y)
    }
}

impl Oscillator {
    /// Makes an oscillator at rest; the transition is the closed form of an underdamped oscillator.
    pub(super) fn new(mode: FreeMode, period_s: f64) -> Self {
        let decay_rad_s = mode.damping * mode.frequency_rad_s;
        let damped_rad_s = mode.frequency_rad_s * (1.0 - mode.damping * mode.damping).sqrt();
        let (sin, cos) = (damped_rad_s * period_s).sin_cos();
        let (left, share) = ((-decay_rad_s * period_s).exp(), decay_rad_s / damped_rad_s);
        let transition = [
            DVec2::new(cos + share * sin, sin / damped_rad_s) * left,
            DVec2::new(-mode.frequency_rad_s * mode.frequency_rad_s * sin / damped_rad_s, cos - share * sin) * left,
        ];
        Self { mode, decay: DVec2::ZERO, transition }
    }

    pub(super) fn advance(&mut self) {
        let [first, second] = self.transition;
        self.decay = DVec2::new(first.dot(self.decay), second.dot(self.decay));
    }

    /// Returns the rotation of the body by the decay, rad.
    pub(super) fn rotation(&self) -> DVec3 {
        self.mode.shape * -self.decay.x
    }
}

/// Sweeps of Jacobi's method: 4 x 4 matrices are diagonal to rounding after 5.
const SWEEPS: usize = 8;

type Square = [[f64; MODES_MAX]; MODES_MAX];

/// One mode of the free body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FreeMode {
    /// Frequency, rad/s.
    pub(super) frequency_rad_s: f64,
    /// Damping ratio.
    pub(super) damping: f64,
    /// Rotation of the body per modal coordinate, and torque to modal force.
    pub(super) shape: DVec3,
}

/// Returns the inertia with the rotors free about their axes, kg m^2.
pub(super) fn free_inertia(params: &SpacecraftParams) -> DMat3 {
    let mut inertia = params.inertia_kg_m2;
    for wheel in &params.wheels {
        let axis = wheel.axis_body.normalize_or_zero();
        inertia -= outer(axis, axis) * wheel.inertia_kg_m2;
    }
    inertia
}

/// Returns the free modes of checked parameters, in no order.
pub(super) fn free_modes(params: &SpacecraftParams) -> Vec<FreeMode> {
    let modes = &params.modes;
    let inverse = free_inertia(params).inverse();
    // L^-1/2 (1 - D' J^-1 D) L^-1/2: eigenvalues 1 / o^2.
    let mut matrix = Square::default();
    for (i, a) in modes.iter().enumerate() {
        for (j, b) in modes.iter().enumerate() {
            let identity = if i == j { 1.0 } else { 0.0 };
            let frequencies = TAU * a.frequency_hz * TAU * b.frequency_hz;
            matrix[i][j] = (identity - a.coupling.dot(inverse * b.coupling)) / frequencies;
        }
    }
    let vectors = diagonalise(&mut matrix, modes.len());
    (0..modes.len())
        .map(|m| {
            let frequency_rad_s = matrix[m][m].powf(-0.5);
            let (mut shape, mut damping_rad_s) = (DVec3::ZERO, 0.0);
            for (i, mode) in modes.iter().enumerate() {
                let o = TAU * mode.frequency_hz;
                let part = vectors[i][m] / o * frequency_rad_s;
                shape += mode.coupling * part;
                damping_rad_s += 2.0 * mode.damping * o * part * part;
            }
            FreeMode { frequency_rad_s, damping: damping_rad_s / (2.0 * frequency_rad_s), shape: inverse * shape }
        })
        .collect()
}

/// Applies Jacobi's method (Golub and Van Loan, "Matrix Computations", section 8.5): `matrix` becomes diagonal in its
/// first `n` rows; the columns of what is returned are its eigenvectors.
fn diagonalise(matrix: &mut Square, n: usize) -> Square {
    let mut vectors = Square::default();
    for i in 0..n {
        vectors[i][i] = 1.0;
    }
    for _ in 0..SWEEPS {
        for p in 0..n {
            for q in p + 1..n {
                rotate(matrix, &mut vectors, n, p, q);
            }
        }
    }
    vectors
}

/// Applies one rotation that brings `matrix[p][q]` to zero.
fn rotate(matrix: &mut Square, vectors: &mut Square, n: usize, p: usize, q: usize) {
    if matrix[p][q] == 0.0 {
        return;
    }
    let tau = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
    let tan = tau.signum() / (tau.abs() + tau.hypot(1.0));
    let cos = 1.0 / tan.hypot(1.0);
    let sin = tan * cos;
    for k in 0..n {
        let (a, b) = (matrix[k][p], matrix[k][q]);
        (matrix[k][p], matrix[k][q]) = (cos * a - sin * b, sin * a + cos * b);
        let (a, b) = (vectors[k][p], vectors[k][q]);
        (vectors[k][p], vectors[k][q]) = (cos * a - sin * b, sin * a + cos * b);
    }
    for k in 0..n {
        let (a, b) = (matrix[p][k], matrix[q][k]);
        (matrix[p][k], matrix[q][k]) = (cos * a - sin * b, sin * a + cos * b);
    }
}
