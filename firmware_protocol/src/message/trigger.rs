//! A numbered trigger: the flight computer makes something happen that the stimulator holds ready. Since protocol 1.2.

/// Argument of the command TRIGGER. Its token is its sequence number: a repeat is not done twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trigger {
    /// Which one; what it does is agreed outside the protocol.
    pub number: u16,
    /// When it acts: SCET in microseconds, modulo 2^32; 0 for at once. For an instant whose microseconds are 0, say 1.
    pub at_us: u32,
}

/// Answer to an accepted trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triggered {
    /// Which one.
    pub number: u16,
    /// Its instant was past when it came: it acts at once.
    pub is_late: bool,
}

impl Trigger {
    /// Returns whether it acts as soon as it has come.
    pub const fn is_at_once(&self) -> bool {
        self.at_us == 0
    }
}
