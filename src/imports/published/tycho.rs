//! A line of Tycho-2 -> a star.
//!
//! Tycho-2 (Hog et al. 2000, A&A 355, L27; CDS catalog I/259): `tyc2.dat` has parts between bars, angles in degrees
//! (ICRS), motions in mas/yr (with cos dec), BT and VT in mag. The mean position is of J2000 and holds where the flag
//! is blank; with `P` it is that of two stars together, with `X` there is none and no motion: then the position as
//! observed about 1991.5 is taken. `suppl_1.dat` has stars of Hipparcos and Tycho-1 that Tycho-2 lacks, observed in
//! J1991.25; where it has Hp (flag `H`), it replaces VT. Its second supplement, of doubtful stars, is not read. Tests:
//! `super::bright_tests`.

use super::{bands::of_tycho, bright_star::BrightStar, crossmatch::tolerance_mag, star_line::Line};
use base::{refused::Refused, source::direction_from_ra_dec, units::DEG};
use stars::numbering::TYCHO_NUMBERS;

/// Parts of a line of `tyc2.dat`.
pub(super) const PARTS: usize = 32;
/// Parts of a line of `suppl_1.dat`.
pub(super) const SUPPLEMENT_PARTS: usize = 18;
/// Epoch of mean positions, Julian year.
const MEAN_EPOCH_YR: f64 = 2000.0;
/// Epoch of the supplement's positions, Julian year.
const SUPPLEMENT_EPOCH_YR: f64 = 1991.25;

/// Columns of the parts in a line.
struct Places {
    ra: usize,
    dec: usize,
    pm_ra: usize,
    pm_dec: usize,
    bt: usize,
    vt: usize,
}

const MEAN: Places = Places { ra: 2, dec: 3, pm_ra: 4, pm_dec: 5, bt: 17, vt: 19 };
const OBSERVED: Places = Places { ra: 24, dec: 25, ..MEAN };
const SUPPLEMENT: Places = Places { ra: 2, dec: 3, pm_ra: 4, pm_dec: 5, bt: 11, vt: 13 };
const FLAG: usize = 1;
const OBSERVED_EPOCHS: [usize; 2] = [26, 27];
const MAGNITUDE_FLAG: usize = 10;

/// Returns the star of a line of `tyc2.dat`; `None` when it has no magnitude.
pub(super) fn star(line: &Line<'_>) -> Result<Option<BrightStar>, Refused> {
    let parts = parts::<PARTS>(line);
    if parts[FLAG].trim().is_empty() {
        return star_at(line, &parts, &MEAN, MEAN_EPOCH_YR);
    }
    let [ra, dec] = OBSERVED_EPOCHS.map(|part| line.required("EpRA-1990", parts[part], [0.0, 5.0], "0 to 5 years"));
    star_at(line, &parts, &OBSERVED, 1990.0 + 0.5 * (ra? + dec?))
}

/// Returns the star of a line of `suppl_1.dat`; `None` when it has no magnitude.
pub(super) fn supplement_star(line: &Line<'_>) -> Result<Option<BrightStar>, Refused> {
    let parts = parts::<SUPPLEMENT_PARTS>(line);
    let star = star_at(line, &parts, &SUPPLEMENT, SUPPLEMENT_EPOCH_YR)?;
    // Hp differs from VT by some tenths: less than what a star without a colour is allowed.
    let is_hp = parts[MAGNITUDE_FLAG].trim() == "H";
    Ok(star.map(|star| BrightStar { bp_rp: star.bp_rp.filter(|_| !is_hp), ..star }))
}

/// Returns the `N` parts of a line.
fn parts<'a, const N: usize>(line: &Line<'a>) -> [&'a str; N] {
    let mut parts = line.text.split('|');
    core::array::from_fn(|_| parts.next().unwrap_or_default())
}

#[allow(clippy::cast_possible_truncation, reason = "magnitudes to 1e-6")]
fn star_at(line: &Line<'_>, parts: &[&str], places: &Places, epoch_yr: f64) -> Result<Option<BrightStar>, Refused> {
    let ra_deg = line.required("RA", parts[places.ra], [0.0, 360.0], "0 to 360 degrees")?;
    let dec_deg = line.required("DE", parts[places.dec], [-90.0, 90.0], "-90 to 90 degrees")?;
    let motion = line.number("pmRA", parts[places.pm_ra])?.zip(line.number("pmDE", parts[places.pm_dec])?);
    let (bt, vt) = (line.number("BTmag", parts[places.bt])?, line.number("VTmag", parts[places.vt])?);
    let source_id = -(TYCHO_NUMBERS + number(line, parts[0])?);
    let Some((mag_g, bp_rp)) = of_tycho(bt, vt) else { return Ok(None) };
    Ok(Some(BrightStar {
        source_id,
        direction_icrf: direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG),
        epoch_yr,
        motion_mas_yr: motion.map(<[f64; 2]>::from),
        parallax_mas: None,
        mag_g: mag_g as f32,
        bp_rp: bp_rp.map(|mag| mag as f32),
        tolerance_mag: tolerance_mag(mag_g, 0.0, bp_rp.is_some()) as f32,
    }))
}

/// Reads `TYC1 TYC2 TYC3` as one number.
fn number(line: &Line<'_>, part: &str) -> Result<i64, Refused> {
    let refused = || line.refuse("TYC", "three numbers, such as 0001 00008 1", part);
    let mut numbers = part.split_whitespace().map(|word| word.parse::<u32>().ok());
    match [(); 4].map(|()| numbers.next()) {
        [Some(Some(one @ ..=99_999)), Some(Some(two @ ..=99_999)), Some(Some(three @ ..=9)), None] => {
            Ok(i64::from(one) * 1_000_000 + i64::from(two) * 10 + i64::from(three))
        }
        _ => Err(refused()),
    }
}
