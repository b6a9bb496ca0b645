//! The remote clock on the wire: SCET in time marks, low 32 bits of its microseconds in everything else.

use crate::base::units::NS_PER_S;

/// Microseconds after which `t_us` wraps: 71.6 minutes.
const WRAP_US: i64 = 1 << 32;

/// Nanoseconds of a SCET of whole seconds and a fraction in 2^-24 s (only its low 24 bits count), rounded down.
#[must_use]
pub fn scet_ns(seconds: u32, fraction_2_24: u32) -> i64 {
    let fraction = i64::from(fraction_2_24 & 0x00FF_FFFF);
    i64::from(seconds) * NS_PER_S + ((fraction * NS_PER_S) >> 24)
}

/// The tick count that messages carry at a remote time: whole microseconds, modulo 2^32.
#[must_use]
pub fn remote_ticks_us(remote_ns: i64) -> u32 {
    u32::try_from(remote_ns.div_euclid(1000).rem_euclid(WRAP_US)).unwrap_or_default()
}

/// The count nearest to `near_us` whose low 32 bits are `t_us`.
pub(super) fn unwrapped_us(t_us: u32, near_us: i64) -> i64 {
    let ahead = (i64::from(t_us) - near_us.rem_euclid(WRAP_US)).rem_euclid(WRAP_US);
    let nearest = if ahead >= WRAP_US / 2 { ahead - WRAP_US } else { ahead };
    near_us.saturating_add(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scet_fraction_is_2_to_the_minus_24() {
        assert_eq!(scet_ns(3, 0x0080_0000), 3_500_000_000);
        assert_eq!(scet_ns(0, 1), 59, "59.6 ns, rounded down");
        assert_eq!(scet_ns(0, 0xFF00_0000), 0, "high byte is no part of the fraction");
    }

    #[test]
    fn the_nearest_count_is_meant_on_both_sides_of_half_a_wrap() {
        let half = WRAP_US / 2;
        assert_eq!(unwrapped_us(0, half - 1), 0);
        assert_eq!(unwrapped_us(0, half), 0);
        assert_eq!(unwrapped_us(0, half + 1), WRAP_US);
    }
}
