//! `Frame`: pixels, truth (column by column) and facts of one image.

use frames::sink::facts::{FactSource, json_keys};
use frames::sink::fits::{Header, card::Card, keywords::push_meta};
use frames::sink::{FrameMeta, SentFrame, TruthKind, TruthStar};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::{prelude::*, types::PyDict};
use serde_json::Value;

/// Pixels of an image, row by row from the top, by how far it was drawn.
pub(crate) enum Pixels {
    /// Digital numbers.
    Dn(Vec<u16>),
    /// Mean electrons.
    Electrons(Vec<f32>),
    /// Mean electrons of the reference.
    Precise(Vec<f64>),
}

/// An image as it was drawn, before Python has it.
pub(crate) struct Drawn {
    pixels: Pixels,
    /// Rows and columns.
    shape: [usize; 2],
    meta: FrameMeta,
    truth: Vec<TruthStar>,
}

impl Drawn {
    /// Returns pixels of this shape with the facts of their frame.
    pub(crate) fn new(pixels: Pixels, shape: [usize; 2], frame: &SentFrame) -> Self {
        Self { pixels, shape, meta: frame.meta.clone(), truth: frame.truth.clone() }
    }

    /// Returns the digital numbers of a frame with its facts.
    pub(crate) fn of(frame: &SentFrame) -> Self {
        let shape = [frame.image.height(), frame.image.width()];
        Self::new(Pixels::Dn(frame.image.pixels().to_vec()), shape, frame)
    }
}

/// One image with its truth and its facts.
#[pyclass(frozen)]
pub(crate) struct Frame {
    /// Array of rows and columns: digital numbers (u16), or electrons (f32, f64 from the reference).
    #[pyo3(get)]
    pixels: Py<PyAny>,
    meta: FrameMeta,
    truth: Vec<TruthStar>,
}

impl Frame {
    /// Returns the Python form of an image; no pixel is copied.
    pub(crate) fn new(py: Python<'_>, drawn: Drawn) -> PyResult<Self> {
        let Drawn { pixels, shape, meta, truth } = drawn;
        let pixels = match pixels {
            Pixels::Dn(dn) => dn.into_pyarray(py).reshape(shape)?.into_any().unbind(),
            Pixels::Electrons(electrons) => electrons.into_pyarray(py).reshape(shape)?.into_any().unbind(),
            Pixels::Precise(electrons) => electrons.into_pyarray(py).reshape(shape)?.into_any().unbind(),
        };
        Ok(Self { pixels, meta, truth })
    }
}

#[pymethods]
impl Frame {
    /// Returns the truth table as a dict of columns of one length.
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, &self.truth)
    }

    /// Returns the facts of the frame as JSON, with the keys of the control socket.
    fn meta(&self) -> String {
        let source = FactSource::of_meta(&self.meta);
        let mut facts = json_keys(&source, |row| row.control);
        facts.extend(json_keys(&source, |row| row.control_meta));
        facts.retain(|_, fact| !fact.is_null());
        Value::Object(facts).to_string()
    }

    /// Returns the cards of its FITS header, 80 characters each, in one text.
    fn header(&self) -> String {
        let mut header = Header::default();
        push_meta(&mut header, &self.meta);
        header.cards().iter().flat_map(|card: &Card| card.iter().map(|byte| char::from(*byte))).collect()
    }
}

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
