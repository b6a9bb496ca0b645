//! Attitudes of the items of a data set.
//!
//! In: the table `[attitude]` of a description. Out: an attitude for each item, `sensor_from_icrf`. Kinds: `uniform` (every
//! rotation as likely), `cap` (boresights evenly over a cap, any roll), `list` (rows of right ascension, declination,
//! roll), `file` (attitudes as `starloop render --attitudes` takes them). The last two are taken row by row, from the
//! first again after the last. Tests: below.

use crate::distribution::Draws;
use anyhow::{Context, Result, bail};
use base::axes::{Icrf, Rotation, Sensor, attitude_of_uniforms, sensor_from_ra_dec_roll};
use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use histories::read;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The table `[attitude]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum AttitudeKeys {
    /// Every rotation is as likely.
    #[default]
    Uniform,
    /// Boresights evenly over a cap of the sky, any roll.
    Cap {
        /// Right ascension of its middle, deg.
        ra_deg: f64,
        /// Declination of its middle, deg.
        dec_deg: f64,
        /// Radius, deg.
        radius_deg: f64,
    },
    /// Given attitudes, one after the other.
    List {
        /// Right ascension, declination and roll, deg.
        ra_dec_roll_deg: Vec<[f64; 3]>,
    },
    /// Attitudes of a file, one after the other, with the rates that it has.
    File {
        /// CSV, AEM or STK, relative to the description.
        path: PathBuf,
    },
}

/// Attitudes to take items from.
#[derive(Debug, Clone, PartialEq)]
pub enum Attitudes {
    /// Every rotation is as likely.
    Uniform,
    /// Boresights evenly over a cap.
    Cap {
        /// Axes whose +Z is the middle of the cap.
        cap_from_icrf: Rotation<Sensor, Icrf>,
        /// Cosine of its radius.
        cos_radius: f64,
    },
    /// Given attitudes and rates of the sensor, rad/s.
    Rows(Vec<(Rotation<Sensor, Icrf>, Option<DVec3>)>),
}

impl AttitudeKeys {
    /// Checks the table; a file is relative to `folder`.
    ///
    /// # Errors
    /// With what was got and what was wanted.
    pub fn check(&self, folder: &Path) -> Result<Attitudes> {
        match self {
            Self::Uniform => Ok(Attitudes::Uniform),
            Self::Cap { ra_deg, dec_deg, radius_deg } => {
                if !(0.0..=180.0).contains(radius_deg) {
                    bail!("radius_deg: got {radius_deg}, wanted 0 to 180");
                }
                let cos_radius = libm::cos(radius_deg.to_radians());
                Ok(Attitudes::Cap { cap_from_icrf: pointing([*ra_deg, *dec_deg, 0.0])?, cos_radius })
            }
            Self::List { ra_dec_roll_deg } => {
                let row = |(number, row): (usize, &[f64; 3])| {
                    pointing(*row)
                        .with_context(|| format!("ra_dec_roll_deg[{number}]"))
                        .map(|attitude| (attitude, None))
                };
                rows(ra_dec_roll_deg.iter().enumerate().map(row).collect::<Result<_>>()?)
            }
            Self::File { path } => {
                let path = folder.join(path);
                let history = read::attitudes(&path.display().to_string(), &read::text_of(&path)?, None)?;
                let states = history.segments().iter().flat_map(|segment| segment.states());
                let row = |t_ns: i64| {
                    let motion = history.at_ns(t_ns)?;
                    Some((Rotation::from_quat(motion.body_from_icrf.quat()), Some(motion.rate_rad_s)))
                };
                rows(states.filter_map(|state| row(state.t_ns)).collect())
            }
        }
    }
}

fn rows(rows: Vec<(Rotation<Sensor, Icrf>, Option<DVec3>)>) -> Result<Attitudes> {
    if rows.is_empty() { bail!("got no attitude, wanted one at least") } else { Ok(Attitudes::Rows(rows)) }
}

fn pointing([ra_deg, dec_deg, roll_deg]: [f64; 3]) -> Result<Rotation<Sensor, Icrf>> {
    if !(ra_deg.is_finite() && roll_deg.is_finite() && (-90.0..=90.0).contains(&dec_deg)) {
        bail!("got {ra_deg}, {dec_deg}, {roll_deg}; wanted finite degrees and a declination from -90 to 90");
    }
    Ok(sensor_from_ra_dec_roll(ra_deg.to_radians(), dec_deg.to_radians(), roll_deg.to_radians()))
}

impl Attitudes {
    /// Returns the attitude of an item, and the rate that goes with it, rad/s.
    #[must_use]
    pub fn of_item(&self, item: u32, draws: &mut Draws) -> (Rotation<Sensor, Icrf>, Option<DVec3>) {
        match self {
            Self::Uniform => (attitude_of_uniforms(core::array::from_fn(|_| draws.unit())), None),
            Self::Cap { cap_from_icrf, cos_radius } => {
                let cosine = draws.between(*cos_radius, 1.0);
                let [angle, roll] = [draws.between(0.0, TAU), draws.between(0.0, TAU)];
                let radius = libm::acos(cosine.clamp(-1.0, 1.0));
                // A roll about the boresight, a turn away from the middle, and a turn about the middle.
                let turn =
                    DQuat::from_rotation_z(roll) * DQuat::from_rotation_x(radius) * DQuat::from_rotation_z(angle);
                (Rotation::from_quat((turn * cap_from_icrf.quat()).normalize()), None)
            }
            Self::Rows(rows) => rows[item as usize % rows.len()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distribution::Purpose;
    use base::axes::ra_dec_roll;

    const COUNT: u32 = 4000;

    fn boresight(attitude: &Rotation<Sensor, Icrf>) -> DVec3 {
        attitude.inverse().apply(DVec3::Z)
    }

    fn checked(text: &str) -> Result<Attitudes> {
        toml::from_str::<AttitudeKeys>(text)?.check(Path::new("."))
    }

    fn all(attitudes: &Attitudes) -> Vec<Rotation<Sensor, Icrf>> {
        (0..COUNT).map(|item| attitudes.of_item(item, &mut Draws::new(9, item, Purpose::Attitude)).0).collect()
    }

    #[test]
    fn uniform_rotations_prefer_no_direction_of_any_axis() {
        let drawn = all(&Attitudes::Uniform);
        // Five standard errors of the mean of a component of a random direction.
        let limit = 5.0 * (1.0_f64 / 3.0 / f64::from(COUNT)).sqrt();
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let sum: DVec3 = drawn.iter().map(|attitude| attitude.inverse().apply(axis)).sum();
            assert!((sum / f64::from(COUNT)).abs().max_element() < limit, "{axis}: {sum}");
        }
        // The angle of a uniform rotation has the density (1 - cos a) / pi: its mean is pi/2 + 2/pi.
        let angles: f64 = drawn.iter().map(|attitude| 2.0 * attitude.quat().w.abs().acos()).sum();
        let wanted = core::f64::consts::FRAC_PI_2 + 2.0 / core::f64::consts::PI;
        assert!((angles / f64::from(COUNT) - wanted).abs() < 0.06, "{}", angles / f64::from(COUNT));
    }

    #[test]
    fn cap_is_covered_evenly_and_not_left() {
        let cap = checked("kind = \"cap\"\nra_deg = 80\ndec_deg = -20\nradius_deg = 10").unwrap();
        let middle = boresight(&pointing([80.0, -20.0, 0.0]).unwrap());
        let cosines: Vec<f64> = all(&cap).iter().map(|attitude| boresight(attitude).dot(middle)).collect();
        let edge = 10_f64.to_radians().cos();
        assert!(cosines.iter().all(|cosine| *cosine > edge - 1e-12));
        let outer_half = cosines.iter().filter(|cosine| **cosine < 0.5 * (1.0 + edge)).count();
        assert!(outer_half.abs_diff(2000) < 159, "half of the area has half of the boresights: {outer_half}");
    }

    #[test]
    fn given_rows_come_in_order_and_again() {
        let list = checked("kind = \"list\"\nra_dec_roll_deg = [[10, 20, 30], [40, 50, 60]]").unwrap();
        let ra = |item| ra_dec_roll(&list.of_item(item, &mut Draws::new(1, item, Purpose::Attitude)).0)[0].to_degrees();
        assert!((ra(0) - 10.0).abs() < 1e-9 && (ra(3) - 40.0).abs() < 1e-9);
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.csv"), "0 1 0 0 0\n1 0 1 0 0\n").unwrap();
        let keys = AttitudeKeys::File { path: "a.csv".into() };
        let (attitude, rate) = keys.check(folder.path()).unwrap().of_item(2, &mut Draws::new(1, 2, Purpose::Attitude));
        assert_eq!(attitude.wxyz(), [1.0, 0.0, 0.0, 0.0]);
        assert!(rate.is_some());
    }

    #[test]
    fn attitudes_that_cannot_be_taken_are_refused() {
        let refused = |text: &str| format!("{:#}", checked(text).unwrap_err());
        assert!(refused("kind = \"list\"\nra_dec_roll_deg = []").contains("got no attitude"));
        assert!(refused("kind = \"list\"\nra_dec_roll_deg = [[0, 91, 0]]").contains("ra_dec_roll_deg[0]"));
        assert!(refused("kind = \"cap\"\nra_deg = 0\ndec_deg = 0\nradius_deg = 181").contains("radius_deg"));
        assert!(refused("kind = \"spiral\"").contains("spiral"));
    }
}
