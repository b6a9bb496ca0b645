//! slcan: the serial line protocol of CAN adapters, as Lawicel's, with CAN FD as in the CANable 2.0 firmware.

mod channel;
mod parser;

pub(super) use channel::{Channel, line};
pub use parser::{Command, LINE_MAX, Parser, SlcanReject};
