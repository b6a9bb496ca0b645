//! Micro-vibration against elimination by hand, a Runge-Kutta integration and the sweep through a resonance.

use super::*;
use core::f64::consts::TAU;
use glam::DVec2;

const INERTIA: f64 = 100.0;
const IMBALANCE: f64 = 1e-6;
const MS: Span = Span::from_ms(1);

/// Returns one wheel about x with one line, one mode about z: only the torque along z excites it.
fn one_line(multiple: f64, speed_rad_s: f64, kappa: f64) -> SpacecraftParams {
    let line = Harmonic { multiple, torque_n_m_s2: IMBALANCE };
    let coupling = DVec3::Z * (kappa * INERTIA).sqrt();
    SpacecraftParams {
        wheels: vec![WheelParams { imbalance: vec![line], ..wheel(DVec3::X, speed_rad_s) }],
        modes: vec![mode(3.0, 0.005, coupling)],
        ..bare(DMat3::IDENTITY * INERTIA, Span::from_ms(10))
    }
}

fn start(params: &SpacecraftParams) -> MicroVibration {
    MicroVibration::new(params, START, MS, 3).expect("sound parameters")
}

/// Returns the amplitude of body rotation about z per torque about z at `n` rad/s: both equations of motion solved by
/// hand with complex numbers, `theta = -(o^2 - n^2 + i c n) / (n^2 J (o^2 - (1 - kappa) n^2 + i c n))`, `c = 2 z o`.
fn transfer(n: f64, kappa: f64) -> f64 {
    let (o, c) = (3.0 * TAU, 2.0 * 0.005 * 3.0 * TAU);
    let above = DVec2::new(o * o - n * n, c * n).length();
    above / (n * n * INERTIA * DVec2::new(o * o - (1.0 - kappa) * n * n, c * n).length())
}

/// Returns the largest |theta| about z and y over `seconds` at constant speed.
fn largest(vibration: &mut MicroVibration, speed: f64, seconds: i64) -> DVec3 {
    let mut largest = DVec3::ZERO;
    let end = vibration.time() + Span::from_ms(1000 * seconds);
    while vibration.time() < end {
        vibration.advance_to(vibration.time() + MS, &[speed]);
        largest = largest.max(vibration.sample(vibration.time()).expect("the last sample").abs());
    }
    largest
}

#[test]
fn constant_speeds_give_the_frequency_response() {
    let kappa = 0.2;
    for speed in [2.0, 17.0, 18.8, 21.0, 21.2, 30.0, 90.0, 300.0] {
        for multiple in [1.0, 2.83] {
            let params = one_line(multiple, speed, kappa);
            let peak = largest(&mut start(&params), speed, 8);
            let (n, torque) = (multiple * speed, IMBALANCE * speed * speed);
            let wanted = torque * transfer(n, kappa);
            // Samples miss the crest by half a sample at most: 1 - cos(n period / 2), but phases drift over it.
            assert!((peak.z / wanted - 1.0).abs() < 2e-3, "{n} rad/s: {} for {wanted}", peak.z);
            assert!((peak.y / (torque / (INERTIA * n * n)) - 1.0).abs() < 2e-3, "{n} rad/s: rigid about y");
            assert_eq!(peak.x, 0.0, "nothing about the spin axis");
            let rigid = torque / (INERTIA * n * n);
            let is_near = (0.5..2.0).contains(&(n / (3.0 * TAU)));
            assert!(!is_near || (peak.z / rigid - 1.0).abs() > 0.05, "negative control: the mode matters at {n} rad/s");
        }
    }
}

#[test]
fn a_jump_of_speed_shows_the_transient_that_runge_kutta_finds() {
    let (kappa, before, after_jump) = (0.2, 15.0, 21.0);
    let params = one_line(1.0, before, kappa);
    let mut vibration = start(&params);
    let mut oracle = Oracle::steady(kappa, before, &vibration);
    for ms in 1..=3000 {
        // The mean of the two speeds holds between the first two calls.
        let speed = if ms == 1 { 0.5 * (before + after_jump) } else { after_jump };
        vibration.advance_to(START + Span::from_ms(ms), &[after_jump]);
        oracle.advance(speed);
        let got = vibration.sample(vibration.time()).expect("the last sample").z;
        let steady = IMBALANCE * after_jump * after_jump * transfer(after_jump, kappa);
        // Runge-Kutta at 1 ms and 21 rad/s: (o h)^5 / 120 a step, 3000 of them: 1e-7 of the amplitude.
        assert!((got - oracle.rotation()).abs() < 1e-5 * steady, "{ms} ms: {got} for {}", oracle.rotation());
        if ms == 150 {
            assert!((got - steady * oracle.phase.cos()).abs() > 0.1 * steady, "negative control: not yet steady");
        }
    }
}

/// Both equations of motion about z by Runge-Kutta under the torque itself:
/// `eta'' (1 - kappa) + c eta' + o^2 eta = -delta T / J`, `theta = T2 / J - delta eta / J` with `T2 = -T / n^2`.
struct Oracle {
    kappa: f64,
    phase: f64,
    speed: f64,
    eta: DVec2,
}

