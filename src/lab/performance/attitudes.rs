//! Attitudes of a test plan: one, a grid over the field, shifts by parts of a pixel, uniform over all, away from Sun,
//! Moon or Earth.

use crate::availability::{EARTH_LIMB_ANGLE, MOON_ANGLE, SUN_ANGLE};
use crate::record::turned;
use anyhow::{Context, Result, bail};
use base::axes::{Icrf, Sensor, attitude_of_uniforms, sensor_from_ra_dec_roll};
use base::time::{Span, Tai};
use config::{Scenario, StartTime};
use glam::{DQuat, DVec3};
use run::wiring::{bench_parts::run_params, vehicle_parts::uniforms};
use serde::Deserialize;
use sky::bodies::EARTH_RADIUS_KM;
use sky::observer::{Observer, ObserverTrack};
use testbed::{spacecraft::sun_direction_icrf, tracker_model::EarthDisc};

/// Most attitudes of a case.
const MOST: u32 = 100_000;

/// How a case's attitudes are chosen.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Attitudes {
    /// One.
    Fixed {
        /// Right ascension of the boresight, deg.
        ra_deg: f64,
        /// Its declination, deg.
        dec_deg: f64,
        /// Position angle of image up, deg.
        #[serde(default)]
        roll_deg: f64,
    },
    /// Directions on a square grid about one, so that the stars move over the field.
    Grid {
        /// Right ascension of the middle, deg.
        ra_deg: f64,
        /// Its declination, deg.
        dec_deg: f64,
        /// Position angle of image up, deg.
        #[serde(default)]
        roll_deg: f64,
        /// Directions along each side.
        steps: u32,
        /// Length of a side, deg.
        span_deg: f64,
    },
    /// Shifts on a square grid about one direction, in pixels.
    Shifts {
        /// Right ascension of the first, deg.
        ra_deg: f64,
        /// Its declination, deg.
        dec_deg: f64,
        /// Position angle of image up, deg.
        #[serde(default)]
        roll_deg: f64,
        /// Shifts along each side.
        steps: u32,
        /// From one to the next, px.
        step_px: f64,
    },
    /// Uniform over all attitudes, from the plan's seed.
    Uniform {
        /// How many.
        count: u32,
    },
    /// At an angle from the Sun: the sweep's value.
    FromSun {
        /// Directions about the Sun.
        count: u32,
    },
    /// At an angle from the Moon's centre, as the observer sees it: the sweep's value.
    FromMoon {
        /// Directions about the Moon.
        count: u32,
    },
    /// At an angle from the Earth's limb, as an observer in orbit sees it: the sweep's value.
    FromEarth {
        /// Directions about the Earth.
        count: u32,
    },
}

/// Circumstances that decide the attitudes of a case, besides their own numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circumstances<'a> {
    /// Seed of random ones.
    pub(crate) seed: u64,
    /// Angle of a pixel, rad.
    pub(crate) pixel_rad: f64,
    /// Start of the case.
    pub(crate) at: Tai,
    /// Value of the sweep.
    pub(crate) value: Option<f64>,
    /// Moon and Earth, where attitudes are about them.
    pub(crate) bodies: Option<&'a BrightBodies>,
}

impl Attitudes {
    /// Returns the attitudes, `sensor_from_icrf`.
    ///
    /// # Errors
    /// With what is out of range.
    pub(crate) fn list(&self, given: &Circumstances<'_>) -> Result<Vec<DQuat>> {
        let Circumstances { seed, pixel_rad, at, value, .. } = *given;
        match *self {
            Self::Fixed { ra_deg, dec_deg, roll_deg } => Ok(vec![pointing(ra_deg, dec_deg, roll_deg)?]),
            Self::Grid { ra_deg, dec_deg, roll_deg, steps, span_deg } => {
                let step = span_deg.to_radians() / f64::from(steps.saturating_sub(1).max(1));
                grid(pointing(ra_deg, dec_deg, roll_deg)?, steps, step)
            }
            Self::Shifts { ra_deg, dec_deg, roll_deg, steps, step_px } => {
                grid(pointing(ra_deg, dec_deg, roll_deg)?, steps, step_px * pixel_rad)
            }
            Self::Uniform { count } => {
                check(count)?;
                Ok((0..count).map(|number| uniform(seed, number)).collect())
            }
            Self::FromSun { count } => {
                let (angle_rad, sun) = (swept("from_sun", count, value)?, sun_direction_icrf(at).normalize());
                Ok((0..count).map(|number| off(sun, angle_rad, number, count)).collect())
            }
            Self::FromMoon { count } => {
                let (angle_rad, bodies) = (swept("from_moon", count, value)?, seen("from_moon", given)?);
                (0..count).map(|number| Ok(off(bodies.moon(number)?, angle_rad, number, count))).collect()
            }
            Self::FromEarth { count } => {
                let (angle_rad, bodies) = (swept("from_earth", count, value)?, seen("from_earth", given)?);
                let one = |number: u32| {
                    let earth = bodies.earth_of_attitude(number)?;
                    Ok(off(earth.direction_icrf, angle_rad + earth.radius_rad, number, count))
                };
                (0..count).map(one).collect()
            }
        }
    }

