//! The inputs of every check of the suite.

use crate::{Link, LinkError, WireFormat};
use base::{clock::Clock, time::Span};
use std::sync::Arc;

/// Two connected ends.
pub type Ends = (Box<dyn Link>, Box<dyn Link>);

/// A packet that has not arrived after this long is lost.
pub(super) const PATIENCE: Span = Span::from_ms(3000);

/// The inputs of every check.
pub(super) struct Suite<'a> {
    pub(super) format: WireFormat,
    /// Lengths of packets that the link carries, shortest first.
    pub(super) lengths: Vec<usize>,
    pub(super) clock: &'a Arc<dyn Clock>,
    pub(super) make: &'a mut dyn FnMut() -> Result<Ends, LinkError>,
}

impl Suite<'_> {
    /// Returns a length of some eight bytes, or the nearest that the link carries.
    pub(super) fn usual_length(&self) -> usize {
        self.lengths.iter().copied().min_by_key(|length| length.abs_diff(8)).unwrap_or(8)
    }

    pub(super) fn longest(&self) -> usize {
        self.lengths.last().copied().unwrap_or(0)
    }

    pub(super) fn pair(&mut self) -> Result<Ends, String> {
        (self.make)().map_err(|error| error.to_string())
    }
}
