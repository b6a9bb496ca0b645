//! The adapter's receive stamps -> the bench clock.
//!
//! An adapter stamps with a clock of its own, which is never set and drifts. Its stamps are exact from frame to frame;
//! the kernel's stamp of the same frame is late by the interrupt or the USB transfer, never early. So the adapter's
//! clock is placed by its quickest frame of the last two seconds: `at = hardware + min(kernel - hardware)`. Error: the
//! shortest delay itself, and the drift over two seconds (20 ppm: 40 us). Never later than the kernel's stamp. A stamp
//! that places a frame more than [`DELAY_MAX`] before the kernel's means that the adapter's clock was set: the search
//! starts again.

use base::time::{Span, Tai};

/// Two of these are remembered.
const BUCKET: Span = Span::from_ms(1000);
/// No adapter delivers a frame this late.
const DELAY_MAX: Span = Span::from_ms(500);

/// Places an adapter's stamps.
#[derive(Debug, Default)]
pub(super) struct HardwareClock {
    /// Smallest distance kernel - hardware of the bucket being filled, and where it began.
    current: Option<(Tai, i64)>,
    /// The same of the bucket before it.
    previous: Option<i64>,
}

impl HardwareClock {
    /// Returns the instant of a frame that the adapter stamped `hardware_ns` and the kernel `kernel`.
    pub(super) fn place(&mut self, hardware_ns: i64, kernel: Tai) -> Tai {
        let distance_ns = kernel.ns().saturating_sub(hardware_ns);
        self.learn(distance_ns, kernel);
        let least_ns = self.least_ns().unwrap_or(distance_ns);
        if distance_ns - least_ns > DELAY_MAX.ns() {
            *self = Self::default();
            self.learn(distance_ns, kernel);
            return kernel;
        }
        Tai::from_ns(hardware_ns.saturating_add(least_ns))
    }

    fn learn(&mut self, distance_ns: i64, kernel: Tai) {
        match &mut self.current {
            Some((began, least_ns)) if kernel - *began < BUCKET => *least_ns = distance_ns.min(*least_ns),
            Some((began, least_ns)) => {
                // After a long silence the delays before it are too old.
                self.previous = (kernel - *began < BUCKET + BUCKET).then_some(*least_ns);
                self.current = Some((kernel, distance_ns));
            }
            None => self.current = Some((kernel, distance_ns)),
        }
    }

    fn least_ns(&self) -> Option<i64> {
        let current_ns = self.current.map(|(_, least_ns)| least_ns);
        current_ns.into_iter().chain(self.previous).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_NS: i64 = 5_000_000_000;
    /// The adapter's clock began elsewhere.
    const OFFSET_NS: i64 = 1_234_567_890_123;

    /// Returns the adapter's stamp at `true_ns` when its clock runs fast by `ppm`.
    fn hardware_ns(true_ns: i64, ppm: i64) -> i64 {
        true_ns - OFFSET_NS + (true_ns - START_NS) * ppm / 1_000_000
    }

    #[test]
    fn delays_are_taken_off_up_to_the_shortest_and_the_drift() {
        for ppm in [-50, 0, 50] {
            let mut clock = HardwareClock::default();
            for n in 0..2000_i64 {
                let true_ns = START_NS + n * 5_000_000;
                // 100 us at least; up to 2 ms more in a pattern of 17.
                let delay_ns = 100_000 + (n * 7 % 17) * 125_000;
                let at = clock.place(hardware_ns(true_ns, ppm), Tai::from_ns(true_ns + delay_ns));
                let error_ns = at.ns() - true_ns;
                let drift_ns = 2_000_000 * ppm.abs() / 1000 + 1;
                assert!(error_ns <= delay_ns, "never later than the kernel's: {error_ns} ns");
                assert!((n < 17) || (error_ns - 100_000).abs() <= drift_ns, "{ppm} ppm, frame {n}: {error_ns} ns");
            }
        }
    }

    #[test]
    fn a_clock_set_again_is_found_again() {
        let mut clock = HardwareClock::default();
        for (true_ns, shift_ns) in [(0, 0), (1_000_000, 0), (2_000_000, -900_000_000), (3_000_000, -900_000_000)] {
            let kernel = Tai::from_ns(START_NS + true_ns);
            assert_eq!(clock.place(START_NS + true_ns + shift_ns, kernel), kernel, "set by {shift_ns} ns");
        }
        // Forward: the distance shrinks, and the least distance follows at once.
        let kernel = Tai::from_ns(START_NS + 4_000_000);
        assert_eq!(clock.place(START_NS + 4_000_000 + 900_000_000, kernel), kernel);
    }

    #[test]
    fn delays_before_a_silence_are_forgotten() {
        let mut clock = HardwareClock::default();
        assert_eq!(clock.place(0, Tai::from_ns(1_000)), Tai::from_ns(1_000));
        let late = 60_000_000_000;
        assert_eq!(clock.place(late, Tai::from_ns(late + 300_000)), Tai::from_ns(late + 300_000), "a minute of drift");
    }
}