    /// Returns the number of attitudes.
    pub fn count(&self) -> u32 {
        match *self {
            Self::Fixed { .. } => 1,
            Self::Grid { steps, .. } | Self::Shifts { steps, .. } => steps.saturating_mul(steps),
            Self::Uniform { count }
            | Self::FromSun { count }
            | Self::FromMoon { count }
            | Self::FromEarth { count } => count,
        }
    }

    /// Returns the condition that the sweep of angles from a body is.
    pub fn angle_key(&self) -> Option<&'static str> {
        match self {
            Self::FromSun { .. } => Some(SUN_ANGLE),
            Self::FromMoon { .. } => Some(MOON_ANGLE),
            Self::FromEarth { .. } => Some(EARTH_LIMB_ANGLE),
            Self::Fixed { .. } | Self::Grid { .. } | Self::Shifts { .. } | Self::Uniform { .. } => None,
        }
    }

    /// Returns true where the places of Moon or Earth are needed.
    pub(crate) fn is_about_moon_or_earth(&self) -> bool {
        matches!(self, Self::FromMoon { .. } | Self::FromEarth { .. })
    }
}

/// The sweep's angle from a body, rad.
fn swept(kind: &str, count: u32, value: Option<f64>) -> Result<f64> {
    check(count)?;
    match value.filter(|angle| (0.0..=180.0).contains(angle)) {
        Some(angle_deg) => Ok(angle_deg.to_radians()),
        None => bail!("attitudes of kind \"{kind}\": wanted a sweep of angles from 0 to 180 deg"),
    }
}

fn seen<'a>(kind: &str, given: &Circumstances<'a>) -> Result<&'a BrightBodies> {
    given.bodies.with_context(|| format!("attitudes of kind \"{kind}\": the places of Moon and Earth are not known"))
}

fn check(count: u32) -> Result<()> {
    if count == 0 || count > MOST {
        bail!("attitudes: got {count}, wanted 1 to {MOST}");
    }
    Ok(())
}

fn pointing(ra_deg: f64, dec_deg: f64, roll_deg: f64) -> Result<DQuat> {
    let is_good = ra_deg.is_finite() && roll_deg.is_finite() && (-90.0..=90.0).contains(&dec_deg);
    if !is_good {
        bail!(
            "attitudes: got ra_deg {ra_deg}, dec_deg {dec_deg}, roll_deg {roll_deg}; wanted degrees, a declination from -90 to 90"
        );
    }
    Ok(sensor_from_ra_dec_roll(ra_deg.to_radians(), dec_deg.to_radians(), roll_deg.to_radians()).quat())
}

/// A square grid about an attitude, by small turns about x and y.
fn grid(middle: DQuat, steps: u32, step_rad: f64) -> Result<Vec<DQuat>> {
    check(steps.saturating_mul(steps))?;
    if !step_rad.is_finite() {
        bail!("attitudes: got a step of {step_rad} rad, wanted a finite one");
    }
    let offset = |number: u32| (f64::from(number) - 0.5 * f64::from(steps - 1)) * step_rad;
    let places = (0..steps * steps).map(|number| (offset(number % steps), offset(number / steps)));
    Ok(places.map(|(x, y)| turned(middle, DVec3::new(x, y, 0.0))).collect())
}

