//! The PTP clock's registers. Status and servo are those of now; the other numbers are those of the last latch.

use super::{Device, PTP_ON};
use crate::network_camera::gvcp::Status;
use crate::network_camera::ptp::{DISABLED, INITIALIZING, PtpData, SLAVE};
use crate::network_camera::registers::{at, own};

impl Device {
    /// True while the client wants to know of the clock.
    pub(in crate::network_camera) fn wants_ptp(&self) -> bool {
        self.memory.word(own::PTP_ENABLE) == 1
    }

    /// Takes the present state of the clock.
    pub(in crate::network_camera) fn note_ptp(&mut self, data: PtpData) {
        self.ptp = data;
        self.memory.set(own::PTP_STATUS, data.state);
        self.memory.set(own::PTP_SERVO, (data.state == SLAVE).into());
        self.memory.set(at::PTP_STATUS, data.state);
    }

    pub(super) fn write_ptp(&mut self, address: u32, value: u32) -> Result<(), Status> {
        if value > 1 {
            return Err(Status::InvalidParameter);
        }
        match address {
            own::PTP_ENABLE => {
                self.memory.set(address, value);
                self.memory.set(at::GVCP_CONFIGURATION, value * PTP_ON);
                self.note_ptp(PtpData::in_state(if value == 1 { INITIALIZING } else { DISABLED }));
            }
            _ => self.latch_ptp(),
        }
        Ok(())
    }

    pub(super) fn latch_ptp(&mut self) {
        let PtpData { accuracy, offset_ns, delay_ns, clock_id, parent_id, grandmaster_id, .. } = self.ptp;
        self.memory.set(own::PTP_ACCURACY, accuracy);
        for (address, bits) in [
            (own::PTP_OFFSET, offset_ns.cast_unsigned()),
            (own::PTP_DELAY, delay_ns.cast_unsigned()),
            (own::PTP_CLOCK_ID, clock_id),
            (own::PTP_PARENT_ID, parent_id),
            (own::PTP_GRANDMASTER_ID, grandmaster_id),
        ] {
            self.memory.set_long(address, bits);
        }
    }
}
