//! Gauss-Legendre nodes and weights on [-1/2, 1/2], by Newton's method on the Legendre recurrence.
//!
//! Source: Abramowitz and Stegun, section 25.4.29. Exact for polynomials of degree `2 n - 1`; the tests below integrate
//! such polynomials. Integrals and half widths of profiles that depend on the distance alone use them.

use base::bisection::bisected;
use core::cell::RefCell;

/// One node: position in [-1/2, 1/2] and weight; weights sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Position in [-1/2, 1/2].
    pub x: f64,
    /// Weight.
    pub weight: f64,
}

/// Number of Newton steps; convergence is quadratic from the asymptotic start and needs at most six.
const NEWTON_STEPS: usize = 12;

/// Returns the node `i` of `n` (ascending in x).
pub fn gauss_legendre_node(n: usize, i: usize) -> Node {
    let mut x = -(core::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
    let mut slope = 1.0;
    for _ in 0..NEWTON_STEPS {
        let (value, derivative) = legendre(n, x);
        slope = derivative;
        let step = value / slope;
        x -= step;
        if step.abs() < f64::EPSILON {
            slope = legendre(n, x).1;
            break;
        }
    }
    Node { x: 0.5 * x, weight: 1.0 / ((1.0 - x * x) * slope * slope) }
}

/// Returns all `n` nodes, ascending.
pub fn gauss_legendre(n: usize) -> Vec<Node> {
    (0..n).map(|i| gauss_legendre_node(n, i)).collect()
}

/// Largest rule that a thread keeps.
pub const MOST_KEPT_NODES: usize = 520;
/// Number of rules that a thread keeps: a method's, that of the denser list it is compared with, and those of short segments.
const KEPT: usize = 4;

/// The rules that a thread used last: a plan uses the same few many times, and a rule costs the square of its nodes.
struct KeptRules {
    lengths: [usize; KEPT],
    nodes: [[Node; MOST_KEPT_NODES]; KEPT],
    /// The one to replace next.
    oldest: usize,
}

thread_local! {
    // Without a heap: the frame path may be the first to use it.
    static KEPT_RULES: RefCell<KeptRules> = const {
        RefCell::new(KeptRules {
            lengths: [0; KEPT],
            nodes: [[Node { x: 0.0, weight: 0.0 }; MOST_KEPT_NODES]; KEPT],
            oldest: 0,
        })
    };
}

/// Calls `with` with all `n` nodes, ascending, `n` at most [`MOST_KEPT_NODES`]: the same as [`gauss_legendre`], without memory
/// from the heap, and at once when the thread used this `n` a moment ago. `with` must not ask for another rule.
pub fn with_gauss_legendre<T>(n: usize, with: impl FnOnce(&[Node]) -> T) -> T {
    KEPT_RULES.with_borrow_mut(|kept| {
        let at = kept.lengths.iter().position(|length| *length == n).unwrap_or_else(|| {
            let at = kept.oldest;
            kept.oldest = (at + 1) % KEPT;
            kept.lengths[at] = n;
            for (i, node) in kept.nodes[at][..n].iter_mut().enumerate() {
                *node = gauss_legendre_node(n, i);
            }
            at
        });
        with(&kept.nodes[at][..n])
    })
}

/// Returns the integral over a pixel whose centre lies (`x_px`, `y_px`) from the star, of an irradiance that depends on
/// the distance alone, by the tensor rule of these nodes.
pub fn over_pixel(nodes: &[Node], [x_px, y_px]: [f64; 2], irradiance: impl Fn(f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for row in nodes {
        for column in nodes {
            sum += row.weight * column.weight * irradiance((x_px + column.x).hypot(y_px + row.x));
        }
    }
    sum
}

/// Returns the Legendre polynomial of degree `n` and its derivative at `x` in (-1, 1).
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut value) = (1.0, x);
    for k in 2..=n {
        let k = k as f64;
        (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
    }
    (value, n as f64 * (x * value - before) / (x * x - 1.0))
}

/// Returns the integral of `r around(r)` from 0 to `radius_px`, in panels no wider than `panel_px`.
pub(super) fn ringed(radius_px: f64, panel_px: f64, around: impl Fn(f64) -> f64) -> f64 {
    const NODES: usize = 6;
    let nodes = gauss_legendre(NODES);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a radius over a panel's width")]
    let panels = (radius_px / panel_px).ceil().clamp(1.0, 1e4) as u32;
    let width = radius_px / f64::from(panels);
    let panel = |k: u32| -> f64 {
        let at = |x: f64| (f64::from(k) + 0.5 + x) * width;
        nodes.iter().map(|node| node.weight * width * at(node.x) * around(at(node.x))).sum()
    };
    (0..panels).map(panel).sum()
}

/// Returns the distance at which a profile first falls to half of its value at 0, found in steps and then by bisection.
pub(super) fn half_width(step_px: f64, profile: impl Fn(f64) -> f64) -> f64 {
    let half = 0.5 * profile(0.0);
    let mut low = 0.0;
    while profile(low + step_px) > half && low < 1e3 {
        low += step_px;
    }
    bisected([low, low + step_px], 50, |r| half - profile(r) < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_rules_are_the_rules() {
        for n in [1, 2, 7, MOST_KEPT_NODES, 7, 8, 9, 7] {
            with_gauss_legendre(n, |nodes| assert_eq!(nodes, gauss_legendre(n), "n {n}"));
        }
    }

    #[test]
    fn integrates_polynomials_up_to_degree_2n_minus_1_and_no_further() {
        for n in 1..=24_usize {
            let integral = |degree: i32| gauss_legendre(n).iter().map(|p| p.weight * p.x.powi(degree)).sum::<f64>();
            // Integral of x^d over [-1/2, 1/2] = 2^-d / (d + 1) for even d.
            let exact = |degree: i32| 0.5_f64.powi(degree) / f64::from(degree + 1);
            let highest_even = 2 * i32::try_from(n).expect("small") - 2;
            assert!((integral(highest_even) - exact(highest_even)).abs() < 1e-15, "n {n} degree {highest_even}");
            let beyond = highest_even + 2;
            assert!((integral(beyond) - exact(beyond)).abs() > 1e-3 * exact(beyond) / 4.0_f64.powi(beyond), "n {n}");
        }
    }
}
