//! CAN and CAN FD through the kernel's raw sockets: frames of one interface, stamped by the kernel <-> `Link`.
//!
//! Stamps: the adapter's own where it gives any, the kernel's at the end of the receive interrupt otherwise
//! (`kernel_stamp`); both are placed on the bench clock when the frame is fetched. A virtual interface (`vcan`) has
//! neither bit times nor an adapter: its stamp is the instant of sending.
//!
//! * The kernel forwards only data frames with the identifiers that this side receives (`Receives`), and error
//!   frames. Error frames are counted and not delivered.
//! * The receive buffer is enlarged; frames that the kernel drops all the same are counted as overflow.
//! * A frame that finds the interface's queue full is given up and counted; nothing waits behind it.
//! * An interface that is taken down or unplugged is counted as lost, and looked for every `RETRY` until it is back.
//!   Frames to be sent meanwhile are given up and counted. At the start its absence is an error.
//! * Waiting is done in `poll`; nothing spins, and a frame costs no allocation.
//!
//! Sources: Linux `Documentation/networking/can.rst` (sockets, filters, error frames, FD), `timestamping.rst`.
//! Tests: `tests` here (layout, filters, error frames), `hil_scripts/test_vcan.py` on a kernel with CAN.

mod errors;
mod filters;
mod hardware_clock;
mod link;
mod opening;
mod raw_frame;
mod socket;
#[cfg(test)]
mod tests;

use base::time::Span;
use firmware_protocol::can::IdMap;

pub use filters::Receives;
pub use link::SocketCanLink;

/// A lost interface is looked for this often.
pub const RETRY: Span = Span::from_ms(200);

/// Parameters of an interface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SocketCanParams {
    /// Name of the interface, such as `can0`.
    pub interface: String,
    /// Identifiers of the node.
    pub ids: IdMap,
    /// Side whose messages the kernel forwards.
    pub receives: Receives,
    /// True for CAN FD: the interface must have an MTU of 72. Classic frames pass as well.
    pub fd: bool,
    /// FD frames switch to the data bit rate after arbitration. Without it they stay at the arbitration rate.
    pub bit_rate_switch: bool,
}
