//! GVCP: bytes of the control port -> a command, and answers -> bytes. Big-endian, over UDP.
//!
//! ```text
//! command: 0x42, flags u8, code u16, length u16, id u16, payload        answer: status u16, code + 1, length, id, payload
//! ```
//!
//! A datagram that is not a command is counted by reason and not answered; a command whose payload has the wrong length
//! is answered with an error. Codes and registers as clients use them.

use std::net::Ipv4Addr;

/// First byte of every command.
const KEY: u8 = 0x42;
/// Bytes of a command's and an answer's header.
pub(super) const HEADER_BYTES: usize = 8;
/// Most data bytes in one command or answer: 576 bytes of IP datagram less IP, UDP and GVCP headers.
pub(super) const PAYLOAD_BYTES_MAX: usize = 540;
/// Most bytes that one READMEM gives: the payload less the address.
const READ_BYTES_MAX: u16 = 536;
const WANTS_ANSWER: u8 = 0x01;
const IS_SCHEDULED: u8 = 0x80;
const HAS_LONG_BLOCK_IDS: u8 = 0x10;

/// Codes of commands; an answer has the next number.
pub(super) mod code {
    pub(in crate::network_camera) const DISCOVERY: u16 = 0x0002;
    pub(in crate::network_camera) const FORCE_ADDRESS: u16 = 0x0004;
    pub(in crate::network_camera) const RESEND: u16 = 0x0040;
    pub(in crate::network_camera) const READ_REGISTER: u16 = 0x0080;
    pub(in crate::network_camera) const WRITE_REGISTER: u16 = 0x0082;
    pub(in crate::network_camera) const READ_MEMORY: u16 = 0x0084;
    pub(in crate::network_camera) const WRITE_MEMORY: u16 = 0x0086;
    pub(in crate::network_camera) const ACTION: u16 = 0x0100;
}

/// Status of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Done.
    Success,
    /// No such command here.
    NotImplemented,
    /// A value that the register cannot take, or a payload of the wrong length.
    InvalidParameter,
    /// No such register.
    InvalidAddress,
    /// The register cannot be written.
    WriteProtect,
    /// The address is not a multiple of four.
    BadAlignment,
    /// Another application has control, or none has and this needs it.
    AccessDenied,
    /// Not while frames are acquired.
    Busy,
    /// The packet asked for is gone.
    PacketUnavailable,
    /// Too many actions wait.
    Overflow,
    /// A scheduled action came after its instant.
    ActionLate,
}

impl Status {
    /// Returns its number on the wire.
    pub const fn code(self) -> u16 {
        match self {
            Self::Success => 0,
            Self::NotImplemented => 0x8001,
            Self::InvalidParameter => 0x8002,
            Self::InvalidAddress => 0x8003,
            Self::WriteProtect => 0x8004,
            Self::BadAlignment => 0x8005,
            Self::AccessDenied => 0x8006,
            Self::Busy => 0x8007,
            Self::PacketUnavailable => 0x800C,
            Self::Overflow => 0x8015,
            Self::ActionLate => 0x8016,
        }
    }
}

base::words! {
    /// Reason why a datagram was not a command, or cannot be carried out.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Malformed {
        /// Shorter than a header.
        TooShort = "too_short",
        /// The first byte is not that of a command.
        WrongKey = "wrong_key",
        /// The length field differs from the bytes that follow.
        WrongLength = "wrong_length",
        /// The payload's length does not fit the command.
        WrongPayload = "wrong_payload",
        /// A command that this device does not know.
        UnknownCommand = "unknown_command",
    }
}

/// A command with the head that its answer repeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Request<'a> {
    pub(super) wants_answer: bool,
    pub(super) code: u16,
    pub(super) id: u16,
    pub(super) command: Command<'a>,
}

/// A request of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Command<'a> {
    Discovery,
    /// A device of this hardware address is to have this address and mask.
    ForceAddress {
        mac: [u8; 6],
        address: Ipv4Addr,
        mask: Ipv4Addr,
    },
    /// Packets `first` to `last` of a block, of stream channel 0.
    Resend(Resend),
    /// Addresses, four bytes each.
    ReadRegisters(&'a [[u8; 4]]),
    /// Addresses and values, four bytes each, by turns.
    WriteRegisters(&'a [[u8; 4]]),
    ReadMemory {
        address: u32,
        bytes: usize,
    },
    WriteMemory {
        address: u32,
        words: &'a [[u8; 4]],
    },
    Action(Action),
    Bad(Malformed),
}

impl Command<'_> {
    /// Returns true for commands that look for devices, or address many; all others go to one device.
    pub(super) fn may_be_broadcast(&self) -> bool {
        matches!(self, Self::Discovery | Self::ForceAddress { .. } | Self::Action(_))
    }

    /// Returns true for commands that change the device or its actions: they are carried out once, however often they
    /// come.
    pub(super) fn is_change(&self) -> bool {
        matches!(self, Self::WriteRegisters(_) | Self::WriteMemory { .. } | Self::Action(_))
    }
}

