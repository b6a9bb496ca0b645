//! Why input was refused, and how often; why a message cannot be put on the wire.

use core::fmt;

macro_rules! rejects {
    ($($(#[doc = $text:literal])+ $name:ident = $code:literal,)+) => {
        /// One reason to refuse input. The number is the reason's code in STATUS.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum Reject { $($(#[doc = $text])+ $name = $code,)+ }

        impl Reject {
            /// Every reason, in the order of the codes.
            pub const ALL: [Self; REASONS] = [$(Self::$name,)+];

            /// Returns its name in reports.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name),)+ }
            }

            fn text(self) -> &'static str {
                match self { $(Self::$name => concat!($($text),+).trim_ascii(),)+ }
            }
        }

        const REASONS: usize = [$($code,)+].len();
    };
}

rejects! {
    /// a value is NaN or infinite
    NotFinite = 0,
    /// the quaternion's norm is further than 1e-3 from 1
    QuaternionNorm = 1,
    /// the CRC-16 does not match the bytes
    BadCrc = 2,
    /// the length is not the one this message has
    WrongLength = 3,
    /// a classic attitude group is incomplete or mixes epochs
    TornGroup = 4,
    /// no message of this version has this identifier, or it is for another node
    UnknownId = 5,
    /// an enumeration, page or count has a value this version does not know
    UnknownValue = 6,
    /// the sender speaks another major version
    WrongVersion = 7,
    /// the sequence number was received already
    ReplayedSequence = 8,
    /// the time tag is older than the history keeps
    StaleTime = 9,
    /// the time tag lies in the future
    FutureTime = 10,
    /// the bytes between two delimiters are not COBS
    BadFraming = 11,
    /// no delimiter came within the longest packet
    Oversize = 12,
}

impl Reject {
    /// Returns the reason of a STATUS code.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// Returns the code in STATUS.
    pub const fn code(self) -> u8 {
        self as u8
    }
}

impl fmt::Display for Reject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text())
    }
}

impl core::error::Error for Reject {}

/// How often each reason occurred (saturating).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RejectCounters {
    counts: [u32; REASONS],
}

impl RejectCounters {
    /// Counts one occurrence.
    pub fn count(&mut self, reason: Reject) {
        if let Some(count) = self.counts.get_mut(usize::from(reason.code())) {
            *count = count.saturating_add(1);
        }
    }

    /// Occurrences of one reason.
    pub fn get(&self, reason: Reject) -> u32 {
        self.counts.get(usize::from(reason.code())).copied().unwrap_or(0)
    }

    /// Occurrences of all reasons.
    pub fn total(&self) -> u32 {
        self.counts.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }

    /// Returns each reason with its count.
    pub fn iter(&self) -> impl Iterator<Item = (Reject, u32)> + '_ {
        Reject::ALL.into_iter().zip(self.counts)
    }
}

/// A message that its wire format cannot carry. Nothing is clipped in silence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EncodeError {
    /// A value is outside the range of its field, or not a number.
    OutOfRange {
        /// Message and field.
        field: &'static str,
        /// The value.
        got: f64,
        /// Largest magnitude that fits.
        limit: f64,
    },
    /// The wire format has no form for this message.
    NotCarried {
        /// The message.
        message: &'static str,
        /// The wire format.
        format: &'static str,
        /// The message to send instead.
        instead: &'static str,
    },
    /// The caller's buffer is shorter than one packet may be.
    BufferTooShort {
        /// Bytes a packet may need.
        wanted: usize,
        /// Bytes there are.
        got: usize,
    },
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { field, got, limit } => {
                write!(f, "{field}: wanted a magnitude of at most {limit}, got {got}")
            }
            Self::NotCarried { message, format, instead } => {
                write!(f, "{format} does not carry {message}; send {instead}")
            }
            Self::BufferTooShort { wanted, got } => {
                write!(f, "serial packet buffer: wanted {wanted} bytes, got {got}")
            }
        }
    }
}

impl core::error::Error for EncodeError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_positions_and_each_reason_has_its_own_counter() {
        let mut counters = RejectCounters::default();
        for (i, reason) in Reject::ALL.into_iter().enumerate() {
            assert_eq!(usize::from(reason.code()), i, "{reason}");
            assert_eq!(Reject::from_code(reason.code()), Some(reason));
            counters.count(reason);
            counters.count(Reject::BadCrc);
        }
        assert_eq!(Reject::from_code(13), None);
        assert_eq!(counters.get(Reject::Oversize), 1);
        assert_eq!(counters.get(Reject::BadCrc), 14);
        assert_eq!(counters.total(), 26);
    }
}
