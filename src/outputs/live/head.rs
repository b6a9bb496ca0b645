//! One camera head on the board: its newest picture, its newest encoding, and the stars of frames that were encoded
//! last.
//!
//! One owner, the view's thread. What a browser draws over a picture belongs to that picture, so the stars of the last
//! `TRUTHS_KEPT` encoded frames are kept. Tests: `http_tests`, with three heads.

use crate::live::HeadParams;
use crate::live::latest::{Picture, Reader};
use crate::live::picture::{Scale, png_of};
use crate::live::truth::truth_of;
use hyper::body::Bytes;
use std::collections::VecDeque;

/// Frames whose stars are kept.
const TRUTHS_KEPT: usize = 16;

/// A picture as it goes out.
#[derive(Debug, Clone)]
pub(super) struct Encoded {
    /// Frame number.
    pub(super) number: u32,
    /// PNG.
    pub(super) png: Bytes,
    count: u64,
    scale: Scale,
}

/// A head, and the data of its frames.
pub(super) struct Head {
    pub(super) params: HeadParams,
    reader: Reader,
    encoded: Option<Encoded>,
    truths: VecDeque<(u32, Bytes)>,
}

impl Head {
    pub(super) fn new(params: HeadParams, reader: Reader) -> Self {
        Self { params, reader, encoded: None, truths: VecDeque::with_capacity(TRUTHS_KEPT) }
    }

    /// Returns the newest picture; `None` before the first frame.
    pub(super) fn newest(&mut self) -> Option<&Picture> {
        Some(self.reader.newest()).filter(|picture| picture.count > 0)
    }

    /// Returns true when no frame of this head comes any more.
    pub(super) fn is_over(&self) -> bool {
        self.reader.is_over()
    }

    /// Returns the encoding of the newest picture if it is known already.
    pub(super) fn known(&mut self, scale: Scale) -> Option<Encoded> {
        let count = self.newest()?.count;
        self.encoded.as_ref().filter(|encoded| encoded.count == count && encoded.scale == scale).cloned()
    }

    /// Encodes the newest picture as a PNG and keeps it with its stars; `None` before the first frame.
    ///
    /// # Errors
    /// When the image has no pixels.
    pub(super) fn encode(&mut self, scale: Scale) -> std::io::Result<Option<Encoded>> {
        let Some(picture) = Some(self.reader.newest()).filter(|picture| picture.count > 0) else { return Ok(None) };
        let png = png_of(&picture.frame.image, scale)?.into();
        let number = picture.frame.meta.number;
        if self.truths.back().is_none_or(|(newest, _)| *newest != number) {
            if self.truths.len() == TRUTHS_KEPT {
                self.truths.pop_front();
            }
            self.truths.push_back((number, truth_of(&picture.frame).to_string().into()));
        }
        let encoded = Encoded { number, png, count: picture.count, scale };
        self.encoded = Some(encoded.clone());
        Ok(Some(encoded))
    }

    /// Returns the stars of a frame that was encoded not long ago, as JSON.
    pub(super) fn truth(&self, number: u32) -> Option<Bytes> {
        self.truths.iter().rev().find(|(kept, _)| *kept == number).map(|(_, json)| json.clone())
    }
}
