//! Nonlinear response: charge -> charge as the output shows it, straight pieces between knots.
//!
//! Knot `k` says: `x_k` electrons are seen as `y_k`. The response runs from (0, 0) through the knots in straight lines
//! and goes on past the last as it came; below zero it is the first piece. In the form the loops use, `y = s_1 x + sum
//! (s_{k+1} - s_k) max(x - x_k, 0)`: up to four pieces, three thresholds. Exact for its knots; a smooth curve of second
//! derivative `c` between knots `h` apart is off by `c h^2 / 8` at most.
//!
//! Tests: below, and `tests/physics/response.rs`.

use crate::detector::block::BLOCK;
use base::{fused::mul_add, refused::Refused};

/// Most knots.
pub const MOST_KNOTS: usize = 4;

/// A response, or none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nonlinearity {
    knots_e: [[f64; 2]; MOST_KNOTS],
    count: usize,
}

impl Nonlinearity {
    /// Charge is seen as it is.
    pub const OFF: Self = Self { knots_e: [[0.0; 2]; MOST_KNOTS], count: 0 };

    /// Returns the response through `[electrons, electrons seen]`, both rising.
    ///
    /// # Errors
    /// When there are too many knots, or they do not rise.
    pub fn through(knots_e: &[[f64; 2]]) -> Result<Self, Refused> {
        if knots_e.len() > MOST_KNOTS {
            return Err(Refused(format!("{} knots, the most are {MOST_KNOTS}", knots_e.len())));
        }
        let mut made = Self { count: knots_e.len(), ..Self::OFF };
        let mut before = [0.0; 2];
        for (i, (knot, to)) in knots_e.iter().zip(&mut made.knots_e).enumerate() {
            if knot.iter().any(|e| !e.is_finite()) {
                return Err(Refused(format!("knot {} is not finite", i + 1)));
            }
            if knot[0] <= before[0] || knot[1] <= before[1] {
                return Err(Refused(format!(
                    "knot {}: both numbers must be larger than those of the knot before (the first, larger than 0)",
                    i + 1
                )));
            }
            *to = *knot;
            before = *knot;
        }
        Ok(made)
    }

    /// Returns true if the response is not linear.
    pub fn is_on(&self) -> bool {
        self.count > 0
    }

    /// Returns the knots.
    pub fn knots_e(&self) -> &[[f64; 2]] {
        self.knots_e.get(..self.count).unwrap_or_default()
    }

    /// Returns the factors that the loops (and the shader) multiply with.
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn pieces(&self) -> Pieces {
        let mut pieces = Pieces { slope: 1.0, thresholds_e: [f32::MAX; MOST_KNOTS - 1], steps: [0.0; MOST_KNOTS - 1] };
        let (mut before, mut slope_before) = ([0.0; 2], None);
        for (k, knot) in self.knots_e().iter().enumerate() {
            let slope = (knot[1] - before[1]) / (knot[0] - before[0]);
            match slope_before {
                None => pieces.slope = slope as f32,
                Some(earlier) => {
                    pieces.thresholds_e[k - 1] = before[0] as f32;
                    pieces.steps[k - 1] = (slope - earlier) as f32;
                }
            }
            (before, slope_before) = (*knot, Some(slope));
        }
        pieces
    }
}

/// A response as a slope and its changes at three thresholds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pieces {
    /// Slope from zero.
    pub slope: f32,
    /// Charge at which the slope changes, e-; beyond all numbers where it does not.
    pub thresholds_e: [f32; MOST_KNOTS - 1],
    /// By how much.
    pub steps: [f32; MOST_KNOTS - 1],
}

/// Replaces charge by the charge that is seen.
#[inline(always)]
pub fn bend<const FUSED: bool>(electrons: &mut [f32; BLOCK], pieces: &Pieces) {
    let Pieces { slope, thresholds_e: [t0, t1, t2], steps: [s0, s1, s2] } = *pieces;
    for e in electrons {
        let x = *e;
        let mut y = mul_add::<FUSED>(s0, (x - t0).max(0.0), slope * x);
        y = mul_add::<FUSED>(s1, (x - t1).max(0.0), y);
        *e = mul_add::<FUSED>(s2, (x - t2).max(0.0), y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOTS: [[f64; 2]; 4] = [[1000.0, 980.0], [20_000.0, 19_900.0], [50_000.0, 48_000.0], [60_000.0, 51_000.0]];

    fn seen(nonlinearity: &Nonlinearity, e: f32) -> f64 {
        let mut block = [e; BLOCK];
        bend::<true>(&mut block, &nonlinearity.pieces());
        f64::from(block[7])
    }

    /// Returns the response computed line by line, as a person would draw it.
    fn by_hand(knots: &[[f64; 2]], x: f64) -> f64 {
        let mut from = [0.0, 0.0];
        for (i, to) in knots.iter().enumerate() {
            if x <= to[0] || i + 1 == knots.len() {
                return from[1] + (to[1] - from[1]) * (x - from[0]) / (to[0] - from[0]);
            }
            from = *to;
        }
        x
    }

    #[test]
    fn straight_lines_between_the_knots_and_past_them() {
        for count in 0..=MOST_KNOTS {
            let knots = &KNOTS[..count];
            let response = Nonlinearity::through(knots).expect("rising");
            assert_eq!((response.is_on(), response.knots_e()), (count > 0, knots));
            for x in [-50.0_f32, 0.0, 1.0, 999.0, 1000.0, 1001.0, 19_999.0, 35_000.0, 50_000.0, 55_500.0, 1e5] {
                let (got, wanted) = (seen(&response, x), by_hand(knots, f64::from(x)));
                // Four roundings of f32 at 1e5.
                assert!((got - wanted).abs() < 4.0 * 1e5 * 6e-8, "{count} knots, {x}: {got}, wanted {wanted}");
            }
        }
        let response = Nonlinearity::through(&KNOTS[1..]).expect("rising");
        assert!((seen(&response, 500.0) - by_hand(&KNOTS, 500.0)).abs() > 1.0, "other knots are seen");
    }

    #[test]
    fn knots_that_do_not_rise_are_refused() {
        let refused = |knots: &[[f64; 2]]| Nonlinearity::through(knots).expect_err("refused").to_string();
        assert!(refused(&[[0.0, 1.0]]).contains("knot 1"));
        assert!(refused(&[[10.0, 9.0], [10.0, 10.0]]).contains("knot 2"));
        assert!(refused(&[[10.0, 9.0], [20.0, 9.0]]).contains("knot 2"));
        assert!(refused(&[[10.0, f64::NAN]]).contains("not finite"));
        assert!(refused(&[[1.0, 1.0]; 5]).contains("5 knots"));
        assert!(Nonlinearity::through(&[[10.0, 9.0], [20.0, 9.1]]).is_ok());
    }
}
