//! A spacecraft file: body, wheels, modes, disturbances, gyro, Sun sensor, control.

use crate::check::{Checker, Defaulted, Rule};
use crate::document::Document;
use crate::error::{Partly, Result};
use crate::file_kind::{FileKind, must_be};
use crate::key::{Given, listed, section, taken};
use crate::key_type::{Any, Numbers, Raw, Shape};
use crate::several::{check_all, check_partly};
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG, RPM};
use glam::{DMat3, DVec3};
use std::path::Path;
use testbed::spacecraft::{
    CircularOrbitParams, DisturbanceParams, FlexibleMode, GyroParams, Harmonic, SpacecraftParams, UnloadingParams,
    WheelParams, is_inertia,
};

/// Square root of an hour in square roots of a second.
const SQRT_H: f64 = 60.0;

/// A spacecraft, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Spacecraft {
    /// Name for people.
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
    /// Values that the file does not give.
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

section! {
    /// A spacecraft: body, wheels, modes, disturbances, gyro, Sun sensor, control.
    SpacecraftKeys at "" {
        /// Name of the spacecraft.
        name: String = Computed("the file's name"), "text";
        tables:
        /// The rigid body.
        body: BodyKeys;
        /// A reaction wheel.
        wheel: Vec<WheelKeys>;
        /// A flexible mode.
        mode: Vec<ModeKeys>;
        /// Disturbance torques.
        disturbance: DisturbanceKeys;
        /// Unloading of the wheels by magnetic torquers.
        unloading: UnloadingKeys;
        /// The gyro.
        gyro: GyroKeys;
        /// The Sun sensor of safe mode.
        sun_sensor: SunSensorKeys;
        /// Attitude control.
        control: ControlKeys;
    }

    /// The rigid body.
    BodyKeys at "body" {
        /// Inertia about the centre of mass: three rows of three numbers, symmetric, kg m^2.
        inertia_kg_m2: Raw<[[f64; 3]; 3]> = Needed, Shape::Row(3, Box::new(Shape::numbers(3))), "kg m^2";
        /// Step of the dynamics; 5 to 20 ms are usual.
        step_ms: f64 = 10.0, Within(0.1, 100.0);
        /// Body axis that safe mode turns to the Sun.
        sun_axis: [f64; 3] = Silent(Numbers([0.0, -1.0, 0.0])), Finite, DIRECTION;
    }

    /// A reaction wheel.
    WheelKeys at "wheel" {
        /// The spin axis.
        axis: [f64; 3] = Needed, Finite, DIRECTION;
        /// Inertia of the rotor, kg m^2.
        inertia_kg_m2: f64 = 1e-3, Positive;
        /// Largest torque of the motor, N m.
        largest_torque_n_m: f64 = 0.02, Positive;
        /// Largest speed, rpm.
        largest_speed_rpm: f64 = 6000.0, Positive;
        /// Viscous friction, N m s.
        viscous_n_m_s: f64 = 0.0, NotNegative;
        /// Dry friction (Coulomb's), N m.
        coulomb_n_m: f64 = 0.0, NotNegative;
        /// Speed at the start, rpm.
        initial_speed_rpm: f64 = 0.0, Finite;
        /// Harmonics of imbalance: rows of [multiple of the speed, N m s^2], such as [1.0, 2.0e-9].
        imbalance: Raw<Vec<[f64; 2]>> = Optional, Shape::pairs();
    }

    /// A flexible mode.
    ModeKeys at "mode" {
        /// Cantilever frequency, Hz.
        frequency_hz: f64 = Needed, PositiveUpTo(1000.0);
        /// Damping ratio, such as 0.005.
        damping: f64 = 0.005, Within(0.0, 1.0);
        /// Coupling to the body's rotation, square root of kilograms times metres.
        coupling_sqrt_kg_m: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-1e3, 1e3), AXES;
    }

    /// Disturbance torques.
    DisturbanceKeys at "disturbance" {
        /// The Earth's gravity gradient acts.
        gravity_gradient: bool = Silent(true), Any;
        /// Torque of the Sun's light, ICRF axes, N m.
        solar_torque_icrf_n_m: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-1.0, 1.0), AXES;
        /// Constant torque, body axes, N m.
        constant_torque_n_m: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-1.0, 1.0), AXES;
        /// Random walk of the torque, N m per square root of a second.
        random_walk_n_m_sqrt_s: f64 = 0.0, NotNegative;
    }

    /// Unloading of the wheels.
    UnloadingKeys at "unloading" {
        /// Torque over the wheels' momentum, 1/s.
        gain_per_s: f64 = 0.0, NotNegative;
        /// Largest torque per body axis, N m.
        largest_torque_n_m: f64 = 0.0, NotNegative;
    }

    /// The gyro.
    GyroKeys at "gyro" {
        /// Angle random walk, degrees per square root of an hour.
        angle_random_walk_deg_sqrt_h: f64 = 0.01, NotNegative;
        /// Rate random walk, degrees per hour and square root of an hour.
        rate_random_walk_deg_h_sqrt_h: f64 = 0.1, NotNegative;
        /// Bias at the start, degrees per hour about the body axes.
        initial_bias_deg_h: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-1e5, 1e5), AXES;
        /// Error of the scale factor, parts per million, the same on each axis.
        scale_factor_ppm: f64 = 0.0, Within(-1e5, 1e5);
        /// Misalignment about the body axes, arcseconds.
        misalignment_arcsec: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-36_000.0, 36_000.0), AXES;
        /// Angle of one count.
        quantum_arcsec: f64 = 0.0, NotNegative;
        /// Largest rate that it measures, degrees per second.
        largest_rate_deg_s: f64 = 30.0, PositiveUpTo(1000.0);
    }

    /// The Sun sensor.
    SunSensorKeys at "sun_sensor" {
        /// Noise per axis in degrees, one sigma.
        noise_deg: f64 = 0.5, Within(0.0, 30.0);
    }

    /// Attitude control.
    ControlKeys at "control" {
        /// Milliseconds between gyro samples and control steps.
        period_ms: f64 = 100.0, Within(1.0, 2000.0);
        /// Natural frequency of the loop in fine pointing, Hz.
        fine_bandwidth_hz: f64 = 0.05, PositiveUpTo(50.0);
        /// Natural frequency of the loop in coarse pointing, Hz.
        coarse_bandwidth_hz: f64 = 0.02, PositiveUpTo(50.0);
        /// Damping ratio.
        damping: f64 = 0.8, Within(0.1, 5.0);
        /// Largest rate of a slew, degrees per second.
        slew_rate_deg_s: f64 = 0.5, PositiveUpTo(20.0);
        /// Largest acceleration of a slew, degrees per second squared.
        slew_acceleration_deg_s2: f64 = 0.02, PositiveUpTo(20.0);
        tables:
        /// A body axis that slews keep away from the Sun.
        keep_out: Option<KeepOutKeys>;
    }

    /// A body axis that slews keep away from the Sun.
    KeepOutKeys at "control.keep_out" {
        /// The axis.
        boresight_body: [f64; 3] = Silent(Numbers([0.0, 0.0, 1.0])), Finite, DIRECTION;
        /// Degrees between this axis and the Sun.
        half_angle_deg: f64 = Needed, Within(0.0, 120.0);
    }
}