/// Packets that a client has not got.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resend {
    /// Block (frame) of the stream.
    pub block: u16,
    /// First packet, 0 being the leader.
    pub first: u32,
    /// Last packet.
    pub last: u32,
}

impl Resend {
    /// Returns the number of packets.
    pub fn packets(&self) -> u64 {
        u64::from(self.last - self.first) + 1
    }
}

/// A trigger for many cameras at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Action {
    pub(super) device_key: u32,
    pub(super) group_key: u32,
    pub(super) group_mask: u32,
    /// When it is to act, ticks of the device; `None`: at once.
    pub(super) at_ns: Option<u64>,
}

/// Reads one datagram.
pub(super) fn parse(bytes: &[u8]) -> Result<Request<'_>, Malformed> {
    let (head, payload) = bytes.split_first_chunk::<HEADER_BYTES>().ok_or(Malformed::TooShort)?;
    let [key, flags, code_high, code_low, length_high, length_low, id_high, id_low] = *head;
    if key != KEY {
        return Err(Malformed::WrongKey);
    }
    if usize::from(u16::from_be_bytes([length_high, length_low])) != payload.len() {
        return Err(Malformed::WrongLength);
    }
    let code = u16::from_be_bytes([code_high, code_low]);
    let command = command(code, flags, payload).unwrap_or(Command::Bad(Malformed::WrongPayload));
    let id = u16::from_be_bytes([id_high, id_low]);
    Ok(Request { wants_answer: flags & WANTS_ANSWER != 0, code, id, command })
}

/// Reads a command; `None` when the payload's length does not fit.
fn command(code: u16, flags: u8, payload: &[u8]) -> Option<Command<'_>> {
    let (words, rest) = payload.as_chunks::<4>();
    let word = |place: usize| words.get(place).map(|word| u32::from_be_bytes(*word));
    let is_whole = rest.is_empty() && payload.len() <= PAYLOAD_BYTES_MAX;
    match code {
        code::DISCOVERY => payload.is_empty().then_some(Command::Discovery),
        code::FORCE_ADDRESS => force_address(payload),
        code::RESEND => {
            let block = u16::try_from(word(0)? & 0xFFFF).ok()?;
            let is_ours = words.len() == 3 && is_whole && flags & HAS_LONG_BLOCK_IDS == 0 && word(0)? >> 16 == 0;
            let [first, last] = [word(1)? & 0xFF_FFFF, word(2)? & 0xFF_FFFF];
            (is_ours && first <= last).then_some(Command::Resend(Resend { block, first, last }))
        }
        code::READ_REGISTER => (is_whole && !words.is_empty()).then_some(Command::ReadRegisters(words)),
        code::WRITE_REGISTER => {
            (is_whole && !words.is_empty() && words.len() % 2 == 0).then_some(Command::WriteRegisters(words))
        }
        code::READ_MEMORY => {
            let bytes = u16::try_from(word(1)? & 0xFFFF).ok()?;
            let is_read = words.len() == 2 && is_whole && bytes % 4 == 0 && (4..=READ_BYTES_MAX).contains(&bytes);
            is_read.then_some(Command::ReadMemory { address: word(0)?, bytes: bytes.into() })
        }
        code::WRITE_MEMORY => {
            let (_, data) = words.split_first()?;
            (is_whole && !data.is_empty()).then_some(Command::WriteMemory { address: word(0)?, words: data })
        }
        code::ACTION => {
            let is_scheduled = flags & IS_SCHEDULED != 0;
            let at_ns = if is_scheduled { Some(u64::from(word(3)?) << 32 | u64::from(word(4)?)) } else { None };
            let action = Action { device_key: word(0)?, group_key: word(1)?, group_mask: word(2)?, at_ns };
            (words.len() == if is_scheduled { 5 } else { 3 } && is_whole).then_some(Command::Action(action))
        }
        _ => Some(Command::Bad(Malformed::UnknownCommand)),
    }
}

/// Reads a FORCEIP command: each value is at the end of a field of its own.
fn force_address(payload: &[u8]) -> Option<Command<'_>> {
    let payload: &[u8; 56] = payload.try_into().ok()?;
    let [_, _, mac @ ..] = payload.first_chunk::<8>()?;
    let address = |end: usize| Some(Ipv4Addr::from(*payload.get(..end)?.last_chunk::<4>()?));
    Some(Command::ForceAddress { mac: *mac, address: address(24)?, mask: address(40)? })
}

