//! One raw socket: frames with the kernel's stamps and its count of drops.

use super::raw_frame::{self, FD_BYTES, RawFrame};
use super::{SocketCanParams, opening::open};
use crate::LinkError;
use crate::kernel_stamp::nonzero_ns;
use crate::readiness::{Readiness, wait_for};
use base::time::Span;
use firmware_protocol::can::CanFrame;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, Timestamps, recvmsg};
use socketcan::CanFdSocket;
use std::io::{self, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd};

/// Bytes for the requested control messages: three stamps and the count of drops.
const CONTROL_BYTES: usize = 256;

/// An open socket, bound to one interface that is up.
pub(super) struct Socket {
    inner: CanFdSocket,
    control: Box<[u8; CONTROL_BYTES]>,
    drops: u32,
    bit_rate_switch: bool,
}

/// Result of one read of the socket.
#[derive(Debug, Clone, Copy)]
pub(super) struct Received {
    pub(super) frame: RawFrame,
    /// CLOCK_REALTIME at which the kernel got it, ns.
    pub(super) kernel_ns: Option<i64>,
    /// The adapter's own clock, ns.
    pub(super) hardware_ns: Option<i64>,
    /// Frames the kernel dropped since the last read, because the receive buffer was full.
    pub(super) drops: u64,
}

impl Socket {
    pub(super) fn open(params: &SocketCanParams) -> Result<Self, LinkError> {
        let (inner, bit_rate_switch) = (open(params)?, params.bit_rate_switch);
        Ok(Self { inner, control: Box::new([0; CONTROL_BYTES]), drops: 0, bit_rate_switch })
    }

    /// Returns the next frame in the kernel's queue; `None` when it is empty.
    pub(super) fn read(&mut self) -> io::Result<Option<Received>> {
        let mut bytes = [0; FD_BYTES];
        let mut slices = [IoSliceMut::new(&mut bytes)];
        let control = Some(&mut self.control[..]);
        let message = match recvmsg::<()>(self.inner.as_raw_fd(), &mut slices, control, MsgFlags::MSG_DONTWAIT) {
            Ok(message) => message,
            Err(nix::Error::EAGAIN | nix::Error::EINTR) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let mut got = Received { frame: RawFrame::Foreign, kernel_ns: None, hardware_ns: None, drops: 0 };
        for control in message.cmsgs()? {
            if let ControlMessageOwned::ScmTimestampsns(stamps) = control {
                got.stamp(&stamps);
            } else if let ControlMessageOwned::RxqOvfl(total) = control {
                got.drops = u64::from(total.wrapping_sub(self.drops));
                self.drops = total;
            }
        }
        let len = message.bytes;
        got.frame = raw_frame::read(bytes.get(..len).unwrap_or(&[]));
        Ok(Some(got))
    }

    /// Hands a frame to the interface's queue.
    pub(super) fn write(&self, frame: &CanFrame) -> io::Result<()> {
        let mut bytes = [0; FD_BYTES];
        let bytes = raw_frame::write(frame, self.bit_rate_switch, &mut bytes);
        rustix::io::write(&self.inner, bytes).map(|_| ()).map_err(Into::into)
    }

    /// Waits for data or an error, for `span` at most.
    pub(super) fn wait(&self, span: Span) -> io::Result<()> {
        wait_for(self.inner.as_fd(), Readiness::Read, span).map(drop)
    }
}

impl Received {
    /// Takes the stamps; all zero means that no such stamp was taken.
    fn stamp(&mut self, stamps: &Timestamps) {
        self.kernel_ns = nonzero_ns(stamps.system);
        self.hardware_ns = nonzero_ns(stamps.hw_raw);
    }
}
