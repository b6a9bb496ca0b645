//! Pairs of real and drawn stars -> those that are far off, by name, and the figures with and without them.
//!
//! A star is an outlier when its place or its magnitude is off by more than [`OUTLYING`] times the largest of three: the spread
//! of all stars by their median, its own error by noise, and a floor. The spread by the median hardly changes with a few stars
//! that are far off; the rms does (one variable star of 36 made 0.116 mag to 0.305).
//!
//! Bright variable stars are known by their Hipparcos numbers: a catalog has them at one brightness and a photograph at
//! another. They are all stars of the General Catalogue of Variable Stars (N. N. Samus and others, Astronomy Reports 61, 80, 2017; its file of 2016 with
//! 47,969 stars and its list of Hipparcos numbers) that reach V = 8 and change by half a magnitude or more in V: names, types and
//! ranges are from it. Ranges of five are not from there: U Mon, V Hya, Y CVn and W Hya, which it has in photographic
//! light, and Betelgeuse, which became fainter in 2020. Limits: ranges are in V, the catalog's magnitudes in Gaia's G. Tests: below; a
//! frame with one of them changed in `tests/night_sky`.

use crate::figures::{Pair, StarRow};
use crate::picture::{rms, robust};
use base::least_squares::median;
use base::source_id::{GaiaRelease, SourceId};
use core::f64::consts::SQRT_2;
use serde::Serialize;
use stars::numbering::hipparcos_of_gaia;

/// Spreads from which a star is an outlier.
pub const OUTLYING: f64 = 4.0;
/// Least spreads, px along both axes together and mag: half of the fixed limits. A star that is off by less than four times as
/// much does not decide alone.
const FLOORS: [f64; 2] = [0.075, 0.075];
/// Rms length of a Gaussian's two coordinates over the median length: `1 / sqrt(ln 2)`.
const RMS_OF_MEDIAN: f64 = 1.2011;
/// Most stars of the list besides the outliers.
const MOST_OTHERS: usize = 3;
/// Magnitudes of a flux that is `1 + 1 / SNR` times as large.
const MAG_OF_SHARE: f64 = 1.0857;

/// A star that is far off.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstStar {
    /// Name in the source catalog.
    pub name: Option<String>,
    /// Hipparcos number.
    pub hipparcos: Option<u32>,
    /// Name, type and range of a known variable star.
    pub variable: Option<String>,
    /// It is an outlier, and not in the judged figures.
    pub is_outlier: bool,
    /// Its magnitude alone is off, and it is a known variable: it does not count against the limit of outliers.
    pub is_explained: bool,
    /// It is drawn above SNR 20 and has less than 0.4 of that light in the real frame.
    pub is_missing: bool,
    /// Gaia G.
    pub mag_g: f64,
    /// Place in the real frame, px.
    pub x_px: f64,
    /// Row.
    pub y_px: f64,
    /// Real less drawn, px.
    pub dx_px: f64,
    /// Real less drawn, px.
    pub dy_px: f64,
    /// Magnitude of the real star less that of the drawn one.
    pub dmag: f64,
}

impl WorstStar {
    /// Returns the star in words, with what is off.
    pub fn words(&self) -> String {
        let name = self.name.clone().unwrap_or_else(|| "a star without a name".into());
        let number = self.hipparcos.map(|hip| format!("HIP {hip}")).filter(|hip| *hip != name);
        let known: Vec<String> = number.into_iter().chain(self.variable.clone()).collect();
        let known = if known.is_empty() { String::new() } else { format!(" ({})", known.join(", ")) };
        let kind = if self.is_missing { ", missing" } else { "" };
        format!(
            "{name}{known}, G {:.2}, at column {:.0}, row {:.0}: {:.3} px, {:+.2} mag{kind}",
            self.mag_g,
            self.x_px,
            self.y_px,
            self.dx_px.hypot(self.dy_px),
            self.dmag
        )
    }
}

/// Figures of places and magnitudes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Figures {
    /// Rms distance along both axes together, of all stars.
    pub px: f64,
    /// The same without outliers.
    pub robust_px: f64,
    /// Rms difference of magnitudes, of all stars.
    pub mag: f64,
    /// The same without outliers.
    pub robust_mag: f64,
}

/// Returns which rows are outliers; `pairs` are those of the rows.
pub(crate) fn outliers(rows: &[StarRow], pairs: &[&Pair]) -> Vec<[bool; 2]> {
    let mut distances: Vec<f64> = rows.iter().map(distance).collect();
    let mut magnitudes: Vec<f64> = rows.iter().map(|row| row.dmag).collect();
    // Magnitudes are off by a constant where the zero point is: they are compared with 0 here, as the figures are.
    let [middle, spread] = if magnitudes.is_empty() { [0.0; 2] } else { robust(&mut magnitudes) };
    let spreads = [RMS_OF_MEDIAN * median(&mut distances), spread.hypot(middle)];
    let of = |(row, pair): (&StarRow, &&Pair)| {
        let errors = [SQRT_2 * pair.real.place_error_px, MAG_OF_SHARE / row.snr];
        let limit = |i: usize| OUTLYING * spreads[i].max(errors[i]).max(FLOORS[i]);
        [distance(row) > limit(0), row.dmag.abs() > limit(1)]
    };
    rows.iter().zip(pairs).map(of).collect()
}

