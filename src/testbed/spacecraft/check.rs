//! Parameters -> the first thing that is not physical.
//!
//! Steps are held to what the fourth-order method can do: `omega step <= 0.3` for every mode (amplitude error
//! `(omega step)^6 / 144 = 5e-6` of a step, far below the damping of any structure) and friction slopes whose time
//! constant is at least two steps. `tests/refusals.rs` breaks every rule once.

use super::equations::{COULOMB_SMOOTHING_RAD_S, reduced_inertia};
use super::params::{FlexibleMode, MODES_MAX, SpacecraftParams, WHEELS_MAX, WheelParams};
use base::{refused::Refused, time::Span};
use core::f64::consts::TAU;
use glam::DMat3;

/// Largest `omega step` of a mode.
const MODE_STEP_RAD: f64 = 0.3;
/// Largest step over the time constant of friction.
const FRICTION_STEP: f64 = 0.5;
/// Relative asymmetry of an inertia that passes as rounding of a configuration file.
const ASYMMETRY: f64 = 1e-9;
/// Shortest step: two seconds of history stay below 5 MB.
pub(super) const STEP_SMALLEST: Span = Span::from_ns(100_000);
/// Step above which the body itself would be badly integrated.
const STEP_LARGEST: Span = Span::from_ms(100);

/// Returns the first thing that is wrong with `params`.
///
/// # Errors
/// See [`Refused`].
pub(super) fn check(params: &SpacecraftParams) -> Result<(), Refused> {
    if !is_inertia(params.inertia_kg_m2) {
        return Err(Refused(format!(
            "inertia_kg_m2: wanted a symmetric, positive definite matrix whose principal moments obey the triangle \
         inequality, got {got}",
            got = params.inertia_kg_m2
        )));
    }
    if params.wheels.len() > WHEELS_MAX {
        return Err(Refused(format!("wheels: wanted at most {WHEELS_MAX}, got {got}", got = params.wheels.len())));
    }
    if params.modes.len() > MODES_MAX {
        return Err(Refused(format!("modes: wanted at most {MODES_MAX}, got {got}", got = params.modes.len())));
    }
    for (index, wheel) in params.wheels.iter().enumerate() {
        check_wheel(index, wheel)?;
    }
    for (index, mode) in params.modes.iter().enumerate() {
        check_mode(index, mode)?;
    }
    let reduced = reduced_inertia(params);
    if !is_positive_definite(reduced) {
        return Err(Refused(format!(
            "wheels and modes couple more inertia than the whole body has: inertia without them is {reduced} kg m^2"
        )));
    }
    check_outside(params)?;
    check_step(params)
}

/// Returns whether a body can have this inertia.
pub fn is_inertia(inertia: DMat3) -> bool {
    let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
    let skew = inertia - inertia.transpose();
    let is_symmetric = skew.to_cols_array().iter().all(|part| part.abs() <= ASYMMETRY * trace.abs());
    // Second moments of mass: not negative for any body. A flat plate's smallest is zero, so rounding is let pass.
    let second_moments = DMat3::IDENTITY * (0.5 + ASYMMETRY) * trace - inertia;
    inertia.is_finite() && is_symmetric && is_positive_definite(inertia) && is_positive_definite(second_moments)
}

/// Returns whether a matrix is positive definite (Sylvester's criterion).
fn is_positive_definite(m: DMat3) -> bool {
    let second = m.x_axis.x * m.y_axis.y - m.x_axis.y * m.y_axis.x;
    m.x_axis.x > 0.0 && second > 0.0 && m.determinant() > 0.0
}

/// Returns `got` when it is finite and `is_good`, or the error that says what was wanted.
pub(super) fn within(
    of: &'static str,
    index: usize,
    field: &'static str,
    got: f64,
    wanted: &'static str,
    is_good: bool,
) -> Result<(), Refused> {
    if got.is_finite() && is_good {
        Ok(())
    } else {
        Err(Refused(format!("{of} {index}: {field} = {got}, wanted {wanted}")))
    }
}

