//! Distance of the marks' delays from their floor: the scale of queueing, learnt from the marks.
//!
//! Input: heights of marks above the line, ns. Output: `s`, the mean of the exponential law that has as many delays
//! near the floor. The octile (1/8 of the marks lie below it) is followed by steps in proportion to itself, down by 7
//! parts with a mark below it and up by 1 with one above; `s` is the octile over `-ln(7/8)`. Only marks near the floor
//! count, so late marks (10 % or 50 % of them) hardly matter. Steps shrink from 0.8 to 1/20: learnt within some 30
//! marks.

/// Initial `s`, ns: more than most links have, so that the first lines get a low weight.
const FIRST_NS: f64 = 100_000.0;
/// Lower limit of `s`: the resolution of stamps (SCET counts 60 ns), ns.
const LEAST_NS: f64 = 60.0;
/// `-ln(7/8)`.
const OCTILE_OF_EXPONENTIAL: f64 = 0.133_531_392_624_522_62;
/// Largest and smallest step.
const GAIN: (f64, f64) = (0.8, 0.05);

/// The present scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DelayFloor {
    octile_ns: f64,
    marks: u32,
}

impl DelayFloor {
    pub(super) fn new() -> Self {
        Self { octile_ns: FIRST_NS * OCTILE_OF_EXPONENTIAL, marks: 0 }
    }

    /// Returns `s`, ns.
    pub(super) fn scale_ns(&self) -> f64 {
        (self.octile_ns / OCTILE_OF_EXPONENTIAL).max(LEAST_NS)
    }

    /// Updates the scale with a mark's height above the line. A mark below counts like one above: it shows the line's
    /// error, and must not reduce its uncertainty.
    pub(super) fn observe(&mut self, above_ns: f64) {
        self.marks = self.marks.saturating_add(1);
        let gain = (1.0 / (1.0 + f64::from(self.marks) / 4.0)).clamp(GAIN.1, GAIN.0);
        self.octile_ns *= if above_ns.abs() < self.octile_ns { 1.0 - gain * 0.875 } else { 1.0 + gain * 0.125 };
        self.octile_ns = self.octile_ns.max(LEAST_NS * OCTILE_OF_EXPONENTIAL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::{key, philox};

    fn learnt_ns(mean_ns: f64, late_share: f64, marks: u32) -> f64 {
        let mut floor = DelayFloor::new();
        for i in 0..marks {
            let [a, b, ..] = philox([i, 0, 0, 0], key(3)).map(|word| (f64::from(word) + 0.5) / 4_294_967_296.0);
            floor.observe(if b < late_share { 5e6 * a } else { -mean_ns * a.ln() });
        }
        floor.scale_ns()
    }

    #[test]
    fn the_scale_is_learnt_and_late_marks_hardly_matter() {
        for mean_ns in [500.0, 20_000.0, 300_000.0] {
            // With a step of 1/20 per mark the octile is known to a factor of 1.6.
            let ratio = learnt_ns(mean_ns, 0.0, 400) / mean_ns;
            assert!((0.6..1.6).contains(&ratio), "{ratio} of {mean_ns} ns");
            let ratio = learnt_ns(mean_ns, 0.3, 400) / mean_ns;
            assert!((0.7..2.6).contains(&ratio), "{ratio} of {mean_ns} ns with 30 % late");
        }
    }

    #[test]
    fn a_constant_delay_ends_at_the_grain_of_the_stamps() {
        let mut floor = DelayFloor::new();
        (0..100).for_each(|_| floor.observe(0.0));
        assert_eq!(floor.scale_ns(), LEAST_NS);
    }
}
