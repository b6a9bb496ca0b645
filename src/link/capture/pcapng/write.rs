//! Packets -> pcapng, little-endian.

use super::{
    CAN_BRS, CAN_FDF, ENHANCED_PACKET, INBOUND, INTERFACE, LINK_CAN, LINK_DATAGRAM, LINK_SERIAL, NAME_BEFORE,
    OPTION_COMMENT, OPTION_END, OPTION_FLAGS, OPTION_NAME, OPTION_PROGRAM, OPTION_RESOLUTION, ORDER_MAGIC, OUTBOUND,
    SECTION, TAI_AFTER, TAI_BEFORE,
};
use crate::Packet;
use crate::capture::{CapturedPacket, Direction};
use firmware_protocol::can::CanFrame;
use std::io::{self, Write};

/// Units of stamps: 10^-9 s.
const NANOSECONDS: u8 = 9;

/// Writes blocks; its buffers are made once.
pub(in crate::capture) struct PcapngWriter<W> {
    out: W,
    body: Vec<u8>,
    data: Vec<u8>,
    /// Number and link type of each interface that has been described, in this order.
    described: Vec<(u8, u16)>,
}

impl<W: Write> PcapngWriter<W> {
    /// Begins a section.
    pub(in crate::capture) fn new(out: W) -> Result<Self, io::Error> {
        let (body, data) = (Vec::with_capacity(256), Vec::with_capacity(128));
        let mut writer = Self { out, body, data, described: Vec::new() };
        writer.body.extend(ORDER_MAGIC.to_le_bytes());
        writer.body.extend([1, 0, 0, 0]); // version 1.0
        writer.body.extend(u64::MAX.to_le_bytes()); // length of the section: not given
        put_option(&mut writer.body, OPTION_PROGRAM, concat!("starloop ", env!("CARGO_PKG_VERSION")).as_bytes());
        put_option(&mut writer.body, OPTION_END, &[]);
        writer.finish_block(SECTION)?;
        Ok(writer)
    }

    pub(in crate::capture) fn out(&mut self) -> &mut W {
        &mut self.out
    }

    /// Writes one packet, and its interface before the first of its number and kind.
    pub(in crate::capture) fn write(&mut self, captured: &CapturedPacket) -> Result<(), io::Error> {
        let link_type = match captured.packet {
            Packet::Can(_) => LINK_CAN,
            Packet::Serial(_) => LINK_SERIAL,
            Packet::Datagram(_) => LINK_DATAGRAM,
        };
        let wanted = (captured.interface, link_type);
        let place = match self.described.iter().position(|described| *described == wanted) {
            Some(place) => place,
            None => self.describe_interface(wanted)?,
        };
        self.data.clear();
        match &captured.packet {
            Packet::Can(frame) => put_can(&mut self.data, frame),
            Packet::Serial(_) | Packet::Datagram(_) => self.data.extend(captured.packet.data()),
        }
        #[allow(clippy::cast_possible_truncation, reason = "768 interfaces at most")]
        self.put_packet(place as u32, captured);
        self.finish_block(ENHANCED_PACKET)
    }

    fn put_packet(&mut self, place: u32, captured: &CapturedPacket) {
        let body = &mut self.body;
        let unix_ns = captured.at.to_unix_ns().max(0).unsigned_abs();
        body.extend(place.to_le_bytes());
        // The upper half of the stamp comes first.
        body.extend(unix_ns.to_le_bytes()[4..].iter());
        body.extend(unix_ns.to_le_bytes()[..4].iter());
        #[allow(clippy::cast_possible_truncation, reason = "a packet has at most 512 bytes")]
        let length = (self.data.len() as u32).to_le_bytes();
        body.extend(length); // captured
        body.extend(length); // on the wire
        body.extend(&self.data);
        pad(body);
        let flags = if captured.direction == Direction::Sent { OUTBOUND } else { INBOUND };
        put_option(body, OPTION_FLAGS, &flags.to_le_bytes());
        let mut comment = [0; 40];
        let mut rest = &mut comment[..];
        let _ = write!(rest, "{TAI_BEFORE}{}{TAI_AFTER}", captured.at.ns()); // 40 bytes are enough
        let unused = rest.len();
        put_option(body, OPTION_COMMENT, &comment[..comment.len() - unused]);
        put_option(body, OPTION_END, &[]);
    }

    /// Describes an interface; returns its place in the section.
    fn describe_interface(&mut self, (number, link_type): (u8, u16)) -> Result<usize, io::Error> {
        self.body.extend(link_type.to_le_bytes());
        self.body.extend([0; 6]); // reserved; no limit to a packet's length
        put_option(&mut self.body, OPTION_NAME, format!("{NAME_BEFORE}{number}").as_bytes());
        put_option(&mut self.body, OPTION_RESOLUTION, &[NANOSECONDS]);
        put_option(&mut self.body, OPTION_END, &[]);
        self.finish_block(INTERFACE)?;
        self.described.push((number, link_type));
        Ok(self.described.len() - 1)
    }

    /// Writes the body with its type and its length on both sides.
    fn finish_block(&mut self, kind: u32) -> Result<(), io::Error> {
        #[allow(clippy::cast_possible_truncation, reason = "blocks of ours are below 1 KiB")]
        let length = (self.body.len() as u32 + 12).to_le_bytes();
        self.out.write_all(&kind.to_le_bytes())?;
        self.out.write_all(&length)?;
        self.out.write_all(&self.body)?;
        self.body.clear();
        self.out.write_all(&length)
    }
}

fn put_option(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    body.extend(code.to_le_bytes());
    #[allow(clippy::cast_possible_truncation, reason = "options of ours are below 256 bytes")]
    body.extend((value.len() as u16).to_le_bytes());
    body.extend(value);
    pad(body);
}

fn pad(body: &mut Vec<u8>) {
    body.resize(body.len().next_multiple_of(4), 0);
}

/// Appends the SocketCAN header, big-endian, and the data.
fn put_can(data: &mut Vec<u8>, frame: &CanFrame) {
    data.extend(frame.id().flagged().to_be_bytes());
    #[allow(clippy::cast_possible_truncation, reason = "a frame has at most 64 bytes")]
    data.push(frame.data().len() as u8);
    data.push(if frame.is_fd() { CAN_FDF | CAN_BRS } else { 0 });
    data.extend([0, 0]);
    data.extend(frame.data());
}
