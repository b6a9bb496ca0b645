//! Bytes of a double precision array file -> its segments: summaries of numbers, and arrays of words.
//!
//! Records of 1024 bytes. The first has the sizes of a summary and the first summary record; summary records are a
//! list. All addresses and counts are checked against the file's length before use.

use crate::error::{HistoryError, Source};

const RECORD: usize = 1024;
const WORD: usize = 8;
/// Most segments of a file that is taken.
const SEGMENTS_MAX: usize = 100_000;

/// A file.
pub(super) struct Daf<'a> {
    bytes: &'a [u8],
    is_little: bool,
    pub(super) segments: Vec<Summary>,
}

/// Summary of one segment: two doubles, six integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Summary {
    pub(super) doubles: [f64; 2],
    pub(super) integers: [i32; 6],
}

impl<'a> Daf<'a> {
    /// Reads the summaries of a file of this kind.
    pub(super) fn read(bytes: &'a [u8], kind: &str, source: &Source<'_>) -> Result<Self, HistoryError> {
        let refuse = |why: &str| source.whole(why.to_owned());
        if bytes.starts_with(b"DAFETF") {
            return Err(refuse("a transfer file; wanted a binary kernel: convert it by NAIF's tobin"));
        }
        let name = bytes.get(..8).unwrap_or_default();
        if String::from_utf8_lossy(name).trim_end() != kind {
            let got = String::from_utf8_lossy(name).escape_debug().to_string();
            return Err(source.whole(format!("it begins with \"{got}\"; wanted a binary kernel, \"{kind}\"")));
        }
        let is_little = match bytes.get(88..96) {
            Some(b"LTL-IEEE") => true,
            Some(b"BIG-IEEE") => false,
            _ => return Err(refuse("no byte order LTL-IEEE or BIG-IEEE; wanted a kernel of toolkit N0050 or newer")),
        };
        let mut daf = Self { bytes, is_little, segments: Vec::new() };
        let sizes = [8, 12].map(|offset| daf.integer(offset));
        if sizes != [Some(2), Some(6)] {
            return Err(refuse("summaries of other sizes than 2 doubles and 6 integers; wanted those of CK and SPK"));
        }
        daf.read_summaries(source)?;
        Ok(daf)
    }

    fn read_summaries(&mut self, source: &Source<'_>) -> Result<(), HistoryError> {
        const SUMMARY_WORDS: usize = 5;
        let broken = || source.whole("its list of segments is broken; wanted a whole file: copy it again, in binary");
        let mut record = self.integer(76).and_then(|record| usize::try_from(record).ok()).ok_or_else(broken)?;
        let mut left = self.bytes.len() / RECORD;
        while record != 0 {
            left = left.checked_sub(1).ok_or_else(broken)?;
            let first = (record - 1).checked_mul(RECORD / WORD).ok_or_else(broken)?;
            let word = |place: usize| self.word(first + place).filter(|value| (0.0..1e9).contains(value));
            let (Some(next), Some(count)) = (word(0), word(2)) else { return Err(broken()) };
            let [next, count] = [next, count].map(whole);
            if count > (RECORD / WORD - 3) / SUMMARY_WORDS || self.segments.len() + count > SEGMENTS_MAX {
                return Err(broken());
            }
            for number in 0..count {
                let at = first + 3 + number * SUMMARY_WORDS;
                self.segments.push(self.summary(at).ok_or_else(broken)?);
            }
            record = next;
        }
        if self.segments.is_empty() { Err(source.whole("it has no segment; wanted one at least")) } else { Ok(()) }
    }

    fn summary(&self, at: usize) -> Option<Summary> {
        let doubles = [self.word(at)?, self.word(at + 1)?];
        let mut integers = [0; 6];
        for (place, integer) in integers.iter_mut().enumerate() {
            *integer = self.integer((at + 2) * WORD + 4 * place)?;
        }
        Some(Summary { doubles, integers })
    }

    /// Returns the words of a segment.
    pub(super) fn words(&self, summary: &Summary, source: &Source<'_>) -> Result<Vec<f64>, HistoryError> {
        let [.., begin, end] = summary.integers;
        let range = usize::try_from(begin).ok().zip(usize::try_from(end).ok()).filter(|(begin, end)| {
            *begin > 0 && begin <= end && end.checked_mul(WORD).is_some_and(|bytes| bytes <= self.bytes.len())
        });
        let Some((begin, end)) = range else {
            let why =
                format!("a segment has words {begin} to {end}; wanted them inside the file: copy it again, in binary");
            return Err(source.whole(why));
        };
        Ok((begin - 1..end).filter_map(|place| self.word(place)).collect())
    }

    fn word(&self, place: usize) -> Option<f64> {
        let at = place.checked_mul(WORD)?;
        let bytes: [u8; WORD] = self.bytes.get(at..at.checked_add(WORD)?)?.try_into().ok()?;
        Some(if self.is_little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    }

    fn integer(&self, at: usize) -> Option<i32> {
        let bytes: [u8; 4] = self.bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        Some(if self.is_little { i32::from_le_bytes(bytes) } else { i32::from_be_bytes(bytes) })
    }
}

/// Returns the refusal of a segment whose counts do not fit its length.
pub(super) fn uncountable(source: &Source<'_>) -> HistoryError {
    source.whole("the counts of a segment do not fit its length; wanted a whole file: copy it again, in binary")
}

/// Returns a count that a kernel keeps as a double; any other number becomes too large for any segment.
pub(super) fn whole(value: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked in the condition")]
    if (0.0..1e15).contains(&value) { value as usize } else { usize::MAX }
}
