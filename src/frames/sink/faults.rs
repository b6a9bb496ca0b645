//! Which commanded faults were active in a frame: a small set in one word; the list of the flags is in `frame_fault`.

use core::fmt;
use core::ops::{BitOr, BitOrAssign};

/// Set of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct FaultFlags(u32);

/// Makes the constants and the names of a list of flags.
macro_rules! flags {
    ($($(#[$doc:meta])* $constant:ident = $bit:literal, $name:literal;)*) => {
        impl FaultFlags {
            $($(#[$doc])* pub const $constant: Self = Self::from_bits(1 << $bit);)*

            /// Every fault there is, with its name in files, by bit.
            pub const NAMED: &'static [(Self, &'static str)] = &[$((Self::$constant, $name)),*];
        }
    };
}

pub(super) use flags;

impl FaultFlags {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// Returns the set as a word, for files and the wire.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Returns the set from a word; bits without a name are kept.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Returns whether no fault is in the set.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns whether every fault of `other` is in the set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the names in the set, by bit.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMED.iter().filter(move |(fault, _)| self.contains(*fault)).map(|&(_, name)| name)
    }
}

impl BitOr for FaultFlags {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for FaultFlags {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl fmt::Display for FaultFlags {
    /// Writes `none`, or the names joined by `+`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        for (i, name) in self.names().enumerate() {
            write!(f, "{}{name}", if i == 0 { "" } else { "+" })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_and_names_are_unique_and_found_again() {
        let mut all = FaultFlags::NONE;
        for &(fault, name) in FaultFlags::NAMED {
            assert!(!all.contains(fault), "{name} shares a bit");
            assert_eq!(fault.names().collect::<Vec<_>>(), [name]);
            all |= fault;
        }
        assert_eq!(all.names().count(), FaultFlags::NAMED.len());
    }

    #[test]
    fn text_names_what_is_active() {
        assert_eq!(FaultFlags::NONE.to_string(), "none");
        assert_eq!((FaultFlags::HOT_PIXELS | FaultFlags::LINK_DROP).to_string(), "link_drop+hot_pixels");
    }
}
