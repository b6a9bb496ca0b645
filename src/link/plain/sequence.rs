//! Numbers of messages: one that was received lately is refused.
//!
//! Any number that is not among the last [`KEPT`] is taken: a sender that starts again begins where it likes.

use super::PlainReject;

/// Numbers that are remembered.
const KEPT: usize = 64;

/// The last numbers.
#[derive(Debug, Clone)]
pub(super) struct Sequence {
    last: [f64; KEPT],
    count: usize,
}

impl Default for Sequence {
    fn default() -> Self {
        Self { last: [f64::NAN; KEPT], count: 0 }
    }
}

impl Sequence {
    /// Takes a number.
    #[allow(clippy::float_cmp, reason = "numbers of messages are copied, not computed")]
    pub(super) fn take(&mut self, number: f64) -> Result<(), PlainReject> {
        if self.last.contains(&number) {
            return Err(PlainReject::Repeated);
        }
        self.last[self.count % KEPT] = number;
        self.count = self.count.wrapping_add(1);
        Ok(())
    }
}
