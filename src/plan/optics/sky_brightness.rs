//! Direction -> surface brightness of the sky: zodiacal light and the light of the Galaxy.
//!
//! Unit: S10, tenth-magnitude stars (V) of the Sun's colour per square degree; 1 S10 is 27.78 mag/arcsec^2
//! ([`mag_per_arcsec2`]).
//!
//! * **Zodiacal light**: Leinert et al. 1998 (A&AS 127, 1), table 16, for an observer at 1 au, against helioecliptic
//!   longitude and ecliptic latitude; bilinear in its logarithm, 60 S10 at the poles (section 8.3 there). The table has no
//!   entry within about 15 deg of the Sun: those are continued here along their own rays as elongation^-2.3, the slope of the table's own inner
//!   rows (so that directions at one elongation differ), down to 5 deg. No seasons (10 %), no Gegenschein beyond the table's own rise.
//! * **Galaxy**: a flat slab of stars and dust evenly mixed, seen from its middle: `S = S_pole (1 - exp(-u / sin |b|)) /
//!   (1 - exp(-u))` (van Rhijn's layer with its own absorption; Disney, Davies and Phillipps 1989, MNRAS 239, 939), with 30
//!   S10 at the pole and u = 0.15: 56 at b = 30 deg, 215 in the plane, within what Allen's Astrophysical Quantities
//!   is quoted with (30 and 160 to 640). Single directions differ by a factor of two (Cygnus, the bulge, dark clouds); stars
//!   that are drawn are in it too: where a camera draws to magnitude 8, a good part of it is counted twice.
//!
//! One value serves a whole frame, that of the boresight. Beyond 60 deg from the Sun the table changes by at most 5 %
//! per degree, and the slab by 7.5 % per degree at b = 5 deg; `check` prints the range over the corners. Tests below.

use base::units::DEG;
use glam::{DVec2, DVec3};

/// V minus Gaia G of a source of the Sun's colour (V -26.76, G -26.90).
pub const SUN_V_LESS_G: f64 = 0.14;
/// V magnitude per square arcsecond of 1 S10: 10 + 2.5 lg 3600^2.
pub const S10_MAG_PER_ARCSEC2: f64 = 27.781_512_503_836_436;
/// Obliquity of the ecliptic at J2000, arcsec (IAU 2006).
const OBLIQUITY_ARCSEC: f64 = 84_381.406;
/// North pole of the Galaxy, ICRF (ESA 1997, Hipparcos Catalogue vol. 1, 1.5.3): 192.859 48, 27.128 25 deg.
const GALACTIC_POLE_DEG: [f64; 2] = [192.859_48, 27.128_25];
/// Brightness of the Galaxy at the poles, S10.
const POLE_S10: f64 = 30.0;
/// Optical depth of the half slab.
const SLAB_DEPTH: f64 = 0.15;
/// Ecliptic latitudes of the table, deg.
const LATITUDE_DEG: [f64; 11] = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 45.0, 60.0, 75.0, 90.0];
/// Helioecliptic longitudes of the table, deg.
const LONGITUDE_DEG: [f64; 19] = [
    0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0, 135.0, 150.0, 165.0,
    180.0,
];
/// S10; rows are longitudes. The nine entries of the first three rows and columns at most 10 deg from the Sun, and (0,
/// 10), (5, 10), are continued (module doc).
#[rustfmt::skip]
const ZODIACAL_S10: [[f64; 11]; 19] = [
    [112_600.0, 31_000.0, 6_250.0, 2_450.0, 1_260.0, 770.0, 500.0, 215.0, 117.0, 78.0, 60.0],
    [112_600.0, 34_000.0, 5_110.0, 2_300.0, 1_200.0, 740.0, 490.0, 212.0, 117.0, 78.0, 60.0],
    [23_000.0, 11_800.0, 3_700.0, 1_930.0, 1_070.0, 675.0, 460.0, 206.0, 116.0, 78.0, 60.0],
    [9_000.0, 5_300.0, 2_690.0, 1_450.0, 870.0, 590.0, 410.0, 196.0, 114.0, 78.0, 60.0],
    [5_000.0, 3_500.0, 1_880.0, 1_100.0, 710.0, 495.0, 355.0, 185.0, 110.0, 77.0, 60.0],
    [3_000.0, 2_210.0, 1_350.0, 860.0, 585.0, 425.0, 320.0, 174.0, 106.0, 76.0, 60.0],
    [1_940.0, 1_460.0, 955.0, 660.0, 480.0, 365.0, 285.0, 162.0, 102.0, 74.0, 60.0],
    [1_290.0, 990.0, 710.0, 530.0, 400.0, 310.0, 250.0, 151.0, 98.0, 73.0, 60.0],
    [925.0, 735.0, 545.0, 415.0, 325.0, 264.0, 220.0, 140.0, 94.0, 72.0, 60.0],
    [710.0, 570.0, 435.0, 345.0, 278.0, 228.0, 195.0, 130.0, 91.0, 70.0, 60.0],
    [395.0, 345.0, 275.0, 228.0, 190.0, 163.0, 143.0, 105.0, 81.0, 67.0, 60.0],
    [264.0, 248.0, 210.0, 177.0, 153.0, 134.0, 118.0, 91.0, 73.0, 64.0, 60.0],
    [202.0, 196.0, 176.0, 151.0, 130.0, 115.0, 103.0, 81.0, 67.0, 62.0, 60.0],
    [166.0, 164.0, 154.0, 133.0, 117.0, 104.0, 93.0, 75.0, 64.0, 60.0, 60.0],
    [147.0, 145.0, 138.0, 120.0, 108.0, 98.0, 88.0, 70.0, 60.0, 58.0, 60.0],
    [140.0, 139.0, 130.0, 115.0, 105.0, 95.0, 86.0, 70.0, 60.0, 57.0, 60.0],
    [140.0, 139.0, 129.0, 116.0, 107.0, 99.0, 91.0, 75.0, 62.0, 56.0, 60.0],
    [153.0, 150.0, 140.0, 129.0, 118.0, 110.0, 102.0, 81.0, 64.0, 56.0, 60.0],
    [180.0, 166.0, 152.0, 139.0, 127.0, 116.0, 105.0, 82.0, 65.0, 56.0, 60.0],
];