const AXES: &str = "three numbers, body axes";
const DIRECTION: &str = "a direction in body axes, such as [0.0, 0.0, 1.0]";

impl Spacecraft {
    /// Reads and checks a spacecraft file.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn load(path: &Path) -> Result<Self> {
        Self::from_document(&Document::open(path)?)
    }

    /// Checks a spacecraft that is already text.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn from_document(document: &Document) -> Result<Self> {
        must_be(FileKind::Spacecraft, document)?;
        check_all(document, Self::checked)
    }

    /// Checks a spacecraft that a run names: the spacecraft without what is wrong, and what is wrong.
    pub(super) fn partly(document: &Document) -> Result<Partly<Self>> {
        must_be(FileKind::Spacecraft, document)?;
        check_partly(document, Self::checked)
    }

    fn checked(document: &Document) -> Result<Partly<Self>> {
        let keys: SpacecraftKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.label(keys.name().raw().cloned())?;
        let inertia = keys.body.inertia_kg_m2();
        let wanted = "three rows of three numbers, symmetric, about the centre of mass";
        let rows = inertia.raw().ok_or_else(|| inertia.missing(wanted, &check))?;
        let inertia_kg_m2 = DMat3::from_cols_array_2d(rows).transpose();
        if !is_inertia(inertia_kg_m2) {
            let wanted = "a symmetric, positive definite matrix, no principal moment above the sum of the other two";
            let advice = "such as [[12.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 10.0]], about the centre of mass";
            return Err(inertia.advised(advice).invalid(format!("{rows:?}"), wanted, &check));
        }
        let step = keys.body.step_ms().ms(&mut check)?;
        let noise_deg = keys.sun_sensor.noise_deg().check(&mut check)?;
        let wheel = |keys: &WheelKeys| keys.params(&mut check);
        let wheels = listed(&keys.wheel, "wheel").iter().map(wheel).collect::<Result<_, _>>()?;
        let mode = |keys: &ModeKeys| keys.params(&mut check);
        let modes = listed(&keys.mode, "mode").iter().map(mode).collect::<Result<_, _>>()?;
        let params = SpacecraftParams {
            inertia_kg_m2,
            wheels,
            modes,
            disturbance: disturbance(&keys.disturbance, &mut check)?,
            unloading: unloading(&keys.unloading, &mut check)?,
            orbit: placeholder_orbit(),
            step,
        };
        let spacecraft = Self {
            name,
            params,
            sun_axis: direction(keys.body.sun_axis(), &mut check)?,
            gyro: gyro(&keys.gyro, &mut check)?,
            sun_sensor_noise_rad: noise_deg * DEG,
            control: control(&keys.control, &mut check)?,
            defaulted: check.defaulted,
        };
        Ok((spacecraft, check.named_errors))
    }
}

