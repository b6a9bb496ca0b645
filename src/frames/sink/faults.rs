//! Which commanded faults were active in a frame: a small set in one word.

use core::fmt;
use core::ops::{BitOr, BitOrAssign};

/// Set of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct FaultFlags(u32);

macro_rules! faults {
    ($($(#[$doc:meta])* $constant:ident = $bit:literal, $name:literal;)*) => {
        impl FaultFlags {
            $($(#[$doc])* pub const $constant: Self = Self(1 << $bit);)*

            /// Every fault there is, with its name in files, by bit.
            pub const NAMED: &'static [(Self, &'static str)] = &[$((Self::$constant, $name)),*];
        }
    };
}

faults! {
    /// Messages lost on the link.
    LINK_DROP = 0, "link_drop";
    /// Messages repeated on the link.
    LINK_DUPLICATE = 1, "link_duplicate";
    /// Messages delayed on the link.
    LINK_DELAY = 2, "link_delay";
    /// Messages out of order on the link.
    LINK_REORDER = 3, "link_reorder";
    /// Messages with wrong bits or a wrong CRC on the link.
    LINK_CORRUPT = 4, "link_corrupt";
    /// An attitude stream that repeats an old value or stops.
    LINK_STALE = 5, "link_stale";
    /// A step of a clock.
    CLOCK_STEP = 6, "clock_step";
    /// A quaternion that is not finite or not of unit norm.
    BAD_QUATERNION = 7, "bad_quaternion";
    /// A frame withheld.
    FRAME_DROP = 8, "frame_drop";
    /// A frame sent twice.
    FRAME_DUPLICATE = 9, "frame_duplicate";
    /// A frame sent late on purpose.
    FRAME_LATE = 10, "frame_late";
    /// A frame made of two.
    FRAME_TORN = 11, "frame_torn";
    /// Pixels that do not respond.
    DEAD_PIXELS = 12, "dead_pixels";
    /// Pixels with excess dark signal.
    HOT_PIXELS = 13, "hot_pixels";
    /// Pixels with random telegraph signal.
    RTS_PIXELS = 14, "rts_pixels";
    /// Stars that are in no catalog.
    FALSE_STARS = 15, "false_stars";
    /// Catalog stars left out.
    MISSING_STARS = 16, "missing_stars";
    /// Tracks of energetic protons.
    PROTON_TRACKS = 17, "proton_tracks";
    /// Stray light beyond the scene's own.
    STRAY_LIGHT = 18, "stray_light";
    /// A blank image in place of the scene.
    BLANK = 19, "blank";
    /// Packets of nonsense on the link.
    LINK_BABBLE = 20, "link_babble";
    /// The controller off the bus.
    LINK_OFF = 21, "link_off";
    /// A drift of a clock.
    CLOCK_DRIFT = 22, "clock_drift";
    /// Bits of pixels the other way.
    FRAME_BIT_FLIP = 23, "frame_bit_flip";
    /// Another point-spread function.
    DEFOCUS = 24, "defocus";
    /// Optics that let less light through.
    CONTAMINATION = 25, "contamination";
    /// A detector at another temperature.
    TEMPERATURE = 26, "temperature";
    /// Pixels flooded with light.
    SATURATION = 27, "saturation";
    /// Pixels that always read the same number.
    STUCK_PIXELS = 28, "stuck_pixels";
}

impl FaultFlags {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// The set as a word, for files and the wire.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The set from a word; bits without a name are kept.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// True when no fault is in the set.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// True when every fault of `other` is in the set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The names in the set, by bit.
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
    /// `none`, or the names joined by `+`.
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
