//! Direction in ICRF axes <-> galactic longitude and latitude.
//!
//! Source of the rotation: ESA, The Hipparcos and Tycho Catalogues, vol. 1 (1997), sec. 1.5.3, eq. 1.5.11, which
//! defines the galactic axes in ICRS. Test: `pole_centre_and_a_published_place`.

use base::source::direction_from_ra_dec;
use glam::{DMat3, DVec3};

/// Rows: the galactic x (centre), y and z (north pole) axes in ICRF.
const GALACTIC_FROM_ICRF: DMat3 = DMat3::from_cols_array_2d(&[
    [-0.054_875_560_4, 0.494_109_427_9, -0.867_666_149_0],
    [-0.873_437_090_2, -0.444_829_630_0, -0.198_076_373_4],
    [-0.483_835_015_5, 0.746_982_244_5, 0.455_983_776_2],
]);

/// Returns the galactic longitude, -pi..pi, and latitude of a direction (unit vector), rad.
pub fn galactic_rad(direction_icrf: DVec3) -> [f64; 2] {
    let galactic = GALACTIC_FROM_ICRF * direction_icrf;
    [galactic.y.atan2(galactic.x), galactic.z.atan2(galactic.x.hypot(galactic.y))]
}

/// Returns the direction in ICRF axes of a galactic longitude and latitude, rad.
pub fn direction_of_galactic(longitude_rad: f64, latitude_rad: f64) -> DVec3 {
    GALACTIC_FROM_ICRF.transpose() * direction_from_ra_dec(longitude_rad, latitude_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, DEG};

    #[test]
    fn pole_centre_and_a_published_place() {
        let near = |got: f64, wanted_deg: f64| assert!((got - wanted_deg * DEG).abs() < 0.1 * ARCSEC, "{}", got / DEG);
        // The pole and the centre by definition; M 31 by SIMBAD: l 121.174 329, b -21.573 309 deg.
        let [_, b] = galactic_rad(direction_from_ra_dec(192.859_481_23 * DEG, 27.128_251_20 * DEG));
        assert!((b - 90.0 * DEG).abs() < 0.1 * ARCSEC, "{}", b / DEG);
        let [l, b] = galactic_rad(direction_from_ra_dec(266.404_996 * DEG, -28.936_172 * DEG));
        near(l, 0.0);
        near(b, 0.0);
        let m31 = direction_from_ra_dec(10.684_708 * DEG, 41.268_750 * DEG);
        let [l, b] = galactic_rad(m31);
        near(l, 121.174_329);
        near(b, -21.573_309);
        assert!((direction_of_galactic(l, b) - m31).length() < 1e-9);
    }
}
