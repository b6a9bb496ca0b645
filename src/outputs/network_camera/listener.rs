//! The control thread: datagrams of the control port -> the device -> answers, test packets, requests to send again.
//!
//! It renders nothing and sends no frames: however much comes in, only this thread is busy with it. Requests to send
//! again go through a bounded queue; requests that do not fit are refused and counted, as are those of other senders
//! than the stream's receiver. Test packets leave before the answer to their command, no faster than the stream's rate.

use crate::network_camera::device::{Answer, Device};
use crate::network_camera::{gvcp::Resend, packets::TestOutlet, ptp::PtpClient, shared::Shared};
use base::clock::Clock;
use crossbeam_channel::Sender;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::net::{SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::Arc;

/// Longest wait for a datagram, ms: how soon a silent controller is noticed.
const LOOK_MS: i64 = 50;
/// The same while events are wanted, ms: how late one leaves at most.
const EVENT_LOOK_MS: i64 = 1;
/// An answer to a message has a header only.
const MESSAGE_ANSWER_BYTES: usize = 64;
/// Datagrams of one socket that are read in a row.
const IN_A_ROW: usize = 64;
/// No command is longer; the rest of a longer datagram is cut off and it is malformed.
const DATAGRAM_BYTES: usize = 1024;

/// The parts that the control side needs.
pub(super) struct Listener {
    pub(super) device: Device,
    pub(super) shared: Arc<Shared>,
    pub(super) clock: Arc<dyn Clock>,
    /// The control port, which also answers broadcasts.
    pub(super) control: UdpSocket,
    /// Sockets that receive broadcasts.
    pub(super) broadcasts: Vec<UdpSocket>,
    /// Where messages leave, and their answers come in.
    pub(super) messages: UdpSocket,
    pub(super) ptp: PtpClient,
    pub(super) tests: TestOutlet,
    pub(super) asks: Sender<Resend>,
}

impl Listener {
    /// Serves until the camera ends.
    pub(super) fn run(mut self) {
        let mut answer = Answer::default();
        let mut buffer = [0; DATAGRAM_BYTES];
        while !self.shared.is_ended() {
            self.wait();
            for place in 0..=self.broadcasts.len() {
                for _ in 0..IN_A_ROW {
                    let broadcast = place.checked_sub(1).map(|place| &self.broadcasts[place]);
                    let socket = broadcast.unwrap_or(&self.control);
                    let Ok((bytes, SocketAddr::V4(from))) = socket.recv_from(&mut buffer) else { break };
                    let (datagram, now) = (&buffer[..bytes], self.clock.now());
                    if broadcast.is_some() {
                        self.device.answer_broadcast(from, datagram, now, &mut answer);
                    } else {
                        self.device.answer(from, datagram, now, &mut answer);
                    }
                    self.act(from, &answer);
                }
            }
            self.device.tick(self.clock.now());
            self.device.end_stream_of(self.shared.gone());
            self.send_messages(&mut answer.reply);
            self.ask_clock();
        }
    }

    fn send_messages(&mut self, buffer: &mut Vec<u8>) {
        let mut answer = [0; MESSAGE_ANSWER_BYTES];
        for _ in 0..IN_A_ROW {
            let Ok((bytes, SocketAddr::V4(from))) = self.messages.recv_from(&mut answer) else { break };
            self.device.answer_to_message(from, &answer[..bytes]);
        }
        for _ in 0..IN_A_ROW {
            let Some(to) = self.device.message(self.clock.now(), buffer) else { break };
            let _ = self.messages.send_to(buffer, to); // repeated if the client wants answers
        }
    }

    fn ask_clock(&mut self) {
        if self.device.camera.wants_ptp() {
            let reported = self.ptp.poll(self.clock.now());
            self.device.camera.note_ptp(reported);
        } else {
            self.ptp.rest();
        }
    }

    fn wait(&self) {
        let all = [&self.control, &self.messages].into_iter().chain(&self.broadcasts);
        let mut sockets: Vec<PollFd<'_>> = all.map(|socket| PollFd::new(socket, PollFlags::IN)).collect();
        let look_ms = if self.device.has_messages() { EVENT_LOOK_MS } else { LOOK_MS };
        let limit = Timespec { tv_sec: 0, tv_nsec: look_ms * 1_000_000 };
        let _ = poll(&mut sockets, Some(&limit)); // the sockets are read in either case
    }

    fn act(&mut self, from: SocketAddrV4, answer: &Answer) {
        if let Some((to, bytes)) = answer.test_packet {
            self.tests.send(to, bytes, self.clock.now());
        }
        if let Some(resend) = answer.resend {
            self.ask_again(from, resend);
        }
        if !answer.reply.is_empty() {
            let _ = self.control.send_to(&answer.reply, from); // a lost answer is asked for again
        }
    }

    fn ask_again(&self, from: SocketAddrV4, resend: Resend) {
        self.shared.tally.resends_asked.add(resend.packets());
        // Everybody in the subnet may be in the group.
        let is_of = |to: SocketAddrV4| to.ip() == from.ip() || to.ip().is_multicast();
        let is_receiver = self.shared.settings().destination.is_some_and(is_of);
        if !is_receiver || self.asks.try_send(resend).is_err() {
            self.shared.tally.resends_refused.add(resend.packets());
        }
    }
}
