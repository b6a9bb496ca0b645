//! What is known now: the newest picture, the newest numbers, and the frames that were encoded last.
//!
//! One owner, the view's thread. An encoding is kept and answers all who ask for the same; the next one waits until three
//! times its duration have passed, so that drawing keeps the cores whatever clients ask for. The stars of the frames that
//! were encoded last are kept with them: what a browser draws over a picture belongs to that picture.

use crate::live::Params;
use crate::live::latest::{Picture, Reader};
use crate::live::numbers::Told;
use crate::live::picture::{Scale, png_of};
use crate::live::truth::truth_of;
use base::clock::Clock;
use base::time::{Span, Tai};
use crossbeam_channel::Receiver;
use frames::report::RunNumbers;
use hyper::body::Bytes;
use std::collections::VecDeque;
use std::sync::Arc;

/// Frames whose stars are kept.
const TRUTHS_KEPT: usize = 16;
/// Rest after an encoding, in durations of it.
const REST: i64 = 3;

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

/// Why there is no picture now.
#[derive(Debug)]
pub(super) enum NoPicture {
    /// No frame has come yet.
    NoFrame,
    /// The encoder rests; to be asked again after this.
    NotYet(Span),
    /// It cannot be encoded.
    Broken(std::io::Error),
}

/// What became of requests and clients.
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
    pub(super) numbers: Box<RunNumbers>,
    pub(super) has_numbers: bool,
    /// The numbers are the totals of a run that is over.
    has_totals: bool,
    /// When somebody asked last.
    pub(super) asked: Option<Tai>,
    pub(super) served: Served,
    told: Receiver<Told>,
    reader: Reader,
    encoded: Option<Encoded>,
    rested: Tai,
    truths: VecDeque<(u32, Bytes)>,
}

impl Board {
    pub(super) fn new(params: Params, clock: Arc<dyn Clock>, reader: Reader, told: Receiver<Told>) -> Self {
        let rested = clock.now();
        let (served, truths) = (Served::default(), VecDeque::with_capacity(TRUTHS_KEPT));
        let numbers = Box::new(RunNumbers::NONE);
        Self {
            params,
            clock,
            numbers,
            has_numbers: false,
            has_totals: false,
            asked: None,
            served,
            told,
            reader,
            encoded: None,
            rested,
            truths,
        }
    }

    /// Takes in the numbers that have come.
    pub(super) fn listen(&mut self) {
        if let Some(Told { numbers, are_last }) = self.told.try_iter().last() {
            *self.numbers = numbers;
            (self.has_numbers, self.has_totals) = (true, are_last);
        }
    }

    /// The newest picture; `None` before the first frame.
    pub(super) fn newest(&mut self) -> Option<&Picture> {
        Some(self.reader.newest()).filter(|picture| picture.count > 0)
    }

    /// True when no frame comes any more, and the numbers are the run's totals where it has any.
    pub(super) fn is_over(&self) -> bool {
        self.reader.is_over() && (self.has_totals || !self.has_numbers)
    }

    /// The newest picture as a PNG.
    pub(super) fn encode(&mut self, scale: Scale) -> Result<Encoded, NoPicture> {
        let picture = Some(self.reader.newest()).filter(|picture| picture.count > 0).ok_or(NoPicture::NoFrame)?;
        let is_known = |encoded: &&Encoded| encoded.count == picture.count && encoded.scale == scale;
        if let Some(known) = self.encoded.as_ref().filter(is_known) {
            return Ok(known.clone());
        }
        let began = self.clock.now();
        if began < self.rested {
            return Err(NoPicture::NotYet(self.rested - began));
        }
        let png = png_of(&picture.frame.image, scale).map_err(NoPicture::Broken)?.into();
        let number = picture.frame.meta.number;
        if self.truths.back().is_none_or(|(newest, _)| *newest != number) {
            if self.truths.len() == TRUTHS_KEPT {
                self.truths.pop_front();
            }
            self.truths.push_back((number, truth_of(&picture.frame).to_string().into()));
        }
        let encoded = Encoded { number, png, count: picture.count, scale };
        self.encoded = Some(encoded.clone());
        let now = self.clock.now();
        self.rested = now + Span::from_ns((now - began).ns().saturating_mul(REST));
        Ok(encoded)
    }

    /// The stars of a frame that was encoded not long ago, as JSON.
    pub(super) fn truth(&self, number: u32) -> Option<Bytes> {
        self.truths.iter().rev().find(|(kept, _)| *kept == number).map(|(_, json)| json.clone())
    }
}
