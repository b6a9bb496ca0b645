//! pcapng: the blocks that a bus capture needs, written and read.
//!
//! Written by hand, as are the readers: the needs are four kinds of blocks, an error with its offset for each
//! damage, and a file that was cut off read up to the cut.

mod read;
mod write;

pub(super) use read::PcapngReader;
pub(super) use write::PcapngWriter;

/// Section header; the same read from either end.
pub(super) const SECTION: u32 = 0x0A0D_0D0A;
const INTERFACE: u32 = 1;
const SIMPLE_PACKET: u32 = 3;
const OBSOLETE_PACKET: u32 = 2;
const ENHANCED_PACKET: u32 = 6;
/// Number that shows the byte order of a section.
const ORDER_MAGIC: u32 = 0x1A2B_3C4D;

const OPTION_END: u16 = 0;
const OPTION_COMMENT: u16 = 1;
/// Option of an interface: its name.
const OPTION_NAME: u16 = 2;
/// Option of an enhanced packet: direction and more.
const OPTION_FLAGS: u16 = 2;
/// Option of an interface: units of its stamps.
const OPTION_RESOLUTION: u16 = 9;
/// Option of an interface: seconds to add to its stamps.
const OPTION_OFFSET: u16 = 14;
/// Option of a section: the program that wrote it.
const OPTION_PROGRAM: u16 = 4;

/// LINKTYPE_CAN_SOCKETCAN.
const LINK_CAN: u16 = 227;
/// LINKTYPE_USER0: here, bytes of a serial line.
const LINK_SERIAL: u16 = 147;
/// LINKTYPE_USER1: here, a plain datagram, or a record or line of a plain stream.
const LINK_DATAGRAM: u16 = 148;

/// Flags in the identifier of a SocketCAN header: remote, error. Bit 31 says 29 bits.
const CAN_NOT_DATA: u32 = 0x6000_0000;
/// FD flag of a SocketCAN header: the frame is an FD frame.
const CAN_FDF: u8 = 0x04;
/// FD flag: bit rate switched.
const CAN_BRS: u8 = 0x01;
/// Bytes of a SocketCAN header before the data.
const CAN_HEADER: usize = 8;
/// Length of a whole FD frame's structure: old captures of FD have no flag, but this length.
const CAN_FD_STRUCTURE: usize = 72;

/// Bits of the flags option: which way a packet went.
const INBOUND: u32 = 1;
const OUTBOUND: u32 = 2;

/// Before the number in the name of an interface of ours.
const NAME_BEFORE: &str = "link";

/// Around the instant in a packet's comment.
const TAI_BEFORE: &str = "TAI ";
const TAI_AFTER: &str = " ns";
