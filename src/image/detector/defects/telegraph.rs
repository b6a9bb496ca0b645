//! Random telegraph signal: rates up and down and a frame number -> which of two levels a pixel is at.
//!
//! A Markov chain of two states in continuous time, looked at once per frame: over a time `T`, `P(low -> high) = p (1 -
//! exp(-(u + d) T))` and `P(high -> low) = (1 - p) (1 - exp(-(u + d) T))`, with rates `u` and `d` and `p = u / (u + d)`
//! the share of time spent high (Cox and Miller, "The theory of stochastic processes", 1965, section 4.3). Levels are
//! constant within an exposure.
//!
//! The level of any frame follows from seed, place and frame number alone: one uniform per frame either sets the level,
//! clears it or leaves it, so the level is that of the latest frame whose uniform decided (coupling from the past:
//! Propp and Wilson 1996). Frame 0 is drawn from the stationary law. A level read frame after frame costs one draw.

use base::random::{Stage, counter, key, philox};

/// Rates of a telegraph signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Switches per second from low to high, while low.
    pub up_per_s: f64,
    /// Switches per second from high to low, while high.
    pub down_per_s: f64,
}

/// One signal as it goes on.
#[derive(Debug, Clone, Copy)]
pub struct Telegraph {
    /// Number of its stream of random numbers.
    stream: u32,
    /// Share of time spent high.
    high_share: f64,
    /// Below this a uniform sets the level.
    set_below: f64,
    /// From here on a uniform clears it.
    clear_from: f64,
    latest: Option<(u32, bool)>,
}

/// Result of one frame's uniform.
enum Verdict {
    High,
    Low,
    AsBefore,
}

impl Telegraph {
    /// Returns a signal with its own stream of random numbers; frames come every `frame_period_s`.
    pub fn new(rates: Rates, frame_period_s: f64, stream: u32) -> Self {
        let sum_per_s = rates.up_per_s + rates.down_per_s;
        let high_share = if sum_per_s > 0.0 { rates.up_per_s / sum_per_s } else { 0.0 };
        let mixed = 1.0 - libm::exp(-sum_per_s * frame_period_s);
        let clear_from = 1.0 - (1.0 - high_share) * mixed;
        Self { stream, high_share, set_below: high_share * mixed, clear_from, latest: None }
    }

    /// Returns whether frame `frame` is at the high level.
    pub fn is_high(&mut self, frame: u32, seed: u64) -> bool {
        let high = self.look_back(frame, seed);
        self.latest = Some((frame, high));
        high
    }

    fn look_back(&self, frame: u32, seed: u64) -> bool {
        let known = self.latest.filter(|(number, _)| *number <= frame);
        for number in (0..=frame).rev() {
            if let Some((latest, high)) = known
                && latest == number
            {
                return high;
            }
            match self.verdict(number, seed) {
                Verdict::High => return true,
                Verdict::Low => return false,
                Verdict::AsBefore => {}
            }
        }
        false
    }