fn check_wheel(index: usize, wheel: &WheelParams) -> Result<(), Refused> {
    let check = |field, got: f64, wanted, is_good| within("wheel", index, field, got, wanted, is_good);
    let length = wheel.axis_body.length();
    check("length of axis_body", length, "more than 0", length > 0.0)?;
    let positive = [
        ("inertia_kg_m2", wheel.inertia_kg_m2),
        ("largest_torque_n_m", wheel.largest_torque_n_m),
        ("largest_speed_rad_s", wheel.largest_speed_rad_s),
    ];
    for (field, got) in positive {
        check(field, got, "more than 0", got > 0.0)?;
    }
    for (field, got) in [("viscous_n_m_s", wheel.viscous_n_m_s), ("coulomb_n_m", wheel.coulomb_n_m)] {
        check(field, got, "0 or more", got >= 0.0)?;
    }
    let speed = wheel.initial_speed_rad_s;
    check("initial_speed_rad_s", speed, "within the largest speed", speed.abs() <= wheel.largest_speed_rad_s)?;
    for harmonic in &wheel.imbalance {
        check("imbalance multiple", harmonic.multiple, "more than 0", harmonic.multiple > 0.0)?;
        check("imbalance torque_n_m_s2", harmonic.torque_n_m_s2, "0 or more", harmonic.torque_n_m_s2 >= 0.0)?;
    }
    Ok(())
}

fn check_mode(index: usize, mode: &FlexibleMode) -> Result<(), Refused> {
    let check = |field, got: f64, wanted, is_good| within("mode", index, field, got, wanted, is_good);
    check("frequency_hz", mode.frequency_hz, "more than 0", mode.frequency_hz > 0.0)?;
    check("damping", mode.damping, "0 or more and below 1", (0.0..1.0).contains(&mode.damping))?;
    check("length of coupling", mode.coupling.length(), "finite", true)
}

fn check_outside(params: &SpacecraftParams) -> Result<(), Refused> {
    let disturbance = &params.disturbance;
    let walk = disturbance.random_walk_n_m_sqrt_s;
    within("disturbance", 0, "random_walk_n_m_sqrt_s", walk, "0 or more", walk >= 0.0)?;
    for (field, torque) in [
        ("length of constant_torque_n_m", disturbance.constant_torque_n_m),
        ("length of solar_torque_icrf_n_m", disturbance.solar_torque_icrf_n_m),
    ] {
        within("disturbance", 0, field, torque.length(), "finite", true)?;
    }
    let unloading = &params.unloading;
    for (field, got) in [("gain_per_s", unloading.gain_per_s), ("largest_torque_n_m", unloading.largest_torque_n_m)] {
        within("unloading", 0, field, got, "0 or more", got >= 0.0)?;
    }
    let orbit = &params.orbit;
    within("orbit", 0, "altitude_m", orbit.altitude_m, "more than 0", orbit.altitude_m > 0.0)?;
    for (field, got) in [
        ("inclination_rad", orbit.inclination_rad),
        ("raan_rad", orbit.raan_rad),
        ("argument_of_latitude_rad", orbit.argument_of_latitude_rad),
    ] {
        within("orbit", 0, field, got, "finite", true)?;
    }
    Ok(())
}

fn check_step(params: &SpacecraftParams) -> Result<(), Refused> {
    let (step_s, smallest_s) = (params.step.s(), STEP_SMALLEST.s());
    let modes = params.modes.iter().map(|mode| (MODE_STEP_RAD / (TAU * mode.frequency_hz), "a mode's frequency"));
    let wheels = params.wheels.iter().map(|wheel| {
        let slope_n_m_s = wheel.viscous_n_m_s + wheel.coulomb_n_m / COULOMB_SMOOTHING_RAD_S;
        (FRICTION_STEP * wheel.inertia_kg_m2 / slope_n_m_s, "a wheel's friction")
    });
    let largest = [(STEP_LARGEST.s(), "the body")].into_iter().chain(modes).chain(wheels);
    for (largest_s, limited_by) in largest {
        if !(smallest_s..=largest_s).contains(&step_s) {
            return Err(Refused(format!(
                "step: {step_s} s, wanted at least {smallest_s} s and at most {largest_s} s for {limited_by}"
            )));
        }
    }
    Ok(())
}
