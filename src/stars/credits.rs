//! Where stars came from -> the credits that their catalogs ask for.
//!
//! A catalog of a user's own stars has no credits unless its maker gives them. Tests: below, and in `stars::catalog`,
//! `cli`.

use super::numbering::Origins;

/// Acknowledgement that Gaia's archive asks for.
pub const GAIA: &str = "This work has made use of data from the European Space Agency (ESA) mission Gaia \
    (https://www.cosmos.esa.int/gaia), processed by the Gaia Data Processing and Analysis Consortium (DPAC, \
    https://www.cosmos.esa.int/web/gaia/dpac/consortium).";
/// The Hipparcos catalog that is read here.
pub const HIPPARCOS: &str = "Hipparcos, the new reduction (van Leeuwen 2007, A&A 474, 653).";
/// Tycho-2.
pub const TYCHO: &str = "Tycho-2 (Hog et al. 2000, A&A 355, L27).";
/// Shown in the place of no credits.
pub const NONE: &str = "none: no star is known to come from a published catalog";

/// Credits for stars of these origins; empty when none is known to come from a published catalog.
pub fn credits_of(origins: &Origins) -> String {
    let [hipparcos, tycho] = origins.are_bright();
    let asked = [(origins.is_gaia(), GAIA), (hipparcos, HIPPARCOS), (tycho, TYCHO)];
    asked.iter().filter(|(is_due, _)| *is_due).map(|(_, text)| *text).collect::<Vec<_>>().join(" ")
}

/// Credits as they are shown to a person.
pub fn shown(credits: &str) -> &str {
    if credits.is_empty() { NONE } else { credits }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_catalogs_that_stars_came_from_are_credited() {
        let own = Origins { numbered: 5, ..Origins::default() };
        assert_eq!((credits_of(&own).as_str(), shown("")), ("", NONE));
        let gaia = Origins { numbered: 10, gaia: 9, ..Origins::default() };
        assert_eq!(credits_of(&gaia), GAIA);
        let all = Origins { hipparcos: 1, tycho: 1, ..gaia };
        assert_eq!(credits_of(&all), format!("{GAIA} {HIPPARCOS} {TYCHO}"));
        assert_eq!(credits_of(&Origins { named_tycho: 2, ..own }), TYCHO);
        let below_zero = Origins { hipparcos: 2, ..own };
        assert_eq!(credits_of(&below_zero), "", "numbers of one's own below zero");
        let mut bright = own;
        bright.begin_bright();
        bright.see(-87_937, 1.0, 1.0);
        assert_eq!(credits_of(&bright), HIPPARCOS);
    }
}
