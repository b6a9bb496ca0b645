//! Records or lines over TCP: the connection of an outside simulator <-> `Link`.
//!
//! * Server: listens, and takes one client at a time; another one is refused and counted. A client that has sent no
//!   message gives way to another one (`seat`). Client: connects, also again after the connection is lost, every
//!   [`RETRY`]; tries that fail are counted. A connection that ends after a message counts as lost, the next one as
//!   regained.
//! * Where the reader knows messages ([`TcpLink::with_reader`]), a connection that brings [`REFUSED_MAX`] others in a row is
//!   hung up on: after a stray byte all records would be cut wrongly for good.
//! * A stream has no borders: [`Framing`] finds them again, in bounded memory. Lines longer than [`crate::DATAGRAM_MAX`] are
//!   refused and counted. The rest of a message whose connection ended is forgotten.
//! * Stamps are the instant of reading: the kernel gives none for a stream.
//! * Where wanted ([`TcpParams::acknowledges`]), the answer of a receiver of 42 goes out after each `[ENDMSG]`.
//!
//! Nothing is read from a client that has not been taken. Tests: `tests` here, `tests/links/plain.rs`.

mod framing;
mod link;
mod seat;
mod stream;
#[cfg(test)]
mod tests;

use base::time::Span;
use std::net::SocketAddr;

pub use framing::Framing;
pub use link::{IsMessage, TcpLink};
pub use seat::{Seat, SeatChange};
pub use stream::keep_alive;

/// A lost connection is tried again this often.
pub const RETRY: Span = Span::from_ms(200);

/// Records or lines in a row that hold no message, after which a connection is hung up on.
pub const REFUSED_MAX: u32 = 32;

/// Side that connects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TcpRole {
    /// The other end, to this address.
    Server(SocketAddr),
    /// This end, to that address.
    Client(SocketAddr),
}

/// Parameters of the connection and of the messages on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpParams {
    /// Side that connects.
    pub role: TcpRole,
    /// Rule for the end of messages.
    pub framing: Framing,
    /// Answers each message of 42.
    pub acknowledges: bool,
}
