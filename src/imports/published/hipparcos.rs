//! A line of `hip2.dat` -> a star.
//!
//! Hipparcos, the new reduction (van Leeuwen 2007, A&A 474, 653; CDS catalog I/311): fixed columns, right ascension and
//! declination in radians (ICRS, epoch J1991.25), parallax (mas), proper motion (mas/yr, with cos dec), Hp, its
//! scatter, B - V and V - I (mag). The magnitude is a median over 3.3 years; a variable star's may differ from Gaia's
//! mean by as much as it varies, so that its tolerance grows with the scatter. Sirius was too bright for the
//! instrument: its Hp is 0.37 mag too faint, and [`SIRIUS`] has its magnitude. Tests: `super::bright_tests`.

use super::{bands::of_hipparcos, bright_star::BrightStar, crossmatch::tolerance_mag, star_line::Line};
use base::{refused::Refused, source::direction_from_ra_dec};
use core::f64::consts::{FRAC_PI_2, TAU};

/// Epoch of the positions, Julian year.
const EPOCH_YR: f64 = 1991.25;
/// Number and G magnitude of Sirius: V = -1.46 (Bessell 1990, PASP 102, 1181), a white star.
const SIRIUS: (i64, f64) = (32_349, -1.45);
/// A line reaches to V - I at least; weights follow.
pub(super) const LEAST_CHARACTERS: usize = 171;

/// Columns, counted from 1, first and last, as the catalog's description has them.
const HIP: [usize; 2] = [1, 6];
const RA_RAD: [usize; 2] = [16, 28];
const DEC_RAD: [usize; 2] = [30, 42];
const PLX: [usize; 2] = [44, 50];
const PM_RA: [usize; 2] = [52, 59];
const PM_DEC: [usize; 2] = [61, 68];
const HP: [usize; 2] = [130, 136];
const SCATTER: [usize; 2] = [145, 149];
const V_I: [usize; 2] = [166, 171];

/// Returns the star of a line; `None` when it has no magnitude.
#[allow(clippy::cast_possible_truncation, reason = "magnitudes to 1e-6, and a number checked to be small")]
pub(super) fn star(line: &Line<'_>) -> Result<Option<BrightStar>, Refused> {
    let field = |[first, last]: [usize; 2]| &line.text[first - 1..last];
    let hip = line.required("HIP", field(HIP), [1.0, 999_999.0], "a Hipparcos number")?;
    let ra_rad = line.required("RArad", field(RA_RAD), [0.0, TAU], "0 to 2 pi radians")?;
    let dec_rad = line.required("DErad", field(DEC_RAD), [-FRAC_PI_2, FRAC_PI_2], "-pi/2 to pi/2 radians")?;
    let motion = line.number("pmRA", field(PM_RA))?.zip(line.number("pmDE", field(PM_DEC))?);
    let parallax_mas = line.number("Plx", field(PLX))?;
    let scatter_mag = line.number("sHp", field(SCATTER))?.unwrap_or(0.0);
    let vi_mag = line.number("V-I", field(V_I))?;
    let Some(hp_mag) = line.number("Hpmag", field(HP))? else { return Ok(None) };
    let (hip, (mag_g, bp_rp)) = (hip as i64, of_hipparcos(hp_mag, vi_mag));
    let mag_g = if hip == SIRIUS.0 { SIRIUS.1 } else { mag_g };
    Ok(Some(BrightStar {
        source_id: -hip,
        direction_icrf: direction_from_ra_dec(ra_rad, dec_rad),
        epoch_yr: EPOCH_YR,
        motion_mas_yr: motion.map(<[f64; 2]>::from),
        parallax_mas: parallax_mas.map(|mas| mas as f32),
        mag_g: mag_g as f32,
        bp_rp: bp_rp.map(|mag| mag as f32),
        tolerance_mag: tolerance_mag(mag_g, scatter_mag, bp_rp.is_some()) as f32,
    }))
}
