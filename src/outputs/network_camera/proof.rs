//! Proves that a client receives the packets to its address, before anything large is sent there.
//!
//! A datagram's source address can be forged. GigE Vision has no handshake against this, but every client fetches the
//! camera's XML before it does anything else. The camera therefore shows each client (address and port) the XML at a
//! memory address of its own, drawn from a random key of this run. A client that reads the XML's first bytes there has
//! received the answer that named the address. Until then no stream starts, no test packet is sent, exclusive access
//! has no effect, and control lasts no longer than the default heartbeat.
//!
//! Guessing: the address is one of 4.0e8. After [`MISSES_MAX`] wrong addresses within [`MISSES_FORGOTTEN`], no new
//! proof is accepted until that time is over: half of the addresses take 36 days.
//!
//! The file name in the XML's URL changes with each run, so that a client that keeps XML files by name reads it again.
//! Limits are checked by `outputs::network_camera::device_tests` and, with sockets, by
//! `outputs::network_camera::tests`.

use base::time::{Span, Tai};
use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::net::SocketAddrV4;

/// Clients whose proof is kept. The controller's is never pushed out.
const PROVEN_MAX: usize = 16;
/// Lowest address at which a client sees the XML, less its place in [`super::registers`].
const SHIFT_LEAST: u32 = 0x1000_0000;
/// Number of such addresses, a word apart. The highest is below 2^31: some clients read addresses as signed numbers.
const SHIFTS: u64 = 0x6000_0000 / 4;
/// Wrong addresses after which no proof is accepted.
const MISSES_MAX: u32 = 64;
/// Time after which wrong addresses are forgotten.
const MISSES_FORGOTTEN: Span = Span::from_ms(1_000);

/// Which clients have proven their address, and where each of them sees the XML.
#[derive(Debug, Default)]
pub(super) struct Proof {
    key: RandomState,
    /// Oldest first.
    proven: Vec<SocketAddrV4>,
    misses: u32,
    first_miss: Option<Tai>,
}

impl Proof {
    /// Returns the offset that is added to the XML's address for this client.
    pub(super) fn shift(&self, client: SocketAddrV4) -> u32 {
        let drawn = self.key.hash_one(client) % SHIFTS;
        u32::try_from(drawn).map_or(SHIFT_LEAST, |drawn| SHIFT_LEAST + 4 * drawn)
    }

    /// Returns a number of this run, for the XML's file name.
    pub(super) fn run_number(&self) -> u32 {
        (self.key.hash_one("file name") & 0xFFFF_FFFF) as u32
    }

    /// Returns true when an address lies where clients see the XML.
    pub(super) const fn is_shown(address: u32) -> bool {
        address >= SHIFT_LEAST
    }

    /// Returns true when the client has proven its address.
    pub(super) fn is_proven(&self, client: SocketAddrV4) -> bool {
        self.proven.contains(&client)
    }

    /// Records that a client has read the XML's first bytes at its own address.
    pub(super) fn accept(&mut self, client: SocketAddrV4, controller: Option<SocketAddrV4>, now: Tai) {
        if self.is_proven(client) || self.is_closed(now) {
            return;
        }
        if self.proven.len() == PROVEN_MAX {
            let oldest = self.proven.iter().position(|known| Some(*known) != controller);
            self.proven.remove(oldest.unwrap_or(0));
        }
        self.proven.push(client);
    }

    /// Records that a client has tried an address at which it does not see the XML.
    pub(super) fn miss(&mut self, now: Tai) {
        if self.first_miss.is_none_or(|first| now - first > MISSES_FORGOTTEN) {
            (self.first_miss, self.misses) = (Some(now), 0);
        }
        self.misses = self.misses.saturating_add(1);
    }

    fn is_closed(&self, now: Tai) -> bool {
        self.misses >= MISSES_MAX && self.first_miss.is_some_and(|first| now - first <= MISSES_FORGOTTEN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    const NOW: Tai = Tai::from_ns(5_000_000_000);

    fn client(port: u16) -> SocketAddrV4 {
        SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 7), port)
    }

    #[test]
    fn shift_of_each_client_and_run_differs_and_stays_in_its_range() {
        let (proof, another_run) = (Proof::default(), Proof::default());
        let shifts: std::collections::BTreeSet<u32> = (1..=1000).map(|port| proof.shift(client(port))).collect();
        assert!(shifts.len() > 990, "{} different of 1000", shifts.len());
        assert!(shifts.iter().all(|shift| shift % 4 == 0 && (0x1000_0000..0x7000_0000).contains(shift)));
        assert_eq!(proof.shift(client(7)), proof.shift(client(7)));
        let same = (1..=100).filter(|port| proof.shift(client(*port)) == another_run.shift(client(*port))).count();
        assert!(same <= 1, "{same} of 100 shifts do not depend on the run");
    }

    #[test]
    fn many_clients_do_not_push_out_the_proof_of_the_controller() {
        let mut proof = Proof::default();
        let controller = client(1);
        proof.accept(controller, None, NOW);
        (2..100).for_each(|port| proof.accept(client(port), Some(controller), NOW));
        assert!(proof.is_proven(controller) && proof.is_proven(client(99)) && !proof.is_proven(client(2)));
        assert_eq!(proof.proven.len(), PROVEN_MAX);
    }

    #[test]
    fn wrong_addresses_are_refused_for_a_second() {
        let mut proof = Proof::default();
        (1..MISSES_MAX).for_each(|_| proof.miss(NOW));
        proof.accept(client(1), None, NOW);
        assert!(proof.is_proven(client(1)), "one miss short of the limit");
        proof.miss(NOW);
        proof.accept(client(2), None, NOW + MISSES_FORGOTTEN);
        assert!(!proof.is_proven(client(2)));
        proof.accept(client(2), None, NOW + MISSES_FORGOTTEN + Span::from_ns(1));
        assert!(proof.is_proven(client(2)));
    }
}
