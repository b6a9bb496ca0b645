//! A star of a catalog brighter and older than Gaia's: its line in a file, its magnitudes in Gaia's bands, its epoch.
//!
//! | relation | domain | spread, mag |
//! |---|---|---|
//! | G - Hp by V - I | -0.3 to 4 | 0.015 |
//! | BP - RP by V - I (Gaia DR3 documentation, sec. 5.5.1) | -0.3 to 4 | 0.06 |
//! | G - VT by BT - VT | -0.3 to 2.2 | 0.04 |
//! | BP - RP by BT - VT | -0.3 to 2.2 | 0.05 |
//!
//! All but the second were fitted to single stars of both catalogs; that of VT to 290,000 to VT = 10, within 0.01 mag
//! of their medians up to BT - VT = 1.8 and 0.06 beyond. Beyond its domain a colour is taken as the domain's end:
//! polynomials run away there. Without a colour a star is taken to have that of a middling one, and its own stays
//! unknown. Tests: `tests` (ends of the domains, known stars), and on real rows `hil_scripts/tests/test_catalog.py`.
//!
//! Lines of `hip2.dat`: Hipparcos, the new reduction (van Leeuwen 2007, A&A 474, 653; CDS catalog I/311): fixed columns, right ascension and
//! declination in radians (ICRS, epoch J1991.25), parallax (mas), proper motion (mas/yr, with cos dec), Hp, its
//! scatter, B - V and V - I (mag). The magnitude is a median over 3.3 years; a variable star's may differ from Gaia's
//! mean by as much as it varies, so that its tolerance grows with the scatter. Sirius was too bright for the
//! instrument: its Hp is 0.37 mag too faint, and `SIRIUS` has its magnitude. Tests: `super::bright_tests`.
//!
//! Lines of Tycho-2 (Hog et al. 2000, A&A 355, L27; CDS catalog I/259): `tyc2.dat` has parts between bars, angles in degrees
//! (ICRS), motions in mas/yr (with cos dec), BT and VT in mag. The mean position is of J2000 and holds where the flag
//! is blank; with `P` it is that of two stars together, with `X` there is none and no motion: then the position as
//! observed about 1991.5 is taken. `suppl_1.dat` has stars of Hipparcos and Tycho-1 that Tycho-2 lacks, observed in
//! J1991.25; where it has Hp (flag `H`), it replaces VT. Its second supplement, of doubtful stars, is not read. Tests:
//! `super::bright_tests`.

use base::refused::Refused;
use base::source::{direction_from_ra_dec, ra_dec_rad};
use base::units::{DEG, MAS};
use core::f64::consts::{FRAC_PI_2, TAU};
use glam::DVec3;
use stars::{layer::NewStar, numbering::TYCHO_NUMBERS};
use std::path::Path;

/// A star as Hipparcos or Tycho-2 has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightStar {
    /// Minus the Hipparcos number, or -(10^12 + 10^6 TYC1 + 10 TYC2 + TYC3): Gaia's numbers are positive.
    pub source_id: i64,
    /// Direction at its epoch, unit vector.
    pub direction_icrf: DVec3,
    /// Julian year of the direction.
    pub epoch_yr: f64,
    /// Proper motion eastward (with cos dec) and northward, mas/yr, where it is known.
    pub motion_mas_yr: Option<[f64; 2]>,
    /// Parallax, mas, where it is known.
    pub parallax_mas: Option<f32>,
    /// G magnitude by the bands that were measured.
    pub mag_g: f32,
    /// BP - RP by them, where both are known.
    pub bp_rp: Option<f32>,
    /// How far Gaia's magnitude of the same star may be from it (`crossmatch`), mag.
    pub tolerance_mag: f32,
}

impl BrightStar {
    /// Returns the star at a Julian year, as a layer takes it.
    pub fn at(&self, epoch_yr: f64) -> NewStar {
        let (direction, motion_mas_yr) = moved(self.direction_icrf, self.motion_mas_yr, epoch_yr - self.epoch_yr);
        let [ra_rad, dec_rad] = ra_dec_rad(direction);
        NewStar {
            source_id: self.source_id,
            ra_rad,
            dec_rad,
            motion_mas_yr,
            parallax_mas: self.parallax_mas.map(f64::from),
            mag_g: f64::from(self.mag_g),
            bp_rp: self.bp_rp.map(f64::from),
        }
    }
}