/// Returns one of the attitudes of a seed; all attitudes are equally likely.
fn uniform(seed: u64, number: u32) -> DQuat {
    let mixed = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(u64::from(number));
    attitude_of_uniforms::<Sensor, Icrf>(uniforms(mixed)).quat()
}

/// A boresight at an angle from a body, one of `count` directions about it.
fn off(body: DVec3, angle_rad: f64, number: u32, count: u32) -> DQuat {
    let side = body.any_orthonormal_vector();
    let about = core::f64::consts::TAU * f64::from(number) / f64::from(count);
    let axis = DQuat::from_axis_angle(body, about) * side;
    let boresight = DQuat::from_axis_angle(axis, angle_rad) * body;
    // v_sensor = q v_icrf q*: the rotation that takes the boresight to +z.
    DQuat::from_rotation_arc(boresight, DVec3::Z)
}

// Where the observer of a case sees Moon and Earth, at the times of its attitudes.

/// The observer of a case.
#[derive(Debug, Clone)]
pub(crate) struct BrightBodies {
    track: ObserverTrack,
    zero: Tai,
    each_s: f64,
}

impl BrightBodies {
    /// Returns those of a run whose attitudes last `each_s`.
    ///
    /// # Errors
    /// When the run has no start, or no observer can be made for it.
    pub(crate) fn of_run(scenario: &Scenario, each_s: f64) -> Result<Self> {
        let StartTime::At(start) = scenario.bench.timing.start else {
            anyhow::bail!("timing.start_utc: got \"now\" or \"plant\", wanted a time");
        };
        let params = run_params(&scenario.bench, start)?;
        Ok(Self::of(params.observer, params.first_exposure, each_s))
    }

    /// Returns those of an observer whose first exposure is at `zero`.
    pub(crate) fn of(observer: Observer, zero: Tai, each_s: f64) -> Self {
        Self { track: ObserverTrack::new(observer, zero), zero, each_s }
    }

    /// Returns the unit vector to the Moon in the middle of an attitude, ICRF.
    pub(crate) fn moon(&self, number: u32) -> Result<DVec3> {
        Ok(self.track.bodies(self.middle_of(number))?.moon_km.normalize())
    }

    /// Returns the Earth's disc in the middle of an attitude.
    pub(crate) fn earth_of_attitude(&self, number: u32) -> Result<EarthDisc> {
        self.earth(self.middle_of(number))?.context(
            "attitudes of kind \"from_earth\": got an observer at the Earth's centre; wanted one in orbit, such as set = \
             [\"observer.kind=circular_orbit\"]",
        )
    }

    /// Returns the Earth's disc; `None` from its centre.
    pub(crate) fn earth(&self, at: Tai) -> Result<Option<EarthDisc>> {
        let disc = |km: DVec3| EarthDisc {
            direction_icrf: km.normalize(),
            radius_rad: (EARTH_RADIUS_KM / km.length()).min(1.0).asin(),
        };
        Ok(self.track.bodies(at)?.earth_km.map(disc))
    }