/// Returns the replaced by the bench's observer before anything flies.
fn placeholder_orbit() -> CircularOrbitParams {
    CircularOrbitParams {
        epoch: Tai::from_ns(0),
        altitude_m: 500e3,
        inclination_rad: 0.0,
        raan_rad: 0.0,
        argument_of_latitude_rad: 0.0,
    }
}

fn direction(given: Given<'_, [f64; 3]>, check: &mut Checker<'_>) -> Result<DVec3> {
    let key = given.key();
    let advice = given.advice.clone();
    let components = given.check(check)?;
    let direction = DVec3::from_array(components);
    if direction.length() > 1e-6 {
        return Ok(direction.normalize());
    }
    let wanted = "three finite numbers that are not all 0";
    Err(check.invalid(&key, format!("{components:?}"), wanted, &advice))
}

impl WheelKeys {
    fn params(&self, check: &mut Checker<'_>) -> Result<WheelParams> {
        taken!(check, self => inertia_kg_m2, largest_torque_n_m, largest_speed_rpm, viscous_n_m_s, coulomb_n_m);
        let initial_speed = self.initial_speed_rpm().within(Rule::Within(-largest_speed_rpm, largest_speed_rpm));
        let initial_rpm = initial_speed.check(check)?;
        let given = self.imbalance();
        let mut imbalance = Vec::new();
        for [multiple, torque_n_m_s2] in given.raw().into_iter().flatten().copied() {
            check.meets(&given.key(), multiple, Rule::PositiveUpTo(100.0), &given.advice)?;
            check.meets(&given.key(), torque_n_m_s2, Rule::NotNegative, &given.advice)?;
            imbalance.push(Harmonic { multiple, torque_n_m_s2 });
        }
        Ok(WheelParams {
            axis_body: direction(self.axis(), check)?,
            inertia_kg_m2,
            largest_torque_n_m,
            largest_speed_rad_s: largest_speed_rpm * RPM,
            viscous_n_m_s,
            coulomb_n_m,
            initial_speed_rad_s: initial_rpm * RPM,
            imbalance,
        })
    }
}

