//! The spacecraft against theory written afresh. One file per subject.

mod closed_forms;
mod conservation;
mod flexible;
mod gyro;
mod micro_vibration;
mod refusals;
mod truth;
mod wheels;

use super::*;
use glam::DMat3;

/// Some instant.
const START: Tai = Tai::from_ns(1_790_000_000_000_000_000);

/// Returns a body and nothing else: no wheels, modes or torques.
fn bare(inertia_kg_m2: DMat3, step: Span) -> SpacecraftParams {
    SpacecraftParams {
        inertia_kg_m2,
        wheels: Vec::new(),
        modes: Vec::new(),
        disturbance: DisturbanceParams::default(),
        unloading: UnloadingParams::default(),
        orbit: CircularOrbitParams {
            epoch: START,
            altitude_m: 600e3,
            inclination_rad: 1.7,
            raan_rad: 0.5,
            argument_of_latitude_rad: 0.3,
        },
        step,
    }
}

/// Returns a body with products of inertia.
fn lopsided() -> DMat3 {
    DMat3::from_cols(DVec3::new(120.0, 4.0, -3.0), DVec3::new(4.0, 100.0, 6.0), DVec3::new(-3.0, 6.0, 80.0))
}

/// Returns a wheel without friction.
fn wheel(axis_body: DVec3, initial_speed_rad_s: f64) -> WheelParams {
    WheelParams {
        axis_body,
        inertia_kg_m2: 0.02,
        largest_torque_n_m: 0.1,
        largest_speed_rad_s: 600.0,
        viscous_n_m_s: 0.0,
        coulomb_n_m: 0.0,
        initial_speed_rad_s,
        imbalance: Vec::new(),
    }
}

/// Returns four wheels on a pyramid, running.
fn pyramid() -> Vec<WheelParams> {
    let axis = |x, y| DVec3::new(x, y, 0.7);
    vec![
        wheel(axis(1.0, 1.0), 150.0),
        wheel(axis(-1.0, 1.0), -90.0),
        wheel(axis(-1.0, -1.0), 200.0),
        wheel(axis(1.0, -1.0), 40.0),
    ]
}

fn mode(frequency_hz: f64, damping: f64, coupling: DVec3) -> FlexibleMode {
    FlexibleMode { frequency_hz, damping, coupling }
}

fn at_rest(params: &SpacecraftParams) -> Spacecraft {
    turning(params, DVec3::ZERO)
}

fn turning(params: &SpacecraftParams, rate_rad_s: DVec3) -> Spacecraft {
    let attitude = Rotation::IDENTITY.rotated_by(DVec3::new(0.4, -1.1, 0.7));
    Spacecraft::new(params, START, attitude, rate_rad_s, 1).expect("sound parameters")
}

fn after(t_s: f64) -> Tai {
    START + Span::from_s(t_s)
}
