//! socketcand: CAN frames over TCP as text in angle brackets; raw mode.

mod parser;
mod session;

pub use parser::{BusName, Command, ELEMENT_MAX, NAME_MAX, Parser, SocketcandReject};
pub(super) use session::{Session, element, tai_minus_utc_s};
