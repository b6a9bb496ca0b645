//! One pixel of a kept frame as JSON: its value, and its direction where the frame has a map of the sky.
//!
//! Directions are catalog places (ICRS at the frame's epoch, without aberration and deflection), as in the header of a
//! FITS file of the frame. Gnomonic projection with polynomials: Calabretta and Greisen 2002, A&A 395, 1077; Shupe et
//! al. 2005, ASP Conf. 347, 491. Tests: below; `hil_scripts/test_live.py` compares values with those of a FITS file.

use crate::live::kept::KeptFrame;
use frames::sink::Wcs;
use serde_json::{Value, json};

/// Returns number, place, value and direction of a pixel; `None` outside of the frame.
pub(super) fn pixel_of(frame: &KeptFrame, [x, y]: [usize; 2]) -> Option<Value> {
    let dn = frame.image.get(x, y)?;
    let there = frame.wcs.as_ref().map(|wcs| direction_deg(wcs, [x as f64, y as f64]));
    let [ra_deg, dec_deg] = [0, 1].map(|axis| there.map(|there| there[axis]));
    Some(json!({ "frame": frame.number, "x_px": x, "y_px": y, "dn": dn, "ra_deg": ra_deg, "dec_deg": dec_deg }))
}

/// Returns right ascension (0 to 360) and declination of a place in the frame whose first pixel's centre is (0, 0),
/// deg.
fn direction_deg(wcs: &Wcs, place_px: [f64; 2]) -> [f64; 2] {
    // FITS counts pixels from 1.
    let [u, v] = [0, 1].map(|axis| place_px[axis] + 1.0 - wcs.crpix[axis]);
    let order = wcs.orders()[0];
    let mut flat = [u, v];
    for i in 0..=order {
        for j in 0..=order - i {
            let terms = wcs.forward(i, j);
            let power = libm::pow(u, f64::from(i)) * libm::pow(v, f64::from(j));
            flat = [flat[0] + terms[0] * power, flat[1] + terms[1] * power];
        }
    }
    let [east, north] = wcs.cd_deg_px.map(|row| (row[0] * flat[0] + row[1] * flat[1]).to_radians());
    let [ra, dec] = wcs.crval_deg.map(f64::to_radians);
    let (sin, cos) = (libm::sin(dec), libm::cos(dec));
    let outwards = cos - north * sin;
    let found_ra = ra + libm::atan2(east, outwards);
    let found_dec = libm::atan2(sin + north * cos, libm::hypot(east, outwards));
    [found_ra.to_degrees().rem_euclid(360.0), found_dec.to_degrees()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::{Sip, SipTerm};
    use std::sync::Arc;

    fn map() -> Wcs {
        Wcs {
            crpix: [16.0, 9.0],
            crval_deg: [359.99, 60.0],
            cd_deg_px: [[-0.01, 0.0], [0.0, -0.01]],
            quadratic_px: [[0.0; 3]; 2],
            sip: None,
            error_px: 0.0,
        }
    }

    fn near(got: [f64; 2], wanted: [f64; 2]) -> bool {
        (0..2).all(|axis| (got[axis] - wanted[axis]).abs() < 1e-9)
    }

    #[test]
    fn reference_pixel_and_its_neighbours_are_where_the_projection_puts_them() {
        assert!(near(direction_deg(&map(), [15.0, 8.0]), [359.99, 60.0]), "counted from 0");
        let north = direction_deg(&map(), [15.0, -92.0]);
        assert!(
            near(north, [359.99, 60.0 + 0.01_f64.mul_add(100.0, 0.0).to_radians().atan().to_degrees()]),
            "{north:?}"
        );
        // A tangent of 0.01 deg per pixel to the east: beyond 24 h the right ascension begins again.
        let east = direction_deg(&map(), [-85.0, 8.0]);
        let tangent = 1.0_f64.to_radians();
        assert!(
            (east[0] - (359.99 + (tangent / 60.0_f64.to_radians().cos()).atan().to_degrees() - 360.0)).abs() < 1e-9
        );
        assert!(east[1] < 60.0, "a great circle: {east:?}");
    }

    #[test]
    fn polynomials_of_lens_and_frame_are_added() {
        let term = SipTerm { i: 2, j: 0, along: [1e-3, 0.0] };
        let sip = Sip { order: 2, forward: vec![term], ..Sip::default() };
        let bent = Wcs { sip: Some(Arc::new(sip)), quadratic_px: [[0.0, 0.0, 2e-3], [0.0; 3]], ..map() };
        // u = 10 and v = 10: the column is 0.1 px and 0.2 px farther.
        let wanted = direction_deg(&map(), [25.3, 18.0]);
        assert!(near(direction_deg(&bent, [25.0, 18.0]), wanted));
        assert!(!near(direction_deg(&map(), [25.0, 18.0]), wanted), "control: without the polynomials");
    }
}
