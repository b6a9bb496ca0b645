//! The identifier of a frame: 11 or 29 bits.

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
