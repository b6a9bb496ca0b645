//! The truth table of a frame, column by column.

use frames::sink::{TruthKind, TruthStar};
use numpy::IntoPyArray;
use pyo3::{prelude::*, types::PyDict};

/// Returns one number of a row.
type Of = fn(&TruthStar) -> f64;

/// Returns the columns of a truth table as arrays of one length.
pub(crate) fn columns<'py>(py: Python<'py>, rows: &[TruthStar]) -> PyResult<Bound<'py, PyDict>> {
    let table = PyDict::new(py);
    let reals: [(&str, Of); 9] = [
        ("apparent_ra_deg", |row| row.apparent_deg[0]),
        ("apparent_dec_deg", |row| row.apparent_deg[1]),
        ("catalog_ra_deg", |row| row.catalog_deg[0]),
        ("catalog_dec_deg", |row| row.catalog_deg[1]),
        ("x_px", |row| row.x_px),
        ("y_px", |row| row.y_px),
        ("electrons", |row| row.electrons),
        ("smear_px", |row| row.smear_px),
        ("smear_deg", |row| row.smear_deg),
    ];
    table.set_item("id", rows.iter().map(|row| row.id).collect::<Vec<_>>().into_pyarray(py))?;
    table.set_item("mag_g", rows.iter().map(|row| row.mag).collect::<Vec<_>>().into_pyarray(py))?;
    for (name, of) in reals {
        table.set_item(name, rows.iter().map(of).collect::<Vec<_>>().into_pyarray(py))?;
    }
    let is_star = rows.iter().map(|row| row.kind == TruthKind::Star).collect::<Vec<_>>();
    table.set_item("is_star", is_star.into_pyarray(py))?;
    let names: Vec<String> =
        rows.iter().map(|row| row.source_id.map_or_else(String::new, |id| id.to_string())).collect();
    table.set_item("source_id", names)?;
    let kinds: Vec<&str> = rows.iter().map(|row| row.kind.name()).collect();
    table.set_item("kind", kinds)?;
    Ok(table)
}