/// Returns how far magnitudes of one star may be apart, mag, by its G, the scatter of its measurements, and whether its
/// colour is known.
fn tolerance_mag(mag_g: f64, scatter_mag: f64, has_colour: bool) -> f64 {
    let saturated = if mag_g < 4.0 { 0.5 } else { 0.0 };
    let unknown_colour = if has_colour { 0.0 } else { 0.75 };
    // Measurements over 3 years do not see the whole of a Mira's 5 mag.
    1.0 + saturated + unknown_colour + (3.0 * scatter_mag).clamp(0.0, 3.0)
}

/// Returns direction and proper motion `years` later: uniform straight motion in space, as `sky::astrometry::at_epoch`;
/// what is eastward there may not be here (Polaris). A star without a motion stays.
pub(super) fn moved(direction: DVec3, motion_mas_yr: Option<[f64; 2]>, years: f64) -> (DVec3, Option<[f64; 2]>) {
    let Some([east_mas_yr, north_mas_yr]) = motion_mas_yr else { return (direction, None) };
    let [east, north] = east_and_north(direction);
    let rate = east * east_mas_yr + north * north_mas_yr;
    let later = (direction + rate * (years * MAS)).normalize();
    (later, Some(east_and_north(later).map(|axis| rate.dot(axis))))
}

fn east_and_north(direction: DVec3) -> [DVec3; 2] {
    let east = DVec3::new(-direction.y, direction.x, 0.0).normalize_or(DVec3::Y);
    [east, direction.cross(east)]
}

/// One line of a file.
pub(super) struct Line<'a> {
    pub(super) path: &'a Path,
    /// From 1.
    pub(super) number: u64,
    pub(super) text: &'a str,
}

impl Line<'_> {
    /// Returns a number, or `None` where the field is blank.
    pub(super) fn number(&self, column: &str, field: &str) -> Result<Option<f64>, Refused> {
        let field = field.trim();
        if field.is_empty() {
            return Ok(None);
        }
        let number = field.parse().ok().filter(|number: &f64| number.is_finite());
        number.map(Some).ok_or_else(|| self.refuse(column, "a number, or blank", field))
    }

    /// Reads a number within limits that must be there.
    pub(super) fn required(
        &self,
        column: &str,
        field: &str,
        [low, high]: [f64; 2],
        wanted: &'static str,
    ) -> Result<f64, Refused> {
        let number = self.number(column, field)?.filter(|number| (low..=high).contains(number));
        number.ok_or_else(|| self.refuse(column, wanted, field))
    }

    pub(super) fn refuse(&self, column: &str, wanted: &'static str, got: &str) -> Refused {
        Refused(format!(
            "{path}, line {line}, column {column}: wanted {wanted}, got \"{got}\"",
            path = self.path.display(),
            line = self.number,
            got = got.trim().chars().take(40).collect::<String>()
        ))
    }

    pub(super) fn refuse_line(&self, wanted: &'static str) -> Refused {
        self.refuse("all", wanted, self.text)
    }
}

/// G - Hp by V - I.
const G_HP_BY_VI: [f64; 4] = [-0.019_64, -0.278_74, -0.180_7, 0.045_9];
/// BP - RP by V - I.
const BP_RP_BY_VI: [f64; 4] = [-0.032_98, 1.259, -0.127_9, 0.016_31];
/// Domain of V - I, mag.
const VI_DOMAIN_MAG: [f64; 2] = [-0.3, 4.0];
/// G - VT by BT - VT.
const G_VT_BY_BTVT: [f64; 5] = [-0.011_03, -0.164_53, -0.355_8, 0.319_58, -0.107_18];
/// BP - RP by BT - VT.
const BP_RP_BY_BTVT: [f64; 5] = [0.021_56, 1.324_74, -0.167_37, -0.240_53, 0.118_22];
/// Domain of BT - VT, mag.
const BTVT_DOMAIN_MAG: [f64; 2] = [-0.3, 2.2];
/// V - I of a star of unknown colour, mag.
const MIDDLING_VI_MAG: f64 = 0.7;
/// BT - VT of a star of unknown colour, mag.
const MIDDLING_BTVT_MAG: f64 = 0.7;

/// Returns the g and BP - RP by what Hipparcos measured.
pub(super) fn of_hipparcos(hp_mag: f64, vi_mag: Option<f64>) -> (f64, Option<f64>) {
    let [low, high] = VI_DOMAIN_MAG;
    let vi = vi_mag.map(|vi| vi.clamp(low, high));
    let g = hp_mag + polynomial(&G_HP_BY_VI, vi.unwrap_or(MIDDLING_VI_MAG));
    (g, vi.map(|vi| polynomial(&BP_RP_BY_VI, vi)))
}

