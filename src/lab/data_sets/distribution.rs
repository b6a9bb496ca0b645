//! Values that are drawn: a table with the name of a distribution in place of a value.
//!
//! In: a TOML value, such as `{ uniform = [0.0, 2.0] }`, `[1, { normal = [0, 0.1] }]` or a plain number. Out: the same
//! value with a number in the place of every distribution. Distributions: `uniform` and `log_uniform` (two limits),
//! `normal` (mean, standard deviation), `integer` (two limits, both included), `choice` (a list of values).
//!
//! Random numbers of one item: Philox, counted by item, purpose and draw.
//!
//! In: the seed of a data set, the number of an item (or shard), a purpose. Out: numbers that depend on nothing else, so
//! that items can be drawn in any order and on any worker. Functions are those of `libm`: the same bits on every machine.

use anyhow::{Context, Result, bail};
use base::random::{Stage, attempt_counter, key, philox};
use glam::DVec3;
use toml::{Table, Value};

/// Names of distributions.
const NAMES: [&str; 5] = ["uniform", "log_uniform", "normal", "integer", "choice"];

/// A law that values are drawn from.
#[derive(Debug, Clone, PartialEq)]
enum Law<'v> {
    Uniform([f64; 2]),
    LogUniform([f64; 2]),
    Normal([f64; 2]),
    Integer([i64; 2]),
    Choice(&'v [Value]),
}

impl<'v> Law<'v> {
    /// Returns the law of a table with one key that names a distribution; `None` for any other value.
    ///
    /// # Errors
    /// When its numbers do not describe a distribution.
    fn of(value: &'v Value) -> Result<Option<Self>> {
        let Some((name, given)) = value.as_table().and_then(named) else { return Ok(None) };
        let pair = || pair_of(given).with_context(|| format!("{name} = {given}"));
        let ordered = || {
            let [low, high] = pair()?;
            if low > high {
                bail!("{name}: got {low} to {high}, wanted the smaller limit first")
            } else {
                Ok([low, high])
            }
        };
        Ok(Some(match name {
            "uniform" => Self::Uniform(ordered()?),
            "log_uniform" => match ordered()? {
                [low, _] if low <= 0.0 => bail!("log_uniform: got {low}, wanted limits above 0"),
                limits => Self::LogUniform(limits),
            },
            "normal" => match pair()? {
                [_, deviation] if deviation < 0.0 => {
                    bail!("normal: got a standard deviation of {deviation}, wanted 0 or more")
                }
                numbers => Self::Normal(numbers),
            },
            "integer" => {
                let [low, high] = ordered()?;
                if low.fract() != 0.0 || high.fract() != 0.0 || low.abs().max(high.abs()) > 1e15 {
                    bail!("integer: got {low} to {high}, wanted whole limits");
                }
                #[allow(clippy::cast_possible_truncation, reason = "whole and below 1e15")]
                let limits = [low as i64, high as i64];
                Self::Integer(limits)
            }
            _choice => match given.as_array() {
                Some(values) if !values.is_empty() => Self::Choice(values),
                Some(_) | None => bail!("choice: got {given}, wanted a list of values"),
            },
        }))
    }

    fn draw(&self, draws: &mut Draws) -> Value {
        match *self {
            Self::Uniform([low, high]) => Value::Float(draws.between(low, high)),
            Self::LogUniform([low, high]) => {
                Value::Float(libm::exp(draws.between(libm::log(low), libm::log(high))).clamp(low, high))
            }
            Self::Normal([mean, deviation]) => Value::Float(mean + deviation * draws.normal()),
            Self::Integer([low, high]) => {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limits below 1e15")]
                let place = draws.place((high - low + 1) as usize) as i64;
                Value::Integer(low + place)
            }
            Self::Choice(values) => values[draws.place(values.len())].clone(),
        }
    }
}

fn named(table: &Table) -> Option<(&str, &Value)> {
    let (name, given) = table.iter().next().filter(|_| table.len() == 1)?;
    NAMES.contains(&name.as_str()).then_some((name, given))
}

fn pair_of(given: &Value) -> Result<[f64; 2]> {
    let numbers: Option<Vec<f64>> = given.as_array().map(|list| list.iter().filter_map(number_of).collect());
    match numbers.as_deref() {
        Some(&[a, b]) if a.is_finite() && b.is_finite() => Ok([a, b]),
        Some(_) | None => bail!("wanted two numbers"),
    }
}

