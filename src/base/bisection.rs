//! Zeros by halving an interval.

/// Halves an interval so many times; returns its ends: the first lies before the change, the second after it.
///
/// `is_before` holds at the first end and not at the second; the ends may be in either order.
pub fn halved(between: [f64; 2], halvings: u32, is_before: impl Fn(f64) -> bool) -> [f64; 2] {
    let [mut before, mut after] = between;
    for _ in 0..halvings {
        let middle = 0.5 * (before + after);
        *(if is_before(middle) { &mut before } else { &mut after }) = middle;
    }
    [before, after]
}

/// Returns the middle of [`halved`].
pub fn bisected(between: [f64; 2], halvings: u32, is_before: impl Fn(f64) -> bool) -> f64 {
    let [before, after] = halved(between, halvings, is_before);
    0.5 * (before + after)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_of_two_is_found_from_either_side() {
        assert!((bisected([0.0, 2.0], 60, |x| x * x < 2.0) - 2.0_f64.sqrt()).abs() < 1e-15);
        assert!((bisected([2.0, 0.0], 60, |x| x * x > 2.0) - 2.0_f64.sqrt()).abs() < 1e-15);
        let [below, above] = halved([0.0, 2.0], 3, |x| x * x < 2.0);
        assert_eq!([below, above], [1.25, 1.5]);
    }
}