impl Oracle {
    /// Returns the steady at `speed`, settled into the phase that the torque of `vibration` has now.
    fn steady(kappa: f64, speed: f64, vibration: &MicroVibration) -> Self {
        let torque = vibration.lines[0].torque_direction();
        let phase = torque.y.atan2(torque.z);
        let mut oracle = Self { kappa, phase, speed, eta: DVec2::ZERO };
        // A free decay of 0.0056 at 21 rad/s: 200 s leave e^-23 of the start.
        oracle.phase -= speed * 200.0 * oracle.sense();
        for _ in 0..200_000 {
            oracle.advance(speed);
        }
        oracle
    }

    /// Returns the about x, z turns to -y: the angle from z towards y falls.
    fn sense(&self) -> f64 {
        -1.0
    }

    fn torque(&self, phase: f64) -> f64 {
        IMBALANCE * self.speed * self.speed * phase.cos()
    }

    fn slope(&self, eta: DVec2, phase: f64) -> DVec2 {
        let (o, c) = (3.0 * TAU, 2.0 * 0.005 * 3.0 * TAU);
        let force = -(self.kappa * INERTIA).sqrt() * self.torque(phase) / INERTIA;
        DVec2::new(eta.y, (force - c * eta.y - o * o * eta.x) / (1.0 - self.kappa))
    }

    fn advance(&mut self, speed: f64) {
        self.speed = speed;
        let (h, turn) = (1e-3, speed * 1e-3 * self.sense());
        let middle = self.phase + 0.5 * turn;
        let k1 = self.slope(self.eta, self.phase);
        let k2 = self.slope(self.eta + k1 * 0.5 * h, middle);
        let k3 = self.slope(self.eta + k2 * 0.5 * h, middle);
        let k4 = self.slope(self.eta + k3 * h, self.phase + turn);
        self.eta += (k1 + 2.0 * k2 + 2.0 * k3 + k4) * (h / 6.0);
        self.phase += turn;
    }

    fn rotation(&self) -> f64 {
        -IMBALANCE * self.phase.cos() / INERTIA - (self.kappa * INERTIA).sqrt() * self.eta.x / INERTIA
    }
}

/// Returns the largest rotation about z over the rigid one, in a sweep from 18 to 24 rad/s through the free mode at
/// 21.07.
fn amplification(rate_rad_s2: f64) -> f64 {
    let params = one_line(1.0, 18.0, 0.2);
    let mut vibration = start(&params);
    let (mut speed, mut peak): (f64, f64) = (18.0, 0.0);
    while speed < 24.0 {
        speed += rate_rad_s2 * 0.01;
        vibration.advance_to(vibration.time() + Span::from_ms(10), &[speed]);
        peak = peak.max(vibration.sample(vibration.time()).expect("the last sample").z.abs());
    }
    peak / (IMBALANCE / INERTIA)
}

#[test]
fn a_sweep_through_the_mode_amplifies_by_the_quality_factor() {
    // Steady peak over rigid: kappa / (1 - kappa) of the elastic part times Q = 1 / (2 z_free), and the rest.
    let n = 3.0 * TAU / 0.8f64.sqrt();
    let steady = transfer(n, 0.2) * n * n * INERTIA;
    let quality = 0.8f64.sqrt() / (2.0 * 0.005);
    assert!((steady / (0.25 * quality) - 1.0).abs() < 0.1, "{steady} for {}", 0.25 * quality);
    // Lewis, Trans. ASME 54 (1932): slow against the square of the half-width (0.118 rad/s)^2 = 0.0139, a sweep reaches
    // the steady peak; at a hundred times that it does not.
    let (slow, fast) = (amplification(0.004), amplification(1.4));
    assert!((slow / steady - 1.0).abs() < 0.1, "slow: {slow} for {steady}");
    assert!(fast < 0.5 * steady && fast > 2.0, "fast: {fast} for {steady}");
}

#[test]
fn the_sampling_period_changes_nothing_at_common_instants() {
    let params = one_line(2.83, 40.0, 0.2);
    let [mut fine, mut coarse] =
        [1, 5].map(|ms| MicroVibration::new(&params, START, Span::from_ms(ms), 3).expect("sound"));
    for decade in 1..=100 {
        let at = START + Span::from_ms(10 * decade);
        let speed = 40.0 + 0.1 * decade as f64;
        fine.advance_to(at, &[speed]);
        coarse.advance_to(at, &[speed]);
        let [a, b] = [&fine, &coarse].map(|one| one.sample(at).expect("the last sample"));
        assert!((a - b).length() < 1e-12 * IMBALANCE, "{a} and {b}");
    }
    let at = START + Span::from_ns(997_300_000);
    let between = fine.sample(at).expect("kept");
    let finer = {
        let mut one = MicroVibration::new(&params, START, Span::from_ns(100_000), 3).expect("sound");
        for decade in 1..=100 {
            one.advance_to(START + Span::from_ms(10 * decade), &[40.0 + 0.1 * decade as f64]);
        }
        one.sample(at).expect("kept")
    };
    // Cubic, 141 rad/s: (n h)^4 / 42 = 1e-5 of the line's 1e-9 rad at most.
    assert!((between - finer).length() < 2e-5 * 1e-8, "{between} and {finer}");
    assert!((between - fine.sample(START + Span::from_ms(997)).expect("kept")).length() > 1e-12, "negative control");
}