fn distance(row: &StarRow) -> f64 {
    row.dx_px.hypot(row.dy_px)
}

/// Returns the figures of the real stars, and of the drawn ones measured alike.
pub(crate) fn figures(rows: &[StarRow], outliers: &[[bool; 2]]) -> [Figures; 2] {
    let kept = || rows.iter().zip(outliers).filter(|(_, off)| **off == [false; 2]).map(|(row, _)| row);
    let drawn = |row: &StarRow| row.drawn_dx_px.hypot(row.drawn_dy_px);
    let real = Figures {
        px: rms(rows.iter().map(distance)),
        robust_px: rms(kept().map(distance)),
        mag: rms(rows.iter().map(|row| row.dmag)),
        robust_mag: rms(kept().map(|row| row.dmag)),
    };
    let drawn = Figures {
        px: rms(rows.iter().map(drawn)),
        robust_px: rms(kept().map(drawn)),
        mag: rms(rows.iter().map(|row| row.drawn_dmag)),
        robust_mag: rms(kept().map(|row| row.drawn_dmag)),
    };
    [real, drawn]
}

/// A star that may be listed.
pub(crate) struct Candidate<'p> {
    pub pair: &'p Pair,
    pub row: StarRow,
    /// Its place, its magnitude is off.
    pub off: [bool; 2],
    pub is_missing: bool,
}

/// Returns all outliers and missing stars, and the worst of the others.
pub(crate) fn worst(candidates: &[Candidate<'_>]) -> Vec<WorstStar> {
    // A tenth of a pixel counts as a tenth of a magnitude.
    let by = |row: &StarRow| distance(row).max(row.dmag.abs());
    let is_bad = |one: &Candidate<'_>| one.is_missing || one.off != [false; 2];
    let mut order: Vec<&Candidate<'_>> = candidates.iter().collect();
    order.sort_by(|a, b| is_bad(b).cmp(&is_bad(a)).then(by(&b.row).total_cmp(&by(&a.row))));
    order.truncate(candidates.iter().filter(|one| is_bad(one)).count() + MOST_OTHERS);
    order.into_iter().map(star).collect()
}

fn star(of: &Candidate<'_>) -> WorstStar {
    let Candidate { pair, row, off: [is_place_off, is_mag_off], is_missing } = of;
    let hipparcos = pair.name.and_then(hipparcos);
    let variable = hipparcos.and_then(variable).map(|star| star.words());
    WorstStar {
        name: pair.name.map(|name| name.to_string()),
        hipparcos,
        is_outlier: *is_place_off || *is_mag_off,
        is_explained: *is_mag_off && !is_place_off && variable.is_some(),
        variable,
        is_missing: *is_missing,
        mag_g: row.mag_g,
        x_px: row.x_px,
        y_px: row.y_px,
        dx_px: row.dx_px,
        dy_px: row.dy_px,
        dmag: row.dmag,
    }
}

/// The stars, in the order of their numbers.
const TABLE: &str = include_str!("variables.csv");

/// A variable star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variable {
    /// Its name.
    pub name: &'static str,
    /// Its type, as the General Catalogue of Variable Stars has it: M for Mira stars, DCEP for Cepheids.
    pub kind: &'static str,
    /// V at its brightest and at its faintest.
    pub range_v: [f64; 2],
}

impl Variable {
    /// Returns the row of a line; `None` where it is none.
    fn of(line: &'static str) -> Option<(u32, Self)> {
        let mut cells = line.split(',');
        let mut next = || cells.next();
        let (number, name, kind) = (next()?.parse().ok()?, next()?, next()?);
        Some((number, Self { name, kind, range_v: [next()?.parse().ok()?, next()?.parse().ok()?] }))
    }

    /// Returns the star in words.
    pub fn words(&self) -> String {
        let [brightest, faintest] = self.range_v;
        format!("variable {}, type {}, V {brightest} to {faintest}", self.name, self.kind)
    }
}

/// Returns the Hipparcos number of a star by its name in its source catalog.
pub fn hipparcos(name: SourceId) -> Option<u32> {
    match name {
        SourceId::Hipparcos(number) => Some(number),
        SourceId::Gaia(GaiaRelease::Dr3 | GaiaRelease::Unknown, number) => hipparcos_of_gaia(number),
        SourceId::Gaia(GaiaRelease::Dr2, _) | SourceId::Tycho(..) | SourceId::Own(_) => None,
    }
}

