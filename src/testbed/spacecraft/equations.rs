//! Equations of motion: state and held torques -> rates of change.
//!
//! Generalised momenta with `J` the inertia of the whole with wheels and appendages held still (Hughes, "Spacecraft
//! Attitude Dynamics" (1986), chapters 3 and 6; Markley and Crassidis, "Fundamentals of Spacecraft Attitude
//! Determination and Control" (2014), section 3.3):
//! ```text
//! H = J w + sum J_w W a + sum delta eta'          H' + w x H = T_ext
//! J_w (W' + a . w') = T_motor - friction(W) = u   eta'' + delta . w' = -2 z o eta' - o^2 eta = f
//! (J - sum J_w a a' - sum delta delta') w' = T_ext - w x H - sum a u - sum delta f
//! q' = -w q / 2
//! ```
//! `W` is a rotor's speed relative to the body. The last matrix is constant and inverted once. Limits: `J` does not
//! change with `eta` (small deflections); wheels are balanced here, `micro_vibration` has the rest.
//! `tests/conservation.rs`, `tests/closed_forms.rs` and `tests/flexible.rs` hold this file to theory.

use super::orbit::CircularOrbit;
use super::params::{DisturbanceParams, FlexibleMode, MODES_MAX, SpacecraftParams, WHEELS_MAX, WheelParams};
use core::f64::consts::TAU;
use glam::{DMat3, DQuat, DVec3};

/// Speed at which Coulomb friction has reached 76 % (`tanh 1`) of its value: keeps it differentiable at rest.
pub(super) const COULOMB_SMOOTHING_RAD_S: f64 = 0.5;

/// Returns the inertia that the body shows at once: the whole less free rotors about their axes, less appendages.
/// `J - sum J_w a a' - sum delta delta'`.
pub(super) fn reduced_inertia(params: &SpacecraftParams) -> DMat3 {
    let mut reduced = params.inertia_kg_m2;
    for wheel in &params.wheels {
        let axis = wheel.axis_body.normalize_or_zero();
        reduced -= outer(axis, axis) * wheel.inertia_kg_m2;
    }
    for mode in &params.modes {
        reduced -= outer(mode.coupling, mode.coupling);
    }
    reduced
}

/// Returns the outer product `a b'`.
pub(super) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// All that moves. Also its own derivative by time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct State {
    /// Body from ICRF.
    pub(super) q: DQuat,
    /// Rate of the body, body axes, rad/s.
    pub(super) rate: DVec3,
    /// Speeds of the rotors relative to the body, rad/s.
    pub(super) speeds: [f64; WHEELS_MAX],
    /// Modal coordinates, sqrt(kg) m.
    pub(super) modal: [f64; MODES_MAX],
    /// Their rates, sqrt(kg) m/s.
    pub(super) modal_rate: [f64; MODES_MAX],
}

/// Values that are constant during a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Held {
    /// Motor torques, N m.
    pub(super) motor: [f64; WHEELS_MAX],
    /// Torque from outside, body axes, N m: random walk, unloading and tests.
    pub(super) outside: DVec3,
}

/// One rotor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rotor {
    pub(super) axis: DVec3,
    pub(super) inertia_kg_m2: f64,
    inverse_inertia: f64,
    viscous_n_m_s: f64,
    coulomb_n_m: f64,
}

/// One cantilever mode.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mode {
    pub(super) coupling: DVec3,
    /// `o^2`, rad^2/s^2.
    pub(super) stiffness: f64,
    /// `2 z o`, rad/s.
    pub(super) damping: f64,
}

/// The constants of the equations.
#[derive(Debug, Clone)]
pub(super) struct Equations {
    pub(super) inertia: DMat3,
    inverse_reduced: DMat3,
    pub(super) rotors: Vec<Rotor>,
    pub(super) modes: Vec<Mode>,
    disturbance: DisturbanceParams,
    orbit: CircularOrbit,
    /// Seconds from the orbit's epoch to the start of the run.
    orbit_offset_s: f64,
}

