//! One camera head on the board: its newest picture, its newest encodings, and the frames that were encoded last.
//!
//! One owner, the view's thread. What a browser draws over a picture belongs to that picture, so the last encoded
//! frames are kept with their stars. Tests: `http_tests`, with three heads.

use crate::live::kept::{Kept, Picture, Reader};
use crate::live::numbers::Reported;
use crate::live::picture::{Scale, png_of};
use crate::live::{HeadParams, Params};
use base::clock::Clock;
use base::time::{Span, Tai};
use crossbeam_channel::Receiver;
use frames::report::RunNumbers;
use hyper::body::Bytes;
use std::sync::Arc;

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

// The present state of a run: each head's newest picture, the newest numbers, and counts of requests.
//
// One owner, the view's thread. An encoding is kept and answers all requests for the same; the next one, of any head,
// waits until three times its duration have passed, so that drawing keeps the cores however often clients ask.

/// Rest after an encoding, in durations of it.
const REST: i64 = 3;

/// Reason why no picture is available.
#[derive(Debug)]
pub(super) enum NoPicture {
    /// The head does not exist.
    NoHead,
    /// No frame has come yet.
    NoFrame,
    /// The frame asked for is not kept.
    NotKept(u32),
    /// The encoder rests; to be asked again after this.
    NotYet(Span),
    /// The picture cannot be encoded.
    Broken(std::io::Error),
}

/// Outcomes of requests and clients.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Served {
    /// Requests answered.
    pub(super) requests: u64,
    /// Requests refused (status 400 and above).
    pub(super) refused: u64,
    /// Clients that found no seat.
    pub(super) clients_refused: u64,
    /// Connections that ended in an error: garbage, silence, a reader that does not read.
    pub(super) clients_failed: u64,
}

/// Everything that answers are made of.
pub(super) struct Board {
    pub(super) params: Params,
    pub(super) clock: Arc<dyn Clock>,
    /// As many as `params` lists.
    pub(super) heads: Vec<Head>,
    pub(super) numbers: Box<RunNumbers>,
    pub(super) has_numbers: bool,
    /// The numbers are the totals of a run that is over.
    has_totals: bool,
    /// Time of the last request.
    pub(super) asked: Option<Tai>,
    pub(super) served: Served,
    reported: Receiver<Reported>,
    rested: Tai,
}

impl Board {
    pub(super) fn new(params: Params, clock: Arc<dyn Clock>, heads: Vec<Head>, reported: Receiver<Reported>) -> Self {
        let rested = clock.now();
        let (served, numbers) = (Served::default(), Box::new(RunNumbers::NONE));
        let (has_numbers, has_totals) = (false, false);
        Self { params, clock, heads, numbers, has_numbers, has_totals, asked: None, served, reported, rested }
    }

    /// Takes in the numbers that have come.
    pub(super) fn listen(&mut self) {
        if let Some(Reported { numbers, are_last }) = self.reported.try_iter().last() {
            *self.numbers = numbers;
            (self.has_numbers, self.has_totals) = (true, are_last);
        }
    }

    /// Returns true when no frame of any head comes any more, and the numbers are the run's totals where it has any.
    pub(super) fn is_over(&self) -> bool {
        self.heads.iter().all(Head::is_over) && (self.has_totals || !self.has_numbers)
    }

    /// Returns a picture of a head as a PNG: of a kept frame, or of the newest one where none is named.
    pub(super) fn encode(&mut self, head: usize, frame: Option<u32>, scale: Scale) -> Result<Encoded, NoPicture> {
        let head = self.heads.get_mut(head).ok_or(NoPicture::NoHead)?;
        let known = match frame {
            Some(number) => head.known_kept(number, scale),
            None => head.known(scale),
        };
        if let Some(known) = known {
            return Ok(known);
        }
        let began = self.clock.now();
        if head.newest().is_some() && began < self.rested {
            return Err(NoPicture::NotYet(self.rested - began));
        }
        let encoded = match frame {
            Some(number) => {
                head.encode_kept(number, scale).map_err(NoPicture::Broken)?.ok_or(NoPicture::NotKept(number))?
            }
            None => head.encode(scale).map_err(NoPicture::Broken)?.ok_or(NoPicture::NoFrame)?,
        };
        let now = self.clock.now();
        self.rested = now + Span::from_ns((now - began).ns().saturating_mul(REST));
        Ok(encoded)
    }
}
