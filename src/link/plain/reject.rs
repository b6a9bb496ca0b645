//! Why a plain message is refused, and how often.

use core::fmt;

base::words! {
    /// Why a plain message is refused.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
    #[error("{}", self.name())]
    pub enum PlainReject {
        /// The number of bytes, or of numbers, is not that of the layout.
        Length = "plain_wrong_length",
        /// The bytes are not UTF-8 text.
        Text = "plain_not_text",
        /// The text is not a JSON object or array.
        Json = "plain_not_json",
        /// A word or a field is not a number.
        Number = "plain_not_a_number",
        /// A field of the layout is missing.
        FieldMissing = "plain_field_missing",
        /// A value is NaN or infinite.
        NotFinite = "plain_not_finite",
        /// The quaternion's norm is further than 1e-3 from 1: the byte order, the type or the order of fields is another.
        QuaternionNorm = "plain_quaternion_norm",
        /// The time is further from its epoch than 292 years.
        Time = "plain_time_out_of_range",
        /// A message of this number was received already.
        Repeated = "plain_repeated",
        /// A message of 42 ended before its time, attitude and rate were complete.
        Incomplete = "plain_incomplete",
        /// A line is none of those that the simulator 42 sends.
        Unread = "plain_unread_line",
    }
}

/// Number of refused messages by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PlainRejectCounters {
    counts: [u32; PlainReject::ALL.len()],
}

impl PlainRejectCounters {
    pub(super) fn count(&mut self, reject: PlainReject) {
        let count = &mut self.counts[reject as usize];
        *count = count.saturating_add(1);
    }

    /// Returns how often this was the reason.
    pub fn get(&self, reject: PlainReject) -> u32 {
        self.counts[reject as usize]
    }

    /// Returns all refusals together.
    pub fn total(&self) -> u64 {
        self.counts.iter().map(|count| u64::from(*count)).sum()
    }

    /// Returns each reason with its count.
    pub fn iter(&self) -> impl Iterator<Item = (PlainReject, u32)> + '_ {
        PlainReject::ALL.into_iter().zip(self.counts)
    }
}

/// The beginning of a refused message, with the reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RefusedMessage {
    /// Why it was refused.
    pub reason: PlainReject,
    bytes: [u8; SHOWN_BYTES],
    length: usize,
}

/// Bytes of a refused message that are shown.
const SHOWN_BYTES: usize = 60;

impl RefusedMessage {
    pub(super) fn new(reason: PlainReject, message: &[u8]) -> Self {
        let (mut bytes, length) = ([0; SHOWN_BYTES], message.len().min(SHOWN_BYTES));
        bytes[..length].copy_from_slice(&message[..length]);
        Self { reason, bytes, length }
    }
}

impl fmt::Display for RefusedMessage {
    /// Writes the text, with a point for each byte that is not printable ASCII, and the reason.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = |byte: &u8| if (b' '..=b'~').contains(byte) { char::from(*byte) } else { '.' };
        let text: String = self.bytes[..self.length].iter().map(shown).collect();
        write!(f, "\"{text}\" ({})", self.reason)
    }
}
