//! Time tags of the remote clock -> unwrapped microseconds.

use firmware_protocol::ticks::{ticks_diff, wrapped};

/// Returns the count of microseconds nearest to `near_us` whose low 32 bits are `t_us`.
pub(super) fn unwrapped_us(t_us: u32, near_us: i64) -> i64 {
    near_us.saturating_add(i64::from(ticks_diff(t_us, wrapped(near_us))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::ticks::WRAP_US;

    #[test]
    fn the_nearest_count_is_meant_on_both_sides_of_half_a_wrap() {
        let half = WRAP_US / 2;
        assert_eq!(unwrapped_us(0, half - 1), 0);
        assert_eq!(unwrapped_us(0, half), 0);
        assert_eq!(unwrapped_us(0, half + 1), WRAP_US);
    }
}
