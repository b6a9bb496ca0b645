//! Actions of an external controller or star tracker on a spacecraft that is flown inside.
//!
//! | request | keys | effect |
//! |---|---|---|
//! | `control` | `by`, `trackers`: `"outside"` or `"inside"` | who drives the wheels, whose trackers the estimator gets |
//! | `wheels` | `torques_n_m` of the motors on their rotors, `at_s` (left out: now) | held until the next such request |
//! | `torque` | `torque_n_m` on the body, `at_s` (left out: now), `for_s` | on top of all other torques |
//! | `tracker_attitude` | `at_s` of mid-exposure, `body_from_icrf`, `sigma_arcsec` (one, or about each body axis) | into the estimator |
//!
//! Tests: below, and `tests/closed_loop/reaction.rs`.

use base::axes::{Body, COMPUTED_NORM_TOLERANCE, Icrf, Rotation};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use glam::DVec3;
use serde_json::{Map, Value, json};
use testbed::vehicle::Vehicle;

/// One parsed request.
#[derive(Debug, Clone, PartialEq)]
pub enum Reaction {
    /// Selects who drives the wheels and whose trackers are used: true is outside.
    Control {
        /// Driver of the wheels; `None`: unchanged.
        by: Option<bool>,
        /// Owner of the trackers in use; `None`: unchanged.
        trackers: Option<bool>,
    },
    /// Torques of the wheels' motors.
    Wheels {
        /// On each rotor, N m.
        torques_n_m: Vec<f64>,
        /// Start, s after the first exposure; `None`: now.
        at_s: Option<f64>,
    },
    /// A torque on the body.
    Torque {
        /// Body axes, N m.
        torque_n_m: DVec3,
        /// Start, s after the first exposure; `None`: now.
        at_s: Option<f64>,
        /// Duration, s.
        for_s: f64,
    },
    /// An attitude of an external tracker.
    Attitude {
        /// Its time tag, s after the first exposure.
        at_s: f64,
        /// Attitude.
        body_from_icrf: Rotation<Body, Icrf>,
        /// Error about each body axis, rad.
        sigma_rad: DVec3,
    },
}

impl Reaction {
    /// Reads the request of this name.
    pub(super) fn read(name: &str, keys: &Map<String, Value>) -> Result<Self, String> {
        let at_s = number(keys, "at_s")?;
        let wanted = |key: &str| format!("{key} is missing");
        Ok(match name {
            "control" => {
                let (by, trackers) = (side(keys, "by")?, side(keys, "trackers")?);
                if by.is_none() && trackers.is_none() {
                    return Err("control has neither by nor trackers; wanted \"outside\" or \"inside\" for one".into());
                }
                Self::Control { by, trackers }
            }
            "wheels" => {
                let torques_n_m = numbers(keys, "torques_n_m")?.ok_or_else(|| wanted("torques_n_m"))?;
                Self::Wheels { torques_n_m, at_s }
            }
            "torque" => {
                let torque_n_m = vector(keys, "torque_n_m")?.ok_or_else(|| wanted("torque_n_m"))?;
                Self::Torque { torque_n_m, at_s, for_s: number(keys, "for_s")?.ok_or_else(|| wanted("for_s"))? }
            }
            _ => {
                let sigma_arcsec = match number(keys, "sigma_arcsec") {
                    Ok(Some(sigma)) => DVec3::splat(sigma),
                    Ok(None) | Err(_) => vector(keys, "sigma_arcsec")?.ok_or_else(|| wanted("sigma_arcsec"))?,
                };
                let at_s = at_s.ok_or_else(|| wanted("at_s"))?;
                Self::Attitude { at_s, body_from_icrf: rotation(keys)?, sigma_rad: sigma_arcsec * ARCSEC }
            }
        })
    }

    /// Applies the request to a vehicle at the run's time.
    pub(super) fn act(&self, vehicle: &mut Vehicle, zero: Tai, now: Tai) -> Result<Value, String> {
        let instant = |at_s: Option<f64>| at_s.map_or(now, |at_s| zero + Span::from_s(at_s));
        let done = match self {
            Self::Control { by, trackers } => {
                by.iter().for_each(|to_outside| vehicle.hand_over(*to_outside, now));
                trackers.iter().for_each(|to_outside| vehicle.hand_over_trackers(*to_outside));
                Ok(())
            }
            Self::Wheels { torques_n_m, at_s } => vehicle.drive_wheels(torques_n_m, instant(*at_s), now),
            Self::Torque { torque_n_m, at_s, for_s } => {
                vehicle.push(*torque_n_m, instant(*at_s), Span::from_s(*for_s), now)
            }
            Self::Attitude { at_s, body_from_icrf, sigma_rad } => {
                vehicle.take_attitude(instant(Some(*at_s)), *body_from_icrf, *sigma_rad, now)
            }
        };
        done.map_err(|error| error.to_string())?;
        let by = if vehicle.is_driven_outside { "outside" } else { "inside" };
        Ok(json!({ "now_s": (now - zero).s(), "control": by }))
    }
}

fn number(keys: &Map<String, Value>, key: &str) -> Result<Option<f64>, String> {
    let Some(value) = keys.get(key) else { return Ok(None) };
    value.as_f64().map(Some).ok_or_else(|| format!("{key} is {value}; wanted a number"))
}

