//! Proves that a client receives the packets to its address, before anything large is sent there.
//!
//! A datagram's source address can be forged. GigE Vision has no handshake against this, but every client fetches the
//! camera's XML before it does anything else. The camera therefore shows each client (address and port) the XML at a
//! memory address of its own, drawn from a random key of this run. A client that reads the XML's first bytes there has
//! received the answer that named the address. Until then no stream starts, no feature changes, no test packet is sent,
//! exclusive access has no effect, and control gives way to others (`control`).
//!
//! Before the proof each IP address (on loopback: each client) has a budget for [`FORGOTTEN`]: [`REPLIES_MAX`] answers
//! that are longer than their requests, and [`MISSES_MAX`] wrong addresses of the XML, after which no proof of it is
//! accepted. So guesses of one client keep no other out. The address is one of 4.0e8, and no more than [`VISITORS_MAX`] IP
//! addresses have a budget at once: half of the addresses take 3 days.
//!
//! The file name in the XML's URL changes with each run, so that a client that keeps XML files by name reads it again.
//! Limits are checked by `outputs::network_camera::device_tests` and, with sockets, by
//! `outputs::network_camera::tests`.

use base::time::{Span, Tai};
use std::{collections::hash_map::RandomState, hash::BuildHasher, net::SocketAddrV4};

/// Clients whose proof is kept. The controller's is never pushed out.
const PROVEN_MAX: usize = 16;
/// Lowest address at which a client sees the XML, less its place in [`super::registers`].
const SHIFT_LEAST: u32 = 0x1000_0000;
/// Number of such addresses, a word apart. The highest is below 2^31: some clients read addresses as signed numbers.
const SHIFTS: u64 = 0x6000_0000 / 4;
/// Wrong addresses after which no proof is accepted.
const MISSES_MAX: u32 = 64;
/// Answers longer than their requests that an unproven client gets.
const REPLIES_MAX: u32 = 64;
/// Time after which wrong addresses and answers are forgotten.
const FORGOTTEN: Span = Span::from_ms(1_000);
/// IP addresses whose wrong addresses and answers are counted at once.
const VISITORS_MAX: usize = 16;

/// Counts of clients that have proven nothing, for [`FORGOTTEN`].
#[derive(Debug, Clone, Copy)]
struct Visitor {
    address: SocketAddrV4,
    since: Tai,
    misses: u32,
    replies: u32,
}

/// Which clients have proven their address, and where each of them sees the XML.
#[derive(Debug, Default)]
pub(super) struct Proof {
    key: RandomState,
    /// Oldest first.
    proven: Vec<SocketAddrV4>,
    visitors: Vec<Visitor>,
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
        if self.is_proven(client) || self.is_closed(client, now) {
            return;
        }
        if self.proven.len() == PROVEN_MAX {
            let oldest = self.proven.iter().position(|known| Some(*known) != controller);
            self.proven.remove(oldest.unwrap_or(0));
        }
        self.proven.push(client);
    }

    /// Records that a client has tried an address at which it does not see the XML.
    pub(super) fn miss(&mut self, client: SocketAddrV4, now: Tai) {
        if let Some(visitor) = self.visitor(client, now) {
            visitor.misses = visitor.misses.saturating_add(1);
        }
    }

    /// Returns true when a client may get an answer that is longer than its request, and counts it.
    pub(super) fn may_reply_at_length(&mut self, client: SocketAddrV4, now: Tai) -> bool {
        if self.is_proven(client) {
            return true;
        }
        let Some(visitor) = self.visitor(client, now) else { return client.ip().is_loopback() };
        visitor.replies = visitor.replies.saturating_add(1);
        visitor.replies <= REPLIES_MAX
    }

    fn is_closed(&mut self, client: SocketAddrV4, now: Tai) -> bool {
        self.visitor(client, now).map_or(!client.ip().is_loopback(), |visitor| visitor.misses >= MISSES_MAX)
    }

    /// Returns the counts of a client's address; `None` when too many others are counted.
    fn visitor(&mut self, client: SocketAddrV4, now: Tai) -> Option<&mut Visitor> {
        let address = if client.ip().is_loopback() { client } else { SocketAddrV4::new(*client.ip(), 0) };
        self.visitors.retain(|visitor| now - visitor.since <= FORGOTTEN);
        let place = self.visitors.iter().position(|visitor| visitor.address == address);
        if place.is_none() && self.visitors.len() < VISITORS_MAX {
            self.visitors.push(Visitor { address, since: now, misses: 0, replies: 0 });
        }
        let newest = self.visitors.len().checked_sub(1);
        let place = place.or(newest).filter(|place| self.visitors[*place].address == address)?;
        self.visitors.get_mut(place)
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
    fn wrong_addresses_are_refused_for_a_second_and_to_the_guesser_alone() {
        let mut proof = Proof::default();
        (1..MISSES_MAX).for_each(|_| proof.miss(client(9), NOW));
        proof.accept(client(1), None, NOW);
        assert!(proof.is_proven(client(1)), "one miss short of the limit");
        proof.miss(client(9), NOW);
        proof.accept(client(2), None, NOW + FORGOTTEN);
        assert!(!proof.is_proven(client(2)), "another port of the same machine");
        let other = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 8), 2);
        proof.accept(other, None, NOW);
        assert!(proof.is_proven(other), "another machine is not kept out");
        proof.accept(client(2), None, NOW + FORGOTTEN + Span::from_ns(1));
        assert!(proof.is_proven(client(2)));
        let local = |port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
        (0..10_000).for_each(|guess| proof.miss(local(1 + guess % 100), NOW));
        proof.accept(local(500), None, NOW);
        assert!(proof.is_proven(local(500)), "on loopback each client is one of its own");
        proof.accept(local(1), None, NOW);
        assert!(!proof.is_proven(local(1)));
    }

    #[test]
    fn many_forged_addresses_have_one_budget() {
        let mut proof = Proof::default();
        let forged = |last| SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, last), 1);
        for last in 1..=200 {
            (0..MISSES_MAX).for_each(|_| proof.miss(forged(last), NOW));
            proof.accept(forged(last), None, NOW);
        }
        assert!(proof.proven.is_empty() && proof.visitors.len() == VISITORS_MAX);
    }

    #[test]
    fn long_answers_before_the_proof_are_bounded() {
        let mut proof = Proof::default();
        let long = (0..1000).filter(|port| proof.may_reply_at_length(client(*port), NOW)).count();
        assert_eq!(long, REPLIES_MAX as usize);
        proof.accept(client(1), None, NOW);
        assert!((0..1000).all(|_| proof.may_reply_at_length(client(1), NOW)), "control: proven");
        assert!(proof.may_reply_at_length(client(2), NOW + FORGOTTEN + Span::from_ns(1)));
    }
}
