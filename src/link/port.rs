//! A link with a codec: packets <-> messages, rejections counted.

use super::{CHUNK_MAX, Departure, Link, LinkCounters, LinkError, Packet, SerialChunk, Stamped};
use base::time::{Span, Tai};
use firmware_protocol::can::{self, CanFrame, Format, IdMap};
use firmware_protocol::{Message, Reject, RejectCounters, serial};

/// How messages look on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WireFormat {
    /// Classic CAN: attitude as a group of frames.
    CanClassic,
    /// CAN FD: attitude in one frame.
    CanFd,
    /// Serial: COBS packets.
    Serial,
}

/// What [`Port::poll`] came back with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Polled {
    /// A message.
    Message(Stamped<Message>),
    /// A packet that is no message yet, or was refused and counted.
    Packet,
    /// Nothing came in time.
    Nothing,
}

/// One port: sends and receives messages over one link.
///
/// On serial a message carries the stamp of the chunk in which it ended.
pub struct Port {
    link: Box<dyn Link>,
    format: WireFormat,
    ids: IdMap,
    can: can::Decoder,
    serial: SerialCodec,
    rejects: RejectCounters,
    packets_sent: u64,
    /// Taken off every stamp.
    delay: Span,
}

struct SerialCodec {
    encoder: serial::Encoder,
    decoder: serial::Decoder,
    chunk: Stamped<SerialChunk>,
    taken: usize,
}

impl Port {
    /// A port over `link`; `ids` matters on CAN only.
    #[must_use]
    pub fn new(link: Box<dyn Link>, format: WireFormat, ids: IdMap) -> Self {
        let can = can::Decoder::new(ids);
        let rejects = RejectCounters::default();
        Self { link, format, ids, can, serial: SerialCodec::new(), rejects, packets_sent: 0, delay: Span::ZERO }
    }

    /// The same with a constant delay taken off every stamp: how much longer this link's stamps are on their way than
    /// those of the link that the clocks are correlated by.
    #[must_use]
    pub fn less_delay(mut self, delay: Span) -> Self {
        self.delay = delay;
        self
    }

    /// How messages look on this port's wire.
    #[must_use]
    pub fn format(&self) -> WireFormat {
        self.format
    }

    /// Why and how often input was refused.
    #[must_use]
    pub fn rejects(&self) -> &RejectCounters {
        &self.rejects
    }

    /// What went over the link.
    #[must_use]
    pub fn counters(&self) -> LinkCounters {
        self.link.counters()
    }

    /// The next message; waits as [`Link::receive`] does. Refused input is counted and skipped.
    ///
    /// # Errors
    /// When the link is no longer able to receive.
    pub fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Message>>, LinkError> {
        loop {
            match self.poll(until)? {
                Polled::Message(message) => return Ok(Some(message)),
                Polled::Packet => {}
                Polled::Nothing => return Ok(None),
            }
        }
    }

    /// As [`Self::receive`], for one packet at most: a bus that is full of what is not for this port holds nobody up.
    ///
    /// # Errors
    /// When the link is no longer able to receive.
    pub fn poll(&mut self, until: Tai) -> Result<Polled, LinkError> {
        if let Some(message) = self.serial.next(&mut self.rejects) {
            return Ok(Polled::Message(message));
        }
        let Some(mut packet) = self.link.receive(until)? else {
            return Ok(Polled::Nothing);
        };
        packet.at = packet.at - self.delay;
        Ok(self.read(packet).map_or(Polled::Packet, Polled::Message))
    }

    /// Sends a message; returns when its last packet leaves, as [`Link::send`] does.
    ///
    /// # Errors
    /// When the wire format cannot carry it, or the link refuses it.
    pub fn send(&mut self, message: &Message) -> Result<Tai, LinkError> {
        match self.format {
            WireFormat::CanClassic => self.send_frames(message, Format::Classic),
            WireFormat::CanFd => self.send_frames(message, Format::Fd),
            WireFormat::Serial => {
                let chunk = self.serial.encode(message)?;
                self.send_packet(&Packet::Serial(chunk))
            }
        }
    }

    /// Packets that the link took so far: right after [`Self::send`], the last packet of that message is number
    /// `packets_sent() - 1` for [`Self::departure`].
    #[must_use]
    pub fn packets_sent(&self) -> u64 {
        self.packets_sent
    }

    /// What became of packet number `packet`, as [`Link::departure`].
    pub fn departure(&mut self, packet: u64) -> Departure {
        self.link.departure(packet)
    }

    fn send_packet(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let leaves = self.link.send(packet)?;
        self.packets_sent += 1;
        Ok(leaves)
    }

    fn send_frames(&mut self, message: &Message, format: Format) -> Result<Tai, LinkError> {
        let mut leaves = Tai::from_ns(i64::MIN);
        for frame in can::encode(message, format, &self.ids)?.iter() {
            leaves = self.send_packet(&Packet::Can(*frame))?;
        }
        Ok(leaves)
    }

    /// A CAN frame gives its message at once; a chunk is put aside for [`SerialCodec::next`].
    fn read(&mut self, packet: Stamped<Packet>) -> Option<Stamped<Message>> {
        match packet.value {
            Packet::Can(frame) => self.read_frame(packet.at, &frame),
            Packet::Serial(chunk) => {
                self.serial.put(Stamped { at: packet.at, value: chunk });
                None
            }
        }
    }

    fn read_frame(&mut self, at: Tai, frame: &CanFrame) -> Option<Stamped<Message>> {
        let message = self.can.read(frame);
        message
            .unwrap_or_else(|reject: Reject| {
                self.rejects.count(reject);
                None
            })
            .map(|value| Stamped { at, value })
    }
}

impl SerialCodec {
    fn new() -> Self {
        let chunk = Stamped { at: Tai::from_ns(0), value: SerialChunk::EMPTY };
        Self { encoder: serial::Encoder::new(), decoder: serial::Decoder::new(), chunk, taken: 0 }
    }

    fn put(&mut self, chunk: Stamped<SerialChunk>) {
        self.chunk = chunk;
        self.taken = 0;
    }

    /// The next message in the chunk at hand.
    fn next(&mut self, rejects: &mut RejectCounters) -> Option<Stamped<Message>> {
        let bytes = self.chunk.value.as_slice();
        let mut rest = &bytes[self.taken..];
        let message = core::iter::from_fn(|| self.decoder.read(&mut rest))
            .find_map(|outcome| outcome.map_err(|reject| rejects.count(reject)).ok());
        self.taken = bytes.len() - rest.len();
        message.map(|value| Stamped { at: self.chunk.at, value })
    }

    fn encode(&mut self, message: &Message) -> Result<SerialChunk, LinkError> {
        let mut line = [0; CHUNK_MAX];
        let len = self.encoder.encode(message, &mut line)?;
        Ok(SerialChunk::new(&line[..len]).unwrap_or(SerialChunk::EMPTY))
    }
}
