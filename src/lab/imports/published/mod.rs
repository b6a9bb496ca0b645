//! Catalogs as they are published -> stars for layers.
//!
//! * [`gaia`]: the bulk files of Gaia's archive, and any CSV with its column names;
//! * [`bright`]: Hipparcos and Tycho-2, for the bright end; `crossmatch`: those of them that Gaia lacks are added.
//!
//! Rows are taken in as they stream by; what a row lacks is counted and said, what it should not have ends the import
//! with file, line and column.
//!
//! **Variable stars** have their mean magnitude in Gaia (34 months to 2017) and their median in Hipparcos (1989 to 1993); a
//! frame shows that, whatever the date. **Saturated stars:** Gaia's G is the published one. Brighter than G = 6 or so
//! its images saturate: down to G = 3 the published magnitudes are good to some hundredths (Riello et al. 2021, A&A
//! 649, A3, give a correction of at most 0.02 mag, which is not applied), and most stars brighter than 3 have no row.
//! Those come from Hipparcos, whose magnitudes hold to the brightest but Sirius, which has one of its own.

pub mod bright;
pub mod bright_star;
mod crossmatch;
pub mod gaia;
mod lines;

pub use bright::add_bright;

#[cfg(test)]
mod bright_tests;
#[cfg(test)]
mod damage_tests;