impl ModeKeys {
    fn params(&self, check: &mut Checker<'_>) -> Result<FlexibleMode> {
        taken!(check, self => frequency_hz, damping, coupling_sqrt_kg_m);
        Ok(FlexibleMode { frequency_hz, damping, coupling: DVec3::from_array(coupling_sqrt_kg_m) })
    }
}

fn disturbance(keys: &DisturbanceKeys, check: &mut Checker<'_>) -> Result<DisturbanceParams> {
    taken!(check, keys => constant_torque_n_m, solar_torque_icrf_n_m, random_walk_n_m_sqrt_s, gravity_gradient);
    Ok(DisturbanceParams {
        constant_torque_n_m: DVec3::from_array(constant_torque_n_m),
        solar_torque_icrf_n_m: DVec3::from_array(solar_torque_icrf_n_m),
        random_walk_n_m_sqrt_s,
        gravity_gradient,
    })
}

fn unloading(keys: &UnloadingKeys, check: &mut Checker<'_>) -> Result<UnloadingParams> {
    taken!(check, keys => gain_per_s, largest_torque_n_m);
    Ok(UnloadingParams { gain_per_s, largest_torque_n_m })
}

fn gyro(keys: &GyroKeys, check: &mut Checker<'_>) -> Result<GyroParams> {
    taken!(check, keys => initial_bias_deg_h, misalignment_arcsec, angle_random_walk_deg_sqrt_h);
    taken!(check, keys => rate_random_walk_deg_h_sqrt_h, scale_factor_ppm, quantum_arcsec, largest_rate_deg_s);
    Ok(GyroParams {
        angle_random_walk_rad_sqrt_s: angle_random_walk_deg_sqrt_h * DEG / SQRT_H,
        rate_random_walk_rad_s_sqrt_s: rate_random_walk_deg_h_sqrt_h * DEG / 3600.0 / SQRT_H,
        initial_bias_rad_s: DVec3::from_array(initial_bias_deg_h) * (DEG / 3600.0),
        scale_factor_error: DVec3::splat(scale_factor_ppm * 1e-6),
        misalignment_rad: DVec3::from_array(misalignment_arcsec) * ARCSEC,
        quantum_rad: quantum_arcsec * ARCSEC,
        largest_rate_rad_s: largest_rate_deg_s * DEG,
    })
}

fn control(keys: &ControlKeys, check: &mut Checker<'_>) -> Result<Control> {
    let keep_out = keys.keep_out.as_ref().map(|keys| keep_out(keys, check)).transpose()?;
    let period = keys.period_ms().ms(check)?;
    taken!(check, keys => fine_bandwidth_hz, coarse_bandwidth_hz, damping, slew_rate_deg_s, slew_acceleration_deg_s2);
    Ok(Control {
        period,
        fine_bandwidth_hz,
        coarse_bandwidth_hz,
        damping,
        slew_rate_rad_s: DEG * slew_rate_deg_s,
        slew_acceleration_rad_s2: DEG * slew_acceleration_deg_s2,
        keep_out,
    })
}

fn keep_out(keys: &KeepOutKeys, check: &mut Checker<'_>) -> Result<(DVec3, f64)> {
    let half_angle_deg = keys.half_angle_deg().check(check)?;
    Ok((direction(keys.boresight_body(), check)?, half_angle_deg * DEG))
}
