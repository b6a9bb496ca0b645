//! Transmit and receive error counters of one controller -> error active, error passive, bus-off.
//!
//! Source: ISO 11898-1:2015, 12.1.4 (fault confinement). Left out: the rules for errors inside error and overload
//! flags, and the receiver that is the first to see an error (+8). The tests beside the code count to both limits and
//! back.

/// Error state of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ErrorState {
    /// Sends active error flags.
    #[default]
    Active,
    /// Sends passive error flags, and waits 8 bits after a frame of its own.
    Passive,
    /// Takes no part in the bus.
    BusOff,
}

/// Transmit error counter at which a controller leaves the bus.
const BUS_OFF: u16 = 256;
/// Counter from which a controller is error passive.
const PASSIVE: u16 = 128;
/// Value of a receive counter above the limit after a good frame: the standard allows 119 to 127.
const BACK_FROM_PASSIVE: u16 = 119;

/// The two counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ErrorCounters {
    /// Transmit error counter, 0 to 256.
    pub transmit: u16,
    /// Receive error counter, 0 to 128.
    pub receive: u16,
}

impl ErrorCounters {
    /// Returns the error state of the controller.
    pub fn state(&self) -> ErrorState {
        if self.transmit >= BUS_OFF {
            ErrorState::BusOff
        } else if self.transmit >= PASSIVE || self.receive >= PASSIVE {
            ErrorState::Passive
        } else {
            ErrorState::Active
        }
    }

    /// Counts a destroyed frame of its own.
    pub fn transmit_failed(&mut self) {
        self.transmit = (self.transmit + 8).min(BUS_OFF);
    }

    /// Counts a transmitted frame of its own.
    pub fn transmit_succeeded(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
    }

    /// Counts a destroyed frame of another controller.
    pub fn receive_failed(&mut self) {
        self.receive = (self.receive + 1).min(PASSIVE);
    }

    /// Counts a received frame of another controller.
    pub fn receive_succeeded(&mut self) {
        self.receive = if self.receive >= PASSIVE { BACK_FROM_PASSIVE } else { self.receive.saturating_sub(1) };
    }

    /// Leaves the bus at once.
    pub fn force_off(&mut self) {
        self.transmit = BUS_OFF;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(failures: usize, successes: usize) -> ErrorCounters {
        let mut counters = ErrorCounters::default();
        (0..failures).for_each(|_| counters.transmit_failed());
        (0..successes).for_each(|_| counters.transmit_succeeded());
        counters
    }

    #[test]
    fn sixteen_failures_make_passive_and_thirty_two_bus_off() {
        assert_eq!(after(15, 0).state(), ErrorState::Active);
        assert_eq!(after(16, 0).state(), ErrorState::Passive);
        assert_eq!(after(31, 0).state(), ErrorState::Passive);
        assert_eq!(after(32, 0).state(), ErrorState::BusOff);
        assert_eq!(after(33, 0).transmit, 256, "counts no further");
    }

    #[test]
    fn good_frames_bring_a_passive_controller_back() {
        assert_eq!(after(16, 1).state(), ErrorState::Active, "127 is active");
        assert_eq!(after(1, 20).transmit, 0, "not below zero");
        let mut counters = ErrorCounters::default();
        (0..127).for_each(|_| counters.receive_failed());
        assert_eq!(counters.state(), ErrorState::Active);
        (0..9).for_each(|_| counters.receive_failed());
        assert_eq!(counters.state(), ErrorState::Passive);
        counters.receive_succeeded();
        assert!((119..=127).contains(&counters.receive), "{counters:?}");
        counters.receive_succeeded();
        assert_eq!(counters.receive, 118);
    }
}
