//! A link with a codec: packets <-> messages, rejections counted.

use super::plain::{
    PlainAttitude, PlainCodec, PlainLayout, PlainRecord, PlainRejectCounters, PlainTime, RefusedMessage,
};
use super::{CHUNK_MAX, Datagram, Departure, Link, LinkCounters, LinkError, Packet, SerialChunk, Stamped};
use base::time::{Span, Tai};
use firmware_protocol::can::{self, CanFrame, Format, IdMap};
use firmware_protocol::{Message, Reject, RejectCounters, message::AttitudeRecord, serial, ticks::ticks_diff};

/// Format of messages on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WireFormat {
    /// Classic CAN: attitude as a group of frames.
    CanClassic,
    /// CAN FD: attitude in one frame.
    CanFd,
    /// Serial: COBS packets.
    Serial,
    /// Plain datagrams of an outside simulator: attitudes, jitter and the observer, and nothing else.
    Plain,
}

/// Input of a port.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Input {
    /// A message of the protocol.
    Message(Message),
    /// A plain message of an outside simulator.
    Plain(PlainRecord),
}

/// Result of [`Port::poll`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Polled {
    /// A message, of either kind.
    Input(Stamped<Input>),
    /// A packet that does not yet complete a message, or was refused and counted.
    Packet,
    /// No packet came in time.
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
    plain: PlainCodec,
    plain_clock: PlainClock,
    rejects: RejectCounters,
    packets_sent: u64,
    /// Taken off every stamp.
    delay: Span,
}

/// The clock of a flight computer that sends plain messages: its ticks wrap, times in plain messages do not.
#[derive(Default)]
struct PlainClock {
    last: Option<(u32, i64)>,
}

/// Bytes without a delimiter that are counted as refused: ten times as many as a packet has.
const NOISE_BYTES: usize = 1024;

struct SerialCodec {
    encoder: serial::Encoder,
    decoder: serial::Decoder,
    chunk: Stamped<SerialChunk>,
    taken: usize,
    /// Bytes since the last delimiter.
    open_bytes: usize,
}

impl Port {
    /// Returns a port over `link`; `ids` matters on CAN only.
    pub fn new(link: Box<dyn Link>, format: WireFormat, ids: IdMap) -> Self {
        let can = can::Decoder::new(ids);
        Self {
            link,
            format,
            ids,
            can,
            serial: SerialCodec::new(),
            plain: PlainCodec::new(PlainLayout::default()),
            plain_clock: PlainClock::default(),
            rejects: RejectCounters::default(),
            packets_sent: 0,
            delay: Span::ZERO,
        }
    }

    /// Returns the same with another layout of plain messages than the default.
    #[must_use]
    pub fn with_layout(mut self, layout: PlainLayout) -> Self {
        self.plain = PlainCodec::new(layout);
        self
    }

    /// Returns the same with a constant delay taken off every stamp: how much longer this link's stamps are on their
    /// way than those of the link that the clocks are correlated by.
    #[must_use]
    pub fn less_delay(mut self, delay: Span) -> Self {
        self.delay = delay;
        self
    }

    /// Returns how messages look on this port's wire.
    pub fn format(&self) -> WireFormat {
        self.format
    }

    /// Returns why and how often input was refused.
    pub fn rejects(&self) -> &RejectCounters {
        &self.rejects
    }

    /// Returns why and how often plain messages were refused.
    pub fn plain_rejects(&self) -> &PlainRejectCounters {
        self.plain.rejects()
    }

    /// Returns the first plain message that was refused.
    pub fn first_refused(&self) -> Option<RefusedMessage> {
        self.plain.first_refused()
    }

    /// Returns the counters of the link.
    pub fn counters(&self) -> LinkCounters {
        self.link.counters()
    }

    /// Returns the next message of the protocol; waits as [`Link::receive`] does. Refused input is counted and skipped.
    ///
    /// # Errors
    /// When the link is no longer able to receive.
    pub fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Message>>, LinkError> {
        loop {
            match self.poll(until)? {
                Polled::Input(Stamped { at, value: Input::Message(value) }) => return Ok(Some(Stamped { at, value })),
                Polled::Input(Stamped { value: Input::Plain(_), .. }) | Polled::Packet => {}
                Polled::Nothing => return Ok(None),
            }
        }
    }

    /// Returns the next message of either kind; waits as [`Link::receive`] does. Refused input is counted and skipped.
    ///
    /// # Errors
    /// When the link is no longer able to receive.
    pub fn receive_any(&mut self, until: Tai) -> Result<Option<Stamped<Input>>, LinkError> {
        loop {
            match self.poll(until)? {
                Polled::Input(input) => return Ok(Some(input)),
                Polled::Packet => {}
                Polled::Nothing => return Ok(None),
            }
        }
    }

    /// Receives as [`Self::receive_any`], but one packet at most: a bus full of packets for others does not delay the
    /// caller.
    ///
    /// # Errors
    /// When the link is no longer able to receive.
    pub fn poll(&mut self, until: Tai) -> Result<Polled, LinkError> {
        if let Some(message) = self.serial.next(&mut self.rejects) {
            return Ok(Polled::Input(message));
        }
        let Some(mut packet) = self.link.receive(until)? else {
            return Ok(Polled::Nothing);
        };
        packet.at = packet.at - self.delay;
        Ok(self.read(packet).map_or(Polled::Packet, Polled::Input))
    }

