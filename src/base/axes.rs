//! Axes, directions and rotations that carry their axes in the type.
//!
//! Conventions (used everywhere, printed by `starloop check`):
//! * quaternions are Hamilton (`i j = k`), scalar first in text and on the wire;
//! * `Rotation<To, From>` is passive: it changes the axes in which one and the same vector is written,
//!   `v_to = q * v_from * conj(q)`. Products read right to left:
//!   `sensor_from_icrf = sensor_from_body * body_from_icrf`;
//! * sensor axes: +Z boresight (out of the instrument, towards the sky), +X along columns (image right),
//!   +Y along rows (image down);
//! * an angular rate is that of the named axes with respect to ICRF, written in the named axes, so
//!   `q(t + dt) = exp(-w dt / 2) * q(t)`.
//!
//! A product of rotations whose inner axes differ does not compile:
//! ```compile_fail
//! use crate::axes::{Body, Icrf, Rotation, Sensor};
//! let a = Rotation::<Sensor, Body>::IDENTITY;
//! let b = Rotation::<Sensor, Icrf>::IDENTITY;
//! let wrong = a * b;
//! ```

use core::{f64::consts::TAU, marker::PhantomData, ops::Mul};
use glam::{DMat3, DQuat, DVec3};

/// Largest difference from 1 of the norm of a quaternion that a person, a table or a message in single precision gives:
/// four decimals of each component.
pub const WRITTEN_NORM_TOLERANCE: f64 = 1e-3;
/// The same of a quaternion that a program gives in double precision: nine decimals of each component, with a margin.
pub const COMPUTED_NORM_TOLERANCE: f64 = 1e-6;

/// Catalog axes: the International Celestial Reference Frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Icrf;
/// Spacecraft body axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Body;
/// Star-sensor boresight axes (+Z boresight, +X image right, +Y image down).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sensor;

/// Passive rotation that rewrites vectors from axes `From` into axes `To`.
#[derive(Debug)]
pub struct Rotation<To, From> {
    q: DQuat,
    axes: PhantomData<(To, From)>,
}

impl<To, From> Clone for Rotation<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Rotation<To, From> {}
impl<To, From> PartialEq for Rotation<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.q == other.q
    }
}

impl<To, From> Rotation<To, From> {
    /// No rotation.
    pub const IDENTITY: Self = Self { q: DQuat::IDENTITY, axes: PhantomData };

    /// Makes a rotation of scalar-first components; normalised here. `None` when not finite or the norm is further than
    /// `norm_tolerance` from 1.
    pub fn from_wxyz(wxyz: [f64; 4], norm_tolerance: f64) -> Option<Self> {
        let [w, x, y, z] = wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        let norm = q.length();
        (norm.is_finite() && (norm - 1.0).abs() <= norm_tolerance).then(|| Self::from_quat(q))
    }

    /// Makes a rotation of a unit quaternion whose bits are kept; `None` when its norm differs from 1 by more than
    /// `norm_tolerance`.
    pub fn from_unit_wxyz(wxyz: [f64; 4], norm_tolerance: f64) -> Option<Self> {
        let [w, x, y, z] = wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        ((q.length() - 1.0).abs() <= norm_tolerance).then_some(Self { q, axes: PhantomData })
    }

    /// Makes a rotation of a quaternion of any non-zero norm.
    pub fn from_quat(q: DQuat) -> Self {
        Self { q: q.normalize(), axes: PhantomData }
    }

    /// Makes a rotation of the three `To` axes written in `From` (the rows of the direction-cosine matrix).
    pub fn from_axes(x: DVec3, y: DVec3, z: DVec3) -> Self {
        Self::from_quat(DQuat::from_mat3(&DMat3::from_cols(x, y, z).transpose()))
    }

    /// Returns the rotation of axes `To` away from `From` by a rotation vector (rad) written in either: `exp(-v/2)`.
    pub fn from_rotation_vector(v_rad: DVec3) -> Self {
        Self { q: DQuat::from_scaled_axis(-v_rad), axes: PhantomData }
    }

