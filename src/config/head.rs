//! Camera heads beside the first: how each is mounted. All have the bench's camera and timing.

use crate::bench::quaternion;
use crate::check::Checker;
use crate::error::ConfigError;
use base::axes::{Body, Rotation, Sensor};
use serde::Deserialize;

/// Most camera heads of one bench or spacecraft.
pub(super) const HEADS_MAX: usize = 8;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HeadKeys {
    sensor_from_body: Option<[f64; 4]>,
}

/// The mountings of the heads listed under `name`, of which there may be `most`.
pub(super) fn check_heads(
    name: &str,
    keys: &[HeadKeys],
    most: usize,
    check: &Checker<'_>,
) -> Result<Vec<Rotation<Sensor, Body>>, ConfigError> {
    if keys.len() > most {
        return Err(check.invalid(name, keys.len(), format!("at most {most}"), "leave some out"));
    }
    let head = |(place, keys): (usize, &HeadKeys)| {
        let key = format!("{name}[{place}].sensor_from_body");
        let missing = || check.invalid(&key, "missing", "a unit quaternion [w, x, y, z]", "how the head is mounted");
        quaternion(&key, keys.sensor_from_body.ok_or_else(missing)?, check)
    };
    keys.iter().enumerate().map(head).collect()
}