    /// Sends a message; returns when its last packet leaves, as [`Link::send`] does. A plain link carries attitudes
    /// only: other messages have no plain form, and are left out.
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
            WireFormat::Plain => self.send_plain(message),
        }
    }

    fn send_plain(&mut self, message: &Message) -> Result<Tai, LinkError> {
        let datagram = match message {
            Message::Attitude(record) => self.plain.write(&self.plain_clock.record(record)),
            Message::Sync(_)
            | Message::TimeFollowUp(_)
            | Message::Jitter(_)
            | Message::JitterPair(_)
            | Message::Wheels(_)
            | Message::Exposure(_)
            | Message::Status(_)
            | Message::Camera(_)
            | Message::Command(_)
            | Message::Response(_)
            | Message::Table(_)
            | Message::Heartbeat(_) => None,
        };
        let send = |datagram: Datagram| self.send_packet(&Packet::Datagram(datagram));
        datagram.map_or(Ok(Tai::from_ns(i64::MIN)), send)
    }

    /// Returns the number of packets that the link took so far: right after [`Self::send`], the last packet of that
    /// message is number `packets_sent() - 1` for [`Self::departure`].
    pub fn packets_sent(&self) -> u64 {
        self.packets_sent
    }

    /// Returns the outcome of packet number `packet`, as [`Link::departure`].
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

    /// Reads a packet: a CAN frame gives its message at once; a chunk is kept for [`SerialCodec::next`].
    fn read(&mut self, packet: Stamped<Packet>) -> Option<Stamped<Input>> {
        match packet.value {
            Packet::Can(frame) => self.read_frame(packet.at, &frame),
            Packet::Serial(chunk) => {
                self.serial.put(Stamped { at: packet.at, value: chunk }, &mut self.rejects);
                None
            }
            Packet::Datagram(datagram) => {
                let record = self.plain.read(datagram.as_slice())?;
                Some(Stamped { at: packet.at, value: Input::Plain(record) })
            }
        }
    }

    fn read_frame(&mut self, at: Tai, frame: &CanFrame) -> Option<Stamped<Input>> {
        let message = self.can.read(frame);
        message
            .unwrap_or_else(|reject: Reject| {
                self.rejects.count(reject);
                None
            })
            .map(|message| Stamped { at, value: Input::Message(message) })
    }
}

impl PlainClock {
    /// Returns the attitude of a message as a plain record, in double precision of its single precision.
    fn record(&mut self, record: &AttitudeRecord) -> PlainRecord {
        let unwrapped_us = match self.last {
            Some((t_us, unwrapped_us)) => unwrapped_us.saturating_add(i64::from(ticks_diff(record.t_us, t_us))),
            None => i64::from(record.t_us),
        };
        self.last = Some((record.t_us, unwrapped_us));
        let attitude = PlainAttitude {
            q_wxyz: record.q_wxyz.map(f64::from),
            rate_rad_s: record.rate_rad_s.map(f64::from),
            acceleration_rad_s2: record.acceleration_rad_s2.map(f64::from),
        };
        let time = PlainTime::Tag(unwrapped_us.saturating_mul(1000));
        PlainRecord { time, attitude: Some(attitude), jitter_rad: None, observer: None }
    }
}

impl SerialCodec {
    fn new() -> Self {
        let chunk = Stamped { at: Tai::from_ns(0), value: SerialChunk::EMPTY };
        Self { encoder: serial::Encoder::new(), decoder: serial::Decoder::new(), chunk, taken: 0, open_bytes: 0 }
    }

    /// Takes a chunk; noise without a delimiter is counted.
    fn put(&mut self, chunk: Stamped<SerialChunk>, rejects: &mut RejectCounters) {
        for byte in chunk.value.as_slice() {
            self.open_bytes = if *byte == 0 { 0 } else { self.open_bytes + 1 };
            if self.open_bytes >= NOISE_BYTES {
                rejects.count(Reject::Oversize);
                self.open_bytes = 0;
            }
        }
        self.chunk = chunk;
        self.taken = 0;
    }

    /// Returns the next message in the chunk at hand.
    fn next(&mut self, rejects: &mut RejectCounters) -> Option<Stamped<Input>> {
        let bytes = self.chunk.value.as_slice();
        let mut rest = &bytes[self.taken..];
        let message = core::iter::from_fn(|| self.decoder.read(&mut rest))
            .find_map(|outcome| outcome.map_err(|reject| rejects.count(reject)).ok());
        self.taken = bytes.len() - rest.len();
        message.map(|message| Stamped { at: self.chunk.at, value: Input::Message(message) })
    }

    fn encode(&mut self, message: &Message) -> Result<SerialChunk, LinkError> {
        let mut line = [0; CHUNK_MAX];
        let len = self.encoder.encode(message, &mut line)?;
        Ok(SerialChunk::new(&line[..len]).unwrap_or(SerialChunk::EMPTY))
    }
}
