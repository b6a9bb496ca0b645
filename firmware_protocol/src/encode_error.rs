//! Why a message cannot be put on the wire.

use core::fmt;

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