/// Puts the head of an answer into `out`, in place of its old contents.
pub(super) fn begin_answer(request_code: u16, id: u16, out: &mut Vec<u8>) {
    out.clear();
    out.extend(0_u16.to_be_bytes());
    out.extend(request_code.wrapping_add(1).to_be_bytes());
    out.extend(0_u16.to_be_bytes());
    out.extend(id.to_be_bytes());
}

/// Fills in status and length.
pub(super) fn end_answer(status: Status, out: &mut [u8]) {
    let length = u16::try_from(out.len().saturating_sub(HEADER_BYTES)).unwrap_or(u16::MAX);
    if let Some((head, _)) = out.split_first_chunk_mut::<HEADER_BYTES>() {
        head[..2].copy_from_slice(&status.code().to_be_bytes());
        head[4..6].copy_from_slice(&length.to_be_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn datagram(flags: u8, code: u16, payload: &[u8]) -> Vec<u8> {
        let length = u16::try_from(payload.len()).unwrap();
        [&[KEY, flags][..], &code.to_be_bytes(), &length.to_be_bytes(), &[0x12, 0x34], payload].concat()
    }

    fn read(flags: u8, code: u16, payload: &[u8]) -> Command<'static> {
        let bytes = datagram(flags, code, payload).leak();
        let request = parse(bytes).unwrap();
        assert_eq!((request.id, request.code, request.wants_answer), (0x1234, code, flags & 1 == 1));
        request.command
    }

    const BAD: Command<'static> = Command::Bad(Malformed::WrongPayload);

    #[test]
    fn commands_by_hand() {
        assert_eq!(read(0x11, code::DISCOVERY, &[]), Command::Discovery);
        let resend = [0, 0, 0, 7, 0, 0, 0, 2, 0, 0, 0, 9];
        assert_eq!(read(0, code::RESEND, &resend), Command::Resend(Resend { block: 7, first: 2, last: 9 }));
        assert_eq!(read(0x10, code::RESEND, &resend), BAD, "long block identifiers");
        assert_eq!(read(0, code::RESEND, &[0, 1, 0, 7, 0, 0, 0, 2, 0, 0, 0, 9]), BAD, "another channel");
        assert_eq!(read(0, code::RESEND, &[0, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0, 2]), BAD, "backwards");
        assert_eq!(
            read(1, code::READ_MEMORY, &[0, 2, 0, 0, 0, 0, 2, 0]),
            Command::ReadMemory { address: 0x2_0000, bytes: 512 }
        );
        for count in [0_u16, 3, 540, 0xFFFF] {
            assert_eq!(
                read(1, code::READ_MEMORY, &[&[0, 2, 0, 0, 0, 0][..], &count.to_be_bytes()].concat()),
                BAD,
                "{count}"
            );
        }
        assert_eq!(read(1, code::WRITE_REGISTER, &[0; 12]), BAD, "an address without a value");
        assert_eq!(read(0x81, code::ACTION, &[0; 12]), BAD, "scheduled, without a time");
        let at_ns = Some(0x0000_0001_0000_0002);
        let scheduled = [[0, 0, 0, 5], [0, 0, 0, 6], [0, 0, 0, 7], [0, 0, 0, 1], [0, 0, 0, 2]].concat();
        let action = Action { device_key: 5, group_key: 6, group_mask: 7, at_ns };
        assert_eq!(read(0x81, code::ACTION, &scheduled), Command::Action(action));
        assert_eq!(read(0x01, code::ACTION, &scheduled), BAD, "a time that no flag announces");
        let force: [u8; 56] = core::array::from_fn(|at| u8::try_from(at).unwrap());
        let (mac, address, mask) = ([2, 3, 4, 5, 6, 7], Ipv4Addr::new(20, 21, 22, 23), Ipv4Addr::new(36, 37, 38, 39));
        assert_eq!(read(1, code::FORCE_ADDRESS, &force), Command::ForceAddress { mac, address, mask });
        assert_eq!(read(1, code::FORCE_ADDRESS, &force[..52]), BAD, "without a gateway");
        assert_eq!(read(1, 0x00C0, &[]), Command::Bad(Malformed::UnknownCommand));
    }

    #[test]
    fn malformed_commands_have_a_reason() {
        let whole = datagram(1, code::DISCOVERY, &[]);
        assert_eq!(parse(&whole[..7]), Err(Malformed::TooShort));
        assert_eq!(parse(&[&whole[..], &[0]].concat()), Err(Malformed::WrongLength));
        assert_eq!(parse(&[0; 8]), Err(Malformed::WrongKey));
        parse(&whole).unwrap();
    }
}
