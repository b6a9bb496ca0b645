//! Derivatives that rows state (rates, velocities) beside the differences of their values (attitudes, positions).
//!
//! Between two rows `h` apart the difference quotient `d` of a smooth motion is the mean of the stated derivatives less
//! `h^2 / 12` times their second derivative, which the neighbouring rows show. The rest is the *residual* of the step.
//! A step contradicts itself where its residual is more than
//!
//! `2 max(s, m) + floor`
//!
//! * `s`: how far the stated derivatives, and the differences beside them, are off a straight line through the
//!   neighbouring rows. A change of the derivative within the step (thrust, the beginning of a slew) gives a residual of at
//!   most half of it, a slew that begins and ends within the step one of `s`;
//! * `m`: the median of `s` over the segment: the noise of measured rows;
//! * `floor`: what rounded numbers may do ([`Floor`]).
//!
//! Another unit, sign, order or frame contradicts in most steps, an event in few. Tests: `tests::contradictions`.

use glam::DVec3;

/// Part of a residual that the acceleration between rows explains, times this.
const EXPLAINED: f64 = 2.0;
/// Largest error of a cubic whose slopes at both ends are off by 1, for a step of 1: `u (1 - u) (1 - 2 u)`.
const CUBIC_OF_SLOPES: f64 = 0.0963;

/// The step from a row to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) s: f64,
    /// Derivatives of both rows.
    pub(crate) stated: [DVec3; 2],
    /// Difference quotient of the values, less the mean of the derivatives.
    pub(crate) beside: DVec3,
}

/// Bounds of the part of a residual that rounding makes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Floor {
    /// Part of the derivative.
    pub(crate) part: f64,
    /// Rounding of a value.
    pub(crate) value: f64,
    /// Most that `part` may make of a value within a step.
    pub(crate) most: f64,
}

/// Comparison of the steps of one segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Comparison {
    pub(crate) steps: usize,
    /// Steps that contradict themselves.
    pub(crate) contradicting: usize,
    /// Place of the first of them, with its mean derivative as the rows state it, and as their values have it.
    pub(crate) first: Option<(usize, [DVec3; 2])>,
    /// Error of cubics through the rows in value, and of the derivatives, as residuals show it.
    pub(crate) errors: [f64; 2],
}

impl Comparison {
    /// Returns true where the contradiction is that of the file, not of an event in it.
    pub(crate) fn is_of_most(&self) -> bool {
        2 * self.contradicting > self.steps
    }

    /// Returns what to say of a contradiction in a segment, numbered from 1; `None` without one.
    pub(crate) fn words(&self, segment: usize, names: Names) -> Option<String> {
        let (place, [stated, differing]) = self.first?;
        let Names { derivatives, values, unit, unit_is } = names;
        let [stated, differing] = [stated, differing].map(|v| vector(v / unit_is));
        Some(format!(
            "the {derivatives} contradict the {values} in {} of {} steps: from row {} to row {} of segment {segment} the \
             {derivatives} say {stated} {unit}, the {values} {differing}",
            self.contradicting,
            self.steps,
            place + 1,
            place + 2
        ))
    }
}

/// Names of a derivative and of its values, for messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Names {
    pub(crate) derivatives: &'static str,
    pub(crate) values: &'static str,
    pub(crate) unit: &'static str,
    /// The unit, in that of the derivatives.
    pub(crate) unit_is: f64,
}

/// Returns three numbers as messages show them.
fn vector(v: DVec3) -> String {
    let [x, y, z] = v.to_array();
    let largest = v.abs().max_element();
    if (0.01..1e5).contains(&largest) {
        format!("[{x:.4}, {y:.4}, {z:.4}]")
    } else {
        format!("[{x:.2e}, {y:.2e}, {z:.2e}]")
    }
}

/// Compares the steps of a segment, which follow each other; `None` without steps.
pub(crate) fn compare(steps: &[Step], floor: Floor) -> Option<Comparison> {
    let bends: Vec<Bend> = (0..steps.len()).map(|place| Bend::of(steps, place)).collect();
    let mut sizes: Vec<f64> = bends.iter().map(|bend| bend.size).collect();
    let middle = sizes.len() / 2;
    let noise = if sizes.is_empty() { return None } else { *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 };
    let mut found = Comparison { steps: steps.len(), contradicting: 0, first: None, errors: [0.0; 2] };
    for (place, (step, bend)) in steps.iter().zip(&bends).enumerate() {
        let residual = (step.beside + bend.second / 12.0).length();
        let largest = step.stated[0].length().max(step.stated[1].length());
        let rounding = (floor.part * largest).min(floor.most / step.s) + floor.value / step.s;
        if residual > EXPLAINED * bend.size.max(noise) + rounding {
            found.contradicting += 1;
            let mean = (step.stated[0] + step.stated[1]) / 2.0;
            found.first = found.first.or(Some((place, [mean, mean + step.beside])));
        }
        // At the ends the second derivative is that of the next step: less sharp, and taken only where it is the only one.
        if bend.is_inside || steps.len() == 2 {
            let errors = [CUBIC_OF_SLOPES * residual * step.s, residual];
            found.errors = core::array::from_fn(|n| found.errors[n].max(errors[n]));
        }
    }
    Some(found)
}

/// How the derivative bends about a step.
struct Bend {
    /// Second derivative times the step squared.
    second: DVec3,
    /// Distance of derivatives and differences from a straight line through their neighbours.
    size: f64,
    is_inside: bool,
}

impl Bend {
    fn of(steps: &[Step], place: usize) -> Self {
        let step = &steps[place];
        let rise = step.stated[1] - step.stated[0];
        let before = place.checked_sub(1).map(|place| &steps[place]);
        let after = steps.get(place + 1);
        // Beyond the straight line of the step before, or after; the second derivative that this is.
        let off = |other: &Step| rise - (other.stated[1] - other.stated[0]) * (step.s / other.s);
        let second = |other: &Step, sign: f64| off(other) * (sign * 2.0 * step.s / (step.s + other.s));
        let seconds = [before.map(|other| second(other, 1.0)), after.map(|other| second(other, -1.0))];
        let beside = match (before, after) {
            (Some(before), Some(after)) => step.beside - (before.beside + after.beside) / 2.0,
            (Some(other), None) | (None, Some(other)) => step.beside - other.beside,
            (None, None) => rise,
        };
        let sizes = [before, after].into_iter().flatten().map(|other| off(other).length());
        let second = match seconds {
            [Some(before), Some(after)] => (before + after) / 2.0,
            [before, after] => before.or(after).unwrap_or_default(),
        };
        let is_inside = before.is_some() && after.is_some();
        Self { second, size: sizes.fold(beside.length(), f64::max), is_inside }
    }
}