    fn verdict(&self, frame: u32, seed: u64) -> Verdict {
        let [word, ..] = philox(counter(frame, self.stream, Stage::Telegraph), key(seed));
        let u = f64::from(word) / 4_294_967_296.0;
        let (set_below, clear_from) =
            if frame == 0 { (self.high_share, self.high_share) } else { (self.set_below, self.clear_from) };
        if u < set_below {
            Verdict::High
        } else if u >= clear_from {
            Verdict::Low
        } else {
            Verdict::AsBefore
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATES: Rates = Rates { up_per_s: 0.4, down_per_s: 1.1 };
    const PERIOD_S: f64 = 0.2;

    fn levels(rates: Rates, stream: u32, frames: u32) -> Vec<bool> {
        let mut signal = Telegraph::new(rates, PERIOD_S, stream);
        (0..frames).map(|frame| signal.is_high(frame, 5)).collect()
    }

    /// Returns the share of frames at the high level, and share of high frames that are low in the next and the other
    /// way round.
    fn statistics(levels: &[bool]) -> [f64; 3] {
        let count = |from: bool, to: bool| levels.windows(2).filter(|w| w[0] == from && w[1] == to).count() as f64;
        let high = levels.iter().filter(|high| **high).count() as f64;
        let down = count(true, false) / (count(true, false) + count(true, true));
        let up = count(false, true) / (count(false, true) + count(false, false));
        [high / levels.len() as f64, down, up]
    }

    /// Returns the transition matrix by its power series, not by the closed form.
    fn switching(rates: Rates) -> [f64; 2] {
        let steps = 1_000_000.0;
        let (up, down) = (rates.up_per_s * PERIOD_S / steps, rates.down_per_s * PERIOD_S / steps);
        let (mut from_high, mut from_low) = (1.0, 0.0);
        for _ in 0..1_000_000 {
            from_high = from_high * (1.0 - down) + (1.0 - from_high) * up;
            from_low = from_low * (1.0 - down) + (1.0 - from_low) * up;
        }
        [1.0 - from_high, from_low]
    }

    #[test]
    fn shares_and_rates_are_those_asked_for() {
        let frames = 200_000;
        let [high, down, up] = statistics(&levels(RATES, 3, frames));
        let [down_wanted, up_wanted] = switching(RATES);
        let share = RATES.up_per_s / (RATES.up_per_s + RATES.down_per_s);
        // Correlation over about 1 / (1.5 * 0.2) frames; five standard errors with so many fewer independent looks.
        let looks = f64::from(frames) * 0.5 * 1.5 * PERIOD_S;
        assert!((high - share).abs() < 5.0 * (share * (1.0 - share) / looks).sqrt(), "{high} for {share}");
        let error = |p: f64, n: f64| 5.0 * (p * (1.0 - p) / n).sqrt();
        assert!((down - down_wanted).abs() < error(down_wanted, high * f64::from(frames)), "{down} for {down_wanted}");
        assert!((up - up_wanted).abs() < error(up_wanted, (1.0 - high) * f64::from(frames)), "{up} for {up_wanted}");
        // The comparison sees rates that are 10 % off.
        let [_, other, _] = statistics(&levels(Rates { down_per_s: 1.21, ..RATES }, 3, frames));
        assert!((other - down_wanted).abs() > error(down_wanted, high * f64::from(frames)), "negative control");
    }

    #[test]
    fn any_frame_can_be_looked_at_alone() {
        let all = levels(Rates { up_per_s: 0.02, down_per_s: 0.03 }, 9, 3000);
        for frame in [0, 1, 2, 17, 500, 2999] {
            let mut fresh = Telegraph::new(Rates { up_per_s: 0.02, down_per_s: 0.03 }, PERIOD_S, 9);
            assert_eq!(fresh.is_high(frame, 5), all[frame as usize], "frame {frame}");
            assert_eq!(fresh.is_high(frame / 2, 5), all[(frame / 2) as usize], "and back to {}", frame / 2);
        }
        assert!(all.contains(&true) && all.contains(&false), "both levels are seen");
        assert_ne!(all, levels(Rates { up_per_s: 0.02, down_per_s: 0.03 }, 10, 3000), "another stream");
    }

    #[test]
    fn frames_at_the_start_are_stationary() {
        let share = RATES.up_per_s / (RATES.up_per_s + RATES.down_per_s);
        for frame in [0, 1, 5] {
            let n = 40_000;
            let high = (0..n).filter(|i| Telegraph::new(RATES, PERIOD_S, *i).is_high(frame, 1)).count() as f64;
            let sigma = (share * (1.0 - share) / f64::from(n)).sqrt();
            assert!((high / f64::from(n) - share).abs() < 5.0 * sigma, "frame {frame}: {high}");
        }
    }

    #[test]
    fn rates_of_zero_stay_where_they_are() {
        assert!(!levels(Rates { up_per_s: 0.0, down_per_s: 0.0 }, 1, 100).contains(&true), "never up");
        assert!(!levels(Rates { up_per_s: 1.0, down_per_s: 0.0 }, 1, 100).contains(&false), "never down");
    }
}
