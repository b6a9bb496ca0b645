//! The control privilege: one application at a time commands the camera, as long as it sends commands.
//!
//! Open access reads; control reads and writes while others still read; exclusive access excludes others. The
//! controller keeps the control by any command within the heartbeat time, and loses it when silent: a killed client
//! blocks others no longer than that. A controller whose address is not proven gives way to a client whose address is,
//! and after [`UNPROVEN_FOR`] to any other: a forged datagram keeps no client out. Time is an argument.

use crate::network_camera::{gvcp::Status, proof::Proof};
use base::time::{Span, Tai};
use std::net::SocketAddrV4;

/// Bits of the control privilege register.
const EXCLUSIVE: u32 = 0x1;
const CONTROL: u32 = 0x2;
const SWITCHOVER: u32 = 0x4;
/// Time that a controller has to prove its address when another unproven client asks for control.
const UNPROVEN_FOR: Span = Span::from_ms(1_000);

/// The present controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Controller {
    address: SocketAddrV4,
    is_exclusive: bool,
    since: Tai,
    got: Tai,
}

/// Control, given or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Control {
    controller: Option<Controller>,
}

/// Result of a write to the privilege register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// A new controller.
    Taken,
    /// A new controller in place of one whose address was not proven.
    Displaced,
    /// The controller asked for another privilege, or for the same.
    Kept,
    /// The controller let go.
    Released,
}

impl Control {
    /// Returns the controller's address.
    pub(super) fn controller(&self) -> Option<SocketAddrV4> {
        self.controller.map(|controller| controller.address)
    }

    /// Records a command from `from`, which extends the control.
    pub(super) fn take_in(&mut self, from: SocketAddrV4, now: Tai) {
        if let Some(controller) = self.controller.as_mut().filter(|controller| controller.address == from) {
            controller.got = now;
        }
    }

    /// Refuses readers while another application has exclusive access, which takes effect once its address is proven.
    pub(super) fn may_read(&self, from: SocketAddrV4, proof: &Proof) -> Result<(), Status> {
        let is_shut_out = self.controller.is_some_and(|controller| {
            controller.is_exclusive && controller.address != from && proof.is_proven(controller.address)
        });
        if is_shut_out { Err(Status::AccessDenied) } else { Ok(()) }
    }

    /// Refuses everybody but the controller.
    pub(super) fn may_write(&self, from: SocketAddrV4) -> Result<(), Status> {
        if self.controller() == Some(from) { Ok(()) } else { Err(Status::AccessDenied) }
    }

    /// Applies a write to the privilege register.
    pub(super) fn request(
        &mut self,
        from: SocketAddrV4,
        value: u32,
        now: Tai,
        proof: &Proof,
    ) -> Result<Change, Status> {
        let wants = value & (EXCLUSIVE | CONTROL) != 0;
        let other = self.controller.filter(|present| present.address != from);
        let gives_way = |present: Controller| {
            !proof.is_proven(present.address) && (proof.is_proven(from) || now - present.since >= UNPROVEN_FOR)
        };
        if other.is_some_and(|present| !wants || !gives_way(present)) {
            return Err(Status::AccessDenied);
        }
        if value & !(EXCLUSIVE | CONTROL | SWITCHOVER) != 0 {
            return Err(Status::InvalidParameter);
        }
        let own = self.controller.filter(|present| present.address == from);
        let (is_exclusive, since) = (value & EXCLUSIVE != 0, own.map_or(now, |own| own.since));
        self.controller = wants.then_some(Controller { address: from, is_exclusive, since, got: now });
        Ok(match (other.is_some(), own.is_some(), wants) {
            (true, _, _) => Change::Displaced,
            (false, false, true) => Change::Taken,
            (false, true, false) => Change::Released,
            (false, true, true) | (false, false, false) => Change::Kept,
        })
    }

    /// Ends the control of any application.
    pub(super) fn release(&mut self) {
        self.controller = None;
    }