/// Returns the variable star of a Hipparcos number.
pub fn variable(hipparcos: u32) -> Option<Variable> {
    TABLE.lines().filter_map(Variable::of).find(|(number, _)| *number == hipparcos).map(|(_, star)| star)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::Spot;
    use base::source_id::SourceId;

    fn pair(hip: u32) -> Pair {
        let real = Spot {
            px: [100.0, 50.0],
            flux_dn: 5000.0,
            flux_error_dn: 100.0,
            place_error_px: 0.02,
            beside_dn: 0.0,
            is_saturated: false,
            is_placed: true,
        };
        let (mag_g, bp_rp) = (6.0, 1.0);
        let name = Some(SourceId::Hipparcos(hip));
        Pair { real, drawn: real, truth_px: real.px, truth_dn: 5000.0, mag_g, bp_rp, is_blended: false, name }
    }

    /// Returns rows that are off by 0.05 px and 0.05 mag, with signs in turn, and one that is off by more.
    fn rows(dx_px: f64, dmag: f64) -> Vec<StarRow> {
        let row = |i: u32, dx_px: f64, dmag: f64| {
            let sign = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            StarRow { dx_px: sign * dx_px, dmag: sign * dmag, ..StarRow::of(&pair(i)) }
        };
        (0..35).map(|i| row(i, 0.05, 0.05)).chain([row(0, dx_px, dmag)]).collect()
    }

    #[test]
    fn one_variable_star_changes_the_plain_figure_alone_and_is_named() {
        let (rows, all) = (rows(0.05, 1.8), (0..35).map(pair).chain([pair(10_826)]).collect::<Vec<_>>());
        let pairs: Vec<&Pair> = all.iter().collect();
        let off = outliers(&rows, &pairs);
        assert_eq!(off.iter().filter(|off| **off != [false; 2]).count(), 1);
        let [real, _] = figures(&rows, &off);
        assert!((real.mag - 0.3041).abs() < 1e-3 && (real.robust_mag - 0.05).abs() < 1e-9, "{real:?}");
        let candidate = |((row, pair), off): ((&StarRow, &&Pair), &[bool; 2])| {
            let pair: &Pair = pair;
            (row.clone(), *pair, *off)
        };
        let parts: Vec<_> = rows.iter().zip(&pairs).zip(&off).map(candidate).collect();
        let listed: Vec<Candidate<'_>> = parts
            .iter()
            .map(|(row, pair, off)| Candidate { pair, row: row.clone(), off: *off, is_missing: false })
            .collect();
        let worst = worst(&listed);
        assert_eq!(worst.len(), 1 + MOST_OTHERS);
        assert!(worst[0].is_outlier && worst[0].is_explained && !worst[1].is_outlier, "{worst:?}");
        let words = worst[0].words();
        assert!(words.starts_with("HIP 10826 (variable o Cet (Mira), type M, V 2 to 10.1), G 6.00"), "{words}");
        assert!(words.contains("+1.80 mag") || words.contains("-1.80 mag"), "{words}");
    }

    #[test]
    fn stars_that_are_all_off_are_not_outliers() {
        let all: Vec<Pair> = (0..36).map(pair).collect();
        let pairs: Vec<&Pair> = all.iter().collect();
        let shifted: Vec<StarRow> =
            rows(2.0, 0.05).into_iter().map(|row| StarRow { dx_px: 2.0, dmag: 0.5, ..row }).collect();
        let off = outliers(&shifted, &pairs);
        assert!(off.iter().all(|off| *off == [false; 2]));
        assert!((figures(&shifted, &off)[0].robust_px - 2.0).abs() < 1e-9, "the shift stays in the figure");
        let placed = outliers(&rows(0.6, 0.05), &pairs);
        assert_eq!(placed[35], [true, false], "control: one star alone is off");
    }
}

#[cfg(test)]
mod variables_tests {
    use super::*;

    #[test]
    fn every_line_is_a_star_that_changes_by_half_a_magnitude() {
        let stars: Vec<(u32, Variable)> = TABLE.lines().filter_map(Variable::of).collect();
        assert_eq!(stars.len(), TABLE.lines().count() - 1, "all but the head");
        assert!(stars.windows(2).all(|pair| pair[0].0 < pair[1].0), "in order, each once");
        assert!(stars.iter().all(|(_, star)| star.range_v[1] - star.range_v[0] >= 0.499 && star.range_v[0] <= 8.0));
    }

    #[test]
    fn mira_is_known_and_vega_is_not() {
        let mira = variable(10_826).unwrap();
        assert_eq!(mira.words(), "variable o Cet (Mira), type M, V 2 to 10.1");
        assert_eq!(variable(91_262), None);
        assert_eq!(hipparcos(SourceId::Hipparcos(10_826)), Some(10_826));
        assert_eq!(hipparcos(SourceId::Own(10_826)), None);
        // A star of magnitude 5.8 in Cetus.
        assert_eq!(hipparcos(SourceId::Gaia(GaiaRelease::Dr3, 650_159_265_042_048)), Some(14_315));
    }
}
