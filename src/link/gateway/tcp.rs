//! TCP listeners: clients come and go; one too many gets a message and is hung up on.
//!
//! Before a newcomer is refused, a client that has left gives its seat up, so that a client may reconnect at once, and
//! a client that has not opened the bus loses its seat ([`super::screen`]).

use super::client::{Client, ClientParts, Dialogue, LOOK_MS, OnStall, Scribe, Served, is_readable, serve};
use super::screen::{Admission, GRACE, keep_alive};
use super::{CountsIfLost, Tally, system};
use crate::{LinkError, simulated::SimulatedBus};
use base::{clock::Clock, time::Span};
use core::sync::atomic::{AtomicBool, Ordering};
use rustix::net::sockopt::set_socket_send_buffer_size;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::{sync::Arc, thread::JoinHandle, time::Duration};

/// Bytes that the system may hold for a client: frames that wait longer are worth nothing to it.
const KERNEL_BYTES: usize = 64 * 1024;
/// Time that a client which has left, or lost its seat, may take until the seat is free.
const LEAVES_WITHIN: Span = Span::from_ms(1000);
/// Between two looks at the seats while a newcomer waits.
const SEATS_LOOK: Span = Span::from_ms(1);

/// The inputs of a listener that serves clients.
pub(super) struct Hall {
    pub(super) name: &'static str,
    pub(super) bus: SimulatedBus,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) tally: Arc<Tally>,
    pub(super) patience: Span,
    pub(super) opening_within: Span,
    pub(super) ended: Arc<AtomicBool>,
    pub(super) protocol: Protocol,
}

/// Protocol that is spoken with clients.
pub(super) struct Protocol {
    pub(super) clients_max: usize,
    /// Message to one client too many.
    pub(super) full: &'static [u8],
    pub(super) new_client: Box<dyn Fn() -> (Box<dyn Dialogue>, Scribe) + Send>,
}

/// Listens in a thread of its own; the address it got.
pub(super) fn listen(hall: Hall, address: SocketAddr) -> Result<(SocketAddr, JoinHandle<()>), LinkError> {
    let refuse = |doing, advice| move |source| system(hall.name, doing, source, advice);
    let advice = "; another program may have the port: port 0 takes a free one";
    let listener = TcpListener::bind(address).map_err(refuse("listen", advice))?;
    listener.set_nonblocking(true).map_err(refuse("listen without blocking", ""))?;
    let got = listener.local_addr().map_err(refuse("read its address", ""))?;
    let name = hall.name;
    let counts = CountsIfLost(Arc::clone(&hall.tally));
    let welcome = move || {
        let _counts = counts;
        hall.welcome(&listener);
    };
    let thread = std::thread::Builder::new().name(name.into()).spawn(welcome);
    Ok((got, thread.map_err(|source| system(name, "start a thread", source, ""))?))
}

impl Hall {
    fn welcome(&self, listener: &TcpListener) {
        let mut clients: Vec<Served> = Vec::with_capacity(self.protocol.clients_max);
        while !self.ended.load(Ordering::Acquire) {
            self.dismiss_idle(&clients, self.opening_within, "never_opened");
            if !is_readable(listener) {
                continue;
            }
            match listener.accept() {
                Ok((stream, _)) if !self.has_seat(&mut clients) => self.turn_away(stream),
                Ok((stream, _)) => match self.serve(stream) {
                    Ok(client) => clients.push(client),
                    Err(_) => self.tally.reject("lost_on_arrival"),
                },
                // The client is gone already, or no descriptors are left: pause before the next attempt.
                Err(_) => self.clock.sleep_until(self.clock.now() + Span::from_ms(1)),
            }
        }
        for client in clients {
            let _ = client.thread.join(); // one that panicked has counted itself
        }
    }

    /// Hangs up on clients that have not opened the bus within `limit`.
    fn dismiss_idle(&self, clients: &[Served], limit: Span, reason: &'static str) {
        let now = self.clock.now();
        let is_idle = |admission: &Admission| admission.is_idle(now, limit);
        let there = clients.iter().filter_map(|client| client.client.upgrade()).filter(|client| !client.is_over());
        for client in there.filter(|client| client.admission.as_ref().is_some_and(is_idle)) {
            client.hang_up(reason);
        }
    }

    /// Returns true if one more client can be served. Waits for clients that are about to leave.
    fn has_seat(&self, clients: &mut Vec<Served>) -> bool {
        let until = self.clock.now() + GRACE + LEAVES_WITHIN;
        loop {
            clients.retain(|client| !client.thread.is_finished());
            if clients.len() < self.protocol.clients_max {
                return true;
            }
            let may_become_free = |client: &Served| {
                let is_or_may_be_gone = |client: &Client| {
                    client.is_leaving() || client.admission.as_ref().is_some_and(Admission::may_lose_its_seat)
                };
                client.client.upgrade().is_none_or(|client| is_or_may_be_gone(&client))
            };
            let is_over = self.ended.load(Ordering::Acquire) || self.clock.now() >= until;
            if is_over || !clients.iter().any(may_become_free) {
                return false;
            }
            self.dismiss_one(clients);
            self.clock.sleep_until(self.clock.now() + SEATS_LOOK);
        }
    }

    /// Takes the seat of the client that has been idle for longest, when no other is about to leave.
    fn dismiss_one(&self, clients: &[Served]) {
        let now = self.clock.now();
        let there = || clients.iter().map(|client| client.client.upgrade());
        if there().any(|client| client.is_none_or(|client| client.is_leaving())) {
            return;
        }
        // Clients sit in the order in which they came.
        let is_idle = |admission: &Admission| admission.is_idle(now, GRACE);
        let idle = there().flatten().find(|client| client.admission.as_ref().is_some_and(is_idle));
        idle.iter().for_each(|client| client.hang_up("gave_way"));
    }

    fn serve(&self, stream: TcpStream) -> std::io::Result<Served> {
        stream.set_nodelay(true)?;
        stream.set_nonblocking(true)?;
        set_socket_send_buffer_size(&stream, KERNEL_BYTES)?;
        keep_alive(&stream)?;
        let parts = ClientParts {
            fd: stream.into(),
            link: self.bus.attach(),
            clock: Arc::clone(&self.clock),
            tally: Arc::clone(&self.tally),
            on_stall: OnStall::HangUp,
            patience: self.patience,
            ended: Arc::clone(&self.ended),
            admission: Some(Admission::new(self.clock.now())),
        };
        let (dialogue, scribe) = (self.protocol.new_client)();
        serve(parts, dialogue, scribe)
    }

    /// Refuses a client. The client's bytes are read before the connection closes; otherwise its system would discard
    /// our message.
    fn turn_away(&self, mut stream: TcpStream) {
        self.tally.lock().refused += 1;
        let mut announce = || {
            stream.set_nonblocking(false)?;
            stream.set_read_timeout(Some(Duration::from_millis(LOOK_MS.unsigned_abs())))?;
            stream.set_write_timeout(Some(Duration::from_millis(LOOK_MS.unsigned_abs())))?;
            stream.write_all(self.protocol.full)?;
            stream.shutdown(Shutdown::Write)?;
            let mut said = [0; 256];
            stream.read(&mut said)
        };
        let _ = announce(); // the client may be gone already
    }
}
