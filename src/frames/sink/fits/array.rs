//! An image as it was read from a FITS file: pixels, header, order of rows; and the refusals of its readers.

use super::card::{Header, Value};
use super::{Pixels, image::BZERO_U16};
use crate::sink::SinkError;

/// Values of `ROWORDER`.
const ROW_ORDERS: [&str; 2] = ["TOP-DOWN", "BOTTOM-UP"];

/// An image as read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct FitsImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The pixels, in the order of the file.
    pub pixels: OwnedPixels,
    /// Every card but `END`.
    pub header: Header,
}

/// Pixels of an image that was read, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum OwnedPixels {
    /// Unsigned 16-bit.
    U16(Vec<u16>),
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
}

impl OwnedPixels {
    /// Returns the same pixels, borrowed.
    pub fn as_pixels(&self) -> Pixels<'_> {
        match self {
            Self::U16(p) => Pixels::U16(p),
            Self::F32(p) => Pixels::F32(p),
            Self::F64(p) => Pixels::F64(p),
        }
    }
}

impl FitsImage {
    /// Returns whether the file states which row is the top one (`ROWORDER`, a keyword of amateur astronomy's programs
    /// and of this one); by FITS's own convention the first row is drawn at the bottom, but cameras write it either way.
    pub fn states_row_order(&self) -> bool {
        self.header
            .text("ROWORDER")
            .is_some_and(|order| ROW_ORDERS.iter().any(|one| order.trim().eq_ignore_ascii_case(one)))
    }

    /// Returns the pixels as numbers, the top row first: that is the first one of the file, unless it says
    /// `ROWORDER = 'BOTTOM-UP'`.
    pub fn top_row_first(&self) -> Vec<f64> {
        let pixels: Vec<f64> = match &self.pixels {
            OwnedPixels::U16(pixels) => pixels.iter().map(|value| f64::from(*value)).collect(),
            OwnedPixels::F32(pixels) => pixels.iter().map(|value| f64::from(*value)).collect(),
            OwnedPixels::F64(pixels) => pixels.clone(),
        };
        if self.header.text("ROWORDER").is_some_and(|order| order.trim().eq_ignore_ascii_case(ROW_ORDERS[1])) {
            return pixels.rchunks_exact(self.width.max(1)).flatten().copied().collect();
        }
        pixels
    }
}

/// Factor and offset of stored numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    factor: f64,
    offset: f64,
}

impl Scale {
    pub(super) fn of(header: &Header) -> Self {
        Self { factor: header.real("BSCALE").unwrap_or(1.0), offset: header.real("BZERO").unwrap_or(0.0) }
    }

    #[allow(clippy::float_cmp, reason = "numbers of the header, not of a computation")]
    pub(super) fn is_unsigned_16(self) -> bool {
        self.factor == 1.0 && self.offset == f64::from(BZERO_U16)
    }

    #[allow(clippy::float_cmp, reason = "numbers of the header, not of a computation")]
    pub(super) fn is_one(self) -> bool {
        self.factor == 1.0 && self.offset == 0.0
    }

    /// Returns stored integers as pixels.
    pub(super) fn integers(self, stored: Vec<i32>) -> OwnedPixels {
        OwnedPixels::F64(stored.into_iter().map(|value| self.offset + self.factor * f64::from(value)).collect())
    }

    pub(super) fn reals(self, stored: Vec<f64>) -> OwnedPixels {
        if self.is_one() {
            return OwnedPixels::F64(stored);
        }
        OwnedPixels::F64(stored.into_iter().map(|value| self.offset + self.factor * value).collect())
    }
}

pub(super) fn bad(keyword: &'static str, wanted: &'static str, header: &Header) -> SinkError {
    SinkError::BadFits {
        what: keyword,
        wanted,
        got: header.get(keyword).map_or_else(|| "no such card".into(), value_text),
    }
}

pub(super) fn ended(what: &'static str, source: &std::io::Error) -> SinkError {
    SinkError::DamagedFits { what, wanted: "more bytes", got: end_or(source) }
}

/// Returns a card's value as the file has it.
fn value_text(value: Value<'_>) -> String {
    match value {
        Value::Undefined => "no value".into(),
        Value::Logical(flag) => if flag { "T" } else { "F" }.into(),
        Value::Integer(number) => number.to_string(),
        Value::Real(number) => number.to_string(),
        Value::Text(text) => format!("'{text}'"),
    }
}

/// Returns what was found where bytes were wanted.
fn end_or(source: &std::io::Error) -> String {
    if source.kind() == std::io::ErrorKind::UnexpectedEof { "the end of the file".into() } else { source.to_string() }
}

pub(super) fn axis(header: &Header, keyword: &'static str) -> Result<usize, SinkError> {
    let length = header.integer(keyword).and_then(|n| usize::try_from(n).ok());
    length.ok_or_else(|| bad(keyword, "a length in pixels", header))
}
