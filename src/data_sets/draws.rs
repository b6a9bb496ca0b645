//! Random numbers of one item: Philox, counted by item, purpose and draw.
//!
//! In: the seed of a data set, the number of an item (or shard), a purpose. Out: numbers that depend on nothing else, so
//! that items can be drawn in any order and on any worker. Functions are those of `libm`: the same bits on every machine.

use base::random::{Stage, attempt_counter, key, philox};
use glam::DVec3;

/// Purposes of random numbers; each has a sequence of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// Attitude of an item.
    Attitude = 0,
    /// Instant of an item.
    Time = 1,
    /// Rate of an item.
    Rate = 2,
    /// Jitter of an item.
    Jitter = 3,
    /// Faults of an item.
    Faults = 4,
    /// Targets of an item.
    Targets = 5,
    /// Keys of the camera of a shard.
    Camera = 6,
    /// Keys of the bench of a shard.
    Bench = 7,
}

/// Random numbers in order.
#[derive(Debug, Clone)]
pub struct Draws {
    key: [u32; 2],
    number: u32,
    purpose: Purpose,
    /// Blocks used.
    blocks: u32,
    words: [u32; 4],
    /// Words of the block that are used.
    used: usize,
}

impl Draws {
    /// Returns the numbers of an item or shard for a purpose.
    pub fn new(seed: u64, number: u32, purpose: Purpose) -> Self {
        Self { key: key(seed), number, purpose, blocks: 0, words: [0; 4], used: 4 }
    }

    fn word(&mut self) -> u32 {
        if self.used == self.words.len() {
            let counter = attempt_counter(self.number, self.blocks, Stage::DataSet, self.purpose as u32);
            self.words = philox(counter, self.key);
            self.blocks += 1;
            self.used = 0;
        }
        self.used += 1;
        self.words[self.used - 1]
    }

    /// Returns a number in 0 to 1, 1 excluded, with 53 bits.
    pub fn unit(&mut self) -> f64 {
        let [high, low] = [self.word(), self.word()].map(u64::from);
        ((high << 21) | (low >> 11)) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a number between two others, the second excluded.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns one of `count` places, each as likely.
    pub fn place(&mut self, count: usize) -> usize {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below `count`")]
        let place = (self.unit() * count as f64) as usize;
        place.min(count.saturating_sub(1))
    }

    /// Returns a number of mean 0 and standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(core::f64::consts::TAU * self.unit())
    }

    /// Returns a unit vector, each direction as likely.
    pub fn direction(&mut self) -> DVec3 {
        let z = self.between(-1.0, 1.0);
        let angle = self.between(0.0, core::f64::consts::TAU);
        let radius = libm::sqrt((1.0 - z * z).max(0.0));
        DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(number: u32, purpose: Purpose) -> Draws {
        Draws::new(5, number, purpose)
    }

    #[test]
    fn numbers_depend_on_seed_item_and_purpose() {
        let first = draws(3, Purpose::Attitude).unit();
        assert_eq!(first.to_bits(), draws(3, Purpose::Attitude).unit().to_bits());
        assert_ne!(first.to_bits(), draws(4, Purpose::Attitude).unit().to_bits());
        assert_ne!(first.to_bits(), draws(3, Purpose::Time).unit().to_bits());
        assert_ne!(first.to_bits(), Draws::new(6, 3, Purpose::Attitude).unit().to_bits());
    }

    #[test]
    fn moments_are_those_of_the_laws() {
        const COUNT: u32 = 20_000;
        let mut all = draws(0, Purpose::Rate);
        let (mut unit, mut normal, mut squares, mut sum) = (0.0, 0.0, 0.0, DVec3::ZERO);
        for _ in 0..COUNT {
            unit += all.unit();
            let one = all.normal();
            normal += one;
            squares += one * one;
            let direction = all.direction();
            assert!((direction.length() - 1.0).abs() < 1e-14);
            sum += direction;
        }
        let count = f64::from(COUNT);
        // Five standard errors.
        let limit = 5.0 / count.sqrt();
        assert!((unit / count - 0.5).abs() < limit * (1.0_f64 / 12.0).sqrt());
        assert!((normal / count).abs() < limit);
        assert!((squares / count - 1.0).abs() < limit * 2.0_f64.sqrt());
        assert!((sum / count).abs().max_element() < limit * (1.0_f64 / 3.0).sqrt());
    }

    #[test]
    fn places_are_all_reached_and_none_beyond() {
        let mut seen = [0; 7];
        let mut all = draws(1, Purpose::Faults);
        (0..7000).for_each(|_| seen[all.place(7)] += 1);
        // Five standard deviations of a binomial of 1/7.
        assert!(seen.iter().all(|count| (*count - 1000_i32).abs() < 147), "{seen:?}");
        assert_eq!(all.place(1), 0);
    }
}
