//! Values -> px along one axis, and its ticks.

use super::Scale;

/// A tick: its value, and its label where it has one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: Option<String>,
}

/// Number of decades above which the lines between them are omitted.
const DECADES_WITH_LINES: i32 = 6;
/// Labels wanted at most on a logarithmic axis.
const DECADE_LABELS: i32 = 9;
/// Intervals wanted on a linear axis.
const INTERVALS: f64 = 6.0;

/// A range of values laid along a range of px.
#[derive(Debug, Clone)]
pub(super) struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    /// Between ticks of a linear axis.
    step: f64,
    from_px: f64,
    to_px: f64,
}

impl Ruler {
    /// Returns a ruler with space for all `values` (which have a place on it) and round ends.
    pub(super) fn around(scale: Scale, values: impl Iterator<Item = f64>, from_px: f64, to_px: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        values.for_each(|v| (low, high) = (low.min(v), high.max(v)));
        let (low, high) = if low > high { (1.0, 10.0) } else { (low, high) };
        let [low, high, step] = match scale {
            Scale::Log => [round_below(low / 1.1), round_above(high * 1.1), 0.0],
            Scale::Linear => linear_ends(low, high),
            Scale::Share => [0.0, 1.0, 0.2],
        };
        Self { scale, low, high, step, from_px, to_px }
    }

    /// Returns the place of a value.
    pub(super) fn px(&self, value: f64) -> f64 {
        let share = match self.scale {
            Scale::Log => (value.log10() - self.low.log10()) / (self.high.log10() - self.low.log10()),
            Scale::Linear | Scale::Share => (value - self.low) / (self.high - self.low),
        };
        self.from_px + (self.to_px - self.from_px) * share
    }

    /// Ticks from low to high.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        match self.scale {
            Scale::Log => self.decade_ticks(),
            Scale::Linear | Scale::Share => self.linear_ticks(),
        }
    }

    fn decade_ticks(&self) -> Vec<Tick> {
        let [first, last] = [decade(self.low), decade(self.high)];
        let decades = last - first + 1;
        let (every, has_lines) = ((decades - 1) / DECADE_LABELS + 1, decades <= DECADES_WITH_LINES);
        // With one or two decades, 2 and 5 are labelled too.
        let is_short = self.high / self.low < 110.0;
        // One way of writing for all decades of an axis.
        let is_plain = first >= -3 && last <= 3;
        let mut ticks = Vec::new();
        for n in first..=last {
            for digit in 1..if has_lines { 10 } else { 2 } {
                let value = power(n) * f64::from(digit);
                if value < self.low * (1.0 - 1e-9) || value > self.high * (1.0 + 1e-9) {
                    continue;
                }
                let has_label = (digit == 1 && n.rem_euclid(every) == 0) || (is_short && matches!(digit, 2 | 5));
                ticks.push(Tick { value, label: has_label.then(|| label_of(digit, n, is_plain)) });
            }
        }
        ticks
    }

    fn linear_ticks(&self) -> Vec<Tick> {
        let step = self.step;
        let decimals = usize::try_from(-decade(step)).unwrap_or(0);
        let is_long = self.low.abs().max(self.high.abs()) >= 1e6;
        let count = ((self.high - self.low) / step).round();
        let tick = |i: f64| {
            let value = self.low + step * i;
            // Half a step is zero or is not a tick: rounding must not print -0.
            let shown = if value.abs() < 0.5 * step { 0.0 } else { value };
            let text = if is_long && shown != 0.0 { format!("{shown:.1e}") } else { format!("{shown:.decimals$}") };
            Tick { value, label: Some(text) }
        };
        (0..100).map(f64::from).take_while(|i| *i <= count).map(tick).collect()
    }
}

/// Returns the power of ten at or below a positive value.
fn decade(value: f64) -> i32 {
    #[allow(clippy::cast_possible_truncation, reason = "the exponents of f64 are within 400")]
    let n = (value.log10() + 1e-9).floor() as i32;
    n
}