impl Rotor {
    /// Returns the friction torque that brakes the rotor, N m.
    pub(super) fn friction_n_m(&self, speed_rad_s: f64) -> f64 {
        let viscous = self.viscous_n_m_s * speed_rad_s;
        if self.coulomb_n_m == 0.0 {
            return viscous;
        }
        viscous + self.coulomb_n_m * (speed_rad_s / COULOMB_SMOOTHING_RAD_S).tanh()
    }
}

impl State {
    /// Returns `self + derivative h`. The quaternion is left unnormalised: stages are points of a smooth field.
    fn plus(&self, derivative: &Self, h_s: f64) -> Self {
        let mut sum = *self;
        sum.add(derivative, h_s);
        sum
    }

    fn add(&mut self, derivative: &Self, h_s: f64) {
        self.q += derivative.q * h_s;
        self.rate += derivative.rate * h_s;
        for i in 0..WHEELS_MAX {
            self.speeds[i] += derivative.speeds[i] * h_s;
        }
        for i in 0..MODES_MAX {
            self.modal[i] += derivative.modal[i] * h_s;
            self.modal_rate[i] += derivative.modal_rate[i] * h_s;
        }
    }
}

impl Equations {
    /// Makes the equations from checked parameters; `orbit_offset_s` is the start of the run less the orbit's epoch.
    pub(super) fn new(params: &SpacecraftParams, orbit_offset_s: f64) -> Self {
        let rotor = |wheel: &WheelParams| Rotor {
            axis: wheel.axis_body.normalize_or_zero(),
            inertia_kg_m2: wheel.inertia_kg_m2,
            inverse_inertia: wheel.inertia_kg_m2.recip(),
            viscous_n_m_s: wheel.viscous_n_m_s,
            coulomb_n_m: wheel.coulomb_n_m,
        };
        let mode = |mode: &FlexibleMode| {
            let o = TAU * mode.frequency_hz;
            Mode { coupling: mode.coupling, stiffness: o * o, damping: 2.0 * mode.damping * o }
        };
        Self {
            inertia: params.inertia_kg_m2,
            inverse_reduced: reduced_inertia(params).inverse(),
            rotors: params.wheels.iter().map(rotor).collect(),
            modes: params.modes.iter().map(mode).collect(),
            disturbance: params.disturbance,
            orbit: CircularOrbit::new(&params.orbit),
            orbit_offset_s,
        }
    }

    /// Returns one step of the classical fourth-order Runge-Kutta method from `t_s` (s since the start of the run).
    pub(super) fn step(&self, from: &State, held: &Held, t_s: f64, h_s: f64) -> State {
        let middle = self.radial(t_s + 0.5 * h_s);
        let k1 = self.derivative(from, held, self.radial(t_s));
        let k2 = self.derivative(&from.plus(&k1, 0.5 * h_s), held, middle);
        let k3 = self.derivative(&from.plus(&k2, 0.5 * h_s), held, middle);
        let k4 = self.derivative(&from.plus(&k3, h_s), held, self.radial(t_s + h_s));
        let mut to = *from;
        to.add(&k1, h_s / 6.0);
        to.add(&k2, h_s / 3.0);
        to.add(&k3, h_s / 3.0);
        to.add(&k4, h_s / 6.0);
        to.q = to.q.normalize();
        to
    }

    /// Returns the acceleration of the body at `t_s`, body axes, rad/s^2.
    pub(super) fn acceleration(&self, state: &State, held: &Held, t_s: f64) -> DVec3 {
        self.derivative(state, held, self.radial(t_s)).rate
    }

    /// Returns the unit vector from the Earth's centre, ICRF; zero when gravity gradient is off.
    fn radial(&self, t_s: f64) -> DVec3 {
        if self.disturbance.gravity_gradient { self.orbit.radial(self.orbit_offset_s + t_s) } else { DVec3::ZERO }
    }

