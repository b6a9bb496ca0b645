//! Parameters of a vehicle: spacecraft, sensors, estimator, control, heads.

use crate::spacecraft::{GyroParams, SpacecraftParams, TestTorque};
use crate::tracker::{CameraOrders, TrackerParams};
use crate::{acs::AcsParams, estimator::MekfParams};
use base::axes::{Body, Icrf, Rotation, Sensor};
use base::time::Span;
use glam::DVec3;

/// One vehicle.
#[derive(Debug, Clone)]
pub struct VehicleParams {
    /// Body, wheels, modes, disturbances, orbit.
    pub spacecraft: SpacecraftParams,
    /// Attitude at the start.
    pub initial: Rotation<Body, Icrf>,
    /// Rate at the start, body axes.
    pub initial_rate_rad_s: DVec3,
    /// Gyro.
    pub gyro: GyroParams,
    /// Noise of the Sun sensor, rad, one sigma per axis.
    pub sun_sensor_noise_rad: f64,
    /// Estimator.
    pub estimator: MekfParams,
    /// Above this sigma the attitude counts as unknown, rad.
    pub attitude_known_sigma_rad: f64,
    /// Control; its period is that of the gyro and must be whole steps of the spacecraft.
    pub acs: AcsParams,
    /// Where to point from the start.
    pub target: Rotation<Body, Icrf>,
    /// Star tracker heads.
    pub heads: Vec<HeadParams>,
    /// Time between a control step and its torque: what is injected to study latency.
    pub actuation_delay: Span,
    /// Delay of the time tags of frames: a date error unknown to the estimator. It shows as rate times error while the
    /// body turns, and not at rest.
    pub tag_error: Span,
    /// Torques from outside by which the loop is tested.
    pub test_torques: Vec<TestTorque>,
    /// Time between samples of micro-vibration; `None`: none is computed.
    pub vibration_period: Option<Span>,
    /// In safe mode with an attitude known for so long the ground sends `Resume`; `None`: never.
    pub resume_after: Option<Span>,
    /// Control steps from one row of telemetry to the next.
    pub telemetry_every: u32,
    /// Seed of every sensor's noise.
    pub seed: u64,
}

/// One head.
#[derive(Debug, Clone, Copy)]
pub struct HeadParams {
    /// Mounting.
    pub sensor_from_body: Rotation<Sensor, Body>,
    /// Parameters of the tracker.
    pub tracker: TrackerParams,
    /// From the last pixel to the attitude.
    pub delay: Span,
    /// Limits of its commands to its camera; `None`: it sends none.
    pub orders: Option<CameraOrders>,
}