    /// Returns the scalar-first components with `w >= 0`.
    pub fn wxyz(&self) -> [f64; 4] {
        let s = if self.q.w < 0.0 { -1.0 } else { 1.0 };
        [s * self.q.w, s * self.q.x, s * self.q.y, s * self.q.z]
    }

    /// Returns the same quaternion as `glam` stores it.
    pub fn quat(&self) -> DQuat {
        self.q
    }

    /// Returns the direction-cosine matrix `C` with `v_to = C v_from`.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_quat(self.q)
    }

    /// Returns the opposite rotation.
    pub fn inverse(&self) -> Rotation<From, To> {
        Rotation { q: self.q.conjugate(), axes: PhantomData }
    }

    /// Rewrites a vector given in `From` axes into `To` axes.
    #[inline]
    pub fn apply(&self, v_from: DVec3) -> DVec3 {
        self.q * v_from
    }

    /// Returns the rotation vector (rad, in `To` axes) that takes `self` to `later`: the inverse of
    /// [`Self::rotated_by`]. Signs are aligned first: `q` and `-q` are one attitude.
    pub fn rotation_vector_to(&self, later: &Self) -> DVec3 {
        let mut d = later.q * self.q.conjugate();
        if d.w < 0.0 {
            d = -d;
        }
        let v = DVec3::new(d.x, d.y, d.z);
        let s = v.length();
        let scale = if s < 1e-12 { 2.0 / d.w } else { 2.0 * s.atan2(d.w) / s };
        -v * scale
    }

    /// Returns the attitude after the `To` axes have turned by the rotation vector (rad, in `To` axes): `exp(-v/2) *
    /// q`.
    pub fn rotated_by(&self, v_rad: DVec3) -> Self {
        Self::from_quat(DQuat::from_scaled_axis(-v_rad) * self.q)
    }
}

impl<To, Mid, From> Mul<Rotation<Mid, From>> for Rotation<To, Mid> {
    type Output = Rotation<To, From>;
    fn mul(self, rhs: Rotation<Mid, From>) -> Self::Output {
        Rotation::from_quat(self.q * rhs.q)
    }
}

/// Returns the attitude of a sensor whose boresight points at (`ra_rad`, `dec_rad`); `roll_rad` is the position angle,
/// east of north, of the image's up direction (towards row 0). With roll 0 north is up and east is left.
pub fn sensor_from_ra_dec_roll(ra_rad: f64, dec_rad: f64, roll_rad: f64) -> Rotation<Sensor, Icrf> {
    let (sin_ra, cos_ra) = ra_rad.sin_cos();
    let (sin_dec, cos_dec) = dec_rad.sin_cos();
    let boresight = DVec3::new(cos_dec * cos_ra, cos_dec * sin_ra, sin_dec);
    let north = DVec3::new(-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec);
    let east = DVec3::new(-sin_ra, cos_ra, 0.0);
    let down = -(north * roll_rad.cos() + east * roll_rad.sin());
    Rotation::from_axes(down.cross(boresight), down, boresight)
}

/// Returns the attitude that belongs to three numbers from 0 to 1; where these are uniform, all attitudes are equally
/// likely (K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992). The bits are the same on every machine.
pub fn attitude_of_uniforms<To, From>([u, v, w]: [f64; 3]) -> Rotation<To, From> {
    let (near, far) = ((1.0 - u).sqrt(), u.sqrt());
    let ((sin_v, cos_v), (sin_w, cos_w)) = (libm::sincos(TAU * v), libm::sincos(TAU * w));
    Rotation::from_quat(DQuat::from_xyzw(near * sin_v, near * cos_v, far * sin_w, far * cos_w))
}