#[test]
fn seeds_decide_phases_and_no_question_panics() {
    let params = one_line(1.0, 40.0, 0.2);
    let at = |seed| {
        let mut one = MicroVibration::new(&params, START, MS, seed).expect("sound");
        one.advance_to(START + Span::from_ms(100), &[41.0]);
        one
    };
    let sample = |seed| at(seed).sample(START + Span::from_ms(100)).expect("kept");
    assert_eq!(sample(1), sample(1));
    assert_ne!(sample(1), sample(2));
    for ns in [-1, 100_000_001, i64::MAX] {
        assert!(at(1).sample(START + Span::from_ns(ns)).is_err(), "{ns} ns");
    }
    let young = MicroVibration::new(&params, START, MS, 1).expect("sound");
    assert!(young.sample(START).is_ok(), "one sample");
    let free = young.free_frequencies_hz().next().expect("one mode");
    assert!((free - 3.0 / 0.8f64.sqrt()).abs() < 1e-9, "{free} Hz");
}

/// Returns the product of complex numbers.
fn times(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

fn divided(a: DVec2, b: DVec2) -> DVec2 {
    times(a, DVec2::new(b.x, -b.y)) / b.length_squared()
}

/// Returns the steady rotation of a body with two modes under `torque` and its quadrature: two complex equations by
/// Cramer's rule, `(o_j^2 - n^2 + i c_j n) eta_j + n^2 sum_k D_j' J^-1 D_k eta_k = -D_j' J^-1 T`.
fn two_modes(params: &SpacecraftParams, n: f64, torque: DVec3, quadrature: DVec3) -> DVec3 {
    let spin = params.wheels[0].axis_body.normalize();
    let rotor = DMat3::from_cols(spin * spin.x, spin * spin.y, spin * spin.z) * params.wheels[0].inertia_kg_m2;
    let inverse = (params.inertia_kg_m2 - rotor).inverse();
    let coupling = [0, 1].map(|j| params.modes[j].coupling);
    let own = [0, 1].map(|j| {
        let o = TAU * params.modes[j].frequency_hz;
        DVec2::new(o * o - n * n, 2.0 * params.modes[j].damping * o * n)
    });
    let cross = |j: usize, k: usize| DVec2::X * (n * n * coupling[j].dot(inverse * coupling[k]));
    let force = [0, 1].map(|j| -DVec2::new(coupling[j].dot(inverse * torque), -coupling[j].dot(inverse * quadrature)));
    let (a, b, c, d) = (own[0] + cross(0, 0), cross(0, 1), cross(1, 0), own[1] + cross(1, 1));
    let determinant = times(a, d) - times(b, c);
    let first = divided(times(force[0], d) - times(b, force[1]), determinant);
    let second = divided(times(a, force[1]) - times(c, force[0]), determinant);
    inverse * (torque / -(n * n) - coupling[0] * first.x - coupling[1] * second.x)
}

/// Returns the largest share by which the steady response differs from Cramer's, from 12 to 30 rad/s.
fn worst_of_two_modes(damping: f64, spoil: f64) -> f64 {
    let axis = DVec3::new(1.0, 0.5, -0.3);
    let line = Harmonic { multiple: 1.0, torque_n_m_s2: IMBALANCE };
    let mut worst: f64 = 0.0;
    for speed in 12..30 {
        let n = f64::from(speed);
        let mut params = SpacecraftParams {
            wheels: vec![WheelParams { imbalance: vec![line], ..wheel(axis, n) }],
            modes: vec![mode(2.6, damping, DVec3::new(1.0, -2.0, 3.0)), mode(3.1, damping, DVec3::new(2.0, 1.5, 4.0))],
            ..bare(lopsided(), Span::from_ms(10))
        };
        let vibration = start(&params);
        let direction = vibration.lines[0].torque_direction();
        let torque = IMBALANCE * n * n;
        params.modes[0].frequency_hz += spoil;
        let wanted = two_modes(&params, n, direction * torque, axis.normalize().cross(direction) * torque);
        let got = vibration.sample(START).expect("the first sample");
        worst = worst.max((got - wanted).length() / wanted.length());
    }
    worst
}

#[test]
fn two_coupled_modes_respond_as_elimination_says() {
    // The neglected part of the damping matrix acts in proportion to the damping.
    let (light, heavy) = (worst_of_two_modes(1e-5, 0.0), worst_of_two_modes(1e-3, 0.0));
    assert!(light < 2e-4 && heavy < 2e-2, "{light:e} and {heavy:e}");
    let spoilt = worst_of_two_modes(1e-5, 0.01);
    assert!(spoilt > 1e-2, "negative control: a mode 0.01 Hz off: {spoilt:e}");
}
