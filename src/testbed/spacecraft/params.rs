//! Parameters of a spacecraft. Plain data; `check.rs` refuses values that are not physical.

use base::time::{Span, Tai};
use glam::{DMat3, DVec3};

/// Most reaction wheels of one spacecraft.
pub const WHEELS_MAX: usize = 6;
/// Most flexible modes of one spacecraft.
pub const MODES_MAX: usize = 4;

/// One spacecraft.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacecraftParams {
    /// Inertia about the centre of mass, body axes, kg m^2: everything aboard, wheels and appendages held still.
    pub inertia_kg_m2: DMat3,
    /// Reaction wheels, at most [`WHEELS_MAX`].
    pub wheels: Vec<WheelParams>,
    /// Flexible modes, at most [`MODES_MAX`].
    pub modes: Vec<FlexibleMode>,
    /// Torques from outside.
    pub disturbance: DisturbanceParams,
    /// Unloading of the wheels' momentum.
    pub unloading: UnloadingParams,
    /// Orbit: gravity gradient, velocity for aberration, eclipse.
    pub orbit: CircularOrbitParams,
    /// Integration step; 5 to 20 ms are usual.
    pub step: Span,
}

/// One reaction wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct WheelParams {
    /// Spin axis, body axes; of any length.
    pub axis_body: DVec3,
    /// Inertia of the rotor about its spin axis, kg m^2.
    pub inertia_kg_m2: f64,
    /// Largest motor torque either way, N m.
    pub largest_torque_n_m: f64,
    /// Largest speed either way, rad/s: the motor takes the rotor no further.
    pub largest_speed_rad_s: f64,
    /// Viscous friction, N m s.
    pub viscous_n_m_s: f64,
    /// Coulomb friction at full sliding, N m.
    pub coulomb_n_m: f64,
    /// Speed relative to the body at the start, rad/s.
    pub initial_speed_rad_s: f64,
    /// Imbalance and bearing harmonics.
    pub imbalance: Vec<Harmonic>,
}

/// One disturbance of a wheel whose frequency follows its speed. Masterson, Miller and Grogan, "Development and
/// validation of reaction wheel disturbance models", J. Sound and Vibration 249 (2002): amplitude `U Omega^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Harmonic {
    /// Frequency over the wheel's speed: 1 is imbalance, others come from the bearings.
    pub multiple: f64,
    /// Torque amplitude over the square of the speed, N m s^2: dynamic imbalance, and static imbalance times its
    /// lever arm.
    pub torque_n_m_s2: f64,
}

/// One mode of an appendage, seen with the body held still ("cantilever").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlexibleMode {
    /// Cantilever frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Coupling to the body's rotation, body axes, sqrt(kg) m.
    pub coupling: DVec3,
}

/// Torques from outside. `Default`: none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DisturbanceParams {
    /// Constant in body axes, N m: a leak, a residual dipole's mean.
    pub constant_torque_n_m: DVec3,
    /// Constant in ICRF, N m: solar pressure while the attitude to the Sun is kept.
    pub solar_torque_icrf_n_m: DVec3,
    /// Random walk of a body torque, per axis, N m / sqrt(s).
    pub random_walk_n_m_sqrt_s: f64,
    /// Gravity gradient in the given orbit.
    pub gravity_gradient: bool,
}

/// External torque `-gain h` of the wheels' momentum `h`, limited per body axis: thrusters or an idealised magnetic
/// law. `Default`: none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnloadingParams {
    /// Gain, 1/s.
    pub gain_per_s: f64,
    /// Largest torque per body axis, N m.
    pub largest_torque_n_m: f64,
}

/// A circular orbit about a spherical Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircularOrbitParams {
    /// Instant of `argument_of_latitude_rad`.
    pub epoch: Tai,
    /// Height above the equatorial radius, m.
    pub altitude_m: f64,
    /// Inclination, rad.
    pub inclination_rad: f64,
    /// Right ascension of the ascending node, rad.
    pub raan_rad: f64,
    /// Angle from the node to the spacecraft at the epoch, rad.
    pub argument_of_latitude_rad: f64,
}
