//! The cards of a frame's [`Wcs`].
//!
//! Sources: FITS standard 4.0, section 8; the SIP convention (Shupe et al. 2005): `A_p_q`, `B_p_q` from pixels,
//! `AP_p_q`, `BP_p_q` back. Read by astropy in `hil_scripts/test_wcs.py`.

use super::card::Header;
use crate::sink::wcs::Wcs;

/// Adds the map from pixels to catalog places.
pub(super) fn push_wcs(header: &mut Header, wcs: &Wcs) {
    header.comment("WCS: pixels to ICRS catalog places at the epoch of the frame (mid-exposure).");
    header.comment("Space motion and parallax are in those places, aberration and deflection of");
    header.comment("light are in the map. Motion within the exposure is not.");
    let projection = if wcs.has_sip() { "TAN-SIP" } else { "TAN" };
    header.push("WCSAXES", 2_u32, "axes of the sky");
    for (axis, name, what) in [(1, "RA---", "right ascension"), (2, "DEC--", "declination")] {
        header.push(&format!("CTYPE{axis}"), format!("{name}{projection}"), what);
        header.push(&format!("CUNIT{axis}"), "deg", "");
        header.push(&format!("CRPIX{axis}"), wcs.crpix[axis - 1], "[px] reference point, from 1");
        header.push(&format!("CRVAL{axis}"), wcs.crval_deg[axis - 1], "[deg] its catalog place");
        for pixel in [1, 2] {
            header.push(&format!("CD{axis}_{pixel}"), wcs.cd_deg_px[axis - 1][pixel - 1], "[deg/px]");
        }
    }
    header.push("LONPOLE", 180.0, "[deg] north is up in the plane of the sky");
    header.push("RADESYS", "ICRS", "");
    header.push("EQUINOX", 2000.0, "axes, not epoch: the epoch is DATE-AVG");
    header.push("WCSERR", wcs.error_px, "[px] largest error found over the image");
    if wcs.has_sip() {
        push_sip(header, wcs);
    }
}

fn push_sip(header: &mut Header, wcs: &Wcs) {
    let [order, inverse_order] = wcs.orders();
    push_polynomials(header, ["A", "B"], 2..=order, |i, j| wcs.forward(i, j));
    push_polynomials(header, ["AP", "BP"], 1..=inverse_order, |i, j| wcs.inverse(i, j));
}

/// Writes the terms of these degrees of two polynomials, one for each axis; zeros are left out.
fn push_polynomials(
    header: &mut Header,
    names: [&str; 2],
    degrees: core::ops::RangeInclusive<u8>,
    coefficients: impl Fn(u8, u8) -> [f64; 2],
) {
    for (axis, name) in names.into_iter().enumerate() {
        header.push(&format!("{name}_ORDER"), u32::from(*degrees.end()), "SIP polynomial");
        for (i, j) in degrees.clone().flat_map(|degree| (0..=degree).map(move |j| (degree - j, j))) {
            let value = coefficients(i, j)[axis];
            if value != 0.0 {
                header.push(&format!("{name}_{i}_{j}"), value, "");
            }
        }
    }
}