/// Returns the right ascension in `0..2 pi`, declination and roll (rad) of an attitude: the inverse of
/// [`sensor_from_ra_dec_roll`]. At a pole the right ascension is the one `atan2` gives and roll follows it.
pub fn ra_dec_roll(sensor_from_icrf: &Rotation<Sensor, Icrf>) -> [f64; 3] {
    let icrf_from_sensor = sensor_from_icrf.inverse();
    let boresight = icrf_from_sensor.apply(DVec3::Z);
    let up = icrf_from_sensor.apply(DVec3::NEG_Y);
    let ra = boresight.y.atan2(boresight.x);
    let dec = boresight.z.atan2(boresight.x.hypot(boresight.y));
    let north = DVec3::new(-dec.sin() * ra.cos(), -dec.sin() * ra.sin(), dec.cos());
    let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
    [ra.rem_euclid(TAU), dec, up.dot(east).atan2(up.dot(north))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{ARCSEC, DEG};

    /// Round trips through f64 trigonometry: a few ulp of 2 pi.
    const ROUND_TRIP_RAD: f64 = 1e-14;

    #[test]
    fn roll_zero_puts_north_up_and_east_left() {
        let q = sensor_from_ra_dec_roll(80.0 * DEG, 20.0 * DEG, 0.0);
        let direction = |ra: f64, dec: f64| DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
        let north = q.apply(direction(80.0 * DEG, 21.0 * DEG));
        let east = q.apply(direction(81.0 * DEG, 20.0 * DEG));
        assert!(north.y < 0.0 && north.x.abs() < 1e-12, "north must be up (towards row 0): {north}");
        assert!(east.x < -0.01 && east.y.abs() < 1e-3, "east must be left: {east}");
    }

    #[test]
    fn ra_dec_roll_round_trips() {
        for (ra, dec, roll) in [(0.1, 0.2, 0.3), (5.9, -1.2, -2.9), (3.0, 1.5, 3.1)] {
            let [a, d, r] = ra_dec_roll(&sensor_from_ra_dec_roll(ra, dec, roll));
            for (got, wanted) in [(a, ra), (d, dec), (r, roll)] {
                assert!((got - wanted).abs() < 20.0 * ROUND_TRIP_RAD, "{got} for {wanted}");
            }
        }
    }

    #[test]
    fn positive_rate_about_boresight_turns_the_sky_the_other_way() {
        let q = Rotation::<Sensor, Icrf>::IDENTITY.rotated_by(DVec3::new(0.0, 0.0, 0.01));
        let star = q.apply(DVec3::new(0.1, 0.0, 0.995));
        assert!(star.y < 0.0, "axes turn +x to +y, so a fixed star moves from +x towards -y: {star}");
    }

    #[test]
    fn rotation_vector_resolves_small_angles_and_sign_flips() {
        let a = sensor_from_ra_dec_roll(1.0, 0.4, -2.0);
        let v = DVec3::new(1e-6, -2e-6, 3e-6) * ARCSEC;
        let b = a.rotated_by(v);
        let flipped = Rotation { q: -b.q, axes: PhantomData };
        assert!((a.rotation_vector_to(&b) - v).length() < 1e-15, "{}", a.rotation_vector_to(&b));
        assert_eq!(a.rotation_vector_to(&flipped), a.rotation_vector_to(&b), "q and -q are one attitude");
    }

    #[test]
    fn attitudes_of_uniform_numbers_prefer_no_axis() {
        let sides = 12_u32;
        let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(sides);
        let mut squares = [[0.0; 3]; 3];
        let numbers = (0..sides.pow(3)).map(|n| [n % sides, n / sides % sides, n / sides.pow(2)].map(middle));
        for q in numbers.map(attitude_of_uniforms::<Sensor, Icrf>) {
            for (row, axis) in squares.iter_mut().zip([DVec3::X, DVec3::Y, DVec3::Z]) {
                for (sum, component) in row.iter_mut().zip(q.apply(axis).to_array()) {
                    *sum += component * component / f64::from(sides.pow(3));
                }
            }
        }
        // A square of a direction's component is 1/3 on average; the grid's own error is below 1 %.
        for mean in squares.iter().flatten() {
            assert!((mean - 1.0 / 3.0).abs() < 0.01, "{squares:?}");
        }
    }

    #[test]
    fn bad_quaternions_are_refused() {
        assert!(Rotation::<Sensor, Icrf>::from_wxyz([f64::NAN, 0.0, 0.0, 0.0], 1e-3).is_none(), "NaN");
        assert!(Rotation::<Sensor, Icrf>::from_wxyz([1.01, 0.0, 0.0, 0.0], 1e-3).is_none(), "norm");
        assert!(Rotation::<Sensor, Icrf>::from_wxyz([0.0; 4], 1e-3).is_none(), "zero");
    }
}
