//! The identifier of a frame, 11 or 29 bits: message number and node <-> identifier.

use crate::{MessageId, Reject};
use core::fmt;

pub(super) const STANDARD_MAX: u16 = 0x7FF;
pub(super) const EXTENDED_MAX: u32 = 0x1FFF_FFFF;
/// Bits of an extended identifier after its first 11.
const EXTENSION_BITS: u32 = 18;
const EXTENSION: u32 = (1 << EXTENSION_BITS) - 1;
/// IDE: recessive in a frame with 29 bits.
const IDE: u32 = 1 << EXTENSION_BITS;
/// Place of the first 11 bits.
const FIRST: u32 = EXTENSION_BITS + 1;
/// Mark of 29 bits where one number says both, as in Linux, pcapng and DBC files.
const EXTENDED_FLAG: u32 = 1 << 31;

/// An identifier of 11 or 29 bits. Only identifiers that exist can be made; two of one number and unlike lengths differ.
///
/// The order is that of the arbitration (ISO 11898-1:2015, 10.4.2): the lesser identifier wins. Of one with 11 bits and
/// one with 29 that begins with the same 11, the shorter wins: it is dominant where the longer has SRR and IDE, which
/// are recessive. Kept as the bus sees it: 11 bits, IDE, 18 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct CanId {
    wire: u32,
}

impl CanId {
    /// The identifier that loses every arbitration.
    pub const LAST: Self = Self { wire: (STANDARD_MAX as u32) << FIRST | IDE | EXTENSION };

    /// Returns an identifier of 11 bits; `None` for a longer number.
    pub const fn standard(number: u16) -> Option<Self> {
        if number > STANDARD_MAX {
            return None;
        }
        Some(Self { wire: (number as u32) << FIRST })
    }

    /// Returns an identifier of 29 bits; `None` for a longer number.
    pub const fn extended(number: u32) -> Option<Self> {
        if number > EXTENDED_MAX {
            return None;
        }
        Some(Self { wire: (number >> EXTENSION_BITS) << FIRST | IDE | number & EXTENSION })
    }

    /// Returns the identifier that one number with a mark in bit 31 says, as in Linux, pcapng and DBC files; `None` when
    /// there is none of this number.
    pub fn from_flagged(flagged: u32) -> Option<Self> {
        if flagged & EXTENDED_FLAG != 0 {
            return Self::extended(flagged & !EXTENDED_FLAG);
        }
        u16::try_from(flagged).ok().and_then(Self::standard)
    }

    /// Returns the number, with bit 31 set when the identifier has 29 bits.
    pub const fn flagged(self) -> u32 {
        if self.is_extended() { self.number() | EXTENDED_FLAG } else { self.number() }
    }

    /// Returns the number without its length.
    pub const fn number(self) -> u32 {
        let first = self.wire >> FIRST;
        if self.is_extended() { first << EXTENSION_BITS | self.wire & EXTENSION } else { first }
    }

    /// Returns true for 29 bits.
    pub const fn is_extended(self) -> bool {
        self.wire & IDE != 0
    }

    /// Returns the first 11 bits, which are all of a standard identifier, and the other 18, which are 0 of one.
    pub const fn parts(self) -> (u16, u32) {
        #[allow(clippy::cast_possible_truncation, reason = "11 bits are left")]
        ((self.wire >> FIRST) as u16, self.wire & EXTENSION)
    }
}

/// Equal to a number of 16 bits when it has 11 bits and is that number.
impl PartialEq<u16> for CanId {
    fn eq(&self, standard: &u16) -> bool {
        Self::standard(*standard) == Some(*self)
    }
}

/// Hexadecimal, as log files and tools have it: 3 digits for 11 bits, 8 digits for 29.
impl fmt::UpperHex for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = if self.is_extended() { 8 } else { 3 };
        write!(f, "{:0digits$X}", self.number())
    }
}

/// The same in small letters.
impl fmt::LowerHex for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = if self.is_extended() { 8 } else { 3 };
        write!(f, "{:0digits$x}", self.number())
    }
}

/// An identifier, or a number that may be one of 11 bits.
pub trait ToCanId {
    /// Returns the identifier; `None` when no identifier has this number.
    fn to_can_id(self) -> Option<CanId>;
}

impl ToCanId for CanId {
    fn to_can_id(self) -> Option<CanId> {
        Some(self)
    }
}

impl ToCanId for u16 {
    fn to_can_id(self) -> Option<CanId> {
        CanId::standard(self)
    }
}