fn numbers(keys: &Map<String, Value>, key: &str) -> Result<Option<Vec<f64>>, String> {
    let Some(value) = keys.get(key) else { return Ok(None) };
    let list = value.as_array().filter(|list| list.len() <= 64);
    let read = list.and_then(|list| list.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>());
    read.map(Some)
        .ok_or_else(|| format!("{key} is not a list of at most 64 numbers; wanted a list such as [0.01, 0, 0]"))
}

fn vector(keys: &Map<String, Value>, key: &str) -> Result<Option<DVec3>, String> {
    let Some(numbers) = numbers(keys, key)? else { return Ok(None) };
    let array = <[f64; 3]>::try_from(numbers.as_slice());
    array.map(|array| Some(array.into())).map_err(|_| format!("{key} has {} numbers; wanted three", numbers.len()))
}

fn rotation(keys: &Map<String, Value>) -> Result<Rotation<Body, Icrf>, String> {
    let key = "body_from_icrf";
    let numbers = numbers(keys, key)?.ok_or_else(|| format!("{key} is missing; wanted a quaternion [w, x, y, z]"))?;
    let wxyz = <[f64; 4]>::try_from(numbers.as_slice()).ok();
    let unit = wxyz.and_then(|wxyz| Rotation::from_wxyz(wxyz, COMPUTED_NORM_TOLERANCE));
    unit.ok_or_else(|| {
        format!("{key} is {numbers:?}; wanted a quaternion [w, x, y, z] of norm 1 within {COMPUTED_NORM_TOLERANCE}")
    })
}

/// Reads a side: true is outside.
fn side(keys: &Map<String, Value>, key: &str) -> Result<Option<bool>, String> {
    match keys.get(key).map(|value| (value, value.as_str())) {
        None => Ok(None),
        Some((_, Some("outside"))) => Ok(Some(true)),
        Some((_, Some("inside"))) => Ok(Some(false)),
        Some((other, _)) => Err(format!("{key} is {other}; wanted \"outside\" or \"inside\"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, keys: Value) -> Result<Reaction, String> {
        Reaction::read(name, keys.as_object().unwrap())
    }

    #[test]
    fn reactions_are_read() {
        let control = Reaction::Control { by: Some(true), trackers: None };
        assert_eq!(read("control", json!({ "by": "outside" })), Ok(control.clone()));
        assert_ne!(read("control", json!({ "by": "inside" })), Ok(control), "control of the test");
        let wheels = Reaction::Wheels { torques_n_m: vec![0.5, -1.0], at_s: Some(2.0) };
        assert_eq!(read("wheels", json!({ "torques_n_m": [0.5, -1], "at_s": 2 })), Ok(wheels));
        let torque = Reaction::Torque { torque_n_m: DVec3::Y, at_s: None, for_s: 3.0 };
        assert_eq!(read("torque", json!({ "torque_n_m": [0, 1, 0], "for_s": 3 })), Ok(torque));
        let fix = |sigma: Value| {
            read("tracker_attitude", json!({ "at_s": 1, "body_from_icrf": [0.6, 0, 0.8, 0], "sigma_arcsec": sigma }))
        };
        assert_eq!(fix(json!(2)), fix(json!([2, 2, 2])));
        assert!(fix(json!([2, 2, 2])).is_ok());
    }

    #[test]
    fn bad_reactions_are_refused_with_their_key() {
        for (name, keys, part) in [
            ("control", json!({}), "neither by nor trackers"),
            ("control", json!({ "by": "me" }), "by is \"me\"; wanted \"outside\" or \"inside\""),
            ("wheels", json!({}), "torques_n_m is missing"),
            ("wheels", json!({ "torques_n_m": [0, "1"] }), "torques_n_m is not a list of at most 64 numbers"),
            ("wheels", json!({ "torques_n_m": vec![0.0; 65] }), "torques_n_m is not a list of at most 64 numbers"),
            ("torque", json!({ "torque_n_m": [0, 1], "for_s": 1 }), "torque_n_m has 2 numbers"),
            ("torque", json!({ "torque_n_m": [0, 1, 0] }), "for_s is missing"),
            ("tracker_attitude", json!({ "body_from_icrf": [1, 0, 0, 0], "sigma_arcsec": 1 }), "at_s is missing"),
            ("tracker_attitude", json!({ "at_s": 1, "sigma_arcsec": 1 }), "body_from_icrf is missing"),
            ("tracker_attitude", json!({ "at_s": 1, "body_from_icrf": [1, 1, 0, 0], "sigma_arcsec": 1 }), "of norm 1"),
            ("tracker_attitude", json!({ "at_s": 1, "body_from_icrf": [1, 0, 0, 0] }), "sigma_arcsec is missing"),
            (
                "tracker_attitude",
                json!({ "at_s": 1, "body_from_icrf": [1, 0, 0, 0], "sigma_arcsec": "1" }),
                "sigma_arcsec is no",
            ),
        ] {
            let error = read(name, keys.clone()).expect_err(part);
            assert!(error.contains(part), "{name} {keys}: {error}");
        }
    }
}