    fn middle_of(&self, number: u32) -> Tai {
        self.zero + Span::from_s(self.each_s * (f64::from(number) + 0.5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sky::observer::{Observer, ObserverTrack};
    use sky::orbit::CircularOrbit;

    fn at() -> Tai {
        Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap()
    }

    fn given(seed: u64, pixel_rad: f64, value: Option<f64>) -> Circumstances<'static> {
        Circumstances { seed, pixel_rad, at: at(), value, bodies: None }
    }

    #[test]
    fn uniform_attitudes_are_uniform() {
        let all = Attitudes::Uniform { count: 4000 }.list(&given(1, 0.0, None)).unwrap();
        // Of a uniform attitude every coordinate of a turned axis has the mean 0 and the variance 1/3.
        for axis in [DVec3::X, DVec3::Z] {
            let seen: Vec<DVec3> = all.iter().map(|q| *q * axis).collect();
            let mean = seen.iter().sum::<DVec3>() / 4000.0;
            let square = seen.iter().map(|v| v.powf(2.0)).sum::<DVec3>() / 4000.0;
            assert!(mean.length() < 0.05, "{mean}");
            assert!((square - DVec3::splat(1.0 / 3.0)).length() < 0.03, "{square}");
        }
        let other = Attitudes::Uniform { count: 1 }.list(&given(2, 0.0, None)).unwrap();
        assert_ne!(all[0], other[0], "the seed counts");
    }

    #[test]
    fn shifts_are_parts_of_a_pixel() {
        let shifts = Attitudes::Shifts { ra_deg: 10.0, dec_deg: 20.0, roll_deg: 30.0, steps: 4, step_px: 0.25 };
        let all = shifts.list(&given(1, 1e-3, None)).unwrap();
        assert_eq!(all.len(), 16);
        let turn = crate::record::attitude_error(all[1], all[0]);
        // Small turns do not commute: the rest is of second order.
        assert!((turn - DVec3::X * 0.25e-3).length() < 1e-7, "{turn}");
    }

    #[test]
    fn boresights_are_at_the_angle_from_the_sun() {
        let all = Attitudes::FromSun { count: 3 }.list(&given(1, 0.0, Some(40.0))).unwrap();
        for q in &all {
            let boresight = q.conjugate() * DVec3::Z;
            let angle = boresight.angle_between(sun_direction_icrf(at())).to_degrees();
            assert!((angle - 40.0).abs() < 1e-9, "{angle}");
        }
        assert!((all[0] * all[1].conjugate()).w.abs() < 0.999, "they differ");
        assert!(Attitudes::FromSun { count: 3 }.list(&given(1, 0.0, None)).is_err());
        assert!(Attitudes::Uniform { count: 0 }.list(&given(1, 0.0, None)).is_err());
    }

    /// An observer 550 km above the Earth; an attitude lasts 100 s.
    fn in_orbit() -> BrightBodies {
        BrightBodies::of(in_orbit_observer(), at(), 100.0)
    }

    fn in_orbit_observer() -> Observer {
        Observer::Circular(CircularOrbit::new(550.0, 97.6, 340.0, -10.0, at()).unwrap())
    }

    #[test]
    fn boresights_follow_moon_and_limb_of_an_observer_in_orbit() {
        let bodies = in_orbit();
        let given = Circumstances { bodies: Some(&bodies), ..given(1, 0.0, Some(25.0)) };
        let from_moon = Attitudes::FromMoon { count: 4 }.list(&given).unwrap();
        let from_earth = Attitudes::FromEarth { count: 4 }.list(&given).unwrap();
        let track = ObserverTrack::new(in_orbit_observer(), at());
        for (number, (moon, earth)) in from_moon.iter().zip(&from_earth).enumerate() {
            // Written afresh: the middle of the attitude's time, and the disc's radius from the height.
            let there = track.bodies(at() + Span::from_s(100.0 * number as f64 + 50.0)).unwrap();
            let angle = |q: &DQuat, km: DVec3| (q.conjugate() * DVec3::Z).angle_between(km).to_degrees();
            assert!((angle(moon, there.moon_km) - 25.0).abs() < 1e-6);
            let limb_deg = (6378.137_f64 / 6928.137).asin().to_degrees();
            assert!((angle(earth, there.earth_km.unwrap()) - limb_deg - 25.0).abs() < 1e-3, "from the limb");
        }
        let nadir = |number: u32| bodies.earth_of_attitude(number).unwrap().direction_icrf;
        assert!((nadir(0).angle_between(nadir(1)).to_degrees() - 36_000.0 / 5_736.0).abs() < 0.1, "100 s of 95.6 min");
    }

    #[test]
    fn from_the_centre_of_the_earth_there_is_no_limb() {
        let bodies = BrightBodies::of(Observer::Geocentre, at(), 1.0);
        let given = Circumstances { bodies: Some(&bodies), ..given(1, 0.0, Some(25.0)) };
        let refused = Attitudes::FromEarth { count: 1 }.list(&given).unwrap_err().to_string();
        assert!(refused.contains("observer.kind"), "{refused}");
        assert!(Attitudes::FromMoon { count: 1 }.list(&given).is_ok());
        assert!(Attitudes::FromMoon { count: 1 }.list(&Circumstances { value: None, ..given }).is_err());
        assert!(Attitudes::FromEarth { count: 1 }.list(&Circumstances { bodies: None, ..given }).is_err());
    }
}
