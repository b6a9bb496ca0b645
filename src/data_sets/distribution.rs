//! Values that are drawn: a table with the name of a distribution in place of a value.
//!
//! In: a TOML value, such as `{ uniform = [0.0, 2.0] }`, `[1, { normal = [0, 0.1] }]` or a plain number. Out: the same
//! value with a number in the place of every distribution. Distributions: `uniform` and `log_uniform` (two limits),
//! `normal` (mean, standard deviation), `integer` (two limits, both included), `choice` (a list of values).

use crate::draws::Draws;
use anyhow::{Context, Result, bail};
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draws::Purpose;

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