/// Returns the zodiacal light in a direction, S10, with the Sun in another (ICRF axes, any length).
pub fn zodiacal_s10(direction_icrf: DVec3, sun_icrf: DVec3) -> f64 {
    let [longitude, latitude] = ecliptic_rad(direction_icrf);
    let from_sun = (longitude - ecliptic_rad(sun_icrf)[0]) / DEG;
    table_s10(from_sun, latitude / DEG)
}

/// Returns the light of the Galaxy in a direction (ICRF axes, any length), mean over galactic longitude, S10.
pub fn galactic_s10(direction_icrf: DVec3) -> f64 {
    let [ra, dec] = GALACTIC_POLE_DEG.map(|deg| deg * DEG);
    let pole = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
    let sine = direction_icrf.normalize_or_zero().dot(pole).abs();
    let seen = |depth: f64| -(-depth).exp_m1();
    POLE_S10 * seen(SLAB_DEPTH / sine) / seen(SLAB_DEPTH)
}

/// Returns the V magnitude per square arcsecond of a brightness in S10.
pub fn mag_per_arcsec2(s10: f64) -> f64 {
    S10_MAG_PER_ARCSEC2 - 2.5 * s10.log10()
}

/// Returns the ecliptic longitude and latitude (J2000), rad.
fn ecliptic_rad(icrf: DVec3) -> [f64; 2] {
    let (sin_e, cos_e) = (OBLIQUITY_ARCSEC / 3600.0 * DEG).sin_cos();
    let DVec3 { x, y, z } = icrf.normalize_or_zero();
    let ecliptic = DVec3::new(x, cos_e * y + sin_e * z, cos_e * z - sin_e * y);
    [ecliptic.y.atan2(ecliptic.x), ecliptic.z.clamp(-1.0, 1.0).asin()]
}

/// Returns the value of the table at a helioecliptic longitude and a latitude, deg.
fn table_s10(longitude_deg: f64, latitude_deg: f64) -> f64 {
    // Both hemispheres and both sides of the Sun are equal.
    let turned = longitude_deg.rem_euclid(360.0);
    let (row, u) = cell(&LONGITUDE_DEG, turned.min(360.0 - turned));
    let (column, v) = cell(&LATITUDE_DEG, latitude_deg.abs());
    let ln = |i: usize, j: usize| ZODIACAL_S10[row + i][column + j].ln();
    let near = ln(0, 0) * (1.0 - v) + ln(0, 1) * v;
    let far = ln(1, 0) * (1.0 - v) + ln(1, 1) * v;
    (near * (1.0 - u) + far * u).exp()
}

/// Returns the cell of `value` among rising nodes, and the share of it that lies below `value`.
fn cell(nodes: &[f64], value: f64) -> (usize, f64) {
    let i = nodes.partition_point(|node| *node <= value).clamp(1, nodes.len() - 1) - 1;
    (i, ((value - nodes[i]) / (nodes[i + 1] - nodes[i])).clamp(0.0, 1.0))
}

/// Parts of the sky that shine.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SkyBrightness {
    /// True when the zodiacal light shines.
    pub zodiacal: bool,
    /// True when the Galaxy shines.
    pub galactic: bool,
    /// Electrons per second and pixel of 1 S10, on the axis.
    pub e_per_s_of_s10: f64,
}

impl SkyBrightness {
    /// Returns whether it shines nowhere.
    pub fn is_dark(&self) -> bool {
        !(self.zodiacal || self.galactic)
    }

    /// Returns electrons per second and pixel in a direction, with the Sun in another (ICRF axes).
    pub fn e_per_s(&self, direction_icrf: DVec3, sun_icrf: DVec3) -> f64 {
        let zodiacal = if self.zodiacal { zodiacal_s10(direction_icrf, sun_icrf) } else { 0.0 };
        let galactic = if self.galactic { galactic_s10(direction_icrf) } else { 0.0 };
        self.e_per_s_of_s10 * (zodiacal + galactic)
    }
}

