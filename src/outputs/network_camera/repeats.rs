//! A command that comes twice is carried out once: a client whose answer was lost sends the same datagram again.
//!
//! The last command that changed something is kept with its answer, for as long as clients try again. Time is an
//! argument.

use base::time::{Span, Tai};
use std::net::SocketAddrV4;

/// Clients try again within seconds (Aravis: 6 times 0.5 s); command numbers come round after 65535 commands.
const KEPT: Span = Span::from_ms(5_000);

/// The last change.
#[derive(Debug, Default)]
pub(super) struct LastChange {
    kept: Option<(SocketAddrV4, Tai)>,
    request: Vec<u8>,
    reply: Vec<u8>,
}

impl LastChange {
    /// Keeps a datagram that was carried out and its answer, empty for silence.
    pub(super) fn keep(&mut self, from: SocketAddrV4, request: &[u8], reply: &[u8], now: Tai) {
        self.kept = Some((from, now));
        for (kept, bytes) in [(&mut self.request, request), (&mut self.reply, reply)] {
            kept.clear();
            kept.extend(bytes);
        }
    }

    /// Returns the answer to a datagram that is the last one again, number included.
    pub(super) fn answer_to(&self, from: SocketAddrV4, request: &[u8], now: Tai) -> Option<&[u8]> {
        let (sender, at) = self.kept?;
        (sender == from && now - at <= KEPT && self.request == request).then_some(&self.reply)
    }

    /// Forgets the last request, whose answer is not valid any more.
    pub(super) fn forget(&mut self) {
        self.kept = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    #[test]
    fn the_same_datagram_of_the_same_sender_is_a_repeat_for_some_seconds() {
        let [sender, other] = [1, 2].map(|port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port));
        let mut last = LastChange::default();
        let at = Tai::from_ns(1_000);
        assert_eq!(last.answer_to(sender, b"", at), None, "nothing was asked yet");
        last.keep(sender, b"write 1", b"done", at);
        assert_eq!(last.answer_to(sender, b"write 1", at + KEPT), Some(&b"done"[..]));
        assert_eq!(last.answer_to(sender, b"write 1", at + KEPT + Span::from_ns(1)), None, "too late");
        assert_eq!(last.answer_to(sender, b"write 2", at), None);
        assert_eq!(last.answer_to(other, b"write 1", at), None);
        last.keep(sender, b"go", b"", at);
        assert_eq!(last.answer_to(sender, b"go", at), Some(&b""[..]), "silence too");
        last.forget();
        assert_eq!(last.answer_to(sender, b"go", at), None);
    }
}