const NODE_BITS: u32 = 4;
const NODE_MAX: u8 = 0xF;
/// Highest identifier at base 0.
const HIGHEST: u32 = ((MessageId::Heartbeat.number() as u32) << NODE_BITS) | NODE_MAX as u32;

/// `id = base + (message << 4 | node)`, of 11 or 29 bits. SYNC is for all nodes and has node 0.
///
/// The node is that of the flight computer and star sensor pair; both ends are set to the same one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IdMap {
    base: CanId,
    node: u8,
}

impl IdMap {
    /// Highest base of identifiers with 11 bits.
    pub const BASE_MAX: u32 = (STANDARD_MAX as u32 - HIGHEST) & !0xF;
    /// Highest base of identifiers with 29 bits.
    pub const EXTENDED_BASE_MAX: u32 = (EXTENDED_MAX - HIGHEST) & !0xF;

    /// Returns a map to identifiers of 11 bits; `None` when the node exceeds 15, the base is not a multiple of 16, or
    /// the highest identifier exceeds 11 bits (base above 0x0F0).
    pub fn new(base: u16, node: u8) -> Option<Self> {
        Self::of(CanId::standard(base)?, node)
    }

    /// Returns a map to identifiers of 29 bits; `None` when the node exceeds 15, the base is not a multiple of 16, or
    /// the highest identifier exceeds 29 bits (base above 0x1FFFF8F0).
    pub fn extended(base: u32, node: u8) -> Option<Self> {
        Self::of(CanId::extended(base)?, node)
    }

    /// Returns a map from its base, which says the length of the identifiers.
    pub fn of(base: CanId, node: u8) -> Option<Self> {
        let most = if base.is_extended() { Self::EXTENDED_BASE_MAX } else { Self::BASE_MAX };
        let legal = node <= NODE_MAX && base.number().is_multiple_of(1 << NODE_BITS) && base.number() <= most;
        legal.then_some(Self { base, node })
    }

    /// Returns the identifier of a message.
    pub fn id(&self, message: MessageId) -> CanId {
        let offset = (u32::from(message.number()) << NODE_BITS) | u32::from(self.node_of(message));
        let number = self.base.number() + offset;
        let id = if self.base.is_extended() { CanId::extended(number) } else { standard(number) };
        id.unwrap_or_default() // a legal base leaves space for every offset
    }

    /// Returns the message of an identifier.
    ///
    /// # Errors
    /// [`Reject::UnknownId`] when it is none of this version's messages, meant for another node, or of the other length.
    pub fn message(&self, id: impl ToCanId) -> Result<MessageId, Reject> {
        let id = id.to_can_id().filter(|id| id.is_extended() == self.base.is_extended()).ok_or(Reject::UnknownId)?;
        let offset = id.number().checked_sub(self.base.number()).ok_or(Reject::UnknownId)?;
        let number = u8::try_from(offset >> NODE_BITS).map_err(|_| Reject::UnknownId)?;
        let message = MessageId::from_number(number)?;
        let node = u32::from(self.node_of(message));
        if offset % (1 << NODE_BITS) == node { Ok(message) } else { Err(Reject::UnknownId) }
    }

    fn node_of(&self, message: MessageId) -> u8 {
        if message == MessageId::Sync { 0 } else { self.node }
    }
}

