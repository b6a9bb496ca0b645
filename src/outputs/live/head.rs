//! One camera head on the board: its newest picture, its newest encodings, and the frames that were encoded last.
//!
//! One owner, the view's thread. What a browser draws over a picture belongs to that picture, so the last encoded
//! frames are kept with their stars. Tests: `http_tests`, with three heads.

use crate::live::latest::{Picture, Reader};
use crate::live::picture::{Scale, png_of};
use crate::live::{HeadParams, kept::Kept};
use hyper::body::Bytes;

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
    /// The encoding of a frame that is not the newest.
    looked_back: Option<Encoded>,
    pub(super) kept: Kept,
}

impl Head {
    /// Returns a head without a picture, one of `heads`.
    pub(super) fn new(params: HeadParams, reader: Reader, heads: usize) -> Self {
        let kept = Kept::of(params.size_px, heads);
        Self { params, reader, encoded: None, looked_back: None, kept }
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
        self.kept.keep(picture);
        let encoded = Encoded { number, png, count: picture.count, scale };
        self.encoded = Some(encoded.clone());
        Ok(Some(encoded))
    }

    /// Returns the encoding of a kept frame if it is known already.
    pub(super) fn known_kept(&self, number: u32, scale: Scale) -> Option<Encoded> {
        self.looked_back.as_ref().filter(|encoded| encoded.number == number && encoded.scale == scale).cloned()
    }

    /// Encodes a kept frame as a PNG; `None` when it is not kept.
    ///
    /// # Errors
    /// When the image has no pixels.
    pub(super) fn encode_kept(&mut self, number: u32, scale: Scale) -> std::io::Result<Option<Encoded>> {
        let Some(kept) = self.kept.get(number) else { return Ok(None) };
        let encoded = Encoded { number, png: png_of(&kept.image, scale)?.into(), count: 0, scale };
        self.looked_back = Some(encoded.clone());
        Ok(Some(encoded))
    }

    /// Returns stars and facts of a frame that was encoded not long ago, as JSON.
    pub(super) fn truth(&self, number: u32) -> Option<Bytes> {
        self.kept.get(number).map(|kept| kept.truth.clone())
    }
}