    /// Returns the angular momentum of everything, body axes, N m s.
    pub(super) fn momentum(&self, state: &State) -> DVec3 {
        let mut momentum = self.inertia * state.rate;
        for (rotor, speed) in self.rotors.iter().zip(&state.speeds) {
            momentum += rotor.axis * (rotor.inertia_kg_m2 * speed);
        }
        for (mode, rate) in self.modes.iter().zip(&state.modal_rate) {
            momentum += mode.coupling * *rate;
        }
        momentum
    }

    /// Returns the momentum of the rotors relative to the body, body axes, N m s.
    pub(super) fn wheel_momentum(&self, speeds: &[f64; WHEELS_MAX]) -> DVec3 {
        self.rotors.iter().zip(speeds).map(|(rotor, speed)| rotor.axis * (rotor.inertia_kg_m2 * speed)).sum()
    }

    /// Returns the kinetic and elastic energy, J.
    #[cfg(test)]
    pub(super) fn energy(&self, state: &State) -> f64 {
        let mut energy = 0.5 * state.rate.dot(self.inertia * state.rate);
        for (rotor, speed) in self.rotors.iter().zip(&state.speeds) {
            energy += rotor.inertia_kg_m2 * speed * (0.5 * speed + rotor.axis.dot(state.rate));
        }
        for (i, mode) in self.modes.iter().enumerate() {
            let (eta, eta_rate) = (state.modal[i], state.modal_rate[i]);
            energy += 0.5 * (eta_rate * eta_rate + mode.stiffness * eta * eta);
            energy += eta_rate * mode.coupling.dot(state.rate);
        }
        energy
    }

    fn derivative(&self, state: &State, held: &Held, radial: DVec3) -> State {
        let mut torque = held.outside + self.outside_torque(state.q, radial) - state.rate.cross(self.momentum(state));
        let mut rotor_torque = [0.0; WHEELS_MAX];
        for (i, rotor) in self.rotors.iter().enumerate() {
            rotor_torque[i] = held.motor[i] - rotor.friction_n_m(state.speeds[i]);
            torque -= rotor.axis * rotor_torque[i];
        }
        let mut modal_force = [0.0; MODES_MAX];
        for (i, mode) in self.modes.iter().enumerate() {
            modal_force[i] = -mode.damping * state.modal_rate[i] - mode.stiffness * state.modal[i];
            torque -= mode.coupling * modal_force[i];
        }
        let acceleration = self.inverse_reduced * torque;
        let mut speeds = [0.0; WHEELS_MAX];
        for (i, rotor) in self.rotors.iter().enumerate() {
            speeds[i] = rotor_torque[i] * rotor.inverse_inertia - rotor.axis.dot(acceleration);
        }
        let mut modal_acceleration = [0.0; MODES_MAX];
        for (i, mode) in self.modes.iter().enumerate() {
            modal_acceleration[i] = modal_force[i] - mode.coupling.dot(acceleration);
        }
        let half_turn = DQuat::from_xyzw(-0.5 * state.rate.x, -0.5 * state.rate.y, -0.5 * state.rate.z, 0.0);
        State {
            q: half_turn * state.q,
            rate: acceleration,
            speeds,
            modal: state.modal_rate,
            modal_rate: modal_acceleration,
        }
    }

    /// Returns the gravity gradient `3 mu / r^3  n x J n` (Hughes, chapter 8), solar pressure and the constant torque,
    /// body axes.
    fn outside_torque(&self, q: DQuat, radial: DVec3) -> DVec3 {
        let mut torque = self.disturbance.constant_torque_n_m;
        if self.disturbance.gravity_gradient {
            let n = q * radial;
            torque += n.cross(self.inertia * n) * (3.0 * self.orbit.rate_squared());
        }
        if self.disturbance.solar_torque_icrf_n_m != DVec3::ZERO {
            torque += q * self.disturbance.solar_torque_icrf_n_m;
        }
        torque
    }
}
