//! A spacecraft file: body, wheels, modes, disturbances, gyro, Sun sensor, control.

use crate::check::{Checker, Defaulted, Rule};
use crate::document::Document;
use crate::error::ConfigError;
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG};
use core::f64::consts::TAU;
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::path::Path;
use testbed::spacecraft::{
    CircularOrbitParams, DisturbanceParams, FlexibleMode, GyroParams, Harmonic, SpacecraftParams, UnloadingParams,
    WheelParams,
};

/// Revolutions per minute in rad/s.
const RPM: f64 = TAU / 60.0;
/// Square root of an hour in square roots of a second.
const SQRT_H: f64 = 60.0;

/// A spacecraft, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Spacecraft {
    /// What people call it.
    pub name: String,
    /// Body, wheels, modes, disturbances. The orbit is a placeholder: it is the bench's observer.
    pub params: SpacecraftParams,
    /// Body axis that safe mode turns to the Sun.
    pub sun_axis: DVec3,
    /// Gyro.
    pub gyro: GyroParams,
    /// Noise of the Sun sensor, rad, one sigma per axis.
    pub sun_sensor_noise_rad: f64,
    /// Control.
    pub control: Control,
    /// Values nobody gave.
    pub defaulted: Vec<Defaulted>,
}

/// Control settings, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// Gyro sampling and control step.
    pub period: Span,
    /// Bandwidth (natural frequency) of fine pointing, Hz.
    pub fine_bandwidth_hz: f64,
    /// Bandwidth of coarse pointing, Hz.
    pub coarse_bandwidth_hz: f64,
    /// Damping ratio of both.
    pub damping: f64,
    /// Largest rate of a slew, rad/s.
    pub slew_rate_rad_s: f64,
    /// Largest acceleration of a slew, rad/s^2.
    pub slew_acceleration_rad_s2: f64,
    /// A body axis that slews keep away from the Sun, and by how much, rad.
    pub keep_out: Option<(DVec3, f64)>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct SpacecraftKeys {
    name: Option<String>,
    body: BodyKeys,
    wheel: Vec<WheelKeys>,
    mode: Vec<ModeKeys>,
    disturbance: DisturbanceKeys,
    unloading: UnloadingKeys,
    gyro: GyroKeys,
    sun_sensor: SunSensorKeys,
    control: ControlKeys,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct BodyKeys {
    inertia_kg_m2: Option<[[f64; 3]; 3]>,
    step_ms: Option<f64>,
    sun_axis: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct WheelKeys {
    axis: Option<[f64; 3]>,
    inertia_kg_m2: Option<f64>,
    largest_torque_n_m: Option<f64>,
    largest_speed_rpm: Option<f64>,
    viscous_n_m_s: Option<f64>,
    coulomb_n_m: Option<f64>,
    initial_speed_rpm: Option<f64>,
    #[serde(default)]
    imbalance: Vec<[f64; 2]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModeKeys {
    frequency_hz: Option<f64>,
    damping: Option<f64>,
    coupling_sqrt_kg_m: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct DisturbanceKeys {
    gravity_gradient: Option<bool>,
    solar_torque_icrf_n_m: Option<[f64; 3]>,
    constant_torque_n_m: Option<[f64; 3]>,
    random_walk_n_m_sqrt_s: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct UnloadingKeys {
    gain_per_s: Option<f64>,
    largest_torque_n_m: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct GyroKeys {
    angle_random_walk_deg_sqrt_h: Option<f64>,
    rate_random_walk_deg_h_sqrt_h: Option<f64>,
    initial_bias_deg_h: Option<[f64; 3]>,
    scale_factor_ppm: Option<f64>,
    misalignment_arcsec: Option<[f64; 3]>,
    quantum_arcsec: Option<f64>,
    largest_rate_deg_s: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct SunSensorKeys {
    noise_deg: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ControlKeys {
    period_ms: Option<f64>,
    fine_bandwidth_hz: Option<f64>,
    coarse_bandwidth_hz: Option<f64>,
    damping: Option<f64>,
    slew_rate_deg_s: Option<f64>,
    slew_acceleration_deg_s2: Option<f64>,
    keep_out: Option<KeepOutKeys>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeepOutKeys {
    boresight_body: Option<[f64; 3]>,
    half_angle_deg: Option<f64>,
}

impl Spacecraft {
    /// Reads and checks a spacecraft file.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::from_document(&Document::open(path)?)
    }

    /// Checks a spacecraft that is already text.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn from_document(document: &Document) -> Result<Self, ConfigError> {
        let keys: SpacecraftKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.label(keys.name.clone())?;
        let inertia = "three rows of three numbers, symmetric, about the centre of mass";
        let missing = |check: &Checker<'_>| check.invalid("body.inertia_kg_m2", "missing", inertia, "kg m^2");
        let rows = keys.body.inertia_kg_m2.ok_or_else(|| missing(&check))?;
        let step = Rule::Within(0.1, 100.0);
        let step_ms = check.number("body.step_ms", keys.body.step_ms, 10.0, step, "5 to 20 ms are usual")?;
        let noise = "degrees, one sigma";
        let noise_rule = Rule::Within(0.0, 30.0);
        let noise_deg = check.number("sun_sensor.noise_deg", keys.sun_sensor.noise_deg, 0.5, noise_rule, noise)?;
        let axis = keys.body.sun_axis.unwrap_or([0.0, -1.0, 0.0]);
        let params = SpacecraftParams {
            inertia_kg_m2: DMat3::from_cols_array_2d(&rows).transpose(),
            wheels: wheels(&keys.wheel, &mut check)?,
            modes: modes(&keys.mode, &mut check)?,
            disturbance: disturbance(&keys.disturbance, &mut check)?,
            unloading: unloading(&keys.unloading, &mut check)?,
            orbit: placeholder_orbit(),
            step: Span::from_s(step_ms * 1e-3),
        };
        Ok(Self {
            name,
            params,
            sun_axis: direction("body.sun_axis", axis, &check)?,
            gyro: gyro(&keys.gyro, &mut check)?,
            sun_sensor_noise_rad: noise_deg * DEG,
            control: control(&keys.control, &mut check)?,
            defaulted: check.defaulted,
        })
    }
}

/// Replaced by the bench's observer before anything flies.
fn placeholder_orbit() -> CircularOrbitParams {
    CircularOrbitParams {
        epoch: Tai::from_ns(0),
        altitude_m: 500e3,
        inclination_rad: 0.0,
        raan_rad: 0.0,
        argument_of_latitude_rad: 0.0,
    }
}

fn direction(key: &str, given: [f64; 3], check: &Checker<'_>) -> Result<DVec3, ConfigError> {
    let direction = DVec3::from_array(given);
    if direction.is_finite() && direction.length() > 1e-6 {
        return Ok(direction.normalize());
    }
    let wanted = "three finite numbers that are not all 0";
    Err(check.invalid(key, format!("{given:?}"), wanted, "a direction in body axes, such as [0.0, 0.0, 1.0]"))
}

fn vector(key: &str, given: Option<[f64; 3]>, most: f64, check: &Checker<'_>) -> Result<DVec3, ConfigError> {
    let given = given.unwrap_or_default();
    for component in given {
        check.meets(key, component, Rule::Within(-most, most), "three numbers, body axes")?;
    }
    Ok(DVec3::from_array(given))
}

fn wheels(keys: &[WheelKeys], check: &mut Checker<'_>) -> Result<Vec<WheelParams>, ConfigError> {
    let mut wheels = Vec::with_capacity(keys.len());
    for (place, keys) in keys.iter().enumerate() {
        let key = |name: &str| format!("wheel[{place}].{name}");
        let mut number =
            |name: &str, given, default, rule, advice| check.number(&key(name), given, default, rule, advice);
        let inertia_kg_m2 = number("inertia_kg_m2", keys.inertia_kg_m2, 1e-3, Rule::Positive, "rotor, kg m^2")?;
        let torque = "largest torque of the motor, N m";
        let largest_torque_n_m = number("largest_torque_n_m", keys.largest_torque_n_m, 0.02, Rule::Positive, torque)?;
        let speed = "largest speed, rpm";
        let largest_rpm = number("largest_speed_rpm", keys.largest_speed_rpm, 6000.0, Rule::Positive, speed)?;
        let viscous = number("viscous_n_m_s", keys.viscous_n_m_s, 0.0, Rule::NotNegative, "viscous friction, N m s")?;
        let coulomb = number("coulomb_n_m", keys.coulomb_n_m, 0.0, Rule::NotNegative, "Coulomb friction, N m")?;
        let within = Rule::Within(-largest_rpm, largest_rpm);
        let initial_rpm = number("initial_speed_rpm", keys.initial_speed_rpm, 0.0, within, "speed at the start, rpm")?;
        let mut imbalance = Vec::with_capacity(keys.imbalance.len());
        for [multiple, torque_n_m_s2] in keys.imbalance.iter().copied() {
            let advice = "[multiple of the speed, N m s^2], such as [1.0, 2.0e-9]";
            check.meets(&key("imbalance"), multiple, Rule::PositiveUpTo(100.0), advice)?;
            check.meets(&key("imbalance"), torque_n_m_s2, Rule::NotNegative, advice)?;
            imbalance.push(Harmonic { multiple, torque_n_m_s2 });
        }
        let axis = keys.axis.ok_or_else(|| check.invalid(&key("axis"), "missing", "three numbers", "the spin axis"))?;
        wheels.push(WheelParams {
            axis_body: direction(&key("axis"), axis, check)?,
            inertia_kg_m2,
            largest_torque_n_m,
            largest_speed_rad_s: largest_rpm * RPM,
            viscous_n_m_s: viscous,
            coulomb_n_m: coulomb,
            initial_speed_rad_s: initial_rpm * RPM,
            imbalance,
        });
    }
    Ok(wheels)
}

fn modes(keys: &[ModeKeys], check: &mut Checker<'_>) -> Result<Vec<FlexibleMode>, ConfigError> {
    let mut modes = Vec::with_capacity(keys.len());
    for (place, keys) in keys.iter().enumerate() {
        let key = |name: &str| format!("mode[{place}].{name}");
        let frequency = "cantilever frequency, Hz";
        let frequency_hz =
            check.required(&key("frequency_hz"), keys.frequency_hz, Rule::PositiveUpTo(1000.0), frequency)?;
        let ratio = "damping ratio, such as 0.005";
        let damping = check.number(&key("damping"), keys.damping, 0.005, Rule::Within(0.0, 1.0), ratio)?;
        let coupling = vector(&key("coupling_sqrt_kg_m"), keys.coupling_sqrt_kg_m, 1e3, check)?;
        modes.push(FlexibleMode { frequency_hz, damping, coupling });
    }
    Ok(modes)
}

fn disturbance(keys: &DisturbanceKeys, check: &mut Checker<'_>) -> Result<DisturbanceParams, ConfigError> {
    let walk = "N m per square root of a second";
    let key = "disturbance.random_walk_n_m_sqrt_s";
    Ok(DisturbanceParams {
        constant_torque_n_m: vector("disturbance.constant_torque_n_m", keys.constant_torque_n_m, 1.0, check)?,
        solar_torque_icrf_n_m: vector("disturbance.solar_torque_icrf_n_m", keys.solar_torque_icrf_n_m, 1.0, check)?,
        random_walk_n_m_sqrt_s: check.number(key, keys.random_walk_n_m_sqrt_s, 0.0, Rule::NotNegative, walk)?,
        gravity_gradient: keys.gravity_gradient.unwrap_or(true),
    })
}

fn unloading(keys: &UnloadingKeys, check: &mut Checker<'_>) -> Result<UnloadingParams, ConfigError> {
    let mut number =
        |name: &str, given, advice| check.number(&format!("unloading.{name}"), given, 0.0, Rule::NotNegative, advice);
    Ok(UnloadingParams {
        gain_per_s: number("gain_per_s", keys.gain_per_s, "torque over the wheels' momentum, 1/s")?,
        largest_torque_n_m: number("largest_torque_n_m", keys.largest_torque_n_m, "per body axis, N m")?,
    })
}

fn gyro(keys: &GyroKeys, check: &mut Checker<'_>) -> Result<GyroParams, ConfigError> {
    let bias_deg_h = vector("gyro.initial_bias_deg_h", keys.initial_bias_deg_h, 1e5, check)?;
    let misalignment_arcsec = vector("gyro.misalignment_arcsec", keys.misalignment_arcsec, 36_000.0, check)?;
    let mut number =
        |name: &str, given, default, rule, advice| check.number(&format!("gyro.{name}"), given, default, rule, advice);
    let walk = "degrees per square root of an hour";
    let arw = number("angle_random_walk_deg_sqrt_h", keys.angle_random_walk_deg_sqrt_h, 0.01, Rule::NotNegative, walk)?;
    let drift = "degrees per hour and square root of an hour";
    let rrw =
        number("rate_random_walk_deg_h_sqrt_h", keys.rate_random_walk_deg_h_sqrt_h, 0.1, Rule::NotNegative, drift)?;
    let scale = "parts per million, the same on each axis";
    let ppm = number("scale_factor_ppm", keys.scale_factor_ppm, 0.0, Rule::Within(-1e5, 1e5), scale)?;
    let quantum = number("quantum_arcsec", keys.quantum_arcsec, 0.0, Rule::NotNegative, "angle of one count")?;
    let largest =
        number("largest_rate_deg_s", keys.largest_rate_deg_s, 30.0, Rule::PositiveUpTo(1000.0), "degrees per second")?;
    Ok(GyroParams {
        angle_random_walk_rad_sqrt_s: arw * DEG / SQRT_H,
        rate_random_walk_rad_s_sqrt_s: rrw * DEG / 3600.0 / SQRT_H,
        initial_bias_rad_s: bias_deg_h * (DEG / 3600.0),
        scale_factor_error: DVec3::splat(ppm * 1e-6),
        misalignment_rad: misalignment_arcsec * ARCSEC,
        quantum_rad: quantum * ARCSEC,
        largest_rate_rad_s: largest * DEG,
    })
}

fn control(keys: &ControlKeys, check: &mut Checker<'_>) -> Result<Control, ConfigError> {
    let keep_out = keys.keep_out.as_ref().map(|keys| keep_out(keys, check)).transpose()?;
    let mut number = |name: &str, given, default, rule, advice| {
        check.number(&format!("control.{name}"), given, default, rule, advice)
    };
    let step = "milliseconds between gyro samples and control steps";
    let period_ms = number("period_ms", keys.period_ms, 100.0, Rule::Within(1.0, 2000.0), step)?;
    let (bandwidth, natural) = (Rule::PositiveUpTo(50.0), "natural frequency of the loop, Hz");
    let degrees = "degrees per second";
    Ok(Control {
        period: Span::from_s(period_ms * 1e-3),
        fine_bandwidth_hz: number("fine_bandwidth_hz", keys.fine_bandwidth_hz, 0.05, bandwidth, natural)?,
        coarse_bandwidth_hz: number("coarse_bandwidth_hz", keys.coarse_bandwidth_hz, 0.02, bandwidth, natural)?,
        damping: number("damping", keys.damping, 0.8, Rule::Within(0.1, 5.0), "damping ratio")?,
        slew_rate_rad_s: DEG * number("slew_rate_deg_s", keys.slew_rate_deg_s, 0.5, Rule::PositiveUpTo(20.0), degrees)?,
        slew_acceleration_rad_s2: DEG
            * number(
                "slew_acceleration_deg_s2",
                keys.slew_acceleration_deg_s2,
                0.02,
                Rule::PositiveUpTo(20.0),
                "degrees per second squared",
            )?,
        keep_out,
    })
}

fn keep_out(keys: &KeepOutKeys, check: &Checker<'_>) -> Result<(DVec3, f64), ConfigError> {
    let boresight = keys.boresight_body.unwrap_or([0.0, 0.0, 1.0]);
    let angle = "degrees between this axis and the Sun";
    let half_angle_deg =
        check.required("control.keep_out.half_angle_deg", keys.half_angle_deg, Rule::Within(0.0, 120.0), angle)?;
    Ok((direction("control.keep_out.boresight_body", boresight, check)?, half_angle_deg * DEG))
}