    /// Ends the control of an application that sent nothing for longer than `timeout`; true when it did.
    pub(super) fn time_out(&mut self, now: Tai, timeout: Span) -> bool {
        let is_silent = self.controller.is_some_and(|controller| now - controller.got > timeout);
        if is_silent {
            self.controller = None;
        }
        is_silent
    }
}

// A command that comes twice is carried out once: a client whose answer was lost sends the same datagram again.
//
// The last command that changed something is kept with its answer, for as long as clients try again. Time is an
// argument.

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

    const A: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1000);
    const B: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1001);
    const START: Tai = Tai::from_ns(1_000);

    #[test]
    fn one_application_has_control() {
        let (mut control, mut proof) = (Control::default(), Proof::default());
        assert_eq!(control.may_write(A), Err(Status::AccessDenied), "the camera is free");
        assert_eq!(control.request(A, CONTROL, START, &proof), Ok(Change::Taken));
        assert_eq!(control.request(B, CONTROL, START, &proof), Err(Status::AccessDenied));
        assert_eq!(control.request(B, 0, START, &proof), Err(Status::AccessDenied), "nor may it be taken away");
        assert_eq!((control.may_read(B, &proof), control.may_write(B)), (Ok(()), Err(Status::AccessDenied)));
        assert_eq!(control.request(A, EXCLUSIVE, START, &proof), Ok(Change::Kept));
        assert_eq!(control.may_read(B, &proof), Ok(()), "one datagram, perhaps forged, shuts out no reader");
        proof.accept(A, Some(A), START);
        assert_eq!((control.may_read(B, &proof), control.may_read(A, &proof)), (Err(Status::AccessDenied), Ok(())));
        assert_eq!(control.request(A, 8, START, &proof), Err(Status::InvalidParameter));
        proof.accept(B, Some(A), START);
        let later = START + UNPROVEN_FOR + UNPROVEN_FOR;
        assert_eq!(control.request(B, CONTROL, later, &proof), Err(Status::AccessDenied), "its address is proven");
        assert_eq!(control.request(A, 0, START, &proof), Ok(Change::Released));
        assert_eq!(control.request(B, CONTROL, START, &proof), Ok(Change::Taken));
    }

    #[test]
    fn an_unproven_controller_gives_way_to_a_proven_client_at_once_and_to_others_after_a_second() {
        let mut proof = Proof::default();
        let mut control = Control::default();
        control.request(A, CONTROL, START, &proof).unwrap();
        let almost = START + UNPROVEN_FOR - Span::from_ns(1);
        assert_eq!(control.request(A, EXCLUSIVE, almost, &proof), Ok(Change::Kept), "it stays as old as it is");
        assert_eq!(control.request(B, CONTROL, almost, &proof), Err(Status::AccessDenied));
        assert_eq!(control.request(B, 0, START + UNPROVEN_FOR, &proof), Err(Status::AccessDenied));
        assert_eq!(control.request(B, CONTROL, START + UNPROVEN_FOR, &proof), Ok(Change::Displaced));
        assert_eq!(control.controller(), Some(B));
        proof.accept(A, Some(B), START);
        assert_eq!(control.request(A, CONTROL, START + UNPROVEN_FOR, &proof), Ok(Change::Displaced));
        assert_eq!(control.may_write(B), Err(Status::AccessDenied));
    }

    #[test]
    fn silence_ends_control_at_the_timeout_and_not_before() {
        let timeout = Span::from_ms(3000);
        let mut control = Control::default();
        let proof = Proof::default();
        control.request(A, CONTROL, START, &proof).unwrap();
        control.take_in(B, START + Span::from_ms(2000));
        assert!(!control.time_out(START + timeout, timeout));
        control.take_in(A, START + Span::from_ms(2000));
        assert!(!control.time_out(START + Span::from_ms(5000), timeout));
        assert!(control.time_out(START + Span::from_ns(5_000_000_001), timeout));
        assert!(!control.time_out(START + Span::from_ms(9000), timeout), "only once");
        assert_eq!(control.request(B, CONTROL, START, &proof), Ok(Change::Taken));
    }
}

#[cfg(test)]
mod repeats_tests {
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
