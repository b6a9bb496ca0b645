//! Seed and faint end -> layers of stars that are not real, in the numbers that were measured.
//!
//! * [`Density`]: stars per square degree by direction and magnitude, from counts of Gaia DR3;
//! * [`Population`]: the stars of a seed, tile by tile, and the layers they make.
//!
//! For benches and scenes deeper than a catalog at hand. Numbers of stars are measured; places are without clusters,
//! dust lanes or doubles, and colours and motions only plausible. Every layer says in its credits what it is. Tests:
//! `density::tests` (means of regions against the measured ones), `tests` (Poisson counts, seeds, files).

mod density;
mod population;

pub use density::{Density, FAINTEST_MAG};
pub use population::{Population, credits};

#[cfg(test)]
mod tests;
