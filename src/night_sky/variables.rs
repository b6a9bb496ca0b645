//! Hipparcos number -> a bright variable star: stars that a catalog has at one brightness and a photograph at another.
//!
//! All stars of the General Catalogue of Variable Stars (N. N. Samus and others, Astronomy Reports 61, 80, 2017; its file of 2016 with
//! 47,969 stars and its list of Hipparcos numbers) that reach V = 8 and change by half a magnitude or more in V: names, types and
//! ranges are from it. Ranges of five are not from there: U Mon, V Hya, Y CVn and W Hya, which it has in photographic
//! light, and Betelgeuse, which became fainter in 2020. Limits: ranges are in V, the catalog's magnitudes in Gaia's G. Tests: below; a
//! frame with one of them changed in `tests/night_sky`.

use base::source_id::{GaiaRelease, SourceId};
use stars::numbering::hipparcos_of_gaia;

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