/// Returns a number that was written as a whole one or with a fraction.
pub fn number_of(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// Checks every distribution within a value.
///
/// # Errors
/// The first one whose numbers do not describe it, with the tables and lists around it.
pub fn check(value: &Value) -> Result<()> {
    if Law::of(value)?.is_some() {
        return Ok(());
    }
    if let Some(table) = value.as_table() {
        table.iter().try_for_each(|(name, value)| check(value).with_context(|| name.clone()))?;
    }
    if let Some(list) = value.as_array() {
        list.iter().enumerate().try_for_each(|(place, value)| check(value).with_context(|| format!("[{place}]")))?;
    }
    Ok(())
}

/// Returns a value with a number in the place of every distribution.
///
/// # Errors
/// As [`check`].
pub fn drawn(value: &Value, draws: &mut Draws) -> Result<Value> {
    if let Some(law) = Law::of(value)? {
        return Ok(law.draw(draws));
    }
    if let Some(table) = value.as_table() {
        return Ok(Value::Table(drawn_table(table, draws)?));
    }
    match value.as_array() {
        Some(list) => Ok(Value::Array(list.iter().map(|value| drawn(value, draws)).collect::<Result<_>>()?)),
        None => Ok(value.clone()),
    }
}

/// Returns a table with a number in the place of every distribution.
///
/// # Errors
/// As [`check`].
pub fn drawn_table(table: &Table, draws: &mut Draws) -> Result<Table> {
    table.iter().map(|(name, value)| Ok((name.clone(), drawn(value, draws)?))).collect()
}

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
    use crate::distribution::Purpose;

    fn value(text: &str) -> Value {
        toml::from_str::<Table>(&format!("v = {text}")).unwrap()["v"].clone()
    }

    fn many(text: &str) -> Vec<f64> {
        let (value, mut draws) = (value(text), Draws::new(1, 0, Purpose::Camera));
        (0..2000).map(|_| number_of(&drawn(&value, &mut draws).unwrap()).unwrap()).collect()
    }

    #[test]
    fn numbers_are_within_their_limits_and_reach_them() {
        for (text, low, high) in [("{ uniform = [2, 3] }", 2.0, 3.0), ("{ log_uniform = [0.01, 100] }", 0.01, 100.0)] {
            let numbers = many(text);
            assert!(numbers.iter().all(|number| (low..=high).contains(number)), "{text}");
            let below = numbers.iter().filter(|number| **number < if low < 1.0 { 1.0 } else { 2.5 }).count();
            // Five standard deviations of a fair coin.
            assert!(below.abs_diff(1000) < 112, "{text}: {below}");
        }
        let whole = many("{ integer = [-1, 1] }");
        assert!([-1.0, 0.0, 1.0].iter().all(|wanted| whole.contains(wanted)));
        let spread = many("{ normal = [10, 0.5] }");
        let mean = spread.iter().sum::<f64>() / 2000.0;
        assert!((mean - 10.0).abs() < 5.0 * 0.5 / 2000.0_f64.sqrt(), "{mean}");
    }

    #[test]
    fn distributions_within_lists_and_tables_are_drawn_and_the_rest_stays() {
        let given = value("{ do = \"stray_light\", at = [1, { choice = [5, 5] }], deep = { uniform = [3, 3] } }");
        let mut draws = Draws::new(1, 0, Purpose::Faults);
        assert_eq!(drawn(&given, &mut draws).unwrap(), value("{ do = \"stray_light\", at = [1, 5], deep = 3.0 }"));
    }

    #[test]
    fn distributions_that_cannot_be_drawn_are_refused_with_their_place() {
        let refused = |text: &str| format!("{:#}", check(&value(text)).unwrap_err());
        assert!(refused("{ uniform = [3, 2] }").contains("smaller limit first"));
        assert!(refused("[0, { uniform = [3] }]").starts_with("[1]: uniform"), "{}", refused("[0, { uniform = [3] }]"));
        assert!(refused("{ a = { log_uniform = [0, 1] } }").contains("a: log_uniform: got 0"));
        assert!(refused("{ normal = [0, -1] }").contains("standard deviation"));
        assert!(refused("{ integer = [0.5, 2] }").contains("whole"));
        assert!(refused("{ choice = [] }").contains("list of values"));
        assert!(refused("{ uniform = [0, nan] }").contains("two numbers"));
    }
}

#[cfg(test)]
mod draws_tests {
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
