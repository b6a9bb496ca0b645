//! Where messages end in a stream of bytes.

use crate::{DATAGRAM_MAX, Datagram};

/// Rule for the end of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// After so many bytes, 1 to [`DATAGRAM_MAX`].
    Records(usize),
    /// At the end of a line; the line break is not part of the message. Empty lines are left out.
    Lines,
}

/// Bytes of a stream that do not yet complete a message.
pub(super) struct Reassembly {
    framing: Framing,
    bytes: Vec<u8>,
    /// Whether the present line is too long: bytes up to its end are left out.
    is_skipping: bool,
    /// Lines that were too long.
    pub(super) oversize: u64,
}

impl Reassembly {
    pub(super) fn new(framing: Framing) -> Self {
        Self { framing, bytes: Vec::with_capacity(DATAGRAM_MAX), is_skipping: false, oversize: 0 }
    }

    /// Discards the unfinished message.
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.is_skipping = false;
    }

    /// Takes bytes from the front of `rest` until a message is whole; `None` when there are no more.
    pub(super) fn next(&mut self, rest: &mut &[u8]) -> Option<Datagram> {
        match self.framing {
            Framing::Records(length) => self.next_record(rest, length.clamp(1, DATAGRAM_MAX)),
            Framing::Lines => core::iter::from_fn(|| self.next_line(rest)).find_map(|line| line),
        }
    }

    fn next_record(&mut self, rest: &mut &[u8], length: usize) -> Option<Datagram> {
        let wanted = (length - self.bytes.len()).min(rest.len());
        let (taken, left) = rest.split_at(wanted);
        *rest = left;
        self.bytes.extend_from_slice(taken);
        (self.bytes.len() == length).then(|| self.whole()).flatten()
    }

    /// Returns the next line: `None` without a whole line; `Some(None)` for one that is left out.
    fn next_line(&mut self, rest: &mut &[u8]) -> Option<Option<Datagram>> {
        let end = rest.iter().position(|byte| *byte == b'\n');
        let (taken, left) = rest.split_at(end.unwrap_or(rest.len()));
        *rest = left.get(1..).unwrap_or(&[]);
        if self.bytes.len() + taken.len() > DATAGRAM_MAX {
            self.oversize += u64::from(!self.is_skipping);
            self.is_skipping = true;
            self.bytes.clear();
        } else if !self.is_skipping {
            self.bytes.extend_from_slice(taken);
        }
        end?;
        if core::mem::take(&mut self.is_skipping) {
            return Some(None);
        }
        if self.bytes.last() == Some(&b'\r') {
            self.bytes.pop();
        }
        Some(self.whole().filter(|line| !line.as_slice().is_empty()))
    }

    fn whole(&mut self) -> Option<Datagram> {
        let message = Datagram::new(&self.bytes);
        self.bytes.clear();
        message
    }
}
