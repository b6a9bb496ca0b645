//! Errors of a catalog.

use base::refused::Refused;

/// More stars or text than a catalog in memory is meant to hold.
pub(crate) fn too_many(what: &'static str, count: usize, most: usize) -> Refused {
    Refused(format!(
        "packed catalog: {count} {what}, wanted at most {most}: `starloop catalog import` takes any number of stars"
    ))
}

/// The text is not CSV, or could not be read.
pub(crate) fn not_csv(why: csv::Error) -> Refused {
    Refused(format!("catalog CSV: {why}"))
}