fn power(n: i32) -> f64 {
    10_f64.powi(n)
}

fn label_of(digit: i32, n: i32, is_plain: bool) -> String {
    let decimals = usize::try_from(-n).unwrap_or(0);
    if is_plain {
        format!("{:.decimals$}", f64::from(digit) * power(n))
    } else if digit == 1 {
        format!("10{}", superscript(n))
    } else {
        format!("{digit}\u{b7}10{}", superscript(n))
    }
}

/// Returns the raised digits: characters of their own, since not every renderer places a raised `tspan` well.
fn superscript(n: i32) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raised = |c: char| c.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]);
    n.to_string().chars().map(raised).collect()
}

/// Returns the largest of 1, 2, 5 times a power of ten that is not above `value`.
fn round_below(value: f64) -> f64 {
    let unit = power(decade(value));
    [5.0, 2.0].into_iter().map(|digit| digit * unit).find(|round| *round <= value).unwrap_or(unit)
}

/// Returns the smallest of 1, 2, 5 times a power of ten that is not below `value`.
pub(in crate::report) fn round_above(value: f64) -> f64 {
    let unit = power(decade(value));
    [1.0, 2.0, 5.0].into_iter().map(|digit| digit * unit).find(|round| *round >= value).unwrap_or(10.0 * unit)
}

/// Returns the low and high end and the step between ticks.
fn linear_ends(low: f64, high: f64) -> [f64; 3] {
    let (low, high) = if high > low { (low, high) } else { (low - 0.5, high + 0.5) };
    let step = round_above((high - low) / INTERVALS);
    [(low / step).floor() * step, (high / step).ceil() * step, step]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, values: &[f64]) -> Vec<String> {
        let ruler = Ruler::around(scale, values.iter().copied(), 0.0, 100.0);
        ruler.ticks().into_iter().filter_map(|tick| tick.label).collect()
    }

    #[test]
    fn decades_are_labelled_and_values_keep_their_order() {
        assert_eq!(labels(Scale::Log, &[0.02, 300.0]), ["0.01", "0.1", "1", "10", "100"]);
        assert_eq!(labels(Scale::Log, &[1.5, 7.0]), ["1", "2", "5", "10"]);
        assert_eq!(labels(Scale::Log, &[1e-9, 1e-4]), ["10⁻⁹", "10⁻⁸", "10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴"]);
        assert!(labels(Scale::Log, &[1e-30, 1e30]).len() <= 10, "thinned");
        let ruler = Ruler::around(Scale::Log, [1.0, 1000.0].into_iter(), 10.0, 90.0);
        assert!(ruler.px(1.0) < ruler.px(10.0) && ruler.px(10.0) < ruler.px(1000.0));
        assert!(ruler.px(1.0) > 10.0 && ruler.px(1000.0) < 90.0, "with space at the ends");
    }

    #[test]
    fn linear_ticks_are_round() {
        assert_eq!(labels(Scale::Linear, &[0.0, 10.0]), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(Scale::Linear, &[-0.1, 0.1]), ["-0.10", "-0.05", "0.00", "0.05", "0.10"]);
        let around_7 = labels(Scale::Linear, &[7.0]);
        assert!(
            around_7.len() >= 5 && around_7.contains(&"7.0".to_owned()),
            "one value has space around it: {around_7:?}"
        );
        assert_eq!(labels(Scale::Share, &[1.0]), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"], "whatever the values are");
        assert_eq!(labels(Scale::Linear, &[0.0, 2e7]).last().map(String::as_str), Some("2.0e7"), "short");
    }

    #[test]
    fn nothing_to_show_still_has_an_axis() {
        assert!(labels(Scale::Log, &[]).contains(&"1".to_owned()));
        assert!(!labels(Scale::Linear, &[]).is_empty());
    }
}
