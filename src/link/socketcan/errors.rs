//! The kernel's error frames -> counters. Classes: Linux `include/uapi/linux/can/error.h`.

use socketcan::errors::{CAN_ERR_BUSOFF, CAN_ERR_CNT, CAN_ERR_CRTL, CAN_ERR_RESTARTED};

/// Byte 1 of a controller problem: the controller's receive buffer overflowed and a frame was lost.
const CONTROLLER_RX_OVERFLOW: u8 = 0x01;
/// Byte 1 of a controller problem: back to error-active, which is good news.
const CONTROLLER_ACTIVE: u8 = 0x40;

/// Meaning of one error frame. Several may apply at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct ErrorReport {
    /// Something went wrong on the bus or in the controller.
    pub(super) error: bool,
    /// The controller has left the bus.
    pub(super) bus_off: bool,
    /// The controller is back on the bus.
    pub(super) restarted: bool,
    /// The controller lost at least one frame.
    pub(super) overflow: bool,
}

impl ErrorReport {
    /// Reads the class bits of the identifier and the data. Bits that this version does not know are errors.
    pub(super) fn of(class: u32, data: &[u8]) -> Self {
        let problem = data.get(1).copied().unwrap_or(0);
        let recovered = class & CAN_ERR_CRTL != 0 && problem == CONTROLLER_ACTIVE;
        let good_news = CAN_ERR_RESTARTED | CAN_ERR_CNT | if recovered { CAN_ERR_CRTL } else { 0 };
        Self {
            error: class & !good_news != 0,
            bus_off: class & CAN_ERR_BUSOFF != 0,
            restarted: class & CAN_ERR_RESTARTED != 0,
            overflow: class & CAN_ERR_CRTL != 0 && problem & CONTROLLER_RX_OVERFLOW != 0,
        }
    }
}
