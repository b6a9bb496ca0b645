//! Light between two greys by time: which refreshes show the brighter one.
//!
//! Of N refreshes (N a power of two) a pixel whose wanted luminance lies at `share` of the step between two greys shows
//! the brighter grey in round(share N): the refreshes whose threshold lies below the share. Thresholds are (b + 1/2) /
//! N, b the bit-reversed number of the refresh (van der Corput 1935), so that bright refreshes lie as evenly in time as
//! can be. Each pixel begins elsewhere in the cycle (Philox of its place): neighbours do not flicker together, and the
//! light of a star, which several pixels share, is steadier than that of each. The same refresh shows the same.
//!
//! Bounds, in units of the luminance step between the two greys (`tests` below, all shares and starts): the mean of any
//! N consecutive refreshes is off by at most 1 / (2 N); that of any M < N by at most (log2(N) + 2) / (2 M) and never
//! more than 1. In luminance, not in grey: the two greys are those of the measured response.

use base::random::philox;

/// Longest cycle, refreshes: a pixel's place in it is one byte.
pub const LONGEST_CYCLE: u32 = 256;

/// A cycle that there is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("dither over {got} refreshes: wanted 1 (none), 2, 4, 8, 16, 32, 64, 128 or {LONGEST_CYCLE}")]
pub struct CycleError {
    /// Refreshes asked for.
    pub got: u32,
}

/// Key of the pixels' starts; any will do, but it must stay.
const KEY: [u32; 2] = [0x6469_7468, 0x6572_0001];

/// A cycle of refreshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dither {
    cycle: u32,
}

impl Dither {
    /// Returns the cycle of so many refreshes: a power of two, 1 (none: the nearer grey) to [`LONGEST_CYCLE`].
    ///
    /// # Errors
    /// When the length is not a power of two within these limits.
    pub fn over(refreshes: u32) -> Result<Self, CycleError> {
        let is_cycle = refreshes.is_power_of_two() && refreshes <= LONGEST_CYCLE;
        if is_cycle { Ok(Self { cycle: refreshes }) } else { Err(CycleError { got: refreshes }) }
    }

    /// Refreshes of one cycle.
    pub fn cycle(self) -> u32 {
        self.cycle
    }

    /// Returns the largest error of the mean over one cycle, steps between greys.
    pub fn bound(self) -> f64 {
        0.5 / f64::from(self.cycle)
    }

    /// Returns where in the cycle a pixel begins.
    pub fn start(self, x: u32, y: u32) -> u8 {
        #[allow(clippy::cast_possible_truncation, reason = "below the cycle, which is 256 at most")]
        let start = (philox([x, y, 0, 0], KEY)[0] & (self.cycle - 1)) as u8;
        start
    }

    /// Returns the threshold of a refresh for a pixel that begins at `start`: the brighter grey where the share is
    /// above it.
    pub fn threshold(self, refresh: u64, start: u8) -> f32 {
        let mask = u64::from(self.cycle - 1);
        #[allow(clippy::cast_possible_truncation, reason = "masked to 8 bits")]
        let place = ((refresh & mask) + u64::from(start)) as u32 & (self.cycle - 1);
        let bits = self.cycle.trailing_zeros();
        let reversed = if bits == 0 { 0 } else { place.reverse_bits() >> (32 - bits) };
        (reversed as f32 + 0.5) / self.cycle as f32
    }

    /// Returns whether a refresh shows the brighter of the two greys.
    pub fn is_brighter(self, share: f32, refresh: u64, start: u8) -> bool {
        share > self.threshold(refresh, start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(dither: Dither, share: f32, first: u64, count: u64, start: u8) -> f64 {
        let lit = (first..first + count).filter(|refresh| dither.is_brighter(share, *refresh, start)).count();
        lit as f64 / count as f64
    }

    #[test]
    fn the_mean_of_a_cycle_is_what_was_wanted() {
        for cycle in [1, 2, 4, 16, 64, 256] {
            let dither = Dither::over(cycle).unwrap();
            for k in 0..=200 {
                let share = k as f32 / 200.0;
                for first in [0, 1, 7, 1_000_003] {
                    let found = mean(dither, share, first, u64::from(cycle), dither.start(9, 4));
                    let error = (found - f64::from(share)).abs();
                    assert!(error <= dither.bound() + 1e-6, "cycle {cycle}, share {share}: {found}");
                }
            }
        }
        let short = (mean(Dither::over(4).unwrap(), 0.4, 0, 4, 0) - 0.4).abs();
        assert!(short > Dither::over(64).unwrap().bound(), "a short cycle is coarser: {short}");
    }

    #[test]
    fn part_of_a_cycle_is_bounded_too() {
        let dither = Dither::over(64).unwrap();
        let mut worst = 0.0_f64;
        for count in 1..64 {
            for first in 0..64 {
                for k in 0..=64 {
                    let share = (k as f32 + 0.3) / 65.0;
                    let error = (mean(dither, share, first, count, 0) - f64::from(share)).abs();
                    let bound = ((64_f64.log2() + 2.0) / (2.0 * count as f64)).min(1.0);
                    assert!(error <= bound, "{count} refreshes from {first}, share {share}: {error} > {bound}");
                    worst = worst.max(error * count as f64);
                }
            }
        }
        assert!(worst > 1.0, "the bound is not idle: {worst}");
    }

    #[test]
    fn pixels_begin_everywhere_and_always_there() {
        let dither = Dither::over(16).unwrap();
        let mut counts = [0_u32; 16];
        for (x, y) in (0..64).flat_map(|x| (0..64).map(move |y| (x, y))) {
            counts[usize::from(dither.start(x, y))] += 1;
            assert_eq!(dither.start(x, y), dither.start(x, y));
        }
        // 256 expected, standard deviation 15.5; the numbers are fixed.
        assert!(counts.iter().all(|count| (180..330).contains(count)), "{counts:?}");
    }

    #[test]
    fn no_dither_is_the_nearer_grey() {
        let none = Dither::over(1).unwrap();
        assert_eq!((none.cycle(), none.is_brighter(0.49, 3, 0), none.is_brighter(0.51, 3, 0)), (1, false, true));
    }

    #[test]
    fn a_cycle_that_there_is_not_is_refused() {
        for got in [0, 3, 5, 255, 257, 512] {
            let reported = Dither::over(got).unwrap_err().to_string();
            assert!(
                reported.contains(&format!("over {got} refreshes")) && reported.contains("64, 128 or 256"),
                "{reported}"
            );
        }
        assert_eq!([1, 256].map(|cycle| Dither::over(cycle).unwrap().cycle()), [1, 256], "both ends");
    }
}
