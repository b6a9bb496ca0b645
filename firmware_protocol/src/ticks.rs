//! Time tags: microseconds of the sender's SCET, modulo 2^32.

/// Microseconds after which time tags wrap: 71.6 minutes.
pub const WRAP_US: i64 = 1 << 32;

/// Returns the time tag of an unwrapped count of microseconds.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the low 32 bits are the tag")]
pub const fn wrapped(us: i64) -> u32 {
    us as u32
}

/// Returns `a - b` in microseconds, from -2^31 to 2^31 - 1: below zero when `a` is the earlier of the two.
///
/// Of the differences that the wrap allows it is the smallest one: the tags must be less than 35.8 minutes apart.
pub const fn ticks_diff(a: u32, b: u32) -> i32 {
    a.wrapping_sub(b).cast_signed()
}

/// Returns how far `a` lies after `b`, in microseconds, from 0 to 2^32 - 1: for tags that are known to lie ahead.
pub const fn ticks_ahead(a: u32, b: u32) -> u32 {
    a.wrapping_sub(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_have_a_sign_across_the_wrap() {
        assert_eq!((ticks_diff(5, 2), ticks_diff(2, 5)), (3, -3));
        assert_eq!((ticks_diff(2, u32::MAX), ticks_diff(u32::MAX, 2)), (3, -3));
        assert_eq!((ticks_diff(1 << 31, 0), ticks_diff(0, 1 << 31)), (i32::MIN, i32::MIN), "half a wrap is past");
        assert_eq!(ticks_ahead(2, 5), u32::MAX - 2, "the same tags, taken as ahead");
    }

    #[test]
    fn tags_are_the_low_bits_of_a_count_before_and_after_zero() {
        for us in [-WRAP_US - 1, -1, 0, 1, WRAP_US - 1, WRAP_US, 40 * WRAP_US + 7] {
            assert_eq!(i64::from(wrapped(us)), us.rem_euclid(WRAP_US), "{us}");
        }
    }
}