fn standard(number: u32) -> Option<CanId> {
    u16::try_from(number).ok().and_then(CanId::standard)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::{format, string::String};

    fn extended(number: u32) -> CanId {
        CanId::extended(number).unwrap()
    }

    #[test]
    fn only_identifiers_that_exist_can_be_made_and_lengths_are_not_confused() {
        assert_eq!((CanId::standard(0x800), CanId::extended(0x2000_0000)), (None, None));
        for number in [0, 1, 0x123, 0x7FF] {
            let (short, long) = (CanId::standard(number).unwrap(), extended(u32::from(number)));
            assert_ne!(short, long);
            assert_eq!((short.number(), long.number()), (u32::from(number), u32::from(number)));
            assert_eq!((short.is_extended(), long.is_extended()), (false, true));
            assert!(short == number && long != number);
        }
        for number in [0x18FF_1234, 0x1FFF_FFFF, 0x3_FFFF, 0x4_0000] {
            assert_eq!(extended(number).number(), number);
            assert_eq!(CanId::from_flagged(extended(number).flagged()), Some(extended(number)));
            assert_eq!(extended(number).flagged(), number | 0x8000_0000);
        }
        assert_eq!(CanId::from_flagged(0x123), CanId::standard(0x123));
        assert_eq!([0x800, 0xA000_0000, 0x4000_0123].map(CanId::from_flagged), [None; 3]);
        assert_eq!(CanId::LAST, extended(0x1FFF_FFFF));
        assert_eq!(extended(0x18FF_1234).parts(), (0x63F, 0x3_1234), "11 and 18 bits");
    }

    #[test]
    fn digits_say_the_length() {
        let short = CanId::standard(0xA).unwrap();
        assert_eq!((format!("{short:X}"), format!("{:x}", extended(0xA))), ("00A".into(), "0000000a".into()));
    }

    /// Returns the bits of arbitration of a data frame as text: identifier, RTR, IDE; or SRR, IDE, 18 bits, RTR.
    fn on_the_wire(id: CanId) -> String {
        let number = id.number();
        if id.is_extended() {
            format!("{:011b}11{:018b}0", number >> 18, number % (1 << 18))
        } else {
            format!("{number:011b}00")
        }
    }

    #[test]
    fn the_order_is_that_of_the_bits_on_the_wire() {
        let shorts = [0, 1, 0x63F, 0x640, 0x7FF].map(|number| CanId::standard(number).unwrap());
        let numbers = [0, 1, 0x3_FFFF, 0x4_0000, 0x18FF_1234, 0x18FF_1235, 0x1900_0000, 0x1FFB_FFFF, 0x1FFF_FFFF];
        let all: std::vec::Vec<CanId> = shorts.into_iter().chain(numbers.map(extended)).collect();
        for (a, b) in all.iter().flat_map(|a| all.iter().map(move |b| (*a, *b))) {
            // Dominant is 0: where two first differ, the text with the 0 wins, and is the lesser.
            assert_eq!(a.cmp(&b), on_the_wire(a).cmp(&on_the_wire(b)), "{a:X} against {b:X}");
        }
        assert!(shorts[2] < extended(0x63F << 18), "the same 11 bits: the short frame wins");
        assert!(extended((0x63F << 18) | 0x3_FFFF) < shorts[3], "the next 11 bits lose");
    }
}

#[cfg(test)]
mod ids_tests {
    use super::*;

    #[test]
    fn every_message_of_every_node_maps_back_and_only_to_itself() {
        let standard = (0..=0x7FF).filter_map(CanId::standard);
        for (base, node) in [(0, 0), (0, 15), (0xF0, 3)] {
            let map = IdMap::new(base, node).unwrap();
            check(&map, standard.clone());
            assert!((0..=0x7FF).filter_map(CanId::extended).all(|id| map.message(id).is_err()), "29 bits");
        }
        for (base, node) in [(0, 0), (0x18FF_0000, 5), (0x1FFF_F8F0, 15)] {
            let map = IdMap::extended(base, node).unwrap();
            check(&map, (base.saturating_sub(0x800)..=base + 0x70F).filter_map(CanId::extended));
            assert!(standard.clone().all(|id| map.message(id).is_err()), "11 bits");
        }
    }

    fn check(map: &IdMap, ids: impl Iterator<Item = CanId>) {
        let mut count = 0;
        for (id, message) in ids.filter_map(|id| map.message(id).ok().map(|message| (id, message))) {
            assert_eq!(map.id(message), id, "{map:?}");
            count += 1;
        }
        assert_eq!(count, MessageId::ALL.len(), "one identifier each");
    }

    #[test]
    fn maps_that_do_not_fit_are_refused() {
        for (base, node) in [(0, 16), (8, 0), (0x100, 0)] {
            assert_eq!(IdMap::new(base, node), None, "base {base:#x} node {node}");
        }
        for (base, node) in [(0, 16), (8, 0), (0x1FFF_F900, 0), (0x2000_0000, 0)] {
            assert_eq!(IdMap::extended(base, node), None, "base {base:#x} node {node}");
        }
        assert_eq!((IdMap::BASE_MAX, IdMap::EXTENDED_BASE_MAX), (0x0F0, 0x1FFF_F8F0));
        assert_eq!(IdMap::new(0, 2).unwrap().message(0x203), Err(Reject::UnknownId), "another node");
        assert_eq!(IdMap::extended(0x100, 2).unwrap().id(MessageId::Attitude), CanId::extended(0x402).unwrap());
    }
}