/// Returns the g and BP - RP by what Tycho measured; `None` when it measured neither band.
pub(super) fn of_tycho(bt_mag: Option<f64>, vt_mag: Option<f64>) -> Option<(f64, Option<f64>)> {
    let [low, high] = BTVT_DOMAIN_MAG;
    let colour = bt_mag.zip(vt_mag).map(|(bt, vt)| (bt - vt).clamp(low, high));
    let vt = vt_mag.or(bt_mag.map(|bt| bt - MIDDLING_BTVT_MAG))?;
    let g = vt + polynomial(&G_VT_BY_BTVT, colour.unwrap_or(MIDDLING_BTVT_MAG));
    Some((g, colour.map(|colour| polynomial(&BP_RP_BY_BTVT, colour))))
}

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

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
pub(super) fn hipparcos_star(line: &Line<'_>) -> Result<Option<BrightStar>, Refused> {
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

/// Parts of a line of `tyc2.dat`.
pub(super) const TYCHO_PARTS: usize = 32;
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
pub(super) fn tycho_star(line: &Line<'_>) -> Result<Option<BrightStar>, Refused> {
    let parts = parts::<TYCHO_PARTS>(line);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_measured_by_both_come_out() {
        // Gaia's documentation gives the Sun's colour as BP - RP = 0.82, G - V = -0.17 about; V - I = 0.70, BT - VT = 0.73,
        // Hp - V = 0.13, VT - V = 0.07 (Hipparcos, vol. 1, sec. 1.3).
        let (g, colour) = of_hipparcos(5.13, Some(0.70));
        assert!((g - 4.83).abs() < 0.05 && (colour.unwrap() - 0.82).abs() < 0.04, "{g} {colour:?}");
        let (g, colour) = of_tycho(Some(5.80), Some(5.07)).unwrap();
        assert!((g - 4.83).abs() < 0.05 && (colour.unwrap() - 0.84).abs() < 0.05, "{g} {colour:?}");
        // A white star has one magnitude in all bands.
        let (g, colour) = of_hipparcos(6.0, Some(0.0));
        assert!((g - 6.0).abs() < 0.03 && colour.unwrap().abs() < 0.04);
        let (g, colour) = of_tycho(Some(6.0), Some(6.0)).unwrap();
        assert!((g - 6.0).abs() < 0.03 && colour.unwrap().abs() < 0.04);
    }

    #[test]
    fn beyond_their_domains_relations_stay_constant() {
        for ([low, high], of) in [
            (VI_DOMAIN_MAG, (|x| of_hipparcos(9.0, Some(x))) as fn(f64) -> (f64, Option<f64>)),
            (BTVT_DOMAIN_MAG, |x| of_tycho(Some(9.0 + x), Some(9.0)).unwrap()),
        ] {
            let apart = |a: f64, b: f64| (of(a).0 - of(b).0).abs() + (of(a).1.unwrap() - of(b).1.unwrap()).abs();
            assert!(apart(high + 3.0, high) < 1e-9 && apart(low - 3.0, low) < 1e-9);
            assert!(apart(high - 0.1, high) > 0.05 && apart(low + 0.1, low) > 0.05, "control: they move inside");
            let colours: Vec<f64> =
                (0..=100).map(|i| of(low + (high - low) * f64::from(i) / 100.0).1.unwrap()).collect();
            assert!(colours.is_sorted(), "redder is redder");
            let greens: Vec<f64> = (0..=100).map(|i| of(low + (high - low) * f64::from(i) / 100.0).0).collect();
            assert!(greens.iter().all(|g| (6.0..9.1).contains(g)), "{greens:?}");
        }
    }

    #[test]
    fn one_band_gives_a_magnitude_and_no_colour() {
        assert_eq!(of_tycho(None, None), None);
        let (from_vt, none) = of_tycho(None, Some(9.0)).unwrap();
        let (from_bt, also_none) = of_tycho(Some(9.7), None).unwrap();
        assert!(none.is_none() && also_none.is_none() && (from_vt - from_bt).abs() < 1e-9);
        assert!((from_vt - of_tycho(Some(9.7), Some(9.0)).unwrap().0).abs() < 1e-9);
        assert!(of_hipparcos(9.0, None).1.is_none());
    }
}