/// Returns the solid angle of a pixel on the axis, arcsec^2, from its sides in rad.
pub fn pixel_arcsec2(ifov_rad: [f64; 2]) -> f64 {
    let side = DVec2::from_array(ifov_rad) / (DEG / 3600.0);
    side.x * side.y
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ra_deg: f64, dec_deg: f64) -> DVec3 {
        let (ra, dec) = (ra_deg * DEG, dec_deg * DEG);
        DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin())
    }

    #[test]
    fn the_table_is_met_at_its_nodes_and_on_both_sides() {
        for (longitude, latitude, wanted) in
            [(90.0, 0.0, 202.0), (180.0, 0.0, 180.0), (45.0, 30.0, 195.0), (15.0, 0.0, 9_000.0), (33.0, 90.0, 60.0)]
        {
            for (l, b) in [(longitude, latitude), (-longitude, -latitude), (360.0 - longitude, latitude)] {
                assert!((table_s10(l, b) / wanted - 1.0).abs() < 1e-12, "{l} {b}: {}", table_s10(l, b));
            }
        }
        // Between nodes: the geometric mean at the middle.
        assert!((table_s10(67.5, 0.0) - (395.0_f64 * 264.0).sqrt()).abs() < 1e-9);
        assert!((table_s10(90.0, 52.5) - (81.0_f64 * 67.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn magnitudes_are_those_that_telescopes_quote() {
        // Hubble's low, average and high zodiacal light: 23.3, 22.7, 22.1 V mag/arcsec^2 (WFC3 Instrument Handbook,
        // 9.7).
        for (s10, mag) in [(60.0, 23.3), (105.0, 22.7), (180.0, 22.1)] {
            assert!((mag_per_arcsec2(s10) - mag).abs() < 0.05, "{s10}: {}", mag_per_arcsec2(s10));
        }
    }

    #[test]
    fn directions_are_turned_to_the_ecliptic() {
        // The ecliptic's pole is at RA 270, Dec 66.56 deg; the Sun at the March equinox at RA 0.
        let sun = at(0.0, 0.0);
        assert!((zodiacal_s10(at(270.0, 66.560_7), sun) - 60.0).abs() < 0.1);
        assert!((zodiacal_s10(at(180.0, 0.0), sun) - 180.0).abs() < 1e-6, "Gegenschein");
        // RA 90 deg, Dec 23.44 deg is the summer solstice: longitude 90 deg in the ecliptic.
        assert!((zodiacal_s10(at(90.0, 23.439_28), sun) - 202.0).abs() < 0.1);
        assert!(zodiacal_s10(at(90.0, 0.0), sun) < 165.0, "control: the equator is 23 deg off");
    }

    #[test]
    fn the_table_falls_as_the_module_says() {
        let mut steepest = 0.0_f64;
        for l in 60..180 {
            for b in 0..85 {
                let (l, b) = (f64::from(l), f64::from(b));
                let here = table_s10(l, b).ln();
                steepest = steepest.max((table_s10(l + 1.0, b).ln() - here).abs());
                steepest = steepest.max((table_s10(l, b + 1.0).ln() - here).abs());
            }
        }
        assert!(steepest < 0.047 && steepest > 0.02, "{steepest}");
        for l in 0..180 {
            let fall = table_s10(f64::from(l), 0.0) / table_s10(f64::from(l) + 1.0, 0.0);
            assert!(fall > 0.98 && fall < 1.5, "no step at {l}: {fall}");
        }
    }

    #[test]
    fn the_galaxy_is_bright_in_its_plane() {
        let pole = at(192.859_48, 27.128_25);
        assert!((galactic_s10(pole) - 30.0).abs() < 1e-9 && (galactic_s10(-pole) - 30.0).abs() < 1e-9);
        // The galactic centre, RA 266.405, Dec -28.936 deg; and 30 deg towards the pole from it.
        let centre = at(266.405, -28.936);
        let in_plane = 30.0 / (1.0 - (-0.15_f64).exp());
        assert!((galactic_s10(centre) / in_plane - 1.0).abs() < 1e-6, "{}", galactic_s10(centre));
        let up = centre * (30.0 * DEG).cos() + pole * (30.0 * DEG).sin();
        assert!((galactic_s10(up) - 55.8).abs() < 0.2, "{}", galactic_s10(up));
        assert!(galactic_s10(DVec3::X).is_finite() && galactic_s10(pole.any_orthonormal_vector()).is_finite());
    }

    #[test]
    fn brightness_adds_what_shines() {
        let (sun, direction) = (at(0.0, 0.0), at(180.0, 10.0));
        let sky =
            |zodiacal, galactic| SkyBrightness { zodiacal, galactic, e_per_s_of_s10: 2.0 }.e_per_s(direction, sun);
        assert_eq!(sky(false, false), 0.0);
        assert!((sky(true, true) - sky(true, false) - sky(false, true)).abs() < 1e-9);
        assert_eq!(sky(true, false), 2.0 * zodiacal_s10(direction, sun));
        assert!((pixel_arcsec2([DEG / 3600.0, 2.0 * DEG / 3600.0]) - 2.0).abs() < 1e-12);
    }
}
