//! `Link` over one CAN interface: waits, stamps, counts, survives the loss of the interface.

use super::socket::{Received, Socket};
use super::{RETRY, SocketCanParams, hardware_clock::HardwareClock, socket::RawFrame};
use crate::kernel_stamp::StampMap;
use crate::{Link, LinkCounters, LinkError, Packet, Stamped};
use base::clock::{Clock, PairedReading};
use base::time::Tai;
use firmware_protocol::can::CanFrame;
use rustix::io::Errno;
use std::{io, sync::Arc};

/// Error frames read in a row before the limit is looked at again: a storm of them ends no wait late.
const REPORTS_MAX: u32 = 64;

/// One CAN interface.
pub struct SocketCanLink {
    params: SocketCanParams,
    clock: Arc<dyn Clock>,
    /// `None` while the interface is lost.
    socket: Option<Socket>,
    retry_at: Tai,
    stamps: StampMap,
    hardware: HardwareClock,
    counters: LinkCounters,
}

/// Result of one read of the socket.
#[allow(clippy::large_enum_variant, reason = "one at a time, on the stack: a packet is its bytes")]
enum Look {
    Packet(Stamped<Packet>),
    /// An error frame, or a frame that is none of ours.
    Nothing,
    Empty,
}

impl SocketCanLink {
    /// Opens the interface.
    ///
    /// # Errors
    /// When the kernel has no CAN, the interface is absent, down or no CAN interface, or `fd` is wanted and its MTU
    /// is that of classic CAN; each with advice.
    pub fn open(params: SocketCanParams, clock: &Arc<dyn Clock>) -> Result<Self, LinkError> {
        let socket = Some(Socket::open(&params)?);
        let stamps = StampMap::new(PairedReading::take(&**clock));
        let (clock, retry_at) = (Arc::clone(clock), Tai::from_ns(i64::MIN));
        let (hardware, counters) = (HardwareClock::default(), LinkCounters::default());
        Ok(Self { params, clock, socket, retry_at, stamps, hardware, counters })
    }

    /// Returns true while the interface is there and up.
    pub fn is_up(&self) -> bool {
        self.socket.is_some()
    }

    /// Looks for a lost interface when it is time to.
    fn regain(&mut self) {
        let now = self.clock.now();
        if self.socket.is_some() || now < self.retry_at {
            return;
        }
        self.retry_at = now + RETRY;
        // Whatever is wrong may pass: the interface was there once.
        if let Ok(socket) = Socket::open(&self.params) {
            self.socket = Some(socket);
            self.stamps = StampMap::new(PairedReading::take(&*self.clock));
            self.hardware = HardwareClock::default();
            self.counters.regained += 1;
        }
    }

    fn look(&mut self) -> Result<Look, LinkError> {
        self.regain();
        let Some(socket) = &mut self.socket else { return Ok(Look::Empty) };
        match socket.read() {
            Ok(Some(received_frame)) => Ok(self.take(&received_frame)),
            Ok(None) => {
                self.stamps.drained();
                Ok(Look::Empty)
            }
            Err(error) => self.lose("receive", error).map(|()| Look::Empty),
        }
    }

    fn take(&mut self, received_frame: &Received) -> Look {
        self.counters.overflows += received_frame.drops;
        match received_frame.frame {
            RawFrame::Data(frame) => {
                self.counters.received += 1;
                Look::Packet(Stamped { at: self.stamp(received_frame), value: Packet::Can(frame) })
            }
            RawFrame::Report(report) => {
                self.counters.errors += u64::from(report.error);
                self.counters.bus_off += u64::from(report.bus_off);
                self.counters.restarted += u64::from(report.restarted);
                self.counters.overflows += u64::from(report.overflow);
                Look::Nothing
            }
            RawFrame::Foreign => Look::Nothing,
        }
    }

    fn stamp(&mut self, received_frame: &Received) -> Tai {
        let placed = self.stamps.place(received_frame.kernel_ns, PairedReading::take(&*self.clock));
        if !placed.is_kernels {
            self.counters.unstamped += 1;
            return placed.at;
        }
        received_frame.hardware_ns.map_or(placed.at, |hardware_ns| self.hardware.place(hardware_ns, placed.at))
    }

    /// Counts the loss of an interface that went away, so that it is looked for again; other errors are permanent.
    fn lose(&mut self, doing: &'static str, source: io::Error) -> Result<(), LinkError> {
        if !is_lost(&source) {
            return Err(LinkError::System { link: self.params.interface.clone(), doing, source, advice: "" });
        }
        self.socket = None;
        self.counters.lost += 1;
        self.retry_at = self.clock.now() + RETRY;
        Ok(())
    }

    fn wait(&mut self, now: Tai, until: Tai) -> Result<(), LinkError> {
        let Some(socket) = &self.socket else {
            self.clock.sleep_until(until.min(self.retry_at));
            return Ok(());
        };
        match socket.wait(until - now) {
            Ok(()) => Ok(()),
            Err(error) => self.lose("wait for a frame", error),
        }
    }

    fn frame_of<'a>(&self, packet: &'a Packet) -> Result<&'a CanFrame, LinkError> {
        match packet {
            Packet::Can(frame) if self.params.fd || !frame.is_fd() => Ok(frame),
            Packet::Can(_) | Packet::Serial(_) | Packet::Datagram(_) => Err(LinkError::WrongPacket {
                link: self.params.interface.clone(),
                wanted: if self.params.fd { "CAN FD or classic CAN" } else { "classic CAN" },
                got: packet.kind(),
            }),
        }
    }
}

impl Link for SocketCanLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let mut reports = 0;
        loop {
            match self.look()? {
                Look::Packet(packet) => return Ok(Some(packet)),
                Look::Nothing if reports < REPORTS_MAX => reports += 1,
                Look::Nothing | Look::Empty => {
                    let now = self.clock.now();
                    if !self.clock.is_real() || now >= until {
                        return Ok(None);
                    }
                    self.wait(now, until)?;
                }
            }
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let frame = self.frame_of(packet)?;
        self.regain();
        match self.socket.as_ref().map(|socket| socket.write(frame)) {
            Some(Ok(())) => self.counters.sent += 1,
            None => self.counters.unsent += 1,
            Some(Err(error)) => {
                self.counters.unsent += 1;
                if !is_full(&error) {
                    self.lose("send", error)?;
                }
            }
        }
        Ok(self.clock.now())
    }

    fn counters(&self) -> LinkCounters {
        self.counters
    }
}

/// Returns true if the queue of the interface or of the socket is full.
fn is_full(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::NOBUFS | Errno::AGAIN | Errno::INTR))
}

/// Returns true if the interface is down or gone.
fn is_lost(error: &io::Error) -> bool {
    let lost = [Errno::NETDOWN, Errno::NODEV, Errno::NXIO, Errno::NETUNREACH];
    Errno::from_io_error(error).is_some_and(|error| lost.contains(&error))
}
