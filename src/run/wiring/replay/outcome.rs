//! The result of the replay of one head.

/// An image that differs from the captured one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Difference {
    /// Number of its head.
    pub head: usize,
    /// Frame number.
    pub frame: u32,
    /// Checksum in the capture.
    pub wanted: u32,
    /// Checksum of the replay.
    pub got: u32,
}

/// Result of the replay of a head.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct HeadOutcome {
    /// Number of the head, from 0.
    pub head: usize,
    /// Frames drawn.
    pub drawn: u64,
    /// Frames compared with the capture.
    pub compared: u64,
    /// Frames that went out and could not be compared.
    pub uncompared: u64,
    /// Number of compared frames that are not bit-identical.
    pub differing: u64,
    /// The first of them.
    pub first: Option<Difference>,
}
