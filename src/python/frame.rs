//! `Frame`: pixels, truth and facts of one image.

use crate::columns::columns;
use frames::sink::facts::{FactSource, json_keys};
use frames::sink::fits::{Header, card::Card, keywords::push_meta};
use frames::sink::{FrameMeta, SentFrame, TruthStar};
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
